"""Units with undeclared effects on a table under command: minutes until they are named, planned and not planned.

    python benchmarks/investigate.py --set tests/undeclared/NAME.py [--units N] [--hours H] [-o RESULT.json]

Each effect of a set (tests/undeclared/README.md) is on a unit of its own, which a table of three axes turns. What
happens there is simulated without a wire: the motion, white noise, biases, and the effect, called at each loop of the
unit; what the planner gets are means over six loops, 22 Hz. The unit warms up by 16 K and follows a room that goes up
and down by 3 K within 40 minutes. Of each motion 15 s go by in which nothing is recorded.

Three strategies have the same time: `imutui investigate` with its planner; a fixed profile again and again (six
positions, rates of both signs on each axis); motions drawn from the planner's list. What there is so far is traced as
often in all three. An effect is named when the rules of `undeclared_score` hold on all channels where it is visible (d
of 15 in any strategy), and done when besides the error of a run at another power-on is at most 1.2 of its floor there.
"""

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import undeclared_score as score
import undeclared_sets as sets
from undeclared_sets import Undeclared

from filters.channels import CHANNELS, DPS, G
from filters.imu import IMU400CD_200, LOOP_HZ, AxisMap
from filters.motion.segments import AXES, SIX
from filters.simulation.scenario import Temperature, draw
from filters.simulation.truth import World
from filters.state import PAPER_SITE
from filters.tracing import planning, table_motions
from filters.tracing.assessment import Assessment
from filters.tracing.candidate_motions import CandidateMotion
from filters.tracing.run import Run
from filters.tracing.table_motions import AxisRange, Table
from filters.tracing.trace import trace
from filters.tracing.trace_document import TraceFindings
from filters.types import Array
from imutui.cli.spoil import load, seed_of
from imutui.jobs.investigation import OVERHEAD_S, Investigation
from imutui.jobs.investigation_diary import Diary, RoundEntry

AVERAGED = 6  # loops that make a sample
TABLE: Table = {axis: AxisRange(math.radians(200.0), math.radians(200.0)) for axis in AXES}
ROOM, WARM_UP, WARM_UP_S, SWING, SWING_S = 22.0, 16.0, 900.0, 3.0, 2400.0
IN_BAND = 1.2
_DENSITY = np.repeat([IMU400CD_200.gyro_arw, IMU400CD_200.accel_vrw], 3)
_SI = np.repeat([DPS, G], 3)


def temperature(seconds: float) -> Temperature:
    t = np.arange(0.0, seconds + 600.0, 20.0)
    degc = ROOM - WARM_UP * np.expm1(-t / WARM_UP_S) + SWING * np.sin(2.0 * math.pi * t / SWING_S)
    return Temperature(tuple(zip(t.tolist(), degc.tolist(), strict=True)))


@dataclass
class SimulatedUnit:
    """A unit of a set from power-on: it makes the motions that it is told to, one after the other."""

    effect: Undeclared
    hours: float
    power_on: int = 0
    now_s: float = 0.0
    table: Table = field(default_factory=lambda: TABLE)
    moments: Array = field(default_factory=lambda: np.zeros((3, 6)))  # of the effect so far: count, sum, sum of squares

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng([self.effect.seed, 7, self.power_on])
        self._error = load(self.effect.spec).make(seed_of(self.effect.seed, self.power_on))
        biases = draw(self.effect.seed)
        axes = self._axes = AxisMap()
        self._bias = np.concatenate(
            [axes.gyro_to_instrument(biases.gyro_bias), axes.accel_to_instrument(biases.accel_bias)]
        )
        self._temperature = temperature(self.hours * 3600.0)

    def make(self, motion: CandidateMotion, name: str) -> Run:
        """Record a motion; the time goes on by it, and by what comes to it."""
        self._pass(OVERHEAD_S, motion)
        begins, count = self.now_s, int(motion.seconds * LOOP_HZ) // AVERAGED * AVERAGED
        world = World(motion.profile, PAPER_SITE, self._axes)
        t = np.arange(count) / LOOP_HZ
        perfect, angles, rates = world.perfect(t), world.angles(t), world.rates(t)
        degc = self._temperature.at(begins + t)
        error = self._errors(begins + t, degc, np.rad2deg(angles), np.rad2deg(rates), perfect / _SI)
        self.now_s += motion.seconds
        self.moments += np.stack([np.full(6, float(len(error))), error.sum(axis=0), (error**2).sum(axis=0)])
        reading = perfect + self._bias + error * _SI
        mean = reading.reshape(-1, AVERAGED, 6).mean(axis=1)
        mean += self._rng.standard_normal(mean.shape) * _DENSITY * math.sqrt(LOOP_HZ / AVERAGED)
        middle = np.asarray((np.arange(len(mean)) * AVERAGED + 0.5 * (AVERAGED - 1)) / LOOP_HZ, np.float64)
        sensed = self._temperature.at(begins + middle) + 0.02 * self._rng.standard_normal(middle.size)
        return Run(
            name, middle - middle[0], mean, np.round(sensed / 0.05) * 0.05, world.angles(middle), world.rates(middle),
            self._axes, PAPER_SITE, power_on="one", begins=begins, history_known=begins > 2.0 * OVERHEAD_S,
        )  # fmt: skip

    @property
    def d(self) -> dict[str, float]:
        """Norm of the effect about its mean so far over white noise, by channel."""
        count, total, squares = self.moments
        about = np.maximum(squares - total**2 / np.maximum(count, 1.0), 0.0)
        return dict(zip(CHANNELS, (np.sqrt(about / LOOP_HZ) * _SI / _DENSITY).tolist(), strict=True))

    def _pass(self, seconds: float, motion: CandidateMotion) -> None:
        """Let time go by where the motion begins."""
        t = self.now_s + np.arange(int(seconds * LOOP_HZ)) / LOOP_HZ
        world = World(motion.profile, PAPER_SITE, self._axes)
        still = np.full(1, -1.0)
        one = [np.repeat(x, t.size, axis=0) for x in (world.angles(still), world.rates(still), world.perfect(still))]
        self._errors(t, self._temperature.at(t), np.rad2deg(one[0]), np.rad2deg(one[1]), one[2] / _SI)
        self.now_s += seconds

    def _errors(self, t: Array, degc: Array, ang: Array, rate: Array, perfect: Array) -> Array:
        """The effect at each loop, deg/s and g, shape (N, 6)."""
        rows = zip(t.tolist(), degc.tolist(), ang, rate, perfect[:, :3], perfect[:, 3:], strict=True)
        return np.array([self._error(*row) for row in rows], np.float64)


# --------------------------------------------------------------------------------------------------------- strategies


@dataclass
class Checks:
    """What traces of a strategy say as its time goes on."""

    truth: Undeclared
    judge: Run  # of another power-on, which nothing is fitted to
    rows: list[dict[str, Any]] = field(default_factory=list)

    def check(self, runs: Sequence[Run], seconds: float, unit: SimulatedUnit) -> bool:
        """Trace with the judging run held out; returns whether all that is visible is named, and at its floor."""
        document = trace(runs, self.judge).document
        d = unit.d
        judged = score.judged(self.truth, d, dict(document), None)
        error = {
            str(e["channel"]): e["after_x_floor"] for e in document["error"]
            if e["metric"] == "e10" and e["after_x_floor"] is not None
        }  # fmt: skip
        self.rows.append({
            "minutes": round(seconds / 60.0, 1), "d": {c: round(v, 1) for c, v in d.items()},
            "named": judged["named_rightly"], "explained_wrongly": judged["explained_wrongly"],
            "false_on_untouched": judged["false_on_untouched"],
            "told": sorted({(c, f["effect"]) for f in document["findings"] for c in f["channels"]}),
            "status": document["status"], "x_floor": {c: round(v, 2) for c, v in error.items()},
        })  # fmt: skip
        visible = [c for c in self.truth.channels if d[c] >= sets.VISIBLE_D]
        return bool(visible) and is_done(self.rows[-1], visible)


def is_done(row: dict[str, Any], visible: Sequence[str]) -> bool:
    """Whether all visible channels are named rightly, and their error on the judging run is at its floor."""
    return set(visible) <= set(row["named"]) and all(row["x_floor"].get(c, 0.0) <= IN_BAND for c in visible)


class SimulatedLaboratory:
    """The unit of an effect, and the runs that were made with it."""

    def __init__(self, unit: SimulatedUnit) -> None:
        self.unit, self.table, self._runs = unit, unit.table, dict[str, Run]()

    def now_s(self) -> float:
        return self.unit.now_s

    def record(self, motion: CandidateMotion, number: int) -> str:
        name = f"{number:02d}"
        self._runs[name] = self.unit.make(motion, name)
        return name

    def runs(self, rounds: Sequence[RoundEntry]) -> list[Run]:
        return [self._runs[entry["log"]] for entry in rounds]

    def judged(self, rounds: Sequence[RoundEntry]) -> TraceFindings:
        *fitted, held = self.runs(rounds)
        self.document = trace(fitted, held).document
        return self.document


class Followed(Investigation):
    """An investigation whose traces are checked against the truth, which it is not told."""

    checks: Checks

    def _known(self) -> tuple[Assessment, planning.Planner, float | None]:
        laboratory = self.laboratory
        assert isinstance(laboratory, SimulatedLaboratory)
        self.checks.check(laboratory.runs(self.diary.made), self.spent_s, laboratory.unit)
        return super()._known()


def planned(effect: Undeclared, hours: float, judge: Run) -> dict[str, Any]:
    """The investigation, to its own end."""
    laboratory = SimulatedLaboratory(SimulatedUnit(effect, hours))
    diary = Diary.begun(hours, None)
    going = Followed(laboratory, diary)
    going.checks = Checks(effect, judge)
    outcome = going.go()
    end = score.judged(effect, laboratory.unit.d, dict(laboratory.document), None)
    return {
        "rows": going.checks.rows, "outcome": outcome, "minutes": round(laboratory.unit.now_s / 60.0, 1),
        "explained_wrongly": end["explained_wrongly"], "outside_log_explained": end["outside_log_explained"],
        "false_on_untouched": end["false_on_untouched"], "status": laboratory.document["status"],
        "rounds": [[e["motion"], e["expected_bits"], e["why"], e["came"]] for e in diary.made],
    }  # fmt: skip


def unplanned(effect: Undeclared, hours: float, judge: Run, motions: Iterator[CandidateMotion]) -> dict[str, Any]:
    """Motions one after the other until all is named, traced as often as those of an investigation are."""
    unit, checks, runs = SimulatedUnit(effect, hours), Checks(effect, judge), list[Run]()
    at_s = sum(m.seconds + OVERHEAD_S for m in table_motions.start(TABLE))
    for motion in motions:
        if unit.now_s + motion.seconds + OVERHEAD_S > hours * 3600.0:
            break
        runs.append(unit.make(motion, f"{len(runs):02d}"))
        if unit.now_s >= at_s:
            if checks.check(runs, unit.now_s, unit):
                break
            at_s = unit.now_s + max(240.0, 0.25 * unit.now_s)
    return {"rows": checks.rows, "minutes": round(unit.now_s / 60.0, 1)}


def fixed() -> Iterator[CandidateMotion]:
    """Six positions, then rates of both signs about each axis, again and again."""
    shares = (0.25, -0.25, 0.5, -0.5, 1.0, -1.0)
    while True:
        for name, segments in (
            ("six positions", table_motions.held(SIX, 30.0)),
            *((f"rates about {axis}", table_motions.turned(TABLE, axis, shares, 15.0)) for axis in AXES),
        ):
            motion = table_motions.commanded(name, segments, TABLE)
            assert motion is not None
            yield motion


def drawn(seed: int) -> Iterator[CandidateMotion]:
    """Any motion of the planner's list."""
    rng, every = np.random.default_rng(seed), table_motions.rounds(TABLE, None)
    while True:
        yield every[int(rng.integers(len(every)))]


STRATEGIES: dict[str, Callable[[Undeclared, float, Run], dict[str, Any]]] = {
    "planned": planned,
    "fixed": lambda effect, hours, judge: unplanned(effect, hours, judge, fixed()),
    "random": lambda effect, hours, judge: unplanned(effect, hours, judge, drawn(effect.seed)),
}


def one(effect: Undeclared, hours: float, wanted: Sequence[str]) -> dict[str, Any]:
    """All strategies on the unit of an effect."""
    apart = table_motions.held_out(TABLE, None, 3)
    assert apart is not None
    other = SimulatedUnit(effect, 1.0, power_on=1)
    judge = replace(other.make(apart, "judge"), power_on="", begins=0.0, history_known=False)
    made = {}
    for name in wanted:
        began = time.process_time()
        made[name] = STRATEGIES[name](effect, hours, judge) | {"cpu_s": round(time.process_time() - began)}
        print(f"{effect.name} {name}: {made[name]['cpu_s']} s", file=sys.stderr, flush=True)
    d = {c: max(row["d"][c] for own in made.values() for row in own["rows"]) for c in effect.channels}
    visible = [c for c, value in d.items() if value >= sets.VISIBLE_D]
    for own in made.values():
        done = [row["minutes"] for row in own["rows"] if is_done(row, visible)]
        named = [row["minutes"] for row in own["rows"] if set(visible) <= set(row["named"])]
        own["named_min"] = min(named, default=None) if visible else None
        own["done_min"] = min(done, default=None) if visible else None
    return {"truth": effect.truth(), "visible": visible, "strategies": made}


def table(results: dict[str, Any]) -> list[str]:
    """Rows of Markdown: minutes until named, and until done, by strategy."""
    wanted = list(next(iter(results.values()))["strategies"])
    rows = [f"| effect | driver | visible | {' | '.join(f'{w}: named, done' for w in wanted)} | end |"]
    rows.append("|---" * (len(wanted) + 4) + "|")
    for name, own in results.items():
        cells = [f"{_min(s['named_min'])}, {_min(s['done_min'])}" for s in own["strategies"].values()]
        end = own["strategies"].get("planned", {})
        said = f"{end.get('outcome', '')} {end.get('minutes', '')} min {end.get('explained_wrongly') or ''}"
        driver = " ".join(own["truth"]["driver"])
        rows.append(f"| {name} | {driver} | {' '.join(own['visible'])} | {' | '.join(cells)} | {said} |")
    asked = [own for own in results.values() if own["visible"] and own["truth"]["in_log"]]
    for w in wanted:
        done = [own["strategies"][w]["done_min"] for own in asked if own["strategies"][w]["done_min"] is not None]
        named = sum(own["strategies"][w]["named_min"] is not None for own in asked)
        half = f", median {np.median(done):.0f} min" if done else ""
        rows.append(f"\n{w}: named {named} of {len(asked)}, done {len(done)}{half}")
    if {"planned", "fixed"} <= set(wanted):
        both = [(own["strategies"]["planned"]["done_min"], own["strategies"]["fixed"]["done_min"]) for own in asked]
        ratios = [a / b for a, b in both if a is not None and b is not None]
        if ratios:
            rows.append(f"planned over fixed, of {len(ratios)} done by both: median {np.median(ratios):.2f}")
    wrong = sum(bool(own["strategies"].get("planned", {}).get("explained_wrongly")) for own in results.values())
    rows.append(f"explained wrongly at the end of an investigation: {wrong} of {len(results)}")
    return rows


def _min(value: float | None) -> str:
    return "–" if value is None else f"{value:.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--set", type=Path, required=True, metavar="FILE.py")
    parser.add_argument("--units", type=int, help="the first so many of the set")
    parser.add_argument("--case", nargs="*")
    parser.add_argument("--hours", type=float, default=2.0)
    parser.add_argument("--strategies", nargs="*", default=list(STRATEGIES))
    parser.add_argument("-o", "--output", type=Path)
    chosen = parser.parse_args()
    effects = [e for e in sets.load_set(chosen.set) if chosen.case is None or e.name in chosen.case][: chosen.units]
    results: dict[str, Any] = {}
    for effect in effects:
        results[effect.name] = one(effect, chosen.hours, chosen.strategies)
        if chosen.output is not None:
            document = {"version": 1, "set": chosen.set.name, "hours": chosen.hours, "units": results}
            chosen.output.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    print("\n".join(table(results)))


if __name__ == "__main__":
    main()

"""From logs of a unit turned by hand to its effects: rests found, forms chosen, everything judged on what is left out.

Each step before is a module of its own; the package's docstring lists them in order. Errors are those of a log that
nothing was fitted to, or of every rest and turn left out in turn: `gravity_norm`, the magnitude of the corrected
specific force of a rest less gravity's, and `gravity_direction`, the angle between a rest's direction of gravity,
carried through the turn by the gyros, and the next rest's. Before: readings as they are, gyros less their mean at rest,
which is the model of constant biases.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from filters.channels import ACCELS, DPS, GYROS, MG
from filters.effects.hypothesis import Hypothesis
from filters.errors import InputError
from filters.multiposition import choice, rests
from filters.multiposition.accelerometer import Rests
from filters.multiposition.carry_over import Spread, measured_again, spreads
from filters.multiposition.choice import Choice
from filters.multiposition.rests import Rest
from filters.multiposition.triad import Triad
from filters.multiposition.turns import Turns
from filters.tracing.error_figure import DRAWS, ErrorFigure, chi2_quantiles, rms, rms_interval
from filters.tracing.run import Run
from filters.tracing.screening import FaultOfRun, without_faults
from filters.tracing.trace_document import HeldOut
from filters.types import Array

Progress = Callable[[float, str], None]
FEWEST = 3  # errors of which a figure is made


@dataclass(frozen=True)
class Metric:
    """An error of rests or of turns."""

    name: str
    unit: str
    si: float  # of the unit
    freedom: int  # directions that the error is in


NORM, DIRECTION = Metric("gravity_norm", "mg", MG, 1), Metric("gravity_direction", "deg", DPS, 2)


@dataclass(frozen=True)
class Sensors:
    """A triad, calibrated and judged."""

    chosen: Choice
    observed: Rests | Turns  # what was fitted to
    apart: Rests | Turns | None  # of a log that judges, with turns if they are of gyros
    metric: Metric
    figure: ErrorFigure | None = None  # errors before and after; None of too few
    spreads: tuple[Spread, ...] = ()  # of kinds of effects between power-ons; none of a single one
    # what a new power-on must measure again; and the turns of the log that judges with its accelerometers so measured
    again: tuple[Spread, ...] = ()
    sensed_again: Turns | None = None

    def errors(self, chosen: Choice | None = None) -> Array:
        """Errors on the log that judges, SI, with another choice of effects if given one; none without such a log."""
        if self.apart is None:
            return np.zeros(0)
        chosen = chosen or self.chosen
        if isinstance(self.apart, Turns):
            return self.apart.errors(chosen.triad, _own_biases(chosen, self.apart))
        return self.apart.errors(chosen.triad, chosen.mean)

    def errors_again(self, chosen: Choice | None = None, but: Hypothesis | None = None) -> Array:
        """The same, with what a power-on must measure again, but one, measured on that log, rests left out in turn."""
        chosen = chosen or self.chosen
        if self.sensed_again is not None:
            return self.sensed_again.errors(chosen.triad, _own_biases(chosen, self.sensed_again))
        if self.again and isinstance(self.apart, Rests) and self.apart.judged >= FEWEST:
            again = [replace(one, effects=tuple(e for e in one.effects if e != but)) for one in self.again]
            return measured_again(chosen, again, self.apart)[1]
        return self.errors(chosen)


@dataclass(frozen=True)
class Calibration:
    """What units turned by hand show."""

    logs: tuple[tuple[Run, tuple[Rest, ...]], ...]  # all, each a power-on, with its rests; the one that judges last
    heldout: bool  # whether one judges; else rests and turns are left out in turn
    directions: int  # distinct ones, of all that were fitted to together
    accelerometers: Sensors
    gyros: Sensors | None  # None without them, or without a turn
    faults: tuple[FaultOfRun, ...]  # of the data

    @property
    def power_ons(self) -> int:
        """How many there are, the one that judges among them."""
        return len(rests.power_ons([run for run, _ in self.logs])[0])

    @property
    def sensors(self) -> tuple[Sensors, ...]:
        """Of both kinds, as far as there are any."""
        return (self.accelerometers,) if self.gyros is None else (self.accelerometers, self.gyros)


def calibrate(
    runs: Sequence[Run],
    heldout: Run | None,
    seed: int = 0,
    progress: Progress = lambda share, text: None,
) -> Calibration:
    """Calibrate a unit that was turned by hand between rests.

    `runs`: logs of one unit to fit to, each a power-on.
    `heldout`: a log to judge on.
    `seed`: of intervals.
    `progress`: told a share from 0 to 1 and what is being done.
    Raises InputError if a log has no rests or lacks an accelerometer; the message names it.
    """
    progress(0.0, "looking for rests")
    cleaned = [without_faults(run, by_hand=True) for run in (*runs, *([] if heldout is None else [heldout]))]
    faults = tuple(fault for _, own in cleaned for fault in own)
    runs, heldout = [run for run, _ in cleaned[: len(runs)]], None if heldout is None else cleaned[-1][0]
    found = [_rests_of(run) for run in runs]
    every = [rest for own in found for rest in own]
    power_on = np.repeat(rests.power_ons(runs)[1], [len(own) for own in found])
    observed, directions = Rests.of(every, runs[0].site.gravity, power_on), rests.distinct_directions(every)
    if directions < 2:
        raise InputError(
            f"{', '.join(run.name for run in runs)}: the unit was never turned: {len(every)} rests, all in one"
            " direction. Lay it down in at least nine; or trace it at rest: --reference gravity."
        )
    progress(0.1, "fitting accelerometers")
    chosen = choice.accelerometers(observed, directions)
    if observed.logs > 1 and "bias" not in (differs := _differing(chosen, observed)):
        # a power-on of few rests says little of its own bias, and nothing more is asked of it
        chosen = choice.accelerometers(observed, directions, ())
    elif observed.logs > 1 and len(differs) > 1:
        chosen = choice.owning(chosen, differs, observed)
    turned = _turned(runs, found, chosen.triad, chosen.own)
    progress(0.2, "fitting gyros")
    made = None if turned is None else choice.gyros(turned)
    if made is not None and turned is not None and (differs := _differing(made, turned)):
        made = choice.owning(made, list(dict.fromkeys(["bias", *differs])), turned)
    apart = [] if heldout is None else [(heldout, _rests_of(heldout))]
    progress(0.7, "judging")
    judge, judge_turned = None, None
    for run, own in apart:
        judge, judge_turned = Rests.of(own, run.site.gravity), _turned([run], [own], chosen.triad, [chosen.mean])
    how = _how(runs, heldout)
    norms = _norms_left_out(observed, chosen) if heldout is None else None
    accelerometers, gyros = _judged(Sensors(chosen, observed, judge, NORM), norms, how, seed), None
    if turned is not None and made is not None:
        angles = _directions_left_out(observed, chosen, turned, made) if heldout is None else None
        gyros = _judged(Sensors(made, turned, judge_turned, DIRECTION), angles, how, seed)
    progress(0.9, "comparing power-ons")
    accelerometers = _compared(accelerometers, how)
    if gyros is not None:
        gyros = _compared(gyros, how)
        if accelerometers.again and heldout is not None and judge is not None:
            theta, _ = measured_again(chosen, accelerometers.again, judge)
            gyros = replace(gyros, sensed_again=_turned([heldout], [apart[0][1]], chosen.triad, [theta]))
    progress(1.0, "done")
    logs = (*zip(runs, found, strict=True), *apart)
    return Calibration(logs, heldout is not None, directions, accelerometers, gyros, faults)


def _rests_of(run: Run) -> tuple[Rest, ...]:
    if not rests.has(run, ACCELS):
        have = rests.recorded(run)
        lack = ", ".join(name for name, c in zip(("x", "y", "z"), ACCELS, strict=True) if not have[c])
        raise InputError(
            f"{run.name}: accelerometer {lack} was not recorded, or reads the same throughout, and the magnitude of"
            " gravity takes all three. Record all of them, or trace the log at one rest: --reference gravity with"
            " --start and --end on import."
        )
    found = rests.find_rests(run)
    if not found:
        raise InputError(
            f"{run.name}: no rest was found: nowhere do all channels stay quiet for {rests.WINDOW_S:g} s together. Put"
            " the unit down for some seconds in at least nine directions."
        )
    return found


def _turned(
    runs: Sequence[Run], found: Sequence[Sequence[Rest]], accelerometers: Triad, theta: Sequence[Array]
) -> Turns | None:
    if not all(rests.has(run, GYROS) for run in runs):
        return None
    turned = Turns(runs, found)
    turned.sense(accelerometers, theta)
    return turned


def _how(runs: Sequence[Run], apart: Run | None) -> HeldOut:
    """What judges: rests left out in turn, another power-on, or another part of one that was fitted to."""
    if apart is None:
        return "folds"
    return "part" if apart.power_on and any(run.power_on == apart.power_on for run in runs) else "run"


def _norms_left_out(rests: Rests, chosen: Choice) -> Array:
    """Error of the magnitude at every rest with a fit to all others, m/s², shape (n,)."""
    out = np.empty(len(rests.mean))
    for k in range(out.size):
        made = rests.without([k]).fit(chosen.triad, chosen.fit.theta, chosen.fit.excess)
        out[k] = rests.errors(chosen.triad, made.theta)[k]
    return out


def _directions_left_out(rests: Rests, accelerometers: Choice, observed: Turns, gyros: Choice) -> Array:
    """Angle that every turn misses by, with both its rests and itself left out of the fits, rad, shape (n,)."""
    out = np.empty(len(observed.turns))
    for k, turn in enumerate(observed.turns):
        both = [turn.first, turn.second]
        made = rests.without(both).fit(accelerometers.triad, accelerometers.fit.theta, accelerometers.fit.excess)
        up = observed.directions(rests.true(accelerometers.triad, made.theta)[both])
        out[k] = observed.left_out(gyros.triad, gyros.fit, k, up)
    return out


def _judged(sensors: Sensors, left_out: Array | None, how: HeldOut, seed: int) -> Sensors:
    """The triad with its figure: of errors left out in turn, or of those on the log that judges."""
    metric, judge = sensors.metric, sensors.apart if left_out is None else sensors.observed
    after = sensors.errors() if left_out is None else left_out
    if judge is None or after.size < FEWEST:
        return sensors
    n, before = after.size, judge.before()
    picks = np.random.default_rng(seed).integers(0, n, (DRAWS, n))
    floor = float(np.sqrt(judge.noise.mean())) / metric.si
    low, high = (float(np.sqrt(q / (metric.freedom * n))) * floor for q in chi2_quantiles(metric.freedom * n))
    figure = ErrorFigure(
        metric=metric.name,
        channel=None,
        unit=metric.unit,
        before=rms(before) / metric.si,
        after=rms(after) / metric.si,
        floor=floor,
        ci95=rms_interval(after, picks, 1.0 / metric.si),
        before_ci95=rms_interval(before, picks, 1.0 / metric.si),
        floor_band95=(low, high),
        n=n,
        heldout=how,
    )
    return replace(sensors, figure=figure)


def _differing(chosen: Choice, observed: Rests | Turns) -> list[str]:
    """Kinds of effects that differ from power-on to power-on, of those that are fitted to."""
    return [one.effects[0].effect for one in spreads(chosen, observed, None) if one.matters]


def _compared(sensors: Sensors, how: HeldOut) -> Sensors:
    """The triad with what its effects differ by from power-on to power-on, the one that judges among them."""
    found = spreads(sensors.chosen, sensors.observed, sensors.apart if how == "run" else None)
    return replace(sensors, spreads=found, again=tuple(one for one in found if one.matters))


def _own_biases(gyros: Choice, turned: Turns) -> Array:
    """Parameters of the gyros for another power-on: the biases of its own rests, and what was fitted."""
    shared = gyros.mean[3:]
    pull = turned.readings_of_rests(gyros.triad, np.concatenate([np.zeros(3), shared]))
    weight = np.array([rest.seconds for rest in turned.rests])
    mean = np.array([rest.mean[list(GYROS)] for rest in turned.rests])
    return np.concatenate([weight @ (mean - pull) / weight.sum(), shared])

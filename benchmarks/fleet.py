"""Statistics of a fleet over many simulated fleets: are errors what their standard deviations say, are alarms as rare.

For each kind of fleet: mean and standard deviation of (estimate - truth) / sd over units and over the model's mean, the
shares within one sd (68.3 % of a normal distribution) and within the 95 % intervals, the coverage of the intervals of
both components; of drift tests how many fleets without any drift have one told (5 % at most by Holm's correction), and
how many of units drifting by 3 standard deviations of a day in half a year are found; of control charts the share of
power-ons that fall out though nothing is wrong, and of those set off by five standard deviations that are found. At the
end, seconds that a channel takes.

    python benchmarks/fleet.py [--fleets 200] [--seed 1] [--json]
"""

import json
import time
from dataclasses import asdict, dataclass, field

import bench
import numpy as np

from filters.fleet import components, control_chart, drift, readings
from filters.fleet.drift import Course
from filters.fleet.mixture import Estimate
from filters.fleet.readings import PowerOns
from filters.types import Array

MEAN, ERROR_SPREAD, MONTHS, FAR = 3.0, 0.3, 6.0, 5.0


@dataclass(frozen=True)
class Kind:
    """A kind of fleet: power-ons of its units, in turn, and standard deviations of unit, day, and measurement."""

    units: int
    power_ons: tuple[int, ...]
    unit_sd: float
    day_sd: float
    error: float

    def text(self) -> str:
        """A row's beginning."""
        days = "/".join(map(str, self.power_ons))
        return f"{self.units:3d} units × {days:<7} {self.unit_sd:4.2f} {self.day_sd:4.2f} {self.error:4.2f}"


KINDS = (
    Kind(2, (4,), 1.0, 0.5, 0.1),
    Kind(3, (3,), 1.0, 0.5, 0.2),
    Kind(5, (1, 2, 6), 1.0, 0.5, 0.2),
    Kind(8, (4,), 1.0, 0.5, 0.2),
    Kind(8, (4,), 1.0, 0.5, 1.0),
    Kind(8, (4,), 1.0, 0.02, 0.2),
    Kind(8, (4,), 0.02, 0.5, 0.2),
    Kind(5, (12,), 1.0, 0.5, 0.2),
    Kind(30, (5,), 1.0, 0.5, 0.2),
    Kind(1, (6,), 1.0, 0.5, 0.2),
    Kind(12, (1,), 1.0, 0.5, 0.2),
)


@dataclass
class Tally:
    """What came of fleets of a kind."""

    z: list[float] = field(default_factory=list)
    inside: list[bool] = field(default_factory=list)
    units_component: list[bool] = field(default_factory=list)
    days_component: list[bool] = field(default_factory=list)
    any_drift: list[bool] = field(default_factory=list)
    drift_found: list[bool] = field(default_factory=list)
    false_alarms: list[bool] = field(default_factory=list)
    found: list[bool] = field(default_factory=list)

    def add(self, estimate: Estimate | None, truth: float) -> None:
        """Compare an estimate, if there is one."""
        if estimate is not None:
            self.z.append((estimate.value - truth) / estimate.sd)
            self.inside.append(estimate.low < truth < estimate.high)

    def figures(self) -> dict[str, float | None]:
        """All figures, None where nothing was estimated."""
        z = np.array(self.z)
        told = (
            {"z_mean": float(z.mean()), "z_sd": float(z.std()), "within_sd": float(np.mean(np.abs(z) < 1.0))}
            if z.size
            else {}
        )
        shares = {name: float(np.mean(own)) for name, own in asdict(self).items() if name != "z" and own}
        names = ["z_mean", "z_sd", "within_sd", *list(asdict(self))[1:]]
        return {name: (told | shares).get(name) for name in names}


def simulated(rng: np.random.Generator, kind: Kind) -> tuple[PowerOns, Array]:
    """Power-ons of a fleet, and the true values of its units, in the order of the data."""
    counts = [kind.power_ons[k % len(kind.power_ons)] for k in range(kind.units)]
    truth = MEAN + rng.normal(0.0, kind.unit_sd, kind.units)
    unit = np.repeat(np.arange(kind.units), counts)
    sd = kind.error * np.exp(rng.normal(0.0, ERROR_SPREAD, unit.size))
    values = truth[unit] + rng.normal(0.0, kind.day_sd, unit.size) + rng.normal(0.0, sd)
    names = [f"{k:06d}" for k in range(unit.size)]
    return readings.power_ons(values, sd, [f"{u:06d}" for u in unit], names), truth


def judge_parts(data: PowerOns, truth: Array, kind: Kind, tally: Tally) -> None:
    """Estimates and components against what the fleet was made with."""
    found = components.estimate(data)
    tally.add(found.model, MEAN)
    for unit, value in zip(found.units, truth, strict=True):
        tally.add(unit.value, float(value))
    both = float(np.hypot(kind.unit_sd, kind.day_sd))
    for component, sd, into in (
        (found.between_units, kind.unit_sd, tally.units_component),
        (found.together, both, tally.units_component),
        (found.between_power_ons, kind.day_sd, tally.days_component),
    ):
        if component is not None:
            into.append(component.low <= sd <= component.high)


def judge_drift(rng: np.random.Generator, data: PowerOns, kind: Kind, tally: Tally) -> None:
    """No drift anywhere, then one in the first unit; temperature varies by itself."""
    slope = 3.0 * float(np.hypot(kind.day_sd, kind.error)) / MONTHS
    courses = []
    for number in range(kind.units):
        part = data.of_unit(number)
        t = np.linspace(0.0, MONTHS, data.values[part].size)
        courses.append(Course(data.values[part], data.variances[part], t, 22.0 + rng.normal(0.0, 2.0, t.size)))
    (none,) = drift.drifts([courses])
    if any(one.verdict != "too_few" for one in none):
        tally.any_drift.append(any(one.verdict == "drift" for one in none))
    first = courses[0]
    ((moved, *_),) = drift.drifts(
        [[Course(first.y + slope * first.t, first.variances, first.t, first.temperature), *courses[1:]]]
    )
    if moved.verdict != "too_few":
        tally.drift_found.append(moved.verdict == "drift")


def judge_chart(rng: np.random.Generator, data: PowerOns, kind: Kind, tally: Tally) -> None:
    """All in control, then one power-on set off."""
    clean = control_chart.chart(data)
    if clean is None:
        return
    several = np.isfinite(clean.centres)
    tally.false_alarms += clean.outside[several].tolist()
    place = int(rng.choice(np.flatnonzero(several)))
    values = data.values.copy()
    values[place] += FAR * float(np.hypot(kind.day_sd, np.sqrt(data.variances[place])))
    off = control_chart.chart(PowerOns(values, data.variances, data.starts, data.units, data.names))
    if off is not None:
        tally.found.append(bool(off.outside[place]))


def seconds(units: int, power_ons: int) -> float:
    """What components and chart of a channel cost."""
    data, _ = simulated(np.random.default_rng(0), Kind(units, (power_ons,), 1.0, 0.5, 0.2))
    began = time.perf_counter()
    components.estimate(data)
    control_chart.chart(data)
    return time.perf_counter() - began


def main() -> None:
    asked = bench.options(__doc__, fleets=200, seed=1, json=False)
    rows = []
    for kind in KINDS:
        rng, tally = np.random.default_rng(asked.seed), Tally()
        for _ in range(asked.fleets):
            data, truth = simulated(rng, kind)
            judge_parts(data, truth, kind, tally)
            judge_drift(rng, data, kind, tally)
            judge_chart(rng, data, kind, tally)
        rows.append({"kind": asdict(kind), **tally.figures()})
        if not asked.json:
            if len(rows) == 1:
                print(f"{'fleet, sd of unit, day, error':<35}" + "".join(f"{name:>16}" for name in tally.figures()))
            cells = "".join(f"{'-' if x is None else f'{x:.3f}':>16}" for x in tally.figures().values())
            print(f"{kind.text():<35}{cells}", flush=True)
    costs = [{"units": u, "power_ons": p, "seconds": seconds(u, p)} for u, p in ((5, 8), (50, 10), (500, 10))]
    if asked.json:
        print(json.dumps({"fleets": asked.fleets, "seed": asked.seed, "kinds": rows, "costs": costs}, indent=1))
        return
    for cost in costs:
        print(f"{cost['units']} units × {cost['power_ons']} power-ons: {cost['seconds']:.2f} s a channel")


if __name__ == "__main__":
    main()

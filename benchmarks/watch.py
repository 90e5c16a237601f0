"""The watch of the residual: what it costs, and whether its odds are right.

    python benchmarks/watch.py [--units 400] [--recordings]

Cost: the filter over 12 minutes of simulated samples at 133 Hz, one by one as they come live, with the watch and
without, by turns in one process; what they take of a processor. Odds: units of 12 minutes with
noise that is white with flicker noise or a random walk, half of them with one effect in one channel, whose size goes
from far too small to be seen to large. What is told is right if kind and channel are. Each unit counts as often as the
priors say: one with an effect by its prior, one without by the rest. Recordings: what is told of those at rest beside
the repository.
"""

import json
import time
from dataclasses import dataclass
from itertools import pairwise

import bench
import numpy as np
from bench import DATA

from filters.imu import STANDARD_GRAVITY
from filters.kalman import runner, series_evidence
from filters.kalman.residual_watch import Cause, ResidualWatch
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.motion import reference
from filters.state import PAPER_SITE

RATE, HZ, SECONDS = 133, 20, 720
KINDS = ("tone", "step", "telegraph", "noise_level", "thermal_lin", "thermal_rate")
SAME = {"telegraph": {"telegraph", "step"}, "step": {"step"}}
AT_REST = ("adis16405_static_a", "mpu6050_static_host_stamps", "aceinna_imu381_s1_static")
BINS = (9.0, 30.0, 100.0, 1e3, 1e7)


def cost(minutes: float = 12.0) -> None:
    """CPU time of the filter, one sample at a time, with the watch and without."""
    rng = np.random.default_rng(1)
    rate, force = reference.level(PAPER_SITE).rates_and_forces()
    n = round(60 * minutes * RATE)
    t, T = np.arange(n) / RATE, 25.0 + 2.0 * np.arange(n) / n
    gyro, accel = rate + rng.normal(size=(n, 3)) * 0.015, force + rng.normal(size=(n, 3)) * 0.2
    series_evidence.prepare()
    spent: dict[bool, list[float]] = {True: [], False: []}
    for turn in range(4):
        watches = turn % 2 == 0
        estimator = Estimator(Settings(1.0 / RATE), every=np.inf)
        if not watches:
            estimator.watch = None
        begun = time.process_time()
        for k in range(n):
            runner.step(estimator, float(t[k]), gyro[k], accel[k], float(T[k]))
        spent[watches].append(time.process_time() - begun)
    with_it, without = min(spent[True]), min(spent[False])
    share = (with_it - without) / (60.0 * minutes)
    print(f"cost at {RATE} Hz: filter {without / minutes / 0.6:.3f} % of a processor, watch {100.0 * share:.3f} %,")
    print(f"{with_it / without:.2f} times the filter without it (least of two runs each, by turns)")


@dataclass(frozen=True)
class Told:
    """What was told of a unit first, its odds, and whether it is right."""

    weight: float
    odds: float
    right: bool


def unit(seed: int) -> tuple[str, float, list[Told], int]:
    """A simulated unit: the kind in it ("" for none), its size over the noise, what was told, changes in all."""
    rng = np.random.default_rng([27, seed])
    n = SECONDS * HZ
    x = rng.normal(size=(n, 6))
    drift = 10.0 ** rng.uniform(-2.5, 0.5)
    if rng.random() < 0.5:
        x += np.cumsum(rng.normal(size=(n, 6)), axis=0) * drift / HZ**0.5 / 30.0
    else:
        x += (
            drift
            * sum(np.repeat(rng.normal(size=(n // m + 1, 6)), m, axis=0)[:n] for m in 20 * 2 ** np.arange(8))
            / 8.0
        )
    t = np.arange(n) / HZ
    T = 25.0 + 4.0 * np.sin(2.0 * np.pi * t / rng.uniform(400.0, 3000.0) + rng.uniform(0.0, 6.0))
    kind, size, c = "", 0.0, int(rng.integers(6))
    if seed % 2:
        kind, size = KINDS[seed // 2 % len(KINDS)], 10.0 ** rng.uniform(-1.0, 0.7)
        at = rng.uniform(150.0, 600.0)
        match kind:
            case "tone":
                x[:, c] += size * np.sin(2.0 * np.pi * 10.0 ** rng.uniform(-1.5, 0.9) * t)
            case "step":
                x[t > at, c] += size
            case "telegraph":
                x[(t > at) & (t < at + rng.uniform(15.0, 60.0)), c] += size
            case "noise_level":
                x[t > at, c] *= 1.0 + 0.3 * size
            case "thermal_lin":
                x[:, c] += 0.3 * size * T
            case "thermal_rate":
                x[:, c] += 10.0 * size * np.gradient(T, t)
    watch = ResidualWatch(1.0)
    for k in range(SECONDS):
        block = slice(k * HZ, (k + 1) * HZ)
        watch.take(k + 1.0, x[block], T[block])
    prior = series_evidence.PRIOR.get(kind, series_evidence.PRIOR["step"])
    weight = 2.0 * len(KINDS) * prior * 6 if kind else 2.0
    first: dict[int, Cause] = {}
    for one in watch.told():
        first.setdefault(one.channel, one)
    right = [one.channel == c and kind != "" and one.effect in SAME.get(kind, {kind}) for one in first.values()]
    told = [Told(weight, one.odds, ok) for one, ok in zip(first.values(), right, strict=True)]
    return kind, size, told, len(watch.changes)


def odds(units: int) -> None:
    """Reliability of the odds, and how many of each kind are found."""
    told, seen = list[Told](), {kind: [0, 0] for kind in KINDS}
    alarms = without = most = 0
    for seed in range(units):
        kind, size, found, changes = unit(seed)
        told, most = told + found, max(most, changes)
        if kind:
            seen[kind][0] += size > 1.0 and any(one.right for one in found)
            seen[kind][1] += size > 1.0
        else:
            without += 1
            alarms += len(found)
    hours = without * SECONDS / 3600.0
    print(f"{units} units: told {len(told)}; of units without an effect {alarms} in {hours:.0f} h of six channels")
    print(f"at most {most} events of a unit")
    for low, high in pairwise(BINS):
        of = [one for one in told if low <= one.odds < high]
        weight = sum(one.weight for one in of)
        share = sum(one.weight for one in of if one.right) / weight if weight else float("nan")
        plain = f"{sum(one.right for one in of)} of {len(of)}"
        print(f"  odds {low:g} to {high:g}: {plain} right; weighted by the priors {share:.3f}")
    for kind, (known, count) in seen.items():
        print(f"  {kind}: {known} of {count} larger than the noise of a reading are told")


def recordings() -> None:
    """What is told of recordings at rest."""
    for name in AT_REST:
        about, data = json.loads((DATA / f"{name}.json").read_text()), np.load(DATA / f"{name}.npz")
        t = data["t"] - data["t"][0]
        x = np.hstack([data["accel"] * STANDARD_GRAVITY, np.deg2rad(data["gyro"])])
        temperature = data["temp"] if "temp" in data else np.full(t.size, np.nan)
        watch, edges = ResidualWatch(1.0), np.searchsorted(t, np.arange(0.0, t[-1]))
        for k, (a, b) in enumerate(pairwise(edges)):
            if b > a:
                watch.take(k + 1.0, x[a:b], temperature[a:b])
        print(f"{name}, {about['duration_s'] / 3600.0:.2f} h: {len(watch.told())} told")
        for change, one in watch.changes:
            channel, unit_of = ("ax", "ay", "az", "gx", "gy", "gz")[one.channel], "deg/s" if one.channel > 2 else "mg"
            size = np.rad2deg(one.size) if one.channel > 2 else one.size / STANDARD_GRAVITY * 1e3
            what = f"{one.effect} {channel} {size:.3g} {unit_of} odds {one.odds:.3g} {one.hz or one.since}"
            print(f"  {one.t:6.0f} s  {change} {what}")


def main() -> None:
    given = bench.options(__doc__, units=400, recordings=False)
    cost()
    odds(given.units)
    if given.recordings:
        recordings()


if __name__ == "__main__":
    main()

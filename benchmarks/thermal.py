"""Effects of temperature: how late its rate is in the filter, and how well a leg that was not fitted is foretold.

    python benchmarks/thermal.py rate
    python benchmarks/thermal.py legs [--count 100]

`rate`: error of T' over T', root mean squares, which is the share of an effect of T' that stays in. Beside each other:
double exponential smoothing over 15 s, which the filter had before, its Kalman filter, and symmetric smoothing, which a
trace and `imutui apply` have. Simulated temperatures with noise and steps of the thermometer; the measured one of the
chamber against its symmetric smoothing.

`legs`: simulated cycles, down, up and down, whose bias is a curve in temperature that lags and plays. After over
before, both after a hold of 60 s: geometric mean, share of cycles above 1.1, with all of the mean and with what is
carried over; errors over their standard deviations, median.
"""

from collections.abc import Callable

import bench
import numpy as np
from bench import DATA
from helpers.cycles import PERIOD, cycle

from filters.effects.temperature import CausalTemperature, lag
from filters.tracing.thermal_forms import average
from filters.tracing.thermal_memory import carried_over, there_and_back

_S = 1500.0
_THERMOMETERS = ((100.0, 0.02, 0.0), (100.0, 0.1, 0.0), (100.0, 0.003, 0.054), (2.0, 0.03, 0.0))  # Hz, noise K, step K
_KINDS = ("none", "lag", "play", "both")


def histories(rng: np.random.Generator, t: np.ndarray) -> dict[str, np.ndarray]:
    """Temperatures, degC."""
    corners = np.interp(t, np.r_[0.0, np.sort(rng.uniform(0.0, _S, 5)), _S], rng.uniform(15.0, 40.0, 7))
    return {
        "warm-up, 600 s": 24.0 - 6.0 * np.expm1(-t / 600.0),
        "warm-up, 80 to 300 s": 22.0 - 6.0 * np.expm1(-t / rng.uniform(80.0, 300.0)),
        "ramps, corners of 10 s": lag(corners, 10.0 / t[1]),
        "sine, 200 to 600 s": 25.0 + 4.0 * np.sin(2.0 * np.pi * t / rng.uniform(200.0, 600.0)),
    }


def before(raw: np.ndarray, period: float) -> np.ndarray:
    """The rate by double exponential smoothing."""
    once = lag(raw, 15.0 / period)
    return (once - lag(once, 15.0 / period)) / 15.0


def ahead(raw: np.ndarray, period: float) -> np.ndarray:
    """The rate as `imutui apply` has it."""
    follower = CausalTemperature(period)
    follower.look_ahead(raw)
    return follower.follow(raw).rate


ESTIMATES: tuple[Callable[[np.ndarray, float], np.ndarray], ...] = (
    before,
    lambda raw, period: CausalTemperature(period).follow(raw).rate,
    ahead,
)


def of_rates() -> None:
    print(f"{'':50s} before  filter  apply")
    for hz, noise, step in _THERMOMETERS:
        t = np.arange(0.0, _S, 1.0 / hz)
        for name in histories(np.random.default_rng(0), t):
            errors = []
            for seed in range(6):
                rng = np.random.default_rng(seed)
                T = histories(rng, t)[name]
                raw = T + noise * rng.standard_normal(t.size)
                raw = np.round(raw / step) * step if step else raw
                true = np.gradient(T, t)
                errors.append([ratio(rate(raw, 1.0 / hz), true, round(5.0 * hz)) for rate in ESTIMATES])
            said = f"{name}; {hz:g} Hz, {noise:g} K, {step:g} K"
            print(f"{said:50s}", "  ".join(f"{x:6.3f}" for x in np.sqrt(np.mean(np.square(errors), axis=0))))
    if DATA.is_dir():
        measured = np.load(DATA / "thermal_chamber_part1.npz")
        raw, period = measured["temp"][1:], float(np.median(np.diff(measured["t"])))
        symmetric = ahead(raw, period)
        print(
            f"{'chamber, measured':50s}", "  ".join(f"{ratio(f(raw, period), symmetric, 120):6.3f}" for f in ESTIMATES)
        )


def ratio(found: np.ndarray, true: np.ndarray, first: int) -> float:
    """Error over what is estimated, root mean squares from a row on."""
    return float(np.linalg.norm((found - true)[first:]) / np.linalg.norm(true[first:]))


def of_legs(count: int) -> None:
    hold = round(60.0 / PERIOD)
    legs: dict[str, list[list[float]]] = {}
    for seed in range(100, 100 + count):
        made = cycle(seed, _KINDS[seed % 4])
        down, up, _ = made.ends
        for name, end, stop in (("one leg, the next", down, up), ("two legs, the next", up, None)):
            rows = made.rows(slice(0, end))
            found = average(rows, 0)
            X, y = made.columns(slice(0, end))[end:stop], made.y[end:stop]
            X, y = (x[hold:] - x[:hold].mean(axis=0) for x in (X, y))
            mean, share = X @ found.weights, carried_over(*there_and_back(rows), found)
            sd = np.sqrt(np.einsum("ij,jk,ik->i", X, found.covariance, X) + made.sd**2)
            errors = [float(np.linalg.norm(y - a * mean) / np.linalg.norm(y)) for a in (1.0, share)]
            legs.setdefault(name, []).append([*errors, float(np.sqrt(np.mean(((y - mean) / sd) ** 2)))])
    print(f"{'':20s} all: mean, above 1.1   carried over: mean, above 1.1   error over sd")
    for name, rows_of in legs.items():
        all_of, part, z = np.array(rows_of).T
        means = (float(np.exp(np.mean(np.log(x)))) for x in (all_of, part))
        told = [f"{m:.3f}, {np.mean(x > 1.1):.3f}" for m, x in zip(means, (all_of, part), strict=True)]
        print(f"{name:20s} {told[0]:>20s} {told[1]:>30s} {np.median(z):>16.2f}")


def main() -> None:
    chosen = bench.options(__doc__, "rate", "legs", count=100)
    if chosen.part == "rate":
        of_rates()
    else:
        of_legs(chosen.count)


if __name__ == "__main__":
    main()

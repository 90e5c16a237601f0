"""Errors that the tracer's catalogue does not have: forms over something logged, and of causes that nobody logged.

Each is added to the simulator's readings at full rate, of unit size in no particular unit: the size is set elsewhere.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import special

from filters.state import PAPER_SITE
from filters.types import Array

SITE = PAPER_SITE
_DEG, _G = 180.0 / np.pi, 9.80665
_AXES = ("outer", "middle", "inner")
GYROS, ALL = (0, 1, 2), (0, 1, 2, 3, 4, 5)


@dataclass(frozen=True)
class World:
    """What truly was: time (s), what a perfect unit reads (SI, (N, 6)), temperature (degC), table angles and rates."""

    t: Array
    perfect: Array
    T: Array
    angles: Array
    rates: Array

    def w(self, axis: int) -> Array:
        """deg/s."""
        return self.perfect[:, axis] * _DEG

    def f(self, axis: int) -> Array:
        """g."""
        return self.perfect[:, 3 + axis] / _G

    def since_motion(self) -> Array:
        """s."""
        moving = (np.abs(self.rates) > 2e-4).any(axis=1)
        last = np.maximum.accumulate(np.where(moving, self.t, -1.0))
        return np.where(last >= 0.0, self.t - last, self.t)

    def direction(self, axis: int) -> Array:
        """Sign of the last motion of a table axis, 0 before the first."""
        sign = np.where(np.abs(self.rates[:, axis]) > 2e-4, np.sign(self.rates[:, axis]), 0.0)
        rows = np.maximum.accumulate(np.where(sign != 0.0, np.arange(sign.size), -1))
        return np.where(rows >= 0, sign[np.maximum(rows, 0)], 0.0)


Function = Callable[[World, np.random.Generator], Array]


@dataclass(frozen=True)
class Form:
    """A kind of error."""

    name: str
    # from a generator and a channel's number: the error (of a world and of a run's generator), and the names of
    # findings that have the right driver; empty where there is none
    drawn: Callable[[np.random.Generator, int], tuple[Function, set[str]]]
    still: bool = False  # whether a still unit shows it
    channels: tuple[int, ...] = ALL  # where it may be


_T = {"driver:temperature", "driver:temperature_threshold", "thermal_lin", "thermal_poly"}
_RATE = {"driver:temperature_rate", "thermal_rate"}


def _heat(name: str, function: Callable[..., Array], *ranges: tuple[float, float], signed: bool = False) -> Form:
    """Of temperature and of parameters, each of them drawn evenly; the last one of either sign if so wanted."""

    def drawn(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
        values = [rng.uniform(*limits) for limits in ranges]
        if signed:
            values[-1] *= rng.choice([-1.0, 1.0])
        return lambda world, own: function(world.T, *values), _T

    return Form(name, drawn, True)


def _own_rate(function: Callable[..., Array], least: float, most: float) -> Callable[..., tuple[Function, set[str]]]:
    """Of a gyro's own rate and of a width, deg/s."""

    def drawn(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
        width = rng.uniform(least, most)
        names = {f"driver:w{'xyz'[c]}", "scale", "nonlinearity_cubic", "asymmetry", "nonlinearity_quadratic"}
        return lambda world, own: function(world.w(c), width), names

    return drawn


def _force(name: str, function: Callable[[World, Array], Array], *names: str) -> Form:
    """Of the specific force on another axis; {} stands for that in the names of findings that are right."""

    def drawn(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
        axis = int(rng.choice([k for k in range(3) if k != c % 3]))
        return lambda world, own: function(world, world.f(axis)), {name.format(f"f{'xyz'[axis]}") for name in names}

    return Form(name, drawn)


def _product(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
    a, b = int(rng.integers(3)), int(rng.integers(3))
    return lambda world, own: world.w(a) * world.f(b), {f"driver:w{'xyz'[a]}*f{'xyz'[b]}"}


def _third(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
    k, phase = int(rng.integers(3)), rng.uniform(0, 2 * np.pi)
    return lambda world, own: np.sin(3 * world.angles[:, k] + phase), {f"driver:angle_{_AXES[k]}", "harmonic"}


def _settling(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
    tau = rng.uniform(2, 8)
    return lambda world, own: np.exp(-world.since_motion() / tau), {"driver:since_motion"}


def _signed_settling(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
    tau, k = rng.uniform(3, 15), int(rng.integers(3))
    names = {f"driver:settling_{_AXES[k]}"}
    return lambda world, own: world.direction(k) * np.exp(-world.since_motion() / tau), names


def _direction(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
    k = int(rng.integers(3))
    return lambda world, own: world.direction(k), {f"driver:direction_{_AXES[k]}"}


def _heat_by_angle(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
    k, phase = int(rng.integers(3)), rng.uniform(0, 2 * np.pi)
    names = {f"driver:temperature*angle_{_AXES[k]}"}
    return lambda world, own: (world.T - 26.0) * np.sin(world.angles[:, k] + phase), names


def _time_w(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
    axis = int(rng.integers(3))
    return lambda world, own: (world.t - 435.0) * world.w(axis), {f"driver:time*w{'xyz'[axis]}"}


def _rate_norm(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
    width = rng.uniform(20, 60)
    return lambda world, own: np.tanh(np.linalg.norm(world.perfect[:, :3], axis=1) * _DEG / width), {"driver:rate_norm"}


def _tanh_slope(rng: np.random.Generator, c: int) -> tuple[Function, set[str]]:
    width = rng.uniform(0.005, 0.015)
    return lambda world, own: np.tanh(np.gradient(world.T, world.t) / width), _RATE


FORMS = (
    _heat("tanh in temperature", lambda T, at, width: np.tanh((T - at) / width), (24, 29), (0.8, 2.5)),
    Form("tanh of own rate", _own_rate(lambda w, width: np.tanh(w / width), 10, 40), channels=GYROS),
    _heat("exponential in temperature", lambda T, width: np.exp((T - 27.0) / width), (2, 5), signed=True),
    Form("rate times specific force", _product),
    _heat("bump in temperature", lambda T, at, width: np.exp(-0.5 * ((T - at) / width) ** 2), (23.5, 29), (1.0, 2.5)),
    Form("three times a turn", _third),
    _heat("absolute value of temperature", lambda T, at: np.abs(T - at), (23.5, 28)),
    Form("settles after moves", _settling),
    _force("cubic in another axis' force", lambda world, f: f**3, "driver:{}", "g_sensitivity", "cross_axis"),
    _heat("threshold in temperature", lambda T, at: (at < T).astype(float), (24, 28)),
    Form("direction of the last move", _direction),
    Form("temperature times angle", _heat_by_angle),
    _heat(
        "sine in temperature", lambda T, period, phase: np.sin(2 * np.pi * T / period + phase), (6, 12), (0, 2 * np.pi)
    ),
    Form("time times rate", _time_w),
    _force("absolute value of another axis' force", lambda world, f: np.abs(f), "driver:{}", "g_squared"),
    Form("signed settling", _signed_settling),
    _force("temperature times force", lambda world, f: (world.T - 26.0) * f, "driver:temperature*{}"),
    Form("dead zone", _own_rate(lambda w, width: -np.clip(w, -width, width), 15, 50), channels=GYROS),
    Form("saturating in the norm of rate", _rate_norm),
    Form("saturating in temperature's rate", _tanh_slope, True),
)


# ------------------------------------------------------------------------------------------ causes that nobody logged


def _none(function: Callable[[Array, np.random.Generator], Array]) -> Callable[..., tuple[Function, set[str]]]:
    return lambda rng, c: (lambda world, own: function(world.t, own), set())


def _moments(t: Array, rng: np.random.Generator, mean_s: float) -> list[float]:
    count = max(3, int(rng.poisson(t[-1] / mean_s)))
    return sorted(rng.uniform(0.0, t[-1], count).tolist())


def bursts(t: Array, rng: np.random.Generator) -> Array:
    """Stretches of wandering between stretches of quiet."""
    out = np.zeros(t.size)
    for at in _moments(t, rng, 150.0):
        inside = (t >= at) & (t < at + rng.uniform(10, 50))
        count = int(inside.sum())
        if count > 1:
            walk = np.cumsum(rng.standard_normal(32))
            out[inside] += np.interp(np.linspace(0, 31, count), np.arange(32), walk - walk.mean())
    return out


def chirp(t: Array, rng: np.random.Generator) -> Array:
    """A tone that runs up in frequency over the whole run."""
    low, high = rng.uniform(0.005, 0.02), rng.uniform(0.08, 0.4)
    return np.sin(2 * np.pi * (low * t + 0.5 * (high - low) * t**2 / t[-1]) + rng.uniform(0, 2 * np.pi))


def levels(t: Array, rng: np.random.Generator) -> Array:
    """Rest at zero and jumps to levels of random size."""
    edges = _moments(t, rng, 60.0)
    values = np.where(np.arange(len(edges) + 1) % 2 == 0, 0.0, rng.standard_normal(len(edges) + 1))
    return np.asarray(values[np.searchsorted(edges, t)])


def sawtooth(t: Array, rng: np.random.Generator) -> Array:
    """A saw of a period of its own in each run."""
    period = rng.uniform(35, 90)
    return (t / period + rng.random()) % 1.0 - 0.5


def ringing(t: Array, rng: np.random.Generator) -> Array:
    """Bessel functions from random times on."""
    out = np.zeros(t.size)
    for at in _moments(t, rng, 120.0):
        out += np.where(t > at, rng.choice([-1.0, 1.0]) * special.j1(np.maximum(t - at, 0.0) / 2.5), 0.0)
    return out


def gradient(t: Array, rng: np.random.Generator) -> Array:
    """Product of two hidden smooth temperatures."""
    knots = np.arange(0.0, t[-1] + 120.0, 60.0)
    a, b = (np.interp(t, knots, rng.standard_normal(knots.size)) for _ in range(2))
    return a * b


def recoveries(t: Array, rng: np.random.Generator) -> Array:
    """Shocks that decay."""
    out = np.zeros(t.size)
    for at in _moments(t, rng, 100.0):
        tau = rng.uniform(5, 40)
        out += np.where(t > at, rng.standard_normal() * np.exp(-np.maximum(t - at, 0.0) / tau), 0.0)
    return out


def wavering(t: Array, rng: np.random.Generator) -> Array:
    """A tone whose amplitude comes and goes and whose frequency wavers."""
    knots = np.arange(0.0, t[-1] + 80.0, 40.0)
    hz = 0.05 + 0.02 * np.interp(t, knots, rng.standard_normal(knots.size))
    size = np.abs(np.interp(t, knots, rng.standard_normal(knots.size)))
    return size * np.sin(2 * np.pi * np.cumsum(hz) * (t[1] - t[0]))


def pulses(t: Array, rng: np.random.Generator) -> Array:
    """Pulses of one sign, of random width, at random times."""
    out = np.zeros(t.size)
    for at in _moments(t, rng, 80.0):
        out[(t >= at) & (t < at + rng.uniform(1, 10))] += 1.0
    return out


def cubes(t: Array, rng: np.random.Generator) -> Array:
    """Cube of a slow drift: quiet mostly, then far out."""
    knots = np.arange(0.0, t[-1] + 200.0, 100.0)
    return np.interp(t, knots, rng.standard_normal(knots.size)) ** 3


UNKNOWN = tuple(
    Form(name, _none(function), True)
    for name, function in (
        ("bursts of wandering", bursts),
        ("chirp", chirp),
        ("levels of random size", levels),
        ("saw", sawtooth),
        ("ringing after random times", ringing),
        ("product of hidden gradients", gradient),
        ("shocks that decay", recoveries),
        ("wavering tone", wavering),
        ("pulses", pulses),
        ("cube of a drift", cubes),
    )
)


def hold_error(tau: float, seconds: float) -> float:
    """Mean square of a 10 s mean less the mean of the first 60 s, of a Gauss-Markov process of unit variance."""

    def variance_of_mean(T: float) -> float:
        x = T / tau
        return 2.0 / x**2 * (x + np.expm1(-x))

    def covariance(gap: float, a: float, b: float) -> float:
        # of means over stretches of a and b, `gap` apart
        return float(np.exp(-gap / tau) * tau**2 / (a * b) * np.expm1(-a / tau) * np.expm1(-b / tau))

    gaps = np.arange(0.0, seconds - 70.0, 10.0)
    cross = np.mean([covariance(g, 60.0, 10.0) for g in gaps])
    return float(variance_of_mean(10.0) + variance_of_mean(60.0) - 2.0 * cross)

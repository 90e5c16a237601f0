"""Cases for the tracer on measured noise: effects of known size added to recordings of units at rest.

The noise is measured, and with it its drift, its lines and its counts. Simulated are the effect, the temperature that
it may follow, and the motion of a table: what a perfect unit would read on that motion is added to the noise. The size
of an effect is set from the detectability that is wanted, as in `tracing_cases`,

    d = norm(effect less its mean in each run) / standard deviation of the white noise,   over the runs to learn from,

the white noise being that of the recording. Development takes the first half of the long recording, the last count
its second half.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import tracing_cases as cases
import tracing_forms as forms
from bench import DATA
from tracing_cases import CHANNELS, DPS, Case, Plan, Spoiled, Truth

from filters.imu import STANDARD_GRAVITY, AxisMap
from filters.tracing.blocks import average
from filters.tracing.run import Run, rest_attitudes
from filters.tracing.stack import Stack
from filters.types import Array

SIZES = (15.0, 30.0, 60.0, 100.0)  # detectabilities that are tried
LONG, SHORT = "adis16405_static_a", "mpu6050_static_host_stamps"

_STILL_S, _SHORT_S = 1200.0, 218.0
SLOW = (
    *("thermal_lin", "warmup", "thermal_lag", "step", "thermal_poly", "hysteresis", "telegraph", "thermal_rate"),
    *("long warmup", "ramp"),
)
FAST = (
    *("scale", "tone", "cross_axis", "g_sensitivity", "delay", "asymmetry", "harmonic", "lever_arm", "mounting"),
    *("nonlinearity_cubic", "g_squared", "thermal_scale"),
)
OTHER = (
    *("several levels", "threshold in temperature", "event", "tanh in temperature", "settles after moves"),
    *("product of hidden gradients", "direction of the last move", "saw", "wavering tone"),
)


@dataclass(frozen=True)
class Noise:
    """A recording of a unit at rest, less its mean."""

    name: str
    t: Array  # its stamps, s, shape (N,)
    values: Array  # readings less their mean, SI, shape (N, 6)
    rate: float  # readings a second
    white: Array  # white densities, unit·√s, shape (6,)

    def part(self, begin: float, end: float) -> "Noise":
        """A share of it, from 0 to 1."""
        rows = slice(round(begin * self.t.size), round(end * self.t.size))
        return replace(self, t=self.t[rows], values=self.values[rows])


def missing() -> str:
    """Why nothing can be run: empty if the recordings are there."""
    absent = [name for name in (LONG, SHORT) if not (DATA / f"{name}.npz").is_file()]
    return f"measured recordings are not there: {', '.join(absent)} in {DATA}" if absent else ""


@cache
def noise(name: str) -> Noise:
    with np.load(DATA / f"{name}.npz") as arrays:
        t = np.asarray(arrays["t"], np.float64)
        readings = np.hstack([arrays["gyro"] * DPS, arrays["accel"] * STANDARD_GRAVITY]).astype(np.float64)
    readings -= readings.mean(axis=0)
    zero = np.zeros((1, 3))
    run = Run(name, t, readings, None, zero, zero, AxisMap(), forms.SITE)
    stack = Stack.of([average(run)])
    return Noise(name, t, readings, run.rate_hz, stack.white_sd() * np.sqrt(stack.period))


# -------------------------------------------------------------------------------------------------------------- runs


def _plan(rng: np.random.Generator, source: Noise, moving: bool) -> Plan:
    """Three runs and a held-out one of the long recording, two and one of the short one; motion in the long only."""
    if source.name == SHORT:
        temperatures = cases.histories(rng, 3, _SHORT_S, cold=True)
        return Plan("short still", None, source.rate, _SHORT_S, temperatures, cases.WHITE)
    seconds = cases.FULL.duration if moving else _STILL_S
    temperatures = cases.histories(rng, 4, seconds, cold=not moving)
    return Plan("moved" if moving else "still", cases.FULL if moving else None, source.rate, seconds, temperatures)


def made(plan: Plan, seed: int, spoiled: Spoiled, source: Noise) -> tuple[Run, ...]:
    """All runs of a plan, one after the other in the recording from a random place on."""
    rng = np.random.default_rng([seed, 99])
    n = int(plan.rate * plan.seconds)
    count = len(plan.temperatures)
    first = int(rng.integers(0, source.t.size - n * count + 1))
    silent = replace(plan.spec, gyro_arw=0.0, accel_vrw=0.0)
    out = []
    for k in range(count):
        rows = slice(first + k * n, first + (k + 1) * n)
        recording = cases.recorded(plan, seed, k, spoiled.effects(k), silent, plan.rate)
        values = cases.reading(recording) + source.values[rows]
        if spoiled.more is not None:
            values = values + spoiled.more(k, cases.world(plan, recording))
        T = recording.temperature_degc + 0.02 * np.random.default_rng([seed, k]).standard_normal(n)
        T = np.round(T / 0.05) * 0.05
        angles = rest_attitudes(recording.angles)
        rates = recording.rates if len(angles) > 1 else recording.rates[:1]
        t = source.t[rows] - source.t[rows.start]
        out.append(Run(f"run {k + 1}", t, values, T, angles, rates, AxisMap(), forms.SITE))
    return tuple(out)


def _scaled(plan: Plan, seed: int, source: Noise, unit: Spoiled, d: float, rate: float) -> tuple[float, Array]:
    """The scale that gives d, and the channels' shares of it."""
    of_spec = cases.detectability(plan, seed, unit, rate)
    own = of_spec * cases.density(plan.spec) / source.white
    return d / max(float(np.linalg.norm(own)), 1e-12), own


def _case(name: str, plan: Plan, seed: int, spoiled: Spoiled, truths: tuple[Truth, ...], source: Noise) -> Case:
    runs = made(plan, seed, spoiled, source)
    return Case(name, runs[: plan.learning], runs[plan.learning], truths, plan.name)


# ----------------------------------------------------------------------------------------------------------- classes


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(1, 2**24))


def _size(number: int, kinds: int) -> float:
    return SIZES[(number + number // kinds) % len(SIZES)]


def _half(source: Noise, final: bool) -> Noise:
    """The half that development, or the last count, takes; the short recording is one."""
    if source.name == SHORT:
        return source
    return source.part(0.5, 1.0) if final else source.part(0.0, 0.5)


def unspoiled(name: str, number: int, rng: np.random.Generator, final: bool) -> Case:
    """The noise alone, with temperatures that have nothing to do with it, still and moved."""
    source = _half(noise(SHORT if number % 5 == 4 else LONG), final)
    plan = _plan(rng, source, bool(number % 2))
    return _case(name, plan, _seed(rng), Spoiled(), (), source)


def _of_catalogue(name: str, effect: str, d: float, plan: Plan, rng: np.random.Generator, source: Noise) -> Case:
    seed = _seed(rng)
    made_one = cases.drawn(rng, "warmup" if effect == "long warmup" else effect, plan)
    if effect == "long warmup":
        made_one = _longer(made_one, float(rng.uniform(0.3, 1.0) * plan.seconds))
    rate = plan.rate if made_one.name in ("telegraph", "tone") else min(plan.rate, 20.0)
    scale, own = _scaled(plan, seed, source, made_one.spoiled(1.0), d, rate)
    true = made_one.at(scale)
    truth = Truth(
        f"{effect} {dict(true.parameters)}" + ("" if made_one.only is None else f" in run {made_one.only + 1}"),
        frozenset([true.name]),
        true.channels or cases.where(own),
        d,
        hz=made_one.facts.get("hz", 0.0),
        transfers=true.name not in cases.EVENTS,
    )
    return _case(name, plan, seed, made_one.spoiled(scale), (truth,), source)


def _longer(drawn: cases.Drawn, tau: float) -> cases.Drawn:
    """A warm-up with another time constant, s."""
    at = drawn.at
    return replace(drawn, at=lambda s: replace(at(s), parameters={**at(s).parameters, "tau_s": tau}))


def slow(name: str, number: int, rng: np.random.Generator, final: bool) -> Case:
    """An effect as slow as drift is."""
    source = _half(noise(SHORT if number % 6 == 5 else LONG), final)
    plan = _plan(rng, source, rng.random() < 0.3)
    return _of_catalogue(name, SLOW[number % len(SLOW)], _size(number, len(SLOW)), plan, rng, source)


def fast(name: str, number: int, rng: np.random.Generator, final: bool) -> Case:
    """An effect of motion, or a tone."""
    source = _half(noise(LONG), final)
    plan = _plan(rng, source, True)
    return _of_catalogue(name, FAST[number % len(FAST)], _size(number, len(FAST)), plan, rng, source)


def _event(rng: np.random.Generator, c: int) -> tuple[forms.Function, set[str]]:
    """Some minutes in one run only, as of a table that tilts and comes back."""

    def function(world: forms.World, own: np.random.Generator) -> Array:
        at, width = own.uniform(0.2, 0.8) * world.t[-1], own.uniform(0.03, 0.1) * world.t[-1]
        return np.asarray(np.exp(-0.5 * ((world.t - at) / width) ** 2) * (own.random() < 0.6))

    return function, set()


def other(name: str, number: int, rng: np.random.Generator, final: bool) -> Case:
    """What the catalogue does not have, or only in part."""
    kind = OTHER[number % len(OTHER)]
    source = _half(noise(LONG), final)
    known = {f.name: f for f in (*forms.FORMS, *forms.UNKNOWN)}
    levels = replace(known["levels of random size"], name="several levels")
    known |= {levels.name: levels, "event": forms.Form("event", _event, True)}
    form = known[kind]
    plan = _plan(rng, source, not form.still or rng.random() < 0.3)
    c = int(rng.choice(form.channels))
    function, names = form.drawn(rng, c)
    names = {"telegraph", "step"} if kind == "several levels" else names
    seed, d = _seed(rng), _size(number, len(OTHER))

    def more(run: int, at: forms.World) -> Array:
        out = np.zeros((at.t.size, 6))
        out[:, c] = function(at, np.random.default_rng([seed, run, 77]))
        return out

    scale, _ = _scaled(plan, seed, source, Spoiled(more=more), d, 20.0)
    truth = Truth(kind, frozenset(names), (CHANNELS[c],), d, transfers=bool(names) and kind != "several levels")
    return _case(name, plan, seed, Spoiled(more=lambda run, at: scale * more(run, at)), (truth,), source)


CLASSES: dict[str, tuple[Callable[[str, int, np.random.Generator, bool], Case], int]] = {
    "unspoiled": (unspoiled, 30),
    "slow": (slow, 60),
    "fast": (fast, 36),
    "other": (other, 27),
}
"""Name to what makes a case, and how many there are."""


def case(kind: str, number: int, final: bool = False) -> Case:
    """Case of a class.

    `kind`: name in `CLASSES`.
    `final`: whether of the set that is kept for the last count, not of the one for development.
    """
    maker, _ = CLASSES[kind]
    rng = np.random.default_rng([int(final), 100 + list(CLASSES).index(kind), number])
    return maker(f"{kind}:{number}", number, rng, final)

"""Blind cases for the tracer: simulated campaigns with known truth, drawn from a seed.

A case is a few runs to learn from, a held-out one, and what is wrong with them. The size of an effect is set from the
detectability that is wanted,

    d = norm(effect less its mean in each run) / standard deviation of the white noise,   over the runs to learn from,

measured on the simulator: the same seed with and without the effect, without noise. Nothing here is measured data.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import tracing_forms as forms

from filters.earth import earth_rate_n
from filters.imu import STANDARD_GRAVITY, AxisMap, ImuSpec
from filters.motion.kinematics import attitudes, body_rate
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sine
from filters.simulation import Effect, PowerOn, Recording, Scenario, Temperature, Unit
from filters.tracing.run import Run, rest_attitudes
from filters.types import Array

CHANNELS = ("gx", "gy", "gz", "ax", "ay", "az")
DPS, MG = np.pi / 180.0, 1e-3 * STANDARD_GRAVITY
COUNT = np.repeat([200.0 * 1.5 / 2**15 * DPS, 4.0 * 1.5 / 2**15 * STANDARD_GRAVITY], 3)
"""Of the instrument, rad/s and m/s²."""

WHITE = ImuSpec(gyro_bandwidth=0.0, accel_bandwidth=0.0)
LIMITED = ImuSpec()
_STOCHASTIC = ("telegraph", "random_walk", "gauss_markov")
_SLOW_HZ = 20.0


@dataclass(frozen=True)
class Truth:
    """One thing that is wrong."""

    text: str  # what, for a person
    names: frozenset[str]  # effects that are it
    channels: tuple[str, ...]  # where it matters
    d: float = np.inf  # detectability; infinite for what has none
    place: str = "findings"  # list of the report that it belongs into: findings, drift, integrity, noise_level
    # name of a parameter in a finding to its true value, where the effect is one of the catalogue
    parameters: Mapping[str, float] = field(default_factory=dict)
    hz: float = 0.0  # of a tone
    transfers: bool = True  # whether a correction can carry over to another run


@dataclass(frozen=True)
class Case:
    name: str
    runs: tuple[Run, ...]
    heldout: Run | None
    truths: tuple[Truth, ...]
    campaign: str


@dataclass(frozen=True)
class Plan:
    """What is done with a unit: motion, readings a second, length, temperatures of the runs, the last one held out."""

    name: str
    profile: Profile | None
    rate: float
    seconds: float
    temperatures: tuple[Temperature, ...]
    spec: ImuSpec = WHITE
    hold: bool = True

    @property
    def learning(self) -> int:
        """Number of runs to learn from."""
        return len(self.temperatures) - self.hold


# --------------------------------------------------------------------------------------------------------- campaigns


def tumble() -> Profile:
    """18 attitudes, heading both ways, constant rates both ways and sines about each axis; 872 s."""
    rest = [
        *[(0, 0, 0), (90, 0, 0), (180, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0), (0, 0, 90), (0, 0, 180)],
        *[(45, 0, 0), (-45, 0, 30), (0, 45, 60), (0, -45, 0), (45, 45, 0), (30, -45, 90), (135, 0, 0), (-135, 0, 0)],
        *[(90, 0, 90), (-90, 0, 45)],
    ]
    segments: list[Dwell | Rate | Sine] = [Dwell((a * DPS, b * DPS, c * DPS), 20.0) for a, b, c in rest]
    segments += [Dwell((0.0, 0.0, 0.0), 10.0), Rate("inner", 10.0 * DPS, 36.0), Rate("inner", -10.0 * DPS, 36.0)]
    for axis in ("inner", "outer", "middle"):
        segments += [Rate(axis, rate * DPS, 8.0) for rate in (30, -30, 60, -60, 90, -90)]
        segments.append(Dwell((0.0, 0.0, 0.0), 5.0))
        segments += [Sine(axis, 20.0 * DPS, hz, 15.0) for hz in (0.3, 0.8)]
    segments.append(Dwell((0.0, 0.0, 0.0), 10.0))
    return Profile(tuple(segments))


FULL = tumble()


def full(rng: np.random.Generator, spec: ImuSpec = WHITE) -> Plan:
    """Three runs to learn from and one held out, of the whole table programme at 100 Hz."""
    return Plan("full", FULL, 100.0, FULL.duration, histories(rng, 4, FULL.duration), spec)


def static(rng: np.random.Generator, rate: float = 20.0, seconds: float = 1800.0, spec: ImuSpec = WHITE) -> Plan:
    """Two runs to learn from and one held out, level and still."""
    return Plan("static", None, rate, seconds, histories(rng, 3, seconds, cold=True), spec)


def cold_start(rng: np.random.Generator) -> Plan:
    """One run that warms up by itself."""
    return Plan("cold start", None, 20.0, 1800.0, (_warming(rng, 1800.0),), hold=False)


def histories(rng: np.random.Generator, runs: int, seconds: float, cold: bool = False) -> tuple[Temperature, ...]:
    """Temperatures of runs that differ: no two of one kind; the first a cold start if so wanted."""
    kinds = rng.permutation(["up", "down", "up-down", "down-up"]).tolist()
    out = [_driven(rng, str(kind), seconds) for kind in kinds[:runs]]
    return (_warming(rng, seconds), *out[1:]) if cold else tuple(out)


def _warming(rng: np.random.Generator, seconds: float) -> Temperature:
    start, rise, tau = rng.uniform(18, 26), rng.uniform(5, 12), rng.uniform(250, 700)
    t = np.linspace(0.0, seconds, 120)
    return Temperature(tuple((float(x), float(start - rise * np.expm1(-x / tau))) for x in t))


def _driven(rng: np.random.Generator, kind: str, seconds: float) -> Temperature:
    low, span = rng.uniform(18, 24), rng.uniform(8, 15)
    at = rng.uniform(0.3, 0.6) * seconds
    end = low + rng.uniform(0.1, 0.6) * span
    points = {
        "up": [(0.0, low), (seconds, low + span)],
        "down": [(0.0, low + span), (seconds, low)],
        "up-down": [(0.0, low), (at, low + span), (seconds, end)],
        "down-up": [(0.0, low + span), (at, low), (seconds, end)],
    }[kind]
    return Temperature(tuple((float(t), float(T)) for t, T in points))


# -------------------------------------------------------------------------------------------------------------- runs


@dataclass(frozen=True)
class Spoiled:
    """What is wrong, as the simulator takes it (for each run its own) or as a function of what was simulated."""

    effects: Callable[[int], tuple[Effect, ...]] = lambda run: ()
    more: Callable[[int, forms.World], Array] | None = None


def recorded(plan: Plan, seed: int, run: int, effects: Sequence[Effect], spec: ImuSpec, rate: float) -> Recording:
    powers = tuple(PowerOn(seed=seed * 16 + k, temperature=T) for k, T in enumerate(plan.temperatures))
    scenario = Scenario(
        seed=seed,
        spec=spec,
        accel_bias_run_sd=0.5 * MG,
        gyro_bias_run_sd=0.05 * DPS,
        profile=plan.profile,
        effects=tuple(effects),
        power_ons=powers,
    )
    return Unit(scenario, run, rate).record(int(rate * plan.seconds))


def reading(recording: Recording) -> Array:
    """Readings in the instrument's axes and sign, shape (N, 6)."""
    axes = AxisMap()
    samples = recording.samples
    return np.hstack([axes.gyro_to_instrument(samples.gyro), axes.accel_to_instrument(samples.accel)])


def made(plan: Plan, seed: int, spoiled: Spoiled) -> tuple[Run, ...]:
    """All runs of a plan, quantised to counts, with the temperature sensor's own noise and steps."""
    out = []
    for k in range(len(plan.temperatures)):
        recording = recorded(plan, seed, k, spoiled.effects(k), plan.spec, plan.rate)
        values = reading(recording)
        if spoiled.more is not None:
            values = values + spoiled.more(k, world(plan, recording))
        values = np.rint(values / COUNT) * COUNT
        rng = np.random.default_rng([seed, k])
        T = recording.temperature_degc + 0.02 * rng.standard_normal(len(values))
        T = np.round(T / 0.05) * 0.05
        angles = rest_attitudes(recording.angles)
        rates = recording.rates if len(angles) > 1 else recording.rates[:1]
        t = recording.samples.t - recording.samples.t[0]
        hz = np.repeat([plan.spec.gyro_bandwidth, plan.spec.accel_bandwidth], 3)
        poles = np.where(hz > 0.0, np.exp(-2.0 * np.pi * hz / plan.rate), 0.0)
        latency = poles / (1.0 - poles) / plan.rate
        name = f"run {k + 1}"
        out.append(
            Run(
                name, t, values, T, angles, rates, AxisMap(), forms.SITE, None, COUNT, hz if hz.any() else None, latency
            )
        )
    return tuple(out)


def world(plan: Plan, recording: Recording) -> forms.World:
    """What an error may be a function of, as it truly was."""
    t = recording.number / plan.rate
    C = attitudes(recording.angles)
    spin = np.einsum("nij,i->nj", C, earth_rate_n(np.array(forms.SITE.latitude)))
    gyro = body_rate(recording.angles, recording.rates) + spin
    axes = AxisMap()
    perfect = np.hstack([axes.gyro_to_instrument(gyro), axes.accel_to_instrument(-forms.SITE.gravity * C[:, 2])])
    return forms.World(t, perfect, recording.temperature_degc, recording.angles, recording.rates)


def density(spec: ImuSpec) -> Array:
    """White noise of the six channels, unit·√s."""
    return np.repeat([spec.gyro_arw, spec.accel_vrw], 3)


def detectability(plan: Plan, seed: int, spoiled: Spoiled, rate: float) -> Array:
    """d of each channel, shape (6,)."""
    silent = replace(plan.spec, gyro_arw=0.0, accel_vrw=0.0)
    total = np.zeros(6)
    for k in range(plan.learning):
        clean = recorded(plan, seed, k, (), silent, rate)
        effects = spoiled.effects(k)
        error = (
            reading(recorded(plan, seed, k, effects, silent, rate)) - reading(clean) if effects else np.zeros((1, 6))
        )
        if spoiled.more is not None:
            error = error + spoiled.more(k, world(replace(plan, rate=rate), clean))
        total += np.sum((error - error.mean(axis=0)) ** 2, axis=0) / rate
    return np.sqrt(total) / density(plan.spec)


def where(d: Array) -> tuple[str, ...]:
    """Channels that have at least a tenth of the whole d²."""
    return tuple(name for name, own in zip(CHANNELS, d, strict=True) if own**2 >= 0.1 * (d @ d))


# ----------------------------------------------------------------------------------------------- the catalogue's ones


@dataclass(frozen=True)
class Drawn:
    """An effect of unit size: `at(scale)` gives it, `only` the run that has it (None: all)."""

    name: str
    at: Callable[[float], Effect]
    only: int | None = None
    facts: Mapping[str, float] = field(default_factory=dict)
    named: Mapping[str, str] = field(default_factory=dict)

    def spoiled(self, scale: float) -> Spoiled:
        """As `made` takes it."""
        effect = self.at(scale)
        return Spoiled(lambda run: (effect,) if self.only in (None, run) else ())


THERMAL = ("thermal_lin", "thermal_poly", "thermal_rate", "thermal_lag", "hysteresis", "warmup", "ramp")
EVENTS = ("tone", "step", *_STOCHASTIC)
MOVING = (
    *("scale", "asymmetry", "nonlinearity_cubic", "nonlinearity_quadratic", "thermal_scale", "cross_axis", "mounting"),
    *("g_sensitivity", "g_squared", "earth_rate", "harmonic", "delay", "lever_arm", "tilt", "gravity"),
)
_ORDER = (
    *("thermal_lin", "scale", "warmup", "g_sensitivity", "tone", "mounting", "thermal_rate", "cross_axis", "step"),
    *("lever_arm", "thermal_lag", "harmonic", "gauss_markov", "tilt", "thermal_poly", "asymmetry", "telegraph"),
    *("delay", "ramp", "nonlinearity_cubic", "random_walk", "gravity", "hysteresis", "thermal_scale", "g_squared"),
    *("nonlinearity_quadratic", "earth_rate"),
)


def drawn(rng: np.random.Generator, name: str, plan: Plan, channel: str | None = None) -> Drawn:
    """An effect of the catalogue with everything but its size drawn."""
    c = channel or str(rng.choice(CHANNELS[:3] if name in ("nonlinearity_quadratic", "g_sensitivity") else CHANNELS))
    e, x = ("dps", "dps") if c[0] == "g" else ("mg", "g")
    base, sign = (0.01 if e == "dps" else 1.0), float(rng.choice([-1.0, 1.0]))

    def one(key: str, value: float, parameter: str = "k", **other: float | str) -> Drawn:
        own = {parameter: key} if parameter else {}
        return Drawn(name, lambda s: Effect(name, (c,), {key: s * value * sign, **other}), None, {}, own)

    def vector(unit: str, axes: Sequence[str], size: float, channels: tuple[str, ...]) -> Drawn:
        direction = rng.standard_normal(len(axes))
        direction *= size / np.linalg.norm(direction)
        values = {f"{a}_{unit}": float(v) for a, v in zip(axes, direction, strict=True)}
        named = {a: f"{a}_{unit}" for a in axes}
        return Drawn(name, lambda s: Effect(name, channels, {k: s * v for k, v in values.items()}), None, {}, named)

    match name:
        case "thermal_lin":
            return one(f"{e}_per_k", base)
        case "thermal_poly":
            return one(f"{e}_per_k2", base, "k2")
        case "thermal_rate":
            return one(f"{e}_s_per_k", 50.0 * base)
        case "thermal_lag":
            return one(f"{e}_per_k", base, "", tau_s=float(rng.uniform(40, 180)))
        case "hysteresis":
            return one(e, 10.0 * base, "", width_k=float(np.exp(rng.uniform(np.log(3), np.log(15)))))
        case "warmup":
            return one(e, 10.0 * base, "", tau_s=float(rng.uniform(40, 400)))
        case "ramp":
            return one(f"{e}_per_s", 1e-3 * base)
        case "scale" | "asymmetry":
            return one("relative", 1e-3)
        case "nonlinearity_cubic":
            return one(f"{e}_per_{x}3", 1e-6 if e == "dps" else 1.0)
        case "nonlinearity_quadratic":
            return one("dps_per_dps2", 1e-5)
        case "thermal_scale":
            return one("relative_per_k", 1e-4)
        case "cross_axis":
            return vector("rad", [a for a in "xyz" if a != c[1]], 1e-3, (c,))
        case "mounting":
            return vector("rad", "xyz", 1e-3, ())
        case "g_sensitivity":
            axes = "xyz" if rng.random() < 0.5 else str(rng.choice(list("xyz")))
            return vector("dps_per_g", list(axes), 0.05, (c,))
        case "g_squared":
            return one(f"{e}_per_g2", base, axis=str(rng.choice(list("xyz"))))
        case "earth_rate":
            return Drawn(name, lambda s: Effect(name, (), {"coefficient": s * sign}), None, {}, {"k": "coefficient"})
        case "harmonic":
            phase, order = rng.uniform(0, 2 * np.pi), float(rng.integers(1, 3))
            shape: dict[str, float | str] = {"order": order, "axis": str(rng.choice(["outer", "middle", "inner"]))}
            size = {f"sin_{e}": 5 * base * np.sin(phase), f"cos_{e}": 5 * base * np.cos(phase)}
            named = {"sin": f"sin_{e}", "cos": f"cos_{e}"}
            return Drawn(
                name, lambda s: Effect(name, (c,), {**shape, **{k: s * v for k, v in size.items()}}), None, {}, named
            )
        case "delay":
            return Drawn(name, lambda s: Effect(name, (), {"tau_s": s * 1e-3}), None, {}, {"tau": "tau_s"})
        case "lever_arm":
            return vector("m", "xyz", 0.01, ())
        case "tilt":
            return vector("deg", ("north", "east"), 0.02, ())
        case "gravity":
            return Drawn(name, lambda s: Effect(name, (), {"relative": s * 1e-4 * sign}), None, {}, {"k": "relative"})
        case "tone":
            hz = float(np.exp(rng.uniform(np.log(5.0 / plan.seconds), np.log(0.4 * plan.rate))))
            return replace(one(e, 10.0 * base, "", hz=hz), facts={"hz": hz})
        case "step":
            made_one = one(e, 10.0 * base, at_s=float(rng.uniform(0.15, 0.85) * plan.seconds))
            return replace(made_one, only=int(rng.integers(plan.learning)) if rng.random() < 0.5 else None)
        case "telegraph":
            return one(e, 10.0 * base, "", mean_s=float(rng.uniform(30.0, 0.1 * plan.seconds)))
        case "random_walk":
            return Drawn(name, lambda s: Effect(name, (c,), {f"{e}_per_sqrt_s": s * 0.1 * base}))
        case "gauss_markov":
            tau = float(np.exp(rng.uniform(np.log(2.0), np.log(0.1 * plan.seconds))))
            return Drawn(name, lambda s: Effect(name, (c,), {e: s * base, "tau_s": tau}))
    raise ValueError(f"`name` is {name}: no effect to draw")


def sized(plan: Plan, seed: int, made_one: Drawn, d: float) -> tuple[Spoiled, Truth]:
    """An effect of the size that gives d, and the truth about it."""
    rate = plan.rate if made_one.name in (*_STOCHASTIC, "tone") else min(plan.rate, _SLOW_HZ)
    unit = detectability(plan, seed, made_one.spoiled(1.0), rate)
    scale = d / max(float(np.linalg.norm(unit)), 1e-12)
    effect = made_one.at(scale)
    named = {k: float(effect.parameters[key]) for k, key in made_one.named.items()}
    truth = Truth(
        f"{effect.name} {dict(effect.parameters)}" + ("" if made_one.only is None else f" in run {made_one.only + 1}"),
        frozenset([effect.name]),
        where(unit) if not effect.channels else effect.channels,
        d,
        "drift" if effect.name in ("random_walk", "gauss_markov") else "findings",
        named,
        made_one.facts.get("hz", 0.0),
        effect.name not in EVENTS,
    )
    return made_one.spoiled(scale), truth


def together(parts: Sequence[Spoiled]) -> Spoiled:
    """Several at once; at most one of them is a function of what was simulated."""
    more = [part.more for part in parts if part.more is not None]
    return Spoiled(lambda run: tuple(e for part in parts for e in part.effects(run)), more[0] if more else None)


# ------------------------------------------------------------------------------------------------------- the classes


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(1, 2**24))


def _loguniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _case(name: str, plan: Plan, seed: int, spoiled: Spoiled, truths: Sequence[Truth]) -> Case:
    runs = made(plan, seed, spoiled)
    learning = plan.learning
    return Case(name, runs[:learning], runs[learning] if plan.hold else None, tuple(truths), plan.name)


def free(name: str, number: int, rng: np.random.Generator) -> Case:
    plan = full(rng) if number % 2 else static(rng)
    return _case(name, plan, _seed(rng), Spoiled(), ())


def flicker(name: str, number: int, rng: np.random.Generator) -> Case:
    """Drift like 1/f on all channels, noise limited to the specification's bands, and no effect."""
    plan = full(rng, LIMITED) if number % 2 else static(rng, 100.0, 1800.0, LIMITED)
    seed = _seed(rng)
    return _case(name, plan, seed, forms_of_flicker(plan, rng), ())


def forms_of_flicker(plan: Plan, rng: np.random.Generator) -> Spoiled:
    """Four or five Gauss-Markov processes of equal size on each channel, E10 1.3 to 3 times its floor."""
    effects = []
    for c, name in enumerate(CHANNELS):
        count = int(rng.integers(4, 6))
        taus = np.geomspace(rng.uniform(2, 4), rng.uniform(500, 1000), count)
        wanted = rng.uniform(1.3, 3.0)
        # variance of a 10 s mean less that of the hold before it, of unit processes
        unit = np.mean([forms.hold_error(float(tau), plan.seconds) for tau in taus]) * count
        floor = density(plan.spec)[c] ** 2 * (1.0 / 10.0 + 1.0 / 60.0)
        sd = np.sqrt((wanted**2 - 1.0) * floor / unit)
        key, si = ("dps", DPS) if c < 3 else ("mg", MG)
        effects += [Effect("gauss_markov", (name,), {key: float(sd / si), "tau_s": float(tau)}) for tau in taus]
    return Spoiled(lambda run: tuple(effects))


def catalogue(name: str, number: int, rng: np.random.Generator, low: float = 8.0, high: float = 60.0) -> Case:
    effect = _ORDER[number % len(_ORDER)]
    still = effect not in MOVING and rng.random() < 0.6
    plan = static(rng) if still else full(rng)
    seed = _seed(rng)
    spoiled, truth = sized(plan, seed, drawn(rng, effect, plan), _loguniform(rng, low, high))
    return _case(name, plan, seed, spoiled, [truth])


def faint(name: str, number: int, rng: np.random.Generator) -> Case:
    """One effect of the catalogue that is too small to be seen."""
    return catalogue(name, number, rng, 1.0, 4.0)


def several(name: str, number: int, rng: np.random.Generator) -> Case:
    """Two to four effects at once, each on its own channel or shared."""
    plan = full(rng) if rng.random() < 0.7 else static(rng)
    possible = (*THERMAL, *EVENTS) if plan.profile is None else (*THERMAL, *EVENTS, *MOVING)
    seed = _seed(rng)
    names = rng.choice(possible, int(rng.integers(2, 5)), replace=False).tolist()
    free_channels = rng.permutation(CHANNELS).tolist()
    parts, truths = [], []
    for effect in names:
        gyro_only = effect in ("nonlinearity_quadratic", "g_sensitivity")
        own = next((c for c in free_channels if not gyro_only or c[0] == "g"), None)
        if own is None:
            continue
        free_channels.remove(own)
        spoiled, truth = sized(plan, seed, drawn(rng, effect, plan, own), _loguniform(rng, 8.0, 60.0))
        parts.append(spoiled)
        truths.append(truth)
    return _case(name, plan, seed, together(parts), truths)


def form(name: str, number: int, rng: np.random.Generator) -> Case:
    """An error driven by something logged, in a form that the catalogue does not have."""
    kind = forms.FORMS[number % len(forms.FORMS)]
    plan = static(rng) if kind.still and rng.random() < 0.5 else full(rng)
    return _outside(name, kind, plan, rng, 15.0)


def unknown(name: str, number: int, rng: np.random.Generator) -> Case:
    """An error of a form and with a driver that nobody knows."""
    kind = forms.UNKNOWN[number % len(forms.UNKNOWN)]
    plan = full(rng) if rng.random() < 0.5 else static(rng)
    return _outside(name, kind, plan, rng, 15.0)


def _outside(name: str, kind: forms.Form, plan: Plan, rng: np.random.Generator, low: float) -> Case:
    seed, d = _seed(rng), _loguniform(rng, low, 80.0)
    c = int(rng.choice(kind.channels))
    function, names = kind.drawn(rng, c)

    def more(run: int, at: forms.World) -> Array:
        out = np.zeros((at.t.size, 6))
        out[:, c] = function(at, np.random.default_rng([seed, run, 77]))
        return out

    unit = detectability(plan, seed, Spoiled(more=more), min(plan.rate, _SLOW_HZ))
    scale = d / max(float(np.linalg.norm(unit)), 1e-12)
    truth = Truth(kind.name, frozenset(names), (CHANNELS[c],), d, transfers=bool(names))
    return _case(name, plan, seed, Spoiled(more=lambda run, at: scale * more(run, at)), [truth])


def integrity(name: str, number: int, rng: np.random.Generator) -> Case:
    effect = ("spikes", "stuck", "saturation", "coarse", "dropout", "jitter")[number % 6]
    plan = full(rng) if rng.random() < 0.5 else static(rng, 100.0, 900.0)
    c = int(rng.integers(6))
    e, x = ("dps", "dps") if c < 3 else ("mg", "g")
    sd = density(plan.spec)[c] * np.sqrt(plan.rate) / (DPS if c < 3 else MG)
    count = COUNT[c] / (DPS if c < 3 else MG)
    channels: tuple[str, ...] = (CHANNELS[c],)
    parameters: dict[str, float] = {}
    match effect:
        case "spikes":
            parameters = {e: float(sd * rng.uniform(10, 40)), "per_hour": _loguniform(rng, 20, 300)}
        case "stuck":
            parameters = {"at_s": float(rng.uniform(0.1, 0.9) * plan.seconds), "seconds": _loguniform(rng, 0.3, 10)}
        case "saturation":
            if plan.profile is None:
                c = 5
                parameters = {"limit_g": 1.0 + 1e-3 * float(rng.uniform(-10, 25))}
            else:
                parameters = {f"limit_{x}": float(rng.uniform(65, 85) if c < 3 else rng.uniform(0.75, 0.98))}
            channels = (CHANNELS[c],)
        case "coarse":
            parameters = {f"lattice_{e}": float(count * rng.integers(4, 24))}
        case "dropout":
            gap = {"at_s": float(rng.uniform(0.1, 0.9) * plan.seconds), "seconds": _loguniform(rng, 0.3, 10)}
            parameters = gap if rng.random() < 0.5 else {"probability": _loguniform(rng, 1e-4, 1e-2)}
            channels = ()
        case "jitter":
            parameters = {"sd_s": float(rng.uniform(0.08, 0.25) / plan.rate)}
            channels = ()
    made_one = Effect(effect, channels, parameters)
    truth = Truth(
        f"{effect} {parameters}", frozenset([effect]), channels or CHANNELS, place="integrity", transfers=False
    )
    return _case(name, plan, _seed(rng), Spoiled(lambda run: (made_one,)), [truth])


def noise(name: str, number: int, rng: np.random.Generator) -> Case:
    """Noise that is not white, not even, or not each channel's own."""
    effect = ("noise_level", "bandwidth", "noise_crosstalk")[number % 3]
    moving = rng.random() < 0.5
    plan = full(rng) if moving else static(rng, 100.0, 900.0)
    c = int(rng.integers(6))
    channels: tuple[str, ...] = (CHANNELS[c],)
    parameters: dict[str, float | str] = {}
    names = {effect}
    match effect:
        case "noise_level":
            drivers = {"temperature": 10.0, "time": plan.seconds}
            drivers |= {"rate_norm": 60.0, "fx": 2.0, "fz": 2.0, "wz": 120.0} if moving else {}
            driver = str(rng.choice(list(drivers)))
            change = 2.0 * np.log(rng.uniform(1.5, 3.0)) * rng.choice([-1.0, 1.0])
            b = float(change / drivers[driver])
            parameters = {"driver": driver, "log_variance_per_unit": b}
            parameters |= {"log_variance": -25.0 * b} if driver == "temperature" else {}
            names = {driver}
        case "bandwidth":
            parameters = {"hz": _loguniform(rng, 4.0, 25.0)}
        case "noise_crosstalk":
            other = int(rng.choice([k for k in range(6) if k != c]))
            channels = (CHANNELS[c], CHANNELS[other])
            parameters = {"correlation": float(rng.uniform(0.05, 0.6) * rng.choice([-1.0, 1.0]))}
    made_one = Effect(effect, channels, parameters)
    place = "noise_level" if effect == "noise_level" else "findings"
    truth = Truth(f"{effect} {parameters}", frozenset(names), channels, place=place, transfers=False)
    return _case(name, plan, _seed(rng), Spoiled(lambda run: (made_one,)), [truth])


def single(name: str, number: int, rng: np.random.Generator) -> Case:
    """One cold start, one effect of the thermal family."""
    plan, seed = cold_start(rng), _seed(rng)
    made_one = drawn(rng, THERMAL[number % len(THERMAL)], plan)
    spoiled, truth = sized(plan, seed, made_one, _loguniform(rng, 15.0, 60.0))
    return _case(name, plan, seed, spoiled, [truth])


CLASSES: dict[str, tuple[Callable[[str, int, np.random.Generator], Case], int]] = {
    "free": (free, 40),
    "flicker": (flicker, 30),
    "catalogue": (catalogue, 60),
    "faint": (faint, 20),
    "several": (several, 30),
    "form": (form, 30),
    "unknown": (unknown, 20),
    "integrity": (integrity, 20),
    "noise": (noise, 12),
    "single": (single, 20),
}
"""Name to what makes a case, and how many there are."""


def case(kind: str, number: int, final: bool = False) -> Case:
    """Case of a class.

    `kind`: name in `CLASSES`.
    `final`: whether of the set that is kept for the last count, not of the one for development.
    """
    maker, _ = CLASSES[kind]
    rng = np.random.default_rng([int(final), list(CLASSES).index(kind), number])
    return maker(f"{kind}:{number}", number, rng)

"""The catalogue: every effect by name, with what it is, and how a hypothesis is made again from its name and shape."""

from collections.abc import Mapping
from dataclasses import dataclass

from filters.channels import CHANNELS
from filters.effects import deterministic, drivers, thermal_average
from filters.effects.hypothesis import Hypothesis
from filters.effects.records import ShapeValue, number_of, numbers_of
from filters.errors import InputError
from filters.motion.segments import AXES


@dataclass(frozen=True, slots=True)
class Entry:
    """An effect of the catalogue."""

    kind: str  # family: additive, motion, run_specific, drift, noise, fault
    equation: str  # of the error e
    include_as: str  # a constant states, S stochastic states, N noise, P pre-filter
    source: str  # where the form comes from


_STANDARD = "IEEE Std 952 / 1293 error models"
_FAULT = "data acquisition practice"

EFFECTS: dict[str, Entry] = {
    "thermal_lin": Entry("additive", "k (T - T0)", "A", _STANDARD),
    "thermal_poly": Entry("additive", "k1 dT + k2 dT² (+ k3 dT³)", "A", "IEEE Std 1293; PX4 thermal calibration"),
    "thermal_rate": Entry("additive", "k T'", "A", _STANDARD),
    "thermal_lag": Entry("additive", "k (T_tau - T)", "A", "first-order heat path"),
    "hysteresis": Entry("additive", "k mean P_n(T) / width", "A", "Prandtl-Ishlinskii play operators"),
    "warmup": Entry("additive", "k exp(-t/tau)", "A", _STANDARD),
    "ramp": Entry("additive", "k t", "A", _STANDARD),
    "scale": Entry("additive", "k x", "A", _STANDARD),
    "asymmetry": Entry("additive", "k |x|", "A", _STANDARD),
    "nonlinearity_cubic": Entry("additive", "k x³", "A", _STANDARD),
    "nonlinearity_quadratic": Entry("additive", "k w²", "A", _STANDARD),
    "thermal_scale": Entry("additive", "k x (T - T0)", "A", _STANDARD),
    "cross_axis": Entry("additive", "k_j x_j + k_k x_k", "A", _STANDARD),
    "mounting": Entry("motion", "v × d", "A", "small rotation"),
    "g_sensitivity": Entry("additive", "G f", "A", _STANDARD),
    "g_squared": Entry("additive", "k f_j²", "A", _STANDARD),
    "earth_rate": Entry("motion", "k C w_ie", "A", "WGS-84"),
    "harmonic": Entry("motion", "a sin h θ + b cos h θ", "A", "table wobble, magnetic fields"),
    "delay": Entry("motion", "-tau x'", "A", "first-order expansion"),
    "lever_arm": Entry("motion", "w × (w × r) + w' × r", "A", "rigid-body kinematics"),
    "tilt": Entry("motion", "C (δ × (0, 0, -γ))", "A", "small rotation"),
    "gravity": Entry("motion", "k C (0, 0, -γ)", "A", "WGS-84 normal gravity"),
    "tone": Entry("run_specific", "a sin 2π f t + b cos 2π f t", "S", "vibration"),
    "step": Entry("run_specific", "k H(t - t0)", "S", "mechanical shock, restarts"),
    "telegraph": Entry("run_specific", "k s(t), s in {0, 1}", "S", "burst noise"),
    "random_walk": Entry("drift", "b' = w", "S", "IEEE Std 952 rate random walk"),
    "gauss_markov": Entry("drift", "b' = -b/tau + w", "S", "IEEE Std 952 correlated noise"),
    "bias": Entry("additive", "b, of units turned by hand only", "A", _STANDARD),
    "noise_level": Entry("noise", "log σ² = a + terms", "N", _STANDARD),
    "bandwidth": Entry("noise", "first-order limit", "N", _STANDARD),
    "noise_crosstalk": Entry("noise", "correlated noise", "N", _STANDARD),
    "spikes": Entry("fault", "isolated readings", "P", _FAULT),
    "stuck": Entry("fault", "repeated readings", "P", _FAULT),
    "saturation": Entry("fault", "clipped readings", "P", _FAULT),
    "coarse": Entry("fault", "a coarse lattice", "N", _FAULT),
    "dropout": Entry("fault", "missing readings", "P", _FAULT),
    "jitter": Entry("fault", "stamps that are off", "P", _FAULT),
}  # name to entry, in the order of docs/effects_notes.toml


def hypothesis(effect: str, channels: tuple[str, ...], shape: Mapping[str, ShapeValue]) -> Hypothesis:
    """A deterministic effect from its name, channels and shape, as a trace wrote them.

    `effect`: in the catalogue, driver:NAME or cause:OPERATOR(NAME).
    `channels`: of gx gy gz ax ay az.
    `shape`: what its `shape()` gave, and a driver's knots.
    Raises InputError if there is no such effect, or its shape is not one that it can have.
    """
    for s in deterministic.shared():
        if s.effect == effect and channels in ((), tuple(CHANNELS[c] for c in s.channels)):
            return s
    if len(channels) != 1:
        raise InputError(f'`channels` of "{effect}" is {", ".join(channels)}: it is an effect of one channel')
    channel = CHANNELS.index(channels[0])
    if shape.get("form") == thermal_average.FORM:
        return thermal_average.from_file(effect, channel, shape)
    if effect.startswith("cause:"):
        return drivers.chain_of(effect.removeprefix("cause:"), shape).on(channel)
    if effect.startswith("driver:"):
        return _driver(effect.removeprefix("driver:"), channel, shape)
    from_s = number_of(shape, "from_s", 0.0) if effect == "warmup" else 0.0
    every = (*deterministic.of_sensor(channel, from_s), *deterministic.harmonics(channel), deterministic.bias(channel))
    known = [h for h in every if h.effect == effect]
    if not known:
        raise InputError(f'`effect` is "{effect}", which {channels[0]} can\'t have or which joins no filter')
    wanted = {key: value for key, value in shape.items() if key != "knots"}
    for h in known:
        if h.shape == wanted:
            return h
    raise InputError(f'`parameters` of "{effect}" are {wanted}, not one of {[dict(h.shape) for h in known]}')


def _driver(name: str, channel: int, shape: Mapping[str, ShapeValue]) -> Hypothesis:
    """A driver on its own knots; those without a memory of the table's motion."""
    ranges = dict.fromkeys((*drivers.SCALARS, *AXES), (0.0, 1.0))
    if "knots" in shape:
        knots = numbers_of(shape, "knots")
        if not knots:
            raise InputError(f'`knots` of "driver:{name}" has none')
        ranges[name] = (knots[0], knots[-1])
    if "centre" in shape:
        centre = number_of(shape, "centre")
        ranges[name.split("*")[0]] = (centre, centre)
    if "threshold_degc" in shape:
        return drivers.threshold(number_of(shape, "threshold_degc")).on(channel)
    for basis in drivers.bases(ranges):
        same = basis.name == name and basis.kind == shape.get("basis")
        if same and all(basis.shape.get(key) == shape.get(key) for key in ("order", "tau_s")):
            return basis.on(channel)
    raise InputError(f'"driver:{name}" with the basis {shape.get("basis")} is not known')

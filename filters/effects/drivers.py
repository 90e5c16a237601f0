"""Free curves over anything that was logged: what finds an effect whose form, or whose name, no catalogue has.

A driver is a quantity of `Inputs` in the unit it is reported in; a basis makes columns of it.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from filters.channels import DPS, G
from filters.effects.hypothesis import Hypothesis, Parameter, own_parameter
from filters.effects.inputs import TRAILED, TRAILS, Inputs
from filters.motion.segments import AXES
from filters.types import Array

RELAY_LEVELS = 25  # temperatures between which a state may flip up and down
_RELAY_K = 5.0
SETTLING_TAUS = (2.0, 10.0, 40.0)
THRESHOLDS = 9
KNEES = 10  # temperatures at which a slope may change
CREEP_TAUS = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0)  # of ln(1 + t / tau), s
CREEP_POWERS = (0.2, 0.35, 0.5, 0.7)  # of t
PAST_MOTION = ("settling", "direction", "turns", "since_motion", "table_accel")
"""Drivers that follow the table's past motion, which the filter does not have, as their names begin."""
_KNOTS = {"time": 9, "temperature": 8, "temperature_rate": 6, "since_motion": 6, "rate_norm": 6, "table_accel": 5}
_KNOTS_INPUT = 7
_FOURIER = (3, 6)
_LOGARITHMIC = ("since_motion",)

Values = Callable[[Inputs], Array]


def _input(column: int) -> Values:
    return lambda inputs: inputs.x[:, column] / (DPS if column < 3 else G)


def _product(a: Values, b: Values) -> Values:
    return lambda inputs: a(inputs) * b(inputs)


def _norm(inputs: Inputs) -> Array:
    return np.asarray(np.linalg.norm(inputs.x[:, :3], axis=1)) / DPS


SCALARS: dict[str, tuple[str, Values, str]] = {
    "time": ("s", lambda inputs: inputs.t, "time"),
    "temperature": ("degC", lambda inputs: inputs.temperature, "temperature"),
    "temperature_rate": ("K/s", lambda inputs: inputs.temperature_rate, "temperature"),
    "since_motion": ("s", lambda inputs: inputs.since_motion, "motion"),
    **{f"w{axis}": ("deg/s", _input(k), "motion") for k, axis in enumerate("xyz")},
    **{f"f{axis}": ("g", _input(3 + k), "motion") for k, axis in enumerate("xyz")},
    "rate_norm": ("deg/s", _norm, "motion"),
    "table_accel": ("deg/s2", lambda inputs: inputs.table_accel / DPS, "motion"),
}  # name to unit, value, and what it is a function of


def _turns(axis: int) -> Values:
    return lambda inputs: inputs.angles[:, axis] / (2.0 * np.pi)


def _direction(axis: int) -> Values:
    return lambda inputs: inputs.direction[:, axis]


@dataclass(frozen=True, eq=False, kw_only=True)
class Driver(Hypothesis):
    """e = sum of θ_i B_i(driver): columns of a basis, the same for every channel, each in the channel's unit."""

    kind: str  # of the basis: hat, fourier, line, threshold, relay, settling, trail, kink, creep
    knots: tuple[float, ...] = ()
    unit: str = ""

    is_free: ClassVar = True

    @property
    def name(self) -> str:
        """Of the driver."""
        return self.effect.removeprefix("driver:")

    @property
    def label(self) -> str:
        words = super().label
        if self.kind == "kink":
            return f"{words}, above {self.shape['knee_degc']:.3g} degC only"
        if self.kind == "creep":
            form = f"ln(1 + t / {self.shape['tau_s']:g} s)" if "tau_s" in self.shape else f"t^{self.shape['power']:g}"
            return f"{words}, as {form}"
        if self.kind == "relay":
            low, high = (float(self.shape[key]) for key in ("down_degc", "up_degc"))
            return f"{words}, flipping up above {high:.3g} and back below {low:.3g} degC"
        return f"{words}, which it follows in some {self.shape['tau_s']:g} s" if self.kind == "trail" else words

    @property
    def in_filter(self) -> bool:
        """Whether the filter can have it from what it knows: not what remembers the table's motion, or a flip."""
        return self.kind not in ("relay", "trail") and not self.name.startswith(PAST_MOTION)

    def on(self, channel: int) -> "Driver":
        """The same on a channel."""
        own = _parameters(channel, len(self.parameters), self.knots, self.unit)
        return replace(self, channels=(channel,), parameters=own)


def _parameters(channel: int, count: int, knots: Sequence[float], unit: str) -> tuple[Parameter, ...]:
    """One for each column; any size is plausible where nothing is known."""
    names = [f"at {knot:.4g} {unit}" for knot in knots[1:]] or [f"b{k + 1}" for k in range(count)]
    return tuple(own_parameter(channel, name if count > 1 or knots else "k", "", 1.0, 10.0) for name in names)


def _driver(
    name: str,
    columns: Callable[[Inputs], Array],
    count: int,
    kind: str,
    source: str,
    parts: Mapping[str, float | str],
    knots: tuple[float, ...] = (),
    unit: str = "",
    choices: int = 1,
    over: tuple[str, ...] = (),
) -> Driver:
    """On channel 0: `on` gives it on another."""
    return Driver(
        effect=f"driver:{name}",
        channels=(0,),
        source=source,
        parameters=_parameters(0, count, knots, unit),
        columns=lambda inputs, channel: columns(inputs),
        shape={"basis": kind, **parts},
        grid=choices,
        over=over,
        at_blocks=kind in ("settling", "trail") or name.startswith(("since", "direction")),
        kind=kind,
        knots=knots,
        unit=unit,
    )


def hats(values: Array, knots: Array) -> Array:
    """Hat functions on the knots but the first (their sum is a constant, which is the bias); shape (n, K - 1)."""
    place = np.clip(np.interp(values, knots, np.arange(knots.size)), 0.0, knots.size - 1.0)
    return np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(1, knots.size)))


def bases(ranges: Mapping[str, tuple[float, float]]) -> list[Driver]:
    """All bases that the data can carry.

    `ranges`: least and greatest value of each scalar driver over all runs, and of "outer", "middle", "inner" (rad);
      those that do not vary are missing.
    """
    made = [_hat(name, *ranges[name]) for name in SCALARS if name in ranges]
    if "temperature" in ranges:
        made += _thresholds(*ranges["temperature"]) + _relays(*ranges["temperature"])
        made += _kinks(*ranges["temperature"])
    if "time" in ranges:
        made += [creep(tau_s=tau) for tau in CREEP_TAUS] + [creep(power=power) for power in CREEP_POWERS]
    for k, axis in enumerate(AXES):
        if axis in ranges:
            made += _of_axis(k, axis, ranges[axis])
    return made + _trails(ranges) + _products(ranges)


def _hat(name: str, low: float, high: float) -> Driver:
    unit, value, source = SCALARS[name]
    count = _KNOTS.get(name, _KNOTS_INPUT)
    if name in _LOGARITHMIC:
        knots = np.expm1(np.linspace(np.log1p(low), np.log1p(high), count))
    else:
        knots = np.linspace(low, high, count)
    return _driver(
        name, lambda inputs: hats(value(inputs), knots), count - 1, "hat", source, {}, tuple(knots.tolist()), unit
    )


def _thresholds(low: float, high: float) -> list[Driver]:
    at = np.linspace(low, high, THRESHOLDS + 2)[1:-1]
    return [threshold(float(limit)) for limit in at]


def threshold(limit: float) -> Driver:
    """e = k H(T - limit)."""

    def above(inputs: Inputs) -> Array:
        return (inputs.temperature > limit).astype(np.float64)[:, None]

    parts, over = {"threshold_degc": limit}, ("temperature",)
    name = "temperature_threshold"
    return _driver(name, above, 1, "threshold", "temperature", parts, unit="degC", choices=THRESHOLDS, over=over)


def _kinks(low: float, high: float) -> list[Driver]:
    # near an end of the range what has a knee is a slope, or nothing
    inner = np.linspace(low, high, KNEES + 6)[3:-3]
    return [kink(float(knee)) for knee in inner]


def kink(knee: float) -> Driver:
    """e = k max(T - knee, 0)."""

    def above(inputs: Inputs) -> Array:
        return np.maximum(inputs.temperature - knee, 0.0)[:, None]

    parts, over = {"knee_degc": knee}, ("temperature",)
    return _driver("temperature", above, 1, "kink", "temperature", parts, choices=KNEES, over=over)


def creep(*, tau_s: float = 0.0, power: float = 0.0) -> Driver:
    """e = k ln(1 + t / tau), or k (t / 100 s)^power: what settles ever more slowly, and has no time constant."""

    def crept(inputs: Inputs) -> Array:
        return (np.log1p(inputs.t / tau_s) if tau_s else (np.maximum(inputs.t, 0.0) / 100.0) ** power)[:, None]

    parts = {"tau_s": tau_s} if tau_s else {"power": power}
    return _driver(
        "time", crept, 1, "creep", "time", parts, choices=len(CREEP_TAUS) + len(CREEP_POWERS), over=("time",)
    )


def _relays(low: float, high: float) -> list[Driver]:
    if high - low < _RELAY_K:
        return []
    at = np.linspace(low, high, RELAY_LEVELS + 2)[1:-1].tolist()
    return [relay(down, up) for down, up in itertools.combinations(at, 2)]


def relay(down: float, up: float) -> Driver:
    """e = k s, s being 1 since temperature was last above `up`, 0 since it was last below `down`."""

    def state(inputs: Inputs) -> Array:
        T = inputs.temperature
        known = np.where(up < T, 1.0, np.where(down > T, 0.0, np.nan))
        last = np.maximum.accumulate(np.where(np.isnan(known), -1, np.arange(T.size)))
        # nothing is known of what was before: as if it came from the middle
        first = float(T[0] > 0.5 * (down + up)) if T.size else 0.0
        return np.where(last >= 0, known[np.maximum(last, 0)], first)[:, None]

    parts, over = {"down_degc": down, "up_degc": up}, ("temperature",)
    choices = THRESHOLDS + RELAY_LEVELS * (RELAY_LEVELS - 1) // 2
    return _driver(
        "temperature_threshold", state, 1, "relay", "temperature", parts, unit="degC", choices=choices, over=over
    )


def _trails(ranges: Mapping[str, tuple[float, float]]) -> list[Driver]:
    """What follows the inputs from behind, and how much the unit was turned of late."""
    made = []
    for k, name in enumerate(TRAILED):
        if name in ranges and "since_motion" in ranges:
            unit = DPS if k < 3 or name == "rate_norm" else G
            made += [_trail(name, k, j, unit) for j in range(len(TRAILS))]
    return made


def _trail(name: str, k: int, j: int, unit: float) -> Driver:
    def followed(inputs: Inputs) -> Array:
        return inputs.trail[:, k, j, None] / unit

    return _driver(name, followed, 1, "trail", "motion", {"tau_s": TRAILS[j]}, choices=len(TRAILS))


def _of_axis(k: int, axis: str, span: tuple[float, float]) -> list[Driver]:
    def fourier(order: int) -> Driver:
        def columns(inputs: Inputs) -> Array:
            angle = inputs.angles[:, k, None] * np.arange(1, order + 1)
            return np.hstack([np.sin(angle), np.cos(angle)])

        parts: dict[str, float | str] = {"order": float(order)}
        return _driver(
            f"angle_{axis}", columns, 2 * order, "fourier", "motion", parts, unit="deg", choices=len(_FOURIER)
        )

    def settling(tau: float) -> Driver:
        def columns(inputs: Inputs) -> Array:
            return (inputs.direction[:, k] * np.exp(-inputs.since_motion / tau))[:, None]

        return _driver(f"settling_{axis}", columns, 1, "settling", "motion", {"tau_s": tau}, choices=len(SETTLING_TAUS))

    made = [fourier(order) for order in _FOURIER] + [settling(tau) for tau in SETTLING_TAUS]
    made.append(_line(f"direction_{axis}", _direction(k), "motion"))
    if span[1] - span[0] > 2.0 * np.pi:
        made.append(_line(f"turns_{axis}", _turns(k), "motion"))
    return made


def _line(name: str, value: Values, source: str, parts: dict[str, float | str] | None = None) -> Driver:
    return _driver(name, lambda inputs: value(inputs)[:, None], 1, "line", source, parts or {})


def _centre(name: str, ranges: Mapping[str, tuple[float, float]]) -> dict[str, float | str]:
    """Where a product's first factor is zero, if that is not its own zero."""
    return {"centre": 0.5 * sum(ranges[name])} if name in ("temperature", "time") else {}


def _products(ranges: Mapping[str, tuple[float, float]]) -> list[Driver]:
    w, f = [f"w{axis}" for axis in "xyz"], [f"f{axis}" for axis in "xyz"]
    pairs = [*itertools.product(w, f), *itertools.product(("temperature", "time"), (*w, *f))]
    made = [
        _line(f"{a}*{b}", _product(_centred(a, ranges), SCALARS[b][1]), "motion", _centre(a, ranges))
        for a, b in pairs
        if a in ranges and b in ranges
    ]
    for a, (k, axis) in itertools.product(("temperature", "time"), enumerate(AXES)):
        if a in ranges and axis in ranges:
            made.append(_with_angle(a, _centred(a, ranges), k, axis, _centre(a, ranges)))
    return made


def _centred(name: str, ranges: Mapping[str, tuple[float, float]]) -> Values:
    """Temperature and time from the middle of their range: else a product with them is nearly its other factor."""
    value = SCALARS[name][1]
    if name not in ("temperature", "time"):
        return value
    middle = 0.5 * sum(ranges[name])
    return lambda inputs: value(inputs) - middle


def _with_angle(name: str, value: Values, k: int, axis: str, parts: dict[str, float | str]) -> Driver:

    def columns(inputs: Inputs) -> Array:
        angle = inputs.angles[:, k]
        return np.stack([value(inputs) * np.sin(angle), value(inputs) * np.cos(angle)], axis=1)

    return _driver(f"{name}*angle_{axis}", columns, 2, "fourier", "motion", {"order": 1.0, **parts})

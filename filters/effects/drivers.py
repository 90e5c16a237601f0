"""Causes that no catalogue names: free curves over anything that was logged, and chains of operators over it.

A driver is a quantity of `Inputs` in the unit it is reported in. A basis makes columns of it (`driver:NAME`), or a
chain of `operators` does (`cause:OPERATOR(NAME)`). One more chain is one more entry of `CHAINS`.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from filters.channels import DPS, G
from filters.effects.hypothesis import Hypothesis, Parameter, own_parameter
from filters.effects.inputs import FOLLOWED, SENSED, Inputs
from filters.effects.operators import OPERATORS, Values, hats, nested
from filters.effects.records import ShapeValue, number_of, numbers_of
from filters.errors import InputError
from filters.motion.segments import AXES
from filters.types import Array

_RELAY_K = 5.0  # range of temperature from which relays of it are tried
_REFRESHES = 3.0
SETTLING_TAUS = (2.0, 10.0, 40.0)
THRESHOLDS = 9
PAST_MOTION = ("settling", "direction", "turns", "since_motion", "table_accel")
"""Drivers that follow the table's past motion, which the filter does not have, as their names begin."""
_KNOTS = {"time": 9, "temperature": 8, "temperature_rate": 6, "since_motion": 6, "rate_norm": 6, "table_accel": 5}
_KNOTS_INPUT = 7
_FOURIER = (3, 6)
_LOGARITHMIC = ("since_motion",)

Value = Callable[[Inputs], Array]


def _unit(column: int) -> float:
    return G if FOLLOWED[column][0] == "f" else DPS


def _input(column: int) -> Value:
    return lambda inputs: inputs.x[:, column] / _unit(column)


def _slope(column: int) -> Value:
    return lambda inputs: inputs.x_dot[:, column] / _unit(column)


def _followed(column: int) -> Value:
    return lambda inputs: inputs.followed[:, column] / _unit(column)


def _product(a: Value, b: Value) -> Value:
    return lambda inputs: a(inputs) * b(inputs)


def _norm(inputs: Inputs) -> Array:
    return np.asarray(np.linalg.norm(inputs.x[:, :3], axis=1)) / DPS


SCALARS: dict[str, tuple[str, Value, str]] = {
    "time": ("s", lambda inputs: inputs.t, "time"),
    "temperature": ("degC", lambda inputs: inputs.temperature, "temperature"),
    "temperature_rate": ("K/s", lambda inputs: inputs.temperature_rate, "temperature"),
    "since_motion": ("s", lambda inputs: inputs.since_motion, "motion"),
    **{f"w{axis}": ("deg/s", _input(k), "motion") for k, axis in enumerate("xyz")},
    **{f"f{axis}": ("g", _input(3 + k), "motion") for k, axis in enumerate("xyz")},
    "rate_norm": ("deg/s", _norm, "motion"),
    "table_accel": ("deg/s2", lambda inputs: inputs.table_accel / DPS, "motion"),
}  # name to unit, value, and what it is a function of


SLOPES = {f"rate({name})": _slope(k) for k, name in enumerate(SENSED[:3])}
"""Angular accelerations: inputs by themselves, for they are taken where it is sensed."""

CHAINS: tuple[tuple[str, ...], ...] = (
    ("temperature", "relay"),
    ("temperature", "kink"),
    ("temperature", "hold"),
    ("temperature", "lag", "curve"),
    ("temperature", "lag", "relay"),
    ("temperature_rate", "relay"),
    ("time", "creep"),
    ("time", "power"),
    *((name, operator) for name in FOLLOWED for operator in ("lag", "play", "relay", "dead_zone")),
)
"""Inputs, and the operators over them, the innermost first."""

_SUFFIX = {"degC": "degc", "K/s": "k_per_s", "deg/s": "dps", "g": "g", "s": "s"}
_PER = {"degC": "/K", "K/s": "/(K/s)", "deg/s": "/(deg/s)", "g": "/g", "s": "/s"}


def _turns(axis: int) -> Value:
    return lambda inputs: inputs.angles[:, axis] / (2.0 * np.pi)


def _direction(axis: int) -> Value:
    return lambda inputs: inputs.direction[:, axis]


@dataclass(frozen=True, eq=False, kw_only=True)
class Driver(Hypothesis):
    """e = sum of θ_i B_i(driver): columns of a basis, the same for every channel, each in the channel's unit."""

    kind: str  # of the basis: hat, fourier, line, threshold, settling; of a chain the last operator
    knots: tuple[float, ...] = ()
    unit: str = ""
    chain: tuple[tuple[str, Values], ...] = ()  # operators, the innermost first, with their numbers
    value: Value | None = field(default=None, repr=False)  # what the first of them is given

    is_free: ClassVar = True

    @property
    def name(self) -> str:
        """Of the driver, or of the chain."""
        return self.effect.partition(":")[2]

    @property
    def label(self) -> str:
        details = [OPERATORS[name].detail.format(*values, u=self.unit) for name, values in self.chain]
        return super().label + "".join(details)

    @property
    def refines(self) -> bool:
        """Whether it is sought between the numbers of its grid: where a few seconds late is another effect."""
        return self.source == "temperature" and len(self.chain) == 1

    @property
    def in_filter(self) -> bool:
        """Whether the filter can have it from what it knows: not what remembers the table's motion."""
        return not self.name.startswith(PAST_MOTION)

    def blank(self) -> Array:
        return np.full((len(self.chain), 2), np.nan)

    def going_on(self, inputs: Inputs, channel: int, memory: Array) -> Array:
        if self.value is None:
            return super().going_on(inputs, channel, memory)
        made = self.value(inputs)
        for (name, values), own in zip(self.chain, memory, strict=True):
            made = OPERATORS[name].course(made, inputs.t, values, own)
        return made if made.ndim == 2 else made[:, None]

    def on(self, channel: int) -> "Driver":
        """The same on a channel."""
        has_unit = bool(self.chain) and all(OPERATORS[name].per for name, _ in self.chain)
        per = _PER[self.unit] if has_unit else ""
        own = _parameters(channel, len(self.parameters), self.knots, self.unit, per)
        return replace(self, channels=(channel,), parameters=own)


def _parameters(channel: int, count: int, knots: Sequence[float], unit: str, per: str = "") -> tuple[Parameter, ...]:
    """One for each column; any size is plausible where nothing is known."""
    names = [f"at {knot:.4g} {unit}" for knot in knots[1:]] or [f"b{k + 1}" for k in range(count)]
    return tuple(own_parameter(channel, name if count > 1 or knots else "k", per, 1.0, 10.0) for name in names)


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
        at_blocks=kind == "settling" or name.startswith(("since", "direction")),
        kind=kind,
        knots=knots,
        unit=unit,
    )


def bases(ranges: Mapping[str, tuple[float, float]]) -> list[Driver]:
    """All bases that the data can carry.

    `ranges`: least and greatest value of each scalar driver over all runs, and of "outer", "middle", "inner" (rad);
      those that do not vary are missing.
    """
    made = [_hat(name, *ranges[name]) for name in SCALARS if name in ranges]
    if "temperature" in ranges:
        made += _thresholds(*ranges["temperature"])
    for k, axis in enumerate(AXES):
        if axis in ranges:
            made += _of_axis(k, axis, ranges[axis])
    made += [_line(name, value, "motion", cause=True) for name, value in SLOPES.items() if name[5:-1] in ranges]
    return made + _products(ranges) + [c for of in CHAINS for c in _chains(of, ranges)]


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


def _chains(of: Sequence[str], ranges: Mapping[str, tuple[float, float]]) -> list[Driver]:
    """A chain of operators with all numbers that are tried."""
    source, *operators = of
    if source not in ranges or (source in FOLLOWED and "since_motion" not in ranges):
        return []
    low, high = ranges[source]
    if source == "temperature" and "relay" in operators and high - low < _RELAY_K:
        return []
    close = list(of) == ["temperature", "relay"]  # whose levels are what units do by themselves
    grids = [OPERATORS[name].grid(low, high, close) for name in operators]
    if operators == ["hold"]:  # what is refreshed once or twice is what it was at the start
        grids = [[own for own in grids[0] if own[0] < ranges.get("time", (0.0, 0.0))[1] / _REFRESHES]]
    numbers = list(itertools.product(*grids))
    # of motion every input is tried, and which of them it is was chosen too
    choices = len(numbers) * (len(FOLLOWED) if source in FOLLOWED else 1)
    return [chain(source, operators, values, choices) for values in numbers]


def chain(source: str, operators: Sequence[str], numbers: Sequence[Values], choices: int = 1) -> Driver:
    """A chain of operators over an input, the innermost first, with their numbers, on channel 0."""
    unit, value, kind = SCALARS[source]
    known = [OPERATORS[name] for name in operators]
    remembers = any(operator.remembers for operator in known)
    if remembers and source in FOLLOWED:
        value = _followed(FOLLOWED.index(source))
    suffix = _SUFFIX[unit]
    knots = numbers[-1] if operators[-1] == "curve" else ()
    shape: dict[str, float | str] = {
        key.format(suffix): number
        for operator, own in zip(known, numbers, strict=True)
        for key, number in zip(operator.parameters, own, strict=False)
    }

    def fresh(inputs: Inputs, channel: int) -> Array:
        return made.going_on(inputs, channel, made.blank())

    count = max(1, len(knots) - 1)
    made = Driver(
        effect=f"cause:{nested(operators, source)}",
        channels=(0,),
        source=kind,
        parameters=_parameters(0, count, knots, unit),
        columns=fresh,
        shape=shape,
        grid=choices,
        over=() if remembers or kind == "motion" else (source,),
        at_blocks=remembers and kind == "motion",
        kind=operators[-1],
        knots=knots,
        unit=unit,
        chain=tuple(zip(operators, numbers, strict=True)),
        value=value,
    )
    return made


def near(h: Driver, grid: Sequence[Driver], share: float) -> list[Driver]:
    """A chain and others whose numbers are up to two steps away, each a share of the spacing of a grid's.

    `grid`: the same chain with other numbers.
    """
    ((name, own),) = h.chain
    every = np.array([other.chain[0][1] for other in grid])
    tried = []
    for x, column in zip(own, every.T, strict=True):
        at = np.unique(column)
        place = int(np.clip(np.searchsorted(at, x), 1, at.size - 1))
        step = share * float(at[place] - at[place - 1])
        tried.append([x + side * step for side in (-2, -1, 0, 1, 2)])
    source = h.name.removeprefix(f"{name}(")[:-1]
    return [chain(source, [name], [own], h.grid) for own in itertools.product(*tried) if list(own) == sorted(set(own))]


def chain_of(name: str, shape: Mapping[str, ShapeValue]) -> Driver:
    """A chain from its name and shape, as a trace wrote them: the numbers of its operators, and a curve's knots.

    Raises InputError if there is no such chain, or a number is missing or not possible.
    """
    if name in SLOPES:
        return _line(name, SLOPES[name], "motion", cause=True)
    known = next((of for of in CHAINS if nested(of[1:], of[0]) == name), None)
    if known is None:
        names = ", ".join(sorted({operator for _, *rest in CHAINS for operator in rest}))
        raise InputError(f'`effect` is "cause:{name}", which is no chain that is known; operators are {names}')
    source, *operators = known
    suffix = _SUFFIX[SCALARS[source][0]]
    numbers: list[Values] = [
        tuple(number_of(shape, key.format(suffix)) for key in OPERATORS[operator].parameters)
        if operator != "curve"
        else tuple(numbers_of(shape, "knots"))
        for operator in operators
    ]
    for operator, own in zip(operators, numbers, strict=True):
        if len(own) == 1 and not (own[0] > 0.0 or OPERATORS[operator].signed):
            raise InputError(f'the number of {operator} in "cause:{name}" is {own[0]:g}, not above zero')
        if list(own) != sorted(set(own)) or (operator == "curve" and len(own) < 2):
            raise InputError(f'the numbers of {operator} in "cause:{name}" are {list(own)}, not two or more that rise')
    return chain(source, operators, numbers)


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


def _line(
    name: str, value: Value, source: str, parts: dict[str, float | str] | None = None, *, cause: bool = False
) -> Driver:
    made = _driver(name, lambda inputs: value(inputs)[:, None], 1, "line", source, parts or {})
    return replace(made, effect=f"cause:{name}", grid=len(SLOPES)) if cause else made


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
    return [replace(product, grid=len(made)) for product in made]  # which of them it is was chosen


def _centred(name: str, ranges: Mapping[str, tuple[float, float]]) -> Value:
    """Temperature and time from the middle of their range: else a product with them is nearly its other factor."""
    value = SCALARS[name][1]
    if name not in ("temperature", "time"):
        return value
    middle = 0.5 * sum(ranges[name])
    return lambda inputs: value(inputs) - middle


def _with_angle(name: str, value: Value, k: int, axis: str, parts: dict[str, float | str]) -> Driver:

    def columns(inputs: Inputs) -> Array:
        angle = inputs.angles[:, k]
        return np.stack([value(inputs) * np.sin(angle), value(inputs) * np.cos(angle)], axis=1)

    return _driver(f"{name}*angle_{axis}", columns, 2, "fourier", "motion", {"order": 1.0, **parts})

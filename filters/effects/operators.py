"""Operators that a cause is a chain of: each makes one course in time of another, from the past alone.

A chain over an input is an effect without a name in the catalogue, `cause:OPERATOR(INPUT)`: "relay(temperature)",
"curve(lag(temperature))". An operator's numbers are in the unit of the chain's input, and its memory is two numbers,
not a number before anything is known: so it goes on over gaps, parts of a power-on and samples that come one by one.
"""

import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from filters.compilation import cached_njit
from filters.types import Array

Values = tuple[float, ...]
Course = Callable[[Array, Array, Values, Array], Array]
"""What an operator makes of u, shape (n,), at instants, s, shape (n,), with its numbers and its memory, shape (2,)."""


@dataclass(frozen=True, slots=True)
class Operator:
    """One operator."""

    course: Course
    # what its numbers are called in a file, the unit of the input in the place of {}
    parameters: tuple[str, ...]
    detail: str  # what a sentence says of its numbers, in the unit {u}
    # numbers that are tried, from the least and greatest value of the input, and whether they are to be close together
    grid: Callable[[float, float, bool], Sequence[Values]]
    remembers: bool  # whether it depends on the past
    per: bool = True  # whether what it makes has the input's unit
    signed: bool = False  # whether its number may be zero or less


# -------------------------------------------------------------------------------------------------------- with memory


def _lag(u: Array, t: Array, values: Values, memory: Array) -> Array:
    out = np.empty(u.size)
    cached_njit(_lagged)(np.ascontiguousarray(u), t, values[0], memory, out)
    return out


def _lagged(u, t, tau, memory, out):  # type: ignore[no-untyped-def]
    """First-order lag that begins in equality; `memory`: its value and when it was."""
    for k in range(u.size):
        if np.isnan(memory[0]):
            memory[0] = u[k]
        else:
            memory[0] += (1.0 - np.exp(-(t[k] - memory[1]) / tau)) * (u[k] - memory[0])
        memory[1] = t[k]
        out[k] = memory[0]


def _play(u: Array, t: Array, values: Values, memory: Array) -> Array:
    out = np.empty(u.size)
    cached_njit(_played)(np.ascontiguousarray(u), 0.5 * values[0], memory, out)
    return out


def _played(u, half, memory, out):  # type: ignore[no-untyped-def]
    """Play: follows u when it is half a width away; `memory`: where it is."""
    if np.isnan(memory[0]) and u.size:
        memory[0] = u[0]
    for k in range(u.size):
        memory[0] = min(max(memory[0], u[k] - half), u[k] + half)
        out[k] = memory[0]


def _relay(u: Array, t: Array, values: Values, memory: Array) -> Array:
    """1 since u was last above `up`, 0 since it was last below `down`; before, as if it came from the middle."""
    down, up = values
    known = np.where(u > up, 1.0, np.where(u < down, 0.0, np.nan))
    if np.isnan(memory[0]) and u.size:
        memory[0] = float(u[0] > 0.5 * (down + up))
    return _kept(known, memory)


def _hold(u: Array, t: Array, values: Values, memory: Array) -> Array:
    """What u was at the last multiple of a period since power-on, less what it is; `memory`: it, and the multiple."""
    number = np.floor(t / values[0])
    new = number != np.append(memory[1], number[:-1])
    memory[1] = number[-1] if number.size else memory[1]
    return _kept(np.where(new, u, np.nan), memory) - u


def _kept(known: Array, memory: Array) -> Array:
    """Each value kept until the next that is known; `memory`: the last one."""
    last = np.maximum.accumulate(np.where(np.isnan(known), -1, np.arange(known.size)))
    out = np.where(last >= 0, known[np.maximum(last, 0)], memory[0])
    if out.size:
        memory[0] = out[-1]
    return np.asarray(out)


# ------------------------------------------------------------------------------------------------------------- static


def _kink(u: Array, t: Array, values: Values, memory: Array) -> Array:
    return np.maximum(u - values[0], 0.0)


def _dead_zone(u: Array, t: Array, values: Values, memory: Array) -> Array:
    return u - np.clip(u, -values[0], values[0])


def _creep(u: Array, t: Array, values: Values, memory: Array) -> Array:
    return np.log1p(np.maximum(u, 0.0) / values[0])


def _power(u: Array, t: Array, values: Values, memory: Array) -> Array:
    return np.asarray((np.maximum(u, 0.0) / 100.0) ** values[0])


def hats(values: Array, knots: Array) -> Array:
    """Hat functions on the knots but the first (their sum is a constant, which is the bias); shape (n, K - 1)."""
    place = np.clip(np.interp(values, knots, np.arange(knots.size)), 0.0, knots.size - 1.0)
    return np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(1, knots.size)))


def _curve(u: Array, t: Array, values: Values, memory: Array) -> Array:
    return hats(u, np.array(values))


# -------------------------------------------------------------------------------------------------------------- grids

RELAY_LEVELS = (6, 25)  # values between which a relay may flip, far apart and close together
KNEES = 10
CURVE_KNOTS = 8


def _each(*values: float) -> Callable[[float, float, bool], list[Values]]:
    return lambda low, high, close: [(value,) for value in values]


def _shares(*shares: float) -> Callable[[float, float, bool], list[Values]]:
    return lambda low, high, close: [(share * (high - low),) for share in shares]


def _pairs(low: float, high: float, close: bool) -> list[Values]:
    at = np.linspace(low, high, RELAY_LEVELS[close] + 2)[1:-1].tolist()
    return list(itertools.combinations(at, 2))


def _inner(low: float, high: float, close: bool) -> list[Values]:
    # near an end of the range what has a knee is a slope, or nothing
    return [(float(knee),) for knee in np.linspace(low, high, KNEES + 6)[3:-3]]


def _knots(low: float, high: float, close: bool) -> list[Values]:
    return [tuple(np.linspace(low, high, CURVE_KNOTS).tolist())]


OPERATORS: dict[str, Operator] = {
    "lag": Operator(_lag, ("tau_s",), ", {0:g} s", _each(10.0, 40.0, 160.0), remembers=True),
    "play": Operator(_play, ("width_{}",), ", {0:.3g} {u} wide", _shares(0.15, 0.4, 0.7), remembers=True),
    "relay": Operator(
        _relay, ("down_{}", "up_{}"), ", up at {1:.3g} {u}, down at {0:.3g} {u}", _pairs, remembers=True, per=False
    ),
    "hold": Operator(
        _hold, ("period_s",), ", every {0:.3g} s", _each(*(10.0 * 1.15**k for k in range(30))), remembers=True
    ),
    "kink": Operator(_kink, ("knee_{}",), ", {0:.3g} {u}", _inner, remembers=False, signed=True),
    "dead_zone": Operator(_dead_zone, ("limit_{}",), ", {0:.3g} {u}", _shares(0.05, 0.15, 0.3), remembers=False),
    "creep": Operator(
        _creep, ("tau_s",), ", as ln(1 + t / {0:g} s)", _each(1.0, 3.0, 10.0, 30.0, 100.0, 300.0), remembers=False,
        per=False,
    ),
    "power": Operator(_power, ("power",), ", as t^{0:g}", _each(0.2, 0.35, 0.5, 0.7), remembers=False, per=False),
    "curve": Operator(_curve, (), "", _knots, remembers=False, per=False),
}  # fmt: skip


def nested(operators: Sequence[str], of: str) -> str:
    """Name of a chain: the first operator is the innermost."""
    return functools.reduce(lambda name, operator: f"{operator}({name})", operators, of)

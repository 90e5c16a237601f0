"""Records of effects that join the filter, as a trace finds them and files keep them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeGuard

from filters.errors import InputError

ShapeValue = float | str | list[float]  # what fixes an effect's shape: a number, a word, or knots


@dataclass(frozen=True)
class State:
    """One extra state of the filter."""

    # name, unit: of the parameter, as reported
    name: str
    unit: str
    # mean, sd: in that unit
    mean: float
    sd: float
    tau_s: float = float("inf")  # time constant, infinity for a constant
    q: float = 0.0  # noise density, unit/√s


@dataclass(frozen=True)
class Included:
    """An effect that joins the filter."""

    effect: str  # name in the catalogue, or driver:NAME
    channels: tuple[str, ...]  # which it acts on, instrument axes
    include_as: str  # a extra constant states, S stochastic states, N noise, P pre-filter
    # what fixes its shape, SI or as named: time constants, knots, …
    parameters: dict[str, ShapeValue] = field(default_factory=dict)
    states: tuple[State, ...] = ()  # in order

    def number(self, name: str, default: float | None = None) -> float:
        """A parameter that is a number; InputError if it is none."""
        return number_of(self.parameters, name, default)

    def numbers(self, name: str) -> list[float]:
        """A parameter that is a list of numbers; InputError if it is none."""
        return numbers_of(self.parameters, name)


def number_of(shape: Mapping[str, ShapeValue], name: str, default: float | None = None) -> float:
    """A number among what fixes a shape.

    Raises InputError if it is missing and has no default, or is no number.
    """
    value = shape.get(name, default)
    if not _is_number(value):
        raise InputError(f"`{name}` is {value!r}, not a number")
    return float(value)


def numbers_of(shape: Mapping[str, ShapeValue], name: str) -> list[float]:
    """A list of numbers among what fixes a shape.

    Raises InputError if it is missing, or is no list.
    """
    value = shape.get(name)
    if not isinstance(value, list) or not all(_is_number(x) for x in value):
        raise InputError(f"`{name}` is {value!r}, not a list of numbers")
    return [float(x) for x in value]


def _is_number(value: object) -> TypeGuard[int | float]:
    """Whether a value is a number that may be one of a shape; a whole number may be longer than a float takes."""
    return isinstance(value, int | float) and -_LARGEST < value < _LARGEST


_LARGEST = 1e30

"""A correction of readings that is a matrix, a bias and powers of temperature: what it is made of.

A unit reads

    reading = true + bias + A true + Σ_n K_n (T - T0)^n

so that what it should have read is

    corrected = M (reading - bias - Σ_n K_n (T - T0)^n),  M = (I + A)⁻¹

A filter that does not know what the unit senses takes A of the reading instead. Its biases belong to

    corrected = reading - bias - A reading - Σ_n K_n (T - T0)^n

gx, gy, gz in deg/s, ax, ay, az in g, in the unit's own axes and sign.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from filters.channels import CHANNELS
from filters.effects import plain_names
from filters.effects.records import Included
from filters.errors import InputError
from filters.types import Array
from imutui.estimates import EffectField
from imutui.logbook import effects_file

# --------------------------------------------------------------------------------------------------- correction terms
# What corrects a reading beside its constant bias: states of effects, from an effects file or a replay's result.


@dataclass(frozen=True, slots=True)
class Term:
    """A state of an effect."""

    channels: tuple[str, ...]  # which it acts on, instrument axes
    effect: str  # name in the catalogue, or driver:NAME
    # state, unit: of the parameter
    state: str
    unit: str
    value: float  # in that unit


def of_effects_file(text: str) -> tuple[Term, ...]:
    """Terms of an effects file; none of an empty text.

    Raises InputError if it is no effects file.
    """
    if not text:
        return ()
    return of_effects(effects_file.parse(text.encode()).effects)


def of_effects(effects: Iterable[Included]) -> tuple[Term, ...]:
    """Terms of effects, one a state."""
    return tuple(
        Term(effect.channels, effect.effect, state.name, state.unit, state.mean)
        for effect in effects
        for state in effect.states
    )


def of_states(states: Sequence[EffectField]) -> tuple[Term, ...]:
    """Terms of a result's states, "gy thermal_lin k (deg/s/K)"; of no channel where a name does not read so."""
    return tuple(_of_state(state) for state in states)


def _of_state(state: EffectField) -> Term:
    words, _, unit = state["name"].removesuffix(")").partition(" (")
    channels, _, rest = words.partition(" ")
    effect, _, name = rest.rpartition(" ")
    known = tuple(channels.split("/"))
    if not effect or not set(known) <= set(CHANNELS):
        return Term((), state["name"], "", "", state["value"])
    return Term(known, effect, name, unit, state["value"])


# -------------------------------------------------------------------------------------------------- linear correction

_MG = 1e-3
_POWERS = {"k": 1, "k1": 1, "k2": 2, "k3": 3}
_ORDERS = 3
_AXES = "xyz"
_MOST_CONDITION = 1e6


@dataclass(frozen=True, slots=True)
class LinearCorrection:
    """A correction of the six readings."""

    bias: Array  # deg/s and g, shape (6,); zero where none is known
    by_reading: Array  # A, per deg/s or g on each channel, shape (6, 6)
    by_temperature: Array  # K_1 to K_3, per K, K² and K³ from `filters.effects.inputs.REFERENCE_DEGC` on, shape (3, 6)
    left_out: tuple[str, ...]  # effects that take more than a reading and its temperature, in words
    of_reading: bool = False  # whether A was taken of the reading, by a filter that did not know what is sensed

    @property
    def orders(self) -> int:
        """Powers of temperature in it."""
        used = np.flatnonzero(self.by_temperature.any(axis=1))
        return int(used[-1]) + 1 if used.size else 0

    @property
    def matrix(self) -> Array:
        """M, shape (6, 6)."""
        return np.asarray(np.linalg.inv(np.eye(6) + self.by_reading))


def of_terms(bias: Sequence[float | None], terms: Sequence[Term], *, of_reading: bool = False) -> LinearCorrection:
    """Correction of constant biases and of effects.

    `bias`: gyros in deg/s, accelerometers in mg; None counts as zero.
    Raises InputError if two readings of the unit would be alike whatever it senses, so that I + A has no inverse.
    """
    made = np.array([0.0 if b is None else b for b in bias], float)
    made[3:] *= _MG
    A, K = np.zeros((6, 6)), np.zeros((_ORDERS, 6))
    left_out: dict[str, None] = {}
    for term in terms:
        for name in term.channels or ("",):
            if not _take(term, name, made, A, K):
                words = plain_names.on_channels(term.effect, term.channels) if term.channels else term.effect
                left_out[words] = None
    if np.linalg.cond(np.eye(6) + A) > _MOST_CONDITION:
        raise InputError("its scale factors and cross-axis terms leave no reading to correct: look at their values")
    return LinearCorrection(made, A, K, tuple(left_out), of_reading)


def _take(term: Term, channel: str, bias: Array, A: Array, K: Array) -> bool:
    """Add a term on a channel; False if it is none of these."""
    if channel not in CHANNELS:
        return False
    c = CHANNELS.index(channel)
    value = term.value * (_MG if term.unit.startswith("mg") else 1.0)
    match term.effect:
        case "bias":
            bias[c] += value
        case "thermal_lin" | "thermal_poly" if term.state in _POWERS:
            K[_POWERS[term.state] - 1, c] += value
        case "scale":
            A[c, c] += value
        case "cross_axis" if term.state in _AXES:
            A[c, c // 3 * 3 + _AXES.index(term.state)] += value
        case "g_sensitivity" if term.state in _AXES:
            A[c, 3 + _AXES.index(term.state)] += value
        case _:
            return False
    return True

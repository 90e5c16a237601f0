"""What corrects a reading beside its constant bias: states of effects, from an effects file or a replay's result."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from filters.effects.records import Included
from filters.imu import CHANNELS
from imutui.logbook import effects_file
from imutui.logbook.results import EffectField


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

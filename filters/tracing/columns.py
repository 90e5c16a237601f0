"""Columns of the design matrix: which hypotheses the runs can carry, and their regressors averaged over blocks."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS
from filters.effects import deterministic, drivers
from filters.effects.hypothesis import Hypothesis
from filters.effects.inputs import SENSED, Inputs
from filters.motion.segments import AXES
from filters.tracing.stack import Stack
from filters.types import Array

WIDE_K = 20.0  # range of temperature from which long lags and wide plays are tried, K
_AT_ONCE = 1 << 14
_RELAY_ROWS = 1 << 16
"""Rows up to which flips between two temperatures are tried: there are hundreds of pairs, each with a column."""


Key = tuple[str, tuple[int, ...], str]
Maker = tuple[Hypothesis, int, slice]  # a hypothesis, a channel, and the places of its columns there


@dataclass(frozen=True)
class Term:
    """A hypothesis with its columns in the design: for each of its channels, their numbers."""

    hypothesis: Hypothesis
    places: dict[int, NDArray[np.int_]]

    @property
    def size(self) -> int:
        """How many parameters it has: k."""
        return next(iter(self.places.values())).size

    @property
    def key(self) -> Key:
        """Its hypothesis': equal for the same one, whatever the data."""
        return self.hypothesis.key


def columns_of_all(stack: Stack) -> tuple[Array, list[Term]]:
    """Columns of all hypotheses that vary, over all runs, shape (n, K), and the terms that say where they are."""
    ranges = _ranges(stack)
    seconds = float((stack.t - stack.t[stack.begins][stack.power_on]).max())
    from_s = min(b.run.begins for b in stack.blocks)
    makers: list[Maker] = []
    terms: list[Term] = []

    def put(h: Hypothesis, channel: int) -> NDArray[np.int_]:
        first = makers[-1][2].stop if makers else 0
        makers.append((h, channel, slice(first, first + len(h.parameters))))
        return np.arange(first, first + len(h.parameters))

    kept: dict[object, NDArray[np.int_]] = {}
    for c in range(len(CHANNELS)):
        for h in (*deterministic.of_sensor(c, from_s), *deterministic.harmonics(c)):
            if not _has(h, ranges, seconds):
                continue
            key = (h.effect, str(h.shape), -1 if h.is_everywhere else c)
            if key not in kept:
                kept[key] = put(h, c)
            terms.append(Term(h, {c: kept[key]}))
    for driver in drivers.bases(ranges):
        if driver.kind == "relay" and stack.t.size > _RELAY_ROWS:
            continue
        places = put(driver, 0)
        terms += [Term(driver.on(c), {c: places}) for c in range(len(CHANNELS)) if not _twin(driver.name, c)]
    if any(not b.run.still for b in stack.blocks) or len(stack.blocks) > 1:
        terms += [Term(s, {c: put(s, c) for c in s.channels}) for s in deterministic.shared()]
    return _filled(stack, makers), terms


ColumnsByTerm = dict[tuple[object, int], Array]  # columns of terms on a stack, by term's key and channel, shape (n, k)


def columns_on(stack: Stack, terms: Sequence[Term]) -> ColumnsByTerm:
    """Columns of hypotheses on another stack than that of their design."""
    wanted = [(a, c) for a in terms for c in a.places]
    ends = np.cumsum([0, *(a.size for a, _ in wanted)]).tolist()
    made = [(a.hypothesis, c, slice(*at)) for (a, c), at in zip(wanted, itertools.pairwise(ends), strict=True)]
    values = _filled(stack, made)
    return {(a.key, c): values[:, place] for (a, c), (*_, place) in zip(wanted, made, strict=True)}


def _on(h: Hypothesis, channel: int) -> Callable[[Inputs], Array]:
    return lambda inputs: h.columns(inputs, channel)


def _filled(stack: Stack, makers: Sequence[Maker]) -> Array:
    """Columns of hypotheses on channels at their places, over all runs, 0 where there is none; shape (n, K)."""
    out = np.zeros((stack.t.size, makers[-1][2].stop if makers else 0))
    memories: dict[tuple[object, object], Array] = {}  # what parts of a power-on hand on to the next
    fast = [(_on(h, c), place) for h, c, place in makers if not h.is_slow]
    for start, blocks in zip(stack.starts.tolist(), stack.blocks, strict=True):
        rows = slice(start, start + blocks.t.size)
        at_rest, power_on = blocks.slow(), blocks.run.power_on or start
        for h, c, place in makers:
            if h.is_slow:
                memory = memories.setdefault((h.key, power_on), h.blank())
                out[rows, place] = h.going_on(at_rest, c, memory)
        if fast:
            blocks.mean(fast, out[rows])
    # in parts: what it makes by the way is as large as what it is given
    for first in range(0, len(out), _AT_ONCE):
        np.nan_to_num(out[first : first + _AT_ONCE], copy=False)
    return out


def _has(h: Hypothesis, ranges: dict[str, tuple[float, float]], seconds: float) -> bool:
    """Whether what an effect is a function of is there and varies, over power-ons of at most so many seconds."""
    if h.is_wide:
        low, high = ranges.get("temperature", (0.0, 0.0))
        if high - low < WIDE_K or float(h.shape.get("tau_s", 0.0)) > seconds:
            return False
    if h.source == "time":
        # settling that takes longer than the record is a ramp
        return float(h.shape.get("tau_s", 0.0)) <= ranges.get("time", (0.0, 0.0))[1]
    return all(name in ranges for name in h.needs) if h.needs else any(name in ranges for name in SENSED)


def _twin(name: str, channel: int) -> bool:
    """Whether a product is in the catalogue under another name: x (T - T0)."""
    return name == f"temperature*{SENSED[channel]}"


def _ranges(stack: Stack) -> dict[str, tuple[float, float]]:
    """Least and greatest value of the scalar drivers and of the table's angles, where they vary."""
    names = [*drivers.SCALARS, *AXES]

    def scalars(inputs: Inputs) -> Array:
        return np.column_stack([*(value(inputs) for _, value, _ in drivers.SCALARS.values()), inputs.angles])

    values = np.empty((stack.t.size, len(names)))
    for start, blocks in zip(stack.starts.tolist(), stack.blocks, strict=True):
        blocks.mean([(scalars, slice(None))], values[start : start + blocks.t.size])
    out = {}
    for k, name in enumerate(names):
        own = values[:, k]
        if not np.isfinite(own).all():
            continue
        # what differs from power-on to power-on only is their biases
        within = max(float(np.ptp(part)) for part in np.split(own, stack.begins[1:]))
        low, high = float(own.min()), float(own.max())
        if within > 1e-6 * max(1.0, abs(high), abs(low)):
            out[name] = (low, high)
    if all(b.run.still for b in stack.blocks):
        out.pop("since_motion", None)  # it is time then
    # a unit at rest senses Earth rate only
    return {n: r for n, r in out.items() if n[0] != "w" or r[1] - r[0] > 0.02}

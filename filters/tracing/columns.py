"""Columns of the design matrix: which hypotheses the runs can carry, and their regressors averaged over blocks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS
from filters.effects import additive, drivers, reference_errors
from filters.effects.additive import Hysteresis, ThermalLag
from filters.effects.hypothesis import Hypothesis
from filters.effects.inputs import SENSED, Inputs
from filters.motion.segments import AXES
from filters.tracing.stack import Stack
from filters.types import Array

WIDE_K = 20.0
"""Range of temperature from which long lags and wide plays are tried, K."""
_AT_ONCE = 1 << 14
_RELAY_ROWS = 1 << 16
"""Rows up to which flips between two temperatures are tried: there are hundreds of pairs, each with a column."""


@dataclass(frozen=True)
class Term:
    """A hypothesis with its columns in the design: for each of its channels, their numbers."""

    hypothesis: Hypothesis
    places: dict[int, NDArray[np.int_]]

    @property
    def size(self) -> int:
        """How many parameters it has: k."""
        return next(iter(self.places.values())).size

    @cached_property
    def key(self) -> tuple[str, tuple[int, ...], str]:
        """Effect, channels and shape: equal for the same hypothesis, whatever the data."""
        h = self.hypothesis
        return h.effect, h.channels, str(sorted(h.shape().items()))


def columns_of_all(stack: Stack) -> tuple[Array, list[Term]]:
    """Columns of all hypotheses that vary, over all runs, shape (n, K), and the terms that say where they are."""
    ranges = _ranges(stack)
    seconds = float((stack.t - stack.t[stack.begins][stack.power_on]).max())
    makers: list[tuple[bool, Callable[[Inputs], Array], int]] = []
    terms: list[Term] = []
    width = 0

    def put(slow: bool, columns: Callable[[Inputs], Array], count: int) -> NDArray[np.int_]:
        nonlocal width
        makers.append((slow, columns, count))
        width += count
        return np.arange(width - count, width)

    # what is a function of time or temperature is the same on every channel
    kept: dict[object, NDArray[np.int_]] = {}
    for c in range(len(CHANNELS)):
        for h in (*additive.hypotheses(c), *reference_errors.harmonics(c)):
            if not _has(h, ranges, seconds):
                continue
            alike = h.source != "motion" or h.effect in ("harmonic", "g_squared", "g_sensitivity")
            key = (h.effect, str(h.shape())) if alike else (h.effect, c, str(h.shape()))
            if key not in kept:
                kept[key] = put(is_slow(h), _bound(h, c), len(h.parameters()))
            terms.append(Term(h, {c: kept[key]}))
    for basis in drivers.bases(ranges):
        if basis.kind == "relay" and stack.t.size > _RELAY_ROWS:
            continue
        places = put(is_slow(basis.on(0)), basis.columns_of, basis.count)
        terms += [Term(basis.on(c), {c: places}) for c in range(len(CHANNELS)) if not _twin(basis.name, c)]
    if any(not b.run.still for b in stack.blocks) or len(stack.blocks) > 1:
        for s in reference_errors.shared():
            terms.append(Term(s, {c: put(False, _bound(s, c), len(s.parameters())) for c in s.channels}))
    return _filled(stack, makers, width), terms


ColumnsByTerm = dict[tuple[object, int], Array]
"""Columns of terms on a stack, by term's key and channel, shape (n, k)."""


def columns_on(stack: Stack, terms: Sequence[Term]) -> ColumnsByTerm:
    """Columns of hypotheses on another stack than that of their design."""
    wanted = [(a, c) for a in terms for c in a.places]
    out: ColumnsByTerm = {}
    places = np.concatenate([[0], np.cumsum([a.size for a, _ in wanted])]).astype(int)
    fast = [
        (_bound(a.hypothesis, c), slice(places[k], places[k + 1]))
        for k, (a, c) in enumerate(wanted)
        if not is_slow(a.hypothesis)
    ]
    values = np.empty((stack.t.size, int(places[-1])))
    for start, blocks in zip(stack.starts.tolist(), stack.blocks, strict=True):
        rows = slice(start, start + blocks.t.size)
        if fast:
            blocks.mean(fast, values[rows])
        for k, (a, c) in enumerate(wanted):
            if is_slow(a.hypothesis):
                values[rows, places[k] : places[k + 1]] = a.hypothesis.columns(blocks.slow(), c)
    for k, (a, c) in enumerate(wanted):
        out[a.key, c] = np.nan_to_num(values[:, places[k] : places[k + 1]])
    return out


def is_slow(h: Hypothesis) -> bool:
    """Whether a hypothesis is a function of what `Blocks.slow` has: time, temperature, what follows motion."""
    if isinstance(h, drivers.Driver) and h.kind == "trail":
        return True
    return h.source != "motion" or h.effect.startswith(("driver:since", "driver:settling", "driver:direction"))


def _bound(h: Hypothesis, channel: int) -> Callable[[Inputs], Array]:
    return lambda inputs: h.columns(inputs, channel)


def _filled(stack: Stack, makers: list[tuple[bool, Callable[[Inputs], Array], int]], width: int) -> Array:
    out = np.zeros((stack.t.size, width))
    places = np.concatenate([[0], np.cumsum([count for *_, count in makers])]).astype(int)
    fast = [(f, slice(places[i], places[i + 1])) for i, (slow, f, _) in enumerate(makers) if not slow]
    for start, blocks in zip(stack.starts.tolist(), stack.blocks, strict=True):
        rows = slice(start, start + blocks.t.size)
        at_rest = blocks.slow()
        for i, (slow, f, _) in enumerate(makers):
            if slow:
                out[rows, places[i] : places[i + 1]] = f(at_rest)
        blocks.mean(fast, out[rows])
    # in parts: what it makes by the way is as large as what it is given
    for first in range(0, len(out), _AT_ONCE):
        np.nan_to_num(out[first : first + _AT_ONCE], copy=False)
    return out


def _has(h: Hypothesis, ranges: dict[str, tuple[float, float]], seconds: float) -> bool:
    """Whether what an effect is a function of is there and varies, over power-ons of at most so many seconds."""
    if isinstance(h, ThermalLag | Hysteresis) and h.is_wide:
        low, high = ranges.get("temperature", (0.0, 0.0))
        if high - low < WIDE_K or float(h.shape().get("tau_s", 0.0)) > seconds:
            return False
    if isinstance(h, additive.Warmup):
        # longer than the record it is a ramp
        return h.tau <= ranges.get("time", (0.0, 0.0))[1]
    if h.effect == "thermal_scale":
        # of an input that never varies it is a bias that follows temperature
        return "temperature" in ranges and SENSED[h.channels[0]] in ranges
    if h.source == "temperature":
        return "temperature" in ranges
    if h.effect == "harmonic":
        return str(h.shape()["axis"]) in ranges
    return h.source == "time" or any(name in ranges for name in SENSED)


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

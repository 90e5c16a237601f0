"""What one channel's readings are made of: the steps they come in, and the size of their fast noise."""

import math

import numpy as np
from numpy.typing import NDArray

from filters.types import Array

_MOST = 1 << 16
# single precision of the source leaves values this far from where they were, as a part of them
_SINGLE = 4e-7
_DOUBLE = 1e-12  # the same of differences in double precision, as a part of the largest
_NEAR, _WITHIN, _MOST_ON = 0.1, 20.0, 0.97
_QUANTILES = (0.5, 0.25, 0.1, 0.03)

# rms of the smallest 90 % of normal deviates, squared
KEPT = 0.9
KEPT_VARIANCE = 0.623
_WINDOW_S = 2.0
LEAST_WINDOW = 32  # samples: of fewer, noise is not told

_MOST_WINDOW = 1024
_AT_ONCE = 1 << 18


def lattice(x: Array, lsb: float | None = None) -> float:
    """Step between the values that readings come in; 0 where they show none.

    Sorted distinct values of a lattice are whole multiples of one step apart. A lattice that went through counts of
    `lsb` has each value off by up to half of one.

    `x`: readings, shape (N,); of many, some 65 000 are looked at.
    `lsb`: size of a count, unit of x.
    Returns unit of x.
    """
    some = x[:: max(1, x.size // _MOST)]
    if not some.size:
        return 0.0
    values = np.unique(some)
    steps = np.diff(values)
    steps = steps[steps > rounding(values[1:], values[:-1])]
    for q in _QUANTILES if steps.size else ():
        step = _refined(steps, float(np.quantile(steps, q)))
        near = _NEAR + (min(lsb / step, 0.25) if lsb is not None else 0.0)
        ratio = steps[steps < _WITHIN * step] / step
        if 2 * ratio.size >= steps.size and np.mean(np.abs(ratio - np.rint(ratio)) < near) >= _MOST_ON:
            return step
    return 0.0


def rounding(a: Array, b: Array) -> Array:
    """Differences of readings, shape (...), that the arithmetic of their source leaves between equal ones."""
    size = np.maximum(np.abs(a), np.abs(b))
    return np.asarray(np.maximum(_SINGLE * size, _DOUBLE * size.max(initial=0.0)))


def _refined(steps: Array, step: float) -> float:
    """The step that the near multiples of a first guess have in common."""
    few = steps[(steps > 0.5 * step) & (steps < 5.0 * step)]
    return float(np.sum(few) / np.sum(np.rint(few / step)))


def window(fs: float, count: int) -> int:
    """Samples of a window of 2 s, within what gives a scale and what follows its changes."""
    return max(1, min(count, max(LEAST_WINDOW, min(_MOST_WINDOW, round(_WINDOW_S * fs)))))


def scales(x: Array, width: int, order: int = 1) -> Array:
    """Standard deviation of white noise with the differences seen, window by window.

    σ² = ⟨(∇x)²⟩ / C(2·order, order): 2 for first differences, 6 for second. Of each window the largest tenth of the
    differences is left out, so that spikes and steps do not count.

    `x`: readings or residuals, shape (N,); NaN only where a whole window may have it.
    `width`: differences in a window.
    `order`: of the differences.
    Returns unit of x, shape (max(1, N' // width),), N' the number of differences.
    """
    count = max(0, x.size - order)
    if count < width:
        return scales(x, count, order) if count else np.zeros(1)
    kept = max(1, round(KEPT * width))
    squares = np.empty(count // width)
    at_once = max(1, _AT_ONCE // width)
    for first in range(0, squares.size, at_once):
        last = min(first + at_once, squares.size)
        rows = np.abs(np.diff(x[first * width : last * width + order], order)).reshape(-1, width)
        small = np.partition(rows, kept - 1, axis=1)[:, :kept]
        squares[first:last] = np.mean(small**2, axis=1)
    return np.asarray(np.sqrt(squares / (KEPT_VARIANCE * math.comb(2 * order, order))))


def spread(per_window: Array, width: int, rows: NDArray[np.intp]) -> Array:
    """A value of each window for some of its samples, by number; what is left at the end has the last one's."""
    return np.asarray(per_window[np.minimum(rows // width, per_window.size - 1)])

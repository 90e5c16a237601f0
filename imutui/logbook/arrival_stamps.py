"""Sampling instants from arrival times: a recording whose program stamped packets when it got round to them.

No packet arrives early, so the instants lie on the line under the arrivals (the live clock's idea, with all of the
recording to look at). Samples lost inside a burst can't be told from a slow clock and are spread over their piece.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

SHORT = 0.25  # a step shorter than this share of the mean period comes of a burst
_SHARE = 0.2
_COARSE = 0.15  # share of the period to which stamps are rounded visibly
_PIECE_S = 20.0
_SILENCE_S = 1.0
_SLACK = 2.0
_BLOCK, _BLOCKS, _FEWEST = 64, 64, 8


@dataclass(frozen=True, slots=True)
class Instants:
    """Sampling instants fitted to arrivals."""

    t: np.ndarray  # s, shape (N,), increasing, none after its arrival
    pieces: int  # lines that it took; 1 is one regular grid
    # median_late, max_late: arrival less instant, s
    median_late: float
    max_late: float


def rounding(t: np.ndarray) -> list[str]:
    """Return in words that stamps are rounded, or that a float32 held them; empty if they are not.

    `t`: s, shape (N,), increasing.
    """
    period = float(np.median(np.diff(t)))
    steps = np.sort(np.diff(t) / period)
    steps = steps[steps < 1.6]
    kinds = [float(part.mean()) for part in np.split(steps, np.flatnonzero(np.diff(steps) > 0.05) + 1)]
    unit = float(np.diff(kinds).min()) if len(kinds) > 1 else 0.0
    if unit < _COARSE or max(abs(kind / unit - round(kind / unit)) for kind in kinds) > 0.1:
        return []
    what = f"stamps are rounded to {unit * period:.2g} s, {100 * unit:.0f} % of the period"
    return [f"{what}: --stamps arrival fits the sampling instants"]


def burst_words(share: float, period: float, longest: float) -> str:
    """Return stamps that look like arrivals in bursts in words; "" if they do not.

    `share`: of the steps that are shorter than `SHORT` of the mean period.
    `period`, `longest`: mean and longest step, s.
    """
    if share <= _SHARE:
        return ""
    return (
        f"{100 * share:.0f} % of steps are shorter than a quarter of the mean period of {period * 1e3:.2f} ms,"
        f" the longest is {longest * 1e3:.0f} ms"
    )


def from_arrivals(t: np.ndarray) -> Instants:
    """Equally spaced instants under arrival times.

    `t`: arrivals, s, shape (N,), increasing.
    Returns one grid t_k = a + k T with the least total lateness; where it would have whole stretches arrive late by
      more than two periods (lost samples, a wandering clock), joined lines of 20 s; and a new start after a silence.
    """
    parts = np.split(np.arange(t.size), _silences(t))
    fitted = [_fit(t[part]) for part in parts]
    instants = np.concatenate([line for line, _ in fitted])
    if not (np.diff(instants) > 0.0).all():
        fitted = [_fit(t)]
        instants = fitted[0][0]
    late = t - instants
    return Instants(instants, sum(pieces for _, pieces in fitted), float(np.median(late)), float(late.max()))


def _silences(t: np.ndarray) -> np.ndarray:
    """Samples before which nothing came for a second, and that were not caught up with afterwards."""
    steps = np.diff(t)
    usual = steps[steps <= _SILENCE_S]
    period = float(usual.mean()) if usual.size else _SILENCE_S
    found = []
    for k in np.flatnonzero(steps > _SILENCE_S).tolist():
        # twice the silence is time enough to catch up, at twice the rate
        after = t[k + 1 : k + 1 + max(2, int(2.0 * float(steps[k]) / period))]
        least = float(np.min(after - t[k] - period * np.arange(after.size)))
        if least > 0.5 * float(steps[k]):
            found.append(k + 1)
    return np.array(found, int)


def _fit(t: np.ndarray) -> tuple[np.ndarray, int]:
    """Instants of a stretch without silence, and how many lines it took."""
    if t.size < 3:
        return t.copy(), 1
    k = np.arange(t.size)
    a, period = _line_under(t)
    late = t - (a + period * k)
    size = max(3, int(np.ceil(_PIECE_S / period)))
    pieces = max(1, t.size // size)
    edges = np.linspace(0, t.size, pieces + 1).astype(int)
    if pieces < 3 or max(float(late[i:j].min()) for i, j in pairwise(edges)) <= _SLACK * period:
        return a + period * k, 1
    return _joined(t, edges), pieces


def _line_under(t: np.ndarray) -> tuple[float, float]:
    """Offset and slope of the least late line under arrivals.

    The hull's edge below their mean has the least total lateness, but leans on two arrivals; its slope is put right by
    the least late of each block, and the line then raised until it touches.
    """
    k = np.arange(t.size)
    period = _hull_slope(t)
    size = max(_BLOCK, t.size // _BLOCKS)
    blocks = t.size // size
    if blocks >= _FEWEST:
        late = (t - period * k)[: blocks * size].reshape(blocks, size)
        least = np.argmin(late, axis=1)
        period += _median_slope(least + size * np.arange(blocks), late.min(axis=1))
    return float((t - period * k).min()), period


def _median_slope(x: np.ndarray, y: np.ndarray) -> float:
    """Median slope of all pairs (Theil and Sen), which blocks that were late throughout don't move."""
    i, j = np.triu_indices(x.size, 1)
    return float(np.median((y[j] - y[i]) / (x[j] - x[i])))


def _hull_slope(t: np.ndarray) -> float:
    """Slope of the lower hull's edge below the mean arrival."""
    hull: list[int] = []
    values = t.tolist()
    for k, value in enumerate(values):
        while len(hull) > 1:
            i, j = hull[-2], hull[-1]
            if (values[j] - values[i]) * (k - i) < (value - values[i]) * (j - i):
                break
            hull.pop()
        hull.append(k)
    right = min(max(1, int(np.searchsorted(hull, (t.size - 1) / 2.0))), len(hull) - 1)
    i, j = hull[right - 1], hull[right]
    return float((values[j] - values[i]) / (j - i))


def _joined(t: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Lines that meet halfway along each piece, at the height of the line under that piece."""
    k = np.arange(t.size)
    knots, heights = [], []
    for i, j in pairwise(edges):
        a, period = _line_under(t[i:j])
        half = (j - i - 1) / 2.0
        knots.append(i + half)
        heights.append(a + period * half)
    x, y = np.array(knots), np.array(heights)
    # where the chord of two pieces cuts above an arrival, both of its ends come down
    between = np.clip(np.searchsorted(x, k) - 1, 0, x.size - 2)
    early = np.zeros(x.size - 1)
    np.maximum.at(early, between, _polyline(x, y, between, k) - t)
    y -= np.maximum(np.r_[early, 0.0], np.r_[0.0, early])
    return _polyline(x, y, between, k)


def _polyline(x: np.ndarray, y: np.ndarray, between: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Joined lines through (x, y), the outer ones prolonged."""
    slope = np.diff(y) / np.diff(x)
    return np.asarray(y[between] + slope[between] * (k - x[between]))

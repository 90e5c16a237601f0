"""Series to character cells: minimum and maximum of every dot column, so that no spike is hidden. Pure numpy."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from imutui.tui.terminal.glyphs import Glyphs

Floats = npt.NDArray[np.floating]
Bits = npt.NDArray[np.bool_]
Codes = npt.NDArray[np.uint32]
Limits = tuple[float, float]
Line = list[tuple[str, str]]  # texts with their styles, from left to right
Look = TypeVar("Look")
SPACE = 0x20

# Braille dots of a cell, by row and column: Unicode 2800 + sum.
_BRAILLE = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_HALVES = {name: np.array([ord(sign) for sign in signs], np.uint32) for name, signs in
           (("block", " ▀▄█"), ("ascii", " '.:"))}  # fmt: skip
_MEAN_SIGNS = {"block": "─", "ascii": "="}
_STEPS = (1.0, 2.0, 5.0, 10.0)
_GAP_STEPS = 5.0
_RECENT = 256
_HEADROOM = 0.1


@dataclass(frozen=True, slots=True)
class Envelope:
    """Lowest and highest value of each dot column; NaN where there is none."""

    low: Floats
    high: Floats

    def limits(self) -> Limits | None:
        """Lowest and highest of all, or None without data."""
        if np.isnan(self.low).all():
            return None
        return float(np.nanmin(self.low)), float(np.nanmax(self.high))


def column_extremes(
    t: Floats, values: Floats, width: float, first: int, columns: int, most: float
) -> tuple[Floats, Floats]:
    """Minimum and maximum of some columns, of several series at once.

    `t`, `values`: instants, increasing, s, and values.
    `width`: of a column, s.
    `first`, `columns`: number of the first column, counted from instant 0, and how many there are.
    `most`: columns between two samples that are still joined.
    Returns NaN where there is nothing.
    """
    low = np.full((values.shape[1], columns), np.nan)
    high = low.copy()
    index = np.floor(t / width).astype(np.int64) - first
    inside = slice(int(np.searchsorted(index, 0)), int(np.searchsorted(index, columns)))
    index, values = index[inside], values[inside]
    if not index.size:
        return low, high
    starts = np.flatnonzero(np.diff(index, prepend=-1))
    filled = index[starts]
    low[:, filled] = np.minimum.reduceat(values, starts, axis=0).T
    high[:, filled] = np.maximum.reduceat(values, starts, axis=0).T
    for lane in range(low.shape[0]):
        _bridge(low[lane], high[lane], filled, most)
    return low, high


def gap_columns(t: Floats, width: float) -> float:
    """Columns that a slow series may leave between two samples; more is a gap in the data."""
    steps = np.sort(np.diff(t[-_RECENT:]))  # the middle one of a few: numpy's own median takes longer than the rest
    return _GAP_STEPS * float(steps[steps.size // 2]) / width if steps.size else 0.0


def _bridge(low: Floats, high: Floats, filled: npt.NDArray[np.int64], most: float) -> None:
    """Fill columns between samples of a slow series; leave real gaps open."""
    distance = np.diff(filled)
    if not (distance > 1).any():
        return
    columns = np.arange(low.size)
    middle = np.interp(columns, filled, (low[filled] + high[filled]) / 2)
    right = np.searchsorted(filled, columns)
    between = (right > 0) & (right < filled.size) & np.isnan(low)
    reach = distance[np.clip(right - 1, 0, distance.size - 1)]
    bridged = between & (reach <= max(most, 1.0))
    low[bridged] = high[bridged] = middle[bridged]


def nice_range(low: float, high: float) -> Limits:
    """Round limits that contain both values."""
    spread = high - low
    if spread <= 0.0:
        spread = max(abs(high) * 1e-3, 1e-3)
        low, high = low - spread / 2, high + spread / 2
    raw = spread / 8.0
    power = 10.0 ** np.floor(np.log10(raw))
    step = float(next(s for s in _STEPS if s * power >= raw * (1 - 1e-9)) * power)
    return float(np.floor(low / step) * step), float(np.ceil(high / step) * step)


def keep_range(current: tuple[float, float] | None, low: float, high: float) -> tuple[float, float]:
    """Axis limits that contain the data, changed only if they must: a scale that dances cannot be read."""
    if (
        current is not None
        and current[0] <= low
        and high <= current[1]
        and high - low >= 0.35 * (current[1] - current[0])
    ):
        return current
    # room for the next spike that is a little larger: every change of a scale redraws the whole lane
    room = _HEADROOM * (high - low)
    return nice_range(low - room, high + room)


def label_decimals(limits: Limits) -> int:
    """Decimals that tell both ends of an axis apart."""
    spread = limits[1] - limits[0]
    return int(np.clip(1 - np.floor(np.log10(spread)), 0, 4)) if spread > 0 else 3


def dots(band: Envelope, limits: Limits, rows: int) -> Bits:
    """Dots (rows, columns) of an envelope, neighbours joined; what is outside the limits is cut off."""
    low, high = limits
    known = ~np.isnan(band.low)
    scale = (rows - 1) / (high - low)
    top = np.rint((high - np.where(known, band.high, low)) * scale)
    bottom = np.rint((high - np.where(known, band.low, low)) * scale)
    joined = known[1:] & known[:-1]
    top_all, bottom_all = top.copy(), bottom.copy()
    bottom_all[:-1] = np.where(joined, np.maximum(bottom[:-1], top[1:] - 1), bottom[:-1])
    top_all[:-1] = np.where(joined, np.minimum(top[:-1], bottom[1:] + 1), top[:-1])
    row = np.arange(rows)[:, None]
    return (row >= top_all) & (row <= bottom_all) & known


def cells_of(bits: Bits, glyphs: Glyphs) -> Bits:
    """Which characters have a dot, (rows, columns)."""
    return np.asarray(bits.reshape(bits.shape[0] // glyphs.rows, glyphs.rows, -1, glyphs.columns).any(axis=(1, 3)))


def codes_with_line(band: Bits, line: Bits, glyphs: Glyphs) -> Codes:
    """A line over a band of dots, as characters: it is seen without a colour of its own, and hides no spike.

    Where characters have dots enough, those of the band beside the line give way, but for the outermost of a column.
    Else the line has a sign of its own in cells that the band fills.
    """
    if glyphs.name == "braille":
        beside, inside = np.zeros_like(line), np.zeros_like(band)
        beside[1:], beside[:-1] = line[:-1], beside[:-1] | line[1:]
        inside[1:-1] = band[:-2] & band[2:]
        return codes((band & ~(beside & inside)) | line, glyphs)
    filled = band.reshape(band.shape[0] // glyphs.rows, glyphs.rows, -1).all(axis=1)
    sign = ord(_MEAN_SIGNS[glyphs.name])
    return np.where(filled & cells_of(line, glyphs), sign, codes(band, glyphs)).astype(np.uint32)


def trailing_mean(
    t: Floats, values: Floats, width: float, first: int, columns: int, window: int, fewest: int
) -> Floats:
    """Mean over some columns that end with each one, of several series at once.

    `t`, `values`: instants, increasing, s, and values, from `window` columns before the first one on.
    `width`: of a column, s.
    `first`, `columns`: number of the first column, counted from instant 0, and how many there are.
    `window`, `fewest`: columns that a mean is taken over, and samples that it takes at least.
    Returns NaN where there are too few samples.
    """
    edges = np.searchsorted(np.floor(t / width).astype(np.int64), np.arange(first - window, first + columns) + 1)
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0, dtype=float)])[edges]
    counts = edges[window:] - edges[:-window]
    mean: Floats = ((sums[window:] - sums[:-window]) / np.maximum(counts, 1)[:, None]).T
    return np.where(counts < fewest, np.nan, mean)


def codes(bits: Bits, glyphs: Glyphs) -> Codes:
    """Dots to characters (rows, columns), as their Unicode numbers."""
    rows, columns = bits.shape[0] // glyphs.rows, bits.shape[1] // glyphs.columns
    blocks = bits.reshape(rows, glyphs.rows, columns, glyphs.columns)
    if glyphs.name == "braille":
        found = np.einsum("rycx,yx->rc", blocks, _BRAILLE) + 0x2800
        # an empty cell as a space: one byte instead of three, copied text stays clean
        return np.where(found == 0x2800, SPACE, found).astype(np.uint32)
    halves: Codes = _HALVES[glyphs.name][blocks[:, 0, :, 0] + 2 * blocks[:, 1, :, 0].astype(int)]
    return halves


def lines(characters: Codes) -> list[str]:
    """Characters to lines of text."""
    size = 4 * characters.shape[1]
    whole = np.ascontiguousarray(characters, "<u4").tobytes()
    return [whole[start : start + size].decode("utf-32-le") for start in range(0, len(whole), size)] if size else []


def cells(bits: Bits, glyphs: Glyphs) -> list[str]:
    """Dots to lines of characters."""
    return lines(codes(bits, glyphs))


def runs(line: str, looks: Iterable[Look]) -> list[tuple[str, Look]]:
    """A line in parts that look alike; `looks` has one for each character."""
    parts, begin = [], 0
    for look, same in groupby(looks):
        end = begin + sum(1 for _ in same)
        parts.append((line[begin:end], look))
        begin = end
    return parts


def titled(left: str, rights: Iterable[str], width: int, glyphs: Glyphs) -> str:
    """A line from a title at the left to the first words that fit at the right, the longest of which come first."""
    left, said = glyphs.text(left), ""
    for right in rights:
        said = glyphs.text(f" {right} ──" if right else "")
        if len(left) + len(said) <= width:
            break
    return (left + glyphs.text("─") * (width - len(left) - len(said)) + said)[:width].ljust(width)

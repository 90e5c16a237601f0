"""A plot's lanes as a ring of character cells, of which only the newest ones are worked out anew.

A cell's place in the ring is its number, counted from instant 0, modulo the width: drawn from place 0 on, that is the
sweep; turned until the newest cell is last, it is the scrolling plot. Both show the same cells.
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from imutui.tui.connection.packet_series import PacketSeries
from imutui.tui.terminal.glyphs import Glyphs
from imutui.tui.widgets import raster
from imutui.tui.widgets.raster import Bits, Codes, Envelope, Floats, Limits

Cells = TypeVar("Cells", Codes, Bits)
_BAR_SHARE = 40
_MEAN_SHARE = 20  # a running mean is over this part of the span
_FEWEST_IN_MEAN = 8  # of fewer samples there is none: they are a thin line as they are
_FEWEST_ROWS = 3  # a lane of fewer lines has no room for a mean in its band


@dataclass(frozen=True, slots=True)
class Frame:
    """Size and time of the cells."""

    span: float  # of the whole width, s
    # cells, rows: width, and height of a lane
    cells: int
    rows: int


def mean_columns(columns: int) -> int:
    """Dot columns that a running mean is over, of so many in all."""
    return max(columns // _MEAN_SHARE, 2)


class PlotLanes:
    """Cells of some columns of a series."""

    def __init__(self, columns: slice, count: int, glyphs: Glyphs) -> None:
        self._columns = columns
        self._count = count
        self._glyphs = glyphs
        self.ranges: list[Limits | None] = [None] * count  # scale of each lane, None without data
        self.outside: list[bool] = [False] * count  # whether a locked scale leaves something out
        self._frame: Frame | None = None
        self._source: PacketSeries | None = None
        self._newest = 0

    def follow_scales(self) -> None:
        self.ranges = [None] * self._count

    def update(self, series: PacketSeries, frame: Frame, *, sweep: bool, locked: bool) -> list[list[str]]:
        """Take what is new; returns the lines of each lane.

        `sweep`, `locked`: whether time stands still and an erase bar moves; whether scales stay as they are.
        """
        width = frame.span / (frame.cells * self._glyphs.columns)
        t, values = series.last(
            frame.span + (2 * self._glyphs.columns + mean_columns(frame.cells * self._glyphs.columns)) * width
        )
        if not t.size:
            self._frame = None
            self.ranges = [None] * self._count
            return [[" " * frame.cells] * frame.rows for _ in range(self._count)]
        newest = int(np.floor(t[-1] / width))
        first = self._first(series, frame, newest)
        self._take(t, values[:, self._columns], width, first, newest)
        if frame.rows >= _FEWEST_ROWS:
            self._take_mean(t, values[:, self._columns], width, first, newest)
        self._newest = newest
        self._draw(frame, first, sweep=sweep, locked=locked)
        return [raster.lines(self._arranged(lane, frame.cells, raster.SPACE, sweep=sweep)) for lane in self._codes]

    def in_mean(self, lane: int, *, sweep: bool) -> list[list[bool]]:
        """Whether the running mean is in each cell of a lane's lines; empty without data."""
        if self._frame is None:
            return []
        shown = self._arranged(self._through[lane], self._frame.cells, False, sweep=sweep)
        return shown.tolist()  # type: ignore[no-any-return]

    def _first(self, series: PacketSeries, frame: Frame, newest: int) -> int:
        """Number of the first dot column to work out: the last one drawn, or all if anything else has changed."""
        columns = frame.cells * self._glyphs.columns
        whole = (newest // self._glyphs.columns + 1 - frame.cells) * self._glyphs.columns
        if (
            (self._frame, self._source) == (frame, series)
            and self._newest <= newest
            and self._newest >= whole + self._glyphs.columns
        ):
            return self._newest
        self._frame, self._source = frame, series
        self._low = np.full((self._count, columns), np.nan)
        self._high, self._mean = self._low.copy(), self._low.copy()
        self._codes = np.full((self._count, frame.rows, frame.cells), raster.SPACE, np.uint32)
        self._through = np.zeros(self._codes.shape, bool)
        self._drawn: list[Limits | None] = [None] * self._count
        return whole

    def _take(self, t: Floats, values: Floats, width: float, first: int, newest: int) -> None:
        """Put the columns from `first` to the newest cell's end into the ring."""
        per_cell = self._glyphs.columns
        count = (newest // per_cell + 1) * per_cell - first
        start = max(int(np.searchsorted(t, first * width)) - 1, 0)  # rounding must not cost the column's first sample
        most = raster.gap_columns(t, width)
        # from the sample before on, so that what joins it to the first one in sight is drawn too
        lead = max(first - int(np.floor(t[start] / width)), 0)
        low, high = raster.column_extremes(t[start:], values[start:], width, first - lead, count + lead, most)
        places = np.arange(first, first + count) % self._low.shape[1]
        self._low[:, places], self._high[:, places] = low[:, lead:], high[:, lead:]

    def _take_mean(self, t: Floats, values: Floats, width: float, first: int, newest: int) -> None:
        """Put the running mean of the columns from `first` to the newest cell's end into the ring."""
        per_cell, window = self._glyphs.columns, mean_columns(self._mean.shape[1])
        count = (newest // per_cell + 1) * per_cell - first
        start = int(np.searchsorted(t, (first - window - 1) * width))
        mean = raster.trailing_mean(t[start:], values[start:], width, first, count, window, _FEWEST_IN_MEAN)
        self._mean[:, np.arange(first, first + count) % self._mean.shape[1]] = mean

    def _draw(self, frame: Frame, first: int, *, sweep: bool, locked: bool) -> None:
        per_cell = self._glyphs.columns
        end = self._newest // per_cell + 1
        hidden = self._bar(frame.cells) if sweep else 0
        seen = np.arange((end - frame.cells + hidden) * per_cell, end * per_cell) % self._low.shape[1]
        low, high = self._low[:, seen], self._high[:, seen]
        for lane in range(self._count):
            extent = Envelope(low[lane], high[lane]).limits()
            if extent is None:
                self._codes[lane], self._drawn[lane], self.outside[lane] = raster.SPACE, None, False
                continue
            now = self.ranges[lane]
            limits = now if locked and now is not None else raster.keep_range(now, *extent)
            self.ranges[lane] = limits
            self.outside[lane] = extent[0] < limits[0] or extent[1] > limits[1]
            # the column before the first new one is joined to it
            begin = first // per_cell - 1 if limits == self._drawn[lane] else end - frame.cells
            self._drawn[lane] = limits
            self._draw_cells(lane, frame, max(begin, end - frame.cells), end, limits)

    def _draw_cells(self, lane: int, frame: Frame, begin: int, end: int, limits: Limits) -> None:
        per_cell = self._glyphs.columns
        columns = np.arange(begin * per_cell, end * per_cell) % self._low.shape[1]
        band = Envelope(self._low[lane, columns], self._high[lane, columns])
        mean = np.where(np.isnan(band.low), np.nan, self._mean[lane, columns])
        rows = frame.rows * self._glyphs.rows
        bits, line = raster.dots(band, limits, rows), raster.dots(Envelope(mean, mean), limits, rows)
        cells = np.arange(begin, end) % frame.cells
        self._codes[lane][:, cells] = raster.codes_with_line(bits, line, self._glyphs)
        self._through[lane][:, cells] = raster.cells_of(line, self._glyphs)

    def _bar(self, cells: int) -> int:
        """Cells of the erase bar."""
        return max(cells // _BAR_SHARE, 2)

    def _arranged(self, lane: Cells, cells: int, empty: float, *, sweep: bool) -> Cells:
        """A lane as it is shown: turned, or with the erase bar."""
        newest = self._newest // self._glyphs.columns
        if not sweep:
            return np.roll(lane, -(newest + 1), axis=1)
        shown = lane.copy()
        shown[:, np.arange(newest + 1, newest + 1 + self._bar(cells)) % cells] = empty
        return shown

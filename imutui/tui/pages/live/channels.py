"""The table of channels: counts, value, the statistics of the last seconds, and a small trend; one is chosen."""

import time

import numpy as np
from textual.content import Content

from imutui.session.snapshot import ChannelSnapshot
from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.tui.connection.packet_series import TEMPERATURE
from imutui.tui.terminal.glyphs import Glyphs
from imutui.tui.widgets import raster
from imutui.tui.widgets.text_lines import TextLines

CHANNEL_NAMES = ("gx", "gy", "gz", "ax", "ay", "az", "T")
CHANNEL_UNITS = ("deg/s",) * 3 + ("mg",) * 3 + ("degC",)
_STATISTICS_S = 10.0
_TREND_CELLS = 10
_LEVEL_SD = 8.0
"""Means of noise stay within four standard deviations on either side: the trend of a quiet channel is level."""


class ChannelTable(TextLines):
    """Counts, value, mean, standard deviation and extremes of seven channels, below a head."""

    DEFAULT_CSS = "ChannelTable { width: 80; height: 8; }"
    _shown_at = 0.0

    def __init__(self) -> None:
        super().__init__()
        self.chosen = 0
        self.span = 30.0  # of the trends, s

    def choose(self, channel: int) -> None:
        self.chosen = channel
        self._shown_at = 0.0

    def show(self, view: View) -> None:
        """Take a view, at most as often as numbers can be read; a frozen or ended one at once."""
        now, before = time.monotonic(), self.view
        same = before is not None and before.frozen == view.frozen and before.shown is not None
        running = view.shown is not None and view.shown["state"] == "running"
        if same and running and now - self._shown_at < 0.95 / view.pacing.table_hz:
            return
        self._shown_at = now
        super().show(view)

    def lines(self, view: View, width: int) -> list[Content]:
        span = view.shown["statistics_s"] if view.shown is not None else _STATISTICS_S
        rows = {channel["name"]: channel for channel in view.shown["channels"]} if view.shown is not None else {}
        head = f"{'counts':>12}{'value':>10}{f'{span:.0f} s:  mean':>17}{'sd':>8}{'min':>10}{'max':>10}"
        head += f"  trend {self.span:.0f} s"
        lines = [self.line((head.ljust(width), "bold underline"))]
        trends = trend_lines(view, self.span, self.glyphs)
        for i, (name, unit) in enumerate(zip(CHANNEL_NAMES, CHANNEL_UNITS, strict=True)):
            right = _slope(view) if i == TEMPERATURE else f"  {trends[i]}"
            lines.append(self._row(name, unit, rows.get(name), right, chosen=i == self.chosen))
        return lines

    def _row(self, name: str, unit: str, channel: ChannelSnapshot | None, right: str, *, chosen: bool) -> Content:
        """Counts, value, mean, sd, extremes; dashes where nothing has come."""
        decimals, mean_decimals = formatting.DECIMALS[unit], formatting.MEAN_DECIMALS[unit]
        if channel is None:
            counts, value, mean, sd, low, high = formatting.NOTHING, None, None, None, None, None
        else:
            counts, value, mean, sd = str(channel["counts"]), channel["value"], channel["mean"], channel["sd"]
            low, high = channel["min"], channel["max"]
        return self.line(
            (f"{'>' if chosen else ' '}{name:<3}", "bold reverse" if chosen else "bold"),
            f"{counts:>8}",
            (formatting.aligned(value, 10, decimals, 3), "bold"),
            f" {self.glyphs.text(formatting.unit_name(unit)):<6}"
            + formatting.aligned(mean, 10, mean_decimals, 4)
            + formatting.aligned(sd, 8, mean_decimals, 4)
            + formatting.aligned(low, 10, decimals, 3)
            + formatting.aligned(high, 10, decimals, 3)
            + right,
        )


def trend_lines(view: View, span: float, glyphs: Glyphs) -> list[str]:
    """Means of the six channels over the last seconds, a small line each; level where they move no more than noise."""
    t, values = view.series.last(span)
    empty = " " * _TREND_CELLS
    if t.size < 2:
        return [empty] * TEMPERATURE
    columns = _TREND_CELLS * glyphs.columns
    width = span / columns
    first = int(np.floor(t[-1] / width)) - columns + 1
    means = raster.trailing_mean(t, values[:, :TEMPERATURE], width, first, columns, 1, 1)
    per_column = max(t.size / columns, 1.0)
    return [
        _trend(mean, float(sd) / per_column**0.5, glyphs) for mean, sd in zip(means, values.std(axis=0), strict=False)
    ]


def _trend(mean: raster.Floats, sd: float, glyphs: Glyphs) -> str:
    extent = raster.Envelope(mean, mean).limits()
    if extent is None:
        return " " * _TREND_CELLS
    middle, half = sum(extent) / 2, max(extent[1] - extent[0], _LEVEL_SD * sd, 1e-9) / 2
    bits = raster.dots(raster.Envelope(mean, mean), (middle - half, middle + half), glyphs.rows)
    return raster.cells(bits, glyphs)[0]


def _slope(view: View) -> str:
    """How fast the temperature moves."""
    return f"  {formatting.number(view.slope_k_per_min, 5, 2, sign=True)} K/min"

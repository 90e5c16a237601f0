"""The table of channels: counts, value, and the statistics of the last seconds."""

import time

from textual.content import Content

from imutui.session.snapshot import ChannelSnapshot
from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.tui.connection.packet_series import TEMPERATURE
from imutui.tui.widgets.text_lines import TextLines

_NAMES = ("gx", "gy", "gz", "ax", "ay", "az", "T")
_STATISTICS_S = 10.0
_UNITS = ("deg/s",) * 3 + ("mg",) * 3 + ("degC",)


class ChannelTable(TextLines):
    """Counts, value, mean, standard deviation and extremes of seven channels, below a head."""

    DEFAULT_CSS = "ChannelTable { width: 80; height: 8; }"
    _shown_at = 0.0

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
        """Head and channels; dashes while nothing has come."""
        span = view.shown["statistics_s"] if view.shown is not None else _STATISTICS_S
        rows = {channel["name"]: channel for channel in view.shown["channels"]} if view.shown is not None else {}
        head = f"      counts     value           mean      sd       min       max  {span:.0f} s"
        lines = [self.line((head.ljust(width), "bold underline"))]
        for i, (name, unit) in enumerate(zip(_NAMES, _UNITS, strict=True)):
            slope = _slope(view) if i == TEMPERATURE else ""
            lines.append(self._row(name, unit, rows.get(name), slope))
        return lines

    def _row(self, name: str, unit: str, channel: ChannelSnapshot | None, right: str) -> Content:
        """Counts, value, mean, sd, extremes; dashes where nothing has come."""
        decimals, mean_decimals = formatting.DECIMALS[unit], formatting.MEAN_DECIMALS[unit]
        if channel is None:
            counts, value, mean, sd, low, high = formatting.NOTHING, None, None, None, None, None
        else:
            counts, value, mean, sd = str(channel["counts"]), channel["value"], channel["mean"], channel["sd"]
            low, high = channel["min"], channel["max"]
        return self.line(
            (f" {name:<3}", "bold"),
            f"{counts:>8}",
            (formatting.aligned(value, 10, decimals, 3), "bold"),
            f" {formatting.unit_name(unit):<6}"
            + formatting.aligned(mean, 10, mean_decimals, 4)
            + formatting.aligned(sd, 8, mean_decimals, 4)
            + formatting.aligned(low, 10, decimals, 3)
            + formatting.aligned(high, 10, decimals, 3)
            + right,
        )


def _slope(view: View) -> str:
    """How fast the temperature moves."""
    slope = view.series.slope_per_minute(TEMPERATURE)
    return f"  {formatting.number(slope, 5, 2, sign=True)} K/min"

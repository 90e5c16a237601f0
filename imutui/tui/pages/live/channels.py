"""The table of channels: counts, value, and the statistics of the last seconds."""

import time
from typing import Any

from textual.content import Content

from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.tui.connection.packet_series import TEMPERATURE
from imutui.tui.widgets.text_lines import TextLines

_NAMES = ("gx", "gy", "gz", "ax", "ay", "az", "T")
_UNITS = ("deg/s",) * 3 + ("mg",) * 3 + ("degC",)


class ChannelTable(TextLines):
    """Eight lines: a head and seven channels."""

    DEFAULT_CSS = "ChannelTable { width: 80; height: 8; }"
    _shown_at = 0.0

    def show(self, view: View) -> None:
        """Take a view, at most as often as numbers can be read; a frozen or ended one at once."""
        now, before = time.monotonic(), self.view
        same = before is not None and before.frozen == view.frozen and before.shown is not None
        running = view.shown is not None and view.shown.get("state") == "running"
        if same and running and now - self._shown_at < 0.95 / view.pacing.table_hz:
            return
        self._shown_at = now
        super().show(view)

    def lines(self, view: View, width: int) -> list[Content]:
        """Head and channels; dashes while nothing has come."""
        shown = view.shown or {}
        span = shown.get("statistics_s") or 10.0
        rows = {channel["name"]: channel for channel in shown.get("channels") or []}
        extremes = None if all("min" in row for row in rows.values()) else view.series.extremes(span)
        head = f"      counts     value           mean      sd       min       max  {span:.0f} s"
        lines = [self.line((head.ljust(width), "bold underline"))]
        for i, (name, unit) in enumerate(zip(_NAMES, _UNITS, strict=True)):
            row = rows.get(name, {"name": name, "unit": unit})
            low, high = (extremes[0][i], extremes[1][i]) if extremes is not None else (row.get("min"), row.get("max"))
            slope = _slope(view) if i == TEMPERATURE else ""
            lines.append(self._row(row, low, high, slope))
        return lines

    def _row(self, channel: dict[str, Any], low: float | None, high: float | None, right: str) -> Content:
        unit = channel["unit"]
        decimals, mean_decimals = formatting.DECIMALS[unit], formatting.MEAN_DECIMALS[unit]
        counts = channel.get("counts")
        return self.line(
            (f" {channel['name']:<3}", "bold"),
            f"{formatting.NOTHING if counts is None else counts:>8}",
            (formatting.aligned(channel.get("value"), 10, decimals, 3), "bold"),
            f" {formatting.unit_name(unit):<6}"
            + formatting.aligned(channel.get("mean"), 10, mean_decimals, 4)
            + formatting.aligned(channel.get("sd"), 8, mean_decimals, 4)
            + formatting.aligned(low, 10, decimals, 3)
            + formatting.aligned(high, 10, decimals, 3)
            + right,
        )


def _slope(view: View) -> str:
    """How fast the temperature moves."""
    slope = view.series.slope_per_minute(TEMPERATURE)
    return f"  {formatting.number(slope, 5, 2, sign=True)} K/min"

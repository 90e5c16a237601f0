"""The table of channels: counts, value, and the statistics of the last seconds."""

from typing import Any

from textual.content import Content

from imutui.tui import text
from imutui.tui.link import View
from imutui.tui.widgets.lines import Lines

_NAMES = ("gx", "gy", "gz", "ax", "ay", "az", "T")
_UNITS = ("deg/s",) * 3 + ("mg",) * 3 + ("degC",)


class ChannelTable(Lines):
    """Eight lines: a head and seven channels."""

    DEFAULT_CSS = "ChannelTable { width: 80; height: 8; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """Head and channels; dashes while nothing has come."""
        shown = view.shown or {}
        span = shown.get("statistics_s") or 10.0
        rows = {channel["name"]: channel for channel in shown.get("channels") or []}
        extremes = view.series.extremes(span)
        head = f"        counts      value             mean      sd       min       max  {span:.0f} s"
        lines = [self.line((head.ljust(width), "bold underline"))]
        for i, (name, unit) in enumerate(zip(_NAMES, _UNITS, strict=True)):
            low, high = (extremes[0][i], extremes[1][i]) if extremes is not None else (None, None)
            lines.append(self._row(rows.get(name, {"name": name, "unit": unit}), low, high))
        return lines

    def _row(self, channel: dict[str, Any], low: float | None, high: float | None) -> Content:
        unit = channel["unit"]
        decimals, mean_decimals = text.DECIMALS[unit], text.MEAN_DECIMALS[unit]
        counts = channel.get("counts")
        return self.line(
            (f" {channel['name']:<5}", "bold"),
            (f"{text.NOTHING if counts is None else counts:>8}", ""),
            (text.aligned(channel.get("value"), 11, decimals, 3), "bold"),
            f" {text.unit_name(unit):<6}",
            text.aligned(channel.get("mean"), 11, mean_decimals, 4),
            text.aligned(channel.get("sd"), 8, mean_decimals, 4),
            text.aligned(low, 10, decimals, 3),
            text.aligned(high, 10, decimals, 3),
        )

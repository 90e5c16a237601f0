"""Warm-up, link and recording, a line each."""

from pathlib import PurePath

from textual.content import Content

from imutui.session.snapshot import Snapshot
from imutui.tui import formatting, messages
from imutui.tui.connection.model import View
from imutui.tui.connection.packet_series import TEMPERATURE
from imutui.tui.widgets.text_lines import TextLines

_ROOM_FOR_MARKS = 90


class WarmLine(TextLines):
    """Whether the unit is warm: word, minutes on, slope of the temperature, what to wait for."""

    DEFAULT_CSS = "WarmLine { height: 1; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """Word, minutes, slope, advice; empty without an acquisition."""
        now = view.now
        said = messages.warm_up(now["since_start_s"], view.series.slope_per_minute(TEMPERATURE)) if now else ""
        word, _, rest = said.partition(" ")
        return [self.line(" ", (word, "bold"), " ", rest)]


class LinkLine(TextLines):
    """Rates, what was lost, and what the unit says of itself."""

    DEFAULT_CSS = "LinkLine { height: 1; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """Rate asked and measured, packets lost, wrong checksums, status word; empty without an acquisition."""
        now = view.now
        if now is None:
            return [Content("")]
        lost, bad = now["lost_packets_max"], now["bad_checksums"]
        return [
            self.line(
                f" {_rates(now)}  ",
                (f"lost {messages.lost(now)}", "bold $text-warning" if lost else ""),
                "  ",
                (f"bad sums {bad}", "bold $text-warning" if bad else ""),
                (f"  BIT {status}" if (status := now.get("status")) else "", "bold $text-warning"),
            )
        ]


def _rates(now: Snapshot) -> str:
    measured = now["measured_hz"]
    asked = f"{now['rate_hz']:g}"
    return f"asked {asked} measured {formatting.NOTHING if measured is None else f'{measured:.2f}'} Hz"


class RecordingLine(TextLines):
    """File, size and age of the last flush; or how to start."""

    DEFAULT_CSS = "RecordingLine { height: 1; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """Name, size, samples and flush of the file, shorter where there is no room."""
        now, recording = view.now, view.recording
        if recording is None:
            running = now is not None and now["state"] == "running"
            hint = " not recording: r writes every packet to a file, from then on" if running else ""
            return [self.line((hint, "dim"))]
        flushed = recording["flush_age_s"]
        marks = [formatting.plural(recording["marks"], "mark")] if width >= _ROOM_FOR_MARKS else []
        facts = "  ".join(
            (
                formatting.size(recording["bytes"]),
                formatting.plural(recording["samples"], "sample"),
                *marks,
                "not flushed yet" if flushed is None else f"flush {flushed:.1f} s ago",
            )
        )
        name = formatting.shorten(PurePath(recording["path"]).name, max(width - len(facts) - 4, 12))
        stale = flushed is not None and flushed > 3.0
        return [self.line(" ", (name, "bold"), (f"  {facts}", "bold $text-error" if stale else ""))]

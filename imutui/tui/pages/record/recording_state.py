"""The Record page's panels: state of the recording, and its marks."""

from textual.content import Content

from imutui.session.snapshot import RecordingSnapshot, Snapshot
from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.tui.pages.record import text
from imutui.tui.widgets.text_lines import LEVEL_STYLES, TextLines

_NAME = 10


class RecordingState(TextLines):
    """Whether it records, in big; hint; and every number of the file and the line."""

    DEFAULT_CSS = "RecordingState { height: 8; padding: 0 1; }"

    def __init__(self) -> None:
        super().__init__()
        self.finished: list[tuple[str, str]] = []
        """What was written last: names and values."""

    def lines(self, view: View, width: int) -> list[Content]:
        """State and hint; four lines of the file, written or to come; rate, losses, line."""
        now = view.now
        level, said = text.state(now)
        style = LEVEL_STYLES[level]
        badge = self.line((f" {said} ", f"{style} reverse"), "  ", (text.hint(now), "bold"))
        if now is None:
            return [badge]
        recording = now["recording"]
        rows = self._idle(now, width) if recording is None else self._file(now, recording, width)
        return [row.truncate(width, ellipsis=True) for row in (badge, *rows, *self._link(now, width))]

    def _row(self, name: str, said: str, level: str = "none") -> Content:
        return self.line((f"{name:{_NAME}}", "dim"), (said, "" if level == "none" else LEVEL_STYLES[level]))

    def _file(self, now: Snapshot, recording: RecordingSnapshot, width: int) -> list[Content]:
        full = text.fill_words(recording, now["free_bytes"])
        level, flushed = text.flush(recording)
        size = f"{formatting.size(recording['bytes'])}, {text.growth(recording)}; disk {full}"
        return [
            self._row("file", formatting.shorten_path(recording["path"], width - _NAME)),
            self._row("size", size, text.room(recording)),
            self._row("rotation", f"{text.part(recording, now)}; {formatting.plural(recording['samples'], 'sample')}"),
            self._row("disk", flushed, level),
        ]

    def _idle(self, now: Snapshot, width: int) -> list[Content]:
        free = now["free_bytes"]
        space = "" if free is None else f"; {formatting.size(free)} free"
        if self.finished:
            (name, path), *others = self.finished
            rows = [self._row(name, formatting.shorten_path(path, width - _NAME))]
            rows += [self._row(name, formatting.shorten(said, width - _NAME)) for name, said in others]
            again = "" if now["state"] == "ended" else "; r records again"
            rows += [self._row("next", f"6 Logs opens it: info, check, replay, trace{again}", "good")]
            return [*rows, *[Content("")] * (4 - len(rows))]
        if now["state"] == "ended":
            folder = formatting.shorten_path(now["logs"] or "the logs folder", width - _NAME)
            return [self._row("files", folder), self._row("", "6 Logs lists them"), Content(""), Content("")]
        return [
            self._row("r writes", formatting.shorten_path(text.will_write(now), width - _NAME)),
            self._row("", f"every packet, onto the disk each second{space}"),
            self._row("", "the filter begins anew with it, so that a replay gives the same"),
            Content(""),
        ]

    def _link(self, now: Snapshot, width: int) -> list[Content]:
        measured, packets = now["measured_hz"], now["packet_hz"]
        rate = f"asked {now['rate_hz']:g} Hz, measured {formatting.number(measured, 0, 2)} Hz"
        if packets is not None:
            rate += f"; {packets:.2f} packets/s, {formatting.plural(now['packets'], 'packet')}"
        trouble, losses = text.losses(now)
        if len(losses) > width - _NAME:  # counts whole, rather than half an advice
            losses = losses.partition(": ")[0]
        level, line = text.line(now)
        return [
            self._row("rate", rate),
            self._row("losses", losses, trouble),
            self._row("line", line, level),
        ]


class MarkList(TextLines):
    """The last marks, newest at the bottom."""

    DEFAULT_CSS = "MarkList { height: 1fr; padding: 0 1; min-height: 3; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """A head and as many marks as there is room for."""
        marks = view.now["marks"] if view.now is not None else []
        room = max(self.content_size.height - 1, 1)
        head = self.rule(f"marks: {len(marks)}" if marks else "marks", width, "UTC, time in the file, text")
        if not marks:
            return [
                head,
                self.line(
                    ("none yet: m adds one" if view.recording is not None else "none: they go into a recording", "dim")
                ),
            ]
        return [head, *(self.line(text.mark_line(mark)).truncate(width, ellipsis=True) for mark in marks[-room:])]

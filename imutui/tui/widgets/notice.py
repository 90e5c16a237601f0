"""What there is to say just now: an alarm, the answer to a key, a frozen view, or the last event."""

from textual.content import Content

from imutui.session.snapshot import EventLine
from imutui.tui import formatting, messages
from imutui.tui.connection.model import View
from imutui.tui.widgets.text_lines import LEVEL_STYLES, TextLines


class Notice(TextLines):
    """The most urgent message in one line, more for a long one."""

    # docked: whatever else has to give way, what is said is seen
    DEFAULT_CSS = (
        "Notice { dock: bottom; height: auto; min-height: 1; max-height: 8; background: $surface; padding: 0 1; }"
    )

    def show(self, view: View) -> None:
        """Take a view; a longer message makes room for itself."""
        before = self._made
        super().show(view)
        if before is None or self._made is None or before.plain != self._made.plain:
            self.refresh(layout=True)

    def lines(self, view: View, width: int) -> list[Content]:
        """The most urgent message."""
        level, said = _chosen(view)
        said = formatting.folded(said, width)
        return [self.line((said, "" if level == "event" else LEVEL_STYLES[level]))]


def _chosen(view: View) -> tuple[str, str]:
    now = view.now
    silent = messages.silence(now) if now is not None else None
    if silent is not None:
        return "bad", silent
    if now is not None and now["state"] == "running" and now["error"]:
        return "bad", now["error"]
    if view.notice[1]:
        return view.notice
    if view.frozen:
        return "wait", "FROZEN view: the acquisition goes on. space follows it again."
    if now is not None and now["findings"]:
        return "bad", now["findings"][-1]
    events = now["events"] if now is not None else []
    return "event", event_text(events[-1]) if events else ""


def event_text(event: EventLine) -> str:
    """Time, kind and text of an event, without the bounds of a gap that stand there for programs."""
    kind = "" if event["name"] == "acquisition" else f"{event['name']}: "
    return f"{formatting.utc_time(event['utc'])}  {kind}{event['text'].partition(' (lost_min=')[0]}"

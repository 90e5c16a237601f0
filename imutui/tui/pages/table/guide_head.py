"""The guided list's head: which profile, what to do now, how long still."""

from textual.content import Content

from imutui.session.snapshot import GuideSnapshot, ProfileDescription, SegmentDescription
from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.tui.pages.table import text
from imutui.tui.widgets.text_lines import TextLines

_BAR = 30


class GuideHead(TextLines):
    """Which profile, what to do now, what then, and how long still; always as high, so that the list below stays."""

    DEFAULT_CSS = "GuideHead { height: 6; padding: 0 1; }"

    profile: ProfileDescription | None = None
    """As the acquisition tells it."""
    recorded = False
    """Whether there is a recording of it."""

    def lines(self, view: View, width: int) -> list[Content]:
        """Title, instruction, what then, bar; or, before it begins, what to know of a virtual unit."""
        if self.profile is None or view.now is None:
            return []
        guide, segments = view.now["guide"], self.profile["segments"]
        by_hand = text.guided(self.profile, view.now)
        ended = view.now["state"] == "ended"
        what, then = (
            text.ENDED if ended else text.said(guide, self.profile, view.recording is not None, by_hand, self.recorded)
        )
        about = " ".join(self.profile.get("about", []))
        seconds = sum(s["seconds"] for s in segments)
        warned = text.warning(view.now, width) if by_hand and not ended else []
        return [
            self.line((text.title(self.profile, seconds), "bold")),
            self.line((formatting.shorten(about, width - 2), "dim")),
            self.line((what, "bold reverse" if guide and guide["state"] == "go" and not ended else "bold")),
            self.line(then),
            *(self.line(said) for said in warned),
            *([] if warned or ended else [self._bar(guide, segments)]),
        ]

    def _bar(self, guide: GuideSnapshot | None, segments: list[SegmentDescription]) -> Content:
        if guide is None or guide["state"] not in ("go", "hold"):
            return self.line("")
        seconds = segments[guide["segment"]]["seconds"]
        left = text.left(guide, guide["segment"])
        if left is None:
            return self.line(f"{text.bar(0.0, _BAR)}  then {seconds:.0f} s")
        share = 1.0 - left / seconds if seconds > 0.0 else 1.0
        return self.line(f"{text.bar(share, _BAR)}  ", (f"{left:3.0f} s left", "bold"), f" of {seconds:.0f} s")

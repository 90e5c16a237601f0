"""The guided list's head: which profile, what to do now, how long still."""

from collections.abc import Mapping, Sequence
from typing import Any

from textual.content import Content

from imutui.tui.connection.model import View
from imutui.tui.pages.table import text
from imutui.tui.widgets.text_lines import TextLines

_BAR = 30


def guided(profile: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    """Whether the acquisition guides through a profile: the filter must go by the operator, if there is a filter."""
    return profile.get("align") == "marks" or now.get("filter") is None


class GuideHead(TextLines):
    """As high in one state as in another, so that the list below stays where it is."""

    DEFAULT_CSS = "GuideHead { height: 6; padding: 0 1; }"

    profile: Mapping[str, Any] | None = None
    """As the acquisition tells it."""

    def lines(self, view: View, width: int) -> list[Content]:
        """Title, instruction, what then, bar; or, before it begins, what to know of a virtual unit."""
        if self.profile is None or view.now is None:
            return []
        guide, segments = view.now.get("guide"), self.profile["segments"]
        recording = view.now.get("recording") is not None
        by_hand = guided(self.profile, view.now)
        what, then = text.said(guide, self.profile, recording, by_hand)
        seconds = sum(float(s["seconds"]) for s in segments)
        warned = text.warning(view.now, width) if by_hand else []
        return [
            self.line((text.title(self.profile, seconds), "bold")),
            self.line(""),
            self.line((what, "bold reverse" if guide and guide["state"] == "go" else "bold")),
            self.line(then),
            *(self.line(said) for said in warned),
            *([] if warned else [self._bar(guide, segments)]),
        ]

    def _bar(self, guide: text.Guide | None, segments: Sequence[Mapping[str, Any]]) -> Content:
        if guide is None or guide["state"] not in ("go", "hold"):
            return self.line("")
        seconds = float(segments[guide["segment"]]["seconds"])
        left = text.left(guide, int(guide["segment"]))
        if left is None:
            return self.line(f"{text.bar(0.0, _BAR)}  then {seconds:.0f} s")
        share = 1.0 - left / seconds if seconds > 0.0 else 1.0
        return self.line(f"{text.bar(share, _BAR)}  ", (f"{left:3.0f} s left", "bold"), f" of {seconds:.0f} s")

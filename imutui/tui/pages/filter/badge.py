"""The badge: a word, its reason, and what to do."""

from textual.content import Content

from imutui.tui.connection.model import View
from imutui.tui.widgets.text_lines import TextLines
from imutui.verdict.rules import Verdict

_STYLES = {"good": "$success", "wait": "$warning", "bad": "$error", "none": "$foreground"}
_LEAST = 16
_WHY = "  w why "


class FilterBadge(TextLines):
    """The verdict on the filter in two lines: word, reason, and what to do."""

    DEFAULT_CSS = "FilterBadge { height: 2; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """Word, reason, what to do; what does not fit is behind a key."""
        verdict = view.shown_verdict
        if verdict is None:
            return [self.line((" – OFF ", "bold reverse"), "  no acquisition: 1 connects to one")]
        # without colour, the reverse of a colour is grey on grey
        style = "bold reverse" if self.app.no_color else f"bold reverse {_STYLES[verdict.level]}"
        chip = self.line((f" {verdict.badge} ", style))
        indent = chip.cell_length + 2
        said = self.glyphs.text(_said(view, verdict))
        first, second = two_lines(said, width - indent - 1, width - indent - len(_WHY))
        why = self.line((_WHY, "dim"))
        return [
            Content.assemble(chip, "  ", (first, "bold")),
            self.spread(Content(" " * indent + second), why, width),
        ]


def _said(view: View, verdict: Verdict) -> str:
    now = view.verdict
    changed = f"(frozen; now {now.badge}) " if view.frozen and now is not None and now.word != verdict.word else ""
    return f"{changed}{verdict.reason}\n{verdict.todo}"


def two_lines(said: str, first: int, second: int) -> tuple[str, str]:
    """A reason and what to do as two lines at most: what to do begins a line of its own if the reason leaves one.

    A long reason is cut so that what to do has room beside it; the key `w` has all of it.

    `said`: reason, line feed, what to do.
    `first`, `second`: characters of the lines.
    """
    reason, _, todo = said.partition("\n")
    if len(reason) <= first:
        return reason, _cut(todo, second)
    cut = reason.rfind(" ", 0, first + 1)
    cut = cut if cut > 0 else first
    rest = reason[cut:].strip()
    room = second - len(todo) - 2
    if not todo or room < _LEAST:
        return reason[:cut], _cut(rest, second)
    return reason[:cut], f"{_cut(rest, room)}; {todo}"


def _cut(said: str, width: int) -> str:
    """At most `width` characters, cut behind a word."""
    if len(said) <= width:
        return said
    cut = said.rfind(" ", 0, width - 1)
    return f"{said[: cut if cut > 0 else width - 2].rstrip(' ;,:')} …"

"""Why the badge is what it is: every rule with what it found."""

from textual.content import Content

from imutui.report import wrapping
from imutui.tui.connection.model import View
from imutui.tui.widgets.text_lines import LEVEL_STYLES, TextLines
from imutui.verdict.rules import LEVEL_MARKS, Check


class RuleLines(TextLines):
    """Why the badge is what it is, beside the table: a head, and each rule with what it found."""

    DEFAULT_CSS = "RuleLines { height: 100%; padding: 0 1; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """One rule after the other, wrapped."""
        verdict = view.shown_verdict
        if verdict is None:
            return []
        head = self.line((f"why {verdict.badge}".ljust(width), "bold underline"))
        return [head, *(line for check in verdict.checks for line in self._rule(check, width))]

    def _rule(self, check: Check, width: int) -> list[Content]:
        mark = f"{LEVEL_MARKS[check.level]:<5}"
        said = wrapping.wrap(f"{check.name}: {check.said}", max(width - len(mark), 10))
        style = LEVEL_STYLES[check.level] if check.level != "none" else ""
        return [self.line((mark if i == 0 else " " * len(mark), style), line) for i, line in enumerate(said)]

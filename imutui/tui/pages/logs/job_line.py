"""A job under way: what, how far, what is being done, for how long."""

import time

from textual.content import Content
from textual.widget import Widget

from imutui.tui import formatting
from imutui.tui.pages.table import text
from imutui.tui.terminal.glyphs import choose

_BAR = 24


class JobLine(Widget):
    """Two lines; empty without a job."""

    DEFAULT_CSS = """
    JobLine { height: 2; padding: 0 1; background: $panel; display: none; }
    JobLine.-on { display: block; }
    """

    def __init__(self) -> None:
        super().__init__()
        self._what, self._share, self._doing, self._since = "", 0.0, "", 0.0

    def begin(self, what: str) -> None:
        """A job begins."""
        self._what, self._share, self._doing, self._since = what, 0.0, "starting", time.monotonic()
        self.add_class("-on")
        self.refresh()

    def tell(self, share: float | None = None, doing: str | None = None) -> None:
        """How far it is; without news the seconds go on."""
        self._share = self._share if share is None else share
        self._doing = doing or self._doing
        self.refresh()

    def end(self) -> None:
        """It is over."""
        self.remove_class("-on")

    def render(self) -> Content:
        """What; bar, share, what is being done."""
        seconds = time.monotonic() - self._since
        bar = text.bar(self._share, _BAR)
        first = f"{self._what}   {formatting.clock(seconds)}   Esc cancels"
        lines = f"{first}\n{bar} {100.0 * self._share:3.0f} %  {self._doing}"
        return Content(choose().text(lines))

"""Why the badge is what it is: every rule, every alarm, everything that has no room on the page."""

from typing import ClassVar

from textual.binding import Binding, BindingType

from imutui.tui.connection.model import View
from imutui.tui.pages.dialogs.base import ScrollDialog
from imutui.tui.pages.filter.explanation import explanation


class WhyDialog(ScrollDialog):
    """Every rule, alarm and number of the filter, as of the moment it was asked for, to scroll.

    `view`: what is explained.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("w", "cancel", show=False, priority=True),
    ]

    def __init__(self, view: View) -> None:
        super().__init__(explanation(view))

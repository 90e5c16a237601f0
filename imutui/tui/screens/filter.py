"""Filter: how far the biases are, how good, and whether the filter may be believed."""

from collections.abc import Iterable
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.content import Content
from textual.widget import Widget
from textual.widgets import Static

from imutui.tui.glyphs import choose
from imutui.tui.link import View
from imutui.tui.screens.page import Page
from imutui.tui.widgets.biases import BiasTable
from imutui.tui.widgets.estimates import AlarmLines, NavigationLines, NisLines, ToleranceLine, VerdictLine
from imutui.tui.widgets.plot import Plot

_LEGEND = """\
bias: what a still unit reads too much
±3 sd: the filter's own certainty
bar: │ is zero, the ends are Table 1
in 10 s: how far the estimate moved
NIS: squared innovation in units of
  what the filter expects"""
_SHORTEST_S = 60.0


class FilterPage(Page):
    """Verdict, biases, NIS, navigation, alarms; in tall terminals the biases' history."""

    TITLE = "Filter"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "app.freeze", "freeze", tooltip="Freeze the view, or follow again"),
        Binding("g", "other_plot", "gyro/accel", tooltip="Show the gyro or the accelerometer biases"),
        Binding("escape", "app.live", "back", show=False),
    ]

    def body(self) -> Iterable[Widget]:
        """From the verdict down to the details."""
        yield VerdictLine()
        yield Horizontal(BiasTable(), Static(Content(choose().text(_LEGEND)), id="legend"), id="top")
        yield ToleranceLine()
        yield NisLines()
        yield NavigationLines()
        yield AlarmLines()
        yield Plot("gyro bias, deg/s", ("x gyro", "y gyro", "z gyro"), slice(0, 3), id="gyro")
        yield Plot("accel bias, mg", ("x accel", "y accel", "z accel"), slice(3, 6), id="accel")

    def show(self, view: View) -> None:
        """Show a view."""
        super().show(view)
        t, _ = view.biases.last(float("inf"))
        span = max(float(t[-1] - t[0]), _SHORTEST_S) if t.size else _SHORTEST_S
        for plot in self.query(Plot):
            plot.show(view.biases, span, frozen=view.frozen)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer the other plot only where there is one."""
        return self.has_class("-tall") if action == "other_plot" else True

    def action_other_plot(self) -> None:
        """Show the other biases' history."""
        self.toggle_class("-accel")

"""Filter: how far the biases are, how good, and whether the filter may be believed."""

from collections.abc import Iterable
from pathlib import Path
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.containers import Grid, Horizontal, Vertical
from textual.widget import Widget

from imutui.estimates import NAMES, live_biases
from imutui.tui.connection.model import View
from imutui.tui.pages import requests
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.base import ScrollDialog
from imutui.tui.pages.filter.bias_history import BiasPlot, BiasPlotSettings
from imutui.tui.pages.filter.estimates import (
    AlarmLines,
    BiasTable,
    EffectLines,
    FilterBadge,
    NavigationLines,
    NisLines,
    RuleLines,
)
from imutui.tui.pages.filter.text import explanation
from imutui.tui.widgets import history_cells

_UNITS = ("deg/s",) * 3 + ("mg",) * 3
_TEMPERATURE = BiasPlotSettings("temperature", "°C", None, 0, "whole run", "", chosen=False, unseen="", banded=False)
# side by side: gyro and accelerometer of one axis
_ORDER = (0, 3, 1, 4, 2, 5)


class FilterPage(Page):
    """Badge, biases, NIS, remainder, navigation, and the biases' past."""

    TITLE = "Filter"
    CSS = """
    FilterPage #numbers { height: auto; }
    FilterPage #left { width: 80; height: auto; }
    FilterPage RuleLines { display: none; width: 1fr; }
    FilterPage.-wide RuleLines { display: block; }
    FilterPage #all { display: none; grid-size: 2 3; height: 1fr; }
    FilterPage.-tall #all { display: block; layout: grid; }
    FilterPage.-tall #one { display: none; }
    FilterPage.-plot #all { display: none; }
    FilterPage.-plot #one { display: block; }
    FilterPage.-plot .details, FilterPage.-plot RuleLines { display: none; }
    FilterPage.-plot BiasTable { height: 2; }
    FilterPage #temperature { display: none; height: 30%; }
    FilterPage.-plot.-warm #temperature { display: block; }
    FilterPage Notice { dock: bottom; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "choose(-1)", "bias above", show=False),
        Binding("down,j", "choose(1)", "bias below", show=False),
        Binding("enter", "plot", "plot", key_display="enter", tooltip="Enlarge the plot of the chosen bias"),
        Binding("t", "trace", "trace", tooltip="Look in this recording for what the model does not explain"),
        Binding("e", "effects", "effects", tooltip="Load found effects into the filter"),
        Binding("space", "app.freeze", "freeze", tooltip="Freeze the view, or follow again"),
        Binding("w", "why", "why", tooltip="Why the badge is what it is: every rule, alarm and number"),
        Binding("a", "scale", "scale", show=False, tooltip="Plot scale: settled part, whole run, limits"),
        Binding("escape", "back", "back", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._chosen = 0
        self._scale = 0

    def body(self) -> Iterable[Widget]:
        """From the badge down to the details; room adds plots below and the rules at the right."""
        yield FilterBadge()
        with Horizontal(id="numbers"):
            with Vertical(id="left"):
                yield BiasTable()
                with Vertical(classes="details") as details:
                    details.styles.height = "auto"
                    yield NisLines()
                    yield NavigationLines()
                    yield EffectLines()
                    yield AlarmLines()
            yield RuleLines()
        yield BiasPlot(id="one")
        yield BiasPlot(id="temperature")
        with Grid(id="all"):
            for index in _ORDER:
                yield BiasPlot(index)

    def show(self, view: View) -> None:
        super().show(view)
        warm = self.query_one("#temperature", BiasPlot)
        self.set_class(len(view.temperature) > 0, "-warm")
        if self.has_class("-plot"):
            warm.show(view.temperature, _TEMPERATURE)
        for plot in self.query(BiasPlot).exclude("#temperature"):
            if (plot.column is None) == self._alone:
                plot.show(view.biases, self._settings(view, self._chosen if plot.column is None else plot.column))

    @property
    def _alone(self) -> bool:
        """Whether there is only one plot."""
        return self.has_class("-plot") or not self.has_class("-tall")

    def _settings(self, view: View, index: int) -> BiasPlotSettings:
        biases = live_biases(view.estimates) if view.estimates is not None else []
        hint = "Esc back, a scale" if self.has_class("-plot") else "↑↓ choose, Enter enlarges" if self._alone else ""
        # limits are of the filter's kind of unit: without a filter there are none
        name, unit, limit, unseen = NAMES[index], _UNITS[index], None, ""
        if biases:
            bias = biases[index]
            waits = view.estimates is not None and bool(view.estimates["waiting"])
            name, unit, limit = bias.name, bias.unit, bias.limit
            unseen = "" if bias.observable or waits else view.fault_of(bias.channel) or "unobservable in this setup"
        scale = history_cells.SCALES[self._scale]
        return BiasPlotSettings(name, unit, limit, index, scale, hint, index == self._chosen, unseen)

    def _redraw(self) -> None:
        self.query_one(BiasTable).select(self._chosen, alone=self.has_class("-plot"))
        self.redraw()

    def action_choose(self, step: int) -> None:
        self._chosen = (self._chosen + step) % len(NAMES)
        self._redraw()

    def action_plot(self) -> None:
        self.toggle_class("-plot")
        self._redraw()

    def action_scale(self) -> None:
        self._scale = (self._scale + 1) % len(history_cells.SCALES)
        self._redraw()

    async def action_back(self) -> None:
        if self.has_class("-plot"):
            self.action_plot()
        else:
            await self.app.run_action("live")

    def action_why(self) -> None:
        if self.view is not None:
            self.app.push_screen(WhyDialog(self.view))

    def action_trace(self) -> None:
        recording = self.recording
        now = self.now
        if now is not None and now["state"] == "ended":
            self.say("the acquisition has ended: 6 Logs, t traces what it recorded", "wait")
        elif recording is None:
            self.say("not recording: r starts a recording, then t traces it", "wait")
        else:
            self.post_message(requests.Trace(Path(recording["path"])))

    def action_effects(self) -> None:
        self.post_message(requests.ChooseEffects())


class WhyDialog(ScrollDialog):
    """Every rule, alarm and number of the filter, as of the moment it was asked for, to scroll."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("w", "cancel", show=False, priority=True),
    ]

    def __init__(self, view: View) -> None:
        super().__init__(explanation(view))

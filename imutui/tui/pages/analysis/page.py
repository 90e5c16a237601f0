"""Analysis of one channel over Live: Allan deviation, spectrum, histogram, and a cursor that reads values."""

import time
from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.content import Content
from textual.widget import Widget

from imutui.session.client import Client
from imutui.session.snapshot import StatisticsSnapshot
from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.tui.pages.analysis import figures, text
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog
from imutui.tui.widgets import axes
from imutui.tui.widgets.plot_widget import PlotWidget
from imutui.tui.widgets.raster import Line
from imutui.tui.widgets.text_lines import TextLines

NAMES = ("gx", "gy", "gz", "ax", "ay", "az", "T")
_EVERY_S = 1.0
_PAGE = 10
_LATE_S = 5.0


class HeadLines(TextLines):
    """Channel, the three views, and what they are made of."""

    DEFAULT_CSS = "HeadLines { height: 2; }"

    def __init__(self) -> None:
        super().__init__()
        self.head: tuple[str, int, StatisticsSnapshot | None] = (NAMES[0], 0, None)

    def lines(self, view: View, width: int) -> list[Content]:
        del view
        name, chosen, seen = self.head
        tabs = [(f" {title} ", "bold reverse" if n == chosen else "") for n, title in enumerate(text.TITLES)]
        unit = formatting.unit_name(seen["unit"]) if seen is not None else ""
        unit += "/√Hz" if unit and chosen == figures.SPECTRUM else ""
        unit = "packets" if unit and chosen == figures.HISTOGRAM else unit
        first = self.spread(self.line(" ", (f">{name}", "bold"), "  ", *tabs), self.line(f"{unit} "), width)
        return [first, self.line(f" {text.made_of(seen)}" if seen is not None else "")]


class ReadingLines(TextLines):
    """What the cursor reads, what that is compared with, how to read the figure."""

    DEFAULT_CSS = "ReadingLines { height: 3; }"

    def __init__(self) -> None:
        super().__init__()
        self.said: tuple[str, str, str] = ("", "", "")

    def lines(self, view: View, width: int) -> list[Content]:
        del view
        value, compared, meaning = (f" {said}"[:width] for said in self.said)
        return [self.line((value, "bold")), self.line(compared), self.line((meaning, "dim"))]


class AxesPlot(PlotWidget):
    """Curves over axes with numbers, or words as long as there are none."""

    PREFIX = "axes"
    COMPONENT_CLASSES = {f"axes--{kind}" for kind in (axes.BLANK, axes.DATA, axes.COMPARED, axes.CURSOR)}  # noqa: RUF012
    DEFAULT_CSS = """
    AxesPlot { height: 1fr; min-height: 4; }
    AxesPlot > .axes--blank { color: $foreground 70%; }
    AxesPlot > .axes--data { color: $text-primary; }
    AxesPlot > .axes--compared { color: $text-warning; }
    AxesPlot > .axes--cursor { color: $foreground; text-style: bold; }
    """

    figure: axes.Figure | None = None
    words = ""

    @property
    def cells(self) -> int:
        """Characters between both ends of the x axis."""
        return max(self.size.width - axes.GUTTER, 1)

    def show(self, figure: axes.Figure | None, words: str = "") -> None:
        self.figure, self.words = figure, words
        self.redraw()

    def drawn(self, width: int, height: int) -> list[Line]:
        if self.figure is not None:
            return axes.draw(self.figure, width, height, self.glyphs)
        lines = [[(" " * width, axes.BLANK)] for _ in range(height)]
        if lines:
            lines[height // 2] = [(self.glyphs.text(self.words)[:width].center(width), axes.BLANK)]
        return lines


class AnalysisPage(Page):
    """Above the Live page until Esc; asks for the channel's statistics about once a second."""

    TITLE = "Live"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("w,tab", "view(1)", "view", key_display="w", tooltip="Allan deviation, spectrum, histogram"),
        Binding("shift+tab", "view(-1)", "view before", show=False),
        Binding("up", "channel(-1)", "channel", key_display="up,dn", tooltip="Another channel"),
        Binding("down", "channel(1)", "next channel", show=False),
        Binding("left", "cursor(-1)", "cursor", key_display="lt,rt", tooltip="Move the cursor that reads values"),
        Binding("right", "cursor(1)", "cursor right", show=False),
        Binding("pageup", f"cursor(-{_PAGE})", "cursor far left", show=False),
        Binding("pagedown", f"cursor({_PAGE})", "cursor far right", show=False),
        Binding("home", "cursor(-9999)", "cursor to the beginning", show=False),
        Binding("end", "cursor(9999)", "cursor to the end", show=False),
        Binding("space", "app.freeze", "freeze", show=False, tooltip="Freeze the view, or follow again"),
        Binding("b", "begin", "anew", tooltip="Leave out all packets until now, as after the unit was moved"),
        Binding("escape", "leave", "back", key_display="esc"),
    ]

    def __init__(self, channel: int = 0) -> None:
        super().__init__()
        self._channel, self._shown = channel, figures.ALLAN
        self._cursors: dict[tuple[int, int], float] = {}
        self._seen: StatisticsSnapshot | None = None
        self._asked_at: float | None = None
        self._next_at = 0.0

    def body(self) -> Iterable[Widget]:
        yield HeadLines()
        yield AxesPlot()
        yield ReadingLines()

    def show(self, view: View) -> None:
        self.view = view
        running = view.now is not None and view.now["state"] in ("running", "stopping")
        now = time.monotonic()
        waits = self._asked_at is not None and now - self._asked_at < _LATE_S
        if running and not view.frozen and not waits and now >= self._next_at:
            self._ask(now)
        self._draw()
        super().show(view)

    def _ask(self, now: float) -> None:
        channel = self._channel
        self._asked_at, self._next_at = now, now + _EVERY_S
        found: list[StatisticsSnapshot] = []

        def ask(client: Client) -> str:
            found.append(client.statistics(channel))
            return ""

        def done() -> None:
            self._asked_at = None
            if found and channel == self._channel:
                self._seen = found[0]
            self._redraw()

        self.post_message(self.Ask(ask, "", done))

    def _redraw(self) -> None:
        # an answer may come when the page has been left
        if self.view is not None and self.is_whole and self in self.app.screen_stack:
            self._draw()
            super().show(self.view)

    def _draw(self) -> None:
        """Give the widgets what they show."""
        seen, plot = self._seen, self.query_one(AxesPlot)
        self.query_one(HeadLines).head = (NAMES[self._channel], self._shown, seen)
        reading = self.query_one(ReadingLines)
        figure = None if seen is None else figures.of(self._shown, seen)
        if seen is None or figure is None:
            plot.show(None, "" if seen is None else text.nothing(self._shown, seen))
            reading.said = ("", "", "")
            return
        stop = self._stop(seen)
        plot.show(replace(figure, cursor=float(figures.stops(self._shown, seen)[stop])))
        reading.said = (*text.reading(self._shown, seen, stop), text.meaning(self._shown, seen))

    def _stop(self, seen: StatisticsSnapshot) -> int:
        x = self._cursors.get((self._shown, self._channel), figures.first_stop(self._shown, seen))
        return figures.nearest(self._shown, seen, x)

    def action_view(self, step: int) -> None:
        self._shown = (self._shown + step) % len(text.TITLES)
        self._redraw()

    def action_channel(self, step: int) -> None:
        self._channel = (self._channel + step) % len(NAMES)
        self._seen, self._asked_at, self._next_at = None, None, 0.0
        self.redraw()

    def action_cursor(self, step: int) -> None:
        """Move the cursor by characters, at least to the next value."""
        seen = self._seen
        figure = None if seen is None else figures.of(self._shown, seen)
        if seen is None or figure is None:
            return
        places = figures.stops(self._shown, seen)
        cells = (figure.x.place(places) * self.query_one(AxesPlot).cells).astype(int)
        now = self._stop(seen)
        beyond = [n for n in range(len(places)) if (cells[n] - cells[now]) * step >= step * step]
        ahead = now + (1 if step > 0 else -1)
        if beyond:
            ahead = beyond[0] if step > 0 else beyond[-1]
        elif abs(step) > 1:
            ahead = len(places) - 1 if step > 0 else 0
        self._cursors[self._shown, self._channel] = float(places[min(max(ahead, 0), len(places) - 1)])
        self._redraw()

    def action_begin(self) -> None:
        said = "Packets until now are left out of all three views of all channels, on every screen."
        answers = [Answer("b", "begin", "begin anew, as after the unit was moved")]
        self.app.push_screen(ChoiceDialog("Begin statistics anew?", said, answers), self._begin)

    def _begin(self, answer: str | None) -> None:
        def ask(client: Client) -> str:
            client.begin_statistics()
            return "statistics of all channels begin anew"

        if answer is not None:
            self._next_at = 0.0
            self.post_message(self.Ask(ask, ""))

    def action_leave(self) -> None:
        self.app.pop_screen()

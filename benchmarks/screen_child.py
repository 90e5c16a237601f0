"""One side of benchmarks/screen.py, in a terminal of its own: draws for some seconds and writes down what it cost.

    python benchmarks/screen_child.py KIND MODE SECONDS RESULT [NAME]

KIND is plot, screen, or the same with plotext's widgets in place of ours: plot-peer, screen-peer; screen-plain sends
what Textual itself would. MODE is scroll or sweep, for the peer braille or hd. NAME is the running acquisition that
`screen` looks at.
"""

import json
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from textual.app import App, ComposeResult
from textual.widget import Widget

from imutui.session import client as session
from imutui.tui import app as application
from imutui.tui.app import ImutuiApp
from imutui.tui.connection.model import View
from imutui.tui.connection.packet_series import PacketSeries
from imutui.tui.connection.poller import Poller
from imutui.tui.pages.live import page as live_page
from imutui.tui.pages.live.page import LivePage
from imutui.tui.terminal import textual_private
from imutui.tui.terminal.appearance import Appearance
from imutui.tui.terminal.driver import Terminal
from imutui.tui.terminal.painter import Painter
from imutui.tui.widgets.plot import Plot

FPS, RATE_HZ, POINTS = 10.0, 133.0, 665
SPAN_S = 5.0
WARM_UP_S = 4.0
PANELS = (("gyro, deg/s", ("gx", "gy", "gz"), slice(0, 3)), ("accel, mg", ("ax", "ay", "az"), slice(3, 6)))
MEANS = np.array([0.35, -0.47, -0.27, -6.1, -0.4, 1001.0, 25.0])
SDS = np.array([0.15, 0.15, 0.15, 1.9, 1.9, 1.9, 0.02])


class Account:
    """Frames, processor time and ages of one run; writes them down and leaves when it is over."""

    def __init__(self, seconds: float, result: Path, leave: Callable[[], object]) -> None:
        self._result, self._leave = result, leave
        self._begin_at = time.monotonic() + WARM_UP_S
        self._end_at = self._begin_at + seconds
        self._begun: tuple[float, float, float] | None = None
        self._frames = 0
        self._ages: list[float] = []

    def frame(self, age_s: float | None = None) -> None:
        now = time.monotonic()
        if now < self._begin_at:
            return
        if self._begun is None:
            self._begun = (now, time.process_time(), time.time())
            return
        self._frames += 1
        if age_s is not None:
            self._ages.append(age_s)
        if now >= self._end_at:
            begun, cpu, wall = self._begun
            found = {
                "frames": self._frames, "seconds": now - begun, "cpu_s": time.process_time() - cpu,
                "from": wall, "to": time.time(), "ages_s": self._ages,
            }  # fmt: skip
            self._result.write_text(json.dumps(found))
            self._end_at = float("inf")
            self._leave()


class Panels(App[None]):
    """The plot area alone: two panels of three series."""

    CSS = "Plot, PlotextPlot { height: 1fr; }"

    def __init__(self, mode: str, peer: bool, seconds: float, result: Path) -> None:
        self._mode, self._peer, self._seconds, self._result = mode, peer, seconds, result
        super().__init__()
        self._painter = Painter()
        if not peer:
            textual_private.draw_through(self, self._painter.exact)
        self._series = PacketSeries(7)
        self._noise = np.random.default_rng(1).standard_normal((8192, 7))
        self._born = time.monotonic() - SPAN_S
        self._sent = 0

    def compose(self) -> ComposeResult:
        for title, names, columns in PANELS:
            yield peer_panel(title, names, columns, self._mode) if self._peer else Plot(title, names, columns)

    def on_mount(self) -> None:
        self._account = Account(self._seconds, self._result, self.exit)
        self.set_interval(1.0 / FPS, self._tick)

    def _tick(self) -> None:
        count = int((time.monotonic() - self._born) * RATE_HZ)
        numbers = np.arange(self._sent, count)
        self._series.extend(numbers / RATE_HZ, MEANS + SDS * self._noise[numbers % 8192])
        self._sent = count
        for panel in self.query(Widget):
            if isinstance(panel, Plot):
                panel.show(self._series, SPAN_S, mode=self._mode)
            elif hasattr(panel, "replot_with"):
                panel.replot_with(self._series)
        self._account.frame()

    # what the application does: measure the terminal, send only what changed

    def get_driver_class(self) -> Any:
        """As the application has it."""
        return super().get_driver_class() if self._peer else Terminal


def peer_panel(title: str, names: tuple[str, ...], columns: slice, marker: str) -> Widget:
    """A panel of textual-plotext: the same series, its own axes and legend."""
    from textual_plotext import PlotextPlot

    class Panel(PlotextPlot):
        def replot_with(self, series: PacketSeries) -> None:
            t, values = series.last(SPAN_S)
            t, values = t[-POINTS:], values[-POINTS:, columns]
            self.plt.clear_data()
            self.plt.title(title)
            x = t.tolist()
            for i, name in enumerate(names):
                self.plt.plot(x, values[:, i].tolist(), label=name, marker=marker)
            self.refresh()

    return Panel()


class PeerPage(LivePage):
    """The live page with plotext's widgets in place of ours."""

    marker = "braille"

    def body(self) -> Iterable[Widget]:
        """As the live page, but for the plots."""
        for widget in super().body():
            if isinstance(widget, Plot):
                title, names, columns = PANELS[widget.id == "accel"]
                panel = peer_panel(title, names, columns, self.marker)
                panel.styles.height = "1fr"
                yield panel
            else:
                yield widget

    def show(self, view: View) -> None:
        super().show(view)
        for panel in self.query(Widget):
            if hasattr(panel, "replot_with") and len(view.series):
                panel.replot_with(view.series)


class Whole(ImutuiApp):
    """The application, which leaves when its account is closed."""

    CSS_PATH = str(Path(application.__file__).with_name("app.tcss"))
    account: Account

    def on_mount(self) -> None:
        draw = self.drawing.draw

        def counted(event: Poller.Arrived) -> None:
            draw(event)
            if isinstance(self.page, LivePage):
                self.page._span = SPAN_S
            self.account.frame(self.drawing.frames.take_age())

        self.drawing.draw = counted  # type: ignore[method-assign]


def whole_screen(mode: str, peer: bool, plain: bool, seconds: float, result: Path, name: str) -> None:
    """The application on a running acquisition, its live page in front."""
    if peer:
        PeerPage.marker, mode = mode, "scroll"
        live_page.LivePage = PeerPage  # type: ignore[misc]
    if peer or plain:  # updates are Textual's own
        textual_private.HIDDEN.update(textual_private.DRAWING)
    app = Whole(session.attach(name), appearance=Appearance(plot=mode, fps=FPS))
    app.account = Account(seconds, result, lambda: app.exit(0))
    app.run()


def main() -> None:
    kind, mode, seconds, result = sys.argv[1:5]
    peer = kind.endswith("-peer")
    if kind.startswith("plot"):
        Panels(mode, peer, float(seconds), Path(result)).run()
    else:
        whole_screen(mode, peer, kind.endswith("-plain"), float(seconds), Path(result), sys.argv[5])


if __name__ == "__main__":
    main()

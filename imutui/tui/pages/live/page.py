"""Live: what the instrument says now, and said in the last seconds."""

from collections.abc import Iterable
from pathlib import PurePath
from typing import ClassVar

from textual import events
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.content import Content
from textual.widget import Widget

from imutui.session.snapshot import Snapshot
from imutui.tui import formatting, messages
from imutui.tui.connection.model import View
from imutui.tui.pages.analysis.page import AnalysisPage
from imutui.tui.pages.base import Page
from imutui.tui.pages.live.channels import CHANNEL_NAMES, CHANNEL_UNITS, ChannelTable
from imutui.tui.pages.live.orientation import Orientation
from imutui.tui.widgets.page_frame import EventList
from imutui.tui.widgets.plot import Plot
from imutui.tui.widgets.text_lines import TextLines

SPANS_S = (5.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0, 14400.0)
_FEWEST_SAMPLES = 60
_CHANNEL, _GYRO, _ACCEL, _BOTH, _ORIENTATION = "-channel", "-gyro", "-accel", "-both", "-orientation"
_PLOTS = (_CHANNEL, _GYRO, _ACCEL, _BOTH, _ORIENTATION)
_ROOM_FOR_BOTH = 30  # lines of a page from which on all six lanes are tall enough to be read


def first_span(rate_hz: float) -> float:
    """Span to begin with: half a minute, longer for slow packets."""
    return next((span for span in SPANS_S if span >= 30.0 and span * rate_hz >= _FEWEST_SAMPLES), SPANS_S[-1])


def packet_rate_hz(snapshot: Snapshot | None) -> float:
    """Packets per second of an acquisition, as far as known."""
    return (snapshot["packet_hz"] or 0.0) if snapshot is not None else 0.0


def _of_channel(channel: int) -> tuple[str, tuple[str, ...], slice]:
    """Title, names and columns of the plot of one channel."""
    name, unit = CHANNEL_NAMES[channel], formatting.unit_name(CHANNEL_UNITS[channel])
    return f"{name}, {unit}, with mean", (name,), slice(channel, channel + 1)


class LivePage(Page):
    """Table of channels, the chosen channel large or several, link and recording."""

    TITLE = "Live"
    CSS = """
    LivePage #top { height: 8; }
    LivePage #one, LivePage #gyro, LivePage #accel, LivePage Orientation { display: none; }
    LivePage.-orientation Orientation { display: block; }
    LivePage.-channel #one, LivePage.-gyro #gyro, LivePage.-accel #accel { display: block; }
    LivePage.-both #gyro, LivePage.-both #accel { display: block; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "channel(-1)", "channel", key_display="up,dn", tooltip="Choose the channel that is shown large"),
        Binding("down", "channel(1)", "next channel", show=False),
        Binding("w", "analysis", "noise", tooltip="Allan deviation, spectrum and histogram of the chosen channel"),
        Binding("space", "app.freeze", "freeze", tooltip="Freeze the view, or follow again"),
        Binding("plus,equals_sign", "span(1)", "span", key_display="+/-", tooltip="Longer plots (- for shorter ones)"),
        Binding("minus,underscore", "span(-1)", "shorter span", show=False),
        Binding("a", "lock", "lock", show=False, tooltip="Lock the scales, or let them follow"),
        Binding("s", "app.plot_mode", "sweep", show=False, tooltip="Plots scroll, sweep, or give way to numbers"),
        Binding("g", "plots", "plot", tooltip="One channel large, a quantity, all six, or how the unit lies"),
        Binding("escape", "app.follow", "follow", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._span: float | None = None
        self._locked = False
        self._plots = ""
        self._channel = 0

    def body(self) -> Iterable[Widget]:
        yield Horizontal(ChannelTable(), EventList(), id="top")
        yield Plot(*_of_channel(self._channel), id="one")
        yield Plot("gyro, deg/s", ("gx", "gy", "gz"), slice(0, 3), id="gyro")
        yield Plot("accel, mg", ("ax", "ay", "az"), slice(3, 6), id="accel")
        yield Orientation()
        yield StateLines()

    def show(self, view: View) -> None:
        self.query_one(ChannelTable).span = self.span(view)
        super().show(view)
        for plot in self.query(Plot):
            if plot.display:
                self._show_plot(plot, view)

    def _show_plot(self, plot: Plot, view: View) -> None:
        mode, note = view.pacing.mode, view.pacing.note
        plot.show(view.series, self.span(view), mode=mode, note=note, locked=self._locked, frozen=view.frozen)

    def on_resize(self, _: events.Resize) -> None:
        self._lay_out()

    def _lay_out(self) -> None:
        shown = self._plots or (_BOTH if self.size.height >= _ROOM_FOR_BOTH else _CHANNEL)
        for name in _PLOTS:
            self.set_class(name == shown, name)

    def span(self, view: View) -> float:
        """Span of the plots, s."""
        if self._span is not None:
            return self._span
        now = view.now
        if now is not None and now["sampling"] == "polled" and now["rate_hz"]:
            return first_span(now["rate_hz"])
        return first_span(packet_rate_hz(now) or 133.0)

    def action_span(self, step: int) -> None:
        view = self.view
        if view is None:
            return
        now = SPANS_S.index(self.span(view))
        span = SPANS_S[min(max(now + step, 0), len(SPANS_S) - 1)]
        if step < 0 or span * packet_rate_hz(view.now) <= view.series.capacity:
            self._span = span
        self.show(view)

    def action_lock(self) -> None:
        self._locked = not self._locked
        self.redraw()

    def action_plots(self) -> None:
        now = next(name for name in _PLOTS if self.has_class(name))
        self._plots = _PLOTS[(_PLOTS.index(now) + 1) % len(_PLOTS)]
        self._lay_out()
        self.call_after_refresh(self.redraw)

    def action_analysis(self) -> None:
        self.app.push_screen(AnalysisPage(self._channel))

    def action_channel(self, step: int) -> None:
        self._channel = (self._channel + step) % len(CHANNEL_NAMES)
        self.query_one(ChannelTable).choose(self._channel)
        self.query_one("#one", Plot).choose(*_of_channel(self._channel))
        self.redraw()


_ROOM_FOR_MARKS = 90


class StateLines(TextLines):
    """An effect that shows, or whether the unit is warm; rates and losses; the file, or how to start one."""

    DEFAULT_CSS = "StateLines { height: 3; }"

    def lines(self, view: View, width: int) -> list[Content]:
        now = view.now
        word, rest = messages.temperature(now["since_start_s"] if now else None, view.slope_k_per_min)
        link = Content("") if now is None else self._link(now, width)
        lines = self._showing(view) or self.line(" ", (word, "bold"), "  ", rest), link, self._recording(view, width)
        return [line.truncate(width) for line in lines]

    def _showing(self, view: View) -> Content | None:
        """The effect that shows most certainly in the residual, and how many more do; 4 Filter has all of them."""
        estimates = view.estimates
        said = [one["text"] for one in estimates["causes"] if one["shows"]] if estimates is not None else []
        if not said:
            return None
        more = f"  {len(said) - 1} more: 4 Filter, w" if len(said) > 1 else ""
        return self.line((f" {self.glyphs.text(said[0])}", "bold $text-warning"), more)

    def _link(self, now: Snapshot, width: int) -> Content:
        """Rate asked and measured, packets lost, wrong checksums, status word; of that its meaning if room is short."""
        lost, bad, measured = now["lost_packets_max"], now["bad_checksums"], now["measured_hz"]
        rates = f"asked {now['rate_hz']:g} measured {formatting.NOTHING if measured is None else f'{measured:.2f}'} Hz"
        counted = self.line(
            f" {rates}  ",
            (f"lost {messages.lost(now)}", "bold $text-warning" if lost else ""),
            "  ",
            (f"bad checksums {bad}", "bold $text-warning" if bad else ""),
        )
        status = now["status"]
        if counted.cell_length + len(f"  BIT {status}") > width:
            status = status.partition(" (")[2].removesuffix(")")
        return self.line(counted, (f"  BIT {status}" if status else "", "bold $text-warning"))

    def _recording(self, view: View, width: int) -> Content:
        """Name, size, samples and flush of the file, shorter where there is no room; or how to start."""
        now, recording = view.now, view.recording
        if recording is None:
            running = now is not None and now["state"] == "running"
            hint = " not recording: r writes every packet to a file, from then on" if running else ""
            return self.line((hint, "dim"))
        flushed = recording["flush_age_s"]
        marks = [formatting.plural(recording["marks"], "mark")] if width >= _ROOM_FOR_MARKS else []
        facts = "  ".join(
            (
                formatting.size(recording["bytes"]),
                formatting.plural(recording["samples"], "sample"),
                *marks,
                "not flushed yet" if flushed is None else f"flush {flushed:.1f} s ago",
            )
        )
        name = formatting.shorten(PurePath(recording["path"]).name, max(width - len(facts) - 4, 12))
        stale = flushed is not None and flushed > 3.0
        return self.line(" ", (name, "bold"), (f"  {facts}", "bold $text-error" if stale else ""))

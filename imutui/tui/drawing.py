"""Drawing: how much and how often, only the cells that changed, and all of it after somebody else has written."""

import os
import time
from collections import deque

from textual.driver import Driver

from imutui.session.snapshot import Snapshot
from imutui.tui import formatting
from imutui.tui.connection.poller import Poller
from imutui.tui.context import AppContext
from imutui.tui.terminal import textual_private
from imutui.tui.terminal.appearance import Appearance
from imutui.tui.terminal.driver import Terminal
from imutui.tui.terminal.pacing import Load, Pacing, PacingController, is_remote
from imutui.tui.terminal.painter import Painter


class Drawing:
    """Has the page in front drawn at the pace that the terminal keeps up with."""

    def __init__(self, context: AppContext, appearance: Appearance) -> None:
        self._context = context
        self.frames = FrameMonitor(PacingController(appearance.plot, appearance.fps, remote=is_remote(os.environ)))
        self.painter = Painter()
        textual_private.draw_through(context.app, self.painter.exact)
        context.connection.set_pacing(self.frames.pacing)

    def draw(self, event: Poller.Arrived) -> None:
        """Draw a snapshot if the terminal has taken the last one; only the page in front draws."""
        driver = textual_private.driver_of(self._context.app)
        draws = self.frames.admit(driver, event.snapshot, event.asked_at)
        self._context.connection.set_pacing(self.frames.pacing, self.frames.debug)
        if draws:
            self._context.redraw()

    def cycle_plots(self) -> None:
        self._context.connection.set_pacing(self.frames.controller.cycle(), self.frames.debug)
        self._context.redraw()

    def repaint(self, _: object = None) -> None:
        """Draw all of it: nothing of what was drawn is there any more."""
        self.painter.forget()
        for screen in self._context.app.screen_stack:
            screen.refresh(layout=True)
            for widget in screen.walk_children():
                widget.refresh()


_WINDOW_S = 2.0
_MOST_QUEUED = 2
_REST_S = 0.1


class FrameMonitor:
    """Asks the terminal's driver, and tells what it takes to the pacing controller."""

    def __init__(self, controller: PacingController) -> None:
        self.controller = controller
        self.load = Load()
        self.debug = ""  # what the debug line says
        self._frames: deque[tuple[float, int, float]] = deque()
        self._sampled_at: float | None = None
        self._age_s: float | None = None
        self._fresh_age_s: float | None = None
        self._drawn_at = 0.0

    @property
    def pacing(self) -> Pacing:
        return self.controller.pacing

    def admit(self, driver: Driver | None, snapshot: Snapshot, asked_at: float) -> bool:
        """A snapshot has come; returns whether it should be drawn.

        A terminal that still chews on the last frame gets none: drawing into a full queue would stop the UI, and
        what it would show, once it is through, would be old.

        `driver`: of the terminal; one that does not measure is taken as one that keeps up.
        `asked_at`: when the snapshot was asked for, monotonic, s.
        """
        now = time.monotonic()
        if isinstance(driver, Terminal):
            self._finish(driver)
            driver.probe()
            self.load = driver.meter.load(driver.queue)
        self.controller.judge(now, self.load)
        draws = self.load.queue <= _MOST_QUEUED and self.load.stuck_s < _REST_S
        if draws:
            silent = snapshot["silent_s"]
            self._sampled_at = None if silent is None else asked_at - silent
            self._drawn_at = now
            self._count(now, driver)
        self.debug = self._text(now)
        return draws

    def take_age(self) -> float | None:
        """Age of the newest sample of the last frame that was written, s; each frame's once, at most so old."""
        age, self._fresh_age_s = self._fresh_age_s, None
        return age

    def _finish(self, driver: Terminal) -> None:
        """The last frame has been written, or not yet."""
        written = driver.meter.written_at
        if self._sampled_at is not None and written > self._drawn_at:
            self._age_s = self._fresh_age_s = written - self._sampled_at
            self._sampled_at = None

    def _count(self, now: float, driver: Driver | None) -> None:
        sent = driver.meter.bytes if isinstance(driver, Terminal) else 0
        self._frames.append((now, sent, time.process_time()))
        while now - self._frames[0][0] > _WINDOW_S:
            self._frames.popleft()

    def _text(self, now: float) -> str:
        """Frames and bytes sent a second, processor, age, queue, mode; with room, how soon the terminal answers."""
        if len(self._frames) < 2:
            return "measuring"
        (t0, bytes0, cpu0), (t1, bytes1, cpu1) = self._frames[0], self._frames[-1]
        lasted = max(t1 - t0, 1e-9)
        age = None if self._age_s is None else 1e3 * self._age_s
        trip = self.load.round_trip_s
        parts = [
            f"{(len(self._frames) - 1) / lasted:4.1f} fps",
            f"{(bytes1 - bytes0) / lasted / 1e3:6.1f} kB/s",
            f"CPU {100 * (cpu1 - cpu0) / lasted:3.0f} %",
            f"sample {formatting.number(age, 4, 0)} ms old",
            f"queue {self.load.queue:2d}",
            f"auto {self.pacing.mode}" if self.controller.wish == "auto" else self.pacing.mode,
            *([f"answers in {1e3 * trip:4.0f} ms"] if trip is not None else []),
        ]
        return "  ".join(parts)

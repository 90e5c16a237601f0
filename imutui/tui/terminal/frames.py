"""Frame after frame: may it be drawn, what did the last one cost, how old was its newest sample when it was sent."""

import time
from collections import deque

from textual.driver import Driver

from imutui.session.snapshot import Snapshot
from imutui.tui import formatting
from imutui.tui.terminal.driver import Measured
from imutui.tui.terminal.pacing import Load, Pacing, PacingController

_WINDOW_S = 2.0
_MOST_QUEUED = 2
_REST_S = 0.1


class FrameMonitor:
    """Asks the terminal's driver, and tells what it takes to the pacing controller.

    `controller`: decides what is drawn.
    """

    def __init__(self, controller: PacingController) -> None:
        self.controller = controller
        self.load = Load()
        self.debug = ""
        """What the debug line says."""
        self._frames: deque[tuple[float, int, float]] = deque()
        self._sampled_at: float | None = None
        self._age_s: float | None = None
        self._fresh_age_s: float | None = None
        self._drawn_at = 0.0

    @property
    def pacing(self) -> Pacing:
        """What is drawn now."""
        return self.controller.pacing

    def admit(self, driver: Driver | None, snapshot: Snapshot, asked_at: float) -> bool:
        """A snapshot has come; returns whether it should be drawn.

        A terminal that still chews on the last frame gets none: drawing into a full queue would stop the UI, and
        what it would show, once it is through, would be old.

        `driver`: of the terminal; one that does not measure is taken as one that keeps up.
        `snapshot`: the data.
        `asked_at`: when it was asked for, monotonic, s.
        """
        now = time.monotonic()
        if isinstance(driver, Measured):
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

    def _finish(self, driver: Measured) -> None:
        """The last frame has been written, or not yet."""
        written = driver.meter.written_at
        if self._sampled_at is not None and written > self._drawn_at:
            self._age_s = self._fresh_age_s = written - self._sampled_at
            self._sampled_at = None

    def _count(self, now: float, driver: Driver | None) -> None:
        sent = driver.meter.bytes if isinstance(driver, Measured) else 0
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

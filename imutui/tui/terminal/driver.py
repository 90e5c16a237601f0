"""The terminal as Textual's drivers write to it: counted, timed, and noticed when it is gone."""

import contextlib
import os
import select
import signal
import threading
import time
from collections import deque
from typing import IO, TYPE_CHECKING, Any

from textual import messages
from textual.message import Message

from imutui.tui.terminal import textual_private
from imutui.tui.terminal.pacing import Load
from imutui.tui.terminal.textual_private import LinuxDriver

if TYPE_CHECKING:
    from textual.app import App

_WINDOW_S = 1.0
_PROBE = "\x1b[?2026$p"
_PROBE_EVERY_S = 1.0
_LEAVE_S = 1.5
# of a terminal that is gone nothing is left to put in order
_GONE_S = 0.5
_HANGUP = 128 + signal.SIGHUP


class Meter:
    """What was written, and how long it took."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.bytes = 0  # bytes written so far
        self.written_at = time.monotonic()  # when the last write ended
        self._writes: deque[tuple[float, float]] = deque()
        self._began: float | None = None
        self._answers, self._open = False, False
        self._asked_at = 0.0
        self._round_trip_s: float | None = None

    def begin(self) -> None:
        with self._lock:
            self._began = time.monotonic()

    def end(self, count: int) -> None:
        """Note that the write has ended, and how many bytes it took."""
        with self._lock:
            self.written_at = time.monotonic()
            if self._began is not None:
                self._writes.append((self._began, self.written_at))
            self._began = None
            self.bytes += count

    def ask(self) -> bool:
        """Whether the terminal should be asked now if it has read so far; if so, it counts as asked."""
        with self._lock:
            now = time.monotonic()
            if not self._answers or self._open or now - self._asked_at < _PROBE_EVERY_S:
                return False
            self._asked_at, self._open = now, True
            return True

    def answered(self) -> bool:
        """The terminal has read what was written before it was asked; False if nothing was asked."""
        with self._lock:
            open_, self._open, self._answers = self._open, False, True
            if open_:
                self._round_trip_s = time.monotonic() - self._asked_at
            return open_

    def load(self, queue: int) -> Load:
        """How the terminal takes what it is sent."""
        with self._lock:
            now = time.monotonic()
            while self._writes and self._writes[0][1] < now - _WINDOW_S:
                self._writes.popleft()
            stuck = now - self._began if self._began is not None else 0.0
            busy = sum(end - max(start, now - _WINDOW_S) for start, end in self._writes) + min(stuck, _WINDOW_S)
            return Load(busy / _WINDOW_S, stuck, queue, self._late(now))

    def _late(self, now: float) -> float | None:
        """Last round trip, or that of the question that is still open, if that is longer."""
        if self._round_trip_s is None or not self._open:
            return self._round_trip_s
        return max(self._round_trip_s, now - self._asked_at)


class Output:
    """Stands for the terminal's file: counts, and stays calm when the terminal is gone."""

    def __init__(self, file: IO[str], meter: Meter) -> None:
        self._file = file
        self._meter = meter

    def write(self, text: str) -> None:
        """Write all of it; nothing if nobody is there."""
        data = text.encode("utf-8", "replace")
        self._meter.begin()
        # The terminal has gone: whoever leaves now still writes its farewell, and must not stop over it.
        with contextlib.suppress(OSError):
            rest = memoryview(data)
            while rest:
                rest = rest[os.write(self._file.fileno(), rest) :]
        self._meter.end(len(data))

    def flush(self) -> None:
        pass

    def fileno(self) -> int:
        return self._file.fileno()

    def isatty(self) -> bool:
        return self._file.isatty()


class Terminal(LinuxDriver):
    """Textual's driver, measured; leaves when the terminal does.

    Textual reads an end of file again and again, with all of one processor: so the hang-up is waited for apart.
    """

    def __init__(self, app: "App[Any]", **arguments: Any) -> None:
        super().__init__(app, **arguments)
        self.meter = Meter()
        self._application = app
        textual_private.replace_output(self, lambda file: Output(file, self.meter))
        self._gone = threading.Event()
        self._closed = threading.Event()

    @property
    def queue(self) -> int:
        return textual_private.queued(self)

    def probe(self) -> None:
        """Ask the terminal for a sign of life, now and then; one that does not know the question is never late."""
        if self.meter.ask():
            self.write(_PROBE)

    @property
    def is_gone(self) -> bool:
        """Whether the terminal has gone away, so that nobody waits for what is still done."""
        return self._gone.is_set() and self._has_hung_up(0)

    def process_message(self, message: Message) -> None:
        """Pass on what comes from the terminal; answers to `probe` are for the meter."""
        if isinstance(message, messages.TerminalSupportsSynchronizedOutput) and self.meter.answered():
            return
        super().process_message(message)

    def start_application_mode(self) -> None:
        super().start_application_mode()  # type: ignore[no-untyped-call]
        signal.signal(signal.SIGHUP, lambda *_: self._hang_up())
        if textual_private.is_watchable(self) and self.input_tty:
            threading.Thread(target=self._watch, name="imutui-hangup", daemon=True).start()

    def run_input_thread(self) -> None:
        try:
            super().run_input_thread()
        except OSError:
            if not self._has_hung_up(0):
                raise
            self._hang_up()

    def close(self) -> None:
        self._closed.set()
        super().close()

    def _watch(self) -> None:
        while not self._closed.is_set() and not self._gone.is_set():
            if self._has_hung_up(500):
                self._hang_up()

    def _has_hung_up(self, timeout_ms: int) -> bool:
        poll = select.poll()
        poll.register(self.fileno, 0)
        return any(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL) for _, event in poll.poll(timeout_ms))

    def _hang_up(self) -> None:
        """Leave in order, and if that takes too long, leave."""
        if self._gone.is_set():
            return
        self._gone.set()
        textual_private.stop_reading(self)  # the end of file is not read again
        threading.Thread(target=self._leave, name="imutui-leave", daemon=True).start()
        self._application.post_message(messages.ExitApp())

    def _leave(self) -> None:
        if not self._closed.wait(_GONE_S if self.is_gone else _LEAVE_S):
            os._exit(_HANGUP)

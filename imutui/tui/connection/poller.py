"""Polls an acquisition from a thread and hands the newest snapshot to the UI.

What comes is posted, never handed over with `call_from_thread`: a frozen terminal blocks the event loop, nothing else.
The next poll waits until the UI has taken the last one, so nothing piles up behind a slow link.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from imutui.estimate_history import HistoryRows, HistorySnapshot
from imutui.session.client import Client, EndReport, SessionError, SessionGoneError
from imutui.session.plan import HistoryWish
from imutui.session.snapshot import Snapshot
from imutui.tui import messages
from imutui.tui.terminal.pacing import LOCAL_FPS

_PIECES = 30


class Poller:
    """A polling thread.

    `post`: takes `Arrived` and `Lost`, from any thread; False if nobody listens any more.
    `rate_hz`: polls per second; may be changed at any time.
    """

    @dataclass(frozen=True, slots=True)
    class Arrived:
        """A snapshot, and when it was asked for (monotonic, s); whoever handles it calls `poller.taken()`.

        `history` has pieces of the run's past that are new.
        """

        poller: "Poller"
        snapshot: Snapshot
        asked_at: float
        history: tuple[HistorySnapshot, ...] = ()

    @dataclass(frozen=True, slots=True)
    class Lost:
        """The acquisition does not answer any more; the poller has ended.

        `report` is what it left, if anything; `gone` says that its process is no more.
        """

        poller: "Poller"
        error: str
        report: EndReport | None = None
        gone: bool = False

    def __init__(self, client: Client, post: Callable[[Arrived | Lost], bool], rate_hz: float = LOCAL_FPS) -> None:
        self._client = client
        self._post = post
        self.rate_hz = rate_hz
        self._wish = HistoryWish()
        self._complete_at: int | None = None
        self._stop = threading.Event()
        self._taken = threading.Event()
        self._thread = threading.Thread(target=self._run, name="imutui-poller", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """Poll no more; a message under way is for nobody."""
        self._stop.set()
        self._taken.set()

    def taken(self) -> None:
        self._taken.set()

    def _run(self) -> None:
        since = 0
        while not self._stop.is_set():
            asked_at = time.monotonic()
            due = asked_at + 1.0 / self.rate_hz
            try:
                snapshot = self._client.snapshot(since)
                history = self._new_history(snapshot)
            except (SessionError, OSError) as error:
                if not self._stop.is_set():
                    gone = isinstance(error, SessionGoneError)
                    self._post(Poller.Lost(self, messages.fault(error), self._client.end(), gone))
                return
            since = int(snapshot["series"]["next"])
            self._taken.clear()
            if self._stop.is_set() or not self._post(Poller.Arrived(self, snapshot, asked_at, history)):
                return
            self._taken.wait()
            self._stop.wait(max(due - time.monotonic(), 0.0))

    def _new_history(self, snapshot: Snapshot) -> tuple[HistorySnapshot, ...]:
        """What is new of the run's past: once a second, as its rows are, and at first as much as a moment allows."""
        second = int(snapshot["since_start_s"])
        pieces: list[HistorySnapshot] = []
        while second != self._complete_at and len(pieces) < _PIECES:
            piece = self._client.history(self._wish)
            pieces.append(piece)
            before = self._wish if piece["run"] == self._wish.run else HistoryWish()
            self._wish = HistoryWish(
                piece["run"],
                _last(piece["estimates"], before.estimates_s),
                _last(piece["temperature"], before.temperature_s),
            )
            self._complete_at = second if piece["complete"] else None
        return tuple(pieces)


def _last(rows: HistoryRows, before: float | None) -> float | None:
    """Instant of the last row that has come."""
    return rows["t"][-1] if rows["t"] else before

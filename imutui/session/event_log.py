"""The last events and operator's marks of an acquisition, for viewers; the log file has all of them."""

import time
from collections import deque
from dataclasses import dataclass, replace

from imutui.session.snapshot import EventLine, MarkLine
from imutui.session.timebase import Timebase

INFORMATION, WARNING, ERROR = 20, 30, 40  # levels of events, as /rosout has them

_EVENTS = 20
_MARKS = 50


@dataclass(frozen=True, slots=True)
class OperatorMark:
    """What the operator said."""

    at_ns: int | None  # monotonic; None if it belongs to an earlier run of samples than the present one
    # utc, text: when, as a clock on the wall shows it, and what
    utc: str
    text: str


class EventLog:
    """Keeps the last 20 events and the last 50 marks.

    An event is now, or of when that came which is being handled (`handled_ns`, monotonic): what a packet tells is of
    its arrival. Later ones may have come meanwhile, and log time does not go back: where something was told while a
    packet was held, what that packet tells is of no earlier time.
    """

    def __init__(self, timebase: Timebase) -> None:
        self._timebase = timebase
        self.handled_ns: int | None = None
        self._last_ns = 0
        self._events: deque[EventLine] = deque(maxlen=_EVENTS)
        self._marks: deque[OperatorMark] = deque(maxlen=_MARKS)

    def add(self, name: str, text: str) -> int:
        """Take an event, or a mark if its name says so: "mark", or "remark" while the operator is guided.

        Returns when it is, monotonic, ns; never before the last one.
        """
        now_ns = self._last_ns = max(self._last_ns, time.monotonic_ns() if self.handled_ns is None else self.handled_ns)
        utc = time.strftime("%H:%M:%S", time.gmtime(self._timebase.utc_ns(now_ns) / 1e9))
        self._events.append({"utc": utc, "name": name, "text": text})
        if name in ("mark", "remark"):
            self._marks.append(OperatorMark(now_ns, utc, text))
        return now_ns

    def forget_mark_times(self) -> None:
        """Keep what was said, but not when: another run of samples begins, and the marks are at no time of it."""
        self._marks = deque((replace(mark, at_ns=None) for mark in self._marks), _MARKS)

    def clear_marks(self) -> None:
        """Forget the marks: another recording begins."""
        self._marks.clear()

    def events(self) -> list[EventLine]:
        """Events for viewers, oldest first."""
        return list(self._events)

    def marks(self, started_ns: int | None) -> list[MarkLine]:
        """Marks for viewers, oldest first, with times since `started_ns`, when the present run of samples began."""
        return [{"t": _seconds(mark.at_ns, started_ns), "utc": mark.utc, "text": mark.text} for mark in self._marks]


def _seconds(at_ns: int | None, started_ns: int | None) -> float | None:
    return None if at_ns is None or started_ns is None else max(0.0, (at_ns - started_ns) / 1e9)

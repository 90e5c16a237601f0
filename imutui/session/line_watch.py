"""What is to be said of the line and of the unit: away, silent, slower than asked; each second, and at the end."""

from collections.abc import Iterator
from dataclasses import dataclass

from imutui.instrument.clock import Stamp
from imutui.logbook import line_advice
from imutui.logbook.polled_rate import PolledRate
from imutui.logbook.session_info import SessionInfo
from imutui.session import exit_codes, reconnection, silence
from imutui.session.absence import Absence
from imutui.session.reconnection import LineLost, LineReturned, StillAway
from imutui.session.requests import EndFinding
from imutui.session.silence import SilenceMonitor
from imutui.session.snapshot import ReconnectingSnapshot
from imutui.session.timebase import Timebase


@dataclass(frozen=True, slots=True)
class LineState:
    """How the line stands."""

    silent_s: float  # since the last packet
    expected: bool  # whether no packet is expected now


class LineWatch:
    """Follows one acquisition's line.

    `info`: port, unit, sampling and rate.
    `timebase`: monotonic to UTC.
    `stream_hz`: packets a second that the unit sends where it streams, at most.
    """

    def __init__(self, info: SessionInfo, timebase: Timebase, stream_hz: float) -> None:
        self._info = info
        polled_hz = info.rate_hz if info.sampling == "polled" else None
        self._absence = Absence(timebase, polled_hz or stream_hz)
        self._silence = SilenceMonitor(1.0 / polled_hz if polled_hz else 0.0)
        self._ask_again_s = reconnection.ask_again_after_s(polled_hz)
        self._rate = PolledRate(info.rate_hz)
        self._rate_said = False

    @property
    def is_away(self) -> bool:
        """Whether the unit is waited for."""
        return self._absence.since_ns is not None

    def begin_recording(self) -> None:
        """Judge the rate of polling anew."""
        self._rate, self._rate_said = PolledRate(self._info.rate_hz), False

    def answered(self, requested_ns: int) -> None:
        """Take note of a poll that was answered."""
        self._rate.answered(requested_ns)

    def unanswered(self) -> None:
        """Take note of a poll that was not answered."""
        self._rate.unanswered()

    def interrupt(self) -> None:
        """Take note that nothing was asked for meanwhile."""
        self._rate.interrupt()

    def lost(self, event: LineLost) -> str:
        """The line is lost; returns what to say."""
        return self._absence.lost(event)

    def still_away(self, event: StillAway) -> str | None:
        """Something else is waited for; returns what to say, if there is anything new."""
        return self._absence.still(event)

    def returned(self, event: LineReturned, before_ns: int) -> None:
        """The unit is back; its first packet is awaited to say more. `before_ns` is the last stamp before."""
        self._absence.returned(event, before_ns)
        self._rate.interrupt()

    def back(self, stamp: Stamp) -> str | None:
        """A packet has come; returns what to say if it is the first one after the unit was away."""
        return self._absence.over(stamp)

    def is_to_be_asked(self, line: LineState) -> bool:
        """Whether the unit has been silent for so long that it has to be asked who it is."""
        return line.silent_s > self._ask_again_s and not line.expected and not self.is_away

    def each_second(self, line: LineState) -> Iterator[tuple[str, bool]]:
        """What is new, and whether it is a warning."""
        silent = None if self.is_away else self._silence.check(line.silent_s, expected=line.expected)
        if silent:
            yield f"no packets for {line.silent_s:.1f} s: {self._advice()}", True
        elif silent is not None:
            yield "packets again", False
        slow = self._rate.finding()
        if slow is not None and not self._rate_said:
            self._rate_said = True
            yield slow, True

    def at_the_end(self, now_ns: int, line: LineState | None) -> Iterator[tuple[EndFinding, bool]]:
        """What must be said when the acquisition ends, and whether that has been said before.

        `now_ns`: monotonic.
        `line`: as it was when the end was asked for; None if that is not to be judged.
        """
        slow = self._rate.finding()
        if slow is not None:
            yield {"exit_code": exit_codes.FINDINGS, "text": slow}, self._rate_said
        gone = self._absence.at_the_end(now_ns)
        if gone is not None:
            yield {"exit_code": exit_codes.INSTRUMENT, "text": gone}, False
        elif line is not None and not line.expected and self._silence.is_silent(line.silent_s):
            text = silence.at_the_end(line.silent_s, self._advice())
            yield {"exit_code": exit_codes.INSTRUMENT, "text": text}, False

    def snapshot(self, now_ns: int) -> ReconnectingSnapshot | None:
        """What is waited for, for viewers; None while the unit is there."""
        return self._absence.snapshot(now_ns)

    def _advice(self) -> str:
        return line_advice.of_silence(self._info.port, self._info.firmware)

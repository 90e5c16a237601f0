"""Polling: a packet for each request, every answer told apart from the next one's however late it comes.

The unit answers one thing after the other. So when an answer is late, the unit is told once more to measure in scaled
mode, which it does already: that it says so (`C`) means that no answer to an earlier request comes any more. Until
then nothing else is asked for, and a poll counts as lost only when its answer certainly did not come.
"""

import math
import time
from collections.abc import Callable

from imutui.instrument.discarded import Discarded
from imutui.instrument.host import Answer
from imutui.instrument.imu400.crossbow import Decoder, Event, GetPacket, Mode, Packet, SetMode, encode
from imutui.instrument.imu400.messages import REPLY_LETTERS, ModeSet
from imutui.instrument.port import Port

_LEAST_PATIENCE_S = 0.1
_MOST_PATIENCE_S = 2.0
_NOTHING_CAME_S = 0.5
_REST_S = 0.3
_LETTER = REPLY_LETTERS[ModeSet(Mode.SCALED)]


class Poller:
    """Asks a unit for one packet at a time.

    `port`: of a unit that is polled, in scaled mode.
    `giving_up`: whether to wait no longer for what has not come.
    `unanswered`: whether the last request was sent and has no answer; also after an error of the line.
    """

    def __init__(self, port: Port, giving_up: Callable[[], bool]) -> None:
        self._port = port
        self._giving_up = giving_up
        self._decoder = Decoder()
        self._patience_s = _LEAST_PATIENCE_S
        self._stray_bytes = 0
        self.unanswered = False
        self._letters = 0

    @property
    def bad_checksums(self) -> int:
        """Answers that came damaged."""
        return self._decoder.bad_checksums

    @property
    def discarded_bytes(self) -> int:
        """Bytes that belonged to no answer."""
        return self._decoder.discarded_bytes - self._letters + self._stray_bytes

    def poll(self) -> Answer | None:
        """Ask for a packet and wait for it; None if it certainly does not come, or is waited for no longer.

        Raises PortError if the line goes away.
        """
        self.unanswered = False
        # what waits here came before the request, so it is no answer to it
        while waiting := self._port.waiting():
            self._stray_bytes += len(self._port.read(waiting).strip(_LETTER))
        self._decoder.expect_packets(Mode.SCALED, streaming=False)
        requested_ns = time.monotonic_ns()
        self._port.write(encode(GetPacket()))
        self.unanswered = True
        answer = self._await_packet(requested_ns) or self._await_certainty(requested_ns)
        self.unanswered = answer is None
        if answer is not None:
            # a unit that is slow by nature is not asked twice each time
            late_s = 2e-9 * (answer.arrived_ns - requested_ns)
            self._patience_s = min(max(_LEAST_PATIENCE_S, late_s, 0.5 * self._patience_s), _MOST_PATIENCE_S)
        return answer

    def _await_packet(self, requested_ns: int) -> Answer | None:
        """The answer if it comes as soon as answers do."""
        deadline = time.monotonic() + self._patience_s
        while True:
            data = self._port.read(self._decoder.missing)
            answer = _first(self._decoder.feed(data), requested_ns)
            # a host that was held up looks once more: it may have come long ago
            if answer is not None or (not data and (time.monotonic() > deadline or self._giving_up())):
                return answer

    def _await_certainty(self, requested_ns: int) -> Answer | None:
        """The late answer, or None once it is certain that it does not come."""
        answer, asked, said = None, 0, 0
        came, since = False, -math.inf
        while not self._giving_up():
            now = time.monotonic()
            if not came and now - since > _NOTHING_CAME_S:
                self._port.write(encode(SetMode(Mode.SCALED)))
                asked, since = asked + 1, now
            data = self._port.read(self._decoder.missing)
            rested = came and not data and time.monotonic() - since > _REST_S
            events = self._decoder.feed(data) if data else self._decoder.quiet() if rested else []
            if data:
                came, since = True, time.monotonic()
            answer = answer or _first(events, requested_ns)
            said += self._count_letters(events)
            # a letter that did not come with the others is lost, and so it is where only the packet came
            if said >= asked or (rested and (said or answer is not None)):
                break
            if rested:  # damaged bytes, and the letter perhaps among them: once more
                asked, came, since = 0, False, -math.inf
        return answer

    def _count_letters(self, events: list[Event]) -> int:
        """How often the unit said that its mode is set, where it said nothing else at that."""
        said = [event.data for event in events if isinstance(event, Discarded)]
        count = sum(len(data) for data in said if not data.strip(_LETTER))
        self._letters += count
        return count


def _first(events: list[Event], requested_ns: int) -> Answer | None:
    arrived_ns = time.monotonic_ns()
    return next((Answer(event, requested_ns, arrived_ns) for event in events if isinstance(event, Packet)), None)

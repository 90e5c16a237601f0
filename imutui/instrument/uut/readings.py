"""Packets of a 440, 380 or 381 as the session takes them: from a stream, or asked for one by one."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from imutui.instrument.discarded import Discarded
from imutui.instrument.host import Answer, PacketDetails
from imutui.instrument.port import Port, PortError
from imutui.instrument.uut.decoder import Decoder
from imutui.instrument.uut.messages import Event, GetPacket, Memory, PacketS0, PacketS1, Ping, Refused, Triple
from imutui.instrument.uut.payloads import SET, encode

_ANSWER = encode(Ping())
_LEAST_PATIENCE_S, _MOST_PATIENCE_S = 0.1, 2.0


@dataclass(frozen=True, slots=True)
class DataPacket:
    """See `host.DataPacket`; the temperature is that of the X rate sensor."""

    rates: Triple
    accels: Triple
    temperature: int
    ticks: int
    status: int  # the word that the manuals call BIT
    source: PacketS0 | PacketS1  # the packet with all its fields

    @property
    def details(self) -> PacketDetails:
        """Temperatures of all rate sensors and of the board, and the status word."""
        return PacketDetails(self.source.rate_temperatures, self.source.board_temperature, self.status)


def reading_of(event: Event) -> DataPacket | None:
    """What the session takes of an event; None if it is no such packet."""
    if isinstance(event, PacketS1):
        ticks = event.counter
    elif isinstance(event, PacketS0):
        ticks = event.time
    else:
        return None
    return DataPacket(event.rates, event.accels, event.rate_temperatures[0], ticks, event.bit, event)


class Packets:
    """Packets of a stream; see `host.PacketStream`.

    `refused`: what to say if the unit refuses what was set last.
    """

    def __init__(self, refused: str) -> None:
        self._decoder = Decoder()
        self._refused = refused
        self._newest = b""
        self.answers = 0

    def feed(self, data: bytes) -> Sequence[DataPacket | Discarded]:
        """Take bytes from the line; raises PortError if the unit refuses to stream."""
        found = self._packets(self._decoder.feed(data))
        # by its bytes: behind a packet that was cut off the decoder waits for that one's end
        self._newest += data
        answers = self._newest.count(_ANSWER)
        self.answers = answers + (0 if any(not isinstance(one, Discarded) for one in found) else self.answers)
        self._newest = self._newest[self._newest.rfind(_ANSWER) + len(_ANSWER) if answers else 0 :][1 - len(_ANSWER) :]
        return found

    def pause(self) -> Sequence[DataPacket | Discarded]:
        """Take note that the line is quiet for the moment."""
        return self._packets(self._decoder.pause())

    def quiet(self) -> Sequence[DataPacket | Discarded]:
        """Take note that nothing follows."""
        return self._packets(self._decoder.quiet())

    @property
    def missing(self) -> int:
        """Bytes still needed to complete the next packet."""
        return self._decoder.missing

    @property
    def bad_checksums(self) -> int:
        """Frames that were due and came damaged."""
        return self._decoder.bad_checksums

    @property
    def discarded_bytes(self) -> int:
        """Bytes that belonged to no frame."""
        return self._decoder.discarded_bytes

    def _packets(self, events: list[Event]) -> list[DataPacket | Discarded]:
        found: list[DataPacket | Discarded] = []
        for event in events:
            packet = event if isinstance(event, Discarded) else reading_of(event)
            if packet is not None:
                found.append(packet)
            if isinstance(event, Refused) and event.type == SET[Memory.RAM]:
                raise PortError(self._refused)
        return found


class Poller:
    """Asks a unit that is quiet for one packet S1 at a time; see `host.Poller`.

    Nothing in a packet says which request it answers, but a unit answers in order. So one that comes before the next
    request, or before the answer to a ping that follows an unanswered one, belongs to an earlier request, and counts
    for nothing.

    `port`: at the unit's speed.
    `giving_up`: whether to wait no longer for what has not come.
    """

    def __init__(self, port: Port, giving_up: Callable[[], bool]) -> None:
        self._port = port
        self._giving_up = giving_up
        self._decoder = Decoder()
        self._patience_s = _LEAST_PATIENCE_S
        self._is_behind = False
        self.unanswered = False

    @property
    def bad_checksums(self) -> int:
        """Answers that came damaged."""
        return self._decoder.bad_checksums

    @property
    def discarded_bytes(self) -> int:
        """Bytes that belonged to no answer."""
        return self._decoder.discarded_bytes

    def poll(self) -> Answer | None:
        """Ask for a packet and wait for it; None if it does not come, or is waited for no longer."""
        self.unanswered = False
        while waiting := self._port.waiting():
            self._decoder.feed(self._port.read(waiting))
        if self._is_behind:
            self._port.write(encode(Ping()))
            self.unanswered = self._await(Ping) is None
            if self.unanswered:
                return None
        requested_ns = time.monotonic_ns()
        self._port.write(encode(GetPacket(b"S1")))
        self.unanswered = self._is_behind = True
        found = self._await(PacketS1)
        self.unanswered = self._is_behind = found is None
        if found is None:
            # the answer may be late: the next one is waited for longer
            self._patience_s = min(2.0 * self._patience_s, _MOST_PATIENCE_S)
            return None
        event, arrived_ns = found
        late_s = 2e-9 * (arrived_ns - requested_ns)
        self._patience_s = min(max(_LEAST_PATIENCE_S, late_s, 0.5 * self._patience_s), _MOST_PATIENCE_S)
        packet = reading_of(event)
        return None if packet is None else Answer(packet, requested_ns, arrived_ns)

    def _await(self, kind: type[Ping] | type[PacketS1]) -> tuple[Event, int] | None:
        """The next event of a kind, and when it had been read, monotonic ns; None if it does not come."""
        deadline = time.monotonic() + self._patience_s
        while True:
            data = self._port.read(self._decoder.missing)
            arrived_ns = time.monotonic_ns()
            for event in self._decoder.feed(data) if data else self._decoder.pause():
                if isinstance(event, kind):
                    return event, arrived_ns
            if not data and (time.monotonic() > deadline or self._giving_up()):
                return None

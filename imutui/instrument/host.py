"""What an instrument's host side is to the session, and what all of them do alike.

A host is the only one who writes to the port. It may block, and knows what is sent and what is answered; whoever uses
it knows packets only. `imu400.host` and its like fulfil this.
"""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from imutui.instrument.counter_spec import CounterSpec
from imutui.instrument.counts import DataPacket
from imutui.instrument.frame_search import Discarded, EventT, FrameDecoder
from imutui.instrument.port import Port

QUICK_S = 0.4
"""How long units take at most for a reply, but for those that are slow."""
PATIENCE_S = 2.0
"""How long a unit that is slow may take."""

_LEAST_PATIENCE_S = 0.1
_NOTHING_CAME_S = 0.5
_REST_S = 0.3

PacketStream: TypeAlias = FrameDecoder[DataPacket]


class InstrumentError(Exception):
    """The instrument is not there, is another one, or does not behave; the message says what to do next."""


@dataclass(frozen=True, slots=True)
class Identity:
    """What the unit says of itself."""

    # serial_number, version: empty where it did not answer
    serial_number: str
    version: str
    source: str = ""  # where a virtual unit's readings come from, if it says so
    slowest_reply_s: float = field(default=0.0, compare=False)  # how long it took for the slowest of its answers
    # how it was configured when it was found, in words; empty of units that do not say
    configuration: str = field(default="", compare=False)
    # how its packets' axes lie in its case as it is configured, as `filters.imu.parse_mount` reads it; empty of units
    # that do not say
    own_mount: str = field(default="", compare=False)


class Host(ABC):
    """Speaks with one unit over one port. Every method raises PortError if the line goes away.

    `port`: open.
    """

    as_after_power_up: str
    """How a unit that forgot how it was set up shows it, in words."""
    streams_from_power_up = False
    """Whether a unit sends as soon as it has power: that it sends does not say that it kept it."""
    counter: CounterSpec
    """What the packets' counter counts."""
    stream_hz = 0.0
    """Packets a second that the unit was told to stream; 0 where it can't be told."""

    def __init__(self, port: Port) -> None:
        self.port = port

    @abstractmethod
    def find(self) -> Identity:
        """Find the unit's speed and ask who it is, and no more; raises InstrumentError if it is not there."""

    @abstractmethod
    def answers(self, baud: int | None = None) -> bool:
        """Whether such a unit answers, asked briefly: at one speed, or at any that it may have.

        Another kind of unit at that speed makes nothing of the question. One at another speed hears other bytes than
        were sent, and may take them for commands.
        """

    def check_model(self, identity: Identity) -> None:  # noqa: B027 - most refuse none
        """Refuse, with InstrumentError, a unit whose ranges and packets are others."""

    @abstractmethod
    def open(
        self,
        baud: int | None,
        *,
        accept: Callable[[Identity], None] = lambda identity: None,
        thorough: bool = True,
        patience_s: float = PATIENCE_S,
    ) -> Identity:
        """Find the unit, identify it, and set it up; it sends nothing by itself afterwards.

        `baud`: wanted speed; None to leave the unit at its own, where its kind has one.
        `accept`: raises InstrumentError to refuse a unit, before anything of it is changed for longer.
        `thorough`: whether to look for it at every speed.
        `patience_s`: how long a reply may take.
        Raises InstrumentError if nothing answers, garbage answers, or another model does.
        """

    @abstractmethod
    def start(self) -> None:
        """Have the unit stream."""

    @abstractmethod
    def stop(self) -> None:
        """Have it send nothing by itself."""

    def leave(self) -> str:
        """Stop, and leave the unit as it was found, as far as something was changed.

        Returns what the unit does not take back, in words; "" if it is as it was.
        """
        self.stop()
        return ""

    @abstractmethod
    def packets(self) -> PacketStream:
        """What makes packets of the stream's bytes."""

    @abstractmethod
    def poller(self, giving_up: Callable[[], bool]) -> "Poller":
        """What asks for packets one by one, and waits no longer once it is told to give up."""

    @abstractmethod
    def ask_for_life(self) -> None:
        """Write what any unit of the kind answers, without waiting: for one that has fallen silent."""

    def ask_amid(self, identity: Identity) -> None:  # noqa: B027 - some have no such thing
        """Write, without waiting, what a unit answers and streams on; its stream counts the answers."""

    def may_have_forgotten(self, packet: DataPacket) -> bool:
        """Whether a packet alone leaves open that the unit forgot how it was set up."""
        return False

    @abstractmethod
    def has_forgotten(self, packet: DataPacket, before: DataPacket, elapsed_s: float | None = None) -> bool:
        """Whether a packet, after one that was right, shows that the unit forgot how it was set up, or is another.

        It arrived `elapsed_s` after the last packet that had it; None if an arrival does not say when it was sent.
        """

    @abstractmethod
    def set_up(self) -> bool:
        """Set a unit on a quiet line up anew; whether it says that it is."""

    def zero(self, argument: int, stopping: Callable[[], bool]) -> float | None:
        """Have the rate sensors zeroed; seconds until the unit said so, None if it did not, or has no such command."""
        return None


def await_event(
    port: Port, decoder: FrameDecoder[EventT], wanted: Callable[[EventT | Discarded], bool], patience_s: float
) -> EventT | Discarded | None:
    """Read until something comes that is wanted, and return that; None if it does not come in time."""
    began = time.monotonic()
    while time.monotonic() - began < patience_s:
        data = port.read(decoder.missing)
        for event in decoder.feed(data) if data else decoder.pause():
            if wanted(event):
                return event
    return None


@dataclass(frozen=True, slots=True)
class Answer:
    """A packet that was asked for: when it was, and when its last byte had been read, monotonic ns."""

    packet: DataPacket
    requested_ns: int
    arrived_ns: int


class Poller:
    """Asks a unit for one packet at a time, every answer told apart from the next one's however late it comes.

    The unit answers one thing after the other. So when an answer is late, the unit is asked something else that changes
    nothing: that it answers that means that no answer to an earlier request comes any more. Until then nothing else is
    asked for, and a poll counts as lost only when its answer certainly did not come.

    `port`: of a unit that is set up, at its own speed, and sends nothing by itself.
    `giving_up`: whether to wait no longer for what has not come.
    `decoder`: makes events of what the unit sends.
    `request`: asks for a packet, and the class of that.
    `check`: asks for something else, and the class of the answer.
    """

    def __init__(
        self,
        port: Port,
        giving_up: Callable[[], bool],
        decoder: FrameDecoder[Any],
        request: tuple[bytes, type[DataPacket]],
        check: tuple[bytes, type],
    ) -> None:
        self._port = port
        self._giving_up = giving_up
        self._decoder = decoder
        self._request, self._packet = request
        self._check, self._checked = check
        self._patience_s = _LEAST_PATIENCE_S
        self._stray_bytes = 0
        self._heard = b""  # the last answer, if nothing else came with it
        self.doubled = 0
        """Answers that came a second time."""
        self.unanswered = False
        """Whether the last request was sent and has no answer; also after an error of the line."""

    @property
    def bad_checksums(self) -> int:
        """Answers that came damaged."""
        return self._decoder.bad_checksums

    @property
    def discarded_bytes(self) -> int:
        """Bytes that belonged to no answer."""
        return self._decoder.discarded_bytes + self._stray_bytes

    def poll(self) -> Answer | None:
        """Ask for a packet and wait for it; None if it certainly does not come, or is waited for no longer.

        Raises PortError if the line goes away.
        """
        self.unanswered = False
        # what waits here came before the request, so it is no answer to it
        while waiting := self._port.waiting():
            self._take_stray(self._port.read(waiting))
        self._decoder.quiet()
        self._heard = b""
        requested_ns = time.monotonic_ns()
        self._port.write(self._request)
        self.unanswered = True
        answer = self._await_packet(requested_ns) or self._await_certainty(requested_ns)
        self.unanswered = answer is None
        if answer is not None:
            # a unit that is slow by nature is not asked twice each time
            late_s = 2e-9 * (answer.arrived_ns - requested_ns)
            self._patience_s = min(max(_LEAST_PATIENCE_S, late_s, 0.5 * self._patience_s), PATIENCE_S)
        return answer

    def _take_stray(self, data: bytes) -> None:
        """Take what came between an answer and the next request: the same answer again, or noise."""
        again = len(data) // len(self._heard) if self._heard else 0
        if again and data == again * self._heard:
            self.doubled += again
        else:
            self._stray_bytes += len(self._stray(data))

    def _await_packet(self, requested_ns: int) -> Answer | None:
        """The answer if it comes as soon as answers do."""
        deadline = time.monotonic() + self._patience_s
        while True:
            data = self._port.read(self._decoder.missing)
            self._heard += data
            answer = self._first(self._decoder.feed(data) if data else self._decoder.pause(), requested_ns)
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
                self._port.write(self._check)
                asked, since = asked + 1, now
            data = self._port.read(self._decoder.missing)
            rested = came and not data and time.monotonic() - since > _REST_S
            events = self._decoder.feed(data) if data else self._decoder.quiet() if rested else []
            if data:
                came, since = True, time.monotonic()
            answer = answer or self._first(events, requested_ns)
            said += self._count_checks(events)
            # an answer that did not come with the others is lost, and so it is where only the packet came
            if said >= asked or (rested and (said or answer is not None)):
                break
            if rested:  # damaged bytes, and what was asked for perhaps among them: once more
                asked, came, since = 0, False, -math.inf
        return answer

    def _first(self, events: Sequence[Any], requested_ns: int) -> Answer | None:
        arrived_ns = time.monotonic_ns()
        packets = (Answer(event, requested_ns, arrived_ns) for event in events if isinstance(event, self._packet))
        return next(packets, None)

    def _stray(self, data: bytes) -> bytes:
        """What of bytes that came before a request counts as noise."""
        return data

    def _count_checks(self, events: Sequence[Any]) -> int:
        """How often the unit has answered what was asked besides."""
        return sum(isinstance(event, self._checked) for event in events)

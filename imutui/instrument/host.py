"""What an instrument's host side is to the session: the protocols that every member's room fulfils.

A host is the only one who writes to the port. It may block, and knows what is sent and what is answered; whoever uses
it knows packets only. `imu400.host` and its like fulfil this.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from imutui.instrument.counter_spec import CounterSpec
from imutui.instrument.discarded import Discarded
from imutui.instrument.identity import Identity
from imutui.instrument.port import Port

QUICK_S = 0.4
"""How long units take at most for a reply, but for those that are slow."""
PATIENCE_S = 2.0
"""How long a unit that is slow may take."""

Triple: TypeAlias = tuple[int, int, int]


class InstrumentError(Exception):
    """The instrument is not there, is another one, or does not behave; the message says what to do next."""


@dataclass(frozen=True, slots=True)
class PacketDetails:
    """What packets of some units have beside their readings, in counts."""

    rate_temperatures: Triple  # of the rate sensors X, Y, Z
    board_temperature: int
    status: int  # the unit's status word, 16 bits


class DataPacket(Protocol):
    """One set of readings, in counts, in the instrument's own axes and signs."""

    @property
    def rates(self) -> Triple:
        """X, Y, Z."""
        ...

    @property
    def accels(self) -> Triple:
        """X, Y, Z."""
        ...

    @property
    def temperature(self) -> int:
        """The one that the samples have."""
        ...

    @property
    def ticks(self) -> int:
        """The packet's counter, 0 to 65535."""
        ...

    @property
    def details(self) -> PacketDetails | None:
        """What else it has; None of units whose packets have no more."""
        ...


@dataclass(frozen=True, slots=True)
class Answer:
    """A packet that was asked for: when it was, and when its last byte had been read, monotonic ns."""

    packet: DataPacket
    requested_ns: int
    arrived_ns: int


class PacketStream(Protocol):
    """Bytes of a stream in, packets out; no I/O."""

    def feed(self, data: bytes) -> Sequence[DataPacket | Discarded]:
        """Take bytes from the line."""
        ...

    def pause(self) -> Sequence[DataPacket | Discarded]:
        """Take note that the line is quiet for the moment, while the stream is expected to go on."""
        ...

    def quiet(self) -> Sequence[DataPacket | Discarded]:
        """Take note that nothing follows."""
        ...

    @property
    def answers(self) -> int:
        """Answers to `Host.ask_amid` since the last packet."""
        ...

    @property
    def missing(self) -> int:
        """Bytes still needed to complete the next packet."""
        ...

    @property
    def bad_checksums(self) -> int:
        """Packets that were due and came damaged."""
        ...

    @property
    def discarded_bytes(self) -> int:
        """Bytes that belonged to no packet and no reply."""
        ...


class Poller(Protocol):
    """Asks a unit for one packet at a time."""

    @property
    def unanswered(self) -> bool:
        """Whether the last request was sent and has no answer; also after an error of the line."""
        ...

    @property
    def bad_checksums(self) -> int:
        """Answers that came damaged."""
        ...

    @property
    def discarded_bytes(self) -> int:
        """Bytes that belonged to no answer."""
        ...

    def poll(self) -> Answer | None:
        """Ask for a packet and wait for it; None if it certainly does not come. Raises PortError."""
        ...


class Host(Protocol):
    """Speaks with one unit over one port. Every method raises PortError if the line goes away."""

    @property
    def port(self) -> Port:
        """The port."""
        ...

    @property
    def counter(self) -> CounterSpec:
        """What the packets' counter counts."""
        ...

    @property
    def stream_hz(self) -> float:
        """Packets a second that the unit was told to stream; 0 where it can't be told."""
        ...

    @property
    def as_after_power_up(self) -> str:
        """How a unit that forgot how it was set up shows it, in words."""
        ...

    @property
    def streams_from_power_up(self) -> bool:
        """Whether a unit sends as soon as it has power: that it sends does not say that it kept it."""
        ...

    def find(self) -> Identity:
        """Find the unit's speed and ask who it is, and no more; raises InstrumentError if it is not there."""
        ...

    def answers(self, baud: int | None = None) -> bool:
        """Whether such a unit answers, asked briefly: at one speed, or at any that it may have.

        Another kind of unit at that speed makes nothing of the question. One at another speed hears other bytes than
        were sent, and may take them for commands.
        """
        ...

    def check_model(self, identity: Identity) -> None:
        """Refuse, with InstrumentError, a unit whose ranges and packets are others."""
        ...

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
        ...

    def start(self) -> None:
        """Have the unit stream."""
        ...

    def stop(self) -> None:
        """Have it send nothing by itself."""
        ...

    def leave(self) -> str:
        """Stop, and leave the unit as it was found, as far as something was changed.

        Returns what the unit does not take back, in words; "" if it is as it was.
        """
        ...

    def packets(self) -> PacketStream:
        """What makes packets of the stream's bytes."""
        ...

    def poller(self, giving_up: Callable[[], bool]) -> Poller:
        """What asks for packets one by one, and waits no longer once it is told to give up."""
        ...

    def ask_for_life(self) -> None:
        """Write what any unit of the kind answers, without waiting: for one that has fallen silent."""
        ...

    def ask_amid(self, packets: PacketStream, identity: Identity) -> None:
        """Write, without waiting, what a unit answers and streams on; nothing where there is no such thing."""
        ...

    def may_have_forgotten(self, packet: DataPacket) -> bool:
        """Whether a packet alone leaves open that the unit forgot how it was set up."""
        ...

    def has_forgotten(self, packet: DataPacket, before: DataPacket, elapsed_s: float | None = None) -> bool:
        """Whether a packet, after one that was right, shows that the unit forgot how it was set up, or is another.

        It arrived `elapsed_s` after the last packet that had it; None if an arrival does not say when it was sent.
        """
        ...

    def set_up(self) -> bool:
        """Set a unit on a quiet line up anew; whether it says that it is."""
        ...

    def zero(self, argument: int, stopping: Callable[[], bool]) -> float | None:
        """Have the rate sensors zeroed; seconds until the unit said so, None if it did not."""
        ...

"""Blocks of packets whose stamps a test says."""

from collections.abc import Callable, Sequence

from imutui.instrument.clock import Clock, Stamp
from imutui.instrument.counts import DataPacket
from imutui.session.stream import Block, PacketArrival, Stamper

Stamped = tuple[DataPacket, Stamp, int]
"""A packet, its stamp, and when it was read, monotonic, ns."""


class _SaidStamps(Clock):
    """Stamps packets as is said, in order."""

    def __init__(self, stamps: list[Stamp]) -> None:
        self._stamps = iter(stamps)

    def take(self, *_: object, **__: object) -> list[Stamp]:
        return [next(self._stamps)]


def blocks_of(packets: Sequence[Stamped]) -> list[Block]:
    """Packets as the reader hands them on: a block begins where something is missing."""
    stamper = Stamper(_SaidStamps([stamp for _, stamp, _ in packets]))
    for packet, _, host_ns in packets:
        stamper.take(PacketArrival(packet, host_ns, True, False, False, 0, 0))
    return stamper.blocks()


def block_of(packet: DataPacket, stamp: Stamp, host_ns: int) -> Block:
    """A single packet."""
    (block,) = blocks_of([(packet, stamp, host_ns)])
    return block


class Arrivals(Stamper):
    """Hands on packets as they were read to a test, beside making blocks of them."""

    def __init__(self, clock: Clock, emit: Callable[[PacketArrival], object]) -> None:
        super().__init__(clock)
        self._emit = emit

    def take(self, arrival: PacketArrival) -> None:
        self._emit(arrival)
        super().take(arrival)

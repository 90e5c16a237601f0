"""Packets and their stamps: what arrives waits here until the clock is sure of when it was sampled."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from imutui.instrument.clock import Clock, Stamp
from imutui.session.reader_thread import PacketArrival


@dataclass(frozen=True, slots=True)
class StampedPacket:
    """A packet as it was read, and when it was sampled."""

    arrival: PacketArrival
    stamp: Stamp


class PacketStamps:
    """Stamps packets in the order of their arrival.

    `clock`: of the line.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: deque[PacketArrival] = deque()

    def take(self, arrival: PacketArrival) -> list[StampedPacket]:
        """Take a packet; returns those that are stamped by now, this one or earlier ones among them, or none."""
        self._waiting.append(arrival)
        stamps = self._clock.take(
            arrival.packet.ticks,
            arrival.host_ns,
            contiguous=arrival.contiguous,
            quiet=arrival.quiet,
            behind=arrival.behind,
            requested_ns=arrival.requested_ns,
        )
        return self._stamped(stamps)

    def due(self, now_ns: int) -> list[StampedPacket]:
        """Packets that have waited long enough."""
        return self._stamped(self._clock.due(now_ns)) if self._waiting else []

    def release(self) -> list[StampedPacket]:
        """All packets that wait: nothing comes that could say more of them."""
        return self._stamped(self._clock.release())

    def interrupt(self, *, lossy: bool = False) -> list[StampedPacket]:
        """Take note that the next packet begins a new stretch, see `Clock.interrupt`; returns those that wait."""
        return self._stamped(self._clock.interrupt(lossy=lossy))

    def _stamped(self, stamps: Iterable[Stamp]) -> list[StampedPacket]:
        return [StampedPacket(self._waiting.popleft(), stamp) for stamp in stamps]


def gap_text(stamp: Stamp) -> str:
    """Words for the gap before a packet, with its bounds for programs; "" if there is none.

    `stamp`: of the first packet behind it.
    """
    gap = stamp.gap
    if gap is None:
        return ""
    if gap.lost_min == gap.lost_max:
        what = f"{gap.lost_max} packet{'' if gap.lost_max == 1 else 's'} lost in {gap.seconds:.4f} s"
    else:
        what = f"no packets for {gap.seconds:.4f} s; between {gap.lost_min} and {gap.lost_max} were lost"
    bounds = f"lost_min={gap.lost_min} lost_max={gap.lost_max} uncertainty_ms={stamp.uncertainty_ns / 1e6:.3f}"
    return f"{what} ({bounds})"

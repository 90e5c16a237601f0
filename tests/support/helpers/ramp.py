"""Readings that tell their own number, so that packets show which of them were measured, skipped or repeated."""

from itertools import pairwise

from imutui.instrument.counter_spec import SPAN
from imutui.instrument.imu400.crossbow import Packet
from imutui.instrument.virtual_instrument import Reading

LSB_DPS = 300 / 2**15


class Ramp:
    """A source whose X rate tells the number of the reading, in counts, and whose other rates stand still."""

    def __init__(self, length: int | None = None, rates_dps: tuple[float, float] = (1.0, -2.0)) -> None:
        self.length = length
        self.rates_dps = rates_dps
        self.asked: list[int] = []

    def reading(self, k: int) -> Reading | None:
        """Note that reading `k` was asked for, and give it."""
        self.asked.append(k)
        if self.length is not None and k >= self.length:
            return None
        y, z = self.rates_dps
        return Reading((k * LSB_DPS, y, z), (0.0, 0.5, 1.0), 25.0)


def numbers(packets: list[Packet]) -> list[int]:
    """Return the numbers of the ramp's readings."""
    return [packet.rates[0] for packet in packets]


def steps(packets: list[Packet]) -> list[int]:
    """Return the counter's steps down from packet to packet."""
    return [(a.ticks - b.ticks) % SPAN for a, b in pairwise(packets)]

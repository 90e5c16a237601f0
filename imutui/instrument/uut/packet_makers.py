"""Packets of a virtual unit: made of a source's readings, or those of a recorded stream of bytes."""

import math
from dataclasses import dataclass
from itertools import pairwise
from statistics import median_low

import numpy as np

from filters.errors import InputError
from imutui.instrument.counter_spec import SPAN
from imutui.instrument.counts import triple
from imutui.instrument.frame_search import Discarded
from imutui.instrument.uut.counter import COUNTS_PER_SECOND
from imutui.instrument.uut.decoder import frame_decoder
from imutui.instrument.uut.fields import ORIENTATIONS, RATE_OF_DIVIDER_LATER, Field, Orientation
from imutui.instrument.uut.frames import FIXED_LENGTHS, OVERHEAD_BYTES, framed
from imutui.instrument.uut.messages import SCALING, PacketS0, PacketS1, content_of, encode
from imutui.instrument.uut.unit_options import FieldValues, UnitOptions
from imutui.instrument.virtual_instrument import Source


@dataclass(frozen=True, slots=True)
class MadePacket:
    """A packet, and its bytes with those that a recording has before them."""

    packet: PacketS1
    data: bytes


class MeasuredPackets:
    """Packets of a source's readings.

    The source has them in the axes of the unit as it came; another orientation turns them.
    """

    def __init__(self, source: Source, options: UnitOptions) -> None:
        self._source = source
        self._bit = options.bit
        self._home = _matrix(ORIENTATIONS[dict(options.fields)[Field.ORIENTATION]])
        self._last = 0
        self._ended = False

    def restart(self) -> None:
        """Do nothing: readings go on where they are."""

    def length(self, kind: bytes) -> int:
        """Return the length of a packet of this type; 0 once the source has no more."""
        return 0 if self._ended else FIXED_LENGTHS[kind] + OVERHEAD_BYTES

    def streamed(self, kind: bytes, k: int, counter: int, orientation: Orientation) -> MadePacket | None:
        """Return the packet of reading k; None once the source has no more."""
        self._last = max(self._last, k)
        reading = None if self._ended else self._source.reading(self._last)
        self._ended = reading is None
        if reading is None:
            return None
        turn = _matrix(orientation) @ self._home.T
        accels = triple(SCALING.accel_counts(turn @ reading.accels_g))
        rates = triple(SCALING.rate_counts(turn @ reading.rates_dps))
        degc = int(SCALING.temperature_counts(reading.temperature_degc))
        packet = PacketS1(accels, rates, (degc, degc, degc), degc, counter, self._bit)
        if kind == b"S0":
            packet = PacketS0(accels, rates, packet.rate_temperatures, degc, counter, self._bit, (0, 0, 0))
        return MadePacket(packet, encode(packet))

    polled = streamed


class RecordedStream:
    """Packets of a stream that a real unit sent, byte for byte.

    Bytes between two packets belong to the later one, those behind the last to that.

    `raw`: the stream.
    `divider`: divider of its rate, by the steps of its counter, which stands still at 1 Hz; that of 100 Hz where it
      does not count time.
    Raises InputError if there is no packet in it, or of several types.
    """

    def __init__(self, raw: bytes) -> None:
        self._packets = _packets_of(raw)
        kinds = {type(made.packet) for made in self._packets}
        if len(kinds) != 1:
            raise InputError(f"a stream has packets S0 or S1 of one type, and this has {len(kinds)} types of them")
        self.divider = _divider_of([made.packet for made in self._packets])
        self._next = 0

    def __len__(self) -> int:
        return len(self._packets)

    @property
    def kind(self) -> bytes:
        """Type of the packets."""
        return self._packets[0].packet.frame.type

    @property
    def only(self) -> FieldValues:
        """Fields that cannot have another value."""
        return (
            (Field.RATE_DIVIDER, self.divider),
            (Field.PACKET_TYPE, int.from_bytes(self.kind, "big")),
            (Field.ORIENTATION, 0x0000),
        )

    def restart(self) -> None:
        """Begin at the first packet."""
        self._next = 0

    def length(self, kind: bytes) -> int:
        """Return the length of the next packet, with the bytes before it; 0 after the last."""
        return len(self._packets[self._next].data) if self._next < len(self._packets) else 0

    def streamed(self, kind: bytes, k: int, counter: int, orientation: Orientation) -> MadePacket | None:
        """Return the next packet; None after the last."""
        if self._next == len(self._packets):
            return None
        self._next += 1
        return self._packets[self._next - 1]

    def polled(self, kind: bytes, k: int, counter: int, orientation: Orientation) -> MadePacket | None:
        """Return the packet that the stream had last, or its first, without bytes between packets."""
        made = self._packets[max(self._next - 1, 0)]
        return MadePacket(made.packet, encode(made.packet)) if self.kind == kind else None


def _packets_of(raw: bytes) -> list[MadePacket]:
    decoder, made, before = frame_decoder(lambda frame: frame), list[MadePacket](), b""
    for found in [*decoder.feed(raw), *decoder.quiet()]:
        if isinstance(found, Discarded):
            before += found.data
        elif isinstance(packet := content_of(found), PacketS1):
            made.append(MadePacket(packet, before + framed(found)))
            before = b""
        else:
            before += framed(found)
    if made:
        made[-1] = MadePacket(made[-1].packet, made[-1].data + before)
    return made


def _divider_of(packets: list[PacketS1]) -> int:
    """Return the divider of a rate at which the counter steps as it does."""
    steps = [(after.counter - before.counter) % SPAN for before, after in pairwise(packets)]
    if not steps:
        return 1
    period = (median_low(steps) or COUNTS_PER_SECOND) / COUNTS_PER_SECOND
    rates = RATE_OF_DIVIDER_LATER.items()
    return next((divider for divider, hz in rates if math.isclose(period * hz, 1.0, rel_tol=0.02)), 1)


def counter_at(instant: float) -> int:
    """Return the value of a counter that was 0 at the time 0, s."""
    return math.floor(instant * COUNTS_PER_SECOND) % SPAN


def _matrix(orientation: Orientation) -> np.ndarray:
    """Return the rotation from the axes of the case to those of the packets."""
    matrix = np.zeros((3, 3))
    matrix[range(3), list(orientation.axes)] = orientation.signs
    return matrix

"""An IMU381, or a relative of it, as a state machine: loop, fields, requests and line, without a clock and without I/O.

It streams by itself from power-up on, unless its divider is 0. Time of its source begins when a host first asks for
data: sets a divider other than 0, or the type of a stream, or asks for a single measurement; until then it reads the
same all the time. Not documented, and made up here: a packet starts at the instant it was sampled; packets that have to
wait for a reply on the line are late and not lost, up to half a second of them.
"""

import math

from imutui.instrument.counter_spec import SPAN
from imutui.instrument.frame_search import Discarded
from imutui.instrument.transmitter import same_speed, transfer_s
from imutui.instrument.uut.decoder import RequestDecoder
from imutui.instrument.uut.fields import QUIET, Field, Orientation
from imutui.instrument.uut.frames import FIXED_LENGTHS, MOST_PAYLOAD_BYTES, OVERHEAD_BYTES, Frame, framed
from imutui.instrument.uut.messages import (
    GET_PACKET,
    PING,
    REFUSED,
    RESET,
    Memory,
    PacketS1,
    numbers,
    numbers_in,
    pairs,
    pairs_in,
)
from imutui.instrument.uut.packet_makers import MadePacket, MeasuredPackets, RecordedStream, counter_at
from imutui.instrument.uut.unit_options import Configuration, UnitOptions
from imutui.instrument.virtual_instrument import SamplingLoop, Source, VirtualInstrument

# "A frame must arrive within 4 s."
_FRAME_PATIENCE_S = 4.0
_MOST_FIELDS = (MOST_PAYLOAD_BYTES - 1) // 4
_LONGEST_BACKLOG_S = 0.5
_BOOT_S = 0.1  # it is deaf and silent for so long after a restart
# request for one word of the factory's memory at 0x071C, and the word; it refuses to read others
_FACTORY_WORD = b"\x07\x1c\x01", b"\x00\x81"
_MEANINGS = {
    b"PK": "ping",
    b"SR": "restart",
    b"CH": "echo",
    b"GP": "one packet of",
    b"GF": "read from RAM",
    b"RF": "read from EEPROM",
    b"SF": "set in RAM",
    b"WF": "set in EEPROM",
    b"RE": "words of the factory's memory",
}


class VirtualUnit(VirtualInstrument[PacketS1, Frame]):
    """A unit of the family; see `VirtualInstrument`.

    `source`: its readings, or a stream to send as it is.
    `options`: which unit this is.
    `seed`: of the counter's start; without a seed it starts at 0.
    """

    options: UnitOptions

    def __init__(
        self, source: Source | RecordedStream, options: UnitOptions | None = None, seed: int | None = None
    ) -> None:
        super().__init__(options or UnitOptions(), seed)
        self._packets = source if isinstance(source, RecordedStream) else MeasuredPackets(source, self.options)
        self._fields = Configuration(self.options, source.only if isinstance(source, RecordedStream) else ())
        self._loop = SamplingLoop(self.options.loop_hz, 0.0)
        self._begun = math.inf  # the loop's number of the source's first reading
        self._wake(0.0)

    def _wake(self, ready: float) -> None:
        """Be as after power-up, from an instant on."""
        self._requests = RequestDecoder()
        self._ready = ready
        self._frame_since = ready
        self._fields.power_up()
        self._begin_next(ready)

    def in_words(self, command: Frame) -> str:
        """Describe a request, such as ``SF: set in RAM 0001=0000``."""
        kind, meaning = command.type, _MEANINGS.get(command.type, "unknown")
        words = [f"{number:04x}={value:04x}" for number, value in pairs_in(command.payload)]
        words = words if kind in (b"SF", b"WF") else [f"{number:04x}" for number in numbers_in(command.payload)]
        said = _letters(command.payload) if kind == GET_PACKET else " ".join(words) or command.payload.hex()
        return f"{_letters(kind)}: {meaning} {said}".rstrip()

    def in_columns(self, packet: PacketS1) -> tuple[str, int, bytes]:
        return packet.frame.type.decode("ascii"), packet.counter, framed(packet.frame)

    @property
    def data_asked_for(self) -> bool:
        return self._begun < math.inf

    @property
    def source_begins(self) -> float:
        return math.inf if self._begun == math.inf else self._loop.instant(int(self._begun))

    @property
    def baud(self) -> int:
        return self._fields.baud

    @property
    def packet_bytes(self) -> int:
        return FIXED_LENGTHS[self._fields.packet_type] + OVERHEAD_BYTES

    @property
    def rate_hz(self) -> int:
        """Packets a second of the stream; 0 if the unit is quiet."""
        return self._fields.rate_hz

    def _begin_anew(self, now: float) -> None:
        """Put the fields in EEPROM in force, and restart the counter."""
        self._first_count = -counter_at(now) % SPAN
        self._wake(now + _BOOT_S)

    def receive(self, data: bytes, now: float, host_baud: int) -> list[Frame]:
        self._advance(now)
        if now < self._ready or not same_speed(self.baud, host_baud):
            return []
        if not self._requests.holds:
            self._frame_since = now
        understood: list[Frame] = []
        for request in self._requests.feed(data):
            if isinstance(request, Discarded):
                continue
            self._frame_since = now
            understood.append(request)
            self._obey(request, now)
            if request == RESET:
                break
        return understood

    def _next_left(self) -> float:
        return self._next_start() + transfer_s(self._packets.length(self._fields.packet_type), self.baud)

    # ------------------------------------------------------------------------------------------------------- requests

    def _obey(self, request: Frame, now: float) -> None:
        kind, payload = request.type, request.payload
        memory = Memory.EEPROM if kind in Memory.EEPROM.value else Memory.RAM
        if kind == b"CH" or request == PING:
            self._answer(request, now)
        elif request == RESET:
            self._answer(request, now)
            self._begin_anew(self._line.free_at)
        elif kind == memory.read and (ids := numbers_in(payload)):
            # a reply has room for so many
            values = self._fields.get(memory, ids) if len(ids) <= _MOST_FIELDS else ()
            self._answer_in_part(Frame(kind, pairs(values)), len(values), len(ids), now)
        elif kind == memory.write and (values := pairs_in(payload)):
            taken = self._fields.put(memory, values)
            self._answer_in_part(Frame(kind, numbers(taken)), len(taken), len(values), now)
            if memory is Memory.RAM:
                self._begin_stream(dict(pair for pair in values if pair[0] in taken), now)
        elif kind == b"RE" and payload == _FACTORY_WORD[0]:
            self._answer(Frame(kind, b"".join(_FACTORY_WORD)), now)
        elif not (kind == GET_PACKET and self._answer_packet(payload, now)):
            self._answer(Frame(REFUSED, kind), now)

    def _answer(self, reply: Frame, now: float) -> None:
        self._line.send(framed(reply), now, self.baud)

    def _answer_in_part(self, reply: Frame, good: int, asked: int, now: float) -> None:
        """Answer the good part of a request, and refuse the request if that is not all of it."""
        if good:
            self._answer(reply, now)
        if good < asked:
            self._answer(Frame(REFUSED, reply.type), now)

    def _answer_packet(self, kind: bytes, now: float) -> bool:
        """Answer with a packet of a type; returns False if the unit does not have it."""
        if kind == b"ID":
            number = self.options.serial_number.to_bytes(4, "big")
            self._answer(Frame(kind, number + self.options.text.encode("ascii")), now)
        elif kind == b"VR":
            self._answer(Frame(kind, bytes(self.options.version)), now)
        elif kind in self.options.packet_types and (made := self._poll(kind, now)) is not None:
            self._line.send(made.data, now, self.baud)
        else:
            return False
        return True

    def _begin_stream(self, values: dict[int, int], now: float) -> None:
        """Take note of fields that a host has put in force: they may ask for data."""
        if Field.RATE_DIVIDER in values:
            self._begin_next(now)
        if values.get(Field.RATE_DIVIDER, QUIET) != QUIET:
            self._packets.restart()
        # to set the type of a quiet unit is not yet to ask for data
        if self.rate_hz and (Field.RATE_DIVIDER in values or Field.PACKET_TYPE in values):
            self._begun = min(self._begun, self._loop.newest(now) + 1)

    # ----------------------------------------------------------------------------------------------------------- loop

    def _begin_next(self, now: float) -> None:
        """Take the loop's next instant for the next packet."""
        self._next = self._loop.newest(now) + 1

    def _skip_to(self, now: float) -> None:
        """Leave out packets, so that the next one is the newest at a time."""
        step = self.options.loop_hz // self.rate_hz
        self._next += max(0, (self._loop.newest(now) - self._next) // step) * step

    def _next_start(self) -> float:
        """Return when the stream's next packet begins; infinite if there is none."""
        if not (self.rate_hz and self._packets.length(self._fields.packet_type)):
            return math.inf
        if math.isfinite(self._line.free_at):
            self._skip_to(self._line.free_at - _LONGEST_BACKLOG_S)
        return max(self._loop.instant(self._next), self._line.free_at)

    def _advance(self, now: float) -> None:
        """Give up a frame that has not come in time, and begin all packets that fall due by `now`."""
        while self._requests.holds and now - self._frame_since > _FRAME_PATIENCE_S:
            self._frame_since += _FRAME_PATIENCE_S
            for request in self._requests.quiet():
                if not isinstance(request, Discarded):
                    self._obey(request, self._frame_since)
        while True:
            start = self._next_start()
            if start > now:
                return
            made = self._packets.streamed(*self._asked_of(self._fields.packet_type, self._next))
            if made is not None:
                self.on_packet(made.packet, self._loop.instant(self._next))
                self._line.send(made.data, start, self.baud)
            self._next += self.options.loop_hz // self.rate_hz

    def _poll(self, kind: bytes, now: float) -> MadePacket | None:
        """Return a packet of the loop's newest instant."""
        newest = self._loop.newest(now)
        self._begun = min(self._begun, newest)
        made = self._packets.polled(*self._asked_of(kind, newest))
        if made is not None:
            self.on_packet(made.packet, self._loop.instant(newest))
        return made

    def _asked_of(self, kind: bytes, number: int) -> tuple[bytes, int, int, Orientation]:
        reading = max(0, number - int(self._begun)) if self.data_asked_for else 0
        counter = (self._first_count + counter_at(self._loop.instant(number))) % SPAN
        return kind, reading, counter, self._fields.orientation


def _letters(kind: bytes) -> str:
    return ascii(kind.decode("latin-1"))[1:-1]

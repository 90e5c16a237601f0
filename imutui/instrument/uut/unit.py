"""An IMU381, or a relative of it, as a state machine: loop, fields, requests and line, without a clock and without I/O.

It streams by itself from power-up on, unless its divider is 0. Time of its source begins when a host first asks for
data: sets a divider other than 0, or the type of a stream, or asks for a single measurement; until then it reads the
same all the time. Not documented, and made up here: a packet starts at the instant it was sampled; packets that have to
wait for a reply on the line are late and not lost, up to half a second of them.
"""

import math

import numpy as np

from imutui.instrument.counter_spec import SPAN
from imutui.instrument.transmitter import same_speed, transfer_s
from imutui.instrument.uut.decoder import RequestDecoder
from imutui.instrument.uut.fields import QUIET, Field, Orientation
from imutui.instrument.uut.frames import FIXED_LENGTHS, MOST_PAYLOAD_BYTES, OVERHEAD_BYTES, Frame, framed
from imutui.instrument.uut.messages import (
    GET,
    SET,
    Echo,
    FactoryWords,
    Fields,
    FieldsSet,
    GetFields,
    GetPacket,
    Identification,
    Measurement,
    Memory,
    OtherFrame,
    Ping,
    ReadFactoryWords,
    Refused,
    Reply,
    Request,
    Reset,
    SetFields,
    StatusWords,
    encode,
    frame_of,
)
from imutui.instrument.uut.packet_makers import MadePacket, MeasuredPackets, RecordedStream, counter_at
from imutui.instrument.uut.unit_options import Configuration, UnitOptions
from imutui.instrument.virtual_instrument import SamplingLoop, Source, VirtualInstrument

# "A frame must arrive within 4 s."
_FRAME_PATIENCE_S = 4.0
_MOST_FIELDS = (MOST_PAYLOAD_BYTES - 1) // 4
_LONGEST_BACKLOG_S = 0.5
_BOOT_S = 0.1  # it is deaf and silent for so long after a restart
_FACTORY_WORDS = {0x071C: 0x0081}  # by address; it refuses to read others
_STATUS_WORDS = 14


class VirtualUnit(VirtualInstrument[Measurement, Request]):
    """A unit of the family; see `VirtualInstrument`.

    `source`: its readings, or a stream to send as it is.
    `options`: which unit this is.
    `seed`: of the counter's start; without a seed it starts at 0.
    """

    options: UnitOptions

    def __init__(
        self, source: Source | RecordedStream, options: UnitOptions | None = None, seed: int | None = None
    ) -> None:
        super().__init__(options or UnitOptions())
        self._packets = source if isinstance(source, RecordedStream) else MeasuredPackets(source, self.options)
        self._fields = Configuration(self.options, source.only if isinstance(source, RecordedStream) else ())
        self._loop = SamplingLoop(self.options.loop_hz, 0.0)
        self._begun = math.inf  # the loop's number of the source's first reading
        self._first_count = 0 if seed is None else int(np.random.default_rng(seed).integers(SPAN))
        self._wake(0.0)

    def _wake(self, ready: float) -> None:
        """Be as after power-up, from an instant on."""
        self._requests = RequestDecoder()
        self._ready = ready
        self._frame_since = ready
        self._fields.power_up()
        self._begin_next(ready)

    def in_words(self, command: Request) -> str:
        return in_words(command)

    def in_columns(self, packet: Measurement) -> tuple[str, int, bytes]:
        data = encode(packet)
        return data[2:4].decode("ascii"), packet.counter, data

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

    def receive(self, data: bytes, now: float, host_baud: int) -> list[Request]:
        self._advance(now)
        if now < self._ready or not same_speed(self.baud, host_baud):
            return []
        if not self._requests.has_begun:
            self._frame_since = now
        understood: list[Request] = []
        for request in self._requests.feed(data):
            self._frame_since = now
            understood.append(request)
            self._obey(request, now)
            if isinstance(request, Reset):
                break
        return understood

    def _next_left(self) -> float:
        return self._next_start() + transfer_s(self._packets.length(self._fields.packet_type), self.baud)

    # ------------------------------------------------------------------------------------------------------- requests

    def _obey(self, request: Request, now: float) -> None:
        match request:
            case Ping() | Echo():
                self._answer(request, now)
            case Reset():
                self._answer(request, now)
                self._begin_anew(self._line.free_at)
            case GetPacket(kind):
                self._answer_packet(kind, now)
            case GetFields(memory, ids):
                # a reply has room for so many
                values = self._fields.get(memory, ids) if len(ids) <= _MOST_FIELDS else ()
                self._answer_in_part(Fields(memory, values), len(values), len(ids), GET[memory], now)
            case SetFields(memory, values):
                self._set(memory, values, now)
            case ReadFactoryWords(address, count):
                words = [_FACTORY_WORDS[at] for at in range(address, address + count) if at in _FACTORY_WORDS]
                whole = count and len(words) == count
                self._answer(FactoryWords(address, tuple(words)) if whole else Refused(frame_of(request).type), now)
            case OtherFrame(kind, _):
                self._answer(Refused(kind), now)

    def _answer(self, reply: Reply, now: float) -> None:
        self._line.send(encode(reply), now, self.baud)

    def _answer_in_part(self, reply: Fields | FieldsSet, good: int, asked: int, kind: bytes, now: float) -> None:
        """Answer the good part of a request, and refuse the request if that is not all of it."""
        if good:
            self._answer(reply, now)
        if good < asked:
            self._answer(Refused(kind), now)

    def _answer_packet(self, kind: bytes, now: float) -> None:
        if kind == b"ID":
            self._identify(now)
        elif kind == b"VR":
            self._answer(self.options.version, now)
        elif kind == b"T0":
            self._answer(StatusWords((self.options.bit,) + (0,) * (_STATUS_WORDS - 1)), now)
        elif kind in self.options.packet_types and (made := self._poll(kind, now)) is not None:
            self._line.send(made.data, now, self.baud)
        else:
            self._answer(Refused(b"GP"), now)

    def _identify(self, now: float) -> None:
        frame = frame_of(Identification(self.options.serial_number, self.options.text))
        payload = frame.payload if self.options.text_ends_with_zero else frame.payload[:-1]
        self._line.send(framed(Frame(frame.type, payload)), now, self.baud)

    def _set(self, memory: Memory, values: tuple[tuple[int, int], ...], now: float) -> None:
        taken = self._fields.put(memory, values)
        self._answer_in_part(FieldsSet(memory, taken), len(taken), len(values), SET[memory], now)
        if memory is Memory.RAM:
            self._begin_stream(dict(pair for pair in values if pair[0] in taken), now)

    def _begin_stream(self, values: dict[int, int], now: float) -> None:
        """Take note of fields that a host has put in force: they may ask for data."""
        if Field.RATE_DIVIDER in values:
            self._begin_next(now)
        if values.get(Field.RATE_DIVIDER, QUIET) != QUIET:
            self._packets.restart()
        # a quiet unit that is told a type is not asked for data yet
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
        while self._requests.has_begun and now - self._frame_since > _FRAME_PATIENCE_S:
            self._frame_since += _FRAME_PATIENCE_S
            for request in self._requests.quiet():
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


def in_words(request: Request) -> str:
    """Describe a request, such as ``SF: set in RAM 0001=0000``."""
    match request:
        case Ping():
            meaning = "ping"
        case Reset():
            meaning = "restart"
        case Echo(payload):
            meaning = f"echo of {len(payload)} bytes"
        case GetPacket(kind):
            meaning = f"one packet of {_letters(kind)}"
        case GetFields(memory, ids):
            meaning = f"read from {memory.value} " + " ".join(f"{number:04x}" for number in ids)
        case SetFields(memory, values):
            meaning = f"set in {memory.value} " + " ".join(f"{number:04x}={value:04x}" for number, value in values)
        case ReadFactoryWords(address, count):
            meaning = f"{count} words of the factory's memory from {address:04x}"
        case OtherFrame(_, payload):
            meaning = f"unknown, with {len(payload)} bytes"
    return f"{_letters(frame_of(request).type)}: {meaning}"


def _letters(kind: bytes) -> str:
    return ascii(kind.decode("latin-1"))[1:-1]

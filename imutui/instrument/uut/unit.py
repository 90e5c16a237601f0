"""An IMU381, or a relative of it, as a state machine: loop, fields, requests and line, without a clock and without I/O.

`VirtualUnit` is told what arrived and when, and tells which bytes have left the line by then. It streams by itself from
power-up on, unless its divider is 0. Time of its source begins when a host first asks for data: sets a divider other
than 0, or the type of what streams, or asks for a single measurement; until then it reads the same all the time. What
nobody documents and is made up here: a packet starts at the instant it was sampled; packets that have to wait for a
reply on the line are late and not lost, up to half a second of them.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from imutui.instrument.transmitter import Transmitter, as_heard, same_speed, transfer_s
from imutui.instrument.uut.configuration import Configuration
from imutui.instrument.uut.counter import SPAN
from imutui.instrument.uut.decoder import RequestDecoder
from imutui.instrument.uut.fields import QUIET, Field, Orientation
from imutui.instrument.uut.frame_search import FIXED_LENGTHS
from imutui.instrument.uut.frames import MOST_PAYLOAD_BYTES, OVERHEAD_BYTES, Frame, framed
from imutui.instrument.uut.messages import (
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
)
from imutui.instrument.uut.packet_makers import MadePacket, PacketMaker, RecordedStream, counter_at, in_columns
from imutui.instrument.uut.payloads import GET, GET_PACKET, SET, encode, frame_of
from imutui.instrument.uut.request_text import in_words
from imutui.instrument.uut.schedule import Schedule
from imutui.instrument.uut.unit_options import UnitOptions

# "A frame must arrive within 4 s."
_FRAME_PATIENCE_S = 4.0
_MOST_FIELDS = (MOST_PAYLOAD_BYTES - 1) // 4
_LONGEST_BACKLOG_S = 0.5
_STATUS_WORDS = 14


class VirtualUnit:
    """A unit that has just been switched on.

    Times are seconds on any one scale that never goes back; the unit's own loop runs on it. Speeds of the host are
    passed with each call, since a real host changes its own without asking.

    `packets`: what its packets are made of.
    `options`: which unit this is.
    `seed`: where the counter starts is drawn from it; without a seed it starts at 0.
    `options`: which unit this is.
    `on_packet`: told of every packet that it begins to send, and of the instant that was sampled.
    `data_asked_for`: whether a host has ever asked for data.
    """

    in_words = staticmethod(in_words)
    in_columns = staticmethod(in_columns)

    def __init__(self, packets: PacketMaker, options: UnitOptions | None = None, seed: int | None = None) -> None:
        self.options = options or UnitOptions()
        self.on_packet: Callable[[Measurement, float], None] | None = None
        self.data_asked_for = False
        self._packets = packets
        only = packets.only if isinstance(packets, RecordedStream) else ()
        self._fields = Configuration(self.options, only)
        self._line = Transmitter()
        self._schedule = Schedule(self.options.loop_hz)
        self._begun = math.inf  # the loop's number of the source's first reading
        self._first_count = 0 if seed is None else int(np.random.default_rng(seed).integers(SPAN))
        self._wake(0.0)

    def _wake(self, ready: float) -> None:
        """Be as after power-up, from an instant on."""
        self._requests = RequestDecoder()
        self._replies = deque[tuple[float, bytes, int]]()
        self._ready = ready
        self._frame_since = ready
        self._sent = 0
        self._fields.power_up()
        self._schedule.begin(ready)

    @property
    def baud(self) -> int:
        """The unit's present speed."""
        return self._fields.baud

    @property
    def packet_bytes(self) -> int:
        """Bytes of a packet of the stream."""
        return FIXED_LENGTHS[self._fields.packet_type] + OVERHEAD_BYTES

    @property
    def rate_hz(self) -> int:
        """Packets a second of the stream; 0 if the unit is quiet."""
        return self._fields.rate_hz

    def power_up(self, now: float, serial_number: int | None = None) -> None:
        """Begin anew: what is on the line breaks off, fields are those in EEPROM, the counter restarts.

        `now`: time, s.
        `serial_number`: that of another unit, which takes this one's place.
        """
        self._advance(now)
        self._line.cut(now)
        if serial_number is not None:
            self.options = replace(self.options, serial_number=serial_number)
        self._first_count = -counter_at(self.options.counter, now, 0) % SPAN
        self._wake(now + self.options.boot_s)

    def change_mode(self, now: float) -> None:
        """Fall into another type of packet, unasked; a stream goes on."""
        self._advance(now)
        kinds = self.options.packet_types
        kind = kinds[(kinds.index(self._fields.packet_type) + 1) % len(kinds)]
        self._fields.put(Memory.RAM, ((Field.PACKET_TYPE, int.from_bytes(kind, "big")),))

    def pause(self, now: float, seconds: float) -> None:
        """Send nothing for so long after what is on the line; the loop and the counter go on."""
        self._advance(now)
        self._line.hold(now + seconds)
        if self.rate_hz:
            self._schedule.skip_to(now + seconds, self.rate_hz)

    def receive(self, data: bytes, now: float, host_baud: int) -> list[Request]:
        """Let bytes from the host arrive.

        `data`: the bytes, all of which have arrived by `now`.
        `now`: time, s.
        `host_baud`: the speed the host sent them at.
        Returns what the unit understood, for a log.
        """
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

    def transmit(self, now: float, host_baud: int) -> bytes:
        """Return the bytes whose last bit has left the unit by `now`, as a host at `host_baud` gets them.

        `now`: time, s.
        `host_baud`: the speed the host listens at.
        Returns each byte is returned once. At a wrong speed they are garbage.
        """
        self._advance(now)
        return b"".join(as_heard(data, baud, host_baud) for baud, data in self._line.take(now))

    def next_event(self, now: float) -> float | None:
        """Return when a packet or reply will next have left, so that `transmit` is worth calling.

        `now`: time, s.
        Returns none if nothing will leave until the next request.
        """
        self._advance(now)
        sending = self._line.next_end()
        if sending is not None:
            return sending
        length = self._packets.length(self._fields.packet_type)
        left = self._next_start() + transfer_s(length, self.baud)
        if self._replies:
            due, data, baud = self._replies[0]
            left = min(left, due + transfer_s(len(data), baud))
        return left if math.isfinite(left) else None

    # ------------------------------------------------------------------------------------------------------- requests

    def _obey(self, request: Request, now: float) -> None:
        match request:
            case Ping() | Echo():
                self._answer(request, now)
            case Reset():
                self._line.send(encode(request), now + self.options.reply_delay_s, self.baud)
                self._first_count = -counter_at(self.options.counter, self._line.free_at, 0) % SPAN
                self._wake(self._line.free_at + self.options.boot_s)
            case GetPacket(kind):
                self._answer_packet(kind, now)
            case GetFields(memory, ids):
                # a reply has room for so many
                values = self._fields.get(memory, ids) if len(ids) <= _MOST_FIELDS else ()
                self._answer_in_part(Fields(memory, values), len(values), len(ids), GET[memory], now)
            case SetFields(memory, values):
                self._set(memory, values, now)
            case ReadFactoryWords(address, count):
                known = dict(self.options.factory_words)
                words = [known[at] for at in range(address, address + count) if at in known]
                whole = count and len(words) == count
                self._answer(FactoryWords(address, tuple(words)) if whole else Refused(frame_of(request).type), now)
            case OtherFrame(kind, _):
                self._answer(Refused(kind), now)

    def _answer(self, reply: Reply, now: float) -> None:
        self._reply(encode(reply), now, self.baud)

    def _reply(self, data: bytes, now: float, baud: int) -> None:
        """Send a reply, after the unit's delay; packets do not wait for it."""
        if self.options.reply_delay_s:
            self._replies.append((now + self.options.reply_delay_s, data, baud))
        else:
            self._line.send(data, now, baud)

    def _answer_in_part(self, reply: Fields | FieldsSet, good: int, asked: int, kind: bytes, now: float) -> None:
        """Answer what is good of a request, and refuse it if that is not all."""
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
            self._reply(made.data, now, self.baud)
        else:
            self._answer(Refused(GET_PACKET), now)

    def _identify(self, now: float) -> None:
        frame = frame_of(Identification(self.options.serial_number, self.options.text))
        payload = frame.payload if self.options.text_ends_with_zero else frame.payload[:-1]
        self._reply(framed(Frame(frame.type, payload)), now, self.baud)

    def _set(self, memory: Memory, values: tuple[tuple[int, int], ...], now: float) -> None:
        old_baud = self.baud
        taken = self._fields.put(memory, values)
        reply = FieldsSet(memory, taken)
        if self.options.new_baud_at_once or self.baud == old_baud:
            self._answer_in_part(reply, len(taken), len(values), SET[memory], now)
        else:
            self._reply(encode(reply), now, old_baud)
            self._answer_in_part(reply, 0, len(values) - len(taken), SET[memory], now)
        if memory is Memory.RAM:
            self._begin_stream(dict(pair for pair in values if pair[0] in taken), now)

    def _begin_stream(self, values: dict[int, int], now: float) -> None:
        """Take note of fields that a host has put in force: they may ask for data."""
        if Field.RATE_DIVIDER in values:
            self._schedule.begin(now)
        if values.get(Field.RATE_DIVIDER, QUIET) != QUIET:
            self._packets.restart()
        # a quiet unit that is told a type is not asked for data yet
        if self.rate_hz and (Field.RATE_DIVIDER in values or Field.PACKET_TYPE in values):
            self._begin_source(self._schedule.newest(now) + 1)

    def _begin_source(self, number: int) -> None:
        """Let time of the source begin, if it has not, at an instant of the loop."""
        self.data_asked_for = True
        self._begun = min(self._begun, number)

    # ----------------------------------------------------------------------------------------------------------- loop

    def _next_start(self) -> float:
        """When the stream's next packet begins; infinite if there is none."""
        if not (self.rate_hz and self._packets.length(self._fields.packet_type)):
            return math.inf
        if math.isfinite(self._line.free_at):
            self._schedule.skip_to(self._line.free_at - _LONGEST_BACKLOG_S, self.rate_hz)
        return max(self._schedule.instant(self._schedule.next), self._line.free_at)

    def _advance(self, now: float) -> None:
        """Give up a frame that has not come in time, and begin all packets that fall due by `now`."""
        while self._requests.has_begun and now - self._frame_since > _FRAME_PATIENCE_S:
            self._frame_since += _FRAME_PATIENCE_S
            for request in self._requests.quiet():
                self._obey(request, self._frame_since)
        while True:
            start = self._next_start()
            if self._replies and self._replies[0][0] <= min(start, now):
                due, data, baud = self._replies.popleft()
                self._line.send(data, due, baud)
                continue
            if start > now:
                return
            made = self._packets.streamed(*self._asked_of(self._fields.packet_type, self._schedule.next))
            if made is not None:
                self._tell(made, self._schedule.instant(self._schedule.next))
                self._line.send(made.data, start, self.baud)
            self._schedule.advance(self.rate_hz)

    def _poll(self, kind: bytes, now: float) -> MadePacket | None:
        """A packet of the loop's newest instant."""
        newest = self._schedule.newest(now)
        self._begin_source(newest)
        made = self._packets.polled(*self._asked_of(kind, newest))
        if made is not None:
            self._tell(made, self._schedule.instant(newest))
        return made

    def _asked_of(self, kind: bytes, number: int) -> tuple[bytes, int, int, Orientation]:
        reading = max(0, number - int(self._begun)) if math.isfinite(self._begun) else 0
        counter = (
            self._first_count + counter_at(self.options.counter, self._schedule.instant(number), self._sent)
        ) % SPAN
        return kind, reading, counter, self._fields.orientation

    def _tell(self, made: MadePacket, instant: float) -> None:
        self._sent += 1
        if self.on_packet is not None:
            self.on_packet(made.packet, instant)

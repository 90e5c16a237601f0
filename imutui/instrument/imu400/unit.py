"""The IMU400CD as a state machine: loop, words, counter, commands and line, without a clock and without I/O.

`VirtualUnit` is told what arrived and when, and tells which bytes have left the line by then, so that tests run it on
a time of their own. What it measures comes from a `Source`; the errors of the sensors are the source's affair. Where
public documents disagree or are silent (`UnitOptions`), the default is the likeliest reading. What nobody documents
and is made up here: a packet starts at the instant it was sampled, without the unknown computing time; the unit is
deaf while it zeroes its rate sensors; voltage words are centred on 2.5 V and reach 1.5 times the range.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from imutui.instrument.imu400.command_text import in_words
from imutui.instrument.imu400.crossbow import (
    COUNTER_SPAN,
    PACKET_BYTES,
    POWER_UP_BAUD,
    TICK_S,
    AskSerialNumber,
    AskVersion,
    BaudReady,
    BaudSet,
    Command,
    CommandDecoder,
    GetPacket,
    MeasureBaud,
    Mode,
    ModeSet,
    Packet,
    Ping,
    Pong,
    RatesZeroed,
    Reply,
    RequestBaud,
    Scaling,
    SerialNumber,
    SetMode,
    StartStream,
    StopStream,
    UnknownCommand,
    Version,
    ZeroRateSensors,
    encode,
)
from imutui.instrument.imu400.sampling_loop import SamplingLoop
from imutui.instrument.imu400.scaling import FULL_SCALE_RATIO, VOLTS_SPAN
from imutui.instrument.imu400.unit_options import VERSION_CHARACTERS, UnitOptions
from imutui.instrument.reading import Reading, Source
from imutui.instrument.transmitter import Transmitter, as_heard, same_speed, transfer_s

# The speeds a unit could measure, and how long it listens for one: open in the manual; a host needs milliseconds.
_BAUDS = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)
_BAUD_PATIENCE_S = 10.0

# "Sensor voltages: 2.5 V at rest": the middle of what a word can say
_VOLTS_AT_REST = VOLTS_SPAN / 2.0


@dataclass(slots=True)
class _Zeroing:
    """An average of the rate sensors under way."""

    next_sample: int
    remaining: int
    total_dps: np.ndarray = field(default_factory=lambda: np.zeros(3))
    count: int = 0


class VirtualUnit:
    """An IMU400CD that has just been switched on.

    Times are seconds on any one scale that never goes back; the unit's own loop runs on it. Speeds of the host are
    passed with each call, since a real host changes its own without asking.

    `source`: what there is to measure.
    `options`: which unit this is.
    `seed`: where the time counter starts is drawn from it; without a seed it starts at 0.
    `options`: which unit this is.
    `on_packet`: told of every packet that it begins to send, and of the instant that was sampled.
    """

    def __init__(self, source: Source, options: UnitOptions | None = None, seed: int | None = None) -> None:
        self.options = options or UnitOptions()
        self.on_packet: Callable[[Packet, float], None] | None = None
        self._source = source
        self._line = Transmitter()
        self._loop = SamplingLoop(self.options)
        self._last_sample = -1
        self._last_read = 0
        self._ended = False
        self._first_ticks = 0 if seed is None else int(np.random.default_rng(seed).integers(COUNTER_SPAN))
        self._wake()

    def _wake(self) -> None:
        """Be as after power-up."""
        self._commands = CommandDecoder()
        self._baud = POWER_UP_BAUD
        self._measuring_until = -math.inf
        self._mode = self.options.power_up_mode
        self._streaming = False
        self._zeroing: _Zeroing | None = None
        self._zero_dps = np.zeros(3)
        self._versions = _versions(self.options)
        self._versions_told = 0

    packet_bytes = PACKET_BYTES
    in_words = staticmethod(in_words)

    def in_columns(self, packet: Packet) -> tuple[str, int, bytes]:
        """Mode, counter and bytes of a packet."""
        return packet.mode.value, packet.ticks, encode(packet)

    @property
    def data_asked_for(self) -> bool:
        """Whether a host has ever asked for data."""
        return self._loop.has_begun

    @property
    def baud(self) -> int:
        """The unit's present speed."""
        return self._baud

    @property
    def mode(self) -> Mode:
        """The unit's present measurement mode."""
        return self._mode

    @property
    def streaming(self) -> bool:
        """Whether the unit is in continuous mode."""
        return self._streaming

    @property
    def ended(self) -> bool:
        """Whether the source has run out: the unit sends no more packets, but still answers."""
        return self._ended

    def power_up(self, now: float, serial_number: int | None = None) -> None:
        """Begin anew: what is on the line breaks off, the counter restarts, and the loop goes on where it was.

        `now`: time, s.
        `serial_number`: that of another unit, which takes this one's place.
        """
        self._advance(now)
        self._line.cut(now)
        if serial_number is not None:
            self.options = replace(self.options, serial_number=serial_number)
        self._first_ticks = (math.floor(now / TICK_S) - 1) % COUNTER_SPAN
        self._wake()

    def change_mode(self, now: float) -> None:
        """Fall into the other mode, unasked; a stream goes on."""
        self._advance(now)
        self._set_mode(Mode.VOLTAGE if self._mode is Mode.SCALED else Mode.SCALED, now)

    def pause(self, now: float, seconds: float) -> None:
        """Send nothing for so long after what is on the line; the loop and the counter go on."""
        self._advance(now)
        self._line.hold(now + seconds)

    def receive(self, data: bytes, now: float, host_baud: int) -> list[Command]:
        """Let bytes from the host arrive.

        `data`: the bytes, all of which have arrived by `now`.
        `now`: time, s.
        `host_baud`: the speed the host sent them at.
        Returns what the unit understood, for a log.
        """
        commands: list[Command] = []
        for byte in data:
            self._advance(now)
            commands += self._receive_byte(bytes([byte]), now, host_baud)
        return commands

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
        Returns none if nothing will leave until the next command.
        """
        self._advance(now)
        sending = self._line.next_end()
        if sending is not None:
            return sending
        if self._zeroing is not None:
            return self._instant(self._zeroing.next_sample + self._zeroing.remaining - 1)
        if self._streaming and not self._ended:
            return self._next_packet()[1] + transfer_s(PACKET_BYTES, self._baud)
        return None

    # ------------------------------------------------------------------------------------------------------- commands

    def _receive_byte(self, byte: bytes, now: float, host_baud: int) -> list[Command]:
        if self._zeroing is not None:
            return []
        measures = now <= self._measuring_until and byte == encode(MeasureBaud())
        if not measures and not same_speed(self._baud, host_baud):
            return []
        commands = self._commands.feed(byte)
        for command in commands:
            self._obey(command, now, host_baud)
        return commands

    def _obey(self, command: Command, now: float, host_baud: int) -> None:
        match command:
            case Ping():
                self._answer(Pong(), now)
                self._ping(now)
            case SetMode(mode):
                self._answer(ModeSet(mode), now)
                self._set_mode(mode, now)
            case StopStream():
                self._streaming = False
            case StartStream():
                self._start_stream(now)
            case GetPacket():
                self._streaming = False
                self._send_newest(now)
            case AskSerialNumber():
                self._answer(SerialNumber(self.options.serial_number), now)
            case AskVersion():
                self._answer_version(now)
            case ZeroRateSensors(argument):
                self._zero(argument, now)
            case RequestBaud() if self.options.auto_baud:
                self._answer(BaudReady(), now)
                self._measuring_until = now + _BAUD_PATIENCE_S
            case MeasureBaud():
                self._measure_baud(now, host_baud)
            case UnknownCommand() | RequestBaud():
                pass  # "reply to an unknown byte: open; silence"

    def _answer(self, reply: Reply, now: float) -> None:
        self._line.send(encode(reply), now + self.options.reply_delay_s, self._baud)

    def _answer_version(self, now: float) -> None:
        text = self._versions[self._versions_told % len(self._versions)]
        self._versions_told += 1
        if self.options.version_plain_text:
            self._line.send(text.encode("ascii"), now + self.options.reply_delay_s, self._baud)
        else:
            self._answer(Version(text), now)

    def _ping(self, now: float) -> None:
        self._versions_told = 0
        if self.options.ping != "keeps":
            self._streaming = False
        if self.options.ping == "resets":
            self._set_mode(self.options.power_up_mode, now)

    def _set_mode(self, mode: Mode, now: float) -> None:
        if mode is self._mode:
            return
        self._mode = mode
        if self._streaming:
            self._last_sample = self._loop.last_before(
                now, self._mode
            )  # each mode has a loop rate, hence a count of samples, of its own

    def _measure_baud(self, now: float, host_baud: int) -> None:
        if now > self._measuring_until:
            return  # a stray `a`: angle mode on other units, nothing on this one
        measured = next((baud for baud in _BAUDS if same_speed(baud, host_baud)), None)
        if measured is not None:
            self._measuring_until = -math.inf
            self._baud = measured
            self._answer(BaudSet(), now)

    def _start_stream(self, now: float) -> None:
        if self._streaming:
            return
        self._streaming = True
        self._loop.begin(now)
        self._last_sample = self._loop.last_before(now, self._mode)

    def _send_newest(self, now: float) -> None:
        self._loop.begin(now)
        packet = self._packet(self._loop.newest(now, self._mode))
        if packet is not None:
            self._line.send(encode(packet), now, self._baud)

    def _zero(self, argument: int, now: float) -> None:
        if argument == 0:
            self._zero_dps = np.zeros(3)
            self._answer(RatesZeroed(), now)
            return
        self._loop.begin(now)
        self._last_sample = self._loop.last_before(now, self._mode)
        self._zeroing = _Zeroing(self._last_sample + 1, argument * self.options.zero_samples_per_unit)

    # ----------------------------------------------------------------------------------------------------------- loop

    def _instant(self, sample: int) -> float:
        """When the present mode's loop takes a sample."""
        return self._loop.instant(sample, self._mode)

    def _advance(self, now: float) -> None:
        """Do all that falls due by `now`."""
        if self._zeroing is not None:
            self._advance_zeroing(self._zeroing, now)
        while self._streaming and self._zeroing is None and not self._ended:
            sample, start = self._next_packet()
            if start > now:
                return
            self._last_sample = sample
            packet = self._packet(sample)
            if packet is not None:
                self._line.send(encode(packet), start, self._baud)

    def _next_packet(self) -> tuple[int, float]:
        """Sample and start of the stream's next packet: the newest sample when the line is free, or else the next."""
        newest = self._loop.newest(self._line.free_at, self._mode)
        sample = max(newest, self._last_sample + 1)
        return sample, max(self._instant(sample), self._line.free_at)

    def _advance_zeroing(self, zeroing: _Zeroing, now: float) -> None:
        while zeroing.remaining and self._instant(zeroing.next_sample) <= now:
            reading = self._read(zeroing.next_sample)
            if reading is None:
                self._zeroing = None
                return
            zeroing.total_dps += reading.rates_dps
            zeroing.count += 1
            zeroing.remaining -= 1
            zeroing.next_sample += 1
        if zeroing.remaining == 0:
            self._zero_dps = zeroing.total_dps / zeroing.count
            self._last_sample = zeroing.next_sample - 1
            self._zeroing = None
            self._answer(RatesZeroed(), self._instant(self._last_sample))

    def _read(self, sample: int) -> Reading | None:
        """Ask the source for a sample of the present mode's loop; the source counts in scaled mode's."""
        # a mode whose instants lie otherwise would ask for a reading just before the last one
        self._last_read = max(self._loop.reading(sample, self._mode), self._last_read)
        reading = None if self._ended else self._source.reading(self._last_read)
        self._ended = reading is None
        return reading

    # ---------------------------------------------------------------------------------------------------------- words

    def _packet(self, sample: int) -> Packet | None:
        reading = self._read(sample)
        if reading is None:
            return None
        scaling = self.options.scaling
        if self._mode is Mode.SCALED:
            rates = scaling.rate_counts(reading.rates_dps - self._zero_dps)
            accels = scaling.accel_counts(reading.accels_g)
        else:
            rates = _sensor_words(scaling, reading.rates_dps, scaling.rate_range_dps)
            accels = _sensor_words(scaling, reading.accels_g, scaling.accel_range_g)
        temperature, instant = int(scaling.temperature_counts(reading.temperature_degc)), self._instant(sample)
        packet = Packet(self._mode, _triple(rates), _triple(accels), temperature, self._ticks(instant))
        if self.on_packet is not None:
            self.on_packet(packet, instant)
        return packet

    def _ticks(self, instant: float) -> int:
        return (self._first_ticks - math.floor(instant / TICK_S)) % COUNTER_SPAN


def _versions(options: UnitOptions) -> list[str]:
    """Answers to `v` in turn: the version, and the pieces of what it says of its source."""
    text = options.source.encode("ascii", "backslashreplace").decode("ascii")
    pieces = [text[start : start + VERSION_CHARACTERS] for start in range(0, len(text), VERSION_CHARACTERS)]
    return [f"{options.version}+{len(pieces)}", *pieces] if pieces else [options.version]


def _sensor_words(scaling: Scaling, values: ArrayLike, full_range: float) -> np.ndarray:
    """Sensor voltages, as words: 2.5 V at rest, 0 and 5 V at 1.5 times the range."""
    return scaling.volts_counts(
        _VOLTS_AT_REST + np.asarray(values, np.float64) * (_VOLTS_AT_REST / (FULL_SCALE_RATIO * full_range))
    )


def _triple(words: np.ndarray) -> tuple[int, int, int]:
    x, y, z = words.tolist()
    return x, y, z

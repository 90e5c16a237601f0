"""The IMU400CD as a state machine: loop, words, counter, commands and line, without a clock and without I/O.

Its readings come from a `Source`, with the errors of the sensors in them. Where public documents disagree
(`UnitOptions`), the default is the likeliest reading. Not documented, and made up here: a packet starts at the instant
it was sampled, without the unknown computing time; the unit is deaf while it zeroes its rate sensors; voltage words are
centred on 2.5 V and reach 1.5 times the range.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from filters.imu import LOOP_HZ
from imutui.instrument import virtual_instrument
from imutui.instrument.counter_spec import SPAN
from imutui.instrument.counts import nearest, triple
from imutui.instrument.imu400.crossbow import (
    LETTER_REPLIES,
    PACKET_BYTES,
    POWER_UP_BAUD,
    TICK_S,
    Command,
    CommandDecoder,
    Mode,
    Packet,
    encode,
    framed,
    in_words,
    serial_number_frame,
)
from imutui.instrument.imu400.scaling import SCALED_A_VOLTAGE_COUNT, VOLTAGE_AT_REST, VOLTAGE_LIMITS, scaling
from imutui.instrument.transmitter import same_speed, transfer_s
from imutui.instrument.virtual_instrument import Reading, SamplingLoop, Source, VirtualInstrument

# The speeds a unit could measure, and how long it listens for one: open in the manual; a host needs milliseconds.
_BAUDS = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)
_BAUD_PATIENCE_S = 10.0

_SCALING = scaling()


@dataclass(frozen=True)
class UnitOptions(virtual_instrument.UnitOptions):
    """What differs from unit to unit, or is disputed between documents."""

    # the answer to `v`: 24 characters on the units that others have seen; that of a virtual one may be longer
    version: str = "IMU400CD-200 VIRTUAL 1.0"
    # what `R` does besides answering: nothing (VG700M manual); it stops the stream and keeps the mode (seen on
    # hardware); it returns to power-up, voltage mode and polled (AHRS400 manual)
    ping: Literal["keeps", "stops", "resets"] = "stops"
    # samples averaged for each unit of the argument of `z`; 10 or 100 by different sources
    zero_samples_per_unit: int = 10
    version_plain_text: bool = False  # True if `v` is answered without header and checksum, as the manuals can be read


class VirtualUnit(VirtualInstrument[Packet, bytes]):
    """An IMU400CD; see `VirtualInstrument`.

    `source`: its readings.
    `options`: which unit this is.
    `seed`: of the time counter's start; without a seed it starts at 0.
    """

    options: UnitOptions
    packet_bytes = PACKET_BYTES
    in_words = staticmethod(in_words)

    def __init__(self, source: Source, options: UnitOptions | None = None, seed: int | None = None) -> None:
        super().__init__(options or UnitOptions(), seed)
        self._source = source
        self._loop = SamplingLoop(LOOP_HZ)
        self._last_sample = -1
        self.ended = False  # True once the source has no more: the unit sends no packets, but still answers
        self._wake()

    def _wake(self) -> None:
        """Be as after power-up."""
        self._commands = CommandDecoder()
        self._baud = POWER_UP_BAUD
        self._measuring_until = -math.inf
        self.mode = Mode.VOLTAGE  # of measurement
        self.streaming = False  # True in continuous mode
        self._zeroing = range(0)  # samples of an average of the rate sensors under way
        self._zero_dps = np.zeros(3)

    def in_columns(self, packet: Packet) -> tuple[str, int, bytes]:
        return packet.mode.value, packet.ticks, encode(packet)

    @property
    def data_asked_for(self) -> bool:
        return self._loop.has_begun

    @property
    def source_begins(self) -> float:
        return self._loop.instant(0)

    @property
    def baud(self) -> int:
        return self._baud

    def receive(self, data: bytes, now: float, host_baud: int) -> list[bytes]:
        commands: list[bytes] = []
        for byte in data:
            self._advance(now)
            commands += self._receive_byte(bytes([byte]), now, host_baud)
        return commands

    def _next_left(self) -> float:
        if self._zeroing:
            return self._loop.instant(self._zeroing[-1])
        if self.streaming and not self.ended:
            return self._next_packet()[1] + transfer_s(PACKET_BYTES, self._baud)
        return math.inf

    # ------------------------------------------------------------------------------------------------------- commands

    def _receive_byte(self, byte: bytes, now: float, host_baud: int) -> list[bytes]:
        if self._zeroing:
            return []
        measures = now <= self._measuring_until and byte == Command.MEASURE_BAUD
        if not measures and not same_speed(self._baud, host_baud):
            return []
        commands = self._commands.feed(byte)
        for command in commands:
            self._obey(command, now, host_baud)
        return commands

    def _obey(self, command: bytes, now: float, host_baud: int) -> None:
        match command[:1]:
            case Command.PING:
                self._answer(command, now)
                self.streaming &= self.options.ping == "keeps"
                self.mode = Mode.VOLTAGE if self.options.ping == "resets" else self.mode
            case Command.SCALED_MODE | Command.VOLTAGE_MODE:
                self._answer(command, now)
                self.mode = Mode.SCALED if command == Command.SCALED_MODE else Mode.VOLTAGE
            case Command.STOP_STREAM:
                self.streaming = False
            case Command.START_STREAM:
                self._start_stream(now)
            case Command.GET_PACKET:
                self.streaming = False
                self._loop.begin(now)
                self._send(self._loop.newest(now), now)
            case Command.SERIAL_NUMBER:
                self._line.send(serial_number_frame(self.options.serial_number), now, self._baud)
            case Command.VERSION:
                text = self.options.version.encode("ascii")
                self._line.send(text if self.options.version_plain_text else framed(text), now, self._baud)
            case Command.ZERO_RATES:
                self._zero(command[1], now)
            case Command.REQUEST_BAUD:
                self._answer(command, now)
                self._measuring_until = now + _BAUD_PATIENCE_S
            case Command.MEASURE_BAUD:
                self._measure_baud(now, host_baud)
        # "reply to an unknown byte: open; silence"

    def _answer(self, command: bytes, now: float) -> None:
        """Answer a command with its letter."""
        self._line.send(LETTER_REPLIES[Command(command)].encode("ascii"), now, self._baud)

    def _measure_baud(self, now: float, host_baud: int) -> None:
        if now > self._measuring_until:
            return  # a stray `a`: angle mode on other units, nothing on this one
        measured = next((baud for baud in _BAUDS if same_speed(baud, host_baud)), None)
        if measured is not None:
            self._measuring_until = -math.inf
            self._baud = measured
            self._answer(Command.MEASURE_BAUD, now)

    def _start_stream(self, now: float) -> None:
        if self.streaming:
            return
        self.streaming = True
        self._loop.begin(now)
        self._last_sample = self._loop.last_before(now)

    def _zero(self, argument: int, now: float) -> None:
        if argument == 0:
            self._zero_dps = np.zeros(3)
            self._answer(Command.ZERO_RATES, now)
            return
        self._loop.begin(now)
        self._last_sample = self._loop.last_before(now)
        first = self._last_sample + 1
        self._zeroing = range(first, first + argument * self.options.zero_samples_per_unit)

    # ----------------------------------------------------------------------------------------------------------- loop

    def _advance(self, now: float) -> None:
        if self._zeroing and self._loop.instant(self._zeroing[-1]) <= now:
            self._end_zeroing()
        while self.streaming and not self._zeroing and not self.ended:
            sample, start = self._next_packet()
            if start > now:
                return
            self._last_sample = sample
            self._send(sample, start)

    def _next_packet(self) -> tuple[int, float]:
        """Return sample and start of the stream's next packet: the newest sample when the line is free, or the next."""
        newest = self._loop.newest(self._line.free_at)
        sample = max(newest, self._last_sample + 1)
        return sample, max(self._loop.instant(sample), self._line.free_at)

    def _end_zeroing(self) -> None:
        """Take the mean of the rates for zero, and answer; without an answer if the source ended meanwhile."""
        readings = [self._read(sample) for sample in self._zeroing]
        self._last_sample, self._zeroing = self._zeroing[-1], range(0)
        if not self.ended:
            self._zero_dps = np.mean([reading.rates_dps for reading in readings if reading is not None], axis=0)
            self._answer(Command.ZERO_RATES, self._loop.instant(self._last_sample))

    def _read(self, sample: int) -> Reading | None:
        reading = None if self.ended else self._source.reading(sample)
        self.ended = reading is None
        return reading

    # ---------------------------------------------------------------------------------------------------------- words

    def _send(self, sample: int, start: float) -> None:
        """Send the packet of a sample, unless the source has ended."""
        reading = self._read(sample)
        if reading is None:
            return
        if self.mode is Mode.SCALED:
            rates = _SCALING.rate_counts(reading.rates_dps - self._zero_dps)
            accels = _SCALING.accel_counts(reading.accels_g)
        else:
            rates = _sensor_words(reading.rates_dps, _SCALING.rate_lsb_dps)
            accels = _sensor_words(reading.accels_g, _SCALING.accel_lsb_g)
        temperature, instant = int(_SCALING.temperature_counts(reading.temperature_degc)), self._loop.instant(sample)
        ticks = (self._first_count - math.floor(instant / TICK_S)) % SPAN
        packet = Packet(self.mode, triple(rates), triple(accels), temperature, ticks)
        self.on_packet(packet, instant)
        self._line.send(encode(packet), start, self._baud)


def _sensor_words(values: ArrayLike, lsb: float) -> NDArray[np.int64]:
    """Return sensor voltages as words."""
    return np.clip(VOLTAGE_AT_REST + nearest(values, SCALED_A_VOLTAGE_COUNT * lsb), *VOLTAGE_LIMITS)

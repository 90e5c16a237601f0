"""What virtual units of all kinds have in common: their line, their loop, and what they measure.

`imu400.unit.VirtualUnit` is an IMU400CD, `uut.unit.VirtualUnit` an IMU381. Neither has a clock or does I/O: each is
told what arrived and when, and tells which bytes have left it by then, so that tests run it on a time of their own.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

from imutui.instrument.transmitter import SAME_INSTANT_S, Transmitter, as_heard

PacketT = TypeVar("PacketT")
CommandT = TypeVar("CommandT")


@dataclass(frozen=True, slots=True)
class Reading:
    """What the sensors read at one instant, in the instrument's own axes and signs, before the words clip and round."""

    rates_dps: tuple[float, float, float]  # angular rate about X, Y, Z, deg/s
    # acceleration along X, Y, Z as this instrument reads it (+1 g on Z when level), g
    accels_g: tuple[float, float, float]
    temperature_degc: float  # inside the case, degC


class Source(Protocol):
    """What the virtual unit measures."""

    def reading(self, k: int) -> Reading | None:
        """Return what the unit's own loop reads at its instant `k`, or None once there is no more.

        Instants are counted at the options' `loop_hz` from the first command that needs a reading. `k` never decreases;
        it repeats when the host polls faster than the loop, and skips what the line was too slow for.
        """
        ...


class SamplingLoop:
    """A unit's own loop: numbers and instants of its samples.

    `hz`: its rate.
    `start`: instant of sample 0; it may begin later.
    """

    def __init__(self, hz: float, start: float = math.inf) -> None:
        self.hz = hz
        self._start = start

    @property
    def has_begun(self) -> bool:
        """Whether it has."""
        return self._start < math.inf

    def begin(self, now: float) -> None:
        """Begin, if it has not."""
        self._start = min(self._start, now)

    def instant(self, sample: int) -> float:
        """When a sample is taken: a quotient, so that no rounding piles up."""
        return self._start + sample / self.hz

    def newest(self, now: float) -> int:
        """Sample that was taken last; -1 if none was."""
        if now == -math.inf:
            return -1
        return math.floor((now - self._start + SAME_INSTANT_S) * self.hz)

    def last_before(self, now: float) -> int:
        """Sample before the first one that is taken from `now` on."""
        newest = self.newest(now)
        return newest - 1 if self.instant(newest) >= now - SAME_INSTANT_S else newest


@dataclass(frozen=True)
class UnitOptions:
    """What may differ from unit to unit, whatever its kind."""

    serial_number: int = 9911750
    reply_delay_s: float = 0.0  # how late it answers
    clock_skew_ppm: float = 0.0  # how much faster than the host's its clock runs: loop, counter and line


class VirtualInstrument(ABC, Generic[PacketT, CommandT]):
    """A unit that has just been switched on.

    Times are seconds on any one scale that never goes back; the unit's own loop runs on it. Speeds of the host are
    passed with each call, since a real host changes its own without asking.

    `options`: which unit this is.
    """

    options: UnitOptions

    def __init__(self, options: UnitOptions) -> None:
        self.options = options
        self.on_packet: Callable[[PacketT, float], None] | None = None
        """Told of every packet that it begins to send, and of the instant that was sampled."""
        self._line = Transmitter()

    @property
    @abstractmethod
    def baud(self) -> int:
        """The unit's present speed."""

    @property
    @abstractmethod
    def packet_bytes(self) -> int:
        """Bytes of a data packet: faults of the line are told by packets."""

    @property
    @abstractmethod
    def data_asked_for(self) -> bool:
        """Whether a host has ever asked for data: time of scenarios and of faults begins with it."""

    @property
    @abstractmethod
    def source_begins(self) -> float:
        """Instant of the source's reading 0; infinite while there is none."""

    @abstractmethod
    def in_words(self, command: CommandT) -> str:
        """Say what a command asks for, for a log."""

    @abstractmethod
    def in_columns(self, packet: PacketT) -> tuple[str, int, bytes]:
        """Mode of measurement or type of a packet, its counter, and its bytes on the line, for a table."""

    @abstractmethod
    def receive(self, data: bytes, now: float, host_baud: int) -> list[CommandT]:
        """Let bytes from the host arrive, all by `now`, and return what the unit understood, for a log."""

    def power_up(self, now: float, serial_number: int | None = None) -> None:
        """Begin anew: what is on the line breaks off, and the unit is as after power-up.

        `serial_number`: that of another unit, which takes this one's place.
        """
        self._advance(now)
        self._line.cut(now)
        if serial_number is not None:
            self.options = replace(self.options, serial_number=serial_number)
        self._begin_anew(now)

    @abstractmethod
    def change_mode(self, now: float) -> None:
        """Fall into another mode of measurement, unasked; a stream goes on."""

    def pause(self, now: float, seconds: float) -> None:
        """Send nothing for so long after what is on the line; the loop and the counter go on."""
        self._advance(now)
        self._line.hold(now + seconds)

    def transmit(self, now: float, host_baud: int) -> bytes:
        """Return the bytes whose last bit has left the unit by `now`, each once, as a host at `host_baud` gets them.

        At a wrong speed they are garbage.
        """
        self._advance(now)
        return b"".join(as_heard(data, baud, host_baud) for baud, data in self._line.take(now))

    def next_event(self, now: float) -> float | None:
        """Return when a packet or reply will next have left, so that `transmit` is worth calling.

        None if nothing will leave until the next command.
        """
        self._advance(now)
        end = self._line.next_end()
        left = self._next_left() if end is None else end
        return left if left < math.inf else None

    def _tell(self, packet: PacketT, instant: float) -> None:
        if self.on_packet is not None:
            self.on_packet(packet, instant)

    @abstractmethod
    def _begin_anew(self, now: float) -> None:
        """Be as after power-up, from an instant on."""

    @abstractmethod
    def _advance(self, now: float) -> None:
        """Do all that falls due by `now`."""

    @abstractmethod
    def _next_left(self) -> float:
        """When something will next have left while the line is free; infinite if nothing will by itself."""

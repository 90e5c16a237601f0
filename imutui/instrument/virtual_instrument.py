"""What virtual units of all kinds share: their loop, their line, and the readings they measure.

`imu400.unit.VirtualUnit` is an IMU400CD, `uut.unit.VirtualUnit` an IMU381. Neither has a clock or does I/O: the caller
passes the bytes that arrive with their time, and asks for the bytes that have left by a time. So tests run a unit on a
time of their own.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from imutui.instrument.counter_spec import SPAN
from imutui.instrument.transmitter import SAME_INSTANT_S, Transmitter, as_heard

PacketT = TypeVar("PacketT")
CommandT = TypeVar("CommandT")


@dataclass(frozen=True, slots=True)
class Reading:
    """Readings of the sensors at one instant, in the instrument's axes and signs, before words clip and round them."""

    rates_dps: tuple[float, float, float]  # angular rate about X, Y, Z, deg/s
    # acceleration along X, Y, Z as this instrument reads it (+1 g on Z when level), g
    accels_g: tuple[float, float, float]
    temperature_degc: float  # inside the case, degC


class Source(Protocol):
    """Readings of a virtual unit."""

    def reading(self, k: int) -> Reading | None:
        """Return the reading of the unit's loop at its instant `k`, or None once there is no more.

        Instants are counted at the rate of the unit's loop, from the first command that needs a reading. `k` never
        decreases; it repeats when the host polls faster than the loop, and skips what the line was too slow for.
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
        """True if it has a sample 0."""
        return self._start < math.inf

    def begin(self, now: float) -> None:
        """Take sample 0 at `now`, if none was taken before."""
        self._start = min(self._start, now)

    def instant(self, sample: int) -> float:
        """Return the instant of a sample: a quotient, so that no rounding piles up."""
        return self._start + sample / self.hz

    def newest(self, now: float) -> int:
        """Return the number of the newest sample; -1 if there is none."""
        if now == -math.inf:
            return -1
        return math.floor((now - self._start + SAME_INSTANT_S) * self.hz)

    def last_before(self, now: float) -> int:
        """Return the number of the sample before the first one that is taken from `now` on."""
        newest = self.newest(now)
        return newest - 1 if self.instant(newest) >= now - SAME_INSTANT_S else newest


@dataclass(frozen=True)
class UnitOptions:
    """What differs from unit to unit, whatever its kind."""

    serial_number: int = 9911750
    clock_skew_ppm: float = 0.0  # how much faster than the host's its clock runs: loop, counter and line


class VirtualInstrument(ABC, Generic[PacketT, CommandT]):
    """A unit that has just been switched on.

    Times are seconds on any one scale that never goes back; the unit's own loop runs on it. The host's speed is passed
    with each call, since a real host changes its own without asking.

    `options`: which unit this is.
    `seed`: of the counter's start; without a seed it starts at 0.
    """

    options: UnitOptions

    def __init__(self, options: UnitOptions, seed: int | None) -> None:
        self._first_count = 0 if seed is None else int(np.random.default_rng(seed).integers(SPAN))
        self.options = options
        self.on_packet: Callable[[PacketT, float], None] = lambda packet, instant: None
        """Called with every packet that the unit begins to send, and the instant that it sampled."""
        self._line = Transmitter()

    @property
    @abstractmethod
    def baud(self) -> int:
        """The unit's present speed."""

    @property
    @abstractmethod
    def packet_bytes(self) -> int:
        """Length of a data packet."""

    @property
    @abstractmethod
    def data_asked_for(self) -> bool:
        """True once a host has asked for data: time of scenarios and of faults begins with it."""

    @property
    @abstractmethod
    def source_begins(self) -> float:
        """Instant of the source's reading 0; infinite while there is none."""

    @abstractmethod
    def in_words(self, command: CommandT) -> str:
        """Describe a command, for a log."""

    @abstractmethod
    def in_columns(self, packet: PacketT) -> tuple[str, int, bytes]:
        """Return mode of measurement or type of a packet, its counter, and its bytes on the line."""

    @abstractmethod
    def receive(self, data: bytes, now: float, host_baud: int) -> list[CommandT]:
        """Take bytes from the host, all arrived by `now`; return the commands that the unit understood."""

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

    @abstractmethod
    def _advance(self, now: float) -> None:
        """Do all that falls due by `now`."""

    @abstractmethod
    def _next_left(self) -> float:
        """Return when something will next have left while the line is free; infinite if nothing will by itself."""

"""What a virtual unit is to its line and to the pseudo-terminal: the protocol that units of all kinds fulfil.

`imu400.unit.VirtualUnit` is an IMU400CD, `uut.unit.VirtualUnit` an IMU381. Neither has a clock or does I/O: each is
told what arrived and when, and tells which bytes have left it by then.
"""

from collections.abc import Callable
from typing import Protocol, TypeVar

PacketT = TypeVar("PacketT")
CommandT = TypeVar("CommandT")


class HasClock(Protocol):
    """Options that every unit has."""

    @property
    def clock_skew_ppm(self) -> float:
        """How much faster than the host's its clock runs."""
        ...


class VirtualInstrument(Protocol[PacketT, CommandT]):
    """A unit that has just been switched on; times are seconds on any one scale that never goes back."""

    # told of every packet that it begins to send, and of the instant that was sampled
    on_packet: Callable[[PacketT, float], None] | None

    @property
    def options(self) -> HasClock:
        """Which unit this is."""
        ...

    @property
    def baud(self) -> int:
        """The unit's present speed."""
        ...

    @property
    def packet_bytes(self) -> int:
        """Bytes of a data packet: faults of the line are told by packets."""
        ...

    @property
    def data_asked_for(self) -> bool:
        """Whether a host has ever asked for data: time of scenarios and of faults begins with it."""
        ...

    def power_up(self, now: float, serial_number: int | None = None) -> None:
        """Begin anew, as the unit it was or as another one."""
        ...

    def change_mode(self, now: float) -> None:
        """Fall into another mode of measurement, unasked; a stream goes on."""
        ...

    def pause(self, now: float, seconds: float) -> None:
        """Send nothing for so long, and go on with the newest reading."""
        ...

    def receive(self, data: bytes, now: float, host_baud: int) -> list[CommandT]:
        """Let bytes from the host arrive, all by `now`, and return what the unit understood."""
        ...

    def transmit(self, now: float, host_baud: int) -> bytes:
        """Return the bytes whose last bit has left the unit by `now`, as a host at that speed gets them, each once."""
        ...

    def next_event(self, now: float) -> float | None:
        """Return when a packet or reply will next have left; None if nothing will until the next command."""
        ...

    def in_words(self, command: CommandT) -> str:
        """Say what a command asks for, for a log."""
        ...

    def in_columns(self, packet: PacketT) -> tuple[str, int, bytes]:
        """Mode of measurement or type of a packet, its counter, and its bytes on the line, for a table."""
        ...

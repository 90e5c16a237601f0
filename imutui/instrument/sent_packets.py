"""The truth about a virtual unit's stream, as CSV: when each packet was sampled, and its bytes."""

from typing import Generic, TextIO

from imutui.instrument.virtual_instrument import CommandT, PacketT, VirtualInstrument

HEADING = "sampled_monotonic_ns,mode,ticks,frame"


class SentPackets(Generic[PacketT, CommandT]):
    """A table of packets, one a row, in the order in which the unit began to send them.

    `file`: where to write. Rows are whole, and there at once.
    `unit`: knows what its packets are.
    """

    def __init__(self, file: TextIO, unit: VirtualInstrument[PacketT, CommandT]) -> None:
        self._file = file
        self._unit = unit
        self._write(HEADING)

    def __call__(self, packet: PacketT, sampled_ns: int) -> None:
        """Add a packet and the host's monotonic time when it was sampled, ns."""
        mode, ticks, frame = self._unit.in_columns(packet)
        self._write(f"{sampled_ns},{mode},{ticks},{frame.hex()}")

    def _write(self, row: str) -> None:
        self._file.write(row + "\n")
        self._file.flush()

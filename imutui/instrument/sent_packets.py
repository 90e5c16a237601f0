"""The truth about a virtual unit's stream, as CSV: when each packet was sampled, and its bytes."""

from typing import TextIO

from imutui.instrument.crossbow import Packet, encode

HEADING = "sampled_monotonic_ns,mode,ticks,frame"


class SentPackets:
    """A table of packets, one a row, in the order in which the unit began to send them.

    Parameters
    ----------
    file : TextIO
        Where to write. Rows are whole, and there at once.
    """

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self._write(HEADING)

    def __call__(self, packet: Packet, sampled_ns: int) -> None:
        """Add a packet and the host's monotonic time when it was sampled, ns."""
        self._write(f"{sampled_ns},{packet.mode.value},{packet.ticks},{encode(packet).hex()}")

    def _write(self, row: str) -> None:
        self._file.write(row + "\n")
        self._file.flush()

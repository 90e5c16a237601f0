"""The truth about a virtual unit's stream, as CSV: when each packet was sampled, and its bytes."""

from typing import TextIO

from imutui.instrument.imu400 import crossbow
from imutui.instrument.imu400.crossbow import Packet
from imutui.instrument.uut import payloads
from imutui.instrument.uut.messages import Measurement, PacketS0

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

    def __call__(self, packet: Packet | Measurement, sampled_ns: int) -> None:
        """Add a packet and the host's monotonic time when it was sampled, ns."""
        mode, ticks, frame = _columns(packet)
        self._write(f"{sampled_ns},{mode},{ticks},{frame.hex()}")

    def _write(self, row: str) -> None:
        self._file.write(row + "\n")
        self._file.flush()


def _columns(packet: Packet | Measurement) -> tuple[str, int, bytes]:
    """Mode or type, counter and bytes."""
    if isinstance(packet, Packet):
        return packet.mode.value, packet.ticks, crossbow.encode(packet)
    frame = payloads.encode(packet)
    return frame[2:4].decode("ascii"), packet.time if isinstance(packet, PacketS0) else packet.counter, frame

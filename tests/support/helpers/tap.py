"""What a virtual instrument sent, from the file that `imutui virtual --tap` wrote: the truth about a recording."""

import struct
from pathlib import Path

Words = tuple[int, ...]  # six counts, temperature, ticks


def packets_of(tap: Path) -> list[Words]:
    """Packets among the bytes sent: after the last reply, `C` to the command for scaled mode."""
    data = tap.read_bytes()
    # replies before the stream: H, serial number (6), version (26), C
    start = data.index(b"C", 1 + 6) + 1
    while data[start] != 0xFF or sum(data[start + 1 : start + 17]) % 256 != data[start + 17]:
        start = data.index(b"C", start) + 1
    return [struct.unpack(">6h2H", data[i + 1 : i + 17]) for i in range(start, len(data) - 17, 18)]

"""Before an acquisition process begins: its clock is the one that the unit keeps, and what it reads is acknowledged.

Python runs a module of this name from PYTHONPATH by itself. Nothing of the program is changed but its `time`.
"""

import mmap
import os
import struct
import sys
import time
from functools import partial

if "imutui.session" in sys.orig_argv and "IMUTUI_TEST_UNIT_TIME" in os.environ:
    folder = os.environ.pop("IMUTUI_TEST_UNIT_TIME")
    with open(f"{folder}/clock", "rb") as file:
        shared = memoryview(mmap.mmap(file.fileno(), 8, prot=mmap.PROT_READ)).cast("q")
    acknowledged = os.open(f"{folder}/read", os.O_WRONLY | os.O_NONBLOCK)
    utc_ns = time.time_ns() - time.monotonic_ns()
    read = os.read

    def unit_time(kind: type, per_ns: float, offset_ns: int = 0) -> float:
        """Time of the unit."""
        return kind((shared[0] + offset_ns) * per_ns)

    def counted(fd: int, length: int) -> bytes:
        """Read, and tell the unit how much of its line that was."""
        data = read(fd, length)
        if os.isatty(fd):
            os.write(acknowledged, struct.pack("i", len(data)))
        return data

    os.read = counted
    # not functions: these would become methods where a class keeps one, as pyserial does
    time.monotonic_ns = partial(unit_time, int, 1)
    time.monotonic = partial(unit_time, float, 1e-9)
    time.time_ns = partial(unit_time, int, 1, utc_ns)
    time.time = partial(unit_time, float, 1e-9, utc_ns)

"""Before a process begins: an acquisition's clock is the one that the unit keeps, and what it reads is acknowledged.

Python runs a module of this name from PYTHONPATH by itself. Nothing of the program is changed but its `time`.
"""

import contextlib
import mmap
import os
import struct
import sys
import time
from functools import partial
from pathlib import Path


def _be_the_host(folder: str) -> None:
    """Take the unit's time for all times."""
    with open(f"{folder}/clock", "rb") as file:
        shared = memoryview(mmap.mmap(file.fileno(), 8, prot=mmap.PROT_READ)).cast("q")
    # for reading too: a unit that the acquisition starts itself opens its end later
    acknowledged = os.open(f"{folder}/read", os.O_RDWR | os.O_NONBLOCK)
    utc_ns = time.time_ns() - time.monotonic_ns()
    read = os.read

    def unit_time(kind: type, per_ns: float, offset_ns: int = 0) -> float:
        return kind((shared[0] + offset_ns) * per_ns)

    def counted(fd: int, length: int) -> bytes:
        """Read, and tell the unit how much of its line that was."""
        data = read(fd, length)
        if os.isatty(fd):
            with contextlib.suppress(BlockingIOError):  # it has gone, and nobody empties the pipe
                os.write(acknowledged, struct.pack("i", len(data)))
        return data

    os.read = counted
    # not functions: these would become methods where a class keeps one, as pyserial does
    time.monotonic_ns = partial(unit_time, int, 1)
    time.monotonic = partial(unit_time, float, 1e-9)
    time.time_ns = partial(unit_time, int, 1, utc_ns)
    time.time = partial(unit_time, float, 1e-9, utc_ns)


def _be_the_unit(folder: str) -> None:
    sys.path.append(str(Path(__file__).parents[1]))
    import virtual

    virtual.keep_time(Path(folder))


if "IMUTUI_TEST_UNIT_TIME" in os.environ:
    if "imutui.session" in sys.orig_argv:
        _be_the_host(os.environ["IMUTUI_TEST_UNIT_TIME"])
    elif sys.orig_argv[1:5] == ["-P", "-m", "imutui", "virtual"]:
        _be_the_unit(os.environ["IMUTUI_TEST_UNIT_TIME"])

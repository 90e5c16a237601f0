"""Jobs that tests give to workers, and, without a way to tell, to processes beside one another."""

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from filters.errors import InputError

Tell = Callable[[float, str], None]


def add(a: int, b: int, tell: Tell) -> int:
    for k in range(3):
        tell(k / 3, f"step {k}")
    print("what a library prints goes nowhere")
    return a + b


def large(n: int, tell: Tell) -> bytes:
    """A result that no pipe holds at once."""
    return bytes(n)


def chatty(n: int, tell: Tell) -> int:
    """More progress than a pipe holds."""
    for k in range(n):
        tell(k / n, f"step {k} " + "x" * 100)
    return n


def wrong(tell: Tell) -> None:
    raise InputError("`x` is 3; it must be positive")


def wordless(tell: Tell) -> None:
    raise MemoryError


def broken(tell: Tell) -> Any:
    """A defect: numpy's own error."""
    return np.empty(0).min()


def missing(path: Path, tell: Tell) -> bytes:
    """An error of the operating system's."""
    return path.read_bytes()


def unpicklable(tell: Tell) -> Any:
    """A result that can't travel."""
    return lambda: None


def leaves(code: int, tell: Tell) -> None:
    """Ends the process without a word."""
    os._exit(code)


def is_killed(*_: object) -> None:
    """Is killed as the kernel does when memory runs out."""
    os.kill(os.getpid(), signal.SIGKILL)


def patient(folder: Path, tell: Tell) -> None:
    """Works until it is cancelled, and cleans up: writes its pid, then a file that it removes on its way out."""
    part = folder / "result.part"
    part.write_text("half")
    try:
        (folder / "pid.new").write_text(str(os.getpid()))
        (folder / "pid.new").rename(folder / "pid")
        tell(0.5, "waiting")
        while True:
            signal.pause()
    finally:
        part.unlink()


def stubborn(folder: Path, tell: Tell) -> None:
    """Does not listen."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    tell(0.5, "deaf")
    while True:
        time.sleep(60.0)


def paths(tell: Tell) -> list[str]:
    """Where modules are looked for."""
    return sys.path


def doubled_late(number: int) -> int:
    time.sleep(0.2 / (1 + number))
    return 2 * number


def begun(path: Path) -> None:
    """Say that this process runs, and stay."""
    path.touch()
    time.sleep(600.0)

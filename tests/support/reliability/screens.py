"""The terminal is cut off, frozen, suspended or busy, or the recorder dies under it."""

import os
import shlex
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from helpers.processes import children, command_line, has_ended, processor_s, state_of, wait_until
from helpers.terminal import Terminal

from reliability.setting import (
    Acquired,
    log_packets,
    places,
    seconds_until_ended,
)

_RECORDS = "● REC"
_NOT_READY_S = 5.0
_OTHER_SCREEN = b"\x1b[?1049h"
_NS_PER_MS = 1e6


@contextmanager
def watched(size: tuple[int, int] = (80, 24), **environ: str) -> Iterator[Terminal]:
    """A screen that shows the acquisition."""
    terminal = Terminal(command_line("attach"), size, synchronised=True, **environ)
    try:
        terminal.read_until(_RECORDS, "deg/s")
        yield terminal
    finally:
        terminal.close()


@dataclass(frozen=True)
class LinkDropped:
    """What became of a screen whose terminal went away, and of the acquisition."""

    gone_s: float  # until the screen's process was gone
    processor: float  # share of a processor that the acquisition took afterwards
    lost: int  # packets


def link_dropped(it: Acquired, seconds: float) -> LinkDropped:
    """Cut the terminal off, look at what is left for so long, and come back."""
    pid, path = it.client.pid, it.path
    with watched() as terminal:
        since = time.monotonic()
        terminal.hang_up()
        gone_s = seconds_until_ended(terminal.process.pid, since)
    before, since = processor_s(pid), time.monotonic()
    time.sleep(seconds)  # nobody asks it anything meanwhile
    share = (processor_s(pid) - before) / (time.monotonic() - since)
    with watched() as terminal:
        assert path.name[:20] in terminal.read_until(path.name[:20])
    assert (it.client.pid, it.path) == (pid, path)
    return LinkDropped(gone_s, share, lost(it))


@dataclass(frozen=True)
class Lateness:
    """How long after it was written to the line the host stamped a packet, ms; and packets that were lost."""

    median_ms: float
    p99_ms: float
    max_ms: float
    packets: int
    lost: int

    @classmethod
    def between(cls, it: Acquired, begin_ns: int, end_ns: int) -> "Lateness":
        """Of the packets that were sent in a time."""
        gone = lost(it)
        sent, held = it.sent.packets(), log_packets(it.path)
        at = places(held, sent)
        late_ns = (held[:, 0] - sent[at, 0])[(sent[at, 0] >= begin_ns) & (sent[at, 0] < end_ns)]
        median, p99, most = np.percentile(late_ns / _NS_PER_MS, [50.0, 99.0, 100.0]).tolist()
        return cls(median, p99, most, late_ns.size, gone)


def lost(it: Acquired) -> int:
    """Packets sent before now that the file lacks when it holds later ones, and what is counted as lost."""
    now_ns, path = time.monotonic_ns(), it.path
    wait_until(lambda: bool(log_packets(path)[-1, 0] > now_ns))
    held = log_packets(path)
    return int(places(held, it.sent.packets())[-1]) + 1 - len(held) + int(it.state()["lost_packets"])


def frozen(it: Acquired, seconds: float) -> Lateness:
    """Read nothing of the screen for so long, and then again."""
    with watched() as terminal:
        begin = time.monotonic_ns()
        terminal.freeze(seconds)
        end = time.monotonic_ns()
        terminal.drain(0.2)
    return Lateness.between(it, begin, end)


def busy(it: Acquired, seconds: float) -> Lateness:
    """Draw as much and as often as can be, in a terminal that takes it all."""
    with watched((200, 60), IMUTUI_SCREEN_FPS="60", IMUTUI_SCREEN_PLOT="scroll") as terminal:
        begin = time.monotonic_ns()
        terminal.drain(seconds)
        end = time.monotonic_ns()
    return Lateness.between(it, begin, end)


def suspended(it: Acquired, seconds: float) -> int:
    """Ctrl+Z under a screen that a shell has started, and `fg` after so long; packets lost."""
    # one that answers could do so when the screen has just been stopped, and the shell would take it for a command
    shell = Terminal(["sh", "-i"], controlling=True, PS1="$ ")
    try:
        shell.press(f"{shlex.join(command_line('attach'))}\n".encode())
        shell.read_until(_RECORDS, "deg/s")
        (screen,) = children(shell.process.pid)
        _press_until(shell, b"\x1a", lambda: state_of(screen) == "T")
        it.goes_on(seconds)
        shell.press(b"fg\n")
        shell.read_until_sent(_OTHER_SCREEN)
        shell.read_until(_RECORDS, "deg/s")
    finally:
        shell.close()
    return lost(it)


def _read_until(terminal: Terminal, true: Callable[[], bool]) -> None:
    def look() -> bool:
        terminal.read_for(0.02)
        return true()

    wait_until(look)


def _press_until(terminal: Terminal, key: bytes, true: Callable[[], bool]) -> None:
    """Press a key, and again where a busy machine's screen was not ready for it."""
    again_at = 0.0

    def look() -> bool:
        nonlocal again_at
        if time.monotonic() >= again_at:
            terminal.press(key)
            again_at = time.monotonic() + _NOT_READY_S
        terminal.read_for(0.02)
        return true()

    wait_until(look)


def killed_under_the_screen(it: Acquired) -> float:
    """Kill the recorder; s until the screen says that it has ended, and no longer that it records."""
    with watched() as terminal:
        since = time.monotonic()
        os.kill(it.client.pid, signal.SIGKILL)
        _read_until(terminal, lambda: "has ended" in terminal.shown() and "REC" not in terminal.shown())
        took = time.monotonic() - since
        terminal.press(b"c")
        terminal.read_until("Connect")
    wait_until(lambda: has_ended(it.client.pid))
    return took

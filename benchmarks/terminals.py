"""A terminal of its own for a program under measurement: what it gets to know of it, and what it writes into it."""

import os
import pty
import select
import struct
import subprocess
import termios
import time
from fcntl import ioctl

ENVIRONMENT = {"TERM": "xterm-256color", "COLORTERM": "truecolor"}
"""Of every program that draws: the same colours at both ends of a link."""


def in_terminal(
    command: list[str], size: tuple[int, int], until: bytes = b"", limit_s: float = 120.0
) -> list[tuple[float, bytes]]:
    """Run a program in a terminal that answers; returns what it wrote and when.

    `size`: columns and rows.
    `until`: end it once it has written this; empty waits for its own end.
    `limit_s`: end it after that in any case.
    """
    master, slave = pty.openpty()
    ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))
    process = subprocess.Popen(
        command, stdin=slave, stdout=slave, stderr=slave, start_new_session=True, env={**os.environ, **ENVIRONMENT}
    )
    os.close(slave)
    deadline = time.monotonic() + limit_s
    written: list[tuple[float, bytes]] = []
    seen = b""
    while time.monotonic() < deadline:
        if select.select([master], [], [], 0.2)[0]:
            try:
                data = os.read(master, 1 << 16)
            except OSError:
                break
            if not data:
                break
            written.append((time.time(), data))
            if b"\x1b[?2026$p" in data:
                os.write(master, b"\x1b[?2026;2$y")
            seen += data if until else b""
            if until and until in seen:
                break
        elif process.poll() is not None:
            break
    if process.poll() is None:
        process.terminate()
    os.close(master)
    process.wait()
    return written

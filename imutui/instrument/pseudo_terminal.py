"""The unit's end of a pseudo-terminal, and the link that leads to it."""

import contextlib
import fcntl
import os
import termios
import tty
from pathlib import Path
from types import TracebackType
from typing import Self

_BAUD_OF_TERMIOS = {
    getattr(termios, name): int(name[1:]) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()
}

# asks whether TIOCEXCL is set; Python has no name for it
_TIOCGEXCL = 0x80045440


class PseudoTerminal:
    """The unit's end of a pseudo-terminal, raw, at the power-up speed.

    Its other end is kept open here too: so the unit's end never gets an I/O error when the host closes, and bytes that
    a host left unread wait for the next one.

    `link`: symbolic link to make to the terminal while it is in use, in a `with`. It may replace a symbolic link;
      entering raises FileExistsError if something else has that name.
    """

    def __init__(self, link: Path | None) -> None:
        self._link = link
        self._unit, self._host = os.openpty()
        tty.setraw(self._host)
        attributes = termios.tcgetattr(self._host)
        attributes[4] = attributes[5] = termios.B38400
        termios.tcsetattr(self._host, termios.TCSANOW, attributes)
        os.set_blocking(self._unit, False)
        os.set_blocking(self._host, False)
        self.name = os.ttyname(self._host)

    def __enter__(self) -> Self:
        try:
            self._show()
        except OSError:
            self._close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._hide()
        self._close()

    def _show(self) -> None:
        if self._link is None:
            return
        if self._link.is_symlink():
            self._link.unlink()
        elif self._link.exists():
            raise FileExistsError(f"{self._link} exists and is not a symbolic link; choose another name or remove it")
        self._link.symlink_to(self.name)

    def _hide(self) -> None:
        if self._link is not None and self._link.is_symlink() and str(self._link.readlink()) == self.name:
            self._link.unlink()

    def _close(self) -> None:
        os.close(self._unit)
        os.close(self._host)

    def fileno(self) -> int:
        """Descriptor of the unit's end."""
        return self._unit

    def release(self) -> None:
        """Open the port to everybody again after a host was killed.

        The kernel takes back that host's lock, but not its mark of exclusive use while this end is open: a user who is
        not root would find the port in use for ever. A host that sets the mark without a lock loses it.
        """
        with contextlib.suppress(OSError):  # a host that lives has the lock; a driver without such marks needs nothing
            if any(fcntl.ioctl(self._host, _TIOCGEXCL, bytes(4))):
                fcntl.flock(self._host, fcntl.LOCK_EX | fcntl.LOCK_NB)
                fcntl.ioctl(self._host, termios.TIOCNXCL)
                fcntl.flock(self._host, fcntl.LOCK_UN)

    def host_baud(self) -> int:
        """Return the speed that the host has set, which both ends share; 0 if termios has no name for it."""
        return _BAUD_OF_TERMIOS.get(termios.tcgetattr(self._unit)[5], 0)

    def read(self) -> bytes:
        """Return the bytes that the host has sent."""
        try:
            return os.read(self._unit, 4096)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> bytes:
        """Write as many bytes as fit into the host's queue; return those."""
        try:
            return data[: os.write(self._unit, data)]
        except BlockingIOError:
            return b""

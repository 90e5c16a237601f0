"""The unit's end of a pseudo-terminal, and the link that leads to it."""

import contextlib
import fcntl
import os
import termios
import tty
from pathlib import Path

_BAUD_OF_TERMIOS = {
    getattr(termios, name): int(name[1:]) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()
}

# asks whether TIOCEXCL is set; Python has no name for it
_TIOCGEXCL = 0x80045440


class PseudoTerminal(contextlib.AbstractContextManager["PseudoTerminal"]):
    """The unit's end of a pseudo-terminal, raw, at the power-up speed.

    Its other end is kept open here too: so the unit's end never gets an I/O error when the host closes, and bytes that
    a host left unread wait for the next one.

    `link`: symbolic link to make to the terminal until its `with` ends. It may replace a symbolic link.
    Raises FileExistsError if something else has the name of the link.
    """

    def __init__(self, link: Path | None) -> None:
        if link is not None and link.is_symlink():
            link.unlink()
        elif link is not None and link.exists():
            raise FileExistsError(f"{link} exists and is not a symbolic link; choose another name or remove it")
        self._link = link
        self._unit, self._host = os.openpty()
        tty.setraw(self._host)
        attributes = termios.tcgetattr(self._host)
        attributes[4] = attributes[5] = termios.B38400
        termios.tcsetattr(self._host, termios.TCSANOW, attributes)
        os.set_blocking(self._unit, False)
        os.set_blocking(self._host, False)
        self.name = os.ttyname(self._host)
        if link is not None:
            link.symlink_to(self.name)

    def __exit__(self, *_: object) -> None:
        if self._link is not None and self._link.is_symlink() and str(self._link.readlink()) == self.name:
            self._link.unlink()
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

"""The serial port: the only user of pyserial. One thread reads; whatever goes wrong is a `PortError` in words."""

import contextlib
import errno
import fcntl
import os
import select
import socket
import termios
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import serial  # at run time where a port is opened: what an instrument is can be asked without one

READ_TIMEOUT = 0.05
_MOST_AT_ONCE = 4096
_DEAD_PEER_MS = 10_000
_BY_ID = Path("/dev/serial/by-id")
# what pyserial raises when a device goes away in the middle: bare OSError, termios.error (no OSError), TypeError
_HANGUP = (OSError, termios.error, TypeError)


class PortError(Exception):
    """The port cannot be used; the message names it, the cause and the next step."""


class PortAbsentError(PortError):
    """There is no such port, at present."""


@dataclass(frozen=True, slots=True)
class PortInfo:
    """A serial port that this machine has."""

    device: str  # path
    stable_id: str  # name that survives replugging, or the path
    description: str  # the adapter's own


def available() -> list[PortInfo]:
    """Return the serial ports of this machine, those with a stable id first."""
    from serial.tools import list_ports

    by_id = {str(link.resolve()): str(link) for link in sorted(_BY_ID.glob("*"))}
    ports = [PortInfo(p.device, by_id.get(p.device, p.device), p.description or "") for p in list_ports.comports()]
    return sorted(ports, key=lambda p: (p.stable_id == p.device, p.device))


class Port(contextlib.AbstractContextManager["Port"]):
    """An open line, held exclusively.

    `name`: path, name under /dev/serial/by-id, or any pyserial URL.
    `baud`: line speed.
    `lasting_name`: name that leads to the same adapter later; see the function `lasting_name`.
    Raises PortError if it cannot be opened.
    """

    def __init__(self, name: str, baud: int) -> None:
        self.name = name
        self._serial = _open(name, resolve(name), baud)
        self.lasting_name = lasting_name(name)
        self._claim()

    def reopen(self, baud: int) -> None:
        """Open the line again, after it was lost: the same adapter's, which may be another device by now.

        Raises PortError if it cannot be opened; PortAbsentError if it is not there.
        """
        self.close()
        device = self.lasting_name
        if "://" not in device and not Path(device).exists():
            raise PortAbsentError(f"{device} is not there")
        if device.startswith("/dev/pts/"):
            raise PortError(
                f"{device} is a pseudo-terminal: its number is soon another's, only a link leads to it again"
            )
        self._serial = _open(self.name, device, baud)
        self._claim()

    @property
    def is_open(self) -> bool:
        """True if it is open; a line that hung up stays open until it is closed."""
        return bool(self._serial.is_open)

    def has_moved(self) -> bool:
        """Return True if its name leads to another device by now than the one that is open."""
        descriptor = getattr(self._serial, "fd", None)
        try:
            return descriptor is not None and os.fstat(descriptor).st_rdev != Path(self.lasting_name).stat().st_rdev
        except OSError:  # it leads to nothing: whether the line is gone is for its reader to find out
            return False

    def _claim(self) -> None:
        """Keep programs out that ask for no lock, and have neither an FTDI adapter nor a network hold bytes back."""
        network = getattr(self._serial, "_socket", None)
        if isinstance(network, socket.socket):
            # single letters must leave at once; a peer that acknowledges nothing is gone, though it did not hang up
            network.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            network.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _DEAD_PEER_MS)
        descriptor = getattr(self._serial, "fd", None)
        if descriptor is None:
            return
        # a pseudo-terminal or a driver without these controls works as well without them
        with contextlib.suppress(OSError):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)
        with contextlib.suppress(OSError, ValueError, NotImplementedError):
            self._serial.set_low_latency_mode(True)

    @property
    def baud(self) -> int:
        """Line speed of the host's end, bits a second."""
        return int(self._serial.baudrate)

    def set_baud(self, baud: int) -> None:
        """Change the host's line speed."""
        try:
            self._serial.baudrate = baud
        except (*_HANGUP, ValueError) as error:
            raise PortError(f"{self.name}: the line speed {baud} cannot be set ({error}).") from error

    def read(self, size: int) -> bytes:
        """Return up to `size` bytes; fewer, or none, when the line is quiet for 50 ms.

        Raises PortError if the line is gone.
        """
        try:
            return bytes(self._serial.read(size))
        except _HANGUP as error:
            raise PortError(self._gone(error)) from error

    def take(self, patience_s: float = READ_TIMEOUT) -> bytes:
        """Return all bytes that have arrived, as soon as there are any; none when the line is quiet for so long.

        A terminal server of RFC 2217 is given 50 ms, whatever is asked for.
        Raises PortError if the line is gone.
        """
        try:
            descriptor = getattr(self._serial, "fd", None)
            if descriptor is None and self.name.startswith("socket://"):
                descriptor = self._serial.fileno()
            if descriptor is None:
                first = bytes(self._serial.read(1))
                return first + bytes(self._serial.read(self._serial.in_waiting)) if first else first
            if not select.select((descriptor,), (), (), patience_s)[0]:
                return b""
            data = os.read(descriptor, _MOST_AT_ONCE)
        except BlockingIOError:  # another cause to wake
            return b""
        except _HANGUP as error:
            raise PortError(self._gone(error)) from error
        if not data:
            raise PortError(self._gone(OSError("it hung up")))
        return data

    def write(self, data: bytes) -> None:
        """Send bytes.

        Raises PortError if the line is gone or takes nothing for a second.
        """
        try:
            self._serial.write(data)
        except _HANGUP as error:
            raise PortError(self._gone(error)) from error

    def waiting(self) -> int:
        """Return how many bytes have arrived and were not read; over a network maybe fewer, but 0 only if none.

        Raises PortError if the line is gone.
        """
        try:
            return int(self._serial.in_waiting)
        except _HANGUP as error:
            raise PortError(self._gone(error)) from error

    def discard_input(self) -> None:
        """Drop the bytes that have arrived."""
        try:
            self._serial.reset_input_buffer()
        except _HANGUP as error:
            raise PortError(self._gone(error)) from error

    def close(self) -> None:
        """Close the port, so that another program may open it; a line that is gone is closed as well."""
        descriptor = getattr(self._serial, "fd", None)
        if descriptor is not None:
            # a pseudo-terminal lives on in the virtual instrument, and would stay shut to all but root
            with contextlib.suppress(OSError):
                fcntl.ioctl(descriptor, termios.TIOCNXCL)
        with contextlib.suppress(*_HANGUP):  # closing a line that hung up is no news
            self._serial.close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _gone(self, error: BaseException) -> str:
        # pyserial's message at an end of file is a guess of two lines
        why = "it hung up" if "returned no data" in str(error) else error
        return f"{self.name} went away ({why}). Check the cable and the adapter."


def resolve(name: str) -> str:
    """Return the path of a device that is named by its stable id; any other name as it is."""
    stable = _BY_ID / name
    return str(stable) if "/" not in name and stable.exists() else name


def lasting_name(name: str) -> str:
    """Return a name that leads to the same adapter after it was plugged in again, perhaps as another device.

    A symbolic link and a URL are such names; for a bare device path it is its link in /dev/serial/by-id, where it has
    one, and else the path itself.
    """
    device = resolve(name)
    if "://" in device or Path(device).is_symlink():
        return device
    links = sorted(_BY_ID.glob("*")) if _BY_ID.is_dir() else []
    return next((str(link) for link in links if os.path.realpath(link) == os.path.realpath(device)), device)


def _open(name: str, device: str, baud: int) -> "serial.SerialBase":
    import serial

    network = "://" in device
    try:
        return serial.serial_for_url(
            device,
            baudrate=baud,
            timeout=READ_TIMEOUT,
            # pyserial knows no such limit for a terminal server of RFC 2217, and refuses one
            write_timeout=None if device.startswith("rfc2217:") else 1.0,
            exclusive=None if network else True,
        )
    except (serial.SerialException, ValueError, OSError, termios.error) as error:
        raise PortError(_explain(name, device, error)) from error


def _explain(name: str, device: str, error: BaseException) -> str:
    number = getattr(error, "errno", None)
    known = [p.stable_id for p in available()]
    ports = f"Ports of this machine: {', '.join(known)}." if known else "This machine has no serial port."
    virtual = "`imutui demo` needs none; `imutui virtual` makes a virtual instrument's."
    if "://" in device:
        return f"{name} cannot be reached: {error}. Check host, port number and the terminal server."
    if number in (errno.EACCES, errno.EPERM):
        group = _group(device)
        return (
            f"{name}: no permission to open it. It belongs to group {group}: `sudo usermod -aG {group} $USER`, then log"
            " in again; or add a udev rule that gives you the adapter."
        )
    if number == errno.ENOENT or not Path(device).exists():
        return f"{name}: there is no such port. {ports} {virtual}"
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK) or "exclusively lock" in str(error):
        holder = _holder(device)
        return (
            f"{name} is in use{f' by {holder}' if holder else ''}. If that is imutui: `imutui attach` or `imutui stop`;"
            " otherwise end the other program first."
        )
    configuring = error.__context__  # pyserial names the cause in words only
    alien = isinstance(configuring, termios.error) and configuring.args[0] == errno.ENOTTY
    if alien or isinstance(error, termios.error) or Path(device).is_file() or Path(device).is_dir():
        return f"{name} is no serial port. {ports} {virtual}"
    return f"{name} cannot be opened: {error}. {ports}"


def _group(device: str) -> str:
    import grp

    try:
        return grp.getgrgid(Path(device).stat().st_gid).gr_name
    except (KeyError, OSError):
        return "dialout"


def _holder(device: str) -> str:
    """Return the processes that have the device open, as far as this user may see: "name (pid 123)"."""
    target = os.path.realpath(device)
    holders = []
    for process in Path("/proc").glob("[0-9]*"):
        if int(process.name) == os.getpid():
            continue
        try:
            open_here = any(os.path.realpath(fd) == target for fd in (process / "fd").iterdir())
            if open_here:
                holders.append(f"{(process / 'comm').read_text().strip()} (pid {process.name})")
        except OSError:  # another user's process, or one that just ended
            continue
    return ", ".join(sorted(holders))

"""The serial port: the only user of pyserial. One thread reads; whatever goes wrong is a `PortError` in words."""

import contextlib
import errno
import fcntl
import os
import termios
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import serial
from serial.tools import list_ports

READ_TIMEOUT = 0.05
# what pyserial raises when a device goes away in the middle: bare OSError, termios.error (no OSError), TypeError
_HANGUP = (OSError, termios.error, TypeError)


class PortError(Exception):
    """The port cannot be used; the message says which, why, and what to do next."""


@dataclass(frozen=True, slots=True)
class PortInfo:
    """A serial port that this machine has.

    Attributes
    ----------
    device : str
        Path.
    stable_id : str
        Name that survives replugging, or the path.
    description : str
        What the adapter says of itself.
    """

    device: str
    stable_id: str
    description: str


def available() -> list[PortInfo]:
    """Serial ports of this machine, those with a stable id first."""
    by_id = {str(link.resolve()): str(link) for link in sorted(Path("/dev/serial/by-id").glob("*"))}
    ports = [PortInfo(p.device, by_id.get(p.device, p.device), p.description or "") for p in list_ports.comports()]
    return sorted(ports, key=lambda p: (p.stable_id == p.device, p.device))


class Port:
    """An open line, held exclusively.

    Parameters
    ----------
    name : str
        Path, name under /dev/serial/by-id, or any pyserial URL.
    baud : int
        Line speed.

    Raises
    ------
    PortError
        If it cannot be opened.
    """

    def __init__(self, name: str, baud: int) -> None:
        self.name = name
        device = resolve(name)
        try:
            self._serial = serial.serial_for_url(
                device,
                baudrate=baud,
                timeout=READ_TIMEOUT,
                write_timeout=1.0,
                exclusive=None if "://" in device else True,
            )
        except (serial.SerialException, ValueError, OSError, termios.error) as error:
            raise PortError(_explain(name, device, error)) from error
        self._claim()

    def _claim(self) -> None:
        """Keep programs out that do not ask for a lock, and ask an FTDI adapter not to hold bytes back for 16 ms."""
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
        """Up to `size` bytes; fewer, or none, when the line is quiet for 50 ms.

        Raises
        ------
        PortError
            If the line is gone.
        """
        try:
            return bytes(self._serial.read(size))
        except _HANGUP as error:
            raise PortError(self._gone(error)) from error

    def write(self, data: bytes) -> None:
        """Send bytes.

        Raises
        ------
        PortError
            If the line is gone or takes nothing for a second.
        """
        try:
            self._serial.write(data)
        except _HANGUP as error:
            raise PortError(self._gone(error)) from error

    def discard_input(self) -> None:
        """Forget bytes that have arrived."""
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

    def __enter__(self) -> "Port":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _gone(self, error: BaseException) -> str:
        return f"{self.name} went away ({error}). Check the cable and the adapter, then connect again."


def resolve(name: str) -> str:
    """Path of a device that is named by its stable id; any other name as it is."""
    stable = Path("/dev/serial/by-id") / name
    return str(stable) if "/" not in name and stable.exists() else name


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
    """Who has the device open, as far as this user may see: "name (pid 123)"."""
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

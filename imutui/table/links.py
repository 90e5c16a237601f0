"""Links to a table's controller: TCP and serial line by `instrument.port`, GPIB by pyvisa, an extra."""

import contextlib
from collections.abc import Callable
from typing import Any, TypeAlias

from filters.errors import InputError
from imutui.instrument.port import Port, PortError

# A driver notes "40 ms a command at the least on GPIB"; a serial line is assumed to be no faster.
_PAUSE_S = 0.04
# An answer comes in one segment over TCP, and with a line end, it is assumed, over a serial line.
_QUIET_TCP_S, _QUIET_SERIAL_S = 0.001, 0.1


class TableError(Exception):
    """The table cannot do it, or does not do what it should; the message has the next step."""


class TableLinkError(TableError):
    """The controller cannot be reached, or does not answer; the motion of the table is unknown."""


class PortLink:
    """A serial line or a TCP connection.

    `port`: a path, a stable id, or a URL of pyserial.
    `prefix`: characters before the text of an answer; a controller that sends them also acknowledges commands.
    `baud`: speed of a serial line.
    Methods raise TableLinkError if the line is lost or closed.
    """

    def __init__(self, port: str, prefix: int, baud: int = 9600) -> None:
        self.name = port.removeprefix("socket://")
        self.prefix = prefix
        self.acknowledges = prefix > 0  # commands that ask nothing are answered too
        self.pause_s = _PAUSE_S  # after a command that is not answered
        self.quiet_s = _QUIET_TCP_S if prefix else _QUIET_SERIAL_S  # silence that ends an answer without a line end
        self._is_closed = False
        try:
            self._port = Port(port, baud)
        except PortError as error:
            raise TableLinkError(f"the table's controller can't be reached. {error}") from error

    def send(self, data: bytes) -> None:
        """Send bytes."""
        self._try(lambda: self._port.write(data))

    def receive(self, patience_s: float) -> bytes:
        """Return the bytes that have arrived, as soon as there are any; none if the line is quiet for so long."""
        return bytes(self._try(lambda: self._port.take(patience_s)))

    def close(self) -> None:
        """Close the line."""
        self._is_closed = True
        self._port.close()

    def _try(self, do: Callable[[], Any]) -> Any:
        if self._is_closed:
            raise TableLinkError(f"the link to the table's controller at {self.name} is closed.")
        try:
            return do()
        except PortError as error:
            raise TableLinkError(f"the link to the table's controller is lost. {error}") from error


class GpibLink:
    """A resource of pyvisa, such as "GPIB0::1::INSTR", with the methods of `PortLink`."""

    # the bus marks the end of an answer: it is read once, without waiting for more
    prefix, acknowledges, pause_s, quiet_s = 0, False, _PAUSE_S, 0.0

    def __init__(self, resource: str) -> None:
        try:
            import pyvisa
        except ImportError as error:
            raise InputError(
                "a controller on GPIB needs pyvisa, which is not installed here. Type: pip install 'imutui[gpib]'"
            ) from error
        self.name = resource
        self._errors = (pyvisa.Error, OSError, ValueError)  # ValueError: no library for a bus is installed
        self._resource: Any = self._try(lambda: pyvisa.ResourceManager().open_resource(resource))

    def send(self, data: bytes) -> None:
        self._try(lambda: self._resource.write_raw(data))

    def receive(self, patience_s: float) -> bytes:
        self._resource.timeout = max(1000.0 * patience_s, 1.0)
        return bytes(self._try(self._resource.read_raw, at_timeout=b""))

    def close(self) -> None:
        with contextlib.suppress(*self._errors):  # the resource may be lost already
            self._resource.close()

    def _try(self, do: Callable[[], Any], at_timeout: bytes | None = None) -> Any:
        try:
            return do()
        except self._errors as error:
            if at_timeout is not None and "timeout" in str(error).lower():
                return at_timeout
            raise TableLinkError(
                f"the table's controller at {self.name} can't be reached: {error}. Check bus and address."
            ) from error


Link: TypeAlias = PortLink | GpibLink

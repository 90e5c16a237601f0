"""Links to a controller: TCP and serial line by `instrument.port`, GPIB by pyvisa, an extra."""

import contextlib
from collections.abc import Callable
from typing import Any, Protocol

from filters.errors import InputError
from imutui.instrument.port import Port, PortError
from imutui.table.controller import TableLinkError

# a driver notes "40 ms a command at the least on GPIB"; a serial line is assumed to be no faster
_PAUSE_S = 0.04
# an answer comes in one segment over TCP, and with a line end, it is assumed, over a serial line
_QUIET_TCP_S, _QUIET_SERIAL_S = 0.001, 0.1


class Link(Protocol):
    """An open line to a controller. `send` and `receive` raise TableLinkError if the line is gone or closed."""

    name: str
    prefix: int  # characters before the text of an answer
    acknowledges: bool  # whether a command that asks nothing is answered too
    pause_s: float  # after a command that is not answered
    quiet_s: float  # after which an answer without a line end has come whole

    def send(self, data: bytes) -> None:
        """Send bytes."""
        ...

    def receive(self, patience_s: float) -> bytes:
        """Return the bytes that have arrived, as soon as there are any; none if the line is quiet for so long."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


class PortLink:
    """A serial line, or a TCP connection.

    `port`: a path, a stable id, or a URL of pyserial.
    `prefix`: how many characters stand before the text of an answer; a line that has them acknowledges commands.
    `baud`: speed of a serial line.
    """

    def __init__(self, port: str, prefix: int, baud: int = 9600) -> None:
        self.name = port.removeprefix("socket://")
        self.prefix, self.acknowledges, self.pause_s = prefix, prefix > 0, _PAUSE_S
        self.quiet_s = _QUIET_TCP_S if prefix else _QUIET_SERIAL_S
        self._is_closed = False
        try:
            self._port = Port(port, baud)
        except PortError as error:
            raise TableLinkError(f"the table's controller can't be reached. {error}") from error

    def send(self, data: bytes) -> None:
        self._refuse_closed()
        try:
            self._port.write(data)
        except PortError as error:
            raise self._lost(error) from error

    def receive(self, patience_s: float) -> bytes:
        self._refuse_closed()
        try:
            return self._port.take(patience_s)
        except PortError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        self._is_closed = True
        self._port.close()

    def _refuse_closed(self) -> None:
        if self._is_closed:
            raise TableLinkError(f"the link to the table's controller at {self.name} is closed.")

    def _lost(self, error: PortError) -> TableLinkError:
        return TableLinkError(f"the link to the table's controller is lost. {error}")


class GpibLink:
    """A resource of pyvisa, such as "GPIB0::1::INSTR"."""

    # the bus marks the end of an answer: there is nothing to wait for beyond it
    prefix, acknowledges, pause_s, quiet_s = 0, False, _PAUSE_S, 0.0

    def __init__(self, resource: str) -> None:
        try:
            import pyvisa
        except ImportError as error:
            raise InputError(
                "a controller on GPIB needs pyvisa, which is not installed here. Type: pip install 'imutui[gpib]'"
            ) from error
        self.name = resource
        self._errors = (pyvisa.Error, OSError, ValueError)  # the last where there is no library for a bus
        self._resource: Any = self._doing(lambda: pyvisa.ResourceManager().open_resource(resource))

    def send(self, data: bytes) -> None:
        self._doing(lambda: self._resource.write_raw(data))

    def receive(self, patience_s: float) -> bytes:
        self._resource.timeout = max(1000.0 * patience_s, 1.0)
        try:
            return bytes(self._resource.read_raw())
        except self._errors as error:
            if "timeout" in str(error).lower():
                return b""
            raise self._lost(error) from error

    def close(self) -> None:
        with contextlib.suppress(*self._errors):  # one that is gone is closed as well
            self._resource.close()

    def _doing(self, what: Callable[[], object]) -> Any:
        try:
            return what()
        except self._errors as error:
            raise self._lost(error) from error

    def _lost(self, error: Exception) -> TableLinkError:
        return TableLinkError(
            f"the table's controller at {self.name} can't be reached: {error}. Check bus and address."
        )

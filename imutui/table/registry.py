"""The controllers of tables that there are, by the scheme of a URL."""

from collections.abc import Callable
from urllib.parse import parse_qsl

from filters.errors import InputError
from filters.motion.segments import AXES
from imutui.table.acutrol import PREFIX_CHARACTERS, TCP_PORT
from imutui.table.acutrol_host import Acutrol
from imutui.table.controller import TableController
from imutui.table.links import GpibLink, PortLink

_BAUD = 9600


def _tcp(address: str, options: dict[str, str], axes: tuple[str, ...] | None, asks: bool) -> TableController:
    host, _, port = address.rpartition(":") if ":" in address.rpartition("]")[2] else (address, "", str(TCP_PORT))
    if not host or not port.isdigit() or int(port) > 65535:
        raise InputError(f'"{address}" is no HOST:PORT, such as 192.168.1.53:{TCP_PORT}')
    return Acutrol(PortLink(f"socket://{host}:{int(port)}", PREFIX_CHARACTERS), axes, asks=asks)


def _serial(address: str, options: dict[str, str], axes: tuple[str, ...] | None, asks: bool) -> TableController:
    baud = options.get("baud", str(_BAUD))
    if not baud.isdigit() or not 50 <= int(baud) <= 4_000_000:
        raise InputError(f'`baud` is "{baud}", no line speed such as {_BAUD}')
    return Acutrol(PortLink(address, 0, int(baud)), axes, asks=asks)


def _gpib(address: str, options: dict[str, str], axes: tuple[str, ...] | None, asks: bool) -> TableController:
    return Acutrol(GpibLink(address), axes, asks=asks)


_Maker = Callable[[str, dict[str, str], tuple[str, ...] | None, bool], TableController]
CONTROLLERS: dict[str, _Maker] = {
    "acutrol": _tcp,
    "acutrol+serial": _serial,
    "acutrol+gpib": _gpib,
}
"""Makers by scheme; each takes the URL behind the scheme, its options, its axes if named, and whether to ask."""

USAGE = "acutrol://HOST:PORT, acutrol+serial:PORT?baud=N or acutrol+gpib:RESOURCE"
_OPTIONS = ("baud", "axes")


def check(url: str) -> None:
    """Raise InputError if a URL is none of a controller; nothing is opened."""
    _parsed(url)


def connect(url: str, *, asks: bool = True) -> TableController:
    """Connect to the controller at a URL; `?axes=inner,outer` names its axes in the order of their numbers.

    Nothing but questions is sent; with `asks` False nothing at all, so that a stop comes first.
    Raises InputError if the URL is none, TableError if it can't be reached or does not answer as one.
    """
    make, address, options, axes = _parsed(url)
    return make(address, options, axes, asks)


def _parsed(url: str) -> tuple[_Maker, str, dict[str, str], tuple[str, ...] | None]:
    scheme, colon, rest = url.partition(":")
    if not colon or scheme not in CONTROLLERS:
        raise InputError(f'the controller is "{url}"; it is one of: {USAGE}')
    address, _, query = rest.partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True))
    unknown = sorted(set(options) - set(_OPTIONS))
    if unknown:
        raise InputError(f'the controller "{url}" has an option "{unknown[0]}"; known: {", ".join(_OPTIONS)}')
    axes = tuple(options["axes"].split(",")) if "axes" in options else None
    if axes is not None and (not set(axes) <= set(AXES) or len(set(axes)) != len(axes)):
        raise InputError(f'`axes` is "{options["axes"]}", not some of {", ".join(AXES)}, each once')
    return CONTROLLERS[scheme], address.removeprefix("//"), options, axes

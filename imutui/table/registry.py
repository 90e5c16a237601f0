"""The controllers of tables, by the scheme of a URL."""

from collections.abc import Callable
from urllib.parse import parse_qsl

from filters.errors import InputError
from filters.motion.segments import AXES
from imutui.table.acutrol import PREFIX_CHARACTERS, TCP_PORT
from imutui.table.acutrol_host import Acutrol
from imutui.table.controller import TableController
from imutui.table.links import GpibLink, Link, PortLink

_BAUD = 9600


def _tcp(address: str, options: dict[str, str]) -> Link:
    host, _, port = address.rpartition(":") if ":" in address.rpartition("]")[2] else (address, "", str(TCP_PORT))
    if not host or not port.isdigit() or int(port) > 65535:
        raise InputError(f'"{address}" is no HOST:PORT, such as 192.168.1.53:{TCP_PORT}')
    return PortLink(f"socket://{host}:{int(port)}", PREFIX_CHARACTERS)


def _serial(address: str, options: dict[str, str]) -> Link:
    baud = options.get("baud", str(_BAUD))
    if not baud.isdigit() or not 50 <= int(baud) <= 4_000_000:
        raise InputError(f'`baud` is "{baud}", no line speed such as {_BAUD}')
    return PortLink(address, 0, int(baud))


_Opener = Callable[[str, dict[str, str]], Link]
CONTROLLERS: dict[str, _Opener] = {
    "acutrol": _tcp,
    "acutrol+serial": _serial,
    "acutrol+gpib": lambda address, options: GpibLink(address),
}
"""Openers of links by scheme; each takes the URL behind the scheme, and its options."""

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
    opened, address, options, axes = _parsed(url)
    return Acutrol(opened(address, options), axes, asks=asks)


def _parsed(url: str) -> tuple[_Opener, str, dict[str, str], tuple[str, ...] | None]:
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

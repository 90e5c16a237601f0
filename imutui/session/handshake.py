"""The opening dialogue: find the line speed, identify the unit, set the mode. Right under every reading of `R`.

`P`, quiet, flush, `R`, expect `H`, `S`, `v`, then always the mode again: a ping may or may not reset it.
"""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from imutui.instrument.crossbow import (
    POWER_UP_BAUD,
    AskSerialNumber,
    AskVersion,
    BaudReady,
    BaudSet,
    Command,
    Decoder,
    Discarded,
    MeasureBaud,
    Mode,
    ModeSet,
    Ping,
    Pong,
    RequestBaud,
    SerialNumber,
    SetMode,
    StopStream,
    Version,
    encode,
)
from imutui.instrument.port import Port
from imutui.plain_text import NAME_LIMIT, NOTE_LIMIT, one_line

_QUIET_S = 0.06
_QUIET_LIMIT_S = 1.0
_REPLY_S = 0.4
_TRIES = 3
SPEEDS = (POWER_UP_BAUD, 57600, 115200, 19200, 9600)
_OTHERS = re.compile(
    r"IMU[ -]?(300|400C[ABCE]|440|5\d\d|6\d\d)\S*|AHRS\S*|\bVG\S*|\bRGA\S*|\bNAV\S*|DMU\S*|HDX\S*|\bMTI\S*", re.I
)

# what a virtual unit's version ends in when there is more to say
_MORE = re.compile(r"VIRTUAL .*\+(\d{1,2})$")

T = TypeVar("T")


class InstrumentError(Exception):
    """The instrument is not there, is another one, or does not behave; the message says what to do next."""


@dataclass(frozen=True, slots=True)
class Identity:
    """What the unit says of itself.

    Attributes
    ----------
    serial_number, version : str
        Empty where it did not answer.
    source : str
        Where a virtual unit's readings come from, if it says so.
    """

    serial_number: str
    version: str
    source: str = ""


def open_dialogue(
    port: Port,
    baud: int,
    say: Callable[[str], None],
    *,
    accept: Callable[[Identity], None] = lambda identity: None,
    speeds: Sequence[int] = SPEEDS,
) -> Identity:
    """Stop the unit, find its speed, identify it, set speed and scaled mode; it is polled afterwards.

    Parameters
    ----------
    port : Port
        Open; left at the unit's speed.
    baud : int
        Wanted speed; the unit is moved there by its auto-baud sequence.
    say : callable
        Told what is being waited for.
    accept : callable
        Raises InstrumentError to refuse a unit for what it says of itself, before anything of it is changed.
    speeds : sequence of int
        Where to look for it, besides the speed of the port and the wanted one.

    Returns
    -------
    Identity

    Raises
    ------
    InstrumentError
        If nothing answers, garbage answers, or another model does.
    PortError
        If the line goes away.
    """
    say("waiting for the instrument to answer a ping")
    find_speed(port, baud, speeds)
    identity = identify(port)
    accept(identity)
    check_model(port, identity)
    if port.baud != baud:
        _move_speed(port, baud, say)
    if not set_scaled(port):
        raise InstrumentError(
            f"{port.name}: the unit answers a ping but not the command for scaled mode, so its packets could not be"
            " trusted. Power it off and on, then connect again."
        )
    return identity


def identify(port: Port) -> Identity:
    """What a unit that is polled, on a quiet line at its own speed, says of itself."""
    number = ask(port, AskSerialNumber(), SerialNumber)
    version = ask(port, AskVersion(), Version)
    text = one_line(version.text, NAME_LIMIT) if version else ""
    return Identity(str(number.number) if number else "", text, _source(port, text))


def _source(port: Port, version: str) -> str:
    """What a virtual unit says of its readings behind its version; "" of a real one, which is asked nothing more."""
    announced = _MORE.search(version)
    if announced is None:
        return ""
    for _ in range(_TRIES):
        pieces = [ask(port, AskVersion(), Version) for _ in range(int(announced[1]))]
        told = [piece.text for piece in pieces if piece is not None]
        if len(told) == len(pieces):
            return one_line("".join(told), NOTE_LIMIT)
        # a piece was lost: from the beginning
        ask(port, Ping(), Pong)
        ask(port, AskVersion(), Version)
    return ""


def ask(port: Port, command: Command, kind: type[T], timeout: float = _REPLY_S) -> T | None:
    """Send a command on a quiet line and wait for its reply; None if it does not come."""
    decoder = Decoder()
    decoder.expect_reply(command)
    port.write(encode(command))
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        data = port.read(decoder.missing)
        for event in decoder.feed(data) if data else decoder.quiet():
            if isinstance(event, kind):
                return event
    return None


def set_scaled(port: Port) -> bool:
    """Set scaled mode on a quiet line; whether the unit says that it is set."""
    return any(ask(port, SetMode(Mode.SCALED), ModeSet) is not None for _ in range(_TRIES))


def stop_stream(port: Port) -> bytes:
    """Send `P`, wait until the line is quiet, flush; returns what came meanwhile."""
    port.write(encode(StopStream()))
    heard = b""
    deadline = time.monotonic() + _QUIET_LIMIT_S
    quiet_since = time.monotonic()
    while time.monotonic() < deadline and time.monotonic() - quiet_since < _QUIET_S:
        data = port.read(64)
        if data:
            heard += data
            quiet_since = time.monotonic()
    port.discard_input()
    return heard


def find_speed(port: Port, wanted: int, speeds: Sequence[int] = SPEEDS) -> None:
    """Stop the unit and find the speed at which it answers a ping; the port is left at it.

    Parameters
    ----------
    port : Port
        Open; its speed is tried first.
    wanted : int
        Tried next.
    speeds : sequence of int
        Tried then.

    Raises
    ------
    InstrumentError
        If nothing answers at any speed, or not as a Crossbow unit does.
    PortError
        If the line goes away.
    """
    heard, first = b"", port.baud
    for speed in dict.fromkeys((first, wanted, *speeds)):
        port.set_baud(speed)
        heard += stop_stream(port)
        for _ in range(_TRIES if speed == first else 1):
            decoder = Decoder()
            decoder.expect_reply(Ping())
            port.write(encode(Ping()))
            pong, noise = _await_pong(port, decoder)
            heard += noise
            if pong:
                return
            if noise:
                heard += stop_stream(port)
    raise InstrumentError(_no_answer(port, heard))


def _await_pong(port: Port, decoder: Decoder) -> tuple[bool, bytes]:
    noise = b""
    deadline = time.monotonic() + _REPLY_S / 2
    while time.monotonic() < deadline:
        data = port.read(decoder.missing)
        for event in decoder.feed(data):
            if isinstance(event, Pong):
                # a pong amid other bytes is one of their bytes: a unit answers `H` and nothing else
                rest = port.read(18)
                return not noise and not rest, noise + rest
            if isinstance(event, Discarded):
                noise += event.data
    return False, noise


def _no_answer(port: Port, heard: bytes) -> str:
    tried = "tried " + ", ".join(str(s) for s in SPEEDS) + " baud"
    if heard:
        start = heard[:8].hex(" ").upper()
        return (
            f"{port.name}: something answers, but not as a Crossbow IMU: {len(heard)} bytes, starting {start}"
            f" ({tried}). Is it another device, or another cable? Name the unit's own port."
        )
    return (
        f"{port.name} is silent: no answer to a ping ({tried}). Check that the unit has power (9 to 30 V), that"
        " transmit and receive are not swapped, and that this is its port."
    )


def _move_speed(port: Port, baud: int, say: Callable[[str], None]) -> None:
    found = port.baud
    say(f"moving the line from {found} to {baud} baud")
    if ask(port, RequestBaud(), BaudReady) is not None:
        port.set_baud(baud)
        if ask(port, MeasureBaud(), BaudSet) is not None:
            return
    raise InstrumentError(
        f"{port.name}: the unit answers at {found} baud and will not go to {baud}."
        f" Connect with --baud {found}, or power it off and on."
    )


def check_model(port: Port, identity: Identity) -> None:
    """Refuse a unit whose ranges and packets are others; raises InstrumentError, which quotes what it said."""
    version = identity.version.upper().replace(" ", "")
    other = re.search(r"IMU400CD-(?!200)\d", version) if "IMU400CD" in version else _OTHERS.search(identity.version)
    if other:
        raise InstrumentError(
            f'{port.name}: the unit says it is "{identity.version}", not an IMU400CD-200. Its ranges and packets'
            " differ, so its readings would be wrong. Connect the IMU400CD, or name its port."
        )

"""The dialogue with an IMU400CD: its line speed, who it is, its mode. Right under every reading of `R`.

`P`, quiet, flush, `R`, expect `H`, `S`, `v`, then always the mode again: a ping may or may not reset it.

The unit answers one thing after the other. So the reply to a later command is the sign that an earlier one's does not
come any more; and a letter counts as a reply only where it stands alone, since late text has letters too.
"""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from imutui.instrument.frame_search import Discarded
from imutui.instrument.host import PATIENCE_S, QUICK_S, Identity, InstrumentError
from imutui.instrument.imu400.crossbow import (
    PACKET_BYTES,
    POWER_UP_BAUD,
    Command,
    Reply,
    SerialNumber,
    Version,
    encode,
)
from imutui.instrument.imu400.decoder import reply_decoder
from imutui.instrument.port import Port
from imutui.plain_text import NAME_LIMIT, NOTE_LIMIT, one_line

_QUIET_S = 0.06
_QUIET_LIMIT_S = 1.0
_STOPS_WITHIN_S = 0.25
_PONG_S = 0.2
_TRIES = 3
_PONG = encode(Reply.PONG)
# a reply that came damaged is no reply that is yet to come
_DAMAGED_BYTES, _REST_S = 4, 0.3
# two bytes at the lowest speed: by then what stands behind a letter has begun to come
_BEHIND_S = 0.003
SPEEDS = (POWER_UP_BAUD, 57600, 115200, 19200, 9600)
_OTHERS = re.compile(
    r"IMU[ -]?(300|400C[ABCE]|440|5\d\d|6\d\d)\S*|AHRS\S*|\bVG\S*|\bRGA\S*|\bNAV\S*|DMU\S*|HDX\S*|\bMTI\S*", re.I
)

# what a virtual unit's version ends in when there is more to say
_MORE = re.compile(r"VIRTUAL .*\+(\d{1,2})$")


T = TypeVar("T")


@dataclass(slots=True)
class Asker:
    """Asks one thing after the other, on a quiet line."""

    port: Port  # of a unit that is polled, at its own speed
    patience_s: float = PATIENCE_S  # how long to wait for a reply
    tries: int = 2  # how often at most to ask for what comes damaged
    slowest_s: float = 0.0  # how long the slowest reply so far took

    def ask(self, command: Command, kind: type[T], patience_s: float | None = None) -> T | None:
        """Send a command and wait for its reply; None if it does not come, or came damaged each time."""
        for _ in range(self.tries):
            began = time.monotonic()
            reply, noise = _exchange(self.port, command, kind, patience_s or self.patience_s)
            if reply is not None:
                self.slowest_s = max(self.slowest_s, time.monotonic() - began)
                return reply
            if not noise:
                break
        return None

    @property
    def usual_s(self) -> float:
        """How long a reply may take, by those that have come."""
        return max(QUICK_S, 3.0 * self.slowest_s)


def _exchange(port: Port, command: Command, kind: type[T], patience_s: float) -> tuple[T | None, int]:
    """The reply to a command, if it comes, and how many bytes came that were no part of it."""
    decoder = reply_decoder(command)
    port.write(encode(command))
    began = last = time.monotonic()
    noise, since_quiet = 0, 0
    while True:
        data = port.read(decoder.missing)
        events = decoder.feed(data) if data else decoder.quiet()
        since_quiet = since_quiet + len(data) if data else 0
        reply = next((event for event in events if isinstance(event, kind)), None)
        if reply is not None and _stands_alone(port, reply, since_quiet, quiet=not data):
            return reply, noise
        noise += sum(len(event.data) for event in events if isinstance(event, Discarded)) + (reply is not None)
        if reply is not None:  # a letter of something else: the reply itself is still awaited
            decoder = reply_decoder(command)
        now = time.monotonic()
        last = now if data else last
        if not data and (now - began > patience_s or (noise >= _DAMAGED_BYTES and now - last > _REST_S)):
            return None, noise


def _stands_alone(port: Port, reply: object, since_quiet: int, *, quiet: bool) -> bool:
    """Whether a reply is one, and not a part of something else."""
    if isinstance(reply, Version) and not quiet:
        # the longest text that is a reply has come, and perhaps not all that was said
        while port.read(64):
            pass
    if not isinstance(reply, Reply):
        return True
    time.sleep(_BEHIND_S)
    return since_quiet == 1 and not port.waiting()


def open_dialogue(
    port: Port,
    baud: int,
    *,
    accept: Callable[[Identity], None] = lambda identity: None,
    speeds: Sequence[int] = SPEEDS,
    patience_s: float = PATIENCE_S,
) -> Identity:
    """Stop the unit, find its speed, identify it, set speed and scaled mode; it is polled afterwards.

    `port`: open; left at the unit's speed.
    `baud`: wanted speed; the unit is moved there by its auto-baud sequence.
    `accept`: raises InstrumentError to refuse a unit for what it says of itself, before anything of it is changed.
    `speeds`: where to look for it, besides the speed of the port and the wanted one.
    `patience_s`: how long a reply may take.
    Raises InstrumentError if nothing answers, garbage answers, or another model does.
    Raises PortError if the line goes away.
    """
    find_speed(port, baud, speeds, patience_s)
    identity = identify(port, patience_s)
    accept(identity)
    check_model(port, identity)
    if port.baud != baud:
        _move_speed(Asker(port, patience_s), baud)
    if not set_scaled(port, patience_s):
        raise InstrumentError(
            f"{port.name}: the unit answers a ping but not the command for scaled mode, so its packets could not be"
            " trusted. Power it off and on, then connect again."
        )
    return identity


def identify(port: Port, patience_s: float = PATIENCE_S) -> Identity:
    """What a unit that is polled, on a quiet line at its own speed, says of itself."""
    asker = Asker(port, patience_s)
    number = asker.ask(Command.SERIAL_NUMBER, SerialNumber)
    version = asker.ask(Command.VERSION, Version)
    # who answers the one and not the other is asked once more: a byte may have been lost
    if version is not None and number is None:
        number = asker.ask(Command.SERIAL_NUMBER, SerialNumber, asker.usual_s)
    if number is not None and version is None:
        version = asker.ask(Command.VERSION, Version, asker.usual_s)
    text = one_line(version.text, NAME_LIMIT) if version else ""
    return Identity(str(number.number) if number else "", text, _source(asker, text), asker.slowest_s)


def _source(asker: Asker, version: str) -> str:
    """What a virtual unit says of its readings behind its version; "" of a real one, which is asked nothing more."""
    announced = _MORE.search(version)
    if announced is None:
        return ""
    for _ in range(_TRIES):
        pieces = [asker.ask(Command.VERSION, Version) for _ in range(int(announced[1]))]
        told = [piece.text for piece in pieces if piece is not None]
        if len(told) == len(pieces):
            return one_line("".join(told), NOTE_LIMIT)
        # a piece was lost: from the beginning
        asker.ask(Command.PING, Reply)
        asker.ask(Command.VERSION, Version)
    return ""


def set_scaled(port: Port, patience_s: float = QUICK_S) -> bool:
    """Set scaled mode on a quiet line; whether the unit says that it is set, the last time with so much patience."""
    asker = Asker(port, QUICK_S)
    waits = (QUICK_S,) * (_TRIES - 1) + (patience_s,)
    return any(asker.ask(Command.SCALED_MODE, Reply, wait) is not None for wait in waits)


def stop_stream(port: Port, limit_s: float = _QUIET_LIMIT_S) -> bytes:
    """Send `P`, wait until the line is quiet, for so long at most, flush; returns what came meanwhile."""
    port.write(encode(Command.STOP_STREAM))
    heard = _await_quiet(port, _QUIET_S, limit_s)
    port.discard_input()
    return heard


def _await_quiet(port: Port, quiet_s: float, limit_s: float) -> bytes:
    """Read until nothing has come for so long, or the limit is reached; returns what came."""
    heard = b""
    began = quiet_since = time.monotonic()
    while time.monotonic() - began < limit_s and time.monotonic() - quiet_since < quiet_s:
        data = port.read(64)
        if data:
            heard += data
            quiet_since = time.monotonic()
    return heard


def answers_at(port: Port, baud: int) -> bool:
    """Whether a quick unit is at a speed, asked once; the port is left at it."""
    port.set_baud(baud)
    # one that streams stops within a packet: whatever goes on sending is another
    stop_stream(port, _STOPS_WITHIN_S)
    return _ping(port, _PONG_S)[0]


def find_speed(port: Port, wanted: int, speeds: Sequence[int] = SPEEDS, patience_s: float = PATIENCE_S) -> None:
    """Stop the unit and find the speed at which it answers a ping; the port is left at it.

    `port`: open; its speed is tried first.
    `wanted`: tried next.
    `speeds`: tried then.
    `patience_s`: how long an answer may take. At most speeds none is waited for so long: a slow unit is looked for at
      the first two once more, when no quick one was found.
    Raises InstrumentError if nothing answers at any speed, or not as a Crossbow unit does.
    Raises PortError if the line goes away.
    """
    heard, first = b"", port.baud
    likely = [first, wanted]  # and those at which something answered that was not quick
    for speed in dict.fromkeys((first, wanted, *speeds)):
        pong, noise = _ping_at(port, speed, _PONG_S, _TRIES if speed == first else 1)
        heard += noise
        if pong and (speed == first or (len(likely) == 2 and _is_quick(port))):
            return
        likely += [speed] if pong else []
    for speed in dict.fromkeys(likely) if patience_s > QUICK_S else ():
        for _ in range(2):
            pong, noise = _ping_at(port, speed, patience_s, 1)
            heard += noise
            if pong:
                # more was asked than this, and is answered still
                _await_quiet(port, patience_s, 2.0 * patience_s)
                return
            if not noise:
                break
    raise InstrumentError(_no_answer(port, heard))


def _is_quick(port: Port) -> bool:
    """Whether a unit that has answered a ping is quick: else that was the late answer to one at an earlier speed.

    To be asked once: the next time its answer may be late, too.
    """
    return Asker(port, _PONG_S, tries=1).ask(Command.SERIAL_NUMBER, SerialNumber) is not None


def _ping_at(port: Port, speed: int, patience_s: float, tries: int) -> tuple[bool, bytes]:
    """Whether a unit answers a ping at a speed, and what else was heard there."""
    port.set_baud(speed)
    heard = stop_stream(port)
    for _ in range(tries):
        pong, noise = _ping(port, patience_s)
        heard += noise
        if pong:
            return True, heard
        if noise:
            heard += stop_stream(port)
    return False, heard


def _ping(port: Port, patience_s: float) -> tuple[bool, bytes]:
    decoder = reply_decoder(Command.PING)
    port.write(encode(Command.PING))
    noise = b""
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline and len(noise) < PACKET_BYTES:
        data = port.read(decoder.missing)
        for event in decoder.feed(data):
            if event is Reply.PONG:
                # a pong amid other bytes is one of their bytes: a unit answers `H` and nothing else, late ones too
                rest = port.read(PACKET_BYTES).strip(_PONG)
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
        f"{port.name} is silent: no answer to a ping ({tried}). Check that the unit has power (an IMU400CD takes 9 to"
        " 30 V), that transmit and receive are not swapped, and that this is its port."
    )


def _move_speed(asker: Asker, baud: int) -> None:
    port, found = asker.port, asker.port.baud
    if asker.ask(Command.REQUEST_BAUD, Reply) is not None:
        port.set_baud(baud)
        if asker.ask(Command.MEASURE_BAUD, Reply) is not None:
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

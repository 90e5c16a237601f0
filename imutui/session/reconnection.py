"""Find the same unit again after its line was lost or it fell silent, and set it up as it was.

This runs in the thread that owns the port, for as long as it takes. Another unit is refused, and left as it was found.
"""

import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from imutui.instrument.driver import Driver, Identity, InstrumentError, PacketStream
from imutui.instrument.port import Port, PortAbsentError, PortError

_LOOK_S = 0.2
_REFUSED_S = 1.0
_PING_S = 0.5
_HEAR_S = 2.0
_FEW, _MANY = 16, 4096
# another program may have used it meanwhile: other speeds are tried now and then
_ALL_SPEEDS_EVERY = 8

_LEAST_SILENCE_S = 5.0
_SILENT_PERIODS = 4.0

# no pause of a unit that streams at 133 Hz; what comes more slowly is waited for so many periods
_ASK_AFTER_S, _PAUSE_S, _PAUSE_PERIODS = 0.3, 0.1, 1.5
_ANSWERS_WITHIN_S = 0.6
_SURE_ANSWERS = 2


@dataclass(frozen=True, slots=True)
class KnownUnit:
    """The unit that an acquisition began with; it goes on with no other."""

    identity: Identity  # what it said of itself
    baud: int  # speed of its line
    power_up_bauds: tuple[int, ...] = ()  # speeds that it may have after power-up
    returns: bool = True  # whether its line may come back once it is lost: not that of a virtual unit of our own

    def in_words(self) -> str:
        """Return how the unit is identified."""
        number = self.identity.serial_number
        return f"the unit with serial number {number}" if number else "the same unit"


@dataclass(frozen=True, slots=True)
class LineLost:
    """The line went away, or nothing has come over it for long."""

    message: str  # which line, and what is known of why
    since_ns: int  # when the last packet was read, monotonic
    final: bool  # whether it is not waited for: nothing had come over it yet, or what went away cannot come back


@dataclass(frozen=True, slots=True)
class StillAway:
    """The port or unit that is waited for, in words; `refused` if another unit answers in its place."""

    waits_for: str
    refused: bool


@dataclass(frozen=True, slots=True)
class LineReturned:
    """The same unit is back and was set up as before; its first packet follows."""

    found: str  # how it was found, in words


class DifferentUnitError(InstrumentError):
    """A unit answers, but not the one that is waited for."""


def ask_again_after_s(poll_hz: float | None) -> float:
    """Return after how many seconds without a packet the unit is asked who it is, as after a reset."""
    return max(_LEAST_SILENCE_S, _SILENT_PERIODS / poll_hz if poll_hz else 0.0)


class AmidStream:
    """Detects that a streaming unit has stopped, without stopping one whose line is held up.

    It asks what a streaming unit answers. A unit that answers twice, and sends no packet before, between and after, was
    reset; a line that is held up brings packets with the answers, or nothing. A unit that is not known is not asked.
    """

    def __init__(self, host: Driver, packets: PacketStream, known: KnownUnit | None) -> None:
        self._host, self._packets, self._known = host, packets, known
        pause_s = _PAUSE_PERIODS / host.stream_hz if host.stream_hz else 0.0
        self._ask_after_s, self._pause_s = max(_ASK_AFTER_S, pause_s), max(_PAUSE_S, pause_s)
        self._began_ns = time.monotonic_ns()
        self._asked_ns, self._answers, self._patience_s = 0, 0, _ANSWERS_WITHIN_S

    def has_stopped(self, now_ns: int, last_packet_ns: int) -> bool:
        """Return True if the unit has stopped; to be called while nothing comes. Raises PortError."""
        last_ns = max(last_packet_ns, self._began_ns)
        silent_s, waited_s = (now_ns - last_ns) / 1e9, (now_ns - self._asked_ns) / 1e9
        if self._asked_ns <= last_ns:
            self._answers, self._patience_s = 0, _ANSWERS_WITHIN_S
            if silent_s >= self._ask_after_s:
                self._ask(now_ns)
        elif self._packets.answers > self._answers:
            if waited_s >= self._pause_s:
                self._answers = self._packets.answers
                if self._answers >= _SURE_ANSWERS:
                    return True
                self._ask(now_ns)
        elif waited_s >= self._patience_s:
            # a line that was held up passes all questions on at once, and their answers take the time of packets
            self._patience_s *= 2.0
            self._ask(now_ns)
        return False

    def _ask(self, now_ns: int) -> None:
        self._asked_ns = now_ns
        if self._known is not None:
            self._host.ask_amid(self._known.identity)


def ask_silent(host: Driver, known: KnownUnit, stopping: threading.Event) -> bytes:
    """Ping a unit that nothing comes from, until something does; returns it, up to the next quiet.

    That may be the answer of a unit that was reset, and has its speed still or that of power-up; or packets from
    before, where it was the line that had stalled.
    Raises PortError if the line goes away, or its name leads to another device by now.
    """
    port = host.port
    speeds = dict.fromkeys((known.baud, *known.power_up_bauds))
    for speed in itertools.cycle(speeds):
        if stopping.is_set():
            return b""
        if port.has_moved():
            raise PortError(f"{port.lasting_name} leads to another device by now")
        if len(speeds) > 1:
            port.set_baud(speed)
        host.ask_for_life()
        heard = _hear(port)
        if heard:
            return heard
    raise AssertionError


def _hear(port: Port) -> bytes:
    """Return what comes within half a second, and all that follows it without a pause."""
    began, heard = time.monotonic(), b""
    while not heard and time.monotonic() - began < _PING_S:
        heard = port.read(_FEW)
    data = heard
    while data and time.monotonic() - began < _HEAR_S:
        data = port.read(_MANY)
        heard += data
    return heard


def find_again(
    host: Driver, known: KnownUnit, stopping: threading.Event, emit: Callable[[StillAway], None], *, streams: bool
) -> tuple[Identity, str] | None:
    """Wait for the unit, and set it up as it was; it is polled afterwards.

    The host's port is opened anew if it was closed, or its name leads to another device by now. `emit` is called with
    the port or unit that is waited for, whenever that changes. `streams`: True if the unit streams as long as it keeps
    its power. Returns the unit's identity and, in words, how it was found; None if `stopping` ended the wait.
    """
    port = host.port
    emitted: StillAway | None = None
    streams = streams and not host.streams_from_power_up
    kept_power, unanswered = False, 0
    while not stopping.is_set():
        pause = _LOOK_S
        try:
            if not port.is_open or port.has_moved():
                port.reopen(known.baud)
            kept_power |= streams and bool(port.read(_FEW))
            identity = _set_up(host, known, thorough=unanswered % _ALL_SPEEDS_EVERY == _ALL_SPEEDS_EVERY - 1)
            return identity, _in_words(known, identity, kept_power=kept_power if streams else None)
        except PortAbsentError:
            away = StillAway(f"{port.lasting_name} to come back", refused=False)
        except PortError as error:
            port.close()
            away = StillAway(f"{port.lasting_name} to work: {_first_sentence(error)}", refused=False)
        except DifferentUnitError as error:
            # closed meanwhile: another program may want that unit
            port.close()
            pause, away = _REFUSED_S, StillAway(str(error), refused=True)
        except InstrumentError:
            unanswered += 1
            away = StillAway(f"the unit to answer at {port.lasting_name}", refused=False)
        if away != emitted:
            emit(away)
            emitted = away
        stopping.wait(pause)
    return None


def _set_up(host: Driver, known: KnownUnit, *, thorough: bool) -> Identity:
    """Identify the unit, refuse another one, set its speed and mode; raises InstrumentError or PortError."""

    def accept(identity: Identity) -> None:
        why = refusal(known.identity, identity)
        if why is not None:
            raise DifferentUnitError(f"{known.in_words()}; {host.port.lasting_name} has {why}")

    return host.open(known.baud, accept=accept, thorough=thorough)


def refusal(known: Identity, found: Identity) -> str | None:
    """Return why a unit is not the one that is known, in words; None if it is the same."""
    if known.serial_number:
        if not found.serial_number:
            return "a unit that does not say its serial number"
        return f"another unit, {_number(found)}" if found.serial_number != known.serial_number else None
    # one that did not say its number at first may do so now; the port's name and its version identify it
    if known.version and found.version != known.version:
        return f'another unit, version "{found.version}"' if found.version else "a unit that does not say its version"
    return None


def _number(identity: Identity) -> str:
    return f"serial number {identity.serial_number}"


def _first_sentence(error: PortError) -> str:
    return str(error).partition(". ")[0].removesuffix(".")


def _in_words(known: KnownUnit, identity: Identity, *, kept_power: bool | None) -> str:
    said = [_number(identity) if identity.serial_number else "it does not say its serial number"]
    if not known.identity.serial_number:
        said.append("taken for the same by its port, since it had not said its serial number")
    if identity.version != known.identity.version:
        said.append(f'its version is "{identity.version}" now, "{known.identity.version}" before')
    if kept_power is not None:
        said.append("it was sending still" if kept_power else "it had stopped sending: reset, or without power")
    return "; ".join(said)

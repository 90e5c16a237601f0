"""A controller of Acutrol's dialect over a link: the lines that it is sent, their order, and its answers.

The language was read off two public drivers, see docs/tables.md. The limits of a mode are set before its demand, and
the demand before the mode, since an axis moves to its demand as soon as it enters the mode. A line that the controller
does not understand is sent once more. Each motion also sets the acceleration of the rate mode, because a stop brakes in
that mode. A stop waits for no answer.
"""

import math
import re
import time
from collections.abc import Callable, Iterable, Sequence
from urllib.parse import parse_qsl

from filters.errors import InputError
from filters.motion.segments import AXES
from imutui.table.links import GpibLink, Link, PortLink, TableError, TableLinkError
from imutui.table.motion import (
    LAG_S,
    MODES,
    OFF,
    OSCILLATION,
    POSITION,
    RATE,
    RESTS_DPS,
    AxisLimits,
    Motion,
    Move,
    Swing,
    TableState,
    Turn,
)

LINE_END = b"\r\n"
TCP_PORT, BAUD = 9888, 9600

PREFIX_CHARACTERS = 8
"""Characters before the text of each answer over TCP; their meaning is not known."""

DONE = "OK"
"""The answer over TCP to a command that asks nothing. Over GPIB there is none."""

ABSOLUTE_LIMITS = ("rate", "acceleration", "jerk", "low", "high", "trip")
"""The answer to `:limit:absolute? N`, in deg and seconds; "trip" is a rate at which the drive trips."""

USAGE = "acutrol://HOST:PORT, acutrol+serial:PORT?baud=N or acutrol+gpib:RESOURCE"
_OPTIONS = ("baud", "axes")

_PATIENCE_S = 1.0  # for an answer
_MODES_NS = 100_000_000  # modes and interlocks are asked for again after so long
_CLOSING_S = 3.0  # for interlocks
_ENTERING_S = 0.5  # for a mode
_SLOWING_S = 1.0  # within which an axis that is to stop must have become slower
_SLICE_S = 0.02  # between two calls of `meanwhile`, and for the answer to a command of a stop
_BRAKES_S = 3.0  # braking time of an axis whose rate is not known
_JERK_LAG = 1.5  # lag of an axis over the time in which its jerk reaches its acceleration
_ENDLESS_DEG = 36_000.0  # limits of angle beyond this are none

_WORDS = {OFF: "off", POSITION: "position", RATE: "rate", OSCILLATION: "synthesis"}


def parse(url: str) -> tuple[Callable[[], Link], tuple[str, ...]]:
    """Return an opener of the link to the controller at a URL, and the axes that `?axes=inner,outer` names.

    Raises InputError if the URL is not one of a controller.
    """
    scheme, colon, rest = url.partition(":")
    address, _, query = rest.partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True))
    if unknown := sorted(set(options) - set(_OPTIONS)):
        raise InputError(f'the controller "{url}" has an option "{unknown[0]}"; known: {", ".join(_OPTIONS)}')
    axes = tuple(options["axes"].split(",")) if "axes" in options else ()
    if not set(axes) <= set(AXES) or len(set(axes)) != len(axes):
        raise InputError(f'`axes` is "{options["axes"]}", not some of {", ".join(AXES)}, each once')
    address = address.removeprefix("//")
    match scheme * bool(colon):
        case "acutrol":
            has_port = ":" in address.rpartition("]")[2]
            host, _, port = address.rpartition(":") if has_port else (address, "", str(TCP_PORT))
            if not host or not port.isdigit() or int(port) > 65535:
                raise InputError(f'"{address}" is no HOST:PORT, such as 192.168.1.53:{TCP_PORT}')
            return lambda: PortLink(f"socket://{host}:{int(port)}", PREFIX_CHARACTERS), axes
        case "acutrol+serial":
            baud = options.get("baud", str(BAUD))
            if not baud.isdigit() or not 50 <= int(baud) <= 4_000_000:
                raise InputError(f'`baud` is "{baud}", no line speed such as {BAUD}')
            return lambda: PortLink(address, 0, int(baud)), axes
        case "acutrol+gpib":
            return lambda: GpibLink(address), axes
    raise InputError(f'the controller is "{url}"; it is one of: {USAGE}')


def connect(url: str, *, asks: bool = True) -> "Acutrol":
    """Connect to the controller at a URL; see `Acutrol`.

    Raises InputError if the URL is not one of a controller, TableError if it cannot be reached or answers otherwise.
    """
    opened, axes = parse(url)
    return Acutrol(opened(), axes, asks=asks)


class Acutrol:
    """A controller on the line. A method returns when what it sends is done.

    It sends motions as they are: `motion` checks them. Methods raise TableError if the table does not do it, and
    TableLinkError if the controller cannot be asked.

    `axes`: names of its axes in the order of their numbers. If empty, the controller is asked how many it has: one is
      the inner axis, two are middle and inner.
    `asks`: False sends nothing now, so that a stop can be the first thing sent; axes are counted after that stop.
    """

    def __init__(self, link: Link, axes: tuple[str, ...] = (), *, asks: bool = True) -> None:
        self.meanwhile: Callable[[], None] = lambda: None  # called before a command and while an answer is awaited
        self._link = link
        self._limits: dict[str, AxisLimits] = {}
        self._modes: dict[str, str] = {}
        self._fault = ""
        self._modes_ns = -_MODES_NS
        self._has_line_ends = False  # answers have been seen to end with their line
        self._exchanged = (0, 0)  # when the last line was sent, and when its answer began to come, ns
        self._rates: dict[str, float] = {}  # as read last
        self.axes = axes
        try:
            if asks:
                self._count()
        except TableError:
            self.close()
            raise

    def identify(self) -> str:
        """Return the controller's identification."""
        return self._asked(["*idn?"], lambda texts: bool(texts[0]))[0]

    def limits(self) -> dict[str, AxisLimits]:
        """Return the limits of each axis, as the controller reports them."""
        self._limits = self._limits or {axis: self._limits_of(axis) for axis in self.axes}
        return self._limits

    def _limits_of(self, axis: str) -> AxisLimits:
        question = f":limit:absolute? {self._number(axis)}"
        rate, accel, jerk, low, high, *_ = self._numbers([question], each=len(ABSOLUTE_LIMITS))[0]
        endless = low >= high or max(abs(low), abs(high)) > _ENDLESS_DEG
        if not (rate > 0.0 and accel > 0.0):
            raise TableError(
                f"{self._link.name}: the controller reports limits of {rate:g} deg/s and {accel:g} deg/s^2 for the"
                f" {axis} axis. If there is no such axis, name those that there are: acutrol://HOST:PORT?axes=inner"
            )
        lag = max(LAG_S, _JERK_LAG * accel / jerk) if jerk > 0.0 else LAG_S
        return AxisLimits(rate, accel, None if endless else low, None if endless else high, lag)

    def enable(self) -> None:
        """Close the interlocks, so that drives are ready, with the mode of all axes off.

        Raises InputError if a mode is on or an axis turns: another host commands the table.
        """
        self._look_at_modes()
        on = [f"the {axis} axis is in mode {which}" for axis, which in self._modes.items() if which != OFF]
        if on := on + [f"the {axis} axis turns at {rate:.2f} deg/s" for axis, rate in self._turning().items()]:
            raise InputError(
                f"{'; '.join(on)}: another host commands the table. Nothing was sent. End the other program,"
                " or stop the table: imutui table stop --controller URL"
            )
        for n in range(1, len(self.axes) + 1):
            self._tell(f":demand:rate {n},0", f":mode:off {n}")
            self._tell(*(f":interlock:{what} {n}" for what in ("open", "reset", "close")))
        deadline = time.monotonic() + _CLOSING_S
        while wrong := self._look_at_modes():
            if time.monotonic() > deadline:
                raise TableError(
                    f"{'; '.join(wrong)}, after it was reset and closed. Look for what holds it open (emergency stop,"
                    " door, end switch), then try again."
                )

    def start(self, motion: Motion) -> None:
        """Begin a motion of an axis; the angle of a move is sent as it is.

        Raises InputError if the table has no such axis; nothing is sent then.
        """
        n = self._number(motion.axis)
        accel = f":limit:acc rate,{n},{number(motion.accel_dps2)}"
        match motion:
            case Move(_, angle, rate):
                self._tell(
                    accel, f":limit:rate pos,{n},{number(rate)}", f":limit:acc pos,{n},{number(motion.accel_dps2)}",
                    f":demand:position {n},{number(angle)}",
                )  # fmt: skip
            case Turn(axis, rate):
                self._tell(accel)
                # a limit below the rate at which it turns may be a fault: it is only ever raised before the demand
                if abs(rate) > abs(self._read_rates()[axis]):
                    self._tell(f":limit:rate rate,{n},{number(abs(rate))}")
                self._tell(f":demand:rate {n},{number(rate)}")
            case Swing(axis, amplitude, hz):
                if amplitude:
                    own = self.limits()[axis]
                    rate, swings = min(1.1 * motion.peak_dps, own.rate_dps), min(1.5 * motion.peak_dps2, own.accel_dps2)
                    self._tell(accel, f":limit:rate synt,{n},{number(rate)}", f":limit:acc synt,{n},{number(swings)}")
                elif self._mode_of(axis) != OSCILLATION:
                    return
                self._tell(f":demand:osc {n},{number(amplitude)},{number(hz)},0")
        self._enter(motion.axis, motion.mode)

    def read(self) -> TableState:
        """Return the present angles, as the controller counts them, and rates."""
        if time.monotonic_ns() - self._modes_ns >= _MODES_NS:
            self._look_at_modes()
        said = [each[0] for each in self._numbers(self._of_axes(":read:", "position", "rate"))]
        (sent, heard), angles = self._exchanged, dict(zip(self.axes, said, strict=False))
        self._rates = dict(zip(self.axes, said[len(self.axes) :], strict=True))
        outer, middle, inner = ((angles.get(axis, 0.0), self._rates.get(axis, 0.0)) for axis in AXES)
        return TableState(
            stamp_ns=(sent + heard) // 2,
            uncertainty_ns=(heard - sent + 1) // 2,
            angles_deg=(outer[0], middle[0], inner[0]),
            rates_dps=(outer[1], middle[1], inner[1]),
            mode=max(self._modes.values(), key=MODES.index, default=OFF),
            fault=self._fault,
        )

    def stop(self, brakes_s: float | None = None) -> None:
        """Bring all axes to rest, unasked: rate zero and rate mode of every axis, then mode off of every axis.

        `brakes_s`: time that the axes take to come to rest, at most. Then nothing is asked before the mode is off.
          Without it the controller is asked for rates until all axes rest.
        Raises TableError if the controller does not confirm that all axes rest with their modes off.
        """
        axes = self.axes or AXES
        fastest_first = sorted(axes, key=lambda axis: -abs(self._rates.get(axis, 0.0)))
        numbers = [axes.index(axis) + 1 for axis in fastest_first]
        self._blind(line for n in numbers for line in (f":demand:rate {n},0", f":mode:rate {n}"))
        if brakes_s is None:
            try:
                self._settle()
                self._wait_for_rest()
                brakes_s = 0.0
            except TableError:
                brakes_s = _BRAKES_S
        until = time.monotonic() + brakes_s
        while (left := until - time.monotonic()) > 0.0:
            self.meanwhile()
            time.sleep(min(left, _SLICE_S))
        self._blind(f":mode:off {n}" for n in numbers)
        self._settle()
        wrong = [f"the {axis} axis turns still, at {rate:.2f} deg/s" for axis, rate in self._wait_for_rest().items()]
        deadline = time.monotonic() + _ENTERING_S
        while True:
            self._look_at_modes()
            on = [axis for axis, which in self._modes.items() if which != OFF]
            if not on or time.monotonic() > deadline:
                break
        wrong += [f"the {axis} axis was to enter mode off, and is in mode {self._modes[axis]}" for axis in on]
        if wrong:
            raise TableError(f"{'; '.join(wrong)}. Use the table's own emergency stop.")

    def disable(self) -> None:
        """Open the interlocks, after a stop if a mode is on."""
        self._look_at_modes()
        if set(self._modes.values()) - {OFF}:
            self.stop()
        self._tell(*(f":interlock:open {n}" for n in range(1, len(self.axes) + 1)))

    def close(self) -> None:
        """Close the link; the table continues its motion."""
        self._link.close()

    # --------------------------------------------------------------------------------------------------- of a stop

    def _blind(self, lines: Iterable[str]) -> None:
        """Send lines and wait for no answer; one that the controller refuses at once is sent again."""
        self._modes_ns = -_MODES_NS
        for line in lines:
            for _ in range(2):
                self._link.send(line.encode() + LINE_END)
                if not self._link.acknowledges:
                    time.sleep(self._link.pause_s)
                    break
                text = self._link.receive(_SLICE_S)[self._link.prefix :].strip().upper().decode("ascii", "replace")
                if text.endswith(DONE) or DONE.startswith(text):  # all of it, or the beginning
                    break

    def _settle(self) -> None:
        """Drop the answers to lines that were sent blind, then count the axes if that was not done."""
        if self._link.acknowledges:
            quiet_s = min(_SLICE_S + 2e-9 * (self._exchanged[1] - self._exchanged[0]), _PATIENCE_S)
            deadline = time.monotonic() + _PATIENCE_S
            while self._link.receive(quiet_s) and time.monotonic() < deadline:
                pass
        self._count()

    def _wait_for_rest(self) -> dict[str, float]:
        """Wait until all axes rest; returns the rates of those that do not get slower."""
        slower_at, least = time.monotonic(), math.inf
        while turning := self._turning():
            self.meanwhile()
            total = sum(map(abs, turning.values()))
            if total < 0.95 * least:
                slower_at, least = time.monotonic(), total
            elif time.monotonic() - slower_at > _SLOWING_S:
                return turning
        return {}

    # ----------------------------------------------------------------------------------------- axes, rates and modes

    def _count(self) -> None:
        """Name the axes, as many as answer with an angle."""
        count = 0
        while not self.axes and count < len(AXES):
            try:
                self._numbers([f":read:position? {count + 1}"], tries=1 if count else 2)
                count += 1
            except TableError:
                if not count:
                    raise
                break
        self.axes = self.axes or AXES[-count:]

    def _number(self, axis: str) -> int:
        if axis not in self.axes:
            raise InputError(f"this table has no {axis} axis; it has: {', '.join(self.axes)}")
        return self.axes.index(axis) + 1

    def _of_axes(self, branch: str, *words: str) -> list[str]:
        """Return questions about all axes for one line, the later ones relative to the branch of the first."""
        first, *others = [f"{word}? {n}" for word in words for n in range(1, len(self.axes) + 1)]
        return [branch + first, *others]

    def _read_rates(self) -> dict[str, float]:
        said = self._numbers(self._of_axes(":read:", "rate"))
        return {axis: each[0] for axis, each in zip(self.axes, said, strict=True)}

    def _turning(self) -> dict[str, float]:
        """Return the rates of the axes that do not rest."""
        return {axis: rate for axis, rate in self._read_rates().items() if abs(rate) >= RESTS_DPS}

    def _look_at_modes(self) -> list[str]:
        """Ask for modes and interlocks; returns the reasons why drives are not ready."""
        count = len(self.axes)
        said = self._asked(
            self._of_axes(":", "mode", "interlock"), lambda texts: all(text.isalpha() for text in texts[:count])
        )
        self._modes = {axis: _mode(text) for axis, text in zip(self.axes, said, strict=False)}
        locks = [f"the {axis} axis's interlock says {text}" for axis, text in zip(self.axes, said[count:], strict=True)]
        at_fault = [words for words in locks if "fault" in words.lower()]
        opened = [words for words in locks if words.lower().endswith("says open")]
        self._fault = "; ".join(at_fault or (opened if set(self._modes.values()) - {OFF} else []))
        self._modes_ns = time.monotonic_ns()
        return at_fault + opened

    def _mode_of(self, axis: str) -> str:
        self._look_at_modes()
        return self._modes[axis]

    def _enter(self, axis: str, which: str) -> None:
        """Have an axis enter a mode, and see that it is in it."""
        self._tell(f":mode:{'synt' if which == OSCILLATION else which} {self._number(axis)}")
        deadline = time.monotonic() + _ENTERING_S
        while (found := self._mode_of(axis)) != which and not self._fault and time.monotonic() < deadline:
            pass
        if found != which:
            why = f" ({self._fault})" if self._fault else ""
            raise TableError(f"the {axis} axis was to enter mode {which}, and is in mode {found}{why}")

    # --------------------------------------------------------------------------------------------- lines and answers

    def _tell(self, *lines: str) -> None:
        """Send commands that ask nothing, each in a line of its own, so that one that fails is known."""
        for line in lines:
            self._modes_ns = -_MODES_NS
            self.meanwhile()
            if self._link.acknowledges:
                self._asked([line], lambda texts: texts[0].upper() == DONE)
            else:
                self._link.send(line.encode() + LINE_END)
                time.sleep(self._link.pause_s)

    def _numbers(self, questions: Sequence[str], each: int = 1, tries: int = 2) -> list[list[float]]:
        """Return the numbers that questions are answered with, at least so many each."""
        texts = self._asked(questions, lambda texts: all(len(_floats(text)) >= each for text in texts), tries)
        return [_floats(text) for text in texts]

    def _asked(
        self, questions: Sequence[str], understood: Callable[[Sequence[str]], bool], tries: int = 2
    ) -> tuple[str, ...]:
        """Send a line of questions, `tries` times in all until its answers are understood; returns one for each."""
        line = ";".join(questions)
        for _ in range(tries):
            texts = self._exchange(line, len(questions))
            if len(texts) == len(questions) and understood(texts):
                return texts
        raise TableError(
            f'{self._link.name}: the table\'s controller answers "{";".join(texts)}" to "{line}", {tries} times. If'
            " the interlock is closed and the axis exists, send a transcript (docs/tables.md)."
        )

    def _exchange(self, line: str, count: int) -> tuple[str, ...]:
        """Send a line; returns the texts of its answer, of which there should be so many."""
        link, begun = self._link, b""
        # bytes that come late belong to an earlier question; a bus is not read without a question
        while link.quiet_s and link.receive(0.0):
            pass
        sent, heard = time.monotonic_ns(), 0
        deadline = time.monotonic() + _PATIENCE_S
        link.send(line.encode() + LINE_END)
        while (left := deadline - time.monotonic()) > 0.0:
            # a bus marks the end of an answer, so it is read once
            data = link.receive(min(left, link.quiet_s if heard else _SLICE_S) if link.quiet_s else left)
            if not data and not heard:
                self.meanwhile()
                continue
            heard, begun = heard or time.monotonic_ns(), begun + data
            texts, has_line_end = answers(begun, link.prefix)
            self._has_line_ends |= has_line_end
            # without a line end an answer is whole when the line is quiet, or when no more of it can follow
            whole = not data or (texts == (DONE,) * count and not self._has_line_ends)
            if has_line_end or (whole and len(texts) >= count):
                break
        else:
            texts, _ = answers(begun, link.prefix)
        if not texts:
            raise TableLinkError(
                f'{link.name}: the table\'s controller does not answer "{line}" within {_PATIENCE_S:g} s. Look at'
                " the table; check that it is on, and that cable and address are right."
            )
        self._exchanged = sent, heard
        return texts


def answers(data: bytes, prefix: int) -> tuple[tuple[str, ...], bool]:
    """Return the texts of an answer so far, and whether its line has ended; `prefix`: characters before the texts."""
    end = data.find(b"\n", prefix)
    if end < 0 and len(data) <= prefix:
        return (), False
    text = data[prefix : end if end >= 0 else None].decode("ascii", "replace")
    return tuple(each.strip() for each in text.split(";")), end >= 0


def number(value: float) -> str:
    """Return a number without an exponent, to 1e-5 deg, which is below all encoders."""
    text = f"{value:.5f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _mode(text: str) -> str:
    """Return the mode that a controller's word means; an unknown word is taken for the most active mode."""
    words = (ours for ours, word in _WORDS.items() if len(text) > 1 and word.startswith(text.lower()))
    return next(words, OSCILLATION)


def _floats(text: str) -> list[float]:
    """Return the finite numbers of an answer, between commas or blanks; none if something else is among them."""
    try:
        numbers = [float(each) for each in re.split(r"[,\s]+", text)]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []

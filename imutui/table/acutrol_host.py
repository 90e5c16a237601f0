"""A controller of Acutrol's dialect over a link: the commands it sends, their order, and how it reads answers.

The host sets the limits of a mode before its demand, and the demand before the mode, since a mode moves to its demand
as soon as it is entered. It sends a command once more if the controller does not understand it. Each motion also sets
the acceleration of the rate mode, because a stop brakes in that mode. A stop waits for no answer.
"""

import math
import re
import time
from collections.abc import Callable, Iterable, Sequence

from filters.errors import InputError
from filters.motion.segments import AXES
from imutui.table import acutrol
from imutui.table.acutrol import AnswerDecoder, Command, ask, demand, interlock, limit, mode
from imutui.table.controller import TableError, TableLinkError
from imutui.table.links import Link
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

_PATIENCE_S = 1.0  # for an answer
_MODES_NS = 100_000_000  # for how long modes and interlocks are taken to be as they were
_CLOSING_S = 3.0  # for interlocks
_ENTERING_S = 0.5  # for a mode
_SLOWING_S = 1.0  # within which an axis that is to stop must have become slower
_SLICE_S = 0.02  # between two calls of `meanwhile`, and for the answer to a command of a stop
_BRAKES_S = 3.0  # braking time of an axis whose rate is not known
_JERK_LAG = 1.5  # lag of an axis over the time in which its jerk reaches its acceleration
_ENDLESS_DEG = 36_000.0  # limits of angle beyond this are none

_OURS = {"off": OFF, "position": POSITION, "rate": RATE, "synthesis": OSCILLATION}


class Acutrol:
    """A controller of Acutrol's dialect.

    `axes`: names of its axes in the order of their numbers; None: it is asked how many it has, and one is the inner,
      two are middle and inner, three outer, middle and inner.
    `asks`: False sends nothing now, so that a stop can be the first thing sent; axes are counted after that stop.
    Raises TableError if it does not answer as one does, and then closes the link.
    """

    def __init__(self, link: Link, axes: tuple[str, ...] | None = None, *, asks: bool = True) -> None:
        self._link = link
        self._decoder = AnswerDecoder(link.prefix)
        self._limits: dict[str, AxisLimits] | None = None
        self._modes: dict[str, str] = {}
        self._fault = ""
        self._modes_ns = -_MODES_NS
        self._has_line_ends = False  # whether answers have been seen to end with their line
        self._exchanged = (0, 0)  # when the last line was sent, and when its answer began to come, ns
        self._last: tuple[int, dict[str, tuple[float, float]]] | None = None  # when, angle and rate of each axis
        self.meanwhile: Callable[[], None] = lambda: None
        self.axes: tuple[str, ...] = axes or ()
        try:
            self.axes = self._count() if asks and axes is None else self.axes
        except TableError:
            self.close()
            raise

    def identify(self) -> str:
        return self._asked([acutrol.IDENTIFY], lambda texts: bool(texts[0]))[0]

    def limits(self) -> dict[str, AxisLimits]:
        if self._limits is None:
            self._limits = {axis: self._limits_of(axis) for axis in self.axes}
        return dict(self._limits)

    def enable(self) -> None:
        self._refuse_another_host()
        for axis in self.axes:
            n = self._number(axis)
            self._tell(demand("rate", n, 0.0), mode("off", n))
            self._tell(*(interlock(what, n) for what in ("open", "reset", "close")))
        deadline = time.monotonic() + _CLOSING_S
        while wrong := self._look_at_modes():
            if time.monotonic() > deadline:
                raise TableError(
                    f"{'; '.join(wrong)}, after it was reset and closed. Look for what holds it open (emergency stop,"
                    " door, end switch), then try again."
                )

    def _refuse_another_host(self) -> None:
        """Raise InputError if an axis moves, or a mode is on, that this host has not set."""
        self._look_at_modes()
        on = [f"the {axis} axis is in mode {which}" for axis, which in self._modes.items() if which != OFF]
        turning = [f"the {axis} axis turns at {rate:.2f} deg/s" for axis, rate in self._turning()]
        if on or turning:
            raise InputError(
                f"{'; '.join(on + turning)}: another host commands the table. Nothing was sent. End the other program,"
                " or stop the table: imutui table stop --controller URL"
            )

    def start(self, motion: Motion) -> None:
        axis, n = motion.axis, self._number(motion.axis)
        if not (isinstance(motion, Turn) or self._mode_of(axis) == motion.mode):
            if isinstance(motion, Swing) and not motion.amplitude_deg:
                return
            self._refuse_while_it_turns(axis)
        if motion.mode != OSCILLATION or motion.amplitude_deg:
            self._tell(limit("acceleration", "rate", n, motion.accel_dps2))
        match motion:
            case Move():
                self._tell(limit("rate", "position", n, motion.rate_dps))
                self._tell(limit("acceleration", "position", n, motion.accel_dps2))
                self._tell(demand("position", n, motion.angle_deg))
            case Turn():
                # a limit below the rate at which it turns may be a fault: it is only ever raised before the demand
                if abs(motion.rate_dps) > abs(self._reading([axis])[1][axis][1]):
                    self._tell(limit("rate", "rate", n, abs(motion.rate_dps)))
                self._tell(demand("rate", n, motion.rate_dps))
            case Swing():
                if motion.amplitude_deg:
                    own = self.limits()[axis]
                    self._tell(
                        limit("rate", "synthesis", n, min(1.1 * motion.peak_dps, own.rate_dps)),
                        limit("acceleration", "synthesis", n, min(1.5 * motion.peak_dps2, own.accel_dps2)),
                    )
                self._tell(demand("oscillation", n, motion.amplitude_deg, motion.hz, 0.0))
        self._enter(axis, motion.mode)

    def read(self) -> TableState:
        if time.monotonic_ns() - self._modes_ns >= _MODES_NS:
            self._look_at_modes()
        (sent, heard), found = self._reading(self.axes)
        angles, rates = ([found[axis][which] if axis in found else 0.0 for axis in AXES] for which in (0, 1))
        return TableState(
            stamp_ns=(sent + heard) // 2,
            uncertainty_ns=(heard - sent + 1) // 2,
            angles_deg=(angles[0], angles[1], angles[2]),
            rates_dps=(rates[0], rates[1], rates[2]),
            mode=max(self._modes.values(), key=MODES.index, default=OFF),
            fault=self._fault,
        )

    def stop(self, brakes_s: float | None = None) -> None:
        numbers = self._fastest_first()
        self._blind(each for n in numbers for each in (demand("rate", n, 0.0), mode("rate", n)))
        if brakes_s is None:
            brakes_s = self._braked()
        self._pause(brakes_s)
        self._blind(mode("off", n) for n in numbers)
        self._confirm_rest()

    def _fastest_first(self) -> list[int]:
        """Numbers of all axes, the one that turned fastest at the last reading first."""
        rates = {} if self._last is None else {self._number(a): abs(rate) for a, (_, rate) in self._last[1].items()}
        return sorted(range(1, len(self.axes or AXES) + 1), key=lambda n: -rates.get(n, 0.0))

    def _blind(self, commands: Iterable[Command]) -> None:
        """Send commands and wait for no answer; one that the controller refuses at once is sent again."""
        self._modes_ns = -_MODES_NS
        for command in commands:
            for _ in range(2):
                self._link.send(acutrol.encode([command]))
                if not self._link.acknowledges:
                    time.sleep(self._link.pause_s)
                    break
                text = self._link.receive(_SLICE_S)[self._link.prefix :].strip().upper().decode("ascii", "replace")
                if text.endswith(acutrol.DONE) or acutrol.DONE.startswith(text):  # all of it, or the beginning
                    break

    def _braked(self) -> float:
        """Wait until all axes rest; returns how much longer to wait if the controller gives no rates, s."""
        try:
            self._settle()
            self.axes = self.axes or self._count()
            self._wait_for_rest()
        except TableError:
            return _BRAKES_S
        return 0.0

    def _confirm_rest(self) -> None:
        """Raise TableError unless the controller says that all axes rest with their modes off."""
        self._settle()
        self.axes = self.axes or self._count()
        wrong = [f"the {axis} axis turns still, at {rate:.2f} deg/s" for axis, rate in self._wait_for_rest()]
        deadline = time.monotonic() + _ENTERING_S
        while True:
            self._look_at_modes()
            on = [axis for axis, which in self._modes.items() if which != OFF]
            if not on or time.monotonic() > deadline:
                break
        wrong += [f"the {axis} axis was to enter mode off, and is in mode {self._modes[axis]}" for axis in on]
        if wrong:
            raise TableError(f"{'; '.join(wrong)}. Use the table's own emergency stop.")

    def _settle(self) -> None:
        """Read and drop the answers to commands that were sent blind."""
        if not self._link.acknowledges:
            return
        quiet_s = min(_SLICE_S + 2e-9 * (self._exchanged[1] - self._exchanged[0]), _PATIENCE_S)
        deadline = time.monotonic() + _PATIENCE_S
        while self._link.receive(quiet_s) and time.monotonic() < deadline:
            pass

    def _pause(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            self.meanwhile()
            time.sleep(min(left, _SLICE_S))

    def disable(self) -> None:
        self._look_at_modes()
        if set(self._modes.values()) - {OFF}:
            self.stop()
        self._tell(*(interlock("open", self._number(axis)) for axis in self.axes))
        self._modes_ns = -_MODES_NS

    def close(self) -> None:
        self._link.close()

    # ----------------------------------------------------------------------------------------------------- questions

    def _count(self) -> tuple[str, ...]:
        """Names of its axes, as many as answer with an angle."""
        numbers = []
        for n in range(1, len(AXES) + 1):
            try:
                self._numbers([ask("read", "position", axis=n)], tries=2 if n == 1 else 1)
            except TableError:
                if n == 1:
                    raise
                break
            numbers.append(n)
        return AXES[-len(numbers) :]

    def _limits_of(self, axis: str) -> AxisLimits:
        question = ask("limit", "absolute", axis=self._number(axis))
        rate, accel, jerk, low, high, *_ = self._numbers([question], each=len(acutrol.ABSOLUTE_LIMITS))[0]
        endless = low >= high or max(abs(low), abs(high)) > _ENDLESS_DEG
        if not (rate > 0.0 and accel > 0.0):
            raise TableError(
                f"{self._link.name}: limits of the {axis} axis are said to be {rate:g} deg/s and {accel:g} deg/s^2. If"
                f" there is no such axis, name those that there are: acutrol://HOST:PORT?axes=inner"
            )
        lag = max(LAG_S, _JERK_LAG * accel / jerk) if jerk > 0.0 else LAG_S
        return AxisLimits(rate, accel, None if endless else low, None if endless else high, lag)

    def _reading(self, axes: Sequence[str]) -> tuple[tuple[int, int], dict[str, tuple[float, float]]]:
        """When axes were asked and when they answered, ns, and angle and rate of each."""
        questions = [ask("read", what, axis=self._number(axis)) for what in ("position", "rate") for axis in axes]
        self.limits()
        said, exchanged = [each[0] for each in self._numbers(questions)], self._exchanged
        found = {axis: (said[k], said[k + len(axes)]) for k, axis in enumerate(axes)}
        stamp = sum(self._exchanged) // 2
        before_ns, before = self._last or (stamp, {})
        limits, seconds = self.limits(), (stamp - before_ns) * 1e-9
        for axis, (angle, rate) in found.items():
            if limits[axis].low_deg is None:
                was, turned = before.get(axis, (0.0, 0.0))
                expected = was + 0.5 * (turned + rate) * seconds
                found[axis] = round(angle + 360.0 * round((expected - angle) / 360.0), 9), rate
        self._last = stamp, before | found
        return exchanged, found

    def _look_at_modes(self) -> list[str]:
        """Ask for modes and interlocks; returns the reasons why drives are not ready."""
        questions = [ask(what, axis=self._number(axis)) for what in ("mode", "interlock") for axis in self.axes]
        count = len(self.axes)
        said = self._asked(questions, lambda texts: all(text.isalpha() for text in texts[:count]))
        self._modes = {axis: _mode(text) for axis, text in zip(self.axes, said, strict=False)}
        told = {a: f"the {a} axis's interlock says {text}" for a, text in zip(self.axes, said[count:], strict=True)}
        at_fault = [words for words in told.values() if "fault" in words.lower()]
        opened = [words for axis, words in told.items() if words.lower().endswith("says open")]
        self._fault = "; ".join(at_fault or (opened if set(self._modes.values()) - {OFF} else []))
        self._modes_ns = time.monotonic_ns()
        return at_fault + opened

    def _mode_of(self, axis: str) -> str:
        self._look_at_modes()
        return self._modes[axis]

    # ------------------------------------------------------------------------------------------------------ commands

    def _number(self, axis: str) -> int:
        if axis not in self.axes:
            raise InputError(f"this table has no {axis} axis; it has: {', '.join(self.axes)}")
        return self.axes.index(axis) + 1

    def _enter(self, axis: str, which: str) -> None:
        """Have an axis enter one of our modes, and see that it is in it."""
        self._tell(mode(next(word for word, ours in _OURS.items() if ours == which), self._number(axis)))
        deadline = time.monotonic() + _ENTERING_S
        while (found := self._mode_of(axis)) != which and not self._fault and time.monotonic() < deadline:
            pass
        if found != which:
            why = f" ({self._fault})" if self._fault else ""
            raise TableError(f"the {axis} axis was to enter mode {which}, and is in mode {found}{why}")

    def _refuse_while_it_turns(self, axis: str) -> None:
        rate = self._reading([axis])[1][axis][1]
        if abs(rate) >= RESTS_DPS:
            raise TableError(f"the {axis} axis turns, at {rate:.2f} deg/s: stop it, wait until it rests, then move it")

    def _turning(self) -> list[tuple[str, float]]:
        """Axes that do not rest, and their rates."""
        said = self._numbers([ask("read", "rate", axis=self._number(axis)) for axis in self.axes])
        rates = zip(self.axes, (each[0] for each in said), strict=True)
        return [(axis, rate) for axis, rate in rates if abs(rate) >= RESTS_DPS]

    def _wait_for_rest(self) -> list[tuple[str, float]]:
        """Wait until all axes rest; returns those that do not get slower, and their rates."""
        slower_at, least = time.monotonic(), math.inf
        while turning := self._turning():
            self.meanwhile()
            total = sum(abs(rate) for _, rate in turning)
            if total < 0.95 * least:
                slower_at, least = time.monotonic(), total
            elif time.monotonic() - slower_at > _SLOWING_S:
                return turning
        return []

    def _tell(self, *commands: Command) -> None:
        """Send commands that ask nothing, each in a line of its own: one that fails is known then."""
        for command in commands:
            self._modes_ns = -_MODES_NS
            self.meanwhile()
            if self._link.acknowledges:
                self._asked([command], lambda texts: texts[0].upper() == acutrol.DONE)
            else:
                self._link.send(acutrol.encode([command]))
                time.sleep(self._link.pause_s)

    def _numbers(self, questions: Sequence[Command], each: int = 1, tries: int = 2) -> list[list[float]]:
        """Numbers that questions are answered with, at least so many each."""
        found: list[list[float]] = []

        def understood(texts: Sequence[str]) -> bool:
            found[:] = [_floats(text) for text in texts]
            return all(len(numbers) >= each for numbers in found)

        self._asked(questions, understood, tries)
        return found

    def _asked(
        self, commands: Sequence[Command], understood: Callable[[Sequence[str]], bool], tries: int = 2
    ) -> tuple[str, ...]:
        """Return the answers to a line, one a command; asks `tries` times in all for answers that are understood."""
        line = acutrol.encode(commands)
        for _ in range(tries):
            texts = self._exchange(line, len(commands))
            if len(texts) == len(commands) and understood(texts):
                return texts
        asked = line.decode("ascii").strip()
        raise TableError(
            f'{self._link.name}: the table\'s controller answers "{";".join(texts)}" to "{asked}", {tries} times. If'
            " the interlock is closed and the axis exists, send a transcript (docs/tables.md)."
        )

    def _exchange(self, line: bytes, count: int) -> tuple[str, ...]:
        """Send a line; returns the texts of its answer, of which there should be so many."""
        self._decoder.forget()
        # bytes that come late belong to an earlier question; a bus is not read without a question
        while self._link.quiet_s and self._link.receive(0.0):
            pass
        sent, heard = time.monotonic_ns(), 0
        deadline = time.monotonic() + _PATIENCE_S
        self._link.send(line)
        while (left := deadline - time.monotonic()) > 0.0:
            # a bus marks the end of an answer, so it is read once
            wait_s = self._link.quiet_s if heard else _SLICE_S
            data = self._link.receive(min(left, wait_s) if self._link.quiet_s else left)
            if not data and not heard:
                self.meanwhile()
                continue
            heard = heard or (time.monotonic_ns() if data else 0)
            answer = self._decoder.feed(data)
            self._has_line_ends |= answer is not None
            so_far = self._decoder.so_far() if answer is None and heard else None
            # without a line end an answer is whole when the line is quiet, or when no more of it can follow
            ended = not data or (so_far and so_far.texts == (acutrol.DONE,) * count and not self._has_line_ends)
            if so_far and len(so_far.texts) >= count and ended:
                answer = so_far
            if answer is not None:
                self._exchanged = sent, heard
                return answer.texts
        so_far = self._decoder.so_far()
        if so_far is not None:
            self._exchanged = sent, heard
            return so_far.texts
        asked = line.decode("ascii").strip()
        raise TableLinkError(
            f'{self._link.name}: the table\'s controller does not answer "{asked}" within {_PATIENCE_S:g} s. Look at'
            " the table; check that it is on, and that cable and address are right."
        )


def _mode(text: str) -> str:
    """Return the mode that a controller's word means; an unknown word is taken for the most active mode."""
    word = acutrol.full(text, acutrol.MODES) if len(text) > 1 else None
    return OSCILLATION if word is None else _OURS[word]


def _floats(text: str) -> list[float]:
    """Finite numbers of an answer, between commas or blanks; none where something else is among them."""
    try:
        numbers = [float(each) for each in re.split(r"[,\s]+", text)]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []

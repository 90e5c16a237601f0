"""An error from a Python file on top of the virtual instrument's readings, for tests of what nobody declared.

The file's function `NAME(seed)` returns `error(t, temp, ang, rate, w, f)`, which gives six numbers, deg/s and g in the
instrument's axes; docs/formats.md has the words. A scenario never has one: what is told in a scenario is declared.
"""

import runpy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from filters.channels import DPS, G
from filters.simulation import Unit
from imutui.cli.exit_codes import UNREADABLE, USAGE
from imutui.instrument.virtual_instrument import Reading, Source

Error = Callable[
    [float, float, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], Any
]

# as a word of the seed, so that nothing else of a unit is drawn from the same numbers
_SPOIL = 4


class SpoilError(Exception):
    """The file or its function is not what it should be; the message says what, where, and what it may be.

    `exit_code`: 2 where another name would do, 3 where the file's content is wrong.
    """

    def __init__(self, exit_code: int, message: str) -> None:
        super().__init__(message)
        self.exit_code = exit_code


@dataclass(frozen=True, slots=True)
class ErrorFunction:
    """A function of a file that makes errors."""

    name: str
    file: str  # as it was named
    make: Callable[[int], Error]  # from a seed to the error of one power-on

    def __str__(self) -> str:
        return f"{self.file}:{self.name}"


def seed_of(seed: int, power_on: int) -> int:
    """Seed that a function is given: another for each unit and for each of its power-ons."""
    return int(np.random.SeedSequence([seed, _SPOIL, power_on]).generate_state(1)[0])


def load(spec: str) -> ErrorFunction:
    """Function named as FILE.py:NAME.

    Raises SpoilError if there is no such file or function, or the file does not run.
    """
    file, _, name = spec.rpartition(":")
    if not file or not name.isidentifier():
        raise SpoilError(USAGE, f'--spoil is "{spec}"; it is a Python file and the name of a function: FILE.py:NAME.')
    path = Path(file)
    if not path.is_file():
        raise SpoilError(UNREADABLE, f"{file}: there is no such file. --spoil names a Python file: FILE.py:NAME.")
    try:
        content = runpy.run_path(file)
    except (Exception, SystemExit) as error:  # whatever a file does wrong, it is told in a sentence
        raise SpoilError(
            UNREADABLE, f"{file} does not run: {_told(error, file)}. Mend it, then start again."
        ) from error
    if not callable(content.get(name)):
        functions = ", ".join(n for n, v in content.items() if callable(v) and not n.startswith("_")) or "none"
        raise SpoilError(USAGE, f"{file} has no function {name}; it has: {functions}.")
    return ErrorFunction(name, file, content[name])


def plus(reading: Reading, error: NDArray[np.float64]) -> Reading:
    """A reading with an error added, deg/s and g, shape (6,)."""
    x, y, z, fx, fy, fz = error.tolist()
    (gx, gy, gz), (ax, ay, az) = reading.rates_dps, reading.accels_g
    return Reading((gx + x, gy + y, gz + z), (ax + fx, ay + fy, az + fz), reading.temperature_degc)


class Spoiled:
    """Readings with an error added, which is asked for once a sample, in order, whatever the host asks for.

    `unit`: whose readings they are: its temperature, motion and seed.
    `function`: makes the error of this power-on.
    Raises SpoilError if the function fails, here or at a later sample.
    """

    def __init__(self, readings: Source, unit: Unit, function: ErrorFunction) -> None:
        self._readings, self._unit, self._function = readings, unit, function
        self._sensed = unit.sensed()
        seed = seed_of(unit.scenario.seed, unit.power_on)
        try:
            self._error = function.make(seed)
        except Exception as error:
            raise SpoilError(
                UNREADABLE, f"{function}: {function.name}({seed}) fails: {_told(error, function.file)}."
            ) from error
        if not callable(self._error):
            raise SpoilError(
                UNREADABLE,
                f"{function}: {function.name}({seed}) returns {self._error!r:.60}, not a function"
                " error(t, temp, ang, rate, w, f).",
            )
        self._start = 0
        self._inputs: list[NDArray[np.float64]] = [np.empty(0)]
        self._next = 0
        self._last = np.zeros(6)
        # what is wrong from the beginning is said before there is a port
        self._advance(0)

    def reading(self, k: int) -> Reading | None:
        """Reading k of the unit's loop; None after the end of a recording."""
        reading = self._readings.reading(k)
        if reading is None:
            return None
        self._advance(k)
        return plus(reading, self._last)

    def _advance(self, k: int) -> None:
        """Ask for all errors up to that of reading k."""
        while self._next <= k:
            row = self._next - self._start
            if row >= self._inputs[0].size:
                self._fill(self._next)
                row = 0
            t, temp, ang, rate, w, f = self._inputs
            try:
                error = self._error(float(t[row]), float(temp[row]), ang[row], rate[row], w[row], f[row])
            except Exception as raised:
                at = f"at sample {self._next} (t = {t[row]:.3f} s)"
                raise SpoilError(
                    UNREADABLE, f"{self._function} fails {at}: {_told(raised, self._function.file)}."
                ) from raised
            self._last = self._checked(error, float(t[row]))
            self._next += 1

    def _fill(self, start: int) -> None:
        """Inputs of the next samples, each as the function is given it."""
        t = (start + np.arange(self._unit.block(start))) / self._unit.rate_hz
        perfect = self._sensed.perfect(t)
        degrees = [np.rad2deg(values) for values in (self._sensed.angles(t), self._sensed.rates(t))]
        self._inputs = [t, self._unit.temperature.at(t), *degrees, perfect[:, :3] / DPS, perfect[:, 3:] / G]
        self._start = start

    def _checked(self, error: Any, t: float) -> NDArray[np.float64]:
        try:
            six = np.asarray(error, np.float64)
        except (TypeError, ValueError):
            six = np.empty(0)
        if six.shape != (6,) or not np.isfinite(six).all():
            raise SpoilError(
                UNREADABLE,
                f"{self._function} returns {error!r:.80} at sample {self._next} (t = {t:.3f} s); it must be six finite"
                " numbers: deg/s about x, y, z, then g along x, y, z.",
            )
        return six


def _told(error: BaseException, file: str) -> str:
    """An error in a line, with the line of the file where it rose."""
    line, trace = None, error.__traceback__
    while trace is not None:
        line = trace.tb_lineno if trace.tb_frame.f_code.co_filename == file else line
        trace = trace.tb_next
    if isinstance(error, SyntaxError):
        return f"SyntaxError: {error.msg} (line {error.lineno})"
    return f"{type(error).__name__}: {error}{'' if line is None else f' (line {line})'}"

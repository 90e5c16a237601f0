"""Whether samples can be used: stamps that are times and increase, readings that are numbers a unit may read.

One set of limits holds for what is imported, replayed, traced and checked.
"""

from pathlib import Path

import numpy as np

from filters.channels import CHANNELS
from filters.imu import AxisMap
from imutui.logbook.samples import Samples

_LONGEST_NS = 320_000_000_000_000_000
LEAST_STEP_S = 1e-6  # between samples: no unit is sampled that fast, and times in ns do not tell closer ones apart
LARGEST = {"gyro": 1e5, "accel": 1e4, "temp": 2e3}
"""Greatest reading of either sign, deg/s, g and degC. No unit reads more; a broken thermometer reads less."""
_SI = np.repeat([np.deg2rad(LARGEST["gyro"]), 9.80665 * LARGEST["accel"]], 3)
_AT_ONCE = 2**16


class SampleCheck:
    """Takes samples in as many parts as they come in, and says what all of them at once would say.

    `lacks`: channels that are NaN throughout, gyros first, body axes, bool, shape (6,).
    """

    def __init__(self) -> None:
        self.lacks = np.ones(6, bool)
        self._count = 0
        self._least, self._greatest = np.iinfo(np.int64).max, np.iinfo(np.int64).min
        self._last = np.empty(0, np.int64)
        self._beyond = self._back = self._close = self._degc = -1
        self._held = 0
        self._no_number = np.full(6, -1)

    def take(self, samples: Samples) -> None:
        """Look at more samples."""
        for first in range(0, len(samples), _AT_ONCE):
            some = samples.rows(slice(first, first + _AT_ONCE))
            self._degc = self._first(self._degc, np.abs(some.degc) > LARGEST["temp"])
            self._take(some.stamp_ns, np.hstack([some.gyro, some.accel]))

    def _take(self, stamps: np.ndarray, readings: np.ndarray) -> None:
        self._least, self._greatest = min(self._least, int(stamps.min())), max(self._greatest, int(stamps.max()))
        # infinity is told as what is no number at all
        beyond = (np.abs(readings) > _SI).any(axis=1) & ~np.isinf(readings).any(axis=1)
        self._beyond = self._first(self._beyond, beyond)
        steps = np.diff(stamps, prepend=self._last)
        self._back = self._first(self._back, steps <= 0, stamps.size - steps.size)
        # a clock that corrects itself stamps now and then 1 ns after the last; stamps are rounded
        close = (steps > 1) & (steps < round(LEAST_STEP_S * 1e9) - 1)
        self._close = self._first(self._close, close, stamps.size - steps.size)
        self._held += int(np.count_nonzero(steps == 1))
        bad = ~np.isfinite(readings)
        new = bad.any(axis=0) & (self._no_number < 0)
        self._no_number[new] = self._count + bad.argmax(axis=0)[new]
        self.lacks &= np.isnan(readings).all(axis=0)
        self._last = stamps[-1:].copy()
        self._count += stamps.size

    def _first(self, known: int, found: np.ndarray, offset: int = 0) -> int:
        return known if known >= 0 or not found.any() else self._count + offset + int(found.argmax())

    def beyond(self) -> tuple[str, str] | None:
        """What is beyond the limits, the first of it, and what to do next; None if nothing is."""
        if self._beyond >= 0:
            most = f"more than {LARGEST['gyro']:,.0f} deg/s or {LARGEST['accel']:,.0f} g"
            what = f"sample {self._beyond} (first is 0) is beyond anything that a unit reads: {most}."
        elif self._degc >= 0:
            most = f"±{LARGEST['temp']:,.0f} degC, which no unit has"
            what = f"the temperature of sample {self._degc} (first is 0) is beyond {most}."
        elif self._close >= 0 or 2 * self._held > self._count:
            what = f"sample {max(self._close, 1)} (first is 0) is less than a microsecond after the one before it."
        else:
            return None
        return what, "Correct the units or remove such samples in the program that wrote the file."

    def trouble(self, path: Path) -> str:
        """Why the samples cannot be used, and what to do next; "" if they can."""
        if self._count and (self._least < 0 or self._greatest - self._least > _LONGEST_NS):
            return (
                f"{path}: the stamps of its samples are no times: they go from {self._least} to {self._greatest} ns"
                " since 1970, and no recording is longer than ten years. `imutui check` looks at the file."
            )
        if (told := self.beyond()) is not None:
            return f"{path}: {told[0]} {told[1]}"
        if self._count and self.lacks.all():
            return f"{path} has no reading in any channel: all its samples are NaN."
        bad = self._no_number[~self.lacks & (self._no_number >= 0)]
        if bad.size:
            return (
                f"{path}: sample {int(bad.min())} (first is 0) is not a number. Remove such samples in the program that"
                " wrote the file."
            )
        if self._back >= 0:
            return (
                f"{path}: time does not increase at sample {self._back} (first is 0). Sort the samples by time and drop"
                " those that stand twice."
            )
        return ""


# ---------------------------------------------------------------------------------------------------- unread channels
# Channels that a recording lacks: NaN throughout. They stay NaN in the log, and are left out of everything.


def unread(gyro: np.ndarray, accel: np.ndarray) -> np.ndarray:
    """Which channels are NaN throughout, gyros first, bool, shape (6,); readings of shape (N, 3) each."""
    return np.concatenate([np.isnan(values).all(axis=0) for values in (gyro, accel)])


def in_instrument_axes(of_body: np.ndarray, axes: AxisMap) -> np.ndarray:
    """The same of channels in body axes, bool, shape (6,), told in the instrument's."""
    return np.concatenate([axes.sd_to_instrument(part.astype(float)) > 0.5 for part in (of_body[:3], of_body[3:])])


def names(unread_ones: np.ndarray) -> tuple[str, ...]:
    """Names of channels by a mask, shape (6,)."""
    return tuple(name for name, lacks in zip(CHANNELS, unread_ones.tolist(), strict=True) if lacks)

"""Whether a log's samples can be used: stamps that are times and increase, readings that are numbers."""

from pathlib import Path

import numpy as np

from filters.channels import CHANNELS
from filters.imu import AxisMap

_LONGEST_NS = 320_000_000_000_000_000
_LARGEST = 1e6
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
        self._beyond = self._back = -1
        self._no_number = np.full(6, -1)

    def take(self, stamp_ns: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> None:
        """More samples: UTC, ns, int64, shape (N,); rad/s and m/s², shape (N, 3)."""
        for first in range(0, stamp_ns.size, _AT_ONCE):
            rows = slice(first, first + _AT_ONCE)
            self._take(stamp_ns[rows], np.hstack([gyro[rows], accel[rows]]))

    def _take(self, stamps: np.ndarray, readings: np.ndarray) -> None:
        self._least, self._greatest = min(self._least, int(stamps.min())), max(self._greatest, int(stamps.max()))
        # infinity is told as what is no number at all
        beyond = (np.abs(readings) > _LARGEST).any(axis=1) & ~np.isinf(readings).any(axis=1)
        self._beyond = self._first(self._beyond, beyond)
        back = np.diff(stamps, prepend=self._last) <= 0
        self._back = self._first(self._back, back, stamps.size - back.size)
        bad = ~np.isfinite(readings)
        new = bad.any(axis=0) & (self._no_number < 0)
        self._no_number[new] = self._count + bad.argmax(axis=0)[new]
        self.lacks &= np.isnan(readings).all(axis=0)
        self._last = stamps[-1:].copy()
        self._count += stamps.size

    def _first(self, known: int, found: np.ndarray, offset: int = 0) -> int:
        return known if known >= 0 or not found.any() else self._count + offset + int(found.argmax())

    def trouble(self, path: Path) -> str:
        """Why the samples cannot be used, and what to do next; "" if they can."""
        if self._count and (self._least < 0 or self._greatest - self._least > _LONGEST_NS):
            return (
                f"{path}: the stamps of its samples are no times: they go from {self._least} to {self._greatest} ns"
                " since 1970, and no recording is longer than ten years. `imutui check` looks at the file."
            )
        if self._beyond >= 0:
            return (
                f"{path}: sample {self._beyond} (first is 0) is beyond anything that a unit reads: more than"
                f" {_LARGEST:,.0f} rad/s or m/s². Remove such samples in the program that wrote the file."
            )
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

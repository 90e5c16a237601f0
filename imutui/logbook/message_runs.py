"""What the heads of a channel's messages say of their numbers and times, without keeping the messages."""

from dataclasses import dataclass, replace

import numpy as np

MESSAGE = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log_ns", "<i8"), ("publish_ns", "<i8")])
"""What the format has of each message besides its data."""


@dataclass(frozen=True, slots=True)
class HeadRun:
    """Messages in file order; times are log times, UTC, ns."""

    count: int  # how many there are
    # first_ns, last_ns: time of the first and the last
    first_ns: int
    last_ns: int
    # first_number, last_number: their numbers
    first_number: int
    last_number: int
    back: int = 0  # messages before which time goes back
    back_ns: int | None = None  # time before it first does
    again_ns: int | None = None  # time of the first message whose number is not above the one before
    missing: int = 0  # numbers that were left out
    missing_ns: int | None = None  # time of the first message before which some were

    @property
    def since_zero(self) -> "HeadRun":
        """The same, with the numbers missing that lie between 0 and its first."""
        if not self.first_number:
            return self
        return replace(self, missing=self.missing + self.first_number, missing_ns=self.first_ns)


def run_of(heads: np.ndarray) -> HeadRun:
    """Numbers and times of messages.

    `heads`: records of `MESSAGE`, shape (N,), N > 0.
    """
    times, numbers = heads["log_ns"], heads["sequence"].astype(np.int64)
    back, steps = np.flatnonzero(np.diff(times) < 0), np.diff(numbers)
    again, left_out = steps < 1, steps > 1
    return HeadRun(
        int(times.size),
        int(times[0]),
        int(times[-1]),
        int(numbers[0]),
        int(numbers[-1]),
        int(back.size),
        int(times[back[0]]) if back.size else None,
        int(times[int(np.argmax(again)) + 1]) if again.any() else None,
        int(np.sum(steps[left_out] - 1)),
        int(times[int(np.argmax(left_out)) + 1]) if left_out.any() else None,
    )


def joined(a: HeadRun | None, b: HeadRun) -> HeadRun:
    """Messages, and those that follow them."""
    if a is None:
        return b
    back, step = b.first_ns < a.last_ns, b.first_number - a.last_number
    return HeadRun(
        a.count + b.count,
        a.first_ns,
        b.last_ns,
        a.first_number,
        b.last_number,
        a.back + back + b.back,
        _first(a.back_ns, a.last_ns if back else None, b.back_ns),
        _first(a.again_ns, b.first_ns if step < 1 else None, b.again_ns),
        a.missing + max(step - 1, 0) + b.missing,
        _first(a.missing_ns, b.first_ns if step > 1 else None, b.missing_ns),
    )


def _first(*found: int | None) -> int | None:
    return next((ns for ns in found if ns is not None), None)

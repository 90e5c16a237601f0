"""A power-on as recorded, or a part of one: what every step of the tracer starts from."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from filters.effects.fault_records import DataFault
from filters.effects.lines import SpectralLine
from filters.imu import AxisMap
from filters.state import Site
from filters.types import Array


@dataclass(frozen=True)
class Run:
    """A power-on as recorded, or a part of one, with what is known of its motion."""

    name: str  # what it is called in a report
    t: Array  # s since the first sample, shape (N,), increasing
    reading: Array  # rates (rad/s) and accelerations (m/s²), instrument axes and sign, shape (N, 6)
    temperature: Array | None  # degC, shape (N,)
    # angles, rates: rotations of the table about north, east, down, rad, unwrapped, and rad/s; shape (N, 3), or (1, 3)
    # at rest. Where `attitude` says how the unit is turned, on no table: zeros, and rates about the body's axes.
    angles: Array
    rates: Array
    axes: AxisMap  # sign and mounting
    site: Site
    C_nb: Array | None = None  # attitude of a unit at rest that does not sit as the table's angles say, shape (3, 3)
    lsb: Array | None = None  # of a count, SI, shape (6,)
    bandwidth: Array | None = None  # first-order band limits of the specification, Hz, shape (6,)
    latency: Array = field(default_factory=lambda: np.zeros(6))  # known delays of the six channels, s
    flagged: NDArray[np.bool_] | None = None  # readings not to be used, shape (N, 6)
    # whether samples are means over so many packets as fell into a period: then their steps differ by a packet
    averaged: bool = False
    # numbers of channels that the recording lacks; their readings are zeros, and all flagged
    unread: tuple[int, ...] = ()
    # which power-on it is a part of: runs of the same one share their biases and go on from each other's drift and
    # temperature. Empty: it is a power-on by itself.
    power_on: str = ""
    begins: float = 0.0  # when its first sample was taken, s since the first known sample of the power-on
    # whether what came before it in its power-on is known: the part that it follows is among the runs
    history_known: bool = False
    attitude: Array | None = None  # quaternion w, x, y, z of C_nb of a unit that moves on no table, shape (N, 4)
    full_rate: "FullRate | None" = None  # of a run whose rows are means (`long_run`)

    @property
    def still(self) -> bool:
        """Whether one row of angles stands for all."""
        return len(self.angles) == 1

    @property
    def seconds(self) -> float:
        """From the first sample to the last, s."""
        return float(self.t[-1] - self.t[0])

    @property
    def rate_hz(self) -> float:
        """Samples a second, by count: the median of the steps is wrong for stamps that come in bursts."""
        return (self.t.size - 1) / self.seconds


@dataclass(frozen=True, slots=True)
class FullRate:
    """What was seen at the full rate of a run that is too long to be held, and whose rows are means."""

    samples: int
    rate_hz: float  # of the samples
    faults: tuple[DataFault, ...]  # whose readings are in no mean
    lines: tuple[SpectralLine, ...]  # which are in no mean either
    stretches: tuple[Run, ...]  # parts of it, evenly spread, without lines


def in_order(runs: Iterable[Run]) -> list[Run]:
    """Parts of a power-on one after the other by time, where its first one stands; all else as it is."""
    places: dict[str, int] = {}
    keyed = []
    for number, run in enumerate(runs):
        place = places.setdefault(run.power_on, number) if run.power_on else number
        keyed.append((place, run.begins, number, run))
    return [run for *_, run in sorted(keyed, key=lambda each: each[:3])]


def rest_attitudes(angles: Array, tolerance: float = 1e-9) -> Array:
    """Angles as one row if they never change, else as they are, unwrapped; rad, shape (1, 3) or (N, 3)."""
    if np.ptp(angles, axis=0).max() <= tolerance:
        return angles[:1]
    return np.unwrap(angles, axis=0)

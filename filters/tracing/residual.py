"""Raw sensor residual against the reference, at the full rate.

    r = reading - what a perfect unit would read there

in the instrument's axes and sign, so that an error found is the error of a reading.

What it leaves out: flags (`effects.faults`), means over blocks (`blocks`), what the residual means (the rest of
`filters.tracing`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters import attitude, earth
from filters.effects.inputs import tilted
from filters.tracing.run import Run
from filters.types import Array


def perfect(run: Run, rows: slice = slice(None)) -> Array:
    """What a perfect unit reads: w + C w_ie and C (0, 0, -gamma), instrument axes; shape (n, 6), or (1, 6) at rest."""
    return sensed(run, rows).reading


@dataclass(frozen=True, slots=True)
class Sensed:
    """What a perfect unit senses at n samples of a run, or at all of them at rest (n = 1), instrument axes."""

    reading: Array  # rad/s and m/s², shape (n, 6)
    spin: Array  # Earth rate in it, rad/s, shape (n, 3)
    tilt: Array  # reading of the accelerometers per rad of tilt about north and about east, m/s², shape (n, 3, 2)
    turning: Array  # rate of the table, body axes, rad/s, shape (n, 3)


def sensed(run: Run, rows: slice) -> Sensed:
    """What a perfect unit senses at some samples of a run; of a run at rest one row stands for all."""
    axes, site = run.axes, run.site
    C, turning = attitude_and_rate(run, rows)
    spin = axes.gyro_to_instrument(np.einsum("nij,i->nj", C, earth.earth_rate_n(np.array(site.latitude))))
    force = axes.accel_to_instrument(-site.gravity * C[:, 2])
    reading = np.hstack([axes.gyro_to_instrument(turning) + spin, force])
    return Sensed(reading, spin, tilted(axes, C, site.gravity), turning)


def attitude_and_rate(run: Run, rows: slice | NDArray[np.int_]) -> tuple[Array, Array]:
    """C_nb, shape (n, 3, 3), and rate relative to n in body axes, rad/s, shape (n, 3); n = 1 at rest."""
    if run.attitude is not None:
        return attitude.from_quaternion(run.attitude[rows]), run.rates[rows]
    angles, rates = (run.angles, run.rates) if run.still else (run.angles[rows], run.rates[rows])
    C, turning = _attitudes(angles, rates)
    return (C if run.C_nb is None else run.C_nb[None]), turning


def _attitudes(angles: Array, rates: Array) -> tuple[Array, Array]:
    """As `profile.attitudes` and `profile.body_rate`, shapes (n, 3, 3) and (n, 3).

    Those take sines one by one, so that live and replayed numbers are equal to the last bit; here whole arrays are
    several times as fast, and nothing has to be.
    """
    (so, sm, si), (co, cm, ci) = np.sin(angles).T, np.cos(angles).T
    C = np.empty((len(angles), 3, 3))
    C[:, 0, 0], C[:, 0, 1], C[:, 0, 2] = cm * ci, -(cm * si), sm
    C[:, 1, 0], C[:, 1, 1], C[:, 1, 2] = co * si + so * sm * ci, co * ci - so * sm * si, -(so * cm)
    C[:, 2, 0], C[:, 2, 1], C[:, 2, 2] = so * si - co * sm * ci, so * ci + co * sm * si, co * cm
    o, m, i = rates.T
    return C, np.stack([ci * cm * o + si * m, ci * m - si * cm * o, sm * o + i], axis=1)


@dataclass(frozen=True)
class ResidualOf:
    """The residual of a run, made where it is looked at: of a day at rest all of it at once is half a gigabyte."""

    run: Run

    @property
    def shape(self) -> tuple[int, ...]:
        """(N, 6)."""
        return self.run.reading.shape

    def __getitem__(self, key: slice | tuple[slice, int]) -> Array:
        if isinstance(key, slice):
            return residual(self.run, key)
        rows, c = key
        if not self.run.still:
            return residual(self.run, rows)[:, c]
        r: Array = self.run.reading[rows, c] - perfect(self.run)[0, c]
        if self.run.flagged is not None:
            r[self.run.flagged[rows, c]] = np.nan
        return r


def residual_of(run: Run) -> "ResidualOf | Array":
    """The residual of a run for looks at one channel or stretch after the other; of one that moves all of it, made."""
    return ResidualOf(run) if run.still else residual(run)


def residual(run: Run, rows: slice = slice(None)) -> Array:
    """Reading minus what a perfect unit would read, at full rate, NaN where flagged; shape (n, 6)."""
    t = run.t[rows]
    x = perfect(run, rows)
    if run.latency.any() and not run.still and t.size > 1:
        x = x - run.latency * np.gradient(x, t, axis=0)
    r = run.reading[rows] - x
    return r if run.flagged is None else np.where(run.flagged[rows], np.nan, r)

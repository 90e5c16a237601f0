"""Readings through the filter: all at once, one by one, in odd parts; and what it then says of the biases."""

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from filters.imu import Samples
from filters.kalman import runner
from filters.kalman.rows import Estimate
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.motion.segments import Dwell, Rate
from filters.simulation import Truth

Columns = Samples | Sequence[np.ndarray]  # samples, or t, gyro, accel and perhaps temperature
Marks = Sequence[tuple[float, str]]


def dwell(outer: float, middle: float, inner: float = 0.0, seconds: float = 5.0) -> Dwell:
    return Dwell((np.deg2rad(outer), np.deg2rad(middle), np.deg2rad(inner)), seconds)


def rate(axis: str, dps: float, seconds: float) -> Rate:
    return Rate(axis, np.deg2rad(dps), seconds)


def filtered(
    settings: Settings, samples: Columns, marks: Marks = (), every: float = 0.0, sizes: Iterable[int] | None = None
) -> tuple[Estimator, list[Estimate]]:
    """The filter over samples, so many at a time; each mark is known before the first sample that is not before it."""
    columns = (samples.t, samples.gyro, samples.accel) if isinstance(samples, Samples) else samples
    estimator, made, waiting, first = Estimator(settings, every), list[Estimate](), list(marks), 0
    for size in [columns[0].size] if sizes is None else sizes:
        t, *others = (column[first : first + size] for column in columns)
        first += size
        if not t.size:
            break
        while waiting and waiting[0][0] <= t[-1]:
            estimator.mark(*waiting.pop(0))
        if size == 1:
            made += runner.step(estimator, float(t[0]), *(column[0] for column in others))
        else:
            made += runner.run(estimator, t, *others, last=False)
    made += runner.run(estimator, *(column[:0] for column in columns))
    return estimator, made


def same_however_they_come(
    settings: Settings, samples: Columns, marks: Marks = (), every: float = 0.0
) -> tuple[Estimator, list[Estimate]]:
    """The filter over samples at once: live, one by one or in odd parts, it gives the same to the last bit."""
    whole, at_once = filtered(settings, samples, marks, every)
    parts = np.random.default_rng(17).integers(1, 60, whole.taken).tolist()
    for sizes in (itertools.repeat(1), [*parts, whole.taken]):
        other, live = filtered(settings, samples, marks, every, sizes)
        for a, b in zip(at_once, live, strict=True):
            assert (a.index, a.t, a.dof) == (b.index, b.t, b.dof)
            for name in ("latitude", "longitude", "height", "velocity_n", "C_nb", "accel_bias", "gyro_bias"):
                assert np.array_equal(getattr(a.belief.nav, name), getattr(b.belief.nav, name), equal_nan=True)
            for x, y in ((a.belief.P, b.belief.P), (a.nu, b.nu), (a.nis, b.nis)):
                assert np.array_equal(x, y, equal_nan=True)
        for x, y in zip(_said(whole), _said(other), strict=True):
            assert np.array_equal(x, y) if isinstance(x, np.ndarray) else x == y
    return whole, at_once


def _said(estimator: Estimator) -> list[object]:
    """What an estimator says at the end."""
    assert estimator.latest is not None
    moments = estimator.after_convergence
    return [
        estimator.monitor.convergence().since,
        *(estimator.nis_sum, estimator.rejected, estimator.samples, estimator.taken, estimator.held_since),
        *(estimator.observable, estimator.gaps, estimator.alarms(), estimator.confounded()),
        *(estimator.latest.belief.P, *estimator.extra(), estimator.vertical),
        *([] if estimator.watch is None else [estimator.watch.changes, estimator.watch.causes()]),
        *(() if moments is None else (moments.count, moments.mean, moments.covariance)),
    ]


def bias_errors(estimator: Estimator, truth: Truth | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the six biases, accelerometer then gyro, and their covariance."""
    assert estimator.latest is not None
    nav, P = estimator.latest.belief.nav, estimator.latest.belief.P
    bias = np.concatenate([truth.accel_bias, truth.gyro_bias]) if isinstance(truth, Truth) else truth
    return np.concatenate([nav.accel_bias, nav.gyro_bias]) - bias, P[9:, 9:]


def normalised(estimator: Estimator, truth: Truth | np.ndarray) -> np.ndarray:
    error, P = bias_errors(estimator, truth)
    return np.asarray(error / np.sqrt(np.diag(P)))


def nees(estimator: Estimator, truth: Truth | np.ndarray) -> float:
    error, P = bias_errors(estimator, truth)
    return float(error @ np.linalg.solve(P, error))

"""One step, and the loop over it: the same for live, replay and trace, so that equal samples give equal estimates."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from filters import reference as references
from filters import spkf, state
from filters.consistency import Convergence, Gauge
from filters.imu import IMU400CD_200, STANDARD_GRAVITY, ImuSpec
from filters.reference import Reference
from filters.spkf import Belief, Innovation
from filters.state import PAPER_SITE, Site
from filters.types import Array

FILTERS = {"spkf": spkf}
"""Filters by name: modules with `start`, `predict`, `process_noise` and `correct`."""
MEASUREMENTS = ("exact", "drawn")
_GAP = 2.5
_ALARM_FACTOR = 3.0


@dataclass(frozen=True, slots=True)
class Settings:
    """All that decides the estimates, apart from the samples.

    Attributes
    ----------
    period : float
        Sample period the log was made for, s; a step above 2.5 times this is a gap.
    filter : str
        A name of `FILTERS`.
    reference : str
        "level" or "gravity".
    site : Site
        Position and gravity of the table.
    measurements : str
        "exact": the reference itself is fed. "drawn": with noise of covariance R.
    seed : int
        Of the drawn noise.
    kappa : float
        κ of equation (11).
    spec : ImuSpec
        Noise densities and limits.
    """

    period: float
    filter: str = "spkf"
    reference: str = "level"
    site: Site = PAPER_SITE
    measurements: str = "exact"
    seed: int = 0
    kappa: float = 0.0
    spec: ImuSpec = IMU400CD_200

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("filter", self.filter, tuple(FILTERS)),
            ("reference", self.reference, references.KINDS),
            ("measurements", self.measurements, MEASUREMENTS),
        ):
            if value not in allowed:
                raise ValueError(f'`{name}` is "{value}", not one of: {", ".join(allowed)}')
        if self.seed < 0:
            raise ValueError(f"`seed` is {self.seed}, negative")
        if not self.period > 0.0:
            raise ValueError(f"`period` is {self.period} s, not positive")
        if not state.SIZE + self.kappa > 0.0:
            raise ValueError(f"`kappa` is {self.kappa}: 15 + kappa must be positive")


@dataclass(frozen=True, slots=True)
class Estimate:
    """What the filter holds after one sample.

    Attributes
    ----------
    index : int
        Number of the sample, from 0.
    t : float
        s since the first sample.
    belief : Belief
        After the update.
    innovation : Innovation or None
        None for the first sample, which only sets the clock.
    """

    index: int
    t: float
    belief: Belief
    innovation: Innovation | None


@dataclass(slots=True)
class Moments:
    """Running mean and covariance of state errors against the reference (Welford)."""

    count: int = 0
    mean: Array = field(default_factory=lambda: np.zeros(state.SIZE))
    scatter: Array = field(default_factory=lambda: np.zeros((state.SIZE, state.SIZE)))

    def add(self, error: Array) -> None:
        """Take one error, shape (15,)."""
        self.count += 1
        before = error - self.mean
        self.mean = self.mean + before / self.count
        self.scatter = self.scatter + np.outer(before, error - self.mean)


class Estimator:
    """The filter with its reference and its gauge; fed by `step`, read by everybody.

    Parameters
    ----------
    settings : Settings
        What decides the estimates.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.filter = FILTERS[settings.filter]
        self.reference: Reference | None = references.level(settings.site) if settings.reference == "level" else None
        self.gauge = Gauge(settings.period)
        self.latest: Estimate | None = None
        self.samples = 0
        self.gaps: list[tuple[float, float]] = []
        self.nis_sum = 0.0
        self.nis_count = 0
        self.first_nis: float | None = None
        self.after_convergence = Moments()
        self._waiting: list[tuple[float, Array, Array]] = []
        self._expected: tuple[Array, Array] | None = None

    @property
    def observable(self) -> tuple[bool, ...]:
        """For the six biases (accelerometer then gyro, body axes), whether this reference shows them."""
        accel = self.reference.observable if self.reference is not None else (True, True, True)
        return (*accel, True, True, True)

    @property
    def converged(self) -> bool:
        """Whether every bias that can be seen has converged."""
        since = self.gauge.convergence().since
        return all(s is not None for s, seen in zip(since, self.observable, strict=True) if seen)

    def alarms(self) -> list[str]:
        """Sentences about data that contradict the model, in body axes; empty when there are none."""
        convergence = self.gauge.convergence()
        return [] if convergence.apparent is None else _alarms(convergence, self.settings.spec, self.observable)


def step(estimator: Estimator, t: float, gyro: Array, accel: Array) -> list[Estimate]:
    """Feed one sample.

    A reference that has to be found first (gravity) holds back the first 10 s, then all of them come at once.

    Parameters
    ----------
    estimator : Estimator
        Changed in place.
    t : float
        s since the first sample, increasing.
    gyro, accel : Array
        Angular rate (rad/s) and specific force (m/s²), body axes, shape (3,).

    Returns
    -------
    list of Estimate
        One for each sample used; none while the reference is being found.

    Raises
    ------
    ValueError
        If `t` does not increase, or the unit is not at rest while its reference is being found.
    DivergenceError
        If the filter broke down; the message names the sample.
    """
    if estimator.reference is None:
        estimator._waiting.append((t, gyro, accel))
        enough = len(estimator._waiting) >= references.ALIGN_SAMPLES and t >= references.ALIGN_SECONDS
        return finish(estimator) if enough else []
    return [_advance(estimator, estimator.reference, t, gyro, accel)]


def finish(estimator: Estimator) -> list[Estimate]:
    """Use the samples that still wait for a reference, when no more will come; see `step`."""
    if not estimator._waiting:
        return []
    waiting, estimator._waiting = estimator._waiting, []
    mean_force = np.mean([accel for _, _, accel in waiting], axis=0)
    reference = references.gravity(estimator.settings.site, mean_force, spkf.P0_ACCEL_BIAS_SD)
    estimator.reference = reference
    return [_advance(estimator, reference, *sample) for sample in waiting]


def run(estimator: Estimator, samples: Iterable[tuple[float, Array, Array]]) -> Iterator[Estimate]:
    """Feed samples one after the other and yield every estimate; see `step` for the arguments."""
    for t, gyro, accel in samples:
        yield from step(estimator, t, gyro, accel)
    yield from finish(estimator)


def _advance(estimator: Estimator, reference: Reference, t: float, gyro: Array, accel: Array) -> Estimate:
    index, last = estimator.samples, estimator.latest
    if last is None:
        estimate = Estimate(index, t, estimator.filter.start(reference), None)
    else:
        estimate = _filter(estimator, reference, last, t, gyro, accel)
    estimator.samples += 1
    estimator.latest = estimate
    _judge(estimator, reference, estimate, gyro, accel)
    return estimate


def _filter(
    estimator: Estimator, reference: Reference, last: Estimate, t: float, gyro: Array, accel: Array
) -> Estimate:
    settings, index = estimator.settings, estimator.samples
    dt = t - last.t
    if not dt > 0.0:
        raise ValueError(f"`t` goes from {last.t} s to {t} s at sample {index}: time must increase")
    gap = dt > _GAP * settings.period
    if gap:
        estimator.gaps.append((last.t, dt))
    Q_d = estimator.filter.process_noise(settings.spec, dt, dt / settings.period if gap else 1.0)
    drawn = _draw(settings.seed, index, reference.rows.size) if settings.measurements == "drawn" else None
    try:
        belief = estimator.filter.predict(last.belief, gyro, accel, dt, reference.gravity, Q_d, settings.kappa)
        belief, innovation = estimator.filter.correct(belief, reference, drawn)
    except spkf.DivergenceError as error:
        raise spkf.DivergenceError(f"the filter broke down at sample {index}, {t:.3f} s: {error}") from error
    if not (np.isfinite(innovation.nis) and np.all(np.isfinite(belief.P))):
        raise spkf.DivergenceError(f"the filter broke down at sample {index}, {t:.3f} s: the state is not finite")
    estimator.nis_sum += innovation.nis
    estimator.nis_count += 1
    if estimator.first_nis is None:
        estimator.first_nis = innovation.nis
    return Estimate(index, t, belief, innovation)


def _judge(estimator: Estimator, reference: Reference, estimate: Estimate, gyro: Array, accel: Array) -> None:
    if estimator._expected is None:
        estimator._expected = reference.rates_and_forces()
    rate, force = estimator._expected
    nav, P = estimate.belief.nav, estimate.belief.P
    bias = np.concatenate([nav.accel_bias, nav.gyro_bias])
    residual = np.concatenate([accel - force, gyro - rate])
    estimator.gauge.add(estimate.t, residual, bias, np.sqrt(np.diag(P)[9:]))
    if estimator.converged:
        estimator.after_convergence.add(nav.minus(reference.nav))


def _draw(seed: int, index: int, size: int) -> Array:
    """Standard normal draws that depend on seed and sample number alone, shape (size,)."""
    return np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, 0, index])).standard_normal(size)


def _alarms(convergence: Convergence, spec: ImuSpec, observable: tuple[bool, ...]) -> list[str]:
    apparent = convergence.apparent
    assert apparent is not None
    out = []
    if np.any(np.abs(apparent[:3]) > 0.5 * STANDARD_GRAVITY):
        size = float(np.max(np.abs(apparent[:3]))) / STANDARD_GRAVITY
        out.append(
            f"accelerometers are off the reference by {size:.2f} g: wrong accelerometer sign, mounting or attitude"
        )
    limits = np.array([spec.accel_bias_limit] * 3 + [spec.gyro_bias_limit] * 3)
    names = ("x accel", "y accel", "z accel", "x gyro", "y gyro", "z gyro")
    for i in np.flatnonzero(np.abs(apparent) > _ALARM_FACTOR * limits):
        if observable[i] and abs(apparent[i]) < 0.5 * STANDARD_GRAVITY:
            out.append(
                f"{names[i]} (body axes) is off by {abs(apparent[i]) / limits[i]:.1f} times the bias limit of Table 1:"
                " tilt, scale, a moving table, or a faulty sensor"
            )
    return out

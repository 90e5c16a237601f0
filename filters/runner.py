"""One step, and the loop over samples: the same for live, replay and trace, so that equal samples give equal estimates.

Samples may come one by one or many at once; the results are the same to the last bit.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from filters import alarms, alignment, layout, reference, state
from filters.alarms import Turns
from filters.consistency import Gauge, nis_gates
from filters.imu import STANDARD_GRAVITY
from filters.motion import Profile
from filters.reference import Reference, TableMotion, Trajectory
from filters.settings import Settings
from filters.spkf import Belief, DivergenceError
from filters.types import Array

if TYPE_CHECKING:
    from filters.engines import Engine, Feed

P0_ACCEL_BIAS_SD = 18e-3 * STANDARD_GRAVITY
"""m/s²; 1.5 times Table 1."""
P0_GYRO_BIAS_SD = 1.5 * np.pi / 180.0
"""rad/s; 1.5 times Table 1."""

_GAP = 2.5
_CHUNK = 8192
# a turn between two samples that no filter can make up for
_MAX_TURN = 1.0
_SAME = 1e-9


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
    nu : Array
        Innovation of the nine rows, m, m/s, rad; NaN where a row was not known; shape (9,).
    nis : float
        Normalised innovation squared; NaN without an update, as for the first sample, which only sets the clock.
    dof : int
        Rows of the update.
    """

    index: int
    t: float
    belief: Belief
    nu: Array
    nis: float
    dof: int


@dataclass(frozen=True, slots=True)
class Moments:
    """Mean and covariance of state errors against the reference, after convergence; shapes (15,) and (15, 15)."""

    count: int
    mean: Array
    covariance: Array


class Estimator:
    """The filter with its reference and its gauge; fed by `step` or `run`, read by everybody.

    Parameters
    ----------
    settings : Settings
        What decides the estimates.
    every : float
        Least time between two estimates that `step` and `run` give, s; 0 for each sample, infinity for none.

    Raises
    ------
    ValueError
        If the reference cannot be had: no motion given, or a rate too slow for it.
    """

    def __init__(self, settings: Settings, every: float = 0.0) -> None:
        self.settings = settings
        self.every = every
        self.gauge = Gauge(settings.period)
        self.gaps: list[tuple[float, float]] = []
        self.reference: Reference | None = None
        self.aligning = _alignment(settings)
        self._engine: Engine | None = None
        self._P0_sd = np.zeros(state.SIZE)
        self._waiting: list[tuple[Array, Array, Array]] = []
        self._waiting_count = 0
        self._last_t = -np.inf
        self._turns = Turns()
        self._marks: list[tuple[float, str]] = []
        if self.aligning is None:
            self._begin(_reference(settings))

    def _begin(self, found: Reference) -> None:
        self.reference = found
        # here, since it brings the compiler along, which a command that only reads settings should not wait for
        from filters.engines import engine_of

        settings = self.settings
        nav, P0_sd = found.start()
        self._P0_sd = np.concatenate([P0_sd, np.full(3, P0_ACCEL_BIAS_SD), np.full(3, P0_GYRO_BIAS_SD)])
        self._engine = engine_of(settings, found.moving, self.every)
        self._engine.start(nav, self._P0_sd)

    @property
    def samples(self) -> int:
        """Samples that the filter has used."""
        return int(self._core(layout.CORE_SAMPLES))

    @property
    def nis_sum(self) -> float:
        """Sum of NIS over all updates."""
        return self._core(layout.CORE_NIS_SUM)

    @property
    def nis_count(self) -> int:
        """Updates so far."""
        return int(self._core(layout.CORE_NIS_COUNT))

    @property
    def first_nis(self) -> float | None:
        """NIS of the first update."""
        return self._core(layout.CORE_NIS_FIRST) if self.nis_count else None

    @property
    def rejected(self) -> int:
        """Updates left out, because their innovation was beyond the gate."""
        return int(self._core(layout.CORE_REJECTED))

    def _core(self, index: int) -> float:
        return float(self._engine.core[index]) if self._engine is not None else 0.0

    @property
    def latest(self) -> Estimate | None:
        """What the filter holds now; None before the first sample."""
        if self._engine is None or not self.samples:
            return None
        core = self._engine.core
        return Estimate(
            self.samples - 1,
            float(core[layout.CORE_T]),
            self._engine.belief(),
            core[layout.CORE_NU :].copy(),
            float(core[layout.CORE_NIS_LAST]),
            int(core[layout.CORE_DOF_LAST]),
        )

    @property
    def dof(self) -> float:
        """Mean number of rows of an update; a whole number where all had the same."""
        return self._core(layout.CORE_DOF_SUM) / self.nis_count if self.nis_count else 0.0

    @property
    def after_convergence(self) -> Moments | None:
        """Errors against the reference since convergence, where the reference is at rest; None before two samples."""
        if self._engine is None:
            return None
        moments = self._engine.moments
        count = int(moments[layout.MOMENT_COUNT])
        if count < 2:
            return None
        scatter = moments[layout.MOMENT_SCATTER :].reshape(state.SIZE, state.SIZE)
        mean = moments[layout.MOMENT_MEAN : layout.MOMENT_SCATTER].copy()
        return Moments(count, mean, scatter / (count - 1))

    @property
    def observable(self) -> tuple[bool, ...]:
        """For the six biases (accelerometer then gyro, body axes), whether this reference shows them."""
        if self.reference is None or self._engine is None:
            return (True,) * 6
        P0_sd = self._P0_sd[9:]
        # at rest it does not depend on how far the filter has come
        bias_sd = self._engine.biases()[1] if self.reference.moving else P0_sd
        return self.reference.observable(bias_sd, P0_sd)

    @property
    def converged(self) -> bool:
        """Whether every bias that can be seen has converged."""
        since = self.gauge.convergence().since
        observable = self.observable
        return any(observable) and all(s is not None for s, seen in zip(since, observable, strict=True) if seen)

    def mark(self, t: float, text: str) -> None:
        """Take an operator's mark at `t` s since the first sample; a profile aligned by marks needs them."""
        if isinstance(self.reference, TableMotion) and not self.samples and t <= 0.0:
            # from before the first sample: it says where the table is at the start
            self.reference.mark(t, text)
            self._begin(self.reference)
        else:
            self._marks.append((t, text))

    def alarms(self) -> list[str]:
        """Sentences about data that contradict the model, in body axes; empty when there are none."""
        if self._engine is None or not self.samples:
            return []
        out = alarms.of_residuals(self.gauge.convergence(), self.settings.spec, self.observable)
        first = self.first_nis
        if first is not None and first > nis_gates()[9] and not any("off the reference" in text for text in out):
            out.append(
                f"the first innovation is far outside what the filter expects (NIS {first:.0f}): wrong accelerometer"
                " sign, mounting or attitude"
            )
        if not out and self._forces_are_off():
            out.append(
                "accelerometers are off the reference by over 0.5 g: wrong accelerometer sign, mounting or attitude"
            )
        if self._core(layout.CORE_OVERRULED):
            out.append(
                f"{self.rejected} updates were left out as outliers, until they came too many in a row: the reference"
                " and the readings do not belong together"
            )
        own = self._engine.alarm()
        return out if own is None else [*out, own]

    def _forces_are_off(self) -> bool:
        """Whether, before there is a mean over 10 s, that of the present second says so."""
        assert self._engine is not None
        sums = self._engine.sums
        if self.gauge.convergence().apparent is not None or not sums[layout.SUM_RESIDUALS]:
            return False
        mean = sums[layout.SUM_RESIDUAL : layout.SUM_RESIDUAL + 3] / sums[layout.SUM_RESIDUALS]
        return bool(np.any(np.abs(mean) > 0.5 * STANDARD_GRAVITY))

    def confounded(self) -> list[str]:
        """Sentences on biases that the motion cannot tell from other effects, body axes; empty for a unit at rest."""
        return self._turns.confounded()


def step(estimator: Estimator, t: float, gyro: Array, accel: Array) -> list[Estimate]:
    """Feed one sample.

    A reference that has to be found first holds back the first samples, then all of them come at once.

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
        At most one every `estimator.every` s; none while the reference is being found.

    Raises
    ------
    ValueError
        If `t` does not increase, the unit turns too fast for the rate, or its reference cannot be found.
    DivergenceError
        If the filter broke down; the message names the sample.
    """
    return list(run(estimator, np.array([t]), gyro[None], accel[None], last=False))


def run(estimator: Estimator, t: Array, gyro: Array, accel: Array, *, last: bool = True) -> Iterator[Estimate]:
    """Feed many samples, shapes (N,), (N, 3), (N, 3), and yield estimates; see `step`.

    `last` says that no more will come, so that samples which wait for a reference are used as they are.
    """
    for block in rows(estimator, t, gyro, accel, last=last):
        yield from map(estimate_of, block)


def finish(estimator: Estimator) -> Iterator[Estimate]:
    """Use the samples that still wait for a reference, when no more will come; see `step`."""
    for block in _finish(estimator):
        yield from map(estimate_of, block)


def rows(estimator: Estimator, t: Array, gyro: Array, accel: Array, *, last: bool = True) -> Iterator[Array]:
    """As `run`, with estimates as rows of `filters.layout.OUT_*`, some at a time, shape (K, OUT).

    The verdict of `estimator.gauge` is the same for all rows that come at once.
    """
    for first in range(0, t.size, _CHUNK):
        part = slice(first, first + _CHUNK)
        yield from _take(estimator, t[part], gyro[part], accel[part])
    if last:
        yield from _finish(estimator)


def _finish(estimator: Estimator) -> Iterator[Array]:
    if estimator.aligning is None or not estimator._waiting:
        return
    t, gyro, accel = (np.concatenate(arrays) for arrays in zip(*estimator._waiting, strict=True))
    estimator._waiting.clear()
    estimator._begin(estimator.aligning.found(t, gyro, accel))
    estimator.aligning = None
    yield from _filter(estimator, t, gyro, accel)


def _take(estimator: Estimator, t: Array, gyro: Array, accel: Array) -> Iterator[Array]:
    _check_steps(estimator, t, gyro)
    if estimator.aligning is None:
        yield from _filter(estimator, t, gyro, accel)
        return
    aligning, before = estimator.aligning, estimator._waiting_count
    enough = next((k for k in range(t.size) if aligning.enough(float(t[k]), before + k + 1)), None)
    cut = t.size if enough is None else enough + 1
    estimator._waiting.append((t[:cut], gyro[:cut], accel[:cut]))
    estimator._waiting_count += cut
    if enough is not None:
        yield from _finish(estimator)
        yield from _filter(estimator, t[cut:], gyro[cut:], accel[cut:])


def _check_steps(estimator: Estimator, t: Array, gyro: Array) -> None:
    """Refuse what no filter can use, and note the gaps."""
    period = estimator.settings.period
    before = np.concatenate([[estimator._last_t], t[:-1]])
    steps = t - before
    seen = estimator._waiting_count + estimator.samples
    if not np.all(steps > 0.0):
        k = int(np.argmax(~(steps > 0.0)))
        raise ValueError(f"`t` goes from {before[k]} s to {t[k]} s at sample {seen + k}: time must increase")
    gaps = (steps > _GAP * period) & np.isfinite(steps)
    estimator.gaps += [(float(before[k]), float(steps[k])) for k in np.flatnonzero(gaps)]
    turned = np.sqrt(np.sum(gyro**2, axis=1)) * np.where(gaps | ~np.isfinite(steps), 0.0, steps)
    if np.any(turned > _MAX_TURN):
        k = int(np.argmax(turned > _MAX_TURN))
        raise ValueError(
            f"the unit turns {np.rad2deg(turned[k]):.0f} deg between two samples at {t[k]:.3f} s (rate"
            f" {1.0 / period:g} Hz): nothing is known of the rate in between. Record rotation at 10 Hz or more"
        )
    if t.size:
        estimator._last_t = float(t[-1])


def _filter(estimator: Estimator, t: Array, gyro: Array, accel: Array) -> Iterator[Array]:
    """Feed samples to the engine, stopping where a block of the gauge ends or a row has to be completed."""
    found, engine = estimator.reference, estimator._engine
    assert found is not None
    assert engine is not None
    if not t.size:
        return
    feed = _feed(estimator, found, t, gyro, accel)
    partial = found.partial if isinstance(found, reference.Path) else {}
    incomplete = [k for k in range(t.size) if float(t[k]) in partial] if partial else []
    gauge, k = estimator.gauge, 0
    while k < t.size:
        if not estimator.samples:
            gauge.begin(float(t[k]))
        if t[k] >= gauge.end - _SAME:
            _close_block(estimator, float(t[k]))
        if incomplete and incomplete[0] == k:
            assert isinstance(found, reference.Path)
            found.complete(feed.known[incomplete.pop(0)], float(t[k]), engine.belief().nav.C_nb)
        stop = min(gauge.end - _SAME, float(t[incomplete[0]]) if incomplete else np.inf)
        try:
            k, count = engine.advance(feed, k, stop)
        except DivergenceError as error:
            at = estimator.samples
            raise DivergenceError(
                f"the filter broke down at sample {at}, {t[min(k, t.size - 1)]:.3f} s: {error}"
            ) from error
        if count:
            yield engine.out[:count].copy()


def _feed(estimator: Estimator, found: Reference, t: Array, gyro: Array, accel: Array) -> "Feed":
    from filters.engines import Feed, draws

    settings = estimator.settings
    before = float(estimator._core(layout.CORE_T)) if estimator.samples else -np.inf
    if isinstance(found, TableMotion) and estimator._marks:
        known = _known_between_marks(estimator, found, t, before, gyro)
    else:
        known = found.known(t, before, gyro)
    if found.moving:
        estimator._turns.add(known[:, reference.RATE])
    drawn = draws(settings.seed, estimator.samples, t.size) if settings.measurements == "drawn" else np.empty((0, 9))
    contiguous = [np.ascontiguousarray(a, dtype=np.float64) for a in (t, gyro, accel, known)]
    return Feed(contiguous[0], contiguous[1], contiguous[2], contiguous[3], drawn)


def _known_between_marks(estimator: Estimator, found: TableMotion, t: Array, before: float, gyro: Array) -> Array:
    """Rows of samples with marks among them: a mark counts from the first sample that is not before it."""
    parts, first = [], 0
    while first < t.size:
        while estimator._marks and estimator._marks[0][0] <= t[first]:
            found.mark(*estimator._marks.pop(0))
        until = estimator._marks[0][0] if estimator._marks else np.inf
        last = first + int(np.searchsorted(t[first:], until, side="left"))
        parts.append(found.known(t[first:last], before, gyro[first:last]))
        before, first = float(t[last - 1]), last
    return np.concatenate(parts)


def _close_block(estimator: Estimator, t: float) -> None:
    engine, gauge = estimator._engine, estimator.gauge
    assert engine is not None
    sums = engine.sums
    with np.errstate(invalid="ignore"):
        residual = sums[layout.SUM_RESIDUAL : layout.SUM_BIAS] / sums[layout.SUM_RESIDUALS]
    mean_bias = sums[layout.SUM_BIAS : layout.SUM_RESIDUALS] / sums[layout.SUM_BIASES]
    gauge.close(t, residual, mean_bias, *engine.biases())
    sums[:] = 0.0
    still = estimator.reference is not None and not estimator.reference.moving
    engine.core[layout.CORE_SPREAD] = float(still and estimator.converged)


def estimate_of(row: Array) -> Estimate:
    """Estimate of a row of `rows`."""
    from filters.engines import covariance_of, nav_of

    return Estimate(
        int(row[layout.OUT_INDEX]),
        float(row[layout.OUT_T]),
        Belief(nav_of(row[layout.OUT_NAV : layout.OUT_NIS]), covariance_of(row[layout.OUT_P :])),
        row[layout.OUT_NU : layout.OUT_P].copy(),
        float(row[layout.OUT_NIS]),
        int(row[layout.OUT_DOF]),
    )


def warm_up() -> None:
    """Load or compile the filter's step, which takes some seconds the first time on a machine."""
    from filters.engines import compile_all

    compile_all()


def _alignment(settings: Settings) -> alignment.Alignment | None:
    if settings.reference == "gravity":
        return alignment.Levelling(settings.site, P0_ACCEL_BIAS_SD)
    if settings.reference == "trajectory":
        if not isinstance(settings.motion, Trajectory):
            raise ValueError('`motion` is missing: the reference "trajectory" needs one')
        return alignment.InMotion(settings.motion, settings.site, P0_ACCEL_BIAS_SD)
    return None


def _reference(settings: Settings) -> Reference:
    if settings.reference == "level":
        return reference.level(settings.site)
    profile = settings.motion
    if not isinstance(profile, Profile):
        raise ValueError('`motion` is missing: the reference "profile" needs one')
    if profile.align == "gyro" and settings.offset_sd is None:
        raise ValueError(
            '`align` is "gyro": the profile is found in the whole log, so it cannot be used live. Record, then replay;'
            ' or align by "marks"'
        )
    if profile.max_rate * settings.period > _MAX_TURN:
        raise ValueError(
            f"`profile` turns at up to {np.rad2deg(profile.max_rate):.0f} deg/s, which is"
            f" {np.rad2deg(profile.max_rate * settings.period):.0f} deg between two samples at"
            f" {1.0 / settings.period:g} Hz: nothing is known of the rate in between. Sample faster, or turn slower"
        )
    return TableMotion(profile, settings.site, settings.spec, settings.period, settings.offset, settings.offset_sd)

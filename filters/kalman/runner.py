"""One step, and the loop over samples: the same for live, replay and trace, so that equal samples give equal estimates.

Samples may come one by one or many at once; the results are the same to the last bit.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from filters import state
from filters.imu import STANDARD_GRAVITY
from filters.kalman import alarms, augmentation, layout
from filters.kalman.alarms import Turns
from filters.kalman.augmentation import Effects
from filters.kalman.consistency import Gauge, nis_gates
from filters.kalman.settings import Settings
from filters.kalman.spkf import Belief, DivergenceError
from filters.motion import alignment, reference
from filters.motion.profile import Profile
from filters.motion.reference import Reference, TableMotion, Trajectory
from filters.types import Array

if TYPE_CHECKING:
    from filters.kalman.engines import Engine, Feed

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
class Samples:
    """Samples on their way to the filter: `t` s (N,), `gyro`, `accel` body axes, SI (N, 3), `temperature` degC (N,)."""

    t: Array
    gyro: Array
    accel: Array
    temperature: Array

    def part(self, which: slice | NDArray[np.bool_]) -> "Samples":
        """Some of them."""
        return Samples(self.t[which], self.gyro[which], self.accel[which], self.temperature[which])

    @staticmethod
    def joined(parts: "list[Samples]") -> "Samples":
        """All of several, in order."""
        return Samples(
            np.concatenate([part.t for part in parts]),
            np.concatenate([part.gyro for part in parts]),
            np.concatenate([part.accel for part in parts]),
            np.concatenate([part.temperature for part in parts]),
        )


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
        If the reference cannot be had: no motion given, or a rate too slow for it; or if the effects' numbers do not
        belong together.
    """

    def __init__(self, settings: Settings, every: float = 0.0) -> None:
        self.settings = settings
        self.every = every
        self.gauge = Gauge(settings.period)
        self.gaps: list[tuple[float, float]] = []
        self.reference: Reference | None = None
        self.aligning = _alignment(settings)
        self.effects = settings.effects() if settings.effects is not None else None
        if self.effects is not None:
            augmentation.check(self.effects)
        self._engine: Engine | None = None
        self._P0_sd = np.zeros(state.SIZE)
        self._waiting: list[Samples] = []
        self._waiting_count = 0
        self._last_t = -np.inf
        self._shown_t = -np.inf
        self._turns = Turns()
        self._marks: list[tuple[float, str]] = []
        if self.aligning is None:
            self._begin(_reference(settings))

    def _begin(self, found: Reference) -> None:
        self.reference = found
        # here, since it brings the compiler along, which a command that only reads settings should not wait for
        from filters.kalman.engines import engine_of

        settings = self.settings
        nav, P0_sd = found.start()
        self._P0_sd = np.concatenate([P0_sd, np.full(3, P0_ACCEL_BIAS_SD), np.full(3, P0_GYRO_BIAS_SD)])
        self._engine = engine_of(settings, found.moving, self.every, self.effects)
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

    def extra(self) -> tuple[Array, Array]:
        """States of the effects now, (p,), and the covariance of all errors, theirs last, (15 + p, 15 + p), SI."""
        if self._engine is None:
            raise ValueError("the reference is not found yet: there is no estimate")
        return self._engine.extra()

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
        out = alarms.of_residuals(
            self.gauge.convergence(), self.settings.spec, self.observable, self.settings.reference
        )
        causes = alarms.causes(self.settings.reference)
        first = self.first_nis
        if first is not None and first > nis_gates()[9] and not any("off the reference" in text for text in out):
            out.append(f"the first innovation is far outside what the filter expects (NIS {first:.0f}): {causes}")
        if not out and self._forces_are_off():
            out.append(f"accelerometers are off the reference by over 0.5 g: {causes}")
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


def step(estimator: Estimator, t: float, gyro: Array, accel: Array, temperature: float = np.nan) -> list[Estimate]:
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
    temperature : float
        degC; NaN where it is not known. Effects look at it, the filter does not.

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
    return list(run(estimator, np.array([t]), gyro[None], accel[None], np.array([temperature]), last=False))


def run(
    estimator: Estimator, t: Array, gyro: Array, accel: Array, temperature: Array | None = None, *, last: bool = True
) -> Iterator[Estimate]:
    """Feed many samples, shapes (N,), (N, 3), (N, 3), (N,), and yield estimates; see `step`.

    `last` says that no more will come, so that samples which wait for a reference are used as they are.
    """
    for block in rows(estimator, t, gyro, accel, temperature, last=last):
        yield from map(estimate_of, block)


def finish(estimator: Estimator) -> Iterator[Estimate]:
    """Use the samples that still wait for a reference, when no more will come; see `step`."""
    for block in _finish(estimator):
        yield from map(estimate_of, block)


def rows(
    estimator: Estimator, t: Array, gyro: Array, accel: Array, temperature: Array | None = None, *, last: bool = True
) -> Iterator[Array]:
    """As `run`, with estimates as rows of `filters.kalman.layout.OUT_*`, some at a time, shape (K, OUT).

    The verdict of `estimator.gauge` is the same for all rows that come at once.
    """
    samples = Samples(t, gyro, accel, np.full(t.size, np.nan) if temperature is None else temperature)
    for first in range(0, t.size, _CHUNK):
        yield from _take(estimator, samples.part(slice(first, first + _CHUNK)))
    if last:
        yield from _finish(estimator)


def _finish(estimator: Estimator) -> Iterator[Array]:
    if estimator.aligning is None or not estimator._waiting:
        return
    samples = Samples.joined(estimator._waiting)
    estimator._waiting.clear()
    estimator._begin(estimator.aligning.found(samples.t, samples.gyro, samples.accel))
    estimator.aligning = None
    yield from _filter(estimator, samples)


def _take(estimator: Estimator, samples: Samples) -> Iterator[Array]:
    _check_steps(estimator, samples.t, samples.gyro)
    if estimator.aligning is None:
        yield from _filter(estimator, samples)
        return
    aligning, before, t = estimator.aligning, estimator._waiting_count, samples.t
    enough = next((k for k in range(t.size) if aligning.enough(float(t[k]), before + k + 1)), None)
    cut = t.size if enough is None else enough + 1
    estimator._waiting.append(samples.part(slice(cut)))
    estimator._waiting_count += cut
    if enough is not None:
        yield from _finish(estimator)
        yield from _filter(estimator, samples.part(slice(cut, None)))


def _check_steps(estimator: Estimator, t: Array, gyro: Array) -> None:
    """Refuse what no filter can use, and note the gaps."""
    period = estimator.settings.period
    before = np.concatenate([[estimator._last_t], t[:-1]])
    steps = t - before
    seen = estimator._waiting_count + estimator.samples
    if not np.all(steps > 0.0):
        k = int(np.argmax(~(steps > 0.0)))
        raise ValueError(f"`t` goes from {before[k]} s to {t[k]} s at sample {seen + k}: time must increase")
    gaps = _gaps(estimator, before, t)
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


def _gaps(estimator: Estimator, before: Array, t: Array) -> NDArray[np.bool_]:
    """Which of the steps from `before` to `t` are longer than a sample can stand for."""
    steps = t - before
    return (steps > _GAP * estimator.settings.period) & np.isfinite(steps)


def _filter(estimator: Estimator, samples: Samples) -> Iterator[Array]:
    """Feed samples to the engine, stopping where a block of the gauge ends or a row has to be completed."""
    found, engine = estimator.reference, estimator._engine
    assert found is not None
    assert engine is not None
    if not samples.t.size:
        return
    feed = _feed(estimator, found, samples)
    t = feed.t
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


def _feed(estimator: Estimator, found: Reference, samples: Samples) -> "Feed":
    """What the engine takes: the samples that are used, with what is known at each and what effects say of it."""
    from filters.kalman.engines import Feed, draws

    settings = estimator.settings
    known = _known(estimator, found, samples)
    included: list[Array] = []
    if estimator.effects is not None:
        samples, known, *included = _include(estimator, estimator.effects, found, samples, known)
    if found.moving:
        estimator._turns.add(known[:, reference.RATE])
    n = samples.t.size
    drawn = draws(settings.seed, estimator.samples, n) if settings.measurements == "drawn" else np.empty((0, 9))
    arrays = samples.t, samples.gyro, samples.accel, known, drawn, *included
    return Feed(*(np.require(a, np.float64, ("C", "W")) for a in arrays))


def _include(
    estimator: Estimator, effects: Effects, found: Reference, samples: Samples, known: Array
) -> tuple[Samples, Array, Array, Array]:
    """Samples that the effects let pass, what is known at them, their regressors and their noise.

    The others are predicted through, as samples that are flagged in the log are: the engine never sees them.
    """
    t = samples.t
    phi, scale, use = effects.rows(
        t, samples.gyro, samples.accel, samples.temperature, np.broadcast_to(known, (t.size, known.shape[1]))
    )
    augmentation.check_rows(effects.names, t, phi, scale, use)
    before = float(estimator._core(layout.CORE_T)) if estimator.samples else -np.inf
    if not use.all() or before != estimator._shown_t:
        samples = samples.part(use)
        # what a trajectory says at a sample that is not used goes to the next one that is
        known = found.known(samples.t, before, samples.gyro)
        steps_from = np.concatenate([[before], samples.t])[:-1]
        arrived = np.concatenate([[estimator._shown_t], t[:-1]])[use]
        left_out = _gaps(estimator, steps_from, samples.t) & ~_gaps(estimator, arrived, samples.t)
        new = [(float(steps_from[k]), float(samples.t[k] - steps_from[k])) for k in np.flatnonzero(left_out)]
        estimator.gaps = sorted(estimator.gaps + new)
    estimator._shown_t = float(t[-1])
    return samples, known, phi[use], scale[use]


def _known(estimator: Estimator, found: Reference, samples: Samples) -> Array:
    """What the reference says at each sample, or one row for all."""
    if estimator.effects is not None:
        before = estimator._shown_t
    else:
        before = float(estimator._core(layout.CORE_T)) if estimator.samples else -np.inf
    if isinstance(found, TableMotion) and estimator._marks:
        return _known_between_marks(estimator, found, samples.t, before, samples.gyro)
    return found.known(samples.t, before, samples.gyro)


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
    from filters.kalman.engines import covariance_of, nav_of

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
    from filters.kalman.engines import compile_all

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

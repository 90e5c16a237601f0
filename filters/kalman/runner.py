"""A run over samples: the same for live, replay and trace, so that equal samples give equal estimates.

Samples may come one by one or many at once; the results are the same to the last bit. `Estimator` holds the state of a
run; `step`, `run`, `rows` and `finish` feed it.
"""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from filters import state
from filters.imu import STANDARD_GRAVITY
from filters.kalman import alarms, augmentation, layout
from filters.kalman.alarms import Departure, Departures
from filters.kalman.consistency import TOLERANCE, ConvergenceMonitor, nis_gates
from filters.kalman.filter_input import FilterInput, InputBuilder, Readings, SampleTimes
from filters.kalman.first_rest import FirstRest
from filters.kalman.long_gap import HeldBiases, LongGaps, stretches
from filters.kalman.residual_watch import ResidualWatch
from filters.kalman.rows import Estimate, Moments, estimate_of
from filters.kalman.settings import P0_ACCEL_BIAS_SD, P0_GYRO_BIAS_SD, Settings, alignment_of, reference_of
from filters.kalman.spkf import DivergenceError
from filters.kalman.temperature_trend import TemperatureTrend
from filters.motion import reference
from filters.motion.reference import Reference, TableMotion
from filters.types import Array

if TYPE_CHECKING:
    from filters.kalman.engines import FilterEngine

_CHUNK = 8192
_SAME = 1e-9
_LOUD, _DRIFTING = 3.0, 3.0


class Estimator:
    """The filter with its reference and its convergence monitor; fed by `step` or `run`, read by everybody.

    `every`: least time between two estimates that `step` and `run` give, s; 0 for each sample, infinity for none.
    Raises InputError if the reference cannot be had: no motion given, or a rate too slow for it; or if the effects'
      numbers do not belong together.
    """

    def __init__(self, settings: Settings, every: float = 0.0) -> None:
        self.settings = settings
        self.every = every
        self.monitor = ConvergenceMonitor(settings.period)
        self.temperature = TemperatureTrend()
        self._departures = Departures()
        self.watch: ResidualWatch | None = None  # of a unit at rest
        self.reference: Reference | None = None
        self.vertical = np.zeros(3)
        """Mean of the vertical (down) over the run, body axes, shape (3,); shorter than 1 if the unit was turned."""
        self._force_sum, self._force_count = np.zeros(3), 0
        self.aligning = alignment_of(settings)
        self.effects = settings.effects() if settings.effects is not None else None
        if self.effects is not None:
            augmentation.check(self.effects)
        self.first_rest = FirstRest(settings.period, settings.spec) if settings.reference == "turned" else None
        self._times = SampleTimes(settings.period)
        self._long_gaps: LongGaps | None = None
        self._held: HeldBiases | None = None
        self._engine: FilterEngine | None = None
        self._inputs: InputBuilder | None = None
        self._P0_sd = np.zeros(state.SIZE)
        self._marks: list[tuple[float, str]] = []
        self._waiting: list[Readings] = []
        self._waiting_count = 0
        if self.aligning is None:
            self._begin(reference_of(settings))

    def _begin(self, found: Reference) -> None:
        self.reference = found
        # here, since it brings the compiler along, which a command that only reads settings should not wait for
        from filters.kalman.engines import ENGINES

        settings = self.settings
        nav, P0_sd = found.start()
        self.vertical = np.array(nav.C_nb[2])
        self._P0_sd = np.concatenate([P0_sd, np.full(3, P0_ACCEL_BIAS_SD), np.full(3, P0_GYRO_BIAS_SD)])
        self._engine = ENGINES[settings.filter](settings, found.moving, self.every, self.effects)
        self._engine.start(nav, self._P0_sd)
        self._long_gaps = LongGaps(settings.period, moving=found.moving)
        self.watch = None if found.moving else ResidualWatch(self.monitor.block)
        self._inputs = InputBuilder(settings, found, self.effects, self._times, self._marks)

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Time of the sample before each gap, and its length, s."""
        return self._times.gaps

    @property
    def samples(self) -> int:
        """Samples that the filter has used; those over which biases were held count once it goes on."""
        return int(self._core(layout.CORE_SAMPLES))

    @property
    def taken(self) -> int:
        """Samples that were taken: those that the filter has used, and those since the reference has ended."""
        return self.samples if self._held is None else self._held.count

    @property
    def held_since(self) -> float | None:
        """Time of the last sample with a reference, s, once biases are held and nothing is integrated; else None."""
        if self._held is not None:
            return self._held.since if self.nis_count else None
        over = self.first_rest is not None and self.first_rest.over and self.samples
        return self._core(layout.CORE_T) if over else None

    @property
    def awaits_reference(self) -> bool:
        """Whether samples have come, and no reference so far: navigation begins with the first that is known."""
        return self._held is not None and not self.nis_count

    @property
    def nis_sum(self) -> float:
        """Sum of NIS over all updates."""
        return self._core(layout.CORE_NIS_SUM)

    @property
    def nis_count(self) -> int:
        """How many updates with the reference there have been so far."""
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
        core, held = self._engine.core, self._held
        return Estimate(
            self.taken - 1,
            float(core[layout.CORE_T]) if held is None else held.t,
            self._engine.belief() if held is None else held.belief(),
            core[layout.CORE_NU :].copy(),
            float(core[layout.CORE_NIS_LAST]),
            int(core[layout.CORE_DOF_LAST]),
        )

    def extra(self) -> tuple[Array, Array]:
        """States of the effects now, (p,), and the covariance of all errors, theirs last, (15 + p, 15 + p), SI."""
        if self._engine is None:
            raise ValueError("the reference is not found yet: there is no estimate")
        return self._engine.extra()

    def warm_up(self, say: Callable[[str], None] | None = None) -> None:
        """Load or compile what this run needs, if it needs anything compiled; `say` as in `runner.warm_up`."""
        if self.settings.filter == "spkf":
            warm_up(say, effects=self.effects is not None and len(self.effects.names) > 0)

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
        seen = self.reference.observable(bias_sd, P0_sd)
        return tuple(shown and not lacks for shown, lacks in zip(seen, self.settings.unread, strict=True))

    @property
    def converged(self) -> bool:
        """Whether every bias that can be seen has converged."""
        since = self.monitor.convergence().since
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
            self.monitor.convergence(), self.settings.spec, self.observable, self.settings.reference
        )
        causes = alarms.causes(self.settings.reference)
        first = self.first_nis
        if first is not None and first > nis_gates()[9] and not any("off the reference" in text for text in out):
            out.append(f"the first innovation is far outside what the filter expects (NIS {first:.0f}): {causes}")
        sums, apparent = self._engine.sums, self.monitor.convergence().apparent
        if not out and apparent is None and sums[layout.SUM_RESIDUALS]:
            # before there is a mean over 10 s, that of the present second
            force = sums[layout.SUM_RESIDUAL : layout.SUM_RESIDUAL + 3] / sums[layout.SUM_RESIDUALS]
            if np.any(np.abs(force) > 0.5 * STANDARD_GRAVITY):
                out.append(f"accelerometers are off the reference by over 0.5 g: {causes}")
        departure = self.departure()
        # an effect of some per cent is no reference that belongs to something else; where it is, is told elsewhere
        if self._core(layout.CORE_OVERRULED) and (departure is None or departure.gross):
            out.append(
                f"{self.rejected} updates were left out as outliers, until they came too many in a row: the reference"
                " and the readings do not belong together"
            )
        own = self._engine.alarm()
        return out if own is None else [*out, own]

    def departure(self) -> Departure | None:
        """Where in a profile the readings depart from the model most certainly; None if nowhere."""
        if self._engine is None or not isinstance(self.reference, TableMotion):
            return None
        # a bias that drifts by little departs from where it was, too: that is told only where the last minute is loud
        ratio = self.monitor.remainder().ratio
        is_loud = ratio is not None and float(np.max(ratio)) > _LOUD
        least = TOLERANCE if is_loud else _DRIFTING * TOLERANCE
        return self._departures.worst(*self._engine.biases(), self.monitor.noise(), least)

    def confounded(self) -> list[str]:
        """Sentences on biases that the motion cannot tell from other effects, body axes; empty for a unit at rest."""
        return [] if self._inputs is None else self._inputs.turns.confounded()

    def take(self, readings: Readings) -> Iterator[Array]:
        """Feed readings and yield rows of estimates, `filters.kalman.layout.OUT_*`, shape (K, OUT); see `rows`."""
        self.temperature.take(readings.t, readings.temperature)
        if self.first_rest is not None:  # those alone that are known to be of it; at its end, what there is
            readings = self.first_rest.take(readings)
        if self.first_rest is None or readings.t.size:
            yield from self._take(readings)
        if self.first_rest is not None and self.first_rest.over:
            yield from self.use_waiting()

    def _take(self, readings: Readings) -> Iterator[Array]:
        self._times.check(readings.t, readings.gyro, self._waiting_count + self.samples)
        if self.aligning is None:
            yield from self._filter(readings)
            return
        aligning, before, t = self.aligning, self._waiting_count, readings.t
        enough = next((k for k in range(t.size) if aligning.enough(float(t[k]), before + k + 1)), None)
        cut = t.size if enough is None else enough + 1
        self._waiting.append(readings.part(slice(cut)))
        self._waiting_count += cut
        if enough is not None:
            yield from self.use_waiting()
            yield from self._filter(readings.part(slice(cut, None)))

    def use_waiting(self) -> Iterator[Array]:
        """Find the reference in the readings that wait for it, as many as there are, and feed them; see `take`."""
        if self.aligning is None or not self._waiting:
            return
        readings = Readings.joined(self._waiting)
        self._waiting.clear()
        self._begin(self.aligning.found(readings.t, readings.gyro, readings.accel))
        self.aligning = None
        yield from self._filter(readings)

    def _filter(self, readings: Readings) -> Iterator[Array]:
        """Feed readings to the engine, stopping where a block or a long gap ends, or a row has to be completed."""
        engine, inputs, long_gaps = self._engine, self._inputs, self._long_gaps
        assert engine is not None
        assert inputs is not None
        assert long_gaps is not None
        if not readings.t.size:
            return
        before = self._core(layout.CORE_T) if self.samples else -np.inf
        before = before if self._held is None else self._held.t
        samples = inputs.input(readings, self.taken, before)
        t = samples.t
        temperature = readings.temperature[np.searchsorted(readings.t, t)]
        resumed = long_gaps.ends(t, samples.known, before)
        for first, last, is_held in stretches(samples.known, t.size, self.samples, is_held=self._held is not None):
            if is_held:
                yield from self._hold(engine, t[first:last])
            else:
                if self._held is not None:  # navigation begins anew as behind a long gap
                    resumed = sorted({first, *resumed})
                    engine.core[layout.CORE_NEXT_OUT] = self._held.next_out
                    engine.core[layout.CORE_SAMPLES] = self._held.count
                    self._held = None
                here = [k for k in resumed if first <= k < last]
                yield from self._advance(engine, samples, temperature, first, last, here)

    def _hold(self, engine: "FilterEngine", t: Array) -> Iterator[Array]:
        if self._held is None:
            noise, core = self.settings.process_noise(), engine.core
            since, next_out = float(core[layout.CORE_T]), float(core[layout.CORE_NEXT_OUT])
            self._held = HeldBiases(engine.belief(), noise, since, self.samples, self.every, next_out)
        rows = self._held.take(t)
        if rows.size:
            yield rows

    def _advance(
        self,
        engine: "FilterEngine",
        samples: FilterInput,
        temperature: Array,
        first: int,
        last: int,
        resumed: list[int],
    ) -> Iterator[Array]:
        """Feed samples from `first` to before `last` to the engine, and with their temperatures, (N,), to the watch.

        Navigation begins anew at those of `resumed`.
        """
        t, found = samples.t, self.reference
        path = found if isinstance(found, reference.Path) else None
        incomplete = [k for k in range(first, last) if float(t[k]) in path.partial] if path is not None else []
        monitor, k = self.monitor, first
        end = float(t[last]) if last < t.size else np.inf
        while k < last:
            if not self.samples:
                monitor.begin(float(t[k]))
            if t[k] >= monitor.end - _SAME:
                self._close_block(engine, float(t[k]))
            if path is not None and incomplete and incomplete[0] == k:
                path.complete(samples.known[incomplete.pop(0)], float(t[k]), engine.belief().nav.C_nb)
            if resumed and resumed[0] == k:
                engine.resume(samples, resumed.pop(0))
            stop = min([end, monitor.end - _SAME, *(float(t[at[0]]) for at in (incomplete, resumed) if at)])
            begin = k
            try:
                k, count = engine.advance(samples, k, stop)
            except DivergenceError as error:
                at = self.samples
                raise DivergenceError(
                    f"the filter broke down at sample {at}, {t[min(k, t.size - 1)]:.3f} s: {error}"
                ) from error
            if self.watch is not None and k > begin:
                fed = slice(begin, k)
                self.watch.add(samples.accel[fed], samples.gyro[fed], temperature[fed], samples.phi[fed])
            if found is not None and found.moving and k > begin:
                # one after the other, so that the sum does not depend on how many samples come at once
                forces = np.vstack([self._force_sum, samples.accel[begin:k]])
                self._force_sum, self._force_count = np.cumsum(forces, axis=0)[-1], self._force_count + k - begin
            if count:
                yield engine.out[:count].copy()

    def _close_block(self, engine: "FilterEngine", t: float) -> None:
        sums = engine.sums
        with np.errstate(invalid="ignore"):
            residual = sums[layout.SUM_RESIDUAL : layout.SUM_BIAS] / sums[layout.SUM_RESIDUALS]
        found, seconds = self.reference, self.monitor.block
        if isinstance(found, TableMotion) and np.isfinite(residual).all():
            begin = self.monitor.end - seconds
            first, last = found.segment_of(np.array([begin, self.monitor.end - _SAME]))
            if first == last:  # a block that lies in one segment
                known = found.motion(np.array([self.monitor.end - 0.5 * seconds]))[0]
                self._departures.add(int(first), seconds, residual, known[reference.RATE], known[reference.FORCE])
        if self._force_count:
            self.vertical = -self._force_sum / (self._force_count * self.settings.site.gravity)
        if self.watch is not None:
            self.watch.close(self.monitor.end, engine.extra()[0] if self.effects is not None else np.empty(0))
        mean_bias = sums[layout.SUM_BIAS : layout.SUM_RESIDUALS] / sums[layout.SUM_BIASES]
        self.monitor.close(t, residual, mean_bias, *engine.biases())
        sums[:] = 0.0
        engine.core[layout.CORE_SPREAD] = float(found is not None and not found.moving and self.converged)


def step(estimator: Estimator, t: float, gyro: Array, accel: Array, temperature: float = np.nan) -> list[Estimate]:
    """Feed one sample.

    A reference that has to be found first holds back the first samples, then all of them come at once.

    `t`: s since the first sample, increasing.
    `gyro`, `accel`: angular rate (rad/s) and specific force (m/s²), body axes, shape (3,).
    `temperature`: degC; NaN where it is not known. Effects look at it, the filter does not.
    Returns at most one estimate every `estimator.every` s; none while the reference is being found.
    Raises InputError if `t` does not increase, the unit turns too fast for the rate, or its reference cannot be found.
    Raises DivergenceError if the filter broke down; the message names the sample.
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


def rows(
    estimator: Estimator, t: Array, gyro: Array, accel: Array, temperature: Array | None = None, *, last: bool = True
) -> Iterator[Array]:
    """As `run`, with estimates as rows of `filters.kalman.layout.OUT_*`, some at a time, shape (K, OUT).

    The verdict of `estimator.monitor` is the same for all rows that come at once.
    """
    readings = Readings(t, gyro, accel, np.full(t.size, np.nan) if temperature is None else temperature)
    for first in range(0, t.size, _CHUNK):
        yield from estimator.take(readings.part(slice(first, first + _CHUNK)))
    if last:
        yield from estimator.use_waiting()


def warm_up(say: Callable[[str], None] | None = None, *, effects: bool = False) -> None:
    """Load or compile the filter's step, which takes some seconds the first time on a machine.

    `say` is told how far it has come, a sentence at a time, if there is anything to compile. Effects that will join the
    filter have a step of their own, compiled when it is first needed.
    """
    from filters.kalman.engines import compile_step

    compile_step(say, effects)

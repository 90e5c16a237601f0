"""What turns samples into estimates for the runner: the compiled `spkf`, and any filter written as numpy steps.

Both keep the same totals, in the layout of `filters.kalman.layout`, and stop at the same samples; neither judges.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from filters import earth, state
from filters.imu import Noise
from filters.kalman import augmentation, ekf, layout, long_gap, spkf, spkf_paper
from filters.kalman.augmentation import Effects
from filters.kalman.consistency import nis_gates
from filters.kalman.filter_input import FilterInput
from filters.kalman.kernels import step
from filters.kalman.kernels.correction import MAX_REJECTIONS
from filters.kalman.layout import EXTRA_DENSITY, EXTRA_MEAN, EXTRA_OWN, EXTRA_TAU, STRIDE
from filters.kalman.rows import covariance_of, nav_of, padded, row_of
from filters.kalman.settings import FILTERS, GAP_PERIODS, Settings
from filters.kalman.spkf import Belief, DivergenceError
from filters.motion import reference
from filters.state import NavState
from filters.types import Array

_ROOM = 128


class FilterEngine(ABC):
    """A filter in a run.

    `settings`: of the run.
    `linear`: whether readings are linear between samples; else each is held over the step that it ends.
    `every`: least time between two rows of output, s; infinity for none.
    `effects`: whose states join the 15.
    """

    def __init__(self, settings: Settings, linear: bool, every: float, effects: Effects | None = None) -> None:
        self.settings, self.linear, self.every, self.effects = settings, linear, every, effects
        self.noise = settings.process_noise()
        # what the site's gravity has beyond normal gravity there; elsewhere normal gravity is added to it, m/s²
        site = settings.site
        self.anomaly = site.gravity - float(earth.normal_gravity(np.array(site.latitude), np.array(site.height)))
        # totals, sums of the block, moments of the errors, rows of output: `filters.kalman.layout`
        self.core = np.zeros(layout.CORE)
        self.core[layout.CORE_NU :] = np.nan
        self.core[layout.CORE_NIS_LAST] = np.nan
        self.core[layout.CORE_NEXT_OUT] = np.inf if np.isinf(every) else 0.0
        self.sums, self.moments = np.zeros(layout.SUMS), np.zeros(layout.MOMENTS)
        self.out = np.zeros((_ROOM, layout.OUT))

    @abstractmethod
    def start(self, nav: NavState, P0_sd: Array) -> None:
        """Begin with this belief; the first sample only sets the clock."""

    @abstractmethod
    def advance(self, samples: FilterInput, first: int, stop: float) -> tuple[int, int]:
        """Feed samples from `first` on while t < `stop` and there is room for output.

        Returns the index of the first sample not used and the number of rows of output; raises DivergenceError.
        """

    def resume(self, samples: FilterInput, k: int) -> None:
        """Begin navigation anew at sample k, which is the next one, behind a long gap; the biases are carried over."""
        seconds = float(samples.t[k]) - float(self.core[layout.CORE_T])
        belief = long_gap.belief_behind(self.belief(), _known(samples, k), self.noise, seconds)
        self.go_on(belief, samples, k, seconds)
        long_gap.set_clock(self.core, samples, k, self.settings.period)

    @abstractmethod
    def go_on(self, belief: Belief, samples: FilterInput, k: int, seconds: float) -> None:
        """Take up the belief behind a gap of so many seconds, at sample k."""

    @abstractmethod
    def belief(self) -> Belief:
        """State and covariance after the last sample."""

    def biases(self) -> tuple[Array, Array]:
        """The six biases, accelerometer then gyro, and their standard deviations; each (6,)."""
        belief = self.belief()
        return np.concatenate([belief.nav.accel_bias, belief.nav.gyro_bias]), np.sqrt(np.diag(belief.P)[9:])

    def extra(self) -> tuple[Array, Array]:
        """The p extra states, (p,), and the covariance of all errors, they last, (15 + p, 15 + p)."""
        return np.empty(0), self.belief().P

    def alarm(self) -> str | None:
        """A sentence where this filter knows that it is not to be trusted."""
        return None


class Compiled(FilterEngine):
    """`spkf`, by the compiled step."""

    def __init__(self, settings: Settings, linear: bool, every: float, effects: Effects | None = None) -> None:
        super().__init__(settings, linear, every, effects)
        par = np.zeros(layout.PAR)
        par[layout.PAR_PERIOD], par[layout.PAR_KAPPA] = settings.period, settings.kappa
        par[layout.PAR_GRAVITY_ANOMALY] = self.anomaly
        par[layout.PAR_LINEAR], par[layout.PAR_EVERY] = linear, every
        noise = self.noise
        densities = np.concatenate([noise.accel_vrw, noise.gyro_arw, noise.accel_walk, noise.gyro_walk])
        par[layout.PAR_NOISE : layout.PAR_GATE] = densities**2
        par[layout.PAR_GATE : layout.PAR_WHITE] = nis_gates()
        par[layout.PAR_WHITE :] = densities[:6] ** 2
        self._extra, self._across = _extra_of(effects)
        self._run = step.Run(self.core, np.zeros(state.SIZE * STRIDE), par, self.sums, self.moments, self.out)
        self._work = step.make_work()

    def start(self, nav: NavState, P0_sd: Array) -> None:
        self.core[: layout.NAV] = row_of(nav)
        self._run.P[:] = padded(np.diag(P0_sd**2))
        self._extra, self._across = _extra_of(self.effects)

    def advance(self, samples: FilterInput, first: int, stop: float) -> tuple[int, int]:
        fed = samples._replace(known=samples.known.reshape(-1))
        extra = step.Extra(self._extra, self._across, samples.phi) if self._across.size else None
        k, rows, why, row = step.advance(self._run, fed, first, stop, self._work, extra)
        if why == layout.INDEFINITE:
            raise DivergenceError(f"the covariance is not positive definite at {_STATES[row]}")
        if why == layout.NOT_FINITE:
            raise DivergenceError("the state is not finite")
        return int(k), int(rows)

    def go_on(self, belief: Belief, samples: FilterInput, k: int, seconds: float) -> None:
        if self.effects is not None and self._across.size:
            before = augmentation.Augmented(self.belief().nav, *self.extra())
            long_gap.resume_extra(self._extra, self._across, before, self.effects, samples.phi[k], seconds)
        self.core[: layout.NAV] = row_of(belief.nav)
        self._run.P[:] = padded(belief.P)

    def belief(self) -> Belief:
        return Belief(nav_of(self.core[: layout.NAV]), covariance_of(self._run.P))

    def biases(self) -> tuple[Array, Array]:
        variances = self._run.P[9 * (STRIDE + 1) :: STRIDE + 1]
        return self.core[layout.NAV_BA : layout.NAV].copy(), np.sqrt(variances)

    def extra(self) -> tuple[Array, Array]:
        p = self._across.size // (2 * STRIDE)
        extra = self._extra.reshape(-1, p) if p else np.empty((EXTRA_OWN, 0))
        across = self._across.reshape(2 * p, STRIDE)[:p, : state.SIZE]
        own = extra[EXTRA_OWN : EXTRA_OWN + p]
        return extra[EXTRA_MEAN].copy(), np.block([[covariance_of(self._run.P), across.T], [across, own]])


class Stepwise(FilterEngine):
    """A filter written as functions of one step: `start`, `predict`, `correct`, `common`, perhaps `alarm`.

    `module`: `filters.kalman.spkf`, `ekf` or `spkf_paper`; the others as in `FilterEngine`.
    """

    def __init__(
        self, module: ModuleType, settings: Settings, linear: bool, every: float, effects: Effects | None = None
    ) -> None:
        super().__init__(settings, linear, every, effects)
        self._module = module
        self._gates = nis_gates()
        self._belief: Any = None
        self._alarm: str | None = None  # what it said last: what the biases went through stays in them

    def start(self, nav: NavState, P0_sd: Array) -> None:
        self._belief = self._module.start(nav, P0_sd)

    def belief(self) -> Belief:
        common: Belief = self._module.common(self._belief)
        return common

    def alarm(self) -> str | None:
        return self._alarm

    def advance(self, samples: FilterInput, first: int, stop: float) -> tuple[int, int]:
        rows, k, core = 0, first, self.core
        while k < samples.t.size and samples.t[k] < stop and rows < len(self.out):
            known = _known(samples, k)
            if core[layout.CORE_SAMPLES] > 0.0:
                draw = samples.draws[k] if samples.draws.size else None
                self._step(samples.t[k], samples.gyro[k], samples.accel[k], known, draw)
            core[layout.CORE_T] = samples.t[k]
            core[layout.CORE_GYRO : layout.CORE_GYRO + 3] = samples.gyro[k]
            core[layout.CORE_ACCEL : layout.CORE_ACCEL + 3] = samples.accel[k]
            belief = self.belief()
            if hasattr(self._module, "alarm"):
                self._alarm = self._module.alarm(self._belief) or self._alarm
            self._tally(belief, samples.gyro[k], samples.accel[k], known)
            core[layout.CORE_SAMPLES] += 1.0
            if samples.t[k] >= core[layout.CORE_NEXT_OUT] - 1e-9:
                self._write(self.out[rows], samples.t[k], belief)
                rows += 1
            k += 1
        return k, rows

    def go_on(self, belief: Belief, samples: FilterInput, k: int, seconds: float) -> None:
        self._belief = self._module.of_common(belief)

    def _step(self, t: float, gyro: Array, accel: Array, known: Array, draw: Array | None) -> None:
        core, settings = self.core, self.settings
        dt = t - core[layout.CORE_T]
        held = max(1.0, dt / settings.period)
        gyros, accels = np.array([gyro, gyro]), np.array([accel, accel])
        if self.linear:
            gyros[0] = core[layout.CORE_GYRO : layout.CORE_GYRO + 3]
            accels[0] = core[layout.CORE_ACCEL : layout.CORE_ACCEL + 3]
        nav = self.belief().nav
        turned = 0.0
        if held > GAP_PERIODS:
            turned = float(np.linalg.norm(np.max(np.abs(gyros - nav.gyro_bias), axis=0))) * dt
        Q_d = spkf.process_noise(self.noise, nav.C_nb, dt, held, turned)
        gravity = self.anomaly + float(earth.normal_gravity(nav.latitude, nav.height))
        self._belief = self._module.predict(self._belief, gyros, accels, dt, gravity, Q_d, settings.kappa)
        self._correct(known, draw)

    def _correct(self, known: Array, draw: Array | None) -> None:
        core = self.core
        variances = known[reference.VARIANCES]
        rows = np.flatnonzero(variances >= 0.0)
        core[layout.CORE_NU :] = np.nan
        core[layout.CORE_DOF_LAST] = rows.size
        core[layout.CORE_NIS_LAST] = np.nan
        if not rows.size:
            return
        gate = self._gates[rows.size] if core[layout.CORE_IN_A_ROW] < MAX_REJECTIONS else np.inf
        self._belief, innovation = self._module.correct(
            self._belief,
            nav_of(np.concatenate([known[:10], np.zeros(6)])),
            rows,
            np.sqrt(variances[rows]),
            None if draw is None else draw[rows],
            gate,
        )
        if not np.isfinite(innovation.nis):
            raise DivergenceError("the state is not finite")
        core[layout.CORE_NU + rows] = innovation.nu
        core[layout.CORE_NIS_LAST] = innovation.nis
        if core[layout.CORE_NIS_COUNT] == 0.0:
            core[layout.CORE_NIS_FIRST] = innovation.nis
        core[layout.CORE_NIS_SUM] += innovation.nis
        core[layout.CORE_DOF_SUM] += rows.size
        core[layout.CORE_NIS_COUNT] += 1.0
        if not innovation.accepted:
            core[layout.CORE_REJECTED] += 1.0
            core[layout.CORE_IN_A_ROW] += 1.0
            return
        core[layout.CORE_OVERRULED] += innovation.nis > self._gates[rows.size]
        core[layout.CORE_IN_A_ROW] = 0.0

    def _tally(self, belief: Belief, gyro: Array, accel: Array, known: Array) -> None:
        nav, sums = belief.nav, self.sums
        sums[layout.SUM_BIAS : layout.SUM_BIAS + 6] += np.concatenate([nav.accel_bias, nav.gyro_bias])
        sums[layout.SUM_BIASES] += 1.0
        if np.isfinite(known[reference.RATE.start]):
            residual = np.concatenate([accel - known[reference.FORCE], gyro - known[reference.RATE]])
            sums[layout.SUM_RESIDUAL : layout.SUM_RESIDUAL + 6] += residual
            sums[layout.SUM_RESIDUALS] += 1.0
        if self.core[layout.CORE_SPREAD]:
            error = nav.minus(nav_of(np.concatenate([known[:10], np.zeros(6)])))
            moments = self.moments
            moments[layout.MOMENT_COUNT] += 1.0
            mean = moments[layout.MOMENT_MEAN : layout.MOMENT_SCATTER]
            before = error - mean
            mean += before / moments[layout.MOMENT_COUNT]
            moments[layout.MOMENT_SCATTER :] += np.outer(before, error - mean).ravel()

    def _write(self, row: Array, t: float, belief: Belief) -> None:
        core = self.core
        row[layout.OUT_INDEX], row[layout.OUT_T] = core[layout.CORE_SAMPLES] - 1.0, t
        row[layout.OUT_NAV : layout.OUT_NIS] = row_of(belief.nav)
        row[layout.OUT_NIS] = core[layout.CORE_NIS_LAST]
        row[layout.OUT_DOF] = core[layout.CORE_DOF_LAST]
        row[layout.OUT_NU : layout.OUT_P] = core[layout.CORE_NU :]
        row[layout.OUT_P :] = padded(belief.P)
        core[layout.CORE_NEXT_OUT] += self.every
        if core[layout.CORE_NEXT_OUT] <= t:
            core[layout.CORE_NEXT_OUT] = t + self.every


def _known(samples: FilterInput, k: int) -> Array:
    """What the reference says at sample k."""
    known: Array = samples.known[k if len(samples.known) > 1 else 0]
    return known


def _extra_of(effects: Effects | None) -> tuple[Array, Array]:
    """The extra states at the start and their covariances with the 15, laid out for `kernels`."""
    p = 0 if effects is None else effects.mean.size
    extra = np.zeros((EXTRA_OWN + 2 * p, p))
    if effects is not None:
        extra[EXTRA_MEAN], extra[EXTRA_TAU], extra[EXTRA_DENSITY] = effects.mean, effects.tau, effects.q
        extra[EXTRA_OWN : EXTRA_OWN + p] = effects.covariance
    return extra.ravel(), np.zeros(2 * p * STRIDE)


ENGINES: dict[str, Callable[..., FilterEngine]] = {
    "spkf": Compiled,
    "spkf-paper": partial(Stepwise, spkf_paper),
    "ekf": partial(Stepwise, ekf),
}
assert tuple(ENGINES) == FILTERS

_STATES = [f"{axis} {name}" for name in ("position", "velocity", "attitude") for axis in ("north", "east", "down")] + [
    f"{axis} {name} bias" for name in ("accelerometer", "gyro") for axis in "xyz"
]


def compile_step(say: Callable[[str], None] | None = None, effects: bool = False) -> None:
    """Compile the step, or load it from the disk, by running it once on two samples; see `runner.warm_up`."""
    noise = Noise((1.0,) * 3, (1.0,) * 3)
    engine = Compiled(Settings(1.0, noise=noise), False, np.inf, _OneState() if effects else None)
    still = reference.level(state.PAPER_SITE)
    nav, P0_sd = still.start()
    engine.start(nav, np.append(P0_sd, np.ones(6)))
    t, rate = np.array([0.0, 1.0]), np.zeros((2, 3))
    _, force = still.rates_and_forces()
    known, phi = still.known(t, -np.inf, rate), np.zeros((2, 6, int(effects)))
    samples = FilterInput(t, rate, np.tile(force, (2, 1)), known, np.empty((0, 9)), phi)
    with step.told(say, effects=effects):
        engine.advance(samples, 0, np.inf)


class _OneState:
    """An effect that does nothing, to compile what effects need."""

    names: tuple[str, ...] = ("none",)
    mean = np.zeros(1)
    covariance = np.eye(1)
    tau = np.full(1, np.inf)
    q = np.zeros(1)

    def rows(
        self, t: Array, gyro: Array, accel: Array, temperature: Array, known: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """A regressor of zeros."""
        return np.zeros((t.size, 6, 1)), np.ones((t.size, 6)), np.ones(t.size, bool)

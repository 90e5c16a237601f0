from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pytest
from helpers.filtering import same_however_they_come
from scipy.special import chdtri

from filters import earth, state
from filters.imu import IMU400CD_200, Noise
from filters.kalman import (
    augmentation,
    consistency,
    engines,
    layout,
    runner,
    spkf,
)
from filters.kalman.augmentation import Augmented
from filters.kalman.filter_input import FilterInput, draws
from filters.kalman.rows import nav_of
from filters.kalman.runner import Estimator
from filters.kalman.settings import GAP_PERIODS, Settings
from filters.motion import reference
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from filters.motion.segments import Dwell, Rate
from filters.state import PAPER_SITE

DT = 0.05
RATE, FORCE = reference.level(PAPER_SITE).rates_and_forces()
WHITE = np.repeat([1 / 60, np.deg2rad(0.075)], 3)
TURNING = reference.TableMotion(
    Profile((Dwell((0.0, 0.0, 0.0), 2.0), Dwell((0.5, 1.5, -1.0), 4.0), Dwell((-1.0, 0.2, 0.3), 20.0)), offset_sd=0.0),
    PAPER_SITE,
    IMU400CD_200,
    DT,
)
BIAS_SD = np.repeat([18e-3 * 9.80665, np.deg2rad(1.5)], 3)


@dataclass
class Columns:
    """Effects whose regressor is a function of the samples."""

    mean: np.ndarray
    covariance: np.ndarray
    column: Callable[..., np.ndarray]
    tau: np.ndarray
    q: np.ndarray
    scale: Callable[[np.ndarray], np.ndarray] = lambda t: np.ones((t.size, 6))
    use: Callable[[np.ndarray], np.ndarray] = lambda t: np.ones(t.size, bool)
    seen: list[np.ndarray] = field(default_factory=list)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"x{j}" for j in range(self.mean.size))

    def rows(
        self, t: np.ndarray, gyro: np.ndarray, accel: np.ndarray, temperature: np.ndarray, known: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        self.seen.append(temperature)
        return self.column(t, gyro, accel, temperature, known), self.scale(t), self.use(t)


def constants(mean: list[float], sd: list[float], column: Callable[..., np.ndarray], **fields: object) -> Columns:
    p = len(mean)
    given = {"tau": np.full(p, np.inf), "q": np.zeros(p)} | fields
    return Columns(np.array(mean), np.diag(np.square(sd)), column, **given)  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------ compiled and readable


def by_numpy(engine: engines.FilterEngine, feed: FilterInput, nav: state.NavState, P0_sd: np.ndarray) -> Augmented:
    """The filter on 15 + p states as `inclusion` writes it, over all samples of a feed."""
    effects, noise = engine.effects, engine.noise
    belief = augmentation.start(nav, P0_sd, effects)
    for k in range(1, feed.t.size):
        first = k - 1 if engine.linear else k
        dt = feed.t[k] - feed.t[k - 1]
        ends = [first, k]
        belief = augmentation.drift(belief, effects.tau, effects.q, dt)
        held = max(1.0, dt / engine.settings.period)
        turned = 0.0
        if held > GAP_PERIODS:
            rates = feed.gyro[ends] - np.einsum("eip,p->ei", feed.phi[ends], belief.x)[:, 3:] - belief.nav.gyro_bias
            turned = float(np.linalg.norm(np.max(np.abs(rates), axis=0))) * dt
        scale = feed.noise_scale[k]
        here = replace(
            noise,
            accel_vrw=tuple(noise.accel_vrw * scale[:3]),  # type: ignore[arg-type]
            gyro_arw=tuple(noise.gyro_arw * scale[3:]),  # type: ignore[arg-type]
        )
        Q_d = spkf.process_noise(here, belief.nav.C_nb, dt, held, turned)
        gravity = float(earth.normal_gravity(belief.nav.latitude, belief.nav.height))
        belief = augmentation.predict(belief, feed.gyro[ends], feed.accel[ends], feed.phi[ends], dt, gravity, Q_d)
        known = feed.known[k]
        rows = np.flatnonzero(known[reference.VARIANCES] >= 0.0)
        if rows.size:
            target = nav_of(np.concatenate([known[:10], np.zeros(6)]))
            R_sd = np.sqrt(known[reference.VARIANCES][rows])
            belief, _ = augmentation.correct(belief, target, rows, R_sd, feed.draws[k][rows])
    return belief


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("p", [1, 2, 6])
def test_the_compiled_step_is_the_readable_one(p: int, moving: bool) -> None:
    rng = np.random.default_rng(p)
    n = 240
    t = np.arange(n) * DT
    t[140:] += 0.5 if moving else 3.0  # in a dwell
    found = TURNING if moving else reference.level(PAPER_SITE)
    known = np.broadcast_to(found.known(t, -np.inf, np.zeros((n, 3))), (n, 25)).copy()
    turn = known[:, reference.RATE] - RATE
    gyro = known[:, reference.RATE] + rng.normal(size=(n, 3)) * 5e-3
    accel = known[:, reference.FORCE] + rng.normal(size=(n, 3)) * 0.1
    # regressors of the size of a scale factor's and a temperature's, on all channels, and of a drift on one
    phi = np.zeros((n, 6, p))
    phi[:, 3:, 0] = turn if moving else np.sin(t)[:, None]
    for j in range(1, p):
        phi[:, j % 6, j] = 0.3 * np.cos(0.1 * j * t)
        phi[:, (j + 3) % 6, j] += 1.0
    effects = Columns(
        rng.normal(size=p) * 1e-2,
        np.diag(np.full(p, 2e-2**2)) + 1e-4,
        lambda *_: phi,
        np.array([np.inf, 5.0, 30.0, np.inf, 2.0, 100.0][:p]),
        np.array([0.0, 2e-3, 1e-3, 0.0, 1e-3, 1e-4][:p]),
    )
    made = np.einsum("kip,p->ki", phi, effects.mean)
    gyro, accel = gyro + made[:, 3:], accel + made[:, :3]
    noise = Noise((0.02, 0.01, 0.03), (1e-3, 2e-3, 3e-3), (1e-4, 0.0, 0.0), (0.0, 1e-5, 0.0))
    # rows are known now and then only, as on a table that moves
    known[60:100, reference.VARIANCES] = -1.0
    known[::3, reference.VARIANCES][:, 2:5] = -1.0
    scale = 1.0 + 0.5 * np.sin(t)[:, None] * np.ones(6)
    feed = FilterInput(t, gyro, accel, known, draws(7, 0, n), phi, scale)
    engine = engines.Compiled(Settings(DT, noise=noise), moving, np.inf, effects)
    nav, P0_sd = found.start()
    P0_sd = np.append(P0_sd, [0.2] * 3 + [0.03] * 3)
    engine.start(nav, P0_sd)
    for n_used in (1, n):
        engine.advance(feed, 0 if n_used == 1 else 1, np.inf if n_used == n else t[1])
    readable = by_numpy(engine, feed, nav, P0_sd)
    x, P = engine.extra()
    sd = np.sqrt(np.diag(readable.P))
    assert x.shape == (p,)
    assert not engine.core[layout.CORE_REJECTED]
    assert np.max(np.abs(engine.belief().nav.minus(readable.nav)) / sd[:15]) < 1e-3
    assert np.max(np.abs(x - readable.x) / sd[15:]) < 1e-3
    assert np.max(np.abs(P - readable.P) / np.outer(sd, sd)) < 1e-3


# ----------------------------------------------------------------------------------------------------------- statistics


def chi_square_band(dof: int) -> tuple[float, float]:
    """The 99.8 % interval of chi-square."""
    return float(chdtri(dof, 0.999)), float(chdtri(dof, 0.001))


def still(n: int, seed: int, bias: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples at 20 Hz of a level unit with Table 1 noise and an error of its own, accelerometer then gyro, (N, 6)."""
    readings = np.concatenate([FORCE, RATE]) + bias + error
    readings = readings + np.random.default_rng([seed, 1]).normal(size=(n, 6)) * WHITE / np.sqrt(DT)
    return np.arange(n) * DT, readings[:, 3:], readings[:, :3]


def nees(estimator: Estimator, bias: np.ndarray, x: np.ndarray) -> float:
    """Squared error of all 15 + p states over their covariance."""
    found, P = estimator.extra()
    truth = replace(reference.level(PAPER_SITE).nav, accel_bias=bias[:3], gyro_bias=bias[3:])
    error = np.concatenate([estimator.latest.belief.nav.minus(truth), found - x])
    return float(error @ np.linalg.solve(P, error))


def warming(t: np.ndarray) -> np.ndarray:
    """degC."""
    return 22.0 + 12.0 * (1.0 - np.exp(-t / 25.0)) + 2.0 * np.sin(t / 7.0)


def thermal(t: object, gyro: object, accel: object, temperature: np.ndarray, known: object) -> np.ndarray:
    """k (T - T0) on the x accelerometer and the y gyro."""
    phi = np.zeros((temperature.size, 6, 2))
    phi[:, 0, 0] = phi[:, 4, 1] = temperature - 25.0
    return phi


THERMAL_SD = [0.3e-3 * 9.8, np.deg2rad(0.02)]
"""Of both coefficients: 0.3 mg/K, 0.02 deg/s/K."""


def test_errors_of_all_states_lie_in_the_band_and_the_bias_suffers_without_the_effect() -> None:
    n, seeds, sums = 1200, 24, np.zeros(4)
    updates = 0
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        bias, x = rng.normal(size=6) * BIAS_SD, rng.normal(size=2) * THERMAL_SD
        t = np.arange(n) * DT
        phi = thermal(t, None, None, warming(t), None)
        samples = still(n, seed, bias, phi @ x)
        make = partial(constants, [0.0, 0.0], THERMAL_SD, thermal)
        errors = []
        for effects in (make, None):
            estimator = Estimator(Settings(DT, measurements="drawn", seed=seed, effects=effects), every=np.inf)
            list(runner.rows(estimator, *samples, warming(t)))
            errors.append(float(estimator.latest.belief.nav.gyro_bias[1] - bias[4]))
            if effects is not None:
                sums[:2] += nees(estimator, bias, x), estimator.nis_sum
                updates += estimator.nis_count
        sums[2:] += np.square(errors)
    low, high = chi_square_band(17 * seeds)
    assert low < sums[0] < high, f"{sums[0]:.1f} of {17 * seeds}"
    low, high = consistency.nis_band(9, updates, 0.998)
    assert low < sums[1] / updates < high
    with_effect, without = np.sqrt(sums[2:] / seeds)
    assert without > 3.0 * with_effect


def test_a_drifting_state_is_followed_within_its_band() -> None:
    n, seeds, total = 1000, 24, 0.0
    sigma, tau = np.deg2rad(0.3), 20.0
    keep = np.exp(-DT / tau)
    column = np.zeros((6, 1))
    column[5] = 1.0
    effects = partial(
        constants,
        [0.0],
        [sigma],
        lambda t, *_: np.broadcast_to(column, (t.size, 6, 1)),
        tau=np.array([tau]),
        q=np.array([sigma * np.sqrt(2.0 / tau)]),
    )
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        bias, x = rng.normal(size=6) * BIAS_SD, np.empty(n)
        x[0] = rng.normal() * sigma
        for k in range(1, n):
            x[k] = keep * x[k - 1] + rng.normal() * sigma * np.sqrt(1.0 - keep**2)
        estimator = Estimator(Settings(DT, measurements="drawn", seed=seed, effects=effects), every=np.inf)
        list(runner.rows(estimator, *still(n, seed, bias, column[:, 0] * x[:, None])))
        total += nees(estimator, bias, x[-1:])
    low, high = chi_square_band(16 * seeds)
    assert low < total < high, f"{total:.1f} of {16 * seeds}"


def test_scale_factors_are_found_on_a_table_that_turns() -> None:
    n, seeds, total = 900, 24, 0.0
    turns = [Rate("inner", 0.6, 6.0), Rate("middle", -0.5, 6.0), Rate("outer", 0.6, 6.0), Dwell((0.0, 0.0, 0.0), 30.0)]
    profile = Profile((Dwell((0.0, 0.0, 0.0), 3.0), *turns), offset_sd=1e-6)
    t = np.arange(n) * DT
    table = reference.TableMotion(profile, PAPER_SITE, IMU400CD_200, DT)
    known = table.known(t, -np.inf, np.zeros((n, 3)))

    def own_rate(t: object, gyro: object, accel: object, temperature: object, known: np.ndarray) -> np.ndarray:
        phi = np.zeros((len(known), 6, 3))
        for i in range(3):
            phi[:, 3 + i, i] = known[:, layout.KNOWN_RATE + i]
        return phi

    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        bias, k = rng.normal(size=6) * BIAS_SD, rng.normal(size=3) * 0.01
        noise = rng.normal(size=(n, 6)) * WHITE / np.sqrt(DT)
        gyro = known[:, reference.RATE] * (1.0 + k) + bias[3:] + noise[:, 3:]
        accel = known[:, reference.FORCE] + bias[:3] + noise[:, :3]
        make = partial(constants, [0.0] * 3, [0.01] * 3, own_rate)
        settings = Settings(DT, reference="profile", motion=profile, measurements="drawn", seed=seed, effects=make)
        estimator = Estimator(settings, every=np.inf)
        list(runner.rows(estimator, t, gyro, accel))
        found, P = estimator.extra()
        truth = nav_of(np.concatenate([known[-1, :10], bias]))
        error = np.concatenate([estimator.latest.belief.nav.minus(truth), found - k])
        total += float(error @ np.linalg.solve(P, error))
        assert np.all(np.sqrt(np.diag(P)[15:]) < 3e-3)
    low, high = chi_square_band(18 * seeds)
    assert low < total < high, f"{total:.1f} of {18 * seeds}"


# -------------------------------------------------------------------------------------------------------- in the runner


class Lagged(Columns):
    """One state, driven by how far the temperature is ahead of its own lag; remembers the lag from call to call."""

    lag = np.nan

    def rows(
        self, t: np.ndarray, gyro: np.ndarray, accel: np.ndarray, temperature: np.ndarray, known: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        phi = np.zeros((t.size, 6, 1))
        for k, value in enumerate(temperature.tolist()):
            self.lag = value if np.isnan(self.lag) else self.lag + 0.02 * (value - self.lag)
            phi[k, 4, 0] = value - self.lag + 1e-3 * np.nan_to_num(known[k, layout.KNOWN_RATE])
        return phi, self.scale(t), self.use(t)


def lagged() -> Lagged:
    return Lagged(
        np.array([1e-3]),
        np.array([[1e-6]]),
        thermal,
        np.array([300.0]),
        np.array([1e-5]),
        scale=lambda t: 1.0 + 0.3 * np.sin(t)[:, None] * np.ones(6),
        # three of ten for a while, and stretches long enough to be a gap and a long gap
        use=lambda t: ~((np.round(t / DT) % 10 < 3) & (t > 5.0) | (t > 20.0) & (t < 21.0) | (t > 24.0) & (t < 27.0)),
    )


@pytest.mark.parametrize("kind", ["level", "gravity", "trajectory"])
def test_one_by_one_and_all_at_once_are_the_same_to_the_last_bit(kind: str) -> None:
    n = 600
    t, gyro, accel = still(n, 3, np.zeros(6), np.zeros(6))
    row = [PAPER_SITE.latitude, PAPER_SITE.longitude, PAPER_SITE.height, 0, 0, 0, 0, 0, 0]
    motion = Trajectory(t[::7] + 0.01, np.tile(row, (len(t[::7]), 1))) if kind == "trajectory" else None
    settings = Settings(DT, reference=kind, motion=motion, measurements="drawn", effects=lagged)
    whole, at_once = same_however_they_come(settings, (t, gyro, accel, warming(t)))
    assert len(at_once) == np.count_nonzero(lagged().use(t))
    assert [round(seconds, 6) for _, seconds in whole.gaps if seconds > 0.5] == [1.2, 3.2]


def test_a_sample_that_is_not_used_is_as_if_it_had_not_come() -> None:
    n = 400
    t, gyro, accel = still(n, 4, np.zeros(6), np.zeros(6))
    use = (t < 5.0) | (t > 6.0)
    estimator = Estimator(Settings(DT, effects=partial(no_states, use=lambda t: (t < 5.0) | (t > 6.0))))
    left_out = list(runner.run(estimator, t, gyro, accel))
    plain = Estimator(Settings(DT))
    missing = list(runner.run(plain, t[use], gyro[use], accel[use]))
    assert [e.t for e in left_out] == [e.t for e in missing]
    assert all(np.array_equal(a.belief.P, b.belief.P) for a, b in zip(left_out, missing, strict=True))
    assert estimator.gaps == plain.gaps
    assert len(plain.gaps) == 1


def test_states_of_effects_live_through_a_long_gap() -> None:
    t, gyro, accel = still(400, 3, np.zeros(6), np.zeros(6))
    t[200:] += 60.0
    estimator = Estimator(Settings(DT, effects=lagged))
    before = after = (np.empty(0), np.empty(0))
    for k in range(t.size):
        list(runner.step(estimator, float(t[k]), gyro[k], accel[k], float(warming(t)[k])))
        before = estimator.extra() if k == 199 else before
        after = estimator.extra() if k == 203 else after  # the first that is used
    fade = np.exp(-(60.0 + 4 * DT) / 300.0)
    assert after[0] == pytest.approx(before[0] * fade, rel=1e-3, abs=1e-9)
    grown = -0.5 * 1e-5**2 * 300.0 * np.expm1(-2.0 * (60.0 + 4 * DT) / 300.0)
    assert after[1][15, 15] == pytest.approx(before[1][15, 15] * fade**2 + grown, rel=1e-3)
    assert np.all(np.linalg.eigvalsh(after[1]) > 0.0)
    assert estimator.rejected == 0


def no_states(**fields: object) -> Columns:
    return constants([], [], lambda t, *_: np.empty((t.size, 6, 0)), **fields)


def test_noise_by_sample_is_that_of_the_channel() -> None:
    samples = still(300, 5, np.zeros(6), np.zeros(6))
    scale = np.array([1.0, 1.0, 1.0, 3.0, 1.0, 1.0])
    spec = Noise.of(IMU400CD_200)
    louder = replace(spec, gyro_arw=(3.0 * spec.gyro_arw[0], *spec.gyro_arw[1:]))
    covariances = []
    for settings in (
        Settings(DT, effects=partial(no_states, scale=lambda t: np.tile(scale, (t.size, 1)))),
        Settings(DT, noise=louder),
        Settings(DT, effects=no_states),
        Settings(DT),
    ):
        estimator = Estimator(settings)
        covariances.append(list(runner.run(estimator, *samples))[-1].belief.P)
    sd = np.sqrt(np.diag(covariances[1]))
    assert np.max(np.abs(covariances[0] - covariances[1]) / np.outer(sd, sd)) < 1e-9
    assert np.array_equal(covariances[2], covariances[3])
    assert covariances[0][12, 12] > 1.5 * covariances[2][12, 12]


def test_the_monitor_judges_residuals_without_the_effect() -> None:
    error = np.zeros(6)
    error[3] = np.deg2rad(6.0)
    samples = still(700, 6, np.zeros(6), np.tile(error, (700, 1)))
    column = np.zeros((6, 1))
    column[3] = 1.0
    make = partial(constants, [error[3]], [1e-4], lambda t, *_: np.broadcast_to(column, (t.size, 6, 1)))
    explained, plain = (Estimator(Settings(DT, effects=effects)) for effects in (make, None))
    for estimator in (explained, plain):
        list(runner.rows(estimator, *samples))
    apparent = [e.monitor.convergence().apparent for e in (explained, plain)]
    assert abs(apparent[0][3]) < np.deg2rad(0.2)
    assert apparent[1][3] == pytest.approx(error[3], abs=np.deg2rad(0.2))
    assert explained.converged
    assert explained.alarms() == []
    assert len(plain.alarms()) == 1


def test_the_temperature_of_each_sample_reaches_the_effects() -> None:
    t, gyro, accel = still(10, 7, np.zeros(6), np.zeros(6))
    estimator = Estimator(Settings(DT, effects=partial(no_states)))
    list(runner.run(estimator, t[:5], gyro[:5], accel[:5], warming(t[:5])))
    runner.step(estimator, float(t[5]), gyro[5], accel[5])
    assert isinstance(estimator.effects, Columns)
    seen = np.concatenate(estimator.effects.seen)
    assert np.array_equal(seen, np.append(warming(t[:5]), np.nan), equal_nan=True)


# ------------------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize("name", ["ekf", "spkf-paper"])
def test_effects_join_one_filter_only(name: str) -> None:
    with pytest.raises(ValueError, match=f'"{name}", but effects .* "spkf" only'):
        Settings(DT, filter=name, effects=no_states)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"tau": np.array([0.0, 1.0])}, "`tau` .* not positive"),
        ({"q": np.array([0.0, -1.0])}, "`q` .* negative"),
        ({"q": np.zeros(3)}, r"`q` .* shape \(3,\), not \(2,\)"),
        ({"mean": np.array([0.0, np.nan])}, "`mean` .* not finite"),
        ({"covariance": np.array([[1.0, 2.0], [2.0, 1.0]])}, "`covariance` .* not symmetric and positive"),
    ],
)
def test_effects_whose_numbers_do_not_belong_together_are_refused(wrong: dict[str, np.ndarray], words: str) -> None:
    effects = replace(constants([0.0, 0.0], THERMAL_SD, thermal), **wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=words):
        Estimator(Settings(DT, effects=lambda: effects))


def test_a_driver_that_is_not_known_is_an_error_with_the_time() -> None:
    samples = still(100, 8, np.zeros(6), np.zeros(6))
    make = partial(constants, [0.0, 0.0], THERMAL_SD, thermal)
    temperature = np.where(samples[0] > 2.0, np.nan, 25.0)
    with pytest.raises(ValueError, match=r'"x0" depends on what is not known at 2\.050 s'):
        list(runner.rows(Estimator(Settings(DT, effects=make)), *samples, temperature))
    without = partial(make, use=lambda t: t <= 2.0)
    list(runner.rows(Estimator(Settings(DT, effects=without)), *samples, temperature))

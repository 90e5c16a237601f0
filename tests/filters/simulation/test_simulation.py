"""The simulator: each effect leaves the signature of its equation, and numbers do not depend on how they come."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import signal
from scipy.spatial.transform import Rotation

from filters import earth, simulation
from filters.imu import AxisMap, ImuSpec, parse_mount
from filters.motion import kinematics, segments
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sine
from filters.simulation import (
    EFFECTS,
    LOOP_HZ,
    Effect,
    PowerOn,
    Recording,
    Scenario,
    Temperature,
    Truth,
    Unit,
    parameters,
)
from filters.state import PAPER_SITE

DEG = np.pi / 180.0
G = 9.80665
UNITS = np.array([DEG] * 3 + [1e-3 * G] * 3)  # dps, mg
INPUTS = np.array([DEG] * 3 + [G] * 3)  # dps, g
CHANNELS = parameters.CHANNELS
NONE = (0.0, 0.0, 0.0)
QUIET = ImuSpec(gyro_arw=0.0, accel_vrw=0.0, gyro_bandwidth=0.0, accel_bandwidth=0.0)
MOVING = Profile(
    (
        Dwell((0.0, 0.0, 0.0), 4.0),
        Rate("inner", 80 * DEG, 6.0),
        Rate("outer", -50 * DEG, 4.0),
        Sine("middle", 20 * DEG, 0.5, 8.0),
        Dwell((30 * DEG, 60 * DEG, 45 * DEG), 4.0),
        Rate("inner", -70 * DEG, 6.0),
    )
)
HEATED = Temperature(((0.0, 20.0), (15.0, 45.0), (30.0, 15.0), (45.0, 35.0)))
SCENE = Scenario(seed=5, spec=QUIET, accel_bias=NONE, gyro_bias=NONE, temperature=HEATED, profile=MOVING)
SECONDS = 45.0
HZ = 100.0


def recorded(scenario: Scenario, power_on: int = 0, seconds: float = SECONDS, hz: float = HZ) -> Recording:
    return Unit(scenario, power_on, hz).record(round(seconds * hz))


def readings(recording: Recording, axes: AxisMap | None = None) -> np.ndarray:
    """What the instrument shows, its axes and sign, dps and mg, (N, 6)."""
    axes = axes or AxisMap()
    s = recording.samples
    return np.hstack([axes.gyro_to_instrument(s.gyro), axes.accel_to_instrument(s.accel)]) / UNITS


@dataclass(frozen=True)
class Seen:
    """A run without an effect: what its equation takes."""

    t: np.ndarray
    x: np.ndarray  # perfect readings, dps and g
    temperature: np.ndarray
    angles: np.ndarray  # rad

    @property
    def d(self) -> np.ndarray:
        """Temperature over its reference."""
        return self.temperature - 25.0


CLEAN = recorded(SCENE)
SEEN = Seen(CLEAN.samples.t, readings(CLEAN) * UNITS / INPUTS, CLEAN.temperature_degc, CLEAN.angles)


def error(effect: Effect, scene: Scenario = SCENE) -> np.ndarray:
    """What an effect adds to the readings, dps and mg, (N, 6)."""
    spoiled = readings(recorded(replace(scene, effects=(effect,))))
    return np.asarray(spoiled - readings(recorded(scene)))


def column(channel: str) -> int:
    return CHANNELS.index(channel)


def lag(s: Seen, tau: float) -> np.ndarray:
    """Temperature through a first-order lag, in fine steps of its own."""
    fine = np.repeat(s.temperature, 20)
    p = np.exp(-0.05 / HZ / tau)
    return np.asarray(signal.lfilter([1 - p], [1, -p], fine, zi=[p * fine[0]])[0][19::20])


def play(s: Seen, r: float) -> np.ndarray:
    """A play operator, straight from its definition."""
    out, p = [], 0.0
    for u in s.temperature - s.temperature[0]:
        p = min(max(p, u - r), u + r)
        out.append(p)
    return np.array(out)


def rotated(s: Seen, d: tuple[float, float, float], channel: int) -> np.ndarray:
    """v × d, in the unit of errors."""
    part = slice(0, 3) if channel < 3 else slice(3, 6)
    return np.cross(s.x[:, part], np.array(d))[:, channel % 3] * (1.0 if channel < 3 else 1e3)


def accel_error(force_change_n: np.ndarray, s: Seen) -> np.ndarray:
    """A change of specific force in n, m/s², as the accelerometers show it, mg, (N, 3)."""
    return -np.einsum("nij,i->nj", kinematics.attitudes(s.angles), force_change_n) / G * 1e3


def lever_mg(s: Seen, r: tuple[float, float, float]) -> np.ndarray:
    """ω × (ω × r) + ω' × r by difference quotients of the table's own angles, as an instrument of sign -1 shows it."""
    h = 1e-4
    w0, w1, w2 = (kinematics.body_rate(MOVING.angles(s.t + x), MOVING.rates(s.t + x)) for x in (-h, 0.0, h))
    a = np.cross(w1, np.cross(w1, np.array(r))) + np.cross((w2 - w0) / (2 * h), np.array(r))
    return -a / G * 1e3


Case = tuple[str | tuple[str, ...], dict[str, float | str], Callable[[Seen], np.ndarray] | None, float]

EARTH_N = earth.earth_rate_n(np.array(PAPER_SITE.latitude))
TILT = np.array([0.1 * DEG, -0.05 * DEG, 0.0])
FORCE_N = np.array([0.0, 0.0, -PAPER_SITE.gravity])

# effect: channel, parameters, the error its equation gives on that channel (dps or mg), tolerance
EQUATIONS: dict[str, list[Case]] = {
    "thermal_lin": [
        ("gy", {"dps_per_k": 0.02}, lambda s: 0.02 * s.d, 1e-9),
        ("ax", {"mg_per_k": -0.3, "reference_degc": 30.0}, lambda s: -0.3 * (s.temperature - 30.0), 1e-9),
    ],
    "thermal_poly": [
        ("gx", {"dps_per_k2": 1e-3, "dps_per_k": 0.01}, lambda s: 0.01 * s.d + 1e-3 * s.d**2, 1e-9),
        ("az", {"mg_per_k2": 0.1, "mg_per_k3": 0.01}, lambda s: 0.1 * s.d**2 + 0.01 * s.d**3, 1e-9),
    ],
    "thermal_rate": [
        ("gz", {"dps_s_per_k": 1.0}, lambda s: np.select([s.t < 15, s.t < 30, s.t < 45], [5 / 3, -2.0, 4 / 3]), 1e-9)
    ],
    "thermal_lag": [("gx", {"dps_per_k": 0.02, "tau_s": 5.0}, lambda s: 0.02 * (lag(s, 5.0) - s.temperature), 1e-3)],
    "hysteresis": [
        (
            "ay",
            {"mg": 5.0, "width_k": 8.0},
            lambda s: 5.0 / 8.0 * np.mean([play(s, 8.0 * n / 6) for n in range(1, 7)], axis=0),
            1e-9,
        )
    ],
    "warmup": [("gy", {"dps": 0.2, "tau_s": 9.0}, lambda s: 0.2 * np.exp(-s.t / 9.0), 1e-9)],
    "ramp": [("ax", {"mg_per_s": 0.05}, lambda s: 0.05 * s.t, 1e-9)],
    "scale": [
        ("gz", {"relative": 0.01}, lambda s: 0.01 * s.x[:, 2], 1e-9),
        ("az", {"relative": -0.02}, lambda s: -20.0 * s.x[:, 5], 1e-9),
    ],
    "asymmetry": [("gz", {"relative": 3e-3}, lambda s: 3e-3 * np.abs(s.x[:, 2]), 1e-9)],
    "nonlinearity_cubic": [
        ("gz", {"dps_per_dps3": 1e-6}, lambda s: 1e-6 * s.x[:, 2] ** 3, 1e-9),
        ("az", {"mg_per_g3": 4.0}, lambda s: 4.0 * s.x[:, 5] ** 3, 1e-9),
    ],
    "nonlinearity_quadratic": [("gz", {"dps_per_dps2": 1e-5}, lambda s: 1e-5 * s.x[:, 2] ** 2, 1e-9)],
    "thermal_scale": [("gz", {"relative_per_k": 2e-4}, lambda s: 2e-4 * s.x[:, 2] * s.d, 1e-9)],
    "cross_axis": [
        ("gx", {"y_rad": 0.01, "z_rad": -0.02}, lambda s: 0.01 * s.x[:, 1] - 0.02 * s.x[:, 2], 1e-9),
        ("ay", {"z_rad": 0.01}, lambda s: 10.0 * s.x[:, 5], 1e-9),
    ],
    "g_sensitivity": [
        ("gx", {"z_dps_per_g": 0.05, "x_dps_per_g": 0.02}, lambda s: 0.05 * s.x[:, 5] + 0.02 * s.x[:, 3], 1e-9)
    ],
    "g_squared": [
        ("gx", {"dps_per_g2": 0.02, "axis": "z"}, lambda s: 0.02 * s.x[:, 5] ** 2, 1e-9),
        ("ax", {"mg_per_g2": 3.0}, lambda s: 3.0 * s.x[:, 3] ** 2, 1e-9),
    ],
    "harmonic": [
        ("gx", {"sin_dps": 0.05, "order": 2}, lambda s: 0.05 * np.sin(2 * s.angles[:, 2]), 1e-9),
        ("ay", {"cos_mg": 2.0, "axis": "outer"}, lambda s: 2.0 * np.cos(s.angles[:, 0]), 1e-9),
    ],
    "tone": [
        ("ax", {"mg": 3.0, "hz": 7.0, "phase_rad": 0.5}, lambda s: 3.0 * np.sin(2 * np.pi * 7.0 * s.t + 0.5), 1e-9)
    ],
    "step": [("gy", {"dps": 0.1, "at_s": 12.5}, lambda s: 0.1 * (s.t >= 12.5), 1e-9)],
    # the exact rotation against its first-order equation: a few 1e-6 of 80 deg/s and of 1 g
    "mounting": [
        ((), {"x_rad": 0.001, "z_rad": -0.002}, lambda s: rotated(s, (0.001, 0.0, -0.002), 0), 5e-4),
        ((), {"x_rad": 0.001, "z_rad": -0.002}, lambda s: rotated(s, (0.001, 0.0, -0.002), 4), 2e-2),
    ],
    "earth_rate": [
        ((), {}, lambda s: -(np.einsum("nij,i->nj", kinematics.attitudes(s.angles), EARTH_N) / DEG)[:, 0], 1e-9)
    ],
    "lever_arm": [((), {"x_m": 0.05, "z_m": -0.02}, lambda s: lever_mg(s, (0.05, 0.0, -0.02))[:, 0], 0.05)],
    "tilt": [
        (
            (),
            {"north_deg": 0.1, "east_deg": -0.05},
            lambda s: accel_error(np.cross(TILT, FORCE_N), s)[:, 0],
            5e-3,
        )
    ],
    "gravity": [((), {"relative": 1e-4}, lambda s: accel_error(1e-4 * FORCE_N, s)[:, 0], 1e-9)],
}
# where an effect without channels is looked at: its first, but for the case that says otherwise
LOOKED_AT = {"mounting": ["gx", "ay"], "earth_rate": ["gx"], "lever_arm": ["ax"], "tilt": ["ax"], "gravity": ["ax"]}
ELSEWHERE = {
    *("delay", "telegraph", "random_walk", "gauss_markov", "noise_level", "bandwidth", "noise_crosstalk"),
    *("spikes", "stuck", "saturation", "coarse", "dropout", "jitter"),
}
CASES = [(name, n, case) for name, cases in EQUATIONS.items() for n, case in enumerate(cases)]


def test_every_effect_of_the_catalogue_is_measured_here() -> None:
    assert set(EQUATIONS) | ELSEWHERE == set(EFFECTS)
    assert not set(EQUATIONS) & ELSEWHERE


@pytest.mark.parametrize(("name", "number", "case"), CASES, ids=[f"{name}-{n}" for name, n, _ in CASES])
def test_an_effect_is_its_equation(name: str, number: int, case: Case) -> None:
    channel, parameters, equation, tolerance = case
    e = error(Effect(name, (channel,) if isinstance(channel, str) else channel, parameters))
    at = column(channel if isinstance(channel, str) else LOOKED_AT[name][number])
    assert equation is not None
    expected = equation(SEEN)
    ramps = np.isin(np.arange(e.shape[0]), corners()) if name == "lever_arm" else np.zeros(e.shape[0], bool)
    assert np.abs(expected).max() > 1e-3, "a case that excites nothing tests nothing"
    assert np.allclose(e[~ramps, at], expected[~ramps], rtol=1e-9, atol=tolerance)
    if isinstance(channel, str):
        assert not np.delete(e, at, axis=1).any()


def corners() -> np.ndarray:
    """Instants beside a jump of angular acceleration, where difference quotients differ."""
    rates = [MOVING.rates(CLEAN.samples.t + x) for x in (-2e-4, -1e-4, 0.0, 1e-4, 2e-4)]
    bends = np.abs(np.diff(rates, n=2, axis=0)).max(axis=(0, 2))
    return np.flatnonzero(bends > 1e-5)


def test_a_docstring_names_every_parameter() -> None:
    for name, kind in EFFECTS.items():
        for parameter in kind.parameters:
            own = parameter.name.replace("{x}2", "dps2") if name == "nonlinearity_quadratic" else parameter.name
            known = kind.__doc__.replace("`dps_per_dps2`", "`{e}_per_dps2`").replace("`limit_dps`", "`limit_{x}`")
            assert f"`{own}`" in known, f"{name}: {own}"


# ------------------------------------------------------------------------------- effects that are no error by equation


def test_delay_shifts_the_phase_of_a_swing() -> None:
    e = recorded(replace(SCENE, effects=(Effect("delay", (), {"tau_s": 0.03}),)))
    assert np.allclose(e.samples.gyro[3:], CLEAN.samples.gyro[:-3], atol=1e-9)
    assert np.allclose(e.samples.accel[3:], CLEAN.samples.accel[:-3], atol=1e-9)
    one = error(Effect("delay", ("gy",), {"tau_s": 0.03}))
    assert np.abs(one[:, 1]).max() > 0.5
    assert not np.delete(one, 1, axis=1).any()


def still(*effects: Effect, seconds: float = 400.0, spec: ImuSpec = QUIET, seed: int = 5, hz: float = HZ) -> np.ndarray:
    """Readings of a still unit, dps and mg, less their truth."""
    scene = replace(SCENE, profile=None, effects=effects, spec=spec, seed=seed)
    clean = replace(scene, effects=(), spec=QUIET)
    return np.asarray(readings(recorded(scene, 0, seconds, hz)) - readings(recorded(clean, 0, seconds, hz)))


def test_telegraph_has_two_levels_held_for_exponential_times() -> None:
    e = still(Effect("telegraph", ("gx",), {"dps": 0.05, "mean_s": 2.0}), seconds=4000.0)[:, 0]
    assert set(np.round(e, 9)) == {0.0, 0.05}
    switches = np.count_nonzero(np.diff(e))
    assert switches == pytest.approx(2000, abs=5 * np.sqrt(2000))


def test_random_walk_spreads_with_the_root_of_time() -> None:
    e = still(Effect("random_walk", ("az",), {"mg_per_sqrt_s": 0.2}), seconds=4000.0)[:, 5]
    for seconds in (1, 10):
        steps = np.diff(e[:: seconds * int(HZ)])
        assert steps.std() == pytest.approx(0.2 * np.sqrt(seconds), rel=4 / np.sqrt(2 * steps.size))


def test_gauss_markov_has_its_deviation_and_correlation_time() -> None:
    starts = [
        still(Effect("gauss_markov", ("gx",), {"dps": 0.01, "tau_s": 5.0}), seconds=0.01, seed=s)[0, 0]
        for s in range(100)
    ]
    assert np.std(starts) == pytest.approx(0.01, rel=0.25)
    e = still(Effect("gauss_markov", ("gx",), {"dps": 0.01, "tau_s": 5.0}), seconds=4000.0)[:, 0]
    assert e.std() == pytest.approx(0.01, rel=0.15)
    assert np.corrcoef(e[:-500], e[500:])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.12)


WHITE = replace(QUIET, gyro_arw=4.5 * DEG / 60.0, accel_vrw=1.0 / 60.0)


def test_noise_level_follows_its_driver() -> None:
    plain = still(spec=WHITE)[:, 0]
    loud = still(Effect("noise_level", ("gx",), {"log_variance": np.log(4.0)}), spec=WHITE)
    assert np.allclose(loud[:, 0], 2.0 * plain)
    slow = still(Effect("noise_level", ("ay",), {"log_variance_per_unit": 0.01}), spec=WHITE)[:, 4]
    thirds = [part.std() for part in np.array_split(slow, 3)]
    assert thirds[2] / thirds[0] == pytest.approx(np.exp(0.5 * 0.01 * 400 * 2 / 3), rel=0.1)
    driven = Effect("noise_level", ("gx",), {"driver": "rate_norm", "log_variance_per_unit": 0.05})
    noisy = replace(SCENE, spec=WHITE)
    ratio = (readings(recorded(replace(noisy, effects=(driven,)))) - readings(CLEAN))[:, 0] / (
        readings(recorded(noisy)) - readings(CLEAN)
    )[:, 0]
    assert np.allclose(ratio, np.exp(0.025 * np.linalg.norm(SEEN.x[:, :3], axis=1)))


@pytest.mark.parametrize(
    "driver",
    [
        *("time", "temperature", "temperature_rate", "wx", "wy", "wz", "fx", "fy", "fz", "rate_norm"),
        *("angle_outer", "angle_middle", "angle_inner"),
    ],
)
def test_every_driver_of_the_noise_level_drives(driver: str) -> None:
    effect = Effect("noise_level", ("gx",), {"driver": driver, "log_variance_per_unit": 1e-3})
    noisy = replace(SCENE, spec=WHITE)
    with_it, without = recorded(replace(noisy, effects=(effect,))), recorded(noisy)
    log_variance = 2e3 * np.log(
        (with_it.samples.gyro[:, 0] - CLEAN.samples.gyro[:, 0])
        / (without.samples.gyro[:, 0] - CLEAN.samples.gyro[:, 0])
    )
    truth = {
        "time": SEEN.t,
        "temperature": SEEN.temperature,
        "temperature_rate": HEATED.rate(SEEN.t),
        "rate_norm": np.linalg.norm(SEEN.x[:, :3], axis=1),
        **{f"w{axis}": SEEN.x[:, n] for n, axis in enumerate("xyz")},
        **{f"f{axis}": SEEN.x[:, 3 + n] for n, axis in enumerate("xyz")},
        **{f"angle_{axis}": SEEN.angles[:, n] / DEG for n, axis in enumerate(segments.AXES)},
    }
    assert np.allclose(log_variance, truth[driver], atol=1e-3)


def test_bandwidth_limits_signal_and_noise_and_keeps_the_density() -> None:
    e = still(Effect("bandwidth", ("gx",), {"hz": 5.0}), spec=WHITE)
    f, density = signal.welch(e[:, 0], HZ, nperseg=1024)
    expected = (4.5 / 60.0) ** 2 * 2.0
    assert density[(f > 0.2) & (f < 1.0)].mean() == pytest.approx(expected, rel=0.2)
    assert density[f > 30.0].mean() < 0.1 * expected
    assert e[:, 1].std() == pytest.approx(4.5 / 60.0 * np.sqrt(HZ), rel=0.05)
    swing = error(Effect("bandwidth", ("gy",), {"hz": 5.0}))
    pole = np.exp(-2.0 * np.pi * 5.0 / HZ)
    slow = (SEEN.t > 20.5) & (SEEN.t < 23.5)
    lagged = np.interp(SEEN.t - pole / (1.0 - pole) / HZ, SEEN.t, SEEN.x[:, 1]) - SEEN.x[:, 1]
    assert np.allclose(swing[slow, 1], lagged[slow], atol=0.4)
    assert np.abs(lagged[slow]).max() > 3.0


def test_noise_crosstalk_correlates_two_channels_and_keeps_their_levels() -> None:
    e = still(Effect("noise_crosstalk", ("ax", "ay"), {"correlation": 0.4}), spec=WHITE)
    plain = still(spec=WHITE)
    correlation = np.corrcoef(e.T)
    assert correlation[3, 4] == pytest.approx(0.4, abs=0.02)
    correlation[3, 4] = correlation[4, 3] = 0.0
    assert np.abs(correlation - np.eye(6)).max() < 0.03
    assert np.allclose(e.std(axis=0), plain.std(axis=0), rtol=0.03)


def test_spikes_are_single_readings_of_one_size() -> None:
    e = still(Effect("spikes", ("gz",), {"dps": 20.0, "per_hour": 900.0}))[:, 2]
    assert set(np.round(e, 6)) == {-20.0, 0.0, 20.0}
    assert np.count_nonzero(e) == pytest.approx(100, abs=50)


def test_stuck_repeats_one_reading() -> None:
    effect = Effect("stuck", ("gy",), {"at_s": 10.0, "seconds": 12.0})
    values = still(effect, spec=WHITE, seconds=30.0)[:, 1]
    plain = still(spec=WHITE, seconds=30.0)[:, 1]
    assert np.all(values[1000:2200] == plain[1000])
    assert np.array_equal(np.delete(values, np.s_[1000:2200]), np.delete(plain, np.s_[1000:2200]))


def test_saturation_piles_up_at_its_limit() -> None:
    e = readings(recorded(replace(SCENE, effects=(Effect("saturation", ("gz",), {"limit_dps": 40.0}),))))
    assert np.abs(e[:, 2]).max() == pytest.approx(40.0)
    assert np.array_equal(np.abs(e[:, 2]) > 39.999, np.abs(SEEN.x[:, 2]) >= 40.0)
    assert np.array_equal(e[:, 5], readings(CLEAN)[:, 5])
    f = readings(recorded(replace(SCENE, effects=(Effect("saturation", ("az",), {"limit_g": 0.5}),))))
    assert np.abs(f[:, 5]).max() == pytest.approx(500.0)


def test_coarse_readings_lie_on_a_lattice() -> None:
    effect = Effect("coarse", ("ax",), {"lattice_mg": 3.0})
    values = readings(recorded(replace(SCENE, spec=WHITE, effects=(effect,))))[:, 3] / 3.0
    plain = readings(recorded(replace(SCENE, spec=WHITE)))[:, 3] / 3.0
    assert np.allclose(values, np.round(values))
    assert np.abs(values - plain).max() <= 0.5 + 1e-9


def test_dropouts_leave_gaps_and_true_stamps() -> None:
    effect = Effect("dropout", (), {"probability": 0.1, "at_s": 5.0, "seconds": 2.0})
    r = recorded(replace(SCENE, effects=(effect,)))
    assert np.array_equal(r.samples.gyro, CLEAN.samples.gyro[r.number])
    assert np.array_equal(r.samples.t, r.number / HZ)
    assert not np.any((r.number >= 500) & (r.number < 700))
    assert 1.0 - r.number.size / (CLEAN.number.size - 200) == pytest.approx(0.1, abs=0.03)
    unit = Unit(replace(SCENE, effects=(effect,)), 0, HZ)
    assert [k for k in range(4500) if not unit.lost(k)] == r.number.tolist()


def test_jitter_is_in_the_stamps_and_not_in_the_readings() -> None:
    r = recorded(replace(SCENE, effects=(Effect("jitter", (), {"sd_s": 0.001}),)))
    late = r.samples.t - CLEAN.samples.t
    assert late.std() == pytest.approx(0.001, rel=0.05)
    assert np.array_equal(r.samples.gyro, CLEAN.samples.gyro)
    wild = recorded(replace(SCENE, effects=(Effect("jitter", (), {"sd_s": 1.0}),)))
    assert np.all(np.diff(wild.samples.t) > 0.0)


# ------------------------------------------------------------------------------------------------- the unit as a whole


def test_a_thermal_slope_is_found_by_regression_under_noise() -> None:
    effects = (Effect("thermal_lin", ("gy",), {"dps_per_k": 0.02}), Effect("thermal_lin", ("ax",), {"mg_per_k": 0.6}))
    scene = Scenario(seed=2, temperature=Temperature(((0.0, 10.0), (900.0, 60.0))), effects=effects)
    r = recorded(scene, 0, 900.0, LOOP_HZ)
    slopes = np.polyfit(r.temperature_degc, readings(r), 1)[0]
    assert slopes == pytest.approx([0.0, 0.02, 0.0, 0.6, 0.0, 0.0], abs=0.03)
    assert slopes[1] == pytest.approx(0.02, abs=0.001)


def test_tumbling_a_gyro_that_feels_gravity_shows_by_how_much() -> None:
    poses = [(0, 0), (90, 0), (180, 0), (270, 0), (0, 90), (0, -90)]
    profile = Profile(tuple(Dwell((o * DEG, m * DEG, 0.0), 5.0) for o, m in poses))
    scene = replace(SCENE, profile=profile, effects=(Effect("g_sensitivity", ("gx",), {"y_dps_per_g": 0.05}),))
    r = recorded(scene, 0, profile.duration)
    rests = profile.phase(r.samples.t)
    earth_b = np.einsum("nij,i->nj", kinematics.attitudes(r.angles), EARTH_N) / DEG
    shown = readings(r)
    excess = shown[rests, 0] - earth_b[rests, 0]
    slopes, *_ = np.linalg.lstsq(shown[rests, 3:] / 1e3, excess, rcond=None)
    assert slopes == pytest.approx([0.0, 0.05, 0.0], abs=1e-6)


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (90.0, 0.0, 0.0), (30.0, -60.0, 45.0)])
def test_a_unit_at_rest_reads_gravity_and_earth_rate(pose: tuple[float, float, float]) -> None:
    angles = tuple(np.deg2rad(pose))
    scene = replace(
        SCENE, profile=Profile((Dwell(angles, 1.0),)), accel_bias=(0.1, 0.2, 0.3), gyro_bias=(0.01, 0.0, -0.02)
    )
    unit = Unit(scene)
    gyro, accel = unit.reading(10)
    C_nb = Rotation.from_euler("XYZ", angles).as_matrix()
    assert np.allclose(gyro, C_nb.T @ EARTH_N + unit.truth.gyro_bias, atol=1e-15)
    assert np.allclose(accel, C_nb.T @ FORCE_N + unit.truth.accel_bias, atol=1e-12)
    assert np.allclose(unit.truth.accel_bias, [-0.1, -0.2, -0.3]), "the instrument reads with the other sign"


MANY = (
    *(Effect(name, (case[0],) if isinstance(case[0], str) else case[0], case[1]) for name, _, case in CASES),
    Effect("delay", (), {"tau_s": 0.004}),
    Effect("telegraph", ("gx",), {"dps": 0.05, "mean_s": 2.0}),
    Effect("random_walk", ("ax",), {"mg_per_sqrt_s": 0.1}),
    Effect("gauss_markov", ("gx", "gy", "gz"), {"dps": 0.01, "tau_s": 5.0}),
    Effect("noise_level", ("gz",), {"driver": "wz", "log_variance_per_unit": 0.01}),
    Effect("bandwidth", ("az",), {"hz": 20.0}),
    Effect("noise_crosstalk", ("ax", "ay"), {"correlation": -0.5}),
    Effect("spikes", ("gz",), {"dps": 20.0, "per_hour": 900.0}),
    Effect("stuck", ("gy",), {"at_s": 7.0, "seconds": 2.0}),
    Effect("saturation", ("gz",), {"limit_dps": 60.0}),
    Effect("coarse", ("ax",), {"lattice_mg": 3.0}),
    Effect("dropout", (), {"probability": 0.05}),
    Effect("jitter", (), {"sd_s": 1e-3}),
)


def test_readings_are_the_same_one_by_one_and_as_arrays() -> None:
    scene = Scenario(seed=9, profile=MOVING, temperature=HEATED, effects=MANY)
    unit = Unit(scene)
    r = unit.record(4000)
    assert {e.name for e in MANY} == set(EFFECTS)
    for n in sorted({0, 1, 1022, *range(0, r.number.size, 37), r.number.size - 1}):
        k = int(r.number[n])
        gyro, accel = unit.reading(k)
        assert np.array_equal(gyro, r.samples.gyro[n])
        assert np.array_equal(accel, r.samples.accel[n])
        assert unit.temperature_degc(k) == r.temperature_degc[n]
        assert not unit.lost(k)
        assert k / unit.rate_hz + unit.late(k) == pytest.approx(r.samples.t[n], abs=1e-12)
    shorter = unit.record(1500)
    assert np.array_equal(shorter.samples.gyro, r.samples.gyro[: shorter.number.size])


def test_a_seed_and_a_power_on_decide_everything_random() -> None:
    tone = Effect("tone", ("gx",), {"dps": 1.0, "hz": 5.0})
    scene = replace(SCENE, profile=None, effects=(tone,), power_ons=(PowerOn(), PowerOn(), PowerOn(seed=77)))
    runs = [recorded(scene, k, 2.0).samples.gyro for k in (0, 0, 1, 2)]
    assert np.array_equal(runs[0], runs[1])
    assert not np.allclose(runs[0], runs[2], atol=1e-6)
    assert not np.allclose(runs[0], runs[3], atol=1e-6)
    noisy = [recorded(replace(scene, effects=(), spec=WHITE), k, 2.0).samples.gyro for k in (0, 1, 2)]
    assert np.abs(np.corrcoef([n[:, 0] for n in noisy]) - np.eye(3)).max() < 0.3


def test_biases_differ_from_power_on_to_power_on_as_asked() -> None:
    own = PowerOn(gyro_bias=(0.1, 0.2, 0.3), temperature=Temperature(((0.0, 50.0),)))
    scene = Scenario(seed=3, gyro_bias_run_sd=0.01, accel_bias_run_sd=0.0, power_ons=(PowerOn(),) * 200 + (own,))
    biases = np.array([Unit(scene, k).truth.gyro_bias for k in range(200)])
    assert biases.std(axis=0) == pytest.approx([0.01] * 3, rel=0.2)
    assert biases.mean(axis=0) == pytest.approx(simulation.draw(3).gyro_bias, abs=0.005)
    assert Unit(scene, 7).truth.accel_bias == pytest.approx(simulation.draw(3).accel_bias)
    last = Unit(scene, 200)
    assert last.truth.gyro_bias == pytest.approx([0.1, 0.2, 0.3])
    assert last.temperature_degc(100) == 50.0


@pytest.mark.parametrize(
    "axes", [AxisMap(accel_sign=1), AxisMap(parse_mount("x,-y,-z"), 1), AxisMap(parse_mount("y,z,x"))]
)
def test_one_seed_is_one_physics_however_the_unit_sits_and_reads(axes: AxisMap) -> None:
    """Samples in body axes do not know the sign or the mounting; effects are on the instrument's own channels."""
    plain = Scenario(seed=4, profile=MOVING)
    turned = replace(plain, axes=axes)
    a, b = (recorded(scene, 0, 10.0) for scene in (plain, turned))
    assert np.allclose(a.samples.gyro, b.samples.gyro, atol=1e-13)
    assert np.allclose(a.samples.accel, b.samples.accel, atol=1e-11)
    shown = recorded(replace(turned, effects=(Effect("ramp", ("ay",), {"mg_per_s": 1.0}),)), 0, 10.0)
    e = readings(shown, axes) - readings(b, axes)
    assert np.allclose(e[:, 4], a.samples.t, atol=0.05), "but for the band limit's lag"
    assert not np.delete(e, 4, axis=1).any()


def test_a_lever_arm_is_along_the_instruments_axes() -> None:
    axes = AxisMap(parse_mount("y,z,x"))
    plain = recorded(replace(SCENE, effects=(Effect("lever_arm", (), {"x_m": 0.05}),)))
    turned = recorded(replace(SCENE, axes=axes, effects=(Effect("lever_arm", (), {"y_m": 0.05}),)))
    assert np.allclose(plain.samples.accel, turned.samples.accel, atol=1e-11)


def test_temperature_warms_up_or_follows_its_history() -> None:
    t = np.array([0.0, 10.0, 20.0, 40.0, 60.0])
    assert HEATED.at(t) == pytest.approx([20.0, 20 + 50 / 3, 35.0, 15 + 40 / 3, 35.0])
    assert HEATED.rate(t) == pytest.approx([5 / 3, 5 / 3, -2.0, 4 / 3, 0.0])
    own, h = Temperature(), 1e-3
    assert own.at(np.array([0.0, 1e5])) == pytest.approx([24.0, 30.0])
    assert own.rate(t) == pytest.approx((own.at(t + h) - own.at(t - h)) / (2 * h), rel=1e-6)


def test_simulate_gives_what_a_filter_with_that_specification_believes() -> None:
    spec = ImuSpec(gyro_arw=1e-3, accel_vrw=1e-2)
    truth = Truth(np.array([0.1, -0.2, 0.3]), np.array([0.01, -0.02, 0.03]))
    s, told = simulation.simulate(MOVING, rate_hz=20.0, seconds=30.0, seed=3, spec=spec, truth=truth)
    exact, _ = simulation.simulate(
        MOVING, rate_hz=20.0, seconds=30.0, spec=replace(spec, gyro_arw=0.0, accel_vrw=0.0), truth=truth
    )
    C_nb = kinematics.attitudes(MOVING.angles(s.t))
    w = kinematics.body_rate(MOVING.angles(s.t), MOVING.rates(s.t)) + np.einsum("nij,i->nj", C_nb, EARTH_N)
    assert np.allclose(exact.gyro, w + truth.gyro_bias, atol=1e-12)
    assert np.allclose(exact.accel, np.einsum("nij,i->nj", C_nb, FORCE_N) + truth.accel_bias, atol=1e-12)
    assert s.t.size == 600
    noise = np.hstack([(s.gyro - exact.gyro) / 1e-3, (s.accel - exact.accel) / 1e-2]) / np.sqrt(20.0)
    assert noise.std(axis=0) == pytest.approx([1.0] * 6, abs=0.15)
    assert np.abs(np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]) < 0.15
    assert told.gyro_bias == pytest.approx(truth.gyro_bias)
    drawn = simulation.simulate(rate_hz=20.0, seconds=1.0, seed=3)[1]
    assert np.array_equal(drawn.gyro_bias, simulation.draw(3).gyro_bias)


def test_a_long_run_at_full_rate_has_every_packet() -> None:
    scene = Scenario(
        profile=Profile((Rate("inner", 30 * DEG, 500.0), Sine("middle", 0.2, 0.5, 90.0))), effects=MANY[:4]
    )
    assert recorded(scene, 0, 600.0, LOOP_HZ).number.size == 80000


WRONG = [
    (lambda: Effect("warmth", ("gx",), {}), ["`name`", "warmth", "warmup"]),
    (lambda: Effect("thermal_lin", (), {"dps_per_k": 1}), ["`channel` is missing"]),
    (lambda: Effect("thermal_lin", ("gw",), {"dps_per_k": 1}), ["`channel`", "gw", "gx"]),
    (lambda: Effect("g_sensitivity", ("ax",), {}), ["`channel`", "ax", "gx, gy, gz"]),
    (lambda: Effect("scale", ("gx", "gx"), {"relative": 1}), ["twice"]),
    (lambda: Effect("lever_arm", ("ax",), {"x_m": 1}), ["`channel`", "ax", "leave it out"]),
    (lambda: Effect("thermal_lin", ("gx",), {}), ["`dps_per_k` is missing"]),
    (lambda: Effect("thermal_lin", ("ax",), {"dps_per_k": 1}), ["`dps_per_k` is no parameter", "mg_per_k"]),
    (lambda: Effect("warmup", ("gx",), {"dps": 1, "tau_s": 0}), ["`tau_s` is 0", "more than 0"]),
    (lambda: Effect("warmup", ("gx",), {"dps": "x", "tau_s": 1}), ["`dps`", "'x'"]),
    (lambda: Effect("harmonic", ("gx",), {"sin_dps": 1, "axis": "yaw"}), ["`axis`", "yaw", "inner"]),
    (lambda: Effect("cross_axis", ("gx",), {"x_rad": 1}), ["`x_rad`", "own axis"]),
    (lambda: Effect("noise_crosstalk", ("gx",), {"correlation": 0.1}), ["alone"]),
    (lambda: Effect("noise_crosstalk", ("gx", "gy"), {"correlation": 2}), ["`correlation` is 2", "at most 1"]),
    (lambda: Effect("tone", ("gx",), {"dps": 1, "hz": 1, "phase_rad": float("inf")}), ["`phase_rad`"]),
    (lambda: Unit(SCENE, 1), ["`power_on` is 1"]),
    (lambda: Unit(SCENE, 0, 0.0), ["`rate_hz`"]),
    (lambda: Unit(SCENE).record(-1), ["`count` is -1"]),
    (lambda: [unit.reading(k) for unit in (Unit(SCENE),) for k in (5000, 10)], ["`k` is 10", "are gone"]),
    (lambda: Temperature(((1.0, 2.0), (1.0, 3.0))), ["do not increase"]),
    (lambda: simulation.Fault(1.0, "fire"), ["`kind`", "fire", "garbage"]),
    (lambda: simulation.Fault(1.0, "silence", count=3), ["`seconds` is 0"]),
    (lambda: Scenario(seed=-1), ["`seed` is -1"]),
]


@pytest.mark.parametrize(("make", "words"), WRONG)
def test_misuse_names_the_argument_and_its_value(make: Callable[[], object], words: list[str]) -> None:
    with pytest.raises(ValueError, match=" ") as caught:
        make()
    assert all(word in str(caught.value) for word in words), str(caught.value)

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import special

from filters.effects import noise
from filters.imu import IMU400CD_200
from filters.simulation import LOOP_HZ, Effect, PowerOn, Scenario, Unit

DEG, G = np.pi / 180.0, 9.80665
CHANNELS = noise.CHANNELS
SPEC = np.array([25.0] * 3 + [75.0] * 3)
WHITE = replace(IMU400CD_200, gyro_bandwidth=0.0, accel_bandwidth=0.0)
FLICKER = tuple(
    Effect("gauss_markov", (c,), {("dps" if c[0] == "g" else "mg"): (0.05 if c[0] == "g" else 1.0), "tau_s": tau})
    for c in CHANNELS
    for tau in (2.0, 30.0, 400.0)
)
COUNT = np.array([0.00916 * DEG] * 3 + [0.183e-3 * G] * 3)


def runs(
    seed: int,
    hz: float = LOOP_HZ,
    effects: tuple[Effect, ...] = (),
    count: int = 1,
    spec=IMU400CD_200,
    step: float = 1.0,
) -> list[tuple[float, np.ndarray]]:
    """Residuals of a unit at rest at some power-ons, read in steps of so many counts."""
    ons = tuple(PowerOn(seed=1000 * seed + k) for k in range(count))
    scenario = Scenario(seed=seed, effects=effects, spec=spec, power_ons=ons)
    out = []
    for k in range(count):
        samples = Unit(scenario, k, hz).record(round(200.0 * hz)).samples
        reading = np.hstack([samples.gyro, -samples.accel])
        out.append((hz, np.rint(reading / (step * COUNT)) * step * COUNT - [0, 0, 0, 0, 0, 9.78637]))
    return out


CLEAN = {
    "white, 20 Hz": (20.0, (), WHITE, 1.0, None),
    "white, 100 Hz": (100.0, (), WHITE, 1.0, None),
    "white, 133 Hz": (LOOP_HZ, (), WHITE, 1.0, None),
    "band-limited as specified": (LOOP_HZ, (), IMU400CD_200, 1.0, SPEC),
    "with drift": (LOOP_HZ, FLICKER, IMU400CD_200, 1.0, SPEC),
    "a step as large as the noise": (100.0, (), WHITE, 100.0, None),
    "a step as large as band-limited noise": (LOOP_HZ, (), IMU400CD_200, 60.0, SPEC),
}


@pytest.mark.parametrize("name", CLEAN)
def test_noise_as_expected_is_no_finding(name: str) -> None:
    hz, effects, spec, step, expected = CLEAN[name]
    for seed in range(6):
        series = runs(seed, hz, effects, 1 + seed % 2, spec, step)
        assert noise.bandwidth(series, expected) == []
        assert noise.crosstalk(series) == []


@pytest.mark.parametrize("hz", [5.0, 15.0, 45.0])
def test_another_band_limit_is_found_and_measured(hz: float) -> None:
    for c in range(6):
        (found,) = noise.bandwidth(runs(c, effects=(Effect("bandwidth", (CHANNELS[c],), {"hz": hz}),), count=2), SPEC)
        assert (found.channel, found.spec_hz) == (CHANNELS[c], SPEC[c])
        assert found.hz == pytest.approx(hz, rel=0.2)
        assert abs(found.hz - hz) < 4.0 * found.sd_hz


def test_coloured_noise_is_found_where_nothing_is_specified() -> None:
    found = noise.bandwidth(runs(1, count=2), None)
    assert [f.channel for f in found] == ["gx", "gy", "gz"]
    assert all(f.spec_hz == np.inf and f.ratio == pytest.approx(3.57, rel=0.3) for f in found)
    found = noise.bandwidth(runs(2, spec=WHITE), SPEC)
    assert [(f.channel, f.hz) for f in found] == [("gx", np.inf), ("gy", np.inf), ("gz", np.inf)]


def test_means_to_20_hz_are_as_specified() -> None:
    for seed in range(5):
        ((_, x),) = runs(seed)
        first = np.arange(0, x.shape[0] - 7, 20.0 / 3.0).astype(int)
        mean = (np.add.reduceat(x, first) / np.diff(np.append(first, x.shape[0]))[:, None])[:-1]
        assert noise.bandwidth([(20.0, mean)], SPEC) == []


@pytest.mark.parametrize("rho", [-0.9, 0.1, 0.4])
def test_correlated_noise_is_found_between_its_channels(rho: float) -> None:
    for seed in range(8):
        pair = CHANNELS[seed % 6], CHANNELS[(seed + 2) % 6]
        (found,) = noise.crosstalk(runs(seed, effects=(Effect("noise_crosstalk", pair, {"correlation": rho}),)))
        assert set(found.channels) == set(pair)
        # two band limits leave 0.97 of it
        assert found.correlation == pytest.approx(rho, abs=5.0 * found.sd + 0.04 * abs(rho))
        assert abs(found.z) > 5.5


def test_drift_and_a_line_in_common_are_not_noise_in_common() -> None:
    rng = np.random.default_rng(0)
    x = rng.standard_normal((40000, 6))
    x += 0.02 * np.cumsum(rng.standard_normal(40000))[:, None] + np.sin(1.3 * np.arange(40000))[:, None]
    x[1000:1200, 2] = np.nan
    assert noise.crosstalk([(100.0, x)]) == []


def test_a_dead_channel_has_no_noise_to_speak_of() -> None:
    x = np.random.default_rng(0).standard_normal((10000, 6))
    x[:, 1], x[:, 2] = 0.0, np.nan
    assert noise.bandwidth([(100.0, x)], None) == []
    assert noise.crosstalk([(100.0, x)]) == []
    assert noise.bandwidth([(100.0, x[:20])], None) == noise.crosstalk([(100.0, x[:20])]) == []


def test_variance_ratios_of_white_noise_are_chi_square() -> None:
    rng, scales = np.random.default_rng(0), (4, 16, 64, 256)
    p = np.array([[r[2] for r in noise.variance_ratio(rng.standard_normal(2400), scales)] for _ in range(1500)])
    assert np.all(np.mean(p < 0.5, axis=0) == pytest.approx(0.5, abs=0.04))
    assert np.all(np.mean(p < 0.01, axis=0) < 0.018)
    assert np.all(np.mean(p < 0.001, axis=0) < 0.004)


def test_sums_of_two_are_as_probable_as_a_normal_ratio() -> None:
    """Their ratio has no skewness: with just 0, at one length in twenty, there was a division by it."""
    rng = np.random.default_rng(2)
    for n in range(1000, 1100):
        x = rng.standard_normal(n)
        x[1:] += 0.1 * x[:-1].copy()
        ((_, ratio, p),) = noise.variance_ratio(x, (2,))
        # VR(2) - 1 is the correlation of neighbours
        normal = special.erfc(abs(ratio - 1.0) * np.sqrt(0.5 * n))
        if ratio > 1.0:
            assert p == pytest.approx(normal, rel=0.1)


def test_what_is_not_white_has_a_small_probability() -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal(2400)
    slow = x + 0.05 * np.cumsum(rng.standard_normal(2400))
    slow[100:110] = np.nan
    assert noise.variance_ratio(slow, (64,))[0][2] < 1e-6
    (scale, ratio, p) = noise.variance_ratio(np.diff(x), (16,))[0]
    assert scale == 16
    assert ratio < 0.2
    assert p < 1e-6
    assert noise.variance_ratio(x, (1,)) == [(1, 1.0, 1.0)]
    assert noise.variance_ratio(x[:100], (64,)) == []
    with pytest.raises(ValueError, match="`scales`"):
        noise.variance_ratio(x, (0,))


def test_noise_of_real_sensors(recording: Callable[[str], Path]) -> None:
    data = np.load(recording("adis16405_static_a.npz"))
    x = np.hstack([data["gyro"] * DEG, data["accel"] * G])[:300_000]
    assert {f.channel for f in noise.bandwidth([(100.0, x)], None)} >= {"gx", "gy", "az"}
    pairs = {f.channels: f.correlation for f in noise.crosstalk([(100.0, x)])}
    assert pairs["ax", "ay"] == pytest.approx(0.29, abs=0.04)
    data = np.load(recording("mpu6050_static_host_stamps.npz"))
    series = [(99.3, np.hstack([data["gyro"] * DEG, data["accel"] * G]))]
    assert noise.bandwidth(series, None) == []
    assert noise.crosstalk(series) == []

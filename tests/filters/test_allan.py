import allantools
import numpy as np
import pytest
from numpy.typing import NDArray

from filters import allan, simulation
from filters.imu import IMU400CD_200

DEG = np.pi / 180.0
COUNT = 200.0 * DEG * 1.5 / 2**15
"""rad/s of one count of the IMU400CD-200's gyros."""


def drifting(seed: int, count: int, period: float, white: float, drift: float) -> NDArray[np.float64]:
    """Samples of white noise and random walk of these densities, in three channels."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(size=(count, 3)), axis=0) * drift * np.sqrt(period)
    return rng.normal(size=(count, 3)) * white / np.sqrt(period) + walk


@pytest.mark.parametrize("drift", [0.0, 0.3])
def test_the_deviation_is_that_of_allantools(drift: float) -> None:
    x = drifting(1, 5000, 0.05, 1.0, drift)[:, 0] + 5000.0
    factors = np.array([1, 2, 3, 7, 64, 1000, 2400])
    tau, adev = allan.deviation(x, 0.05, factors)
    theirs_tau, theirs, _, _ = allantools.oadev(x, rate=20.0, data_type="freq", taus=tau)
    assert np.allclose(tau, theirs_tau, rtol=1e-12)
    assert np.allclose(adev, theirs, rtol=1e-10)


def test_channels_together_are_channels_alone() -> None:
    x = drifting(3, 1000, 0.05, 1.0, 0.1)
    tau, together = allan.deviation(x, 0.05)
    assert together.shape == (tau.size, 3)
    assert np.allclose(together[:, 1], allan.deviation(x[:, 1], 0.05)[1], rtol=1e-12)


def test_default_times_are_octaves_up_to_a_quarter() -> None:
    tau, _ = allan.deviation(np.zeros(1000), 0.5)
    assert np.array_equal(tau, 0.5 * 2.0 ** np.arange(8))


@pytest.mark.parametrize(("period", "count"), [(0.05, 2400), (3 / 400, 16000), (1.0, 1200)])
def test_white_noise_is_found_within_its_own_standard_deviation(period: float, count: int) -> None:
    levels = [allan.noise_of(drifting(seed, count, period, 2.0, 0.0), period) for seed in range(60)]
    z = np.array([(level.white - 2.0) / level.white_sd for level in levels])
    # 180 values of unit variance scatter by 5 %; the claim itself is good to 15 %; B and K, not negative, cost 0.3 sd
    assert 0.75 < np.std(z) < 1.25
    assert abs(np.mean(z)) < 0.5
    assert np.max(np.abs(z)) < 5.0
    assert np.median([level.white_sd for level in levels]) < 0.16


@pytest.mark.parametrize("drift", [0.02, 0.1])
def test_random_walk_is_found_beside_white_noise(drift: float) -> None:
    levels = [allan.noise_of(drifting(seed, 72000, 0.05, 1.0, drift), 0.05) for seed in range(20)]
    assert abs(np.mean([level.drift for level in levels]) / drift - 1.0) < 0.2
    assert abs(np.mean([level.white for level in levels]) - 1.0) < 0.01


def test_no_drift_is_found_where_none_is() -> None:
    K = np.array([allan.noise_of(drifting(seed, 12000, 0.05, 1.0, 0.0), 0.05).drift for seed in range(40)])
    assert np.mean(K == 0.0) > 0.4
    # its share of the Allan variance at the longest time, 51 s, against white noise's
    assert np.mean(K**2 * 51.2 / 3 > 1.0 / 51.2) < 0.1


@pytest.mark.parametrize("rate", [400 / 3, 20.0])
def test_a_band_limit_does_not_hide_white_noise(rate: float) -> None:
    """Simulated units, 25 and 75 Hz bandwidth, three minutes: densities of Table 1 within 1 % in the mean."""
    expected = np.repeat([IMU400CD_200.gyro_arw, IMU400CD_200.accel_vrw], 3)
    ratios = []
    for seed in range(8):
        samples = simulation.StillUnit(seed, rate).samples(int(180 * rate))
        level = allan.noise_of(np.hstack([samples.gyro, samples.accel]), 1.0 / rate)
        ratios.append(level.white / expected)
        assert np.max(np.abs(level.white - expected) / level.white_sd) < 5.0
    assert abs(np.mean(ratios) - 1.0) < 0.015


def test_quantisation_to_counts_does_not_hide_white_noise() -> None:
    """Gyro at 133 Hz rounded to counts: N is that of the noise and of the rounding error, 1/12 count² a sample."""
    period = 3 / 400
    for in_counts in (16.0, 0.6):
        white = in_counts * COUNT * np.sqrt(period)
        expected = np.hypot(in_counts, np.sqrt(1 / 12)) * COUNT * np.sqrt(period)
        found = []
        for seed in range(10):
            x = np.round(drifting(seed, 16000, period, white, 0.0) / COUNT + 0.3) * COUNT
            found.append(allan.noise_of(x, period).white / expected)
        assert abs(np.mean(found) - 1.0) < 0.012


def test_quantised_increments_do_not_hide_white_noise() -> None:
    """A unit that rounds angle, not rate, has 3 Q²/τ² more at short times: none of it goes into N."""
    rng = np.random.default_rng(4)
    found = []
    for _ in range(10):
        angle = np.cumsum(rng.normal(size=(12001, 3)) * np.sqrt(0.05), axis=0)
        found.append(allan.noise_of(np.diff(np.round(angle / 0.5) * 0.5, axis=0) / 0.05, 0.05).white)
    assert abs(np.mean(found) - 1.0) < 0.02


def test_noise_does_not_depend_on_unit_or_bias() -> None:
    x = drifting(5, 5000, 0.05, 1.0, 0.1)
    a, b = allan.noise_of(x, 0.05), allan.noise_of(1e-6 * x + 3e-4, 0.05)
    for name in ("white", "white_sd", "instability", "drift"):
        assert np.allclose(getattr(b, name), 1e-6 * getattr(a, name), rtol=1e-5, atol=1e-12)


def test_a_stuck_channel_has_no_noise() -> None:
    x = drifting(6, 2000, 0.05, 1.0, 0.0)
    x[:, 1] = 0.1
    level = allan.noise_of(x, 0.05)
    assert level.white[1] < 1e-12
    assert np.allclose(level.white[[0, 2]], 1.0, atol=0.15)


def test_one_channel_may_come_as_a_vector() -> None:
    x = drifting(7, 2000, 0.05, 1.0, 0.0)
    assert allan.noise_of(x[:, 0], 0.05).white.shape == (1,)
    assert np.isclose(allan.noise_of(x[:, 0], 0.05).white[0], allan.noise_of(x, 0.05).white[0], rtol=1e-9)


def test_bad_arguments_are_errors_in_words() -> None:
    x = np.ones(100)
    with pytest.raises(ValueError, match="2 values that are not finite"):
        allan.deviation(np.array([1.0, np.nan, np.inf, 2.0]), 0.1)
    with pytest.raises(ValueError, match=r"`period` is 0\.0 s"):
        allan.deviation(x, 0.0)
    with pytest.raises(ValueError, match=r"`factors` go from 1 to 51: 100 samples allow 1 to 50"):
        allan.deviation(x, 0.1, np.array([1, 51]))
    with pytest.raises(ValueError, match="`x` has shape"):
        allan.deviation(np.ones((2, 2, 2)), 0.1)
    with pytest.raises(ValueError, match=r"`x` has 60 samples: noise takes 64 \(3\.2 s\)"):
        allan.noise_of(np.ones(60), 0.05)
    with pytest.raises(ValueError, match="`period` is -1"):
        allan.noise_of(x, -1.0)


def test_noise_of_a_stream_is_that_of_all_samples_at_once() -> None:
    x = drifting(5, 30000, 0.05, 1.0, 0.02) + np.array([9.8, 0.0, -1000.0])
    whole = allan.noise_of(x, 0.05)
    for overlap, rtol, sd in ((8192, 1e-9, 1e-9), (512, 1e-2, 2e-3)):
        running = allan.RunningAllan(3, overlap)
        for block in np.split(x, np.sort(np.random.default_rng(overlap).integers(0, 30000, 40))):
            running.add(block)
        found = running.noise(0.05)
        assert np.all(np.abs(found.white - whole.white) < sd * whole.white_sd)
        assert np.allclose([found.drift, found.white_sd], [whole.drift, whole.white_sd], rtol=rtol)


def test_noise_of_a_short_or_stuck_stream_is_told_as_of_all_at_once() -> None:
    running = allan.RunningAllan(1)
    for count in (0, 60):
        running.add(np.ones((count, 1)))
        with pytest.raises(ValueError, match=f"has {count} samples: noise takes 64"):
            running.noise(0.05)
    running.add(np.full((40, 1), 1.0))
    assert running.noise(0.05).white.tolist() == [0.0]

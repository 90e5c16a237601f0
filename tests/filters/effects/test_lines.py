from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from filters.effects import lines
from filters.effects.lines import SpectralLine

DEG, G = np.pi / 180.0, 9.80665
SD = np.array([0.015] * 3 + [0.19] * 3)
HZ = 400.0 / 3.0


def noise(seed: int, fs: float = HZ, seconds: float = 300.0, pole: float = 0.0, walk: float = 0.0) -> np.ndarray:
    """White noise of Table 1's size, or band-limited, with a random walk of a part of it."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((round(fs * seconds), 6))
    x = signal.lfilter([1.0 - pole], [1.0, -pole], white, axis=0)
    return (x + walk * np.cumsum(rng.standard_normal(x.shape), axis=0)) * SD


def tone(x: np.ndarray, fs: float, hz: float, size: float, channels: tuple[int, ...], phase: float = 0.3) -> None:
    """Add a sine of `size` times the noise of a sample."""
    for c in channels:
        x[:, c] += size * SD[c] * np.sin(2.0 * np.pi * hz * np.arange(x.shape[0]) / fs + phase + c)


def test_noise_has_no_line() -> None:
    for seed in range(24):
        fs, pole = (20.0, 100.0, HZ)[seed % 3], (0.0, 0.31)[seed // 3 % 2]
        series = [
            (fs, noise(100 * seed + k, fs, (60.0, 150.0, 300.0)[(seed + k) % 3], pole, 0.01 * (seed % 2)))
            for k in range(1 + seed % 3)
        ]
        assert lines.find(series) == []


def test_a_line_is_found_where_it_is() -> None:
    for seed in range(12):
        series, c, hz = [(HZ, noise(seed + 50 * k)) for k in range(2)], seed % 6, 3.21 + 5.1 * seed
        for k, (fs, x) in enumerate(series):
            tone(x, fs, hz, 0.1, (c,), phase=1.7 * k)
        (found,) = lines.find(series)
        assert found.channels == (lines.CHANNELS[c],)
        assert found.hz == pytest.approx(hz, abs=2e-3)
        assert found.width_hz == 0.0
        assert found.rms[c] == pytest.approx(0.1 * SD[c] / np.sqrt(2.0), rel=0.15)
        assert np.count_nonzero(found.rms) == 1


def test_a_strong_line_is_one_line() -> None:
    x = noise(7)
    tone(x, HZ, 12.345, 100.0, (0, 1))
    tone(x, HZ, 30.0, 0.2, (0,))
    strong, weak = lines.find([(HZ, x)])
    assert strong.channels == ("gx", "gy")
    assert (strong.hz, weak.hz) == (pytest.approx(12.345, abs=1e-3), pytest.approx(30.0, abs=2e-3))
    assert strong.width_hz == 0.0


def test_harmonics_are_one_waveform_on_its_channels() -> None:
    x = noise(3)
    for times in (1, 2, 5):
        tone(x, HZ, 7.77 * times, 0.3 / times, (3, 5))
    tone(x, HZ, 20.1, 0.2, (1,))
    wave, other = sorted(lines.find([(HZ, x)]), key=lambda line: line.hz)
    assert wave.channels == ("ax", "az")
    assert wave.harmonics == (1, 2, 5)
    assert wave.hz == pytest.approx(7.77, abs=1e-3)
    assert wave.rms[3] == pytest.approx(0.3 * SD[3] * np.sqrt((1 + 1 / 4 + 1 / 25) / 2.0), rel=0.1)
    assert (other.channels, other.harmonics) == (("gy",), (1,))


def narrow_band(seed: int, hz: float, width: float) -> np.ndarray:
    """A vibration whose amplitude and phase wander: a band of about `width` around `hz`."""
    rng, t = np.random.default_rng(seed), np.arange(round(HZ * 300.0)) / HZ
    slow = rng.standard_normal((2, t.size))
    pole = np.exp(-np.pi * width / HZ)
    slow = signal.lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], slow, axis=1)
    return np.asarray(slow[0] * np.cos(2 * np.pi * hz * t) + slow[1] * np.sin(2 * np.pi * hz * t))


def test_a_narrow_band_is_one_record_with_a_width() -> None:
    for seed in range(5):
        x, band = noise(seed), 0.5 * SD[2] * narrow_band(seed, 31.4, 0.1)
        x[:, 2] += band
        found = lines.find([(HZ, x)])
        assert len(found) == 1
        assert found[0].channels == ("gz",)
        assert found[0].hz == pytest.approx(31.4, abs=0.1)
        assert 0.02 < found[0].width_hz < 0.6
        left = lines.removed(found, HZ, x)[:, 2] - (x[:, 2] - band)
        assert np.var(left) < 0.4 * np.var(band)


def test_what_is_removed_is_the_line_and_only_that() -> None:
    clean = noise(9)
    x = clean.copy()
    tone(x, HZ, 25.0, 2.0, (4,))
    x[5000:5300, 4] = np.nan
    clean[5000:5300, 4] = np.nan
    line = SpectralLine(("ay",), 25.0005, 0.0, np.ones(6))
    out = lines.removed([line], HZ, x)
    assert np.array_equal(np.isnan(out), np.isnan(x))
    assert np.nanstd(out[:, 4] - clean[:, 4]) < 0.03 * SD[4]
    assert np.array_equal(out[:, :4], x[:, :4])
    assert lines.find([(HZ, out)]) == []


def test_runs_of_different_rates_and_lengths_share_a_line() -> None:
    series = [(HZ, noise(1)), (HZ, noise(2, seconds=70.0)), (100.0, noise(3, 100.0, 200.0)), (HZ, noise(4)[:20])]
    for fs, x in series:
        tone(x, fs, 41.37, 0.12, (0, 3))
    (found,) = lines.find(series)
    assert found.channels == ("gx", "ax")
    assert found.hz == pytest.approx(41.37, abs=5e-3)


def test_slow_tones_and_dead_channels_are_left_alone() -> None:
    x = noise(5)
    tone(x, HZ, 1.2, 1.0, (0,))
    x[:, 1], x[:, 2] = 0.0, np.nan
    assert lines.find([(HZ, x)]) == []
    assert lines.find([]) == []


def test_the_site_of_a_real_sensor_vibrates(recording: Callable[[str], Path]) -> None:
    """A narrow band at 1.69 Hz on three accelerometers, and on an older sensor one near 31.4 Hz on one gyro.

    Beside the first a line that wanders by a tenth, with its second harmonic on a gyro.
    """
    data = np.load(recording("adis16405_static_a.npz"))
    x = np.hstack([data["gyro"] * DEG, data["accel"] * G])[:400_000]
    found = lines.find([(100.0, x)])
    (staying,) = [line for line in found if not line.wanders]
    assert staying.channels == ("ax", "ay", "az")
    assert staying.hz == pytest.approx(1.692, abs=0.01)
    (moving,) = [line for line in found if line.wanders]
    assert moving.channels == ("gz", "ax", "ay", "az")
    assert moving.hz == pytest.approx(10.4, abs=0.2)
    assert moving.harmonics == (1, 2)
    data = np.load(recording("mpu6050_static_host_stamps.npz"))
    fs = (data["t"].size - 1) / (data["t"][-1] - data["t"][0])
    (found,) = lines.find([(fs, np.hstack([data["gyro"] * DEG, data["accel"] * G]))])
    assert found.channels == ("gz",)
    assert found.hz == pytest.approx(31.4, abs=0.1)
    assert found.width_hz > 0.02

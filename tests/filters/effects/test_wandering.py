"""Lines whose frequency wanders: one entry with all its channels, removed along its way, and none in noise."""

import numpy as np
import pytest

from filters.effects import lines
from filters.types import Array

HZ = 400.0 / 3.0
SD = np.array([0.015] * 3 + [0.19] * 3)


def noise(seed: int, fs: float = HZ, seconds: float = 300.0) -> Array:
    """White noise of Table 1's size."""
    return np.random.default_rng(seed).standard_normal((round(fs * seconds), 6)) * SD


def wanderer(count: int, hz: float, share: float, kind: str, fs: float = HZ) -> Array:
    """Phase of a line whose frequency goes through a share of itself, evenly or there and back, shape (N,)."""
    u = np.arange(count) / count
    moved = u - 0.5 if kind == "ramp" else 0.5 * np.sin(2.0 * np.pi * u + 1.0)
    return np.asarray(2.0 * np.pi * np.cumsum(hz * (1.0 + share * moved)) / fs)


def with_line(x: Array, phase: Array, size: float, channels: tuple[int, ...]) -> Array:
    out = x.copy()
    for c in channels:
        out[:, c] += size * SD[c] * np.sin(phase + c)
    return out


@pytest.mark.parametrize("hz", [3.0, 12.0, 40.0])
@pytest.mark.parametrize("kind", ["ramp", "sine"])
def test_a_line_that_wanders_is_one_line(hz: float, kind: str) -> None:
    clean = noise(1)
    x = with_line(clean, wanderer(len(clean), hz, 0.1, kind), 0.3, (0, 2, 4))
    (line,) = lines.find([(HZ, x)])
    assert line.wanders
    assert line.channels == ("gx", "gz", "ay")
    assert line.hz == pytest.approx(hz, rel=0.01)
    assert line.width_hz == pytest.approx(0.1 * hz, rel=0.2)
    assert line.rms[0] == pytest.approx(0.3 * SD[0] / np.sqrt(2.0), rel=0.2)
    left = lines.removed([line], HZ, x) - clean
    assert np.all(np.std(left, axis=0)[[0, 2, 4]] < 0.4 * 0.3 * SD[[0, 2, 4]] / np.sqrt(2.0))
    assert np.array_equal(left[:, [1, 3, 5]], np.zeros((len(x), 3)))


def test_another_run_is_followed_on_its_own_way() -> None:
    shown, other = noise(2), noise(3)
    found = lines.find([(HZ, with_line(shown, wanderer(len(shown), 12.0, 0.1, "ramp"), 0.4, (1,)))])
    x = with_line(other, wanderer(len(other), 12.0, 0.1, "sine"), 0.4, (1,))
    left = lines.removed(found, HZ, x) - other
    assert np.std(left[:, 1]) < 0.4 * 0.4 * SD[1] / np.sqrt(2.0)


def test_a_wanderer_and_a_line_that_stays_are_two() -> None:
    x = with_line(noise(4), wanderer(round(300.0 * HZ), 20.0, 0.1, "sine"), 0.4, (0, 1))
    x = with_line(x, wanderer(len(x), 31.0, 0.0, "ramp"), 1.0, (0,))
    wandering, staying = sorted(lines.find([(HZ, x)]), key=lambda line: not line.wanders)
    assert (wandering.wanders, staying.wanders) == (True, False)
    assert wandering.hz == pytest.approx(20.0, abs=0.3)
    assert staying.hz == pytest.approx(31.0, abs=0.01)
    assert staying.width_hz == 0.0


def test_a_periodic_waveform_that_wanders_is_one() -> None:
    phase = wanderer(round(300.0 * HZ), 9.0, 0.08, "ramp")
    x = with_line(with_line(noise(5), phase, 0.5, (2,)), 2.0 * phase, 0.4, (2,))
    (line,) = lines.find([(HZ, x)])
    assert line.wanders
    assert line.harmonics == (1, 2)
    left = lines.removed([line], HZ, x) - noise(5)
    assert np.std(left[:, 2]) < 0.2 * SD[2]


def test_noise_does_not_wander() -> None:
    for seed in range(12):
        x = noise(100 + seed, (20.0, 100.0, HZ)[seed % 3], (120.0, 300.0)[seed % 2])
        if seed % 4 == 1:
            x[: len(x) // 2] *= 3.0
        if seed % 4 == 2:
            x[len(x) // 3 : len(x) // 2] = np.nan
        fs = (20.0, 100.0, HZ)[seed % 3]
        assert not [line for line in lines.find([(fs, x)]) if line.wanders]

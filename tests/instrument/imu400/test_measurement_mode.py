"""A packet in volts is told from one in scaled units, though they look alike."""

import itertools

import numpy as np
import pytest

from imutui.instrument.imu400.crossbow import Mode, Packet
from imutui.instrument.imu400.driver import is_volts, may_be_volts
from imutui.instrument.imu400.scaling import scaling as imu400cd_scaling

SCALING = imu400cd_scaling()


def packets(mode: Mode, rates: np.ndarray, accels: np.ndarray) -> list[Packet]:
    """What a unit makes of such motion, deg/s and g, shape (N, 3) each; in volts 2.5 stand for zero, 5 for the end."""
    if mode is Mode.SCALED:
        words = np.hstack([SCALING.rate_counts(rates), SCALING.accel_counts(accels)])
    else:
        ends = 1.5 * np.array([200.0] * 3 + [4.0] * 3)
        words = np.clip(np.rint(2048.0 * (1.0 + np.hstack([rates, accels]) / ends)), 0, 4095)
    return [Packet(mode, (a, b, c), (d, e, f), 1587, 0) for a, b, c, d, e, f in words.astype(int).tolist()]


def motion(seed: int, n: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """As wild as the unit's range and its bandwidth of some 10 Hz allow, 133 samples a second."""
    rng = np.random.default_rng(seed)
    t = np.arange(n)[:, None] / 133.3
    hz, phase = rng.uniform(0.1, 5.0, 6), rng.uniform(0.0, 6.3, 6)
    wave = np.sin(2.0 * np.pi * hz * t + phase) * rng.uniform(0.1, 1.0, 6)
    return 200.0 * wave[:, :3], 4.0 * wave[:, 3:]


@pytest.mark.parametrize("seed", range(5))
def test_no_motion_is_taken_for_volts(seed: int) -> None:
    scaled = packets(Mode.SCALED, *motion(seed))
    assert not any(is_volts(b, a) for a, b in itertools.pairwise(scaled))


def test_a_change_to_volts_is_seen_at_once() -> None:
    rng = np.random.default_rng(1)
    down = rng.normal(size=(300, 3))
    still = rng.normal(size=(300, 3)) * 0.5, down / np.linalg.norm(down, axis=1, keepdims=True)
    for (rates, accels), share in ((still, 1.0), (motion(3), 0.95)):
        scaled, volts = packets(Mode.SCALED, rates, accels), packets(Mode.VOLTAGE, rates, accels)
        assert all(map(may_be_volts, volts))
        seen = [is_volts(b, a) for a, b in zip(scaled, volts[1:], strict=False)]
        # rests are each at an attitude of their own: the same one goes on
        seen = seen if share < 1.0 else [is_volts(b, a) for a, b in zip(scaled, volts, strict=True)]
        assert np.mean(seen) >= share

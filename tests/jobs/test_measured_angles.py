"""What a trace makes of angles that a table's controller measured."""

import numpy as np
import pytest

from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Segment, Sine
from imutui.jobs.log_motion import measured_motion

ENCODER = np.deg2rad(0.0005)
SEGMENTS: tuple[Segment, ...] = (
    Dwell((0.0, 0.0, 0.0), 5.0),
    Dwell((0.5, -0.3, 1.0), 5.0),
    Rate("inner", np.deg2rad(50.0), 8.0),
    Sine("middle", np.deg2rad(10.0), 0.5, 8.0),
    Dwell((0.0, 0.0, 0.0), 5.0),
)


@pytest.mark.parametrize("step_s", [0.005, 0.02, 0.04])
def test_noise_of_encoders_does_not_become_noise_of_rates(step_s: float) -> None:
    profile, rng = Profile(SEGMENTS), np.random.default_rng(1)
    at = np.cumsum(rng.uniform(0.8, 1.2, round(profile.duration / step_s)) * step_s)
    angles = profile.angles(at) + ENCODER * rng.standard_normal((at.size, 3))
    rates = profile.rates(at) + np.deg2rad(0.01) * rng.standard_normal((at.size, 3))
    t = np.arange(0.5, profile.duration - 0.5, 1 / 133.0)
    found, turning = measured_motion(at, angles, rates, t)
    assert np.std(found - profile.angles(t)) < np.deg2rad(0.01)
    # the instants at which an acceleration begins or ends are smeared over the width of a fit
    off = np.abs(turning - profile.rates(t))
    assert np.percentile(off, 90) < np.deg2rad(0.05)
    by_differences = np.abs(np.gradient(angles, at, axis=0) - profile.rates(at))
    assert np.percentile(off, 90) < 0.5 * np.percentile(by_differences, 90)
    rests = profile.phase(t) & profile.phase(t - 0.3) & profile.phase(t + 0.3)
    assert np.mean(turning[rests] == 0.0) > 0.95


def test_rates_that_are_not_those_of_the_angles_are_not_believed() -> None:
    profile = Profile(SEGMENTS)
    at = np.arange(0.0, profile.duration, 0.02)
    t = np.arange(0.5, profile.duration - 0.5, 1 / 133.0)
    found, _ = measured_motion(at, profile.angles(at), np.full((at.size, 3), 7.0), t)
    assert np.abs(found - profile.angles(t)).max() < np.deg2rad(0.5)

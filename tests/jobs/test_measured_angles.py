"""What a trace makes of angles that a table's controller measured."""

from pathlib import Path

import numpy as np
import pytest
from helpers import logs
from helpers.documents import dwell, profile_file, rate

from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Segment, Sine
from filters.simulation import TableModel, TurnTable, simulate
from filters.tracing import residual
from imutui.jobs import log_motion, runs
from imutui.jobs.log_motion import measured_motion
from imutui.logbook.reading import Reading
from imutui.logbook.session_info import SessionInfo

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


SCALE = 3e-3
MOTION = profile_file(
    dwell(20.0),
    *(rate(axis, dps, 10.0) for axis in ("inner", "middle", "outer") for dps in (30.0, -30.0)),
    dwell(20.0),
    align="gyro",
)


def fitted(path: Path, reading: Reading) -> tuple[np.ndarray, np.ndarray]:
    """Bias and scale factor of each gyro by least squares on the log's reference, (3, 2), and standard deviations."""
    run = runs.read_run(path, "a", reading).run
    expected = residual.perfect(run)[:, :3]
    found, sds = [], []
    for k in range(3):
        design = np.column_stack([np.ones(len(expected)), expected[:, k]])
        values, (squares,), *_ = np.linalg.lstsq(design, run.reading[:, k] - expected[:, k], rcond=None)
        covariance = np.linalg.inv(design.T @ design) * squares / (len(expected) - 2)
        found.append(values)
        sds.append(np.sqrt(np.diag(covariance)))
    return np.array(found), np.array(sds)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_biases_and_scale_factors_are_those_of_a_profile_that_gyros_join(tmp_path: Path, seed: int) -> None:
    """Measured by a virtual table's encoders, which have an offset, noise, and rates of their own."""
    profile = MOTION.motion()
    samples, truth = simulate(profile, rate_hz=50.0, seconds=profile.duration, seed=seed)
    samples.gyro[:] = truth.gyro_bias + (1.0 + SCALE) * (samples.gyro - truth.gyro_bias)
    model, rng = TableModel(seed=seed), np.random.default_rng(seed)
    offsets = np.array([TurnTable(model).encoder_offset(axis) for axis in ("outer", "middle", "inner")])
    at = np.arange(0.0, profile.duration, 0.01)
    angles = profile.angles(at) + offsets + model.encoder_noise * rng.standard_normal((at.size, 3))
    rates = profile.rates(at) + model.rate_noise * rng.standard_normal((at.size, 3))
    session = SessionInfo(rate_hz=50.0, kind="simulated", reference="profile")
    states = zip(at.tolist(), np.rad2deg(angles), np.rad2deg(rates), strict=True)
    measured = logs.of_samples(tmp_path / "m.mcap", samples, session, MOTION, states=states)
    by_controller, sds = fitted(measured, Reading())
    by_gyros, _ = fitted(measured, Reading(reference=MOTION))
    assert np.all(np.abs(by_controller - by_gyros) < sds)
    assert np.abs(by_controller[:, 1] - SCALE).max() < 4.0 * sds[:, 1].max() + 1e-4


def test_a_stamp_that_is_uncertain_counts_only_where_there_is_no_better_one() -> None:
    """Of a host that was held up: one late answer among certain ones, and a stretch with none but late ones."""
    t = np.array([0.0, 0.01, 0.02, 0.03, 0.04, 0.10, 0.11, 0.12, 0.20])
    uncertainty = np.array([100, 120, 9000, 90, 110, 7000, 5000, 8000, 100]) * 1000
    kept = log_motion._certain(t, uncertainty)
    assert kept.tolist() == [0, 1, 3, 4, 6, 8]


def test_a_link_that_is_always_slow_loses_none() -> None:
    t = np.arange(50) * 0.04
    assert log_motion._certain(t, np.full(50, 20_000_000)).size == 50

"""A simulated unit that is turned by hand between rests: a profile that makes it move, and that nobody tells of."""

from dataclasses import replace

import numpy as np

from filters.channels import CHANNELS
from filters.imu import AxisMap, ImuSpec
from filters.motion.profile import Profile
from filters.motion.segments import Dwell
from filters.simulation import Effect, PowerOn, Scenario
from filters.state import PAPER_SITE
from filters.tracing.run import Run
from filters.types import Array
from helpers.runs import run_of

SPEC = ImuSpec(gyro_arw=8e-5, accel_vrw=6e-4, gyro_bandwidth=0.0, accel_bandwidth=0.0)
"""Noise of a good unit in the hand: 0.27 deg/√h and 0.04 m/s/√h."""
ACCEL_BIAS, GYRO_BIAS = (0.15, -0.2, 0.1), (0.01, -0.006, 0.004)  # instrument axes, m/s² and rad/s

ACCELEROMETERS = (
    Effect("scale", ("ax",), {"relative": 0.006}),
    Effect("scale", ("ay",), {"relative": -0.004}),
    Effect("scale", ("az",), {"relative": 0.009}),
    Effect("cross_axis", ("ax",), {"y_rad": 0.008, "z_rad": -0.005}),
    Effect("cross_axis", ("ay",), {"z_rad": 0.012}),
)
GYROS = (
    Effect("scale", ("gx", "gy", "gz"), {"relative": 0.01}),
    Effect("cross_axis", ("gx",), {"y_rad": 0.01, "z_rad": -0.008}),
    Effect("cross_axis", ("gy",), {"x_rad": -0.006, "z_rad": 0.015}),
    Effect("cross_axis", ("gz",), {"x_rad": 0.02, "y_rad": 0.005}),
    Effect("g_sensitivity", ("gx",), {"x_dps_per_g": 0.05, "y_dps_per_g": -0.08, "z_dps_per_g": 0.1}),
    Effect("g_sensitivity", ("gy",), {"x_dps_per_g": -0.1, "y_dps_per_g": 0.06, "z_dps_per_g": 0.04}),
    Effect("g_sensitivity", ("gz",), {"x_dps_per_g": 0.07, "y_dps_per_g": 0.03, "z_dps_per_g": -0.05}),
)
TRUTH = {
    ("ax", "scale"): (0.006,),
    ("ay", "scale"): (-0.004,),
    ("az", "scale"): (0.009,),
    ("ax", "cross_axis"): (0.008, -0.005),
    ("ay", "cross_axis"): (0.012,),
    **{(channel, "scale"): (0.01,) for channel in ("gx", "gy", "gz")},
    ("gx", "cross_axis"): (0.01, -0.008),
    ("gy", "cross_axis"): (-0.006, 0.015),
    ("gz", "cross_axis"): (0.02, 0.005),
    ("gx", "g_sensitivity"): (0.05, -0.08, 0.1),
    ("gy", "g_sensitivity"): (-0.1, 0.06, 0.04),
    ("gz", "g_sensitivity"): (0.07, 0.03, -0.05),
    **{
        (channel, "bias"): (value,)
        for channel, value in zip(CHANNELS, (*np.rad2deg(GYRO_BIAS), *(np.array(ACCEL_BIAS) / 9.80665e-3)), strict=True)
    },
}
"""What `ACCELEROMETERS`, `GYROS` and the biases are, in the units of reports."""


def turned_run(
    *effects: Effect,
    seed: int = 1,
    rests: int = 24,
    hz: float = 100.0,
    axes: AxisMap | None = None,
    biased: bool = True,
    seconds: float = 4.0,
) -> Run:
    """One power-on, turned through so many random directions; what the table knows of it is not in it."""
    rng = np.random.default_rng([seed, 4])
    poses = np.stack(
        [rng.uniform(-np.pi, np.pi, rests), rng.uniform(-1.2, 1.2, rests), rng.uniform(-np.pi, np.pi, rests)], axis=1
    )
    # turns of one to three seconds
    profile = Profile(tuple(Dwell(tuple(pose), seconds) for pose in poses), slew=2.0, accel=4.0)
    zero = (0.0, 0.0, 0.0)
    own = PowerOn(100 + seed, None, ACCEL_BIAS if biased else zero, GYRO_BIAS if biased else zero)
    scenario = Scenario(
        seed=seed, spec=SPEC, effects=effects, profile=profile, power_ons=(own,), axes=axes or AxisMap(accel_sign=1)
    )
    run = run_of(scenario, 0, hz, profile.duration)
    return replace(run, name=f"run {seed}", angles=np.zeros((1, 3)), rates=np.zeros((1, 3)))


def lacking(run: Run, *channels: str) -> Run:
    """A run whose recording lacks channels."""
    lacks = [CHANNELS.index(channel) for channel in channels]
    reading, flagged = run.reading.copy(), np.zeros(run.reading.shape, bool)
    reading[:, lacks], flagged[:, lacks] = 0.0, True
    return replace(run, reading=reading, flagged=flagged, unread=tuple(lacks))


def shaken(run: Run, first: float, last: float, size: float) -> Run:
    """A run in which the unit was shaken between two times, beyond what its accelerometers read: they clip."""
    at = (run.t >= first) & (run.t < last)
    reading = run.reading.copy()
    shake = size * np.sin(2.0 * np.pi * 3.0 * run.t[at])[:, None] * np.ones(3)
    reading[at, 3:] = np.clip(reading[at, 3:] + shake, -1.5 * PAPER_SITE.gravity, 1.5 * PAPER_SITE.gravity)
    return replace(run, reading=reading)


def values(params: list[dict[str, float]]) -> tuple[Array, Array]:
    """Values and standard deviations of a finding's parameters."""
    return np.array([p["value"] for p in params]), np.array([p["sd"] for p in params])

"""Simulated power-ons as the tracer takes them, for its tests: readings, temperature, and the motion that is known."""

from dataclasses import replace

import numpy as np

from filters.imu import AxisMap, ImuSpec
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sine
from filters.simulation import Effect, PowerOn, Scenario, Temperature, Unit
from filters.tracing.run import Run, rest_attitudes

WHITE = ImuSpec(gyro_bandwidth=0.0, accel_bandwidth=0.0)
QUIET = replace(WHITE, gyro_arw=0.0, accel_vrw=0.0)
HISTORIES = (
    Temperature(((0.0, 20.0), (300.0, 34.0), (900.0, 22.0))),
    Temperature(((0.0, 31.0), (400.0, 24.0), (900.0, 33.0))),
    Temperature(((0.0, 22.0), (450.0, 32.0), (900.0, 27.0))),
)
"""Heating and cooling, at different speeds, in three power-ons of 900 s."""


def run_of(scenario: Scenario, power_on: int = 0, hz: float = 20.0, seconds: float = 900.0, lsb_k: float = 0.05) -> Run:
    """One power-on; temperature as a sensor of so many kelvins a count reads it, exact with 0."""
    axes = scenario.axes
    recording = Unit(scenario, power_on, hz).record(round(hz * seconds))
    samples = recording.samples
    reading = np.hstack([axes.gyro_to_instrument(samples.gyro), axes.accel_to_instrument(samples.accel)])
    temperature = recording.temperature_degc
    if lsb_k > 0.0:
        rng = np.random.default_rng([scenario.seed, power_on])
        temperature = np.rint((temperature + 0.02 * rng.standard_normal(temperature.size)) / lsb_k) * lsb_k
    angles = rest_attitudes(recording.angles)
    rates = recording.rates if len(angles) > 1 else recording.rates[:1]
    return Run(
        f"run {power_on + 1}",
        samples.t - samples.t[0],
        reading,
        temperature,
        angles,
        rates,
        axes,
        scenario.site,
    )


def power_ons(
    *effects: Effect,
    seed: int = 1,
    count: int = 3,
    seconds: float = 900.0,
    hz: float = 20.0,
    histories: tuple[Temperature | None, ...] = HISTORIES,
    profile: Profile | None = None,
    axes: AxisMap | None = None,
) -> list[Run]:
    """Several power-ons of one unit, white noise and what it is given."""
    scenario = Scenario(
        seed=seed,
        spec=WHITE,
        effects=effects,
        profile=profile,
        power_ons=tuple(PowerOn(100 * seed + k, histories[k % len(histories)]) for k in range(count)),
        axes=axes or AxisMap(),
    )
    return [run_of(scenario, k, hz, seconds) for k in range(count)]


def _tumble() -> Profile:
    poses = [
        (0, 0, 0),
        (90, 0, 0),
        (180, 0, 0),
        (-90, 0, 0),
        (0, 90, 0),
        (0, -90, 0),
        (45, 0, 0),
        (-45, 0, 30),
        (0, 45, 60),
    ]
    poses += [(45, 45, 0), (30, -45, 90), (135, 0, 0)]
    segments: list[Dwell | Rate | Sine] = []
    segments += [Dwell((np.deg2rad(a), np.deg2rad(b), np.deg2rad(c)), 12.0) for a, b, c in poses]
    segments += [
        Dwell((0.0, 0.0, 0.0), 10.0),
        Rate("inner", np.deg2rad(20.0), 18.0),
        Rate("inner", np.deg2rad(-20.0), 18.0),
    ]
    for axis in ("inner", "outer", "middle"):
        segments += [Rate(axis, np.deg2rad(rate), 6.0) for rate in (60.0, -60.0)]
        segments += [Dwell((0.0, 0.0, 0.0), 5.0), Sine(axis, np.deg2rad(20.0), 0.3, 10.0)]
    return Profile((*segments, Dwell((0.0, 0.0, 0.0), 10.0)))


TUMBLE = _tumble()  # twelve attitudes, a heading sweep both ways, rates and sines about each axis; 378 s


def parts_of(run: Run, *cuts: tuple[float, float], power_on: str = "a") -> list[Run]:
    """A run at rest without what was between the two times of each cut, s: parts of one power-on."""
    edges = [0.0, *(t for cut in cuts for t in cut), np.inf]
    out = []
    for number, (begin, end) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        rows = (run.t >= begin) & (run.t < end)
        t = run.t[rows]
        out.append(
            replace(
                run,
                name=f"{run.name} part {number + 1}",
                t=t - t[0],
                reading=run.reading[rows],
                temperature=None if run.temperature is None else run.temperature[rows],
                power_on=power_on,
                begins=float(t[0]),
                history_known=number > 0,
            )
        )
    return out

"""What the residual of a unit at rest shows while it is filtered: each kind with its size, and nothing of noise."""

import itertools

import numpy as np
import pytest
from helpers.filtering import filtered

from filters.kalman.residual_watch import Cause, ResidualWatch
from filters.kalman.settings import Settings
from filters.simulation import Effect, Scenario, Temperature, Unit
from filters.types import Array
from imutui.logbook import departures
from imutui.logbook.session_info import SessionInfo

HZ, SD = 20, 0.005  # samples a second, and standard deviation of each


def noise(rng: np.random.Generator, seconds: int, drift: float = 0.0) -> Array:
    """White noise, and a random walk that in 100 s goes so many standard deviations of a mean over 1 s."""
    walk = np.cumsum(rng.normal(size=(seconds * HZ, 6)), axis=0) * drift / HZ / 10.0
    return SD * (rng.normal(size=(seconds * HZ, 6)) + walk)


def watched(residual: Array, temperature: Array | None = None) -> ResidualWatch:
    watch = ResidualWatch(1.0)
    degc = np.full(len(residual), np.nan) if temperature is None else temperature
    for k in range(len(residual) // HZ):
        watch.take(k + 1.0, residual[k * HZ : (k + 1) * HZ], degc[k * HZ : (k + 1) * HZ])
    return watch


def only(told: list[Cause]) -> Cause:
    assert len(told) == 1, told
    return told[0]


def test_noise_and_drift_alone_are_told_as_nothing() -> None:
    """Four units of ten minutes, half of them with a random walk: `benchmarks/watch.py` has more."""
    for seed in range(4):
        assert watched(noise(np.random.default_rng(seed), 600, 3.0 * (seed % 2))).changes == []


@pytest.mark.parametrize("hz", [0.05, 0.13, 0.5, 3.0, 9.0])
def test_an_oscillation_is_told_with_amplitude_and_frequency(hz: float) -> None:
    x = noise(np.random.default_rng(3), 300)
    x[:, 4] += 0.7 * SD * np.sin(2.0 * np.pi * hz * np.arange(len(x)) / HZ)
    watch = watched(x)
    found = only(watch.causes())
    assert {one.effect for one in watch.told()} == {"tone"}
    assert (found.effect, found.channel) == ("tone", 4)
    assert found.hz is not None
    assert abs(found.hz - hz) < 0.02
    assert abs(found.size - 0.7 * SD) < 4.0 * found.sd


def test_a_line_at_133_hz_is_told_beside_thousands_of_bins_and_noise_alone_is_not() -> None:
    rng = np.random.default_rng(9)
    watch = ResidualWatch(1.0)
    for k in range(100):
        x = SD * rng.normal(size=(133, 6))
        x[:, 3] += 0.4 * SD * np.sin(2.0 * np.pi * 40.0 * (k + np.arange(133) / 133.0))
        watch.take(k + 1.0, x, np.full(133, np.nan))
    found = only(watch.told())
    assert (found.effect, found.channel) == ("tone", 3)
    assert found.hz is not None
    assert abs(found.hz - 40.0) < 0.05


def test_a_step_is_told_once_and_one_that_was_left_again_is_withdrawn_as_such() -> None:
    x = noise(np.random.default_rng(4), 700)
    x[300 * HZ :, 1] += 1.5 * SD
    x[250 * HZ : 280 * HZ, 5] -= 1.5 * SD
    watch = watched(x)
    step = only([one for one in watch.told() if one.channel == 1])
    level = [(change, one.effect) for change, one in watch.changes if one.channel == 5]
    assert step.effect == "step"
    assert level[0] == ("cause", "step")
    assert sorted(level[1:]) == [("cause", "telegraph"), ("cause_gone", "step")]
    assert {(one.channel, one.effect) for one in watch.causes()} == {(1, "step"), (5, "telegraph")}
    first = next(one for one in watch.told() if one.channel == 5)
    for found, at, size in ((step, 300.0, 1.5 * SD), (first, 250.0, -1.5 * SD), (watch.causes()[1], 250.0, -1.5 * SD)):
        assert abs(found.since - at) < 4.0
        assert abs(found.size - size) < 4.0 * found.sd


@pytest.mark.parametrize("hz", [0.13, 0.5, 3.0])
def test_an_oscillation_that_ends_is_withdrawn_and_not_told_again(hz: float) -> None:
    x = noise(np.random.default_rng(3), 720)
    x[: 300 * HZ, 4] += 0.7 * SD * np.sin(2.0 * np.pi * hz * np.arange(300 * HZ) / HZ)
    watch = watched(x)
    (_, told), (change, gone) = watch.changes
    assert (change, gone.effect, gone.channel, gone.since) == ("cause_gone", "tone", 4, told.since)
    assert gone.odds < 1.0
    assert told.t < 60.0 < 300.0 < gone.t
    assert watch.causes() == []


def test_an_oscillation_stands_beside_a_larger_step() -> None:
    x = noise(np.random.default_rng(5), 500)
    x[:, 1] += 0.5 * SD * np.sin(2.0 * np.pi * 0.13 * np.arange(len(x)) / HZ)
    x[300 * HZ :, 1] += 3.0 * SD
    watch = watched(x)
    assert [(change, one.effect) for change, one in watch.changes] == [("cause", "tone"), ("cause", "step")]


def test_noise_that_grows_is_told_with_its_ratio() -> None:
    x = noise(np.random.default_rng(6), 300)
    x[200 * HZ :, 2] *= 1.5
    found = only(watched(x).told())
    assert (found.effect, found.channel) == ("noise_level", 2)
    assert abs(found.size - 1.5) < 4.0 * found.sd
    assert abs(found.since - 200.0) < 4.0


@pytest.mark.parametrize("effect", ["thermal_lin", "thermal_rate"])
def test_what_follows_temperature_is_told_with_its_coefficient(effect: str) -> None:
    x = noise(np.random.default_rng(7), 512)
    t = np.arange(len(x)) / HZ
    temperature = 25.0 + 3.0 * np.sin(2.0 * np.pi * t / 700.0) ** 2 + np.where(t > 300.0, (t - 300.0) * 0.02, 0.0)
    rate = np.gradient(temperature, 1.0 / HZ)
    coefficient = SD * (0.5 if effect == "thermal_lin" else 40.0)
    x[:, 0] += coefficient * (temperature if effect == "thermal_lin" else rate)
    found = only(watched(x, temperature).causes())
    assert (found.effect, found.channel) == (effect, 0)
    # a rate is a slope over half a minute
    assert abs(found.size - coefficient) < max(4.0 * found.sd, 0.15 * coefficient)


def test_what_a_gap_separates_is_not_compared() -> None:
    x = noise(np.random.default_rng(8), 200)
    x[100 * HZ :, 1] += 10.0 * SD
    watch = ResidualWatch(1.0)
    for k in range(200):
        watch.take(k + 1.0 + 10.0 * (k >= 100), x[k * HZ : (k + 1) * HZ], np.full(HZ, np.nan))
    assert watch.changes == []


def test_the_filter_tells_it_in_the_instruments_axes_whatever_number_of_samples_comes_at_once() -> None:
    scenario = Scenario(
        seed=2,
        temperature=Temperature(((0.0, 25.0),)),
        effects=(Effect("tone", ("gy",), {"dps": 0.2, "hz": 0.13}),),
    )
    recording = Unit(scenario, 0, float(HZ)).record(70 * HZ)
    samples = recording.samples
    columns = (samples.t - samples.t[0], samples.gyro, samples.accel, recording.temperature_degc)
    session = SessionInfo(rate_hz=float(HZ))
    said = []
    for at_once in (1, 700, 3000):
        estimator, _ = filtered(
            Settings(1.0 / HZ), columns, every=np.inf, sizes=itertools.repeat(at_once, 1 + 70 * HZ // at_once)
        )
        assert estimator.watch is not None
        said.append(departures.causes(estimator, session))
    assert said[0] == said[1] == said[2]
    found = said[0][0]
    assert len(said[0]) == 1, [one["text"] for one in said[0]]
    assert (found["effect"], found["channel"], found["unit"], found["shows"]) == ("tone", "gy", "deg/s", True)
    assert estimator.watch.told()[0].t <= 60.0
    assert abs(found["size"] - 0.2) < 4.0 * found["sd"]
    assert found["text"].startswith("gy oscillates at 0.1")

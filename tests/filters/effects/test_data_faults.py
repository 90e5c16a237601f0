from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from filters.effects import faults, time_stamps
from filters.effects.quantisation import lattice
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sine
from filters.simulation import LOOP_HZ, Effect, Scenario, Unit
from filters.simulation.truth import World
from filters.state import PAPER_SITE
from imutui.instrument.imu400.scaling import scaling as imu400cd_scaling

DEG, G = np.pi / 180.0, 9.80665
CHANNELS = faults.CHANNELS
LSB = np.repeat([imu400cd_scaling().rates_dps(1) * DEG, imu400cd_scaling().accels_g(1) * G], 3)
SECONDS = 150.0
TURNED = Profile(
    (
        Dwell((0.0, 0.0, 0.0), 30.0),
        Rate("inner", 80 * DEG, 16.0),
        Rate("outer", -50 * DEG, 14.0),
        Sine("middle", 20 * DEG, 0.5, 18.0),
        Dwell((30 * DEG, 60 * DEG, 45 * DEG), 20.0),
        Dwell((0.0, 90 * DEG, 0.0), 20.0),
        Dwell((180 * DEG, 0.0, 0.0), 20.0),
    )
)
UNKNOWN = np.full((1, 6), np.nan)


def measured(
    seed: int, effects: tuple[Effect, ...] = (), *, turned: bool = False, counts: bool = True, hz: float = LOOP_HZ
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, readings and perfect readings of a simulated unit."""
    scenario = Scenario(seed=seed, effects=effects, profile=TURNED if turned else None)
    recording = Unit(scenario, 0, hz).record(round(SECONDS * hz))
    samples, axes = recording.samples, scenario.axes
    reading = np.hstack([axes.gyro_to_instrument(samples.gyro), axes.accel_to_instrument(samples.accel)])
    perfect = World(scenario.profile, PAPER_SITE, axes).perfect(recording.number / hz)
    return samples.t, np.rint(reading / LSB) * LSB if counts else reading, perfect


def on(name: str, channel: int, **values: float) -> tuple[Effect, ...]:
    """An effect on one channel; UNIT in a name is, and so the value, in dps or mg."""
    unit = "dps" if channel < 3 else "mg"
    return (Effect(name, (CHANNELS[channel],), {key.replace("UNIT", unit): v for key, v in values.items()}),)


def either(channel: int, dps: float, mg: float) -> float:
    return dps if channel < 3 else mg


FAULTS: dict[str, Callable[[int], tuple[Effect, ...]]] = {
    "few spikes": lambda c: on("spikes", c, UNIT=either(c, 9.0, 300.0), per_hour=200.0),
    "many spikes": lambda c: on("spikes", c, UNIT=either(c, 9.0, 300.0), per_hour=3600.0),
    "stuck for 0.2 s": lambda c: on("stuck", c, at_s=20.0 + c, seconds=0.2),
    "stuck for most of it": lambda c: on("stuck", c, at_s=10.0, seconds=130.0),
    "dead": lambda c: on("stuck", c, at_s=0.0, seconds=1e4),
    "saturation in noise": lambda c: (Effect("saturation", ("az",), {"limit_g": 0.99 + 0.01 * c}),),
    "coarse": lambda c: on("coarse", c, lattice_UNIT=either(c, 0.05, 1.0)),
    "very coarse": lambda c: on("coarse", c, lattice_UNIT=either(c, 4.0, 130.0)),
    "dropout": lambda c: (Effect("dropout", (), {"probability": 0.002}),),
    "long dropout": lambda c: (Effect("dropout", (), {"at_s": 40.0 + c, "seconds": 0.3}),),
    "jitter": lambda c: (Effect("jitter", (), {"sd_s": 3e-4 * (1 + c)}),),
}


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_found_and_nothing_else(name: str, turned: bool) -> None:
    for c in (2, 5) if turned else range(6):
        effects = FAULTS[name](c)
        t, reading, perfect = measured(c, effects, turned=turned)
        _, found = faults.find(t, reading, perfect, LSB)
        if turned and name == "saturation in noise":
            assert [f for f in found if f.effect == "saturation" and f.channels == ("az",)]
            continue
        assert [f.effect for f in found] == [effects[0].name]
        assert found[0].channels == (effects[0].channels or CHANNELS)
        assert found[0].count > 0


def test_motion_beyond_the_range_is_saturation() -> None:
    t, reading, perfect = measured(1, (Effect("saturation", ("gz",), {"limit_dps": 60.0}),), turned=True)
    flagged, (found,) = faults.find(t, reading, perfect, LSB)
    assert (found.effect, found.channels) == ("saturation", ("gz",))
    assert found.size == pytest.approx(60.0 * DEG, rel=1e-3)
    assert 15.0 < flagged[:, 2].sum() / LOOP_HZ < 18.0


@pytest.mark.parametrize("hz", [20.0, 100.0, LOOP_HZ])
def test_clean_readings_have_no_fault(hz: float) -> None:
    for seed in range(8):
        t, reading, perfect = measured(seed, turned=seed % 4 == 1, counts=seed % 3 > 0, hz=hz)
        flagged, found = faults.find(t, reading, perfect, LSB if seed % 2 else None)
        assert found == []
        assert not flagged.any()


@pytest.mark.parametrize("name", ["drift", "slow", "louder", "tone", "scale"])
def test_what_is_no_fault_of_data_is_none(name: str) -> None:
    effects = {
        "drift": [on("gauss_markov", c, UNIT=either(c, 0.05, 1.0), tau_s=s) for c in range(6) for s in (2.0, 40.0)],
        "slow": [on("bandwidth", c, hz=3.0) for c in range(6)],
        "louder": [
            (Effect("noise_level", (n,), {"log_variance_per_unit": 0.02, "driver": "rate_norm"}),) for n in CHANNELS
        ],
        "tone": [on("tone", c, UNIT=either(c, 5.0, 100.0), hz=31.0) for c in range(6)],
        "scale": [on("scale", c, relative=0.02) for c in range(6)],
    }[name]
    for seed in range(2):
        t, reading, perfect = measured(seed, tuple(e for (e,) in effects), turned=True)
        assert faults.find(t, reading, perfect, LSB)[1] == []


def test_flags_are_where_the_faults_are() -> None:
    rng = np.random.default_rng(3)
    t, reading = np.arange(5000) / 100.0, rng.standard_normal((5000, 6))
    at = rng.permutation(np.arange(10, 3900, 10))[:40]
    reading[at, 4] += 20.0 * rng.choice([-1, 1], 40)
    reading[4000:4040, 4] = reading[4000, 4]
    flagged, found = faults.find(t, reading, np.zeros((1, 6)), None)
    assert np.array_equal(np.flatnonzero(flagged[:, 4]), np.sort(np.append(at, np.arange(4000, 4040))))
    assert {f.effect: f.count for f in found} == {"spikes": 40, "stuck": 1}
    assert "and 38 more" in next(f for f in found if f.effect == "spikes").where
    assert not np.delete(flagged, 4, axis=1).any()


def test_a_flipped_bit_is_called_one() -> None:
    for counts, flipped in ((2.0**13, True), (6000.0, False)):
        t, reading, perfect = measured(2)
        reading[2000:20000:3000, 0] += counts * LSB[0]
        _, (found,) = faults.find(t, reading, perfect, LSB)
        assert found.effect == "spikes"
        assert found.count == 6
        assert ("bit flip: 2^13" in found.where) == flipped


def test_a_dead_channel_is_stuck_and_says_so() -> None:
    t, reading, perfect = measured(4)
    reading[:, 3] = 0.0
    flagged, (found,) = faults.find(t, reading, perfect, LSB)
    assert (found.effect, found.channels) == ("stuck", ("ax",))
    assert found.where.startswith("dead: 0 ")
    assert flagged[:, 3].all()


@pytest.mark.parametrize("ratio", [0.4, 0.6, 1.0, 3.0])
def test_noise_of_about_one_step_is_neither_stuck_nor_coarse(ratio: float) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        x = ratio * rng.standard_normal((20000, 6)) + np.linspace(0.0, 2.0, 20000)[:, None] + rng.random(6)
        _, found = faults.find(np.arange(20000) / 100.0, np.rint(x) * 1e-3, UNKNOWN, None)
        assert found == []


def test_a_step_well_above_the_noise_is_coarse() -> None:
    """Five times the noise, of an unknown count; the lattice is what it was made with."""
    rng = np.random.default_rng(1)
    x = 0.2 * rng.standard_normal((20000, 6)) + np.linspace(0.0, 3.0, 20000)[:, None]
    _, found = faults.find(np.arange(20000) / 100.0, np.rint(x) * 2e-3, UNKNOWN, None)
    assert [f.effect for f in found] == ["coarse"] * 6
    assert found[0].size == pytest.approx(2e-3, rel=1e-6)


def test_the_lattice_of_noise_without_one_is_zero() -> None:
    rng = np.random.default_rng(0)
    x = rng.standard_normal(20000)
    assert lattice(x) == 0.0
    assert lattice(np.zeros(100)) == 0.0
    assert lattice(np.rint(30.0 * x) * 0.01 + 9.8) == pytest.approx(0.01, rel=1e-6)
    assert lattice((np.rint(30.0 * x) * 0.01 + 9.8).astype(np.float32).astype(float)) == pytest.approx(0.01, rel=1e-3)


def test_bursts_of_arrival_are_jitter_and_not_loss() -> None:
    sampled = np.arange(20000) * 0.01
    sampled[12000:] += 0.4
    t = np.ceil(sampled / 0.05) * 0.05 + 0.002 * (np.arange(20000) % 5)
    stamps = time_stamps.analyse(t)
    assert stamps.bursts
    assert stamps.period == pytest.approx(0.01, rel=1e-3)
    assert stamps.gaps.tolist() == [11999] or stamps.gaps.tolist() == [12000]
    readings = np.random.default_rng(0).standard_normal((20000, 6))
    _, found = faults.find(t, readings, UNKNOWN, None)
    assert [f.effect for f in found] == ["dropout", "jitter"]
    assert "in bursts" in found[1].where


def test_a_late_stamp_is_no_lost_reading() -> None:
    t = np.arange(1000) * 0.01
    t[500] += 0.007
    assert not time_stamps.analyse(t).gaps.size
    assert time_stamps.analyse(np.delete(t, 300)).gaps.tolist() == [299]


def test_one_late_stamp_in_a_thousand_is_no_jitter_and_one_in_fifty_is() -> None:
    t = np.arange(1000) * 0.01
    t[500] += 0.004
    stamps = time_stamps.analyse(t)
    assert (stamps.jitter < 1e-9, stamps.off.tolist()) == (True, [499, 500])
    # second differences tell errors that all stamps have
    noisy = np.arange(1000) * 0.01 + 1e-4 * np.random.default_rng(0).standard_normal(1000)
    assert time_stamps.analyse(noisy).jitter == pytest.approx(1e-4, rel=0.15)
    noisy[500] += 0.004
    assert time_stamps.analyse(noisy).jitter == pytest.approx(1e-4, rel=0.15)
    t[::50] += 0.004
    assert time_stamps.analyse(t).jitter > 3e-4


EXPECTED = {
    "aceinna_imu381_s1_static": {},
    # isolated jumps of 6 to 10 counts on ay, ten times the noise: real ones
    "adis16405_static_a": {("spikes", "ay"): (10, 60), ("spikes", "ax"): (1, 3)},
    "mpu6050_static_host_stamps": {("jitter", "gx"): (1, 65067)},
    "thermal_chamber_part1": {},
}


@pytest.mark.parametrize("name", EXPECTED)
def test_a_real_sensor_at_rest_has_only_what_can_be_seen_in_it(name: str, recording: Callable[[str], Path]) -> None:
    data = np.load(recording(f"{name}.npz"))
    reading = np.hstack([data["gyro"] * DEG, data["accel"] * G])
    _, found = faults.find(data["t"], reading, UNKNOWN, None)
    assert {(f.effect, f.channels[0]) for f in found} == set(EXPECTED[name])
    for f in found:
        least, most = EXPECTED[name][f.effect, f.channels[0]]
        assert least <= f.count <= most


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="`reading` has shape"):
        faults.find(np.arange(5.0), np.zeros((4, 6)), UNKNOWN, None)
    assert faults.find(np.arange(5.0), np.zeros((5, 6)), UNKNOWN, None)[1] == []

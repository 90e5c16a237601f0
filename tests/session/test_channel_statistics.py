"""Statistics of channels say what noise of known size has, whole or with gaps, however the packets come."""

import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from filters import allan
from filters.allan import RunningAllan
from filters.errors import InputError
from imutui.instrument.imu400.scaling import scaling as imu400cd_scaling
from imutui.session.channel_statistics import LENGTHS, ChannelStatistics, RunningSpectrum

Integers = NDArray[np.int64]
SCALING = imu400cd_scaling()
PERIOD = 0.0075
SEEDS = 24


def white(seed: int, count: int, sd: float = 100.0) -> Integers:
    """White noise of one channel, counts."""
    return np.rint(np.random.default_rng(seed).normal(0.0, sd, (count, 1))).astype(np.int64)


def in_blocks(samples: Integers, seed: int) -> list[Integers]:
    """The same samples in blocks of any length."""
    cuts = np.sort(np.random.default_rng(seed).integers(0, len(samples), 30))
    return np.split(samples, cuts)


def packets(rates: NDArray[Any], accels: NDArray[Any]) -> Integers:
    """Readings of packets whose first gyro and accelerometer read these."""
    counts = np.tile([0, 0, 0, 0, 0, -8192, 3276], (len(rates), 1))
    counts[:, 0], counts[:, 3] = rates, accels
    return counts


def t_of(values: list[NDArray[np.float64]], truth: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Mean over seeds less the truth, over its standard error."""
    found = np.stack(values)
    return np.asarray((found.mean(axis=0) - truth) / (found.std(axis=0, ddof=1) / np.sqrt(len(found))))


def test_allan_by_blocks_is_allan_of_the_whole() -> None:
    """Up to eight samples it is the overlapping estimate itself; beyond, one of nearly as many differences."""
    samples = np.cumsum(white(1, 5000, 20.0), axis=0) + white(2, 5000)
    running = RunningAllan(1)
    for block in in_blocks(samples, 3):
        running.add(block)
    table = running.table()
    tau, truth = allan.deviation(samples.astype(float), 1.0, table.factors)
    assert table.factors.tolist() == allan.octaves(1, 5000 // 3).tolist()
    assert np.allclose(table.deviation[:4], truth[:4], rtol=1e-12)
    assert np.all(np.abs(table.deviation / truth - 1.0)[:, 0] < 0.1 / np.sqrt(2.0 * table.dof))
    assert tau[-1] <= 5000 / 3


def test_white_noise_falls_with_the_root_of_time_and_its_uncertainty_is_true() -> None:
    """Mean over seeds against sd/√m; scatter over seeds against the degrees of freedom."""
    variances, dof = [], None
    for seed in range(SEEDS):
        running = RunningAllan(1)
        running.add(white(seed, 4096))
        table = running.table()
        variances.append(table.deviation[:, 0] ** 2)
        factors, dof = table.factors, table.dof
    truth = (100.0**2 + 1.0 / 12.0) / factors
    assert np.all(np.abs(t_of(variances, truth)) < 4.0)
    scatter = np.stack(variances).std(axis=0, ddof=1) / truth
    assert dof is not None
    assert np.all(np.abs(scatter / np.sqrt(2.0 / dof) - 1.0) < 0.6)


def test_a_random_walk_rises_with_the_root_of_time() -> None:
    """σ² = K² (2m² + 1)/(6m) of a walk of K a step, as samples have it; for long times K² m/3."""
    variances = []
    for seed in range(SEEDS):
        running = RunningAllan(1)
        running.add(np.cumsum(white(seed, 4096), axis=0))
        table = running.table()
        variances.append(table.deviation[:, 0] ** 2)
    m = table.factors.astype(float)
    truth = (100.0**2 + 1.0 / 12.0) * (2.0 * m**2 + 1.0) / (6.0 * m)
    assert np.all(np.abs(t_of(variances, truth)) < 4.0)


def test_a_gap_makes_no_noise() -> None:
    running, spectrum = RunningAllan(1), RunningSpectrum(1)
    for level in (0, 5000, -5000):
        for part in (running, spectrum):
            part.interrupt()
            part.add(np.full((700, 1), level))
    assert np.all(running.table().deviation == 0.0)
    found = spectrum.spectrum()
    assert found is not None
    assert np.all(found.power < 1e-12)


def test_stretches_have_the_deviation_of_the_whole() -> None:
    """Interrupted every 300 samples, white noise has the same level up to the longest time that fits."""
    variances = []
    for seed in range(SEEDS):
        running = RunningAllan(1)
        for part in np.split(white(seed, 6000), 20):
            running.interrupt()
            running.add(part)
        table = running.table()
        variances.append(table.deviation[:, 0] ** 2)
    assert table.factors[-1] == 128
    assert np.all(np.abs(t_of(variances, 100.0**2 / table.factors)) < 4.0)


def test_white_noise_has_a_flat_spectrum_of_its_level() -> None:
    """One-sided density 2 sd² T in every band; scatter over seeds as the number of averages says."""
    powers = []
    for seed in range(SEEDS):
        running = RunningSpectrum(1)
        for block in in_blocks(white(seed, 6000), seed):
            running.add(block)
        found = running.spectrum()
        assert found is not None
        powers.append(found.power[:, 0])
    assert found.resolution == 1.0 / 1024
    t = t_of(powers, 2.0 * 100.0**2)
    assert abs(t.mean()) < 0.5
    assert np.mean(np.abs(t) < 2.0) > 0.85
    relative = np.stack(powers).std(axis=0, ddof=1) / (2.0 * 100.0**2)
    assert abs(np.mean(relative * np.sqrt(found.averages)) - 1.0) < 0.1


def test_a_sine_is_a_line_at_its_frequency() -> None:
    """Its power is in the peak: amplitude²/2 over the window's noise bandwidth of 1.5 bins."""
    t = np.arange(40000)[:, None]
    running = RunningSpectrum(1)
    running.add(np.rint(3000.0 * np.sin(2.0 * np.pi * 0.125 * t)).astype(np.int64) + white(1, 40000))
    found = running.spectrum()
    assert found is not None
    band = int(found.peak[:, 0].argmax())
    assert found.peak_at[band, 0] == 0.125
    assert found.peak[band, 0] == pytest.approx(3000.0**2 / 2.0 / (1.5 * found.resolution), rel=0.02)
    assert np.median(found.peak[:, 0]) < found.peak[band, 0] / 1e3


def test_the_spectrum_becomes_finer_with_time() -> None:
    """From the shortest segments to the longest, as soon as there are eight of them; none before the first."""
    running, lengths = RunningSpectrum(1), []
    for block in np.split(white(1, 81920), 80):
        running.add(block[:10] if not lengths else block)
        found = running.spectrum()
        lengths.append(0 if found is None else round(1.0 / found.resolution))
    assert sorted(set(lengths)) == [0, *LENGTHS]
    assert lengths == sorted(lengths)


def test_units_and_table_1_are_those_of_the_channel() -> None:
    """Noise at Table 1's level reads as Table 1's line, in deg/s and in mg; the histogram has its mean and sd."""
    statistics = ChannelStatistics(SCALING)
    gyro, accel = 0.075 / np.sqrt(PERIOD), 1e3 / 60.0 / 9.80665 / np.sqrt(PERIOD)
    rng = np.random.default_rng(5)
    rates = SCALING.rate_counts(0.3 + gyro * rng.standard_normal(20000))
    accels = SCALING.accel_counts(1e-3 * (-6.0 + accel * rng.standard_normal(20000)))
    counts, first = packets(rates, accels), 0
    for size in (1, 2, 33, 255, 256, 257, 5000, 20000):  # blocks of any size
        part = slice(first, min(first + size, 20000))
        statistics.add(np.arange(part.start, part.stop) * PERIOD, counts[part])
        first = part.stop
    for channel, mean, sd in ((0, 0.3, gyro), (3, -6.0, accel)):
        seen = statistics.snapshot(channel, 200.0)
        assert seen["packets"] == 20000
        assert seen["period_s"] == pytest.approx(PERIOD)
        assert seen["white"] == pytest.approx(sd * np.sqrt(PERIOD), rel=1e-3)
        found, told, spectrum = seen["allan"], seen["histogram"], seen["spectrum"]
        assert found is not None
        assert told is not None
        assert spectrum is not None
        line = seen["white"] / np.sqrt(found["tau"])
        assert np.all(np.abs(np.array(found["deviation"]) / line - 1.0) < 4.0 / np.sqrt(2.0 * np.array(found["dof"])))
        assert np.mean(spectrum["density"]) == pytest.approx(np.sqrt(2.0) * seen["white"], rel=0.02)
        assert spectrum["hz"][-1] < 0.5 / PERIOD
        assert told["mean"] == pytest.approx(mean, abs=4.0 * sd / np.sqrt(20000))
        assert told["sd"] == pytest.approx(sd, rel=0.03)
        assert sum(told["counts"]) + told["below"] + told["above"] == 20000
        assert len(told["counts"]) <= 64
    temperature = statistics.snapshot(6, 200.0)["histogram"]
    assert temperature is not None
    assert temperature["mean"] == pytest.approx(float(SCALING.temperature_degc(3276)))
    assert temperature["counts"] == [20000]


def test_statistics_begin_anew() -> None:
    """A unit that was turned has no noise of ten degrees a second: what was before counts no more."""
    statistics = ChannelStatistics(SCALING)
    before, after = white(1, 500)[:, 0] + 3000, white(2, 500)[:, 0]
    statistics.add(np.arange(500) * PERIOD, packets(before, before))
    statistics.begin(4.0)
    assert statistics.snapshot(0, 4.0)["packets"] == 0
    with pytest.raises(InputError, match="from 0 to 6"):  # a viewer's mistake, and no defect of ours
        statistics.snapshot(7, 4.0)
    statistics.add(5.0 + np.arange(500) * PERIOD, packets(after, after))
    seen = statistics.snapshot(0, 10.0)
    assert (seen["packets"], seen["stretches"], seen["seconds"]) == (500, 1, 6.0)
    assert seen["histogram"] is not None
    assert abs(seen["histogram"]["mean"]) < 0.2


def test_a_packet_and_a_look_are_cheap() -> None:
    statistics = ChannelStatistics(SCALING)
    rates = white(1, 4096)[:, 0]
    told = packets(rates, rates)
    began = time.process_time()
    for k in range(0, len(told), 32):
        statistics.add(np.arange(k, k + 32) * PERIOD, told[k : k + 32])
    assert (time.process_time() - began) / len(told) < 50e-6
    began = time.process_time()
    statistics.snapshot(0, 40.0)
    assert time.process_time() - began < 0.1

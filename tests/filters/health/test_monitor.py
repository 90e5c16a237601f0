"""Faults of channels that readings show, and readings that show none."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.spoiled_channels import KINDS, Made, channel_of, findings, healthy

from filters.channels import CHANNELS
from filters.health.finding import ADVICE, BAD
from filters.health.monitor import Expected, HealthMonitor

RATE = 20.0
GYROS = {"gyros in rad/s", "noise 10 times in all gyros"}


@pytest.fixture(scope="module")
def made() -> Made:
    return healthy("imu400cd", RATE, 4)


@pytest.mark.parametrize("stated", [True, False], ids=["stated", "not stated"])
@pytest.mark.parametrize("name", KINDS)
def test_a_spoiled_channel_is_found_and_named(name: str, stated: bool, made: Made) -> None:
    expected, spoil = KINDS[name]
    c = list(KINDS).index(name) % len(CHANNELS)
    found = findings(spoil(made, c, np.random.default_rng(1)), stated=stated)
    channels = {"gx", "gy", "gz"} if name in GYROS else {channel_of(expected, c)}
    assert channels <= {one.channel for one in found if one.kind == expected}, found
    assert all(one.level == ("bad" if one.kind in BAD else "wait") and one.todo == ADVICE[one.kind] for one in found)


@pytest.mark.parametrize("instrument", ["imu400cd", "imu381"])
@pytest.mark.parametrize("stated", [True, False], ids=["stated", "not stated"])
def test_healthy_readings_have_no_fault(instrument: str, stated: bool) -> None:
    for seed in range(3):
        assert findings(healthy(instrument, RATE, 100 + seed), stated=stated) == ()
    assert findings(healthy(instrument, 400.0 / 3.0, 200, 60.0), stated=stated) == ()


@pytest.mark.parametrize("name", ["frozen for 5 s", "copy after 60 s", "zero each 3 s", "clipped at 1 sd"])
def test_findings_do_not_depend_on_how_readings_arrive(name: str, made: Made) -> None:
    spoiled = KINDS[name][1](made, 1, np.random.default_rng(1))
    whole = findings(spoiled, chunk=spoiled.t.size)
    assert whole
    assert all(findings(spoiled, chunk=chunk) == whole for chunk in (1, 13, 4096))


def test_a_channel_that_is_a_sum_twice_is_one_since_the_first_time(made: Made) -> None:
    x = made.x.copy()
    x[:, 1] = np.where((made.t > 60.0) & (made.t < 70.0), x[:, 1], (x[:, 0] + x[:, 2]) / 2.0)
    for chunk in (13, made.t.size):
        sums = [one for one in findings(replace(made, x=x), chunk=chunk) if "sum of" in one.said]
        assert {one.channel for one in sums} == {"gx", "gy", "gz"}
        assert all(one.since_s == made.t[0] for one in sums)


@pytest.mark.parametrize("name", ["dead", "frozen after 60 s", "copy"])
def test_what_is_bad_shows_within_three_seconds_of_a_stream(name: str) -> None:
    made = healthy("imu400cd", 400.0 / 3.0, 5, 70.0)
    spoiled = KINDS[name][1](made, 1, np.random.default_rng(1))
    begins = 60.0 if name.startswith("frozen") else 0.0
    rows = spoiled.t < begins + 2.0
    monitor = HealthMonitor(Expected(made.spec, made.lsb))
    monitor.add(spoiled.t[rows], spoiled.x[rows, :3], spoiled.x[rows, 3:], spoiled.degc[rows])
    assert {"gy"} <= {one.channel for one in monitor.findings() if one.level == "bad"}


def test_all_channels_that_stop_at_once_are_frozen(made: Made) -> None:
    x = made.x.copy()
    x[made.t > 60.0] = x[np.argmax(made.t > 60.0)]
    found = findings(replace(made, x=x))
    assert {one.channel for one in found if one.kind == "frozen"} == set(CHANNELS)


def test_a_quiet_unit_in_steps_as_large_as_its_noise_is_not_frozen(made: Made) -> None:
    """Where a count holds most of the noise, equal readings in a row are what chance makes."""
    sd = made.x.std(axis=0)
    coarse = replace(made, x=np.rint(made.x / sd) * sd, lsb=sd)
    assert not [one for one in findings(coarse) if one.kind in ("dead", "frozen", "repeated", "clipped")]


def test_channels_that_feel_the_same_motion_are_no_copies(made: Made) -> None:
    swing = np.deg2rad(100.0) * np.sin(2.0 * np.pi * 2.0 * made.t)
    x = made.x + np.outer(swing, [1.0, 0.7, 0.2, 0.0, 0.0, 0.0])
    assert not [one for one in findings(replace(made, x=x), still=False) if one.kind == "copy"]


def test_a_unit_that_is_turned_is_not_called_noisy_or_moving(made: Made) -> None:
    x = made.x.copy()
    x[(made.t > 60.0) & (made.t < 90.0), 2] += np.deg2rad(30.0)
    assert findings(replace(made, x=x)) == ()


def test_a_channel_that_the_recording_lacks_is_not_dead(made: Made) -> None:
    x = made.x.copy()
    x[:, 4] = np.nan
    assert findings(replace(made, x=x), stated=False) == ()


def test_a_trend_is_held_against_the_uncertainty_that_a_filter_states(made: Made) -> None:
    x = made.x.copy()
    x[:, 1] += np.deg2rad(0.15) * made.t / made.t[-1]
    monitor = HealthMonitor(Expected(made.spec, made.lsb))
    monitor.add(made.t, x[:, :3], x[:, 3:], made.degc)

    def moves(sd_dps: float) -> bool:
        sd = np.full(6, np.deg2rad(sd_dps))
        return any(one.kind == "moving" for one in monitor.findings(sd, final=True))

    assert moves(0.01)
    assert not moves(0.1)
    assert not any(one.kind == "moving" for one in monitor.findings(moving=False, final=True))


@pytest.mark.parametrize("degc", [25.0, -40.0, 85.0])
def test_a_steady_temperature_is_no_fault(degc: float, made: Made) -> None:
    assert findings(replace(made, degc=np.full(made.t.size, degc))) == ()


def test_an_unknown_temperature_is_no_fault(made: Made) -> None:
    assert findings(replace(made, degc=np.full(made.t.size, np.nan))) == ()


def test_memory_is_bounded(made: Made) -> None:
    monitor = HealthMonitor(Expected(made.spec, made.lsb))
    for turn in range(20):
        monitor.add(made.t + turn * 180.0, made.x[:, :3], made.x[:, 3:], made.degc)
    held = [zeros for zeros in monitor._zeros if len(zeros._places) > 512]
    assert monitor._x.shape[0] == 4096
    assert not held

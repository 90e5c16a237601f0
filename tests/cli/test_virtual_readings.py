"""What the virtual instrument measures: errors of a file's function, and a recording with something added to it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import serial
from helpers import logs
from helpers.commands import imutui, imutui_json
from helpers.documents import dwell, profile_toml, rate, toml
from helpers.paths import SAMPLE
from helpers.processes import virtual_process
from unit_time import record, virtual, virtual_in_real_time

from filters import attitude
from filters.imu import STANDARD_GRAVITY, AxisMap, Samples
from filters.simulation import LOOP_HZ
from filters.state import PAPER_SITE
from imutui.cli.played_recording import load
from imutui.cli.spoil import Spoiled, seed_of
from imutui.cli.spoil import load as function
from imutui.cli.virtual_readings import Asked, SimulatedReadings, on_the_line
from imutui.cli.virtual_units import imu381_unit, instrument_of
from imutui.instrument.uut.decoder import Decoder
from imutui.instrument.uut.frames import Frame
from imutui.instrument.uut.messages import SCALING, PacketS1, encode, identification, pairs
from imutui.instrument.virtual import Wire
from imutui.instrument.virtual_instrument import Reading
from imutui.logbook import reader

GAMMA_G = PAPER_SITE.gravity / STANDARD_GRAVITY

# an error that says which call it is of, and what it was told
ERRORS = """
def counted(seed):
    calls = []

    def error(t, temp, ang, rate, w, f):
        calls.append(t)
        assert round(t * 400 / 3) == len(calls) - 1
        return 0.01 * (len(calls) % 7), seed % 5, temp, 0.001 * ang[2], 0.001 * w[2], 0.1 * f[2]

    return error


def late_failure(seed):
    return lambda t, temp, ang, rate, w, f: [0.0] * 6 if t < 1.0 else None
"""
SCENARIO = toml(
    profile="table.toml",
    biases={"accel_run_mg": 1.0},
    temperature={"history": [[0.0, 20.0], [60.0, 50.0]]},
    effect=[{"name": "thermal_lin", "channel": "gy", "dps_per_k": 0.5}],
    power_on=[{}, {"accel_mg": [20.0, 0.0, 0.0]}],
)
TABLE = profile_toml(dwell(2.0), rate("inner", 30.0, 8.0))


def spoiled(home: Path, name: str, scenario: str = "") -> tuple[SimulatedReadings, Spoiled]:
    """A unit of a scenario without and with an error."""
    (home / "errors.py").write_text(ERRORS)
    (home / "table.toml").write_text(TABLE)
    path = None
    if scenario:
        path = home / "unit.toml"
        path.write_text(scenario)
    plain = on_the_line(Asked(path, seed=3)).readings
    with_error = on_the_line(Asked(path, seed=3, spoil=function(f"{home}/errors.py:{name}"))).readings
    assert isinstance(plain, SimulatedReadings)
    assert isinstance(with_error, Spoiled)
    return plain, with_error


def added(plain: Reading | None, with_error: Reading | None) -> np.ndarray:
    """What was added, deg/s and g."""
    assert plain is not None
    assert with_error is not None
    return np.array(with_error.rates_dps + with_error.accels_g) - np.array(plain.rates_dps + plain.accels_g)


def test_an_error_is_asked_for_once_a_sample_in_order(home: Path) -> None:
    plain, with_error = spoiled(home, "counted")
    for k in (0, 1, 1, 2, 40, 40, 2000, 2001):
        got = added(plain.reading(k), with_error.reading(k))
        assert got[0] == pytest.approx(0.01 * ((k + 1) % 7), abs=1e-12), k
        assert got[1] == pytest.approx(seed_of(3, 0) % 5, abs=1e-12)


def test_an_error_is_told_temperature_and_motion(home: Path) -> None:
    plain, with_error = spoiled(home, "counted", SCENARIO)
    for seconds, turning in ((1.0, 0.0), (6.0, 30.0)):
        k = round(seconds * LOOP_HZ)
        got = added(plain.reading(k), with_error.reading(k))
        assert got[2] == pytest.approx(20.0 + 0.5 * k / LOOP_HZ, abs=1e-9)
        assert got[4] == pytest.approx(1e-3 * turning, abs=1e-5)
        assert got[5] == pytest.approx(0.1 * GAMMA_G, abs=1e-9)
        # a quarter of a second is lost in ramping up
        assert got[3] == pytest.approx(1e-3 * max(30.0 * (seconds - 2.15), 0.0), abs=1e-3)


def test_seeds_differ_from_power_on_to_power_on() -> None:
    seeds = [seed_of(unit, power_on) for unit in range(3) for power_on in range(3)]
    assert len(set(seeds)) == 9
    assert seeds[0] == seed_of(0, 0)


def test_an_error_that_fails_later_ends_the_unit_in_words(home: Path) -> None:
    plain, with_error = spoiled(home, "late_failure")
    assert with_error.reading(100) == plain.reading(100)
    with virtual_process("--spoil", "errors.py:late_failure") as (port, unit), serial.Serial(port, 38400) as line:
        line.write(b"C")
        _, said = unit.communicate(timeout=20.0)
    assert unit.returncode == 3
    assert "errors.py:late_failure returns None at sample 134 (t = 1.005 s)" in said
    assert "Traceback" not in said


def still(path: Path, seconds: float, hz: float = 100.0, **more: np.ndarray) -> np.ndarray:
    """A recording of a unit at rest that reads +1 g on Z, with noise; returns its readings."""
    n = round(seconds * hz)
    noise = np.random.default_rng(5).standard_normal((n, 6)) * [0.3, 0.3, 0.3, 0.002, 0.002, 0.002]
    values = noise + np.array([0.1, -0.2, 0.3, 0.01, 0.02, GAMMA_G])
    np.savez(path, t=np.arange(n) / hz, gyro=values[:, :3], accel=values[:, 3:], **more)
    return values


def played(source: Path, scenario: Path | None, power_on: int = 0, start: float = 0.0, count: int = 1200) -> np.ndarray:
    """Readings of a recording with a scenario added, or without, shape (N, 7)."""
    readings = on_the_line(Asked(scenario, power_on, recording=source, start=start)).readings
    rows = [readings.reading(k) for k in range(count)]
    return np.array([[*r.rates_dps, *r.accels_g, r.temperature_degc] for r in rows if r is not None])


def test_a_scenario_is_added_to_a_recording(home: Path) -> None:
    still(home / "still.npz", 10.0)
    (home / "table.toml").write_text(TABLE)
    (home / "unit.toml").write_text(SCENARIO)
    plain = played(home / "still.npz", None)
    both = played(home / "still.npz", home / "unit.toml", 1)
    assert both.shape == plain.shape
    t = np.arange(len(plain)) / LOOP_HZ
    difference = both - plain
    assert np.all(plain[:, 6] == 25.0)
    assert both[:, 6] == pytest.approx(20.0 + 0.5 * t)
    assert np.abs(difference[:, 0]).max() < 0.01  # Earth rate, seen from a table that turns
    assert difference[:, 1] == pytest.approx(0.5 * (both[:, 6] - 25.0), abs=0.02)
    turning = (t > 3.0) & (t < 8.0)
    assert difference[turning, 2] == pytest.approx(30.0, abs=1e-6)
    assert difference[:, 3] == pytest.approx(0.02, abs=1e-9)
    assert difference[:, 4:6] == pytest.approx(0.0, abs=1e-9)


def test_a_recording_is_played_from_where_it_is_asked(home: Path) -> None:
    values = still(home / "still.npz", 10.0, hz=LOOP_HZ)
    part = played(home / "still.npz", None, start=6.0, count=600)
    assert len(part) in (532, 533)
    assert np.array_equal(part[:, :6], values[800 : 800 + len(part)])


def test_what_a_recording_knows_of_its_motion_drives_effects(home: Path) -> None:
    t = np.arange(1000) / 100.0
    rate = np.deg2rad(40.0)
    C_bn = [attitude.exp(np.array([rate * x, 0.0, 0.0])) for x in t]
    quaternion = np.array([attitude.to_quaternion(C) for C in C_bn])
    quaternion[300:320] = np.nan  # markers out of sight
    up = np.array([C.T @ [0.0, 0.0, 1.0] for C in C_bn])
    gyro = np.tile([40.0, 0.0, 0.0], (t.size, 1))
    np.savez(home / "turned.npz", t=t, gyro=gyro, accel=up, ref_quat=quaternion)
    scale = '[[effect]]\nname = "scale"\nchannel = ["gx", "ay"]\nrelative = 0.1\n[noise]\naccel_bandwidth_hz = 0.0\n'
    (home / "scale.toml").write_text(scale)
    difference = played(home / "turned.npz", home / "scale.toml") - played(home / "turned.npz", None)
    inside = slice(50, 1150)
    assert difference[inside, 0] == pytest.approx(4.0, abs=0.02)
    at = np.arange(len(difference)) / LOOP_HZ
    assert difference[inside, 4] == pytest.approx(0.1 * np.sin(rate * at)[inside] * GAMMA_G, abs=1e-3)


def test_what_a_log_knows_of_its_motion_drives_effects_alike(home: Path) -> None:
    t = np.arange(1500) / 100.0
    angles = np.stack([30.0 * np.sin(0.5 * t), np.zeros(t.size), 20.0 * t], axis=1)
    rates = np.stack([15.0 * np.cos(0.5 * t), np.zeros(t.size), np.full(t.size, 20.0)], axis=1)
    still(home / "table.npz", 15.0, ang=angles, rate=rates)
    imutui("import", "table.npz", "-o", "table.mcap", "--reference", "trajectory")
    errors = '[[effect]]\nname = "scale"\nchannel = ["gz", "ay"]\nrelative = 0.1\n'
    (home / "scale.toml").write_text(errors)
    array, log = (
        played(home / f"table.{suffix}", home / "scale.toml") - played(home / f"table.{suffix}", None)
        for suffix in ("npz", "mcap")
    )
    inside = slice(50, 1150)
    at = np.arange(len(array)) / LOOP_HZ
    expected = 2.0 + 0.0 * at
    assert array[inside, 2] == pytest.approx(expected[inside], abs=0.01)
    assert log[inside, 2] == pytest.approx(array[inside, 2], abs=0.01)
    tilted = 0.1 * GAMMA_G * np.cos(np.deg2rad(20.0 * at)) * np.sin(np.deg2rad(30.0 * np.sin(0.5 * at)))
    assert array[inside, 4] == pytest.approx(tilted[inside], abs=1e-3)
    assert log[inside, 4] == pytest.approx(array[inside, 4], abs=1e-3)


def test_a_recording_with_something_added_is_simulated_and_says_of_what(home: Path) -> None:
    still(home / "still.npz", 8.0)
    (home / "errors.py").write_text(ERRORS)
    (home / "unit.toml").write_text(SCENARIO.replace('profile = "table.toml"', ""))
    told = "measured noise of still.npz + thermal_lin + counted; temperature simulated"
    cases = {
        "both": (("--scenario", "unit.toml", "--spoil", "errors.py:counted"), "simulated", told),
        "plain": ((), "unknown", ""),
    }
    for name, (options, kind, source) in cases.items():
        with virtual("--from", "still.npz", *options) as unit:
            record(*unit, home / f"{name}.mcap", 4.0)
        info = reader.read(home / f"{name}.mcap").info
        assert (info.kind, info.source) == (kind, source)
        assert " from " not in info.firmware
    document = imutui_json("info", "both.mcap")
    assert (document["kind"], document["source"]) == ("simulated", told)
    assert "SIMULATED: measured noise of still.npz" in imutui("info", "both.mcap").stdout


def test_an_error_arrives_in_the_log_to_a_count(home: Path) -> None:
    (home / "errors.py").write_text(ERRORS)
    logs = []
    for name, options in (("plain", ()), ("spoiled", ("--spoil", "errors.py:counted"))):
        with virtual("--seed", "3", *options) as unit:
            record(*unit, home / f"{name}.mcap", 6.0, "--rate", "133")
        logs.append(reader.read(home / f"{name}.mcap").samples)
    plain, with_error = (np.hstack([np.rad2deg(each.gyro), each.accel / STANDARD_GRAVITY])[:700] for each in logs)
    difference = with_error - plain
    expected = 0.01 * ((np.arange(700) + 1) % 7)
    count = 1.5 * 200.0 / 2**15
    assert difference[:, 0] == pytest.approx(expected, abs=count)
    assert difference[:, 1] == pytest.approx(seed_of(3, 0) % 5, abs=count)


def test_a_log_is_played_by_the_unit_that_it_is_of_and_in_the_sign_of_another(tmp_path: Path) -> None:
    """Specific force stays what it was; a log of a unit that nobody knows is played as it reads, by the usual one."""
    imu381 = recorded_by("IMU381ZA-400", tmp_path / "other.mcap")
    assert [instrument_of(path) for path in (None, SAMPLE, imu381, tmp_path / "none.mcap")] == [
        "imu400cd", "imu400cd", "imu381", "imu400cd",
    ]  # fmt: skip
    for sign in (-1, 1):
        played = load(SAMPLE, 0.0, AxisMap(accel_sign=sign), PAPER_SITE)
        assert played.values[:, 5].mean() == pytest.approx(-sign, abs=0.03)
    assert "IMU381ZA-200" in probed(["--from", str(imu381)])


def recorded_by(model: str, path: Path) -> Path:
    """The sample's readings as another unit, which reads specific force, would have recorded them."""
    log = reader.read(SAMPLE)
    info = replace(log.info, instrument=model, accel_sign=1)
    return logs.of_samples(path, Samples(log.seconds(), log.samples.gyro, log.samples.accel), info)


def probed(arguments: list[str]) -> str:
    """What a probe says of a virtual unit with these arguments."""
    with virtual_in_real_time(*arguments) as (port, _):
        return imutui("devices", port).stdout


def test_an_imu381_has_the_readings_of_the_scenario_in_its_own_sign(home: Path) -> None:
    (home / "warm.toml").write_text("[temperature]\nconstant_degc = 31.0\n")
    setting = imu381_unit(Asked(home / "warm.toml", seed=3), None)
    wire = Wire(setting.unit, setting.line, began=0.0)
    wire.receive(encode(Frame(b"SF", pairs(((1, 1),)))) + encode(Frame(b"GP", b"ID")), 0.0, 115200)
    events = Decoder().feed(wire.arrived(5.0, 115200))
    packets = [event for event in events if isinstance(event, PacketS1)]
    assert len(packets) >= 498
    assert SCALING.accels_g([p.accels for p in packets]).mean(axis=0) == pytest.approx([0.0, 0.0, -1.0], abs=0.03)
    assert SCALING.temperature_degc(packets[0].board_temperature) == pytest.approx(31.0, abs=0.01)
    assert [identification(e.payload)[1] for e in events if isinstance(e, Frame) and e.type == b"ID"] == [
        "IMU381ZA-200 VIRTUAL SIM"
    ]

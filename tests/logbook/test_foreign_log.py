"""Logs of other programs are read as they were meant, or refused with commands that read them."""

import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import imutui, imutui_json
from helpers.paths import SAMPLE
from mcap.writer import Writer

from imutui.logbook import reader, schemas
from imutui.logbook.foreign_log import RefusedLogError
from imutui.logbook.reading import Reading

BIAS_DPS = np.array([0.10, -0.20, 0.30])
START, HZ, COUNT = 1_714_550_000_000_000_000, 100, 2000
FLU = np.array([1.0, -1.0, -1.0])
IMU, WARM = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature"


@dataclass
class Channel:
    """Messages of a channel: samples of a unit at rest, its axes forward, right and down."""

    topic: str = "/imu"
    stamps: np.ndarray = field(default_factory=lambda: START + np.arange(COUNT) * (10**9 // HZ))
    gyro: np.ndarray = field(default_factory=lambda: readings(1, np.deg2rad(BIAS_DPS), np.deg2rad(0.05)))
    accel: np.ndarray = field(default_factory=lambda: readings(2, np.array([0.02, -0.03, -9.79]), 0.01))
    logged: np.ndarray | None = None  # log times; None for the stamps
    unknown: tuple[bool, bool] = (False, False)  # whether covariances of rates and forces begin with -1
    typename: str = IMU


def readings(seed: int, mean: np.ndarray, sd: float) -> np.ndarray:
    return mean + np.random.default_rng(seed).normal(0.0, sd, (COUNT, 3))


def written(path: Path, *channels: Channel, order: np.ndarray | None = None) -> Path:
    """Write channels in the order of their log times, or of one channel in another order."""
    rows = []
    for number, each in enumerate(channels):
        logged = each.stamps if each.logged is None else each.logged
        for k, (stamp, log_ns) in enumerate(zip(each.stamps.tolist(), logged.tolist(), strict=True)):
            if each.typename == WARM:
                data = schemas.encode_temperatures(stamp, 20.0 + k)[0]
            else:
                data = bytearray(schemas.encode_imus(stamp, each.gyro[k], each.accel[k])[0])
                for at, unknown in zip((-2 * 72 - 3 * 8, -72), each.unknown, strict=True):
                    if unknown:
                        data[len(data) + at :][:8] = b""
                        data[len(data) + at : len(data) + at + 8] = np.float64(-1.0).tobytes()
            rows.append((log_ns, number, bytes(data), stamp))
    rows = sorted(rows, key=lambda row: row[0]) if order is None else [rows[k] for k in order]
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="another program")
        made = []
        for each in channels:
            kind = each.typename.replace("sensor_msgs/Imu", IMU)
            schema = writer.register_schema(each.typename, "ros2msg", schemas.definition(kind).encode())
            made.append(writer.register_channel(each.topic, "cdr", schema))
        for log_ns, number, data, stamp in rows:
            writer.add_message(made[number], log_ns, data, stamp)
        writer.finish()
    return path


def found(path: Path, **stated: object) -> tuple[np.ndarray, np.ndarray, reader.Log]:
    """Median rates (deg/s) and specific force (m/s²) in body axes, of the samples that are readings; and the log."""
    log = reader.read(path, reading=Reading(**stated))  # type: ignore[arg-type]
    used = log.samples.rows(log.samples.valid)
    return np.rad2deg(np.median(used.gyro, axis=0)), np.median(used.accel, axis=0), log


def assert_read(path: Path, count: int, *words: str, **stated: object) -> reader.Log:
    """All samples are read as the unit meant them, and what was assumed is said."""
    gyro, accel, log = found(path, **stated)
    assert np.allclose(gyro, BIAS_DPS, atol=0.02)
    assert np.allclose(accel, [0.02, -0.03, -9.79], atol=0.005)
    assert len(log.samples) == count
    assert np.all(np.diff(log.samples.stamp_ns) > 0)
    for each in words:
        assert each in "; ".join(log.assumed)
    return log


def assert_cured(path: Path, *words: str, flags: Callable[[str], bool] = bool, bias: np.ndarray = BIAS_DPS) -> int:
    """A replay is refused in words; each command of the refusal reads the log, as the unit meant it."""
    refused = imutui("replay", path, check=2).stderr
    said = " ".join(refused.split())
    for each in words:
        assert each in said
    commands = [shlex.split(command)[1:] for command in re.findall(r"`(imutui [^`]*)`", said)]
    assert commands
    assert any(flags(" ".join(command)) for command in commands), commands
    for command in commands:
        if command[0] == "import":
            imutui(*command, "--force")
            command = ["replay", command[command.index("-o") + 1]]
        document = imutui_json(*command, check=None)
        assert np.allclose(document["final"]["gyro_bias_dps"], bias, atol=0.03), command
    return len(commands)


# -------------------------------------------------------------------------------------------------------------- topics


def test_channels_of_one_topic_are_one_log(tmp_path: Path) -> None:
    """As merged files have them; a channel without messages hides none."""
    whole = Channel()
    parts = [Channel("/backup", *(column[:0] for column in (whole.stamps, whole.gyro, whole.accel)))]
    parts += [Channel("/imu", whole.stamps[k::2], whole.gyro[k::2], whole.accel[k::2]) for k in (1, 0)]
    path = written(tmp_path / "a.mcap", *parts)
    log = assert_read(path, COUNT, "samples of /imu")
    assert log.first_ns == log.samples.stamp_ns[0] == START


def test_units_that_share_a_topic_are_not_one_log(tmp_path: Path) -> None:
    one = Channel()
    other = Channel(stamps=one.stamps + 3_000_000, gyro=one.gyro + 0.02, accel=one.accel + 0.3)
    path = written(tmp_path / "a.mcap", one, other)
    with pytest.raises(RefusedLogError, match="holds samples of several units") as refused:
        found(path)
    assert [name for name, _ in refused.value.cures] == ["import"]


def test_of_several_topics_one_is_chosen(tmp_path: Path) -> None:
    left = Channel("/left")
    right = Channel("/right", left.stamps + 3000, left.gyro + np.deg2rad(1.0), left.accel + 0.1)
    path = written(tmp_path / "a.mcap", left, right)
    for command in ("replay", "info", "check"):
        assert "/left (2,000), /right (2,000)" in " ".join(imutui(command, path, check=2).stderr.split())
    with pytest.raises(RefusedLogError) as refused:
        reader.read(path)
    assert [flags for _, flags in refused.value.cures] == [("--topic", "/left"), ("--topic", "/right")]
    assert_read(path, COUNT, "samples of /left", topics=("/left",))
    assert np.allclose(found(path, topics=("/right",))[0], BIAS_DPS + 1.0, atol=0.02)
    assert "topics of samples: /left, /right" in " ".join(
        imutui("replay", path, "--topic", "/x", check=2).stderr.split()
    )


def test_rates_and_forces_of_two_topics_are_joined(tmp_path: Path) -> None:
    """As a camera has them: the other half of each message is zero, and forces come half as often."""
    whole = Channel()
    gyro = Channel("/gyro", accel=np.zeros((COUNT, 3)))
    accel = Channel("/accel", whole.stamps[::2] + 1000, np.zeros((COUNT // 2, 3)), whole.accel[::2])
    path = written(tmp_path / "a.mcap", gyro, accel)
    assert assert_cured(path, flags=lambda text: "--topic /gyro,/accel" in text) == 1
    log = assert_read(path, COUNT - 2, "with the forces of /accel", topics=("/gyro", "/accel"))
    assert log.samples.valid.all()
    assert "rates without forces are left out, of the first 0.000 s and the last 0.010 s" in "; ".join(log.assumed)
    silent = np.r_[0:300, 500:1000]  # of the forces, from 6 to 10 s
    accel = Channel("/accel", accel.stamps[silent], accel.gyro[silent], accel.accel[silent])
    _, _, log = found(written(tmp_path / "b.mcap", gyro, accel), topics=("/gyro", "/accel"))
    assert "rates in gaps of the forces hold no reading: 1 gap(s)" in log.assumed
    assert np.count_nonzero(~log.samples.valid) == 402
    with pytest.raises(RefusedLogError, match="topic /accel has no rates"):
        found(path, topics=("/accel", "/gyro"))


# -------------------------------------------------------------------------------------------------------------- stamps


@pytest.mark.parametrize("displaced", ["pairs", "one"])
def test_messages_out_of_order_are_sorted(tmp_path: Path, displaced: str) -> None:
    order = np.arange(COUNT)
    if displaced == "pairs":
        order = order.reshape(-1, 4)[:, [1, 0, 3, 2]].ravel()
    else:
        order[[1000, 1001]] = order[[1001, 1000]]
    assert_read(written(tmp_path / "a.mcap", Channel(), order=order), COUNT, "into the order of their log times")


def test_repeated_stamps_are_dropped_and_counted(tmp_path: Path) -> None:
    stamps = Channel().stamps.copy()
    stamps[100::400] = stamps[99::400]
    path = written(tmp_path / "a.mcap", Channel(stamps=stamps, logged=Channel().stamps))
    assert_read(path, COUNT - 5, "5 samples with the stamp of the one before are dropped")


def test_stamps_that_stand_still_are_replaced_by_log_times(tmp_path: Path) -> None:
    still = np.full(COUNT, 1_751_654_798 * 10**9)
    path = written(tmp_path / "a.mcap", Channel(stamps=still, logged=Channel().stamps))
    assert assert_cured(path, "stamps stand still", flags=lambda text: "--stamps log" in text) == 2
    assert_read(path, COUNT, "stamps are the log times", stamps="log")


def test_stamps_since_the_start_of_a_computer_are_read(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", Channel(stamps=Channel().stamps - START + 12 * 10**9, logged=Channel().stamps))
    assert_read(path, COUNT, "stamps count from another instant than UTC's")


def test_a_clock_that_was_set_back_leaves_a_part_before_and_after(tmp_path: Path) -> None:
    stamps = Channel().stamps.copy()
    stamps[1000:] -= 700_000_000
    path = written(tmp_path / "a.mcap", Channel(stamps=stamps, logged=Channel().stamps))
    assert assert_cured(path, "go back once, first by 0.69 s at 9.990 s", flags=lambda text: "--end" in text) == 4
    both = written(tmp_path / "b.mcap", Channel(stamps=stamps, logged=stamps), order=np.arange(COUNT))
    assert assert_cured(both, "go back once", flags=lambda text: "--start" in text) == 3


def test_arrivals_in_bursts_are_said_and_fitted(tmp_path: Path) -> None:
    stamps = Channel().stamps + 5 * (10**9 // HZ)
    arrivals = stamps[np.arange(COUNT) // 5 * 5 + 4] + np.arange(COUNT) % 5 * 20_000
    path = written(tmp_path / "a.mcap", Channel(stamps=arrivals))
    assert_read(path, COUNT, "look like arrivals in bursts")
    log = assert_read(path, COUNT, "fitted under the log times", stamps="arrival")
    steps = np.diff(log.samples.stamp_ns) / 1e9
    assert np.std(steps) < 0.1 * np.std(np.diff(arrivals) / 1e9)


# ------------------------------------------------------------------------------------------------------------- readings


def test_nan_and_zeros_at_the_start_are_no_readings(tmp_path: Path) -> None:
    gyro, accel = Channel().gyro.copy(), Channel().accel.copy()
    gyro[:10], accel[:10] = np.nan, np.nan
    gyro[10:110], accel[10:110] = 0.0, 0.0
    path = written(tmp_path / "a.mcap", Channel(gyro=gyro, accel=accel))
    log = assert_read(path, COUNT, "10 samples with NaN hold no reading", "100 samples of six zeros hold no reading")
    assert np.flatnonzero(~log.samples.valid).tolist() == list(range(110))
    assert np.allclose(imutui_json("replay", path, check=None)["final"]["gyro_bias_dps"], BIAS_DPS, atol=0.03)


def test_an_unknown_covariance_is_none_of_the_reading(tmp_path: Path) -> None:
    """Drivers write -1 into every message, beside good readings."""
    path = written(tmp_path / "a.mcap", Channel(unknown=(False, True)))
    log = assert_read(path, COUNT, "a covariance of -1 in every message stands for an unknown covariance")
    assert log.samples.valid.all()


def test_the_temperature_topic_beside_the_samples_is_taken(tmp_path: Path) -> None:
    warm = Channel("/imu_temperature", Channel().stamps[::100], typename=WARM)
    log = assert_read(written(tmp_path / "a.mcap", Channel(), warm), COUNT, "temperatures of /imu_temperature")
    assert log.samples.degc.tolist() == np.repeat(20.0 + np.arange(20), 100).tolist()
    others = [Channel(f"/{name}/temperature", Channel().stamps[:1], typename=WARM) for name in ("cpu", "disk")]
    path = written(tmp_path / "b.mcap", Channel(), *others)
    log = assert_read(path, COUNT, "none of the temperature topics (/cpu/temperature, /disk/temperature)")
    assert np.isnan(log.samples.degc).all()


def test_a_type_by_its_older_name_is_read(tmp_path: Path) -> None:
    assert_read(written(tmp_path / "a.mcap", Channel(typename="sensor_msgs/Imu")), COUNT)


@pytest.mark.parametrize("lost", ["single", "random"])
def test_samples_that_are_missing_here_and_there_are_counted(tmp_path: Path, lost: str) -> None:
    kept = np.arange(COUNT) % 10 != 5 if lost == "single" else np.random.default_rng(4).uniform(size=COUNT) > 0.1
    kept[[0, -1]] = True
    keep, whole = np.flatnonzero(kept), Channel()
    path = written(tmp_path / "a.mcap", Channel("/imu", whole.stamps[keep], whole.gyro[keep], whole.accel[keep]))
    assert_read(path, keep.size)
    what = [finding["what"] for finding in imutui_json("check", path, check=1)["findings"]]
    assert any(f"By the times {COUNT - keep.size} samples are missing" in each for each in what), what


# ------------------------------------------------------------------------------------------------------ axes and units


def test_axes_forward_left_up_are_recognised(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", Channel(gyro=Channel().gyro * FLU, accel=Channel().accel * FLU))
    refused = imutui("replay", path, check=2).stderr
    assert "its z is up" in " ".join(refused.split())
    document = imutui_json("replay", path, "--mount", "x,-y,-z", check=None)
    assert np.allclose(document["final"]["gyro_bias_dps"], BIAS_DPS * FLU, atol=0.03)  # in the unit's own axes
    assert_read(path, COUNT, overrides={"mount": "x,-y,-z"})
    for command in ("info", "check"):
        imutui(command, path, "--mount", "x,-y,-z", check=None)


@pytest.mark.parametrize("axes", ["down", "up"])
@pytest.mark.parametrize("unit", ["g", "mg", "deg/s"])
def test_units_that_are_not_si_are_recognised(tmp_path: Path, axes: str, unit: str) -> None:
    turn = FLU if axes == "up" else np.ones(3)
    gyro, accel = Channel().gyro * turn, Channel().accel * turn
    if unit == "deg/s":
        gyro = np.rad2deg(readings(1, np.deg2rad(BIAS_DPS), np.deg2rad(2.0))) * turn
    else:
        accel = accel / {"g": 9.80665, "mg": 9.80665e-3}[unit]
    path = written(tmp_path / "a.mcap", Channel(gyro=gyro, accel=accel))
    refused = imutui("replay", path, check=2).stderr
    (command,) = (shlex.split(each)[1:] for each in re.findall(r"`(imutui import [^`]*)`", " ".join(refused.split())))
    imutui(*command)
    gyro_dps, force, _ = found(Path(command[command.index("-o") + 1]))
    assert np.allclose(gyro_dps, BIAS_DPS, atol=0.15 if unit == "deg/s" else 0.02)
    assert np.allclose(force, [0.02, -0.03, -9.79], atol=0.005)


def test_what_is_stated_of_another_program_s_log_is_refused_of_ours() -> None:
    for command in (("replay",), ("info",), ("check",)):
        for stated in (("--topic", "/imu"), ("--mount", "x,y,z"), ("--stamps", "log")):
            told = " ".join(imutui(*command, SAMPLE, *stated, check=2).stderr.split())
            assert "it is a log of imutui. Leave those options out." in told

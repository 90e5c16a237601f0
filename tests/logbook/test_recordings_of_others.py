"""Recordings as other programs leave them, taken by following the commands of messages: what the unit read is known."""

import gzip
import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from helpers import bags_of_others, recordings_of_others
from helpers.bags_of_others import RECORDINGS
from helpers.commands import imutui
from helpers.recordings_of_others import COUNT, FORCE_G, GYRO_DPS, HZ, VARIANTS, readings
from mcap.writer import Writer

from imutui.logbook import reader


def followed(path: Path, *words: str) -> tuple[list[dict[str, Any]], list[str]]:
    """Documents of a command's result, or of all commands of its refusal, and what was said."""
    more = ["--json"] if "--json" not in words else []
    more += ["--force"] if words[0] == "import" and "--force" not in words else []
    done = imutui(*words, *more, check=None)
    if done.stdout:
        return [json.loads(done.stdout)], [done.stderr]
    commands = re.findall(r"`imutui ([^`]*)`", done.stderr)
    assert commands, done.stderr
    found = [followed(path, *shlex.split(command)) for command in commands]
    return [d for documents, _ in found for d in documents], [done.stderr, *(t for _, said in found for t in said)]


def imported(path: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """An import of a recording, or those that its refusal proposes."""
    return followed(path, "import", str(path), "-o", str(path.with_suffix(".log")))


def assert_read(log: reader.Log) -> None:
    """A log holds what the unit read, in its own axes."""
    axes, good = log.info.axes(), log.samples.valid
    gyro = np.median(np.rad2deg(axes.gyro_to_instrument(log.samples.gyro[good])), axis=0)
    assert np.allclose(gyro, GYRO_DPS, atol=0.02)
    force = np.median(axes.accel_to_instrument(log.samples.accel[good]) / log.info.g_unit, axis=0)
    assert np.linalg.norm(force) == pytest.approx(np.linalg.norm(FORCE_G), abs=0.006)


@pytest.mark.parametrize("name", VARIANTS)
def test_a_table_is_taken_as_it_was_meant(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(VARIANTS[name](*readings()), encoding="utf-8")
    documents, _ = imported(path)
    for document in documents:
        assert document["samples"] == COUNT
        assert document["rate_hz"] == pytest.approx(HZ, rel=0.02)
    assert_read(reader.read(path.with_suffix(".log")))


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_bag_is_taken_as_it_was_meant(tmp_path: Path, name: str) -> None:
    content, rate, share = RECORDINGS[name]
    path = tmp_path / "run.bag"
    bags_of_others.bag(path, content())
    documents, _ = imported(path)
    for document in documents:
        assert document["samples"] >= share * COUNT
        assert document["rate_hz"] == pytest.approx(rate, rel=0.02)
    assert_read(reader.read(path.with_suffix(".log")))


@pytest.mark.parametrize("name", ["pair_of_nan", "clock_back_twice", "gaps", "every_message_twice", "one_stamp"])
def test_commands_that_take_another_programs_log_take_it(tmp_path: Path, name: str) -> None:
    content, rate, share = RECORDINGS[name]
    path = tmp_path / "run.mcap"
    bags_of_others.mcap(path, content())
    documents, _ = followed(path, "replay", str(path))
    for document in documents:
        if "final" in document:
            assert np.allclose(document["final"]["gyro_bias_dps"], GYRO_DPS, atol=0.03)
        assert document["samples"] >= share * COUNT - 100
        assert document["rate_hz"] == pytest.approx(rate, rel=0.02)


SAID = {
    "temperature": "temperatures of /imu/temperature",
    "no_estimate_now_and_then": "60 samples with a covariance of -1 hold no reading",
    "zeros_now_and_then": "60 samples of six zeros hold no reading",
    "every_message_twice": "repeating earlier ones",
    "clock_back": "the clock was set back by 0.7 s",
    "pair_of_zeros": "with the forces of /camera/accel/sample",
}


@pytest.mark.parametrize("name", SAID)
def test_what_is_assumed_of_a_bag_is_said(tmp_path: Path, name: str) -> None:
    path = tmp_path / "run.bag"
    bags_of_others.bag(path, RECORDINGS[name][0]())
    documents, _ = imported(path)
    assert SAID[name] in "; ".join(documents[0]["assumed"])


def test_temperatures_of_a_bag_hold_until_the_next(tmp_path: Path) -> None:
    path = tmp_path / "run.bag"
    bags_of_others.bag(path, RECORDINGS["temperature"][0]())
    imported(path)
    degc = reader.read(path.with_suffix(".log")).samples.degc
    assert np.array_equal(degc, 25.0 + np.arange(COUNT) // 100)


def test_a_bag_that_was_cut_is_taken_up_to_there(tmp_path: Path) -> None:
    whole, path = tmp_path / "whole.bag", tmp_path / "run.bag"
    bags_of_others.bag(whole, bags_of_others.samples())
    path.write_bytes(whole.read_bytes()[: whole.stat().st_size * 6 // 10])
    documents, _ = imported(path)
    assert all(1500 < document["samples"] < COUNT for document in documents)
    assert documents[0]["assumed"][0].startswith("the bag is cut")


def test_a_database_of_ros_2_needs_no_metadata(tmp_path: Path) -> None:
    bags_of_others.database(tmp_path / "run", bags_of_others.samples())
    for path in (tmp_path / "run", next((tmp_path / "run").glob("*.db3"))):
        assert imported(path)[0][0]["samples"] == COUNT


def test_a_recording_is_known_by_its_content_whatever_its_name(tmp_path: Path) -> None:
    for name, write in (("run.bag.active", bags_of_others.bag), ("run", bags_of_others.mcap)):
        write(tmp_path / name, bags_of_others.samples())
        assert imported(tmp_path / name)[0][0]["samples"] == COUNT


def test_messages_that_are_packed_each_are_taken(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    bags_of_others.mcap(path, bags_of_others.samples(), packed=zstandard.compress)
    documents, (said, *_) = followed(path, "replay", str(path))
    assert "/imu/data (cdr that cannot be decoded" in said
    assert documents[0]["samples"] == COUNT


def test_a_message_that_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    bags_of_others.mcap(path, bags_of_others.samples()[:2], packed=lambda _: zstandard.compress(bytes(2**26)))
    said = imutui("import", path, "-o", tmp_path / "a.mcap", check=3).stderr
    assert "a message unpacks to more than 1,048,576 bytes" in said


def test_a_file_that_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.bag.gz"
    with gzip.open(path, "wb", 1) as stream:
        for _ in range(2**8 + 1):
            stream.write(bytes(2**20))
    said = imutui("import", path, "-o", tmp_path / "a.mcap", check=3).stderr
    assert "it unpacks to more than 268,435,456 bytes" in said


def test_vectors_of_json_are_lists_too_and_null_is_no_reading(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/imu", "json", writer.register_schema("Imu", "jsonschema", b"{}"))
        for k, (_, gyro, force) in enumerate(zip(*readings(), strict=True)):
            vectors = {"angular_velocity": [*np.deg2rad(gyro)], "linear_acceleration": [*(9.80665 * force)]}
            vectors["angular_velocity"][0] = None if k == 7 else vectors["angular_velocity"][0]
            writer.add_message(channel, k * 10_000_000, json.dumps(vectors).encode(), 0)
        writer.finish()
    assert imported(path)[0][0]["samples"] == COUNT
    log = reader.read(path.with_suffix(".log"))
    assert np.flatnonzero(~log.samples.valid).tolist() == [7]
    assert_read(log)


def test_the_sign_of_the_accelerometers_and_rounded_stamps_are_stated(tmp_path: Path) -> None:
    (path,) = recordings_of_others.write(tmp_path, loggers={"rounded.csv": VARIANTS["rounded.csv"]})
    (document,), _ = imported(path)
    assert "stamps are rounded to 0.002 s, 20 % of the period" in "; ".join(document["assumed"])
    assert "points up (phones, most boards) does: --accel-sign +1" in document["assumed"][-1]


def test_a_cure_replaces_the_option_that_it_changes(tmp_path: Path) -> None:
    (path,) = recordings_of_others.write(tmp_path, loggers={"down.csv": VARIANTS["down.csv"]})
    said = imutui("import", path, "-o", tmp_path / "a.mcap", "--accel-sign", "-1", check=3).stderr
    assert f"import {path} -o {tmp_path / 'a.mcap'} --accel-sign +1`" in said

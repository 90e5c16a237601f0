"""When a file is full, what the next is called and goes on from, and how much room there is."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.acquisitions import unread, untimed
from helpers.blocks import Stamped, blocks_of
from helpers.documents import effect, effects_toml, state

from imutui.instrument.clock import Stamp
from imutui.instrument.imu400.crossbow import Mode, Packet
from imutui.jobs import power_ons, runs
from imutui.jobs.replay import replay
from imutui.logbook import effects_file, reader
from imutui.logbook.reading import Reading
from imutui.logbook.session_info import SessionInfo
from imutui.session import live_filter
from imutui.session.plan import Plan, RecordingWish
from imutui.session.recording import DiskSpace, Recording
from imutui.verdict import sources

S = 1_000_000_000
START = 1_795_257_000_000_000_000
NOISE = np.random.default_rng(8).normal(size=(17_000, 6))
REMEMBERING = effects_toml(
    effect("thermal_lag", "gy", state("k", "deg/s/K", 0.02, 0.01), tau_s=180.0),
    effect("hysteresis", "ax", state("k", "mg", 2.0, 1.0), width_k=10.0),
)


@pytest.mark.parametrize(
    ("minutes", "mb", "seconds", "size", "full"),
    [
        (0.0, 0.0, 1e9, 10**12, False),
        (1.0, 0.0, 59.9, 10**12, False),
        (1.0, 0.0, 60.0, 0, True),
        (0.0, 2.0, 1e9, 1_999_999, False),
        (0.0, 2.0, 5.0, 2_000_000, True),
        (60.0, 2.0, 5.0, 2_000_000, True),
        (1e-6, 1e-6, 0.9, 10**9, False),
    ],
)
def test_a_file_is_full_by_time_or_by_size(
    tmp_path: Path, minutes: float, mb: float, seconds: float, size: int, full: bool
) -> None:
    plan = Plan("virtual", filter="none", rotate_minutes=minutes, rotate_mb=mb, logs=str(tmp_path), min_free_mb=0.0)
    recording = unread(plan, SessionInfo()).recording
    recording.record(RecordingWish())
    recording.run.started_ns = 0
    assert recording._is_full(round(seconds * S), size) is full
    recording.end()


def test_parts_are_named_after_the_first_and_replace_nothing(tmp_path: Path) -> None:
    recording = unread(Plan("virtual", filter="none", logs=str(tmp_path), min_free_mb=0.0), SessionInfo()).recording
    first = recording.record(RecordingWish())
    for part, name in enumerate(("p2", "p3_2"), 2):
        if part == 3:
            first.with_name(f"{first.stem}_p3.mcap").touch()
        recording._go_on()
        assert recording.writer is not None
        assert recording.writer.path == first.with_name(f"{first.stem}_{name}.mcap")
        assert recording.part == part
    recording.end()


@pytest.mark.parametrize("limits", [{"rotate_minutes": -1.0}, {"rotate_mb": float("nan")}, {"rotate_mb": float("inf")}])
def test_limits_that_make_no_sense_are_refused(limits: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(limits))):
        Plan("virtual", **limits)  # type: ignore[arg-type]


def test_a_reference_told_from_one_logs_start_keeps_the_recording_in_one_file() -> None:
    """A second file could not use it."""
    assert Plan("virtual", rotate_minutes=1.0).rotates
    assert not Plan("virtual", rotate_minutes=1.0, reference="profile", reference_file=("t.toml", "x")).rotates
    assert not Plan("virtual").rotates


def test_room_is_that_of_the_nearest_folder_there_is(tmp_path: Path) -> None:
    room = DiskSpace(0.0)
    missing = tmp_path / "logs" / "deep"
    free = room.free_bytes(missing, 5 * S)
    assert free is not None
    assert free == pytest.approx(shutil.disk_usage(tmp_path).free, rel=0.05)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda path: pytest.fail("asked again within the second"))
        assert room.free_bytes(missing, 6 * S - 1) == free
    (tmp_path / "logs").touch()
    assert room.free_bytes(missing, 6 * S) is not None


def test_the_rate_of_growth_is_told_through_all_files() -> None:
    growth = DiskSpace(0.0)
    for second in range(10):
        growth.add_size(second * S, 1000 * second)
        assert growth.bytes_per_s() is None
    growth.add_size(10 * S, 10_000)
    assert growth.bytes_per_s() == pytest.approx(1000.0)
    for second in range(11, 200):
        growth.add_size(second * S, 2000 * (second - 10))
    assert growth.bytes_per_s() == pytest.approx(2000.0)


# ------------------------------------------------------------------------------------- what goes on from file to file


def feed(recording: Recording, first: int, last: int) -> None:
    """Packets at 133 Hz of a unit that warms by 20 K in a minute, and cools."""
    packets = list[Stamped]()
    for k in range(first, last):
        counts = [int(x) for x in NOISE[k] * 40 + [0, 0, 0, 0, 0, 5461]]
        warmth = 350.0 * np.sin(k / 2500.0)
        packet = Packet(Mode.SCALED, tuple(counts[:3]), tuple(counts[3:]), 1550 + int(warmth), k)
        stamp = Stamp(k * 7_518_797, False)
        packets.append((packet, stamp, stamp.monotonic_ns + 2_000_000))
    for k in range(0, len(packets), 67):
        (block,) = blocks_of(packets[k : k + 67])
        recording.take(block)


def recorded(
    folder: Path, *ends: int, effects: str = REMEMBERING, filter_name: str = "spkf"
) -> list[tuple[Path, dict[str, Any]]]:
    """A recording that goes on in another file at each end, as the acquisition has it: files and live results."""
    live_filter.PLAIN.begin()
    live_filter.WITH_EFFECTS.begin()
    plan = Plan("virtual", logs=str(folder), rotate_minutes=1.0, effects=effects, filter=filter_name, min_free_mb=0.0)
    info = SessionInfo(rate_hz=20.0, filter=filter_name, effects_sha256=effects_file.digest(effects.encode()))
    recording = unread(plan, info).recording
    recording._begin("", folder / "a.mcap")
    made, first = list[tuple[Path, dict[str, Any]]](), 0
    for end in ends:
        feed(recording, first, end)
        recording._go_on() if end != ends[-1] else recording.end()
        assert recording.result is not None
        made.append((Path(recording.result["log"]), dict(recording.result)))
        first = end
    return made


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Path, dict[str, Any]]]:
    return recorded(tmp_path_factory.mktemp("rotated"), 2000, 4700, 6400)


def test_each_file_alone_replays_to_its_live_result(files: list[tuple[Path, dict[str, Any]]]) -> None:
    for path, live in files:
        assert untimed(replay(path, Reading())) == untimed(live)
    assert [live["history_known"] for _, live in files] == [False, True, True]
    # only a recording in several files tells its parts
    assert [len(live["parts"]) for _, live in files] == [0, 2, 3]
    for part, (path, live) in zip(files[2][1]["parts"], files, strict=True):
        assert part == {"log": str(path), "converged": live["converged"], "passes": sources.of_document(live).passes}


def test_memory_crosses_files_as_if_there_were_one(files: list[tuple[Path, dict[str, Any]]], tmp_path: Path) -> None:
    """What the third file begins with is, to the last bit, what one file in place of the first two ends with."""
    (whole, _), (after, _) = recorded(tmp_path, 4700, 6400)
    remembered = [reader.read(path).info.memory for path, _ in files]
    assert remembered[0] == ""
    assert json.loads(remembered[1])["lags"] != json.loads(remembered[2])["lags"]
    # averages begin anew with each file: the same packets make samples at other instants
    one, two = (json.loads(text) for text in (remembered[2], reader.read(after).info.memory))
    assert np.allclose(one["lags"], two["lags"], atol=0.02)
    assert np.allclose(one["plays"], two["plays"], atol=0.05)
    assert reader.read(whole).info.memory == ""


def test_a_file_without_its_memory_is_another_result(files: list[tuple[Path, dict[str, Any]]]) -> None:
    """Lag and play do not begin at rest there; from a later second on they do, since nothing is known of it."""
    path, live = files[2]
    without = replay(path, Reading(overrides={"memory": ""}))
    assert without["effects"] != live["effects"]
    assert without["config_sha256"] != live["config_sha256"]
    assert replay(path, Reading(start=1.0))["history_known"] is False


def test_files_name_the_one_before_and_their_power_on(files: list[tuple[Path, dict[str, Any]]]) -> None:
    logs = [reader.read(path) for path, _ in files]
    one, two, three = (log.info for log in logs)
    assert len({one.log_id, two.log_id, three.log_id, ""}) == 4
    assert {info.power_on for info in (one, two, three)} == {one.log_id}
    assert [info.part for info in (one, two, three)] == [1, 2, 3]
    assert [info.continues for info in (one, two, three)] == ["", "a.mcap", "a_p2.mcap"]
    assert [info.continues_id for info in (two, three)] == [one.log_id, two.log_id]
    assert [info.continues_sha256 for info in (two, three)] == [reader.sha256(path) for path, _ in files[:2]]
    assert {info.power_on_ns for info in (two, three)} == {logs[0].first_ns}


def test_memory_that_is_none_is_refused_and_that_of_other_lags_is_unknown(
    files: list[tuple[Path, dict[str, Any]]],
) -> None:
    """Text that was changed by hand is said to be; another version's is as if there were none."""
    path, live = files[1]
    with pytest.raises(ValueError, match="memory of temperature"):
        replay(path, Reading(overrides={"memory": '{"lags": 3}'}))
    held = json.loads(reader.read(path).info.memory)
    fewer = json.dumps({**held, "lags": held["lags"][:-1]})
    unknown = replay(path, Reading(overrides={"memory": ""}))
    assert replay(path, Reading(overrides={"memory": fewer}))["effects"] == unknown["effects"]
    assert unknown["effects"] != live["effects"]


def test_without_effects_nothing_is_remembered(tmp_path: Path) -> None:
    (_, _), (second, _) = recorded(tmp_path, 400, 800, effects="")
    info = reader.read(second).info
    assert info.memory == ""
    assert info.continues == "a.mcap"
    assert replace(info, memory="").part == 2


def test_files_of_a_recording_are_one_power_on_in_a_trace(tmp_path: Path) -> None:
    made = recorded(tmp_path, 8300, 16_600, effects="", filter_name="none")
    reads = [runs.read_run(path, path.stem, Reading()) for path, _ in reversed(made)]
    second, first = power_ons.join(reads)[0]
    assert first.run.power_on == second.run.power_on != ""
    assert (first.run.history_known, second.run.history_known) == (False, True)
    # an average that is not full at a file's end is not written
    assert 0.0 < second.run.begins - first.run.seconds < 0.15

import json
import os
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from imutui.jobs.info import Brief, brief, info, recordings
from imutui.logbook import SessionInfo, file_lock, schemas
from imutui.logbook.writer import LogWriter

START = 1_795_257_000_000_000_000


def written(path: Path, seconds: int = 3, rate: int = 20, *, finish: bool = True, kind: str = "simulated") -> LogWriter:
    """A log of a few seconds, a chunk each."""
    session = SessionInfo(serial_number="42", rate_hz=rate, kind=kind, operator="Ada", note="cold start")
    log = LogWriter(path, session, "x = 1\n", START)
    for k in range(seconds * rate):
        stamp = START + k * 1_000_000_000 // rate
        log.imu(stamp, stamp, np.zeros(3), np.ones(3), valid=k != 3)
        log.message(schemas.TEMPERATURE, schemas.temperature(stamp, 20.0 + k / rate), stamp, stamp)
        if k % rate == rate - 1:
            log.message(schemas.EVENTS, schemas.event(stamp, "mark", f"mark {k}"), stamp, stamp)
            log.flush()
    if finish:
        log.finish({"samples": seconds * rate, "duration_s": seconds - 1.0 / rate, "converged": True}, START)
    else:
        log.flush_file()
    return log


def test_a_finished_log_in_brief(tmp_path: Path) -> None:
    """Length, samples, rate, kind, who and what, from its summary."""
    written(tmp_path / "a.mcap")
    b = brief(tmp_path / "a.mcap")
    assert (b.state, b.why, b.samples, b.rate_hz, b.kind) == ("finished", "", 60, 20.0, "simulated")
    assert b.seconds == pytest.approx(2.95)
    assert b.measured_hz == pytest.approx(20.0)
    assert (b.serial_number, b.operator, b.note, b.name) == ("42", "Ada", "cold start", "a.mcap")
    assert b.converged is True
    assert b.started == START / 1e9
    assert not b.by_ends
    assert b.bytes == (tmp_path / "a.mcap").stat().st_size


def test_an_unfinished_log_in_brief_is_counted_by_its_ends(tmp_path: Path) -> None:
    """Samples are numbered: first and last chunk tell how many there are; while it is held, it is being written."""
    writer = written(tmp_path / "a.mcap", finish=False)
    assert brief(tmp_path / "a.mcap").state == "being written"
    copy = tmp_path / "b.mcap"
    copy.write_bytes((tmp_path / "a.mcap").read_bytes())
    b = brief(copy)
    assert (b.state, b.samples, b.by_ends) == ("unfinished", 60, True)
    assert b.seconds == pytest.approx(2.95)
    writer.finish({}, START)
    assert brief(tmp_path / "a.mcap").state == "finished"


def test_no_cut_or_flipped_byte_makes_a_brief_fail(tmp_path: Path) -> None:
    """Whatever a file is, it gets one of five words and never more samples than were written."""
    written(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    rng = np.random.default_rng(2)
    b = tmp_path / "b.mcap"
    for size in rng.integers(0, len(data), 150).tolist():
        b.write_bytes(data[:size])
        found = brief(b)
        assert found.state in ("unfinished", "not a log")
        assert (found.samples or 0) <= 60
    for at in rng.integers(0, len(data), 150).tolist():
        b.write_bytes(data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :])
        assert brief(b).state in ("finished", "unfinished", "damaged", "not a log")


def test_other_files_are_told_as_what_they_are(tmp_path: Path) -> None:
    """Empty, foreign, absent, a footer broken, rubbish behind the end."""
    written(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    b = tmp_path / "b.mcap"
    for content, state, why in (
        (b"", "not a log", "empty"),
        (b"hello", "not a log", "begin"),
        (data + b"rubbish" * 9, "damaged", "do not belong"),
        (data[:-30] + b"\xff" + data[-29:], "damaged", ""),
    ):
        b.write_bytes(content)
        assert brief(b).state == state
        assert why in brief(b).why
    assert brief(tmp_path / "none.mcap").state == "not a log"


def test_recordings_of_a_folder_newest_first(tmp_path: Path) -> None:
    """Logs only; a folder that is not there has none."""
    for k, name in enumerate(("old", "new", "middle")):
        written(tmp_path / f"{name}.mcap", 1)
        os.utime(tmp_path / f"{name}.mcap", (0, (100, 300, 200)[k]))
    (tmp_path / "notes.txt").write_text("x")
    (tmp_path / "folder.mcap").mkdir()
    assert [b.name for b in recordings(tmp_path)] == ["new.mcap", "middle.mcap", "old.mcap"]
    assert recordings(tmp_path / "nowhere") == []


def test_a_claimed_kind_that_is_none_is_unknown(tmp_path: Path) -> None:
    """Nothing passes for measured that does not say so."""
    written(tmp_path / "a.mcap", 1, kind="Measured?")
    assert brief(tmp_path / "a.mcap").kind == "unknown"
    assert info(tmp_path / "a.mcap")["kind"] == "unknown"


def test_info_tells_all_that_is_in_a_log(tmp_path: Path) -> None:
    """JSON-ready: extent, temperature, marks with their time, topics, attachments, quality."""
    written(tmp_path / "a.mcap")
    d = json.loads(json.dumps(info(tmp_path / "a.mcap"), allow_nan=False))
    assert (d["samples"], d["samples_without_reading"], d["state"]) == (60, 1, "finished")
    assert d["start_utc"] == "2026-11-21T10:30:00.000Z"
    assert d["rate_measured_hz"] == pytest.approx(20.0)
    assert d["temperature_degc"] == pytest.approx({"first": 20.0, "last": 22.95, "min": 20.0, "max": 22.95})
    assert [(m["t"], m["text"]) for m in d["marks"]] == [(0.95, "mark 19"), (1.95, "mark 39"), (2.95, "mark 59")]
    assert d["topics"]["/imu/data_raw"] == {"type": "sensor_msgs/msg/Imu", "messages": 60}
    assert d["topics"]["/imu/raw"]["messages"] == 0
    assert set(d["attachments"]) == {"configuration.toml", "summary.json"}
    assert d["quality"]["converged"] is True
    assert d["recovered"] is None


def test_asking_whether_a_file_is_held_does_not_disturb_its_writer(tmp_path: Path) -> None:
    """Two ask at once; it stays held until it is closed."""
    path = tmp_path / "a"
    with path.open("wb") as writer:
        file_lock.claim(writer)
        with path.open("rb") as one, path.open("rb") as other:
            assert file_lock.is_held(one)
            assert file_lock.is_held(other)
        with path.open("rb") as again:
            assert file_lock.is_held(again)
    with path.open("rb") as after:
        assert not file_lock.is_held(after)


def test_a_brief_can_travel(tmp_path: Path) -> None:
    """Every field has a plain value."""
    written(tmp_path / "a.mcap", 1)
    b = brief(tmp_path / "a.mcap")
    kinds = {type(getattr(b, field.name)) for field in fields(Brief)}
    assert kinds <= {type(tmp_path), int, float, str, bool, type(None)}

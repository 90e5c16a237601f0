import json
import os
import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from imutui.jobs import log_files
from imutui.jobs.info import Brief, brief, folder_logs, info, recordings, row
from imutui.logbook import SessionInfo, added_notes, checksum_file, file_lock, schemas
from imutui.logbook.reader import read
from imutui.logbook.writer import LogWriter
from imutui.report import log_table
from imutui.report.logs import info_text

START = 1_795_257_000_000_000_000


def written(
    path: Path, seconds: int = 3, rate: int = 20, *, finish: bool = True, kind: str = "simulated", start: int = START
) -> LogWriter:
    """A log of a few seconds, a chunk each."""
    session = SessionInfo(serial_number="42", rate_hz=rate, kind=kind, operator="Ada", note="cold start")
    log = LogWriter(path, session, "x = 1\n", start)
    for k in range(seconds * rate):
        stamp = start + k * 1_000_000_000 // rate
        log.imu(stamp, stamp, np.zeros(3), np.ones(3), valid=k != 3)
        log.encoded(schemas.TEMPERATURE, schemas.encode_temperatures(stamp, 20.0 + k / rate)[0], stamp, stamp)
        if k % rate == rate - 1:
            log.encoded(schemas.EVENTS, schemas.encode_event(stamp, "mark", f"mark {k}"), stamp, stamp)
            log.flush()
    if finish:
        log.finish({"samples": seconds * rate, "duration_s": seconds - 1.0 / rate, "converged": True}, START)
    else:
        log.flush_file()
    return log


def test_a_finished_log_in_brief(tmp_path: Path) -> None:
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
    for k, name in enumerate(("old", "new", "middle")):
        written(tmp_path / f"{name}.mcap", 1, start=START + (0, 20_000_000_000, 10_000_000_000)[k])
        os.utime(tmp_path / f"{name}.mcap", (0, 100 + k))
    (tmp_path / "notes.txt").write_text("x")
    (tmp_path / "folder.mcap").mkdir()
    assert [b.name for b in recordings(tmp_path)] == ["new.mcap", "middle.mcap", "old.mcap"]
    assert recordings(tmp_path / "nowhere") == []


def test_a_changed_note_is_the_latest_wherever_it_is_looked_for(tmp_path: Path) -> None:
    session = SessionInfo(rate_hz=20.0, note="cold", operator="Ada")
    log = LogWriter(tmp_path / "a.mcap", session, "", START)
    for second in range(4):
        at = START + second * 1_000_000_000
        log.imu(at, at, np.zeros(3), np.ones(3))
        if second == 1:
            log.describe(replace(session, note="warm"))
        said = {"note": "warm"} if second else {}
        log.encoded(schemas.DIAGNOSTICS, schemas.encode_diagnostics(at, 0, "ok", {"packets": "1", **said}), at, at)
        log.flush()
    (tmp_path / "cut.mcap").write_bytes((tmp_path / "a.mcap").read_bytes())
    assert (brief(tmp_path / "a.mcap").state, brief(tmp_path / "a.mcap").note) == ("being written", "warm")
    log.finish({}, START)
    for name in ("a", "cut"):
        path = tmp_path / f"{name}.mcap"
        assert (brief(path).note, brief(path).operator) == ("warm", "Ada")
        assert info(path)["note"] == "warm"
        assert read(path).info.note == "warm"
        assert len(read(path).samples) == 4


def test_a_note_that_is_added_later_leaves_the_log_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    written(path)
    before, sum_before = path.read_bytes(), checksum_file.read(path)
    log_files.annotate(path, "loose screw", None)
    log_files.annotate(path, "screw tightened", "Bo")
    assert path.read_bytes() == before
    assert checksum_file.read(path) == sum_before
    b = brief(path)
    assert (b.note, b.latest_note, b.operator, b.latest_operator) == ("cold start", "screw tightened", "Ada", "Bo")
    d = info(path)
    assert [(said["note"], said["operator"]) for said in d["added"]] == [
        ("loose screw", None), ("screw tightened", "Bo")
    ]  # fmt: skip
    assert "added later   note: loose screw" in info_text(d, 100)
    added_notes.path_of(path).write_text("added = 3")
    assert brief(path).latest_note == "cold start"
    with pytest.raises(ValueError, match=r"notes\.toml cannot be used"):
        log_files.annotate(path, "x", None)


def test_a_folder_is_a_table_at_every_width(tmp_path: Path) -> None:
    written(tmp_path / f"imu400cd_42_20261121T104307Z_{'long-' * 9}.mcap", 1)
    (tmp_path / "b.mcap").write_bytes(b"")
    logs = folder_logs(tmp_path)
    for width in (None, 80, 100, 120, 200):
        table = log_table.text("logs", logs, width).splitlines()
        assert all(len(line) <= (width or 1000) for line in table)
        assert re.search("SIMULATED {1,2}finished", table[4])
        assert "cold start" in " ".join(table[4:6])
        assert re.search(r" IMU400CD 42 +20 ", table[4])
        assert len(re.split(" {2,}", table[4].strip())) in (8, 9) or width == 80
    assert [one["finished"] for one in json.loads(json.dumps([row(one) for one in logs]))] == [False, True]
    assert "no logs" in log_table.text("logs", [], 80)


@pytest.mark.parametrize(
    ("instrument", "serial", "said"),
    [
        ("IMU400CD-200", "9911750", "IMU400CD 9911750"),
        ("IMU381ZA-200", "17", "IMU381ZA 17"),
        ("Xsens MTi-30", "", "Xsens MTi-30"),
        ("", "", ""),
        ("", "5", "5"),
    ],
)
def test_a_list_has_model_and_serial_number(instrument: str, serial: str, said: str) -> None:
    assert log_table.unit(instrument, serial) == said


def test_a_claimed_kind_that_is_none_is_unknown(tmp_path: Path) -> None:
    written(tmp_path / "a.mcap", 1, kind="Measured?")
    assert brief(tmp_path / "a.mcap").kind == "unknown"
    assert info(tmp_path / "a.mcap")["kind"] == "unknown"


def test_info_tells_all_that_is_in_a_log(tmp_path: Path) -> None:
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


def test_info_shows_no_more_than_a_screen_of_what_a_file_makes_long(tmp_path: Path) -> None:
    """The document has all of it; the text says how long each is."""
    note, names = "word " * 500_000, [f"/topic/{n}" for n in range(500)]
    log = info(written(tmp_path / "a.mcap").path)
    topics = {name: {"type": "x" * 100_000, "messages": 1} for name in names}
    events = [{"t": 0.0, "utc": "2026-01-01T00:00:00Z", "text": note}] * 500
    added = [{"utc": "", "by": "ana", "note": f"note {n}", "operator": None} for n in range(900)]
    long = {**log, "note": note, "effects": names, "topics": topics, "events": events, "added": added,
            "attachments": dict.fromkeys(names, 1)}  # fmt: skip
    text = info_text(long, 80)  # type: ignore[arg-type]
    assert f"({len(note):,} characters; --json has all)" in " ".join(text.split())
    assert "and 470 more topics; --json has all" in text
    assert "note 899" in text
    assert "and 895 more earlier notes" in text
    assert len(text) < 50_000
    head = text.partition("\nevents")[0]
    assert len(head.splitlines()) < 120


def test_asking_whether_a_file_is_held_does_not_disturb_its_writer(tmp_path: Path) -> None:
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
    written(tmp_path / "a.mcap", 1)
    b = brief(tmp_path / "a.mcap")
    kinds = {type(getattr(b, field.name)) for field in fields(Brief)}
    assert kinds <= {type(tmp_path), int, float, str, bool, type(None)}

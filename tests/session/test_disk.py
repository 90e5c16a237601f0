"""The disk of a recording: its file removed, renamed, out of reach; others fill it. Said, and gone on from, or ended.

The acquisition runs in the test's own process; its duties of every second are called for when they are wanted.
"""

import contextlib
import errno
import json
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from helpers import ros_messages
from helpers.acquisitions import acquiring, mounted, mounts, untimed
from helpers.commands import imutui
from helpers.documents import dwell, profile_toml
from helpers.processes import LIMIT_S, wait_until
from helpers.units import virtual

from imutui.jobs.check import check
from imutui.jobs.replay import replay
from imutui.logbook import checksum_file, reader
from imutui.logbook.reading import Reading
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.session import client, lifecycle
from imutui.session.acquisition import Acquisition
from imutui.session.plan import Plan, RecordingWish
from imutui.session.recording import DiskSpace, disk_message, why_lost

PROFILE = profile_toml(dwell(600.0), align="marks")


def faults_of_file(log: Path) -> list[Any]:
    """What `check` finds but that the unit of these tests repeats one reading."""
    return [finding for finding in check(log)["findings"] if finding["code"] != "health"]


def ticks(*logs: Path) -> np.ndarray:
    """Time counters of the packets of some logs."""
    return np.array([packet.ticks for log in logs for packet in ros_messages.packets(reader.read(log, raw=True))])


def is_unbroken(*logs: Path) -> bool:
    """Whether the time counter ran down by one period from packet to packet: none is missing, and none is twice."""
    return np.ptp(np.mod(-np.diff(ticks(*logs)), 65536)) <= 1


def events(log: Path) -> list[str]:
    return [event.text for event in reader.read(log).events]


def remove(file: Path) -> None:
    file.unlink()


def remove_folder(file: Path) -> None:
    shutil.rmtree(file.parent)


def replace(file: Path) -> None:
    file.with_name("new").write_text("somebody else's")
    file.with_name("new").rename(file)


@pytest.mark.parametrize("vanish", [remove, remove_folder, replace])
def test_a_removed_file_is_said_to_be_lost_and_a_new_one_goes_on(home: Path, vanish: Callable[[Path], None]) -> None:
    with acquiring(home) as run:
        vanish(run.first)
        run.a_second_passes()
        state = run.seen()
        assert state["recording"]["path"] == str(run.second)
        assert (state["recording"]["part"], state["state"], state["error"]) == (2, "running", None)
        (said,) = state["findings"]
        assert all(words in said for words in (str(run.first), "was removed", "lost", "a_p2.mcap"))
        run.record()
        result = run.end()
        assert (result["log"], result["finished"]) == (str(run.second), True)
        assert result["parts"] == []
        assert run.findings() == [said]
    assert is_unbroken(run.second)
    assert any("continues a.mcap" in text and "was removed" in text for text in events(run.second))
    assert faults_of_file(run.second) == []
    assert run.first.exists() == (vanish is replace)
    assert not checksum_file.path_of(run.first).exists()
    if vanish is replace:
        assert run.first.read_text() == "somebody else's"


def rename(file: Path) -> Path:
    return file.rename(file.with_name("other.mcap"))


def rename_folder(file: Path) -> Path:
    return file.parent.rename(file.parent.with_name("old logs")) / file.name


@pytest.mark.parametrize("move", [rename, rename_folder])
def test_a_renamed_file_is_whole_where_it_is_and_a_new_one_goes_on(home: Path, move: Callable[[Path], Path]) -> None:
    """It is no part of the recording any more, as if it were lost: nobody follows it."""
    with acquiring(home) as run:
        now_at = move(run.first)
        run.record()
        run.record()
        result = run.end()
        (said,) = run.findings()
    assert (result["log"], result["finished"], result["parts"]) == (str(run.second), True, [])
    assert all(words in said for words in (str(run.first), "renamed", "unless it is elsewhere", "a_p2.mcap"))
    assert is_unbroken(now_at, run.second)
    for log in (now_at, run.second):
        assert faults_of_file(log) == []
    info = reader.read(run.second).info
    assert (info.part, info.continues) == (2, "a.mcap")


def test_each_file_of_a_recording_whose_file_was_renamed_replays_to_its_live_result(home: Path) -> None:
    with acquiring(home, filter="spkf", rate_hz=20.0) as run:
        rename(run.first)
        run.record()
        run.record(300)
        live = run.end()
    assert untimed(replay(run.second, Reading())) == untimed(live)


@pytest.mark.parametrize("number", [errno.EIO, errno.ESTALE])
def test_a_disk_that_has_gone_is_told_from_one_that_is_full(
    home: Path, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with acquiring(home) as run:
        gone, sync, flushed = run.first.stat().st_ino, os.fdatasync, run.seen()["recording"]["bytes"]

        def fail(descriptor: int) -> None:
            if os.fstat(descriptor).st_ino == gone:
                raise OSError(number, os.strerror(number))
            sync(descriptor)

        monkeypatch.setattr(os, "fdatasync", fail)
        with contextlib.suppress(OSError):
            run.a_second_passes()
        assert run.seen()["recording"]["part"] == 2
        run.record()
        result = run.end()
        (said,) = run.findings()
        assert all(words in said for words in (str(run.first), os.strerror(number), "has gone", "a_p2.mcap"))
        assert result["log"] == str(run.second)
    assert run.first.stat().st_size >= flushed
    assert reader.read(run.first).samples.stamp_ns.size >= 20
    assert faults_of_file(run.second) == []


def test_a_file_that_was_removed_just_before_the_end_is_not_said_to_be_finished(home: Path) -> None:
    """Nobody looked since: the result, the finding and a viewer's answer tell."""
    with acquiring(home) as run:
        run.first.unlink()
        result = run.end()
        assert (result["log"], result["finished"], result["log_sha256"]) == (str(run.first), False, None)
        assert [str(run.first) in text and "lost" in text for text in run.findings()] == [True]
    with acquiring(home) as run:

        def at_once(acquisition: Acquisition) -> None:
            run.first.unlink()
            acquisition.stop_recording()

        with pytest.raises(ValueError, match=r"a\.mcap was removed, renamed or unmounted"):
            run.engine.call(at_once)
        assert run.seen()["recording"] is None
    assert list((home / "logs").iterdir()) == []


def test_a_folder_that_cannot_be_made_again_ends_the_acquisition(home: Path) -> None:
    with acquiring(home, logs=str(home / "disk" / "logs"), output=str(home / "disk" / "logs" / "a.mcap")) as run:
        shutil.rmtree(home / "disk")
        wait_until(run.engine.lifecycle.ended.is_set)
        error = run.engine.lifecycle.error or ""
        assert run.engine.exit_code == lifecycle.DISK
        assert all(words in error for words in ("a.mcap was removed", "lost", "No such file or directory"))
        assert "holds everything" not in error


def test_a_file_that_is_gone_is_never_said_to_hold_anything(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path / "a.mcap", SessionInfo(), "", 0)
    full = OSError(errno.ENOSPC, "No space left on device")
    assert "no file is left" in disk_message(writer, full)
    writer.imu(0, 0, np.zeros(3), np.zeros(3))
    writer.flush()
    assert "holds everything up to its last flush" in disk_message(writer, full)
    assert why_lost(writer) == ""
    assert why_lost(writer, full) == ""
    writer.path.unlink()
    assert "not there any more" in disk_message(writer, full)


def test_a_profile_is_not_told_from_the_new_files_first_sample(home: Path) -> None:
    """It is told from the recording's: the new file goes on without a filter, and says nothing of the table."""
    with acquiring(home, filter="spkf", reference="profile", reference_file=("steps.toml", PROFILE)) as run:
        run.first.unlink()
        run.a_second_passes()
        run.record()
        assert run.seen()["filter"] is None
        run.end()
    log = reader.read(run.second)
    assert (log.info.filter, log.info.reference, log.info.reference_sha256) == ("none", "gravity", "")
    assert not any("reference" in name for name in log.attachments)


@pytest.fixture
def stick(home: Path) -> Iterator[Path]:
    """A disk that can be unmounted."""
    with mounted(home / "stick", "2m") as folder:
        yield folder


@mounts
def test_a_disk_that_is_unmounted_is_noticed(home: Path, stick: Path) -> None:
    """The file is finished on it, for whoever mounts it again; the recording goes on in the folder that was below."""
    logs = stick / "logs"
    with acquiring(home, logs=str(logs), output=str(logs / "a.mcap"), min_free_mb=0.0) as run:
        subprocess.run(["umount", "--lazy", str(stick)], timeout=LIMIT_S, check=True)
        run.a_second_passes()
        assert run.seen()["recording"]["path"] == str(logs / "a_p2.mcap")
        run.record()
        run.end()
        (said,) = run.findings()
        assert "unmounted" in said
    assert [path.name for path in sorted(logs.iterdir())] == ["a_p2.mcap", "a_p2.mcap.sha256"]
    assert check(logs / "a_p2.mcap")["findings"] == []


def test_status_and_stop_tell_of_a_vanished_file(home: Path) -> None:
    with virtual() as port:
        connection = client.start(Plan(port, logs=str(home / "logs"), record=True, filter="none"))
        first = Path(connection.snapshot(2**62)["recording"]["path"])
        first.unlink()
        wait_until(lambda: connection.snapshot(2**62)["recording"]["part"] == 2)
        assert f"{first} was removed" in imutui("status").stdout
        stopped = imutui("stop", "--json", check=1)
    assert json.loads(stopped.stdout)["log"] == str(first.with_name(f"{first.stem}_p2.mcap"))
    assert f"{first} was removed" in stopped.stderr


def test_an_end_that_nobody_asked_for_has_the_exit_code_of_the_disk(home: Path) -> None:
    """5, as contracts have it, though the rest is finished."""
    with acquiring(home, duration_s=1.0) as run:
        run.first.unlink()
        wait_until(run.engine.lifecycle.ended.is_set)
        assert run.engine.exit_code == lifecycle.DISK
        assert run.engine.lifecycle.error is None


# Recording leaves some of the disk free: it does not begin below the limit, and ends above zero with a whole file

MB = 1_000_000


class Usage(NamedTuple):
    """What shutil.disk_usage returns."""

    total: int
    used: int
    free: int


class Disk:
    """A disk that has as much free as the test says."""

    def __init__(self, patch: pytest.MonkeyPatch, free_mb: float) -> None:
        self.free_mb = free_mb
        patch.setattr(shutil, "disk_usage", lambda path: Usage(10**12, 0, round(self.free_mb * MB)))


@mounts
def test_a_disk_that_others_fill_ends_the_recording_above_zero(home: Path) -> None:
    with mounted(home / "disk", "4m") as disk:
        fields = {"logs": str(disk / "logs"), "output": str(disk / "logs" / "a.mcap"), "min_free_mb": 2.0}
        with acquiring(home, **fields) as run:
            (disk / "others").write_bytes(bytes(2_500_000))
            wait_until(run.engine.lifecycle.ended.is_set)
            result = run.engine.result
            assert result is not None
            assert (result["log"], result["finished"]) == (str(disk / "logs" / "a.mcap"), True)
            assert run.engine.exit_code == lifecycle.DISK
            (said,) = run.findings()
            assert all(words in said for words in (str(disk / "logs"), "recording leaves 2.0 MB", "a.mcap is finished"))
            assert shutil.disk_usage(disk).free > MB
        assert faults_of_file(disk / "logs" / "a.mcap") == []
        assert checksum_file.read(disk / "logs" / "a.mcap") == result["log_sha256"]
        again = {**fields, "output": str(disk / "other logs" / "b.mcap")}
        with pytest.raises(OSError, match=r"recording leaves 2\.0 MB"), acquiring(home, **again):
            pass
        assert sorted(path.name for path in disk.iterdir()) == ["logs", "others"]


def test_a_recording_is_refused_in_words_before_the_unit_is_touched(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("IMUTUI_PATHS_MIN_FREE_MB", "1e9")
    done = imutui("record", "--port", "/dev/no-such-port", "--filter", "none", check=5)
    assert done.stderr.count("\n") == 1
    assert all(words in done.stderr for words in (str(home / "logs"), "are free", "1,000,000,000 MB", "min_free_mb"))
    assert "Choose another folder or free some space" in done.stderr
    assert not (home / "logs").exists()


def test_a_viewers_recording_ends_and_the_acquisition_goes_on(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Disk(monkeypatch, 500.0)
    with acquiring(home, record=False) as run:

        def begin() -> str:
            return run.engine.call(lambda acquisition: acquisition.record(RecordingWish()))

        log = Path(begin())
        run.record()
        disk.free_mb = 150.0
        wait_until(lambda: run.seen()["recording"] is None)
        state = run.seen()
        assert state["state"] == "running"
        assert "150 MB are free, and recording leaves 200 MB" in state["findings"][0]
        with pytest.raises(ValueError, match=r"150 MB are free.*free some space"):
            begin()
        assert faults_of_file(log) == []
        disk.free_mb = 500.0
        assert Path(begin()) != log


def test_no_limit_is_no_guard(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Disk(monkeypatch, 0.0)
    with acquiring(home, min_free_mb=0.0) as run:
        run.record()
        assert run.seen()["recording"] is not None
        assert run.seen()["min_free_bytes"] == 0


def test_time_left_is_until_the_limit_and_half_an_hour_is_said_once() -> None:
    guard = DiskSpace(200.0)
    assert guard.seconds_left(300 * MB) is None
    for second in range(11):
        guard.add_size(second * 1_000_000_000, second * 100_000)
    assert guard.seconds_left(300 * MB) == pytest.approx(1000.0)
    assert guard.seconds_left(100 * MB) == 0.0
    assert guard.seconds_left(None) is None
    assert guard.warn(None) is None
    assert guard.warn(round(380.1 * MB)) is None
    assert guard.warn(round(379.9 * MB)) == "the disk has room for 30 min more; free some space"
    assert guard.warn(370 * MB) is None
    assert guard.stop(Path("logs/a.mcap"), 200 * MB) is None
    assert guard.stop(Path("logs/a.mcap"), None) is None
    assert "a.mcap is finished" in (guard.stop(Path("logs/a.mcap"), 200 * MB - 1) or "")

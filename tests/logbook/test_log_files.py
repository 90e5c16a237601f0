"""The file of a log: its permissions, its SHA-256 beside it, and what is left of one that could not be begun."""

import errno
import hashlib
import os
import stat
import subprocess
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import imutui
from helpers.paths import SAMPLE

from imutui.jobs import info
from imutui.jobs.check import check
from imutui.logbook import atomic_file, checksum_file, log_stream
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter

START = 1_795_257_000_000_000_000


def written(path: Path, count: int = 40, **options: bool) -> LogWriter:
    """A finished log of so many samples, flushed every ten."""
    log = LogWriter(path, SessionInfo(rate_hz=20, kind="simulated", filter="none"), "x = 1\n", START, **options)
    for k in range(count):
        stamp = START + k * 50_000_000
        log.imu(stamp, stamp, np.full(3, 0.1 * k), np.zeros(3))
        if k % 10 == 9:
            log.flush()
    log.finish({"samples": count}, START)
    return log


def permissions(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_the_hash_made_while_writing_is_that_of_the_file(tmp_path: Path) -> None:
    for count in (0, 1, 40, 3000):
        path = tmp_path / f"{count}.mcap"
        log = written(path, count)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        assert log.sha256 == digest
        assert checksum_file.read(path) == digest
    unfinished = LogWriter(tmp_path / "b.mcap", SessionInfo(), "", START)
    assert unfinished.sha256 is None
    assert not checksum_file.path_of(unfinished.path).exists()
    assert [path for path in tmp_path.iterdir() if path.suffix == ".part"] == []


def test_sha256sum_reads_what_stands_beside_a_log(tmp_path: Path) -> None:
    for name in ("a.mcap", "with a space.mcap", "back\\slash.mcap", "two\nlines.mcap"):
        written(tmp_path / name)
        line = ["sha256sum", "-c", f"{name}.sha256"]
        assert subprocess.run(line, cwd=tmp_path, capture_output=True, check=False).returncode == 0, name
        with (tmp_path / name).open("r+b") as stream:
            stream.write(b"x")
        assert subprocess.run(line, cwd=tmp_path, capture_output=True, check=False).returncode == 1, name


def test_check_compares_the_sum_beside_a_log(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap").path
    assert "Its SHA-256 is the one in a.mcap.sha256." in check(path)["notes"]
    assert "sha256" not in [finding["code"] for finding in check(path)["findings"]]
    data = bytearray(path.read_bytes())
    data[data.index(b"x = 1")] ^= 1  # the configuration: nothing else in the file is about it but a checksum
    path.write_bytes(data)
    found = {finding["code"]: finding for finding in check(path)["findings"]}
    assert hashlib.sha256(data).hexdigest() in found["sha256"]["what"]
    assert "a.mcap.sha256" in found["sha256"]["where"]
    checksum_file.path_of(path).write_text("nonsense\n")
    assert [f["what"] for f in check(path)["findings"] if f["code"] == "sha256" and "holds no SHA-256" in f["what"]]
    checksum_file.remove(path)
    document = check(path)
    assert "sha256" not in [finding["code"] for finding in document["findings"]]
    assert not [note for note in document["notes"] if "SHA-256" in note]


def test_a_sum_goes_with_its_log_whatever_its_name(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap").path
    checksum_file.path_of(path).rename(tmp_path / "b.mcap.sha256")
    path.rename(tmp_path / "b.mcap")
    assert "Its SHA-256 is the one in b.mcap.sha256." in check(tmp_path / "b.mcap")["notes"]


def test_a_new_log_of_a_name_is_not_judged_by_an_older_ones_sum(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap").path
    LogWriter(path, SessionInfo(), "", START, overwrite=True)
    assert checksum_file.read(path) is None
    path = written(tmp_path / "b.mcap").path
    path.unlink()
    LogWriter(path, SessionInfo(), "", START)
    assert checksum_file.read(path) is None


def test_sums_are_no_logs(tmp_path: Path) -> None:
    written(tmp_path / "a.mcap")
    assert [brief.path.name for brief in info.recordings(tmp_path)] == ["a.mcap"]


def test_a_log_is_for_its_owner_and_group(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        path = written(tmp_path / "a.mcap").path
        assert permissions(path) == permissions(checksum_file.path_of(path)) == 0o640
        os.umask(0o077)
        other = LogWriter(tmp_path / "b.mcap", SessionInfo(), "", START, mode=0o664)
        other.finish({}, START)
        assert permissions(other.path) == permissions(checksum_file.path_of(other.path)) == 0o664
        with atomic_file.part_of(tmp_path / "c.mcap", overwrite=False, mode=0o640) as part:
            part.write_bytes(b"x")
        assert permissions(tmp_path / "c.mcap") == 0o640
    finally:
        os.umask(before)


def test_commands_make_logs_with_the_configured_permissions(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = "".join(f"{i / 20},0.1,0.2,0.3,0,0,0.998\n" for i in range(60))
    (home / "a.csv").write_text("t,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n" + rows)
    imutui("import", "a.csv", "-o", "a.mcap")
    imutui("recover", SAMPLE, "-o", "b.mcap")
    assert [permissions(home / name) for name in ("a.mcap", "a.mcap.sha256", "b.mcap", "b.mcap.sha256")] == [0o640] * 4
    assert checksum_file.read(home / "b.mcap") == hashlib.sha256((home / "b.mcap").read_bytes()).hexdigest()
    monkeypatch.setenv("IMUTUI_PATHS_FILE_MODE", "0664")
    imutui("import", "a.csv", "-o", "c.mcap")
    imutui("recover", SAMPLE, "-o", "d.mcap")
    imutui("replay", "a.mcap", "-o", "b.mcap", "--force", "--filter", "spkf-paper", check=None)
    assert [permissions(home / name) for name in ("c.mcap", "d.mcap", "b.mcap")] == [0o664] * 3
    assert not (home / "b.mcap.sha256").exists()
    monkeypatch.setenv("IMUTUI_PATHS_FILE_MODE", "0777")
    assert "paths.file_mode" in imutui("import", "a.csv", "-o", "e.mcap", check=2).stderr


def test_a_log_that_cannot_be_begun_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    early, late = tmp_path / "early.mcap", tmp_path / "late.mcap"
    begun = LogWriter(tmp_path / "begun.mcap", SessionInfo(), "", START)
    held = LogWriter(late, SessionInfo(), "", START)
    held.imu(START, START, np.zeros(3), np.zeros(3))
    held.flush()
    with monkeypatch.context() as patch:
        patch.setattr(os, "fdatasync", full)
        for begin in (lambda: LogWriter(early, SessionInfo(), "", START), begun.flush, held.flush):
            with pytest.raises(OSError, match="No space left"):
                begin()
    assert [path.name for path in tmp_path.iterdir()] == ["late.mcap"]
    assert late.stat().st_size == held.size
    assert (begun.is_empty, held.is_empty) == (True, False)


def test_names_are_on_the_disk_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[Path] = []
    monkeypatch.setattr(atomic_file, "sync_directory", synced.append)
    folder = tmp_path / "logs" / "deep"
    log_stream.create(folder / "a.mcap", overwrite=False).close()
    assert set(synced) == {folder, tmp_path / "logs", tmp_path}
    synced.clear()
    atomic_file.write(tmp_path / "b.txt", "x", overwrite=True)
    with atomic_file.part_of(tmp_path / "c.mcap", overwrite=False, mode=0o640):
        pass
    assert synced == [tmp_path, tmp_path]

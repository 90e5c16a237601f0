"""Recording leaves some of the disk free: it does not begin below the limit, and ends above zero with a whole file."""

import shutil
from pathlib import Path
from typing import NamedTuple

import pytest
from helpers.acquisitions import acquiring, mounted, mounts
from helpers.commands import imutui
from helpers.processes import wait_until

from imutui.jobs.check import check
from imutui.logbook import checksum_file
from imutui.session import lifecycle
from imutui.session.disk_space import DiskGuard
from imutui.session.plan import RecordingWish

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
        assert check(disk / "logs" / "a.mcap")["findings"] == []
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
        assert check(log)["findings"] == []
        disk.free_mb = 500.0
        assert Path(begin()) != log


def test_no_limit_is_no_guard(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Disk(monkeypatch, 0.0)
    with acquiring(home, min_free_mb=0.0) as run:
        run.record()
        assert run.seen()["recording"] is not None
        assert run.seen()["min_free_bytes"] == 0


def test_time_left_is_until_the_limit_and_half_an_hour_is_said_once() -> None:
    guard = DiskGuard(200.0)
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

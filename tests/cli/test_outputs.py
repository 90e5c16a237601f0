"""What -o names: no recording that runs is replaced, nothing that came meanwhile, and two at once do not meet."""

from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.commands import imutui
from helpers.paths import SAMPLE

from imutui.jobs import replay
from imutui.logbook import SessionInfo
from imutui.logbook.writer import LogWriter

ROWS = "".join(f"{i / 20},0.1,0.2,0.3,0,0,0.998\n" for i in range(60))
QUICK = ("replay", SAMPLE, "--filter", "spkf-paper", "--end", "5")


@pytest.mark.parametrize(
    "line",
    [
        QUICK,
        ("export", SAMPLE, "--format", "csv"),
        ("recover", SAMPLE),
        ("import", "a.csv", "--accel-sign", "+1"),
        ("apply", SAMPLE, "--effects", "effects.toml"),
    ],
)
def test_no_command_replaces_a_recording_that_runs(line: tuple[object, ...], home: Path) -> None:
    (home / "a.csv").write_text("t,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n" + ROWS)
    recording = LogWriter(home / "x.mcap", SessionInfo(), "", 0)
    before = (home / "x.mcap").stat()
    said = imutui(*line, "-o", "x.mcap", "--force", check=2).stderr
    assert "x.mcap is being written" in said
    after = (home / "x.mcap").stat()
    assert (after.st_ino, after.st_size, after.st_mode) == (before.st_ino, before.st_size, before.st_mode)
    assert not list(home.glob("*.part"))
    recording.finish({}, 0)


@pytest.mark.parametrize("beside", ["x.mcap.sha256", "x.mcap.notes.toml"])
def test_what_lies_beside_a_log_is_not_replaced_unasked(beside: str, home: Path) -> None:
    (home / "a.csv").write_text("t,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n" + ROWS)
    (home / beside).write_text("mine")
    for line in (("import", "a.csv", "--accel-sign", "+1"), ("recover", SAMPLE), QUICK):
        assert f"{beside} exists and is left as it is" in imutui(*line, "-o", "x.mcap", check=2).stderr
    assert [path.name for path in home.glob("x*")] == [beside]
    assert (home / beside).read_text() == "mine"


def test_a_campaign_does_not_take_a_table_that_is_not_its_own(home: Path) -> None:
    (home / "r").mkdir()
    (home / "r" / "results.parquet").write_text("mine")
    for line in (("campaign", SAMPLE), ("collect", "part")):
        assert "results.parquet exists and is left as it is" in imutui(*line, "-o", "r", check=2).stderr
    assert [path.name for path in (home / "r").iterdir()] == ["results.parquet"]


def meanwhile(monkeypatch: pytest.MonkeyPatch, happens: Callable[[], object]) -> None:
    """Have something happen while a replay is at work."""
    made = replay._replayed

    def at_work(*arguments: object, **wanted: object) -> replay.Replayed:
        monkeypatch.setattr(replay, "_replayed", made)
        happens()
        return made(*arguments, **wanted)  # type: ignore[arg-type]

    monkeypatch.setattr(replay, "_replayed", at_work)


def test_a_file_that_comes_while_a_replay_is_at_work_stays(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = home / "x.mcap"
    meanwhile(monkeypatch, lambda: path.write_text("mine"))
    said = imutui(*QUICK, "-o", "x.mcap", check=2).stderr
    assert "x.mcap exists and is left as it is. --force replaces it" in said
    assert path.read_text() == "mine"
    assert [one.name for one in home.glob("x.*")] == ["x.mcap"]
    path.unlink()
    begun = []
    meanwhile(monkeypatch, lambda: begun.append(LogWriter(path, SessionInfo(), "", 0)))
    assert "x.mcap is being written" in imutui(*QUICK, "-o", "x.mcap", "--force", check=2).stderr
    begun[0].finish({}, 0)


def test_two_replays_into_one_file_do_not_share_what_they_write(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = (*QUICK[:-1], "3", "-o", "x.mcap")
    meanwhile(monkeypatch, lambda: imutui(*other, check=None))
    imutui(*QUICK, "-o", "x.mcap", check=2)
    imutui("check", "x.mcap")
    first = (home / "x.mcap").read_bytes()
    meanwhile(monkeypatch, lambda: imutui(*other, "--force", check=None))
    imutui(*QUICK, "-o", "x.mcap", "--force", check=None)
    imutui("check", "x.mcap")
    assert len((home / "x.mcap").read_bytes()) > len(first)
    assert [one.name for one in home.glob("x.*")] == ["x.mcap"]

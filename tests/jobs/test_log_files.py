"""Files written beside a log, and effects files that are found again."""

import hashlib
from pathlib import Path

import pytest
from helpers import traces

from imutui.jobs import log_files
from imutui.logbook import checksum_file, effects_file, file_lock


def test_a_name_that_is_taken_gets_a_number(tmp_path: Path) -> None:
    log = tmp_path / "a.mcap"
    names = [log_files.keep(log, "_effects.toml", text).name for text in ("1", "2", "3")]
    assert names == ["a_effects.toml", "a_effects_2.toml", "a_effects_3.toml"]
    assert (tmp_path / "a_effects_2.toml").read_text() == "2"
    assert log_files.free_name(log, "_effects.toml").name == "a_effects_4.toml"


def test_files_of_several_logs_are_told_apart(tmp_path: Path) -> None:
    logs = [tmp_path / f"imu400cd_991_20261121T{hour:02d}0000Z.mcap" for hour in range(20)]
    names = [log_files.base(logs[:n]).name for n in (1, 2, 3, 19, 20)]
    assert names[:2] == [logs[0].name, "imu400cd_991_20261121T000000Z_with_20261121T010000Z.mcap"]
    assert len(set(names)) == 5
    assert max(len(name) for name in names) < 180


def test_a_log_takes_its_own_files_along(tmp_path: Path) -> None:
    for name in ("a", "a_recovered", "b"):
        (tmp_path / f"{name}.mcap").write_text(name)
    log = tmp_path / "a.mcap"
    checksum_file.write(log, hashlib.sha256(b"a").hexdigest(), 0o640)
    own = ["a.mcap.notes.toml", "a_effects_2.toml", "a_replay.json", "a_trace.json"]
    others = ["a_recovered_info.json", "a_with_b_trace.json", "ab_trace.json", "a.txt"]
    for name in (*own, *others):
        (tmp_path / name).write_text(name)
    assert [path.name for path in log_files.of(log).beside] == sorted(["a.mcap.sha256", *own])
    with pytest.raises(ValueError, match=r"b\.mcap exists"):
        log_files.rename(log, "b")
    for wrong in ("", "../x", ".hidden", "a\nb", "x" * 300):
        with pytest.raises(ValueError, match=r"name"):
            log_files.rename(log, wrong)
    now = log_files.rename(log, "cold start")
    assert now.name == "cold start.mcap"
    assert checksum_file.path_of(now).read_text().endswith("  cold start.mcap\n")
    assert (tmp_path / "cold start_effects_2.toml").read_text() == "a_effects_2.toml"
    with now.open("r+b") as stream:
        file_lock.claim(stream)
        with pytest.raises(ValueError, match="being written"):
            log_files.delete(now)
        with pytest.raises(ValueError, match="being written"):
            log_files.rename(now, "c")
    assert len(log_files.delete(now)) == 6
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["a_recovered.mcap", "b.mcap", *others])


def test_effects_files_are_told_from_other_settings(tmp_path: Path) -> None:
    (tmp_path / "found.toml").write_text(effects_file.dumps(traces.trace(), "trace of a.mcap"))
    (tmp_path / "none.toml").write_text(effects_file.dumps(traces.nothing(), "trace of b.mcap"))
    (tmp_path / "broken.toml").write_text('version = 1\nsource = "x"\ninclude_as = 3\n')
    (tmp_path / "scenario.toml").write_text('seed = 1\n[[effect]]\nname = "thermal_lin"\nchannel = "gy"\n')
    files = {file.path.name: file for file in log_files.effects_files([tmp_path])}
    assert sorted(files) == ["broken.toml", "found.toml", "none.toml"]
    assert files["found.toml"].effects == ("thermal_lin (gy)", "gauss_markov (gx)")
    assert files["found.toml"].source == "trace of a.mcap"
    assert files["none.toml"].effects == ()
    assert files["broken.toml"].error

"""Files written beside a log, and effects files that are found again."""

from pathlib import Path

from helpers import traces

from imutui.jobs import sidecar_files
from imutui.logbook import effects_file


def test_a_name_that_is_taken_gets_a_number(tmp_path: Path) -> None:
    """Nothing is overwritten, and every file says of which log it is."""
    log = tmp_path / "a.mcap"
    names = [sidecar_files.keep(log, "_effects.toml", text).name for text in ("1", "2", "3")]
    assert names == ["a_effects.toml", "a_effects_2.toml", "a_effects_3.toml"]
    assert (tmp_path / "a_effects_2.toml").read_text() == "2"
    assert sidecar_files.free_name(log, "_effects.toml").name == "a_effects_4.toml"


def test_effects_files_are_told_from_other_settings(tmp_path: Path) -> None:
    """Scenarios and profiles are no effects; a broken file says why."""
    (tmp_path / "found.toml").write_text(effects_file.dumps(traces.trace(), "trace of a.mcap"))
    (tmp_path / "none.toml").write_text(effects_file.dumps(traces.nothing(), "trace of b.mcap"))
    (tmp_path / "broken.toml").write_text('version = 1\nsource = "x"\ninclude_as = 3\n')
    (tmp_path / "scenario.toml").write_text('seed = 1\n[[effect]]\nname = "thermal_lin"\nchannel = "gy"\n')
    files = {file.path.name: file for file in sidecar_files.effects_files([tmp_path])}
    assert sorted(files) == ["broken.toml", "found.toml", "none.toml"]
    assert files["found.toml"].effects == ("thermal_lin (gy)", "gauss_markov (gx)")
    assert files["found.toml"].source == "trace of a.mcap"
    assert files["none.toml"].effects == ()
    assert files["broken.toml"].error

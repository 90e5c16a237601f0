"""Profiles that need no file: by name wherever a profile's file is taken."""

from pathlib import Path

import pytest

from imutui.jobs import operator_steps
from imutui.logbook import import_reference, reference_file
from imutui.scenario import ScenarioError, load_scenario

NAMES = [made.name for made in reference_file.ready_made()]


@pytest.mark.parametrize("name", NAMES)
def test_a_name_does_wherever_a_profiles_file_does(name: str, tmp_path: Path) -> None:
    wanted = reference_file.find(name)
    assert wanted is not None
    (tmp_path / "scenario.toml").write_text(f'profile = "{name}"\n')
    reference = import_reference.from_text(name)
    offer = operator_steps.offer_of(Path(name))
    assert reference is not None
    for text in (wanted.text, reference.content.decode(), offer.text):
        assert reference_file.parse("p.toml", text.encode()) == wanted.profile
    assert load_scenario(tmp_path / "scenario.toml").profile == wanted.profile
    assert load_scenario(Path(name)).profile == wanted.profile


def test_capitals_and_spaces_do_not_count_and_a_file_of_the_name_goes_first(tmp_path: Path) -> None:
    assert reference_file.find("Six positions,  each axis +-30 +-90 deg/s") == reference_file.ready_made()[2]
    (tmp_path / NAMES[0]).write_text('[[segment]]\nkind = "dwell"\nangles_deg = [0.0, 0.0, 0.0]\nseconds = 9.0\n')
    (tmp_path / "scenario.toml").write_text(f'profile = "{NAMES[0]}"\n')
    profile = load_scenario(tmp_path / "scenario.toml").profile
    assert profile is not None
    assert len(profile.segments) == 1


def test_an_unknown_name_is_answered_with_those_there_are(tmp_path: Path) -> None:
    (tmp_path / "scenario.toml").write_text('profile = "seven positions"\n')
    said = [operator_steps.offer_of(Path("seven positions")).error]
    with pytest.raises(ValueError, match="level, gravity, turned") as refused:
        import_reference.from_text("seven positions")
    said.append(str(refused.value))
    for scenario in (tmp_path / "scenario.toml", Path("seven positions")):
        with pytest.raises(ScenarioError) as caught:
            load_scenario(scenario)
        said.append(str(caught.value))
    assert all(f'"{name}"' in message for name in NAMES for message in said), said
    assert import_reference.from_text("level") is None

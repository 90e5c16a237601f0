"""Table profiles as TOML documents: what is read, what is written, what is refused."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from filters.motion.profile import Profile, from_samples
from filters.motion.segments import Dwell, Rate, Sine
from imutui.jobs import operator_steps
from imutui.logbook import import_reference, reference_file
from imutui.logbook.reference_file import from_document, to_toml
from imutui.scenario import ScenarioError, load_scenario

DEG = np.pi / 180.0
DOCUMENT = """
align = "marks"
sign = [1, 1, -1]
offset_sd_s = 0.05
slew_dps = 30
accel_dps2 = 200.0
[[segment]]
kind = "dwell"
angles_deg = [0, 90.0, 0]
seconds = 30
[[segment]]
kind = "rate"
axis = "inner"
rate_dps = -30.0
seconds = 12.0
[[segment]]
kind = "sine"
axis = "middle"
amplitude_deg = 10.0
hz = 0.5
seconds = 20.0
"""


def test_a_document_is_the_profile_it_describes() -> None:
    assert from_document(tomllib.loads(DOCUMENT)) == Profile(
        (
            Dwell((0.0, 90 * DEG, 0.0), 30.0),
            Rate("inner", -30 * DEG, 12.0),
            Sine("middle", 10 * DEG, 0.5, 20.0),
        ),
        (1, 1, -1),
        "marks",
        0.05,
        np.deg2rad(30.0),
        np.deg2rad(200.0),
    )


DWELL = {"kind": "dwell", "angles_deg": [0, 0, 0], "seconds": 1}
RATE = {"kind": "rate", "axis": "inner", "rate_dps": 5, "seconds": 1}
SINE = {"kind": "sine", "axis": "inner", "amplitude_deg": 5, "hz": 1, "seconds": 1}
WRONG: list[tuple[dict[str, Any], list[str]]] = [
    ({}, ["`segment` is missing"]),
    ({"segment": []}, ["`segments` is empty", "at least one"]),
    ({"segment": [DWELL], "speed": 3}, ["`speed` is unknown", "slew_dps"]),
    ({"segment": [DWELL], "align": "gps"}, ["`align`", "gps", "marks"]),
    ({"segment": [DWELL], "sign": [1, 1]}, ["`sign`", "[1, 1]"]),
    ({"segment": [DWELL], "sign": [1, 2, 1]}, ["item 2 of `sign` is 2", "-1, 1"]),
    ({"segment": [DWELL], "slew_dps": 0}, ["`slew_dps` is 0"]),
    ({"segment": [DWELL], "accel_dps2": "fast"}, ["`accel_dps2`", "fast"]),
    ({"segment": [DWELL], "offset_sd_s": -1}, ["`offset_sd_s` is -1"]),
    ({"segment": [DWELL, {"kind": "spin"}]}, ["segment 2", "`kind`", "spin", "sine"]),
    ({"segment": ["dwell"]}, ["item 1 of `segment`", "[[segment]]"]),
    ({"segment": [DWELL | {"seconds": 0}]}, ["segment 1", "`seconds` is 0"]),
    ({"segment": [DWELL | {"angles_deg": [0, 0]}]}, ["`angles_deg`", "[0, 0]"]),
    ({"segment": [DWELL | {"axis": "inner"}]}, ["`axis` is unknown"]),
    ({"segment": [RATE | {"axis": "yaw"}]}, ["`axis`", "yaw", "middle"]),
    ({"segment": [RATE | {"rate_dps": 0}]}, ["`rate_dps` is 0"]),
    ({"segment": [RATE | {"rate_dps": float("nan")}]}, ["`rate_dps`", "nan"]),
    ({"segment": [SINE | {"hz": -1}]}, ["`hz` is -1"]),
    ({"segment": [{"kind": "sine", "axis": "inner", "hz": 1, "seconds": 1}]}, ["`amplitude_deg` is missing"]),
]


@pytest.mark.parametrize(("document", "words"), WRONG)
def test_a_wrong_document_is_refused_by_key_and_value(document: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ValueError, match="`") as caught:
        from_document(document)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_what_is_written_reads_as_the_same_profile() -> None:
    profile = from_document(tomllib.loads(DOCUMENT))
    assert from_document(tomllib.loads(to_toml(profile))) == profile
    assert reference_file.parse("tumble.toml", to_toml(profile).encode()) == profile


def test_sampled_angles_are_not_written_as_a_document() -> None:
    with pytest.raises(ValueError, match="CSV"):
        to_toml(from_samples([0.0, 1.0], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]))


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

"""What segments make testable, by cases whose answer is known; profiles that are offered."""

import itertools
import math
from pathlib import Path

import numpy as np
from helpers.commands import imutui, imutui_json
from helpers.documents import dwell, profile_toml, rate, sine

from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sine
from filters.tracing import detectability
from filters.tracing.detectability import TESTABLE, Quantity
from imutui.jobs import operator_steps

UP = Dwell((0.0, 0.0, 0.0), 60.0)
DOWN = Dwell((math.pi, 0.0, 0.0), 60.0)
SEGMENTS = dwell(12.5, middle=90.0), rate("inner", -30.0, 4.0), sine("middle", 10.0, 0.5, 20.0)
TOML = profile_toml(*SEGMENTS, align="none")


def d_of(profile: Profile, effect: str, channel: str, axis: str = "") -> list[float]:
    return [told[Quantity(effect, channel, axis)] for told in detectability.of_motion(profile)]


def test_a_still_level_table_shows_biases_and_sums_of_biases_only() -> None:
    """Nothing moves, so an accelerometer's bias is what tilt and scale factor make too."""
    (items,) = operator_steps.makes_observable(Profile((UP,), align="marks"))
    assert items == [
        "bias gx gy gz",
        "bias ax ay az in sum with scale factor, misalignment, tilt of base",
    ]


def test_longer_at_rest_tells_no_sum_apart() -> None:
    for seconds in (60.0, 3600.0):
        profile = Profile((Dwell((0.0, 0.0, 0.0), seconds),), align="marks")
        assert d_of(profile, "scale", "az")[0] < TESTABLE
        assert d_of(profile, "bias", "az")[0] < TESTABLE


def test_z_up_and_down_tells_bias_and_scale_factor_of_az_apart() -> None:
    """The reading of gravity changes its sign, the bias does not; the gyros see gravity along z."""
    first, second = operator_steps.makes_observable(Profile((UP, DOWN), align="marks"))
    assert not any(item.startswith("scale factor") for item in first)
    assert second[0].startswith("bias")
    assert "az" in second[0]
    assert any(item.startswith("scale factor") and "az" in item for item in second)
    assert "g-sensitivity gx gy gz to z" in second
    assert not any("scale factor gz" in item for item in second)


def test_a_rate_segment_tells_the_scale_factor_of_its_gyro() -> None:
    """And its two directions tell asymmetry."""
    turns = (Rate("inner", math.radians(30.0), 12.0), Rate("inner", math.radians(-30.0), 12.0))
    level, one, other = operator_steps.makes_observable(Profile((UP, *turns), align="gyro"))
    assert not any("scale factor gz" in item for item in level)
    assert "scale factor gz" in one
    assert "misalignment gx gy to z" in one
    assert any("asymmetry gz" in item for item in other)


def test_a_profile_joined_by_marks_counts_at_rest_only() -> None:
    """Nobody knows when the operator turned the table."""
    turn = Rate("inner", math.radians(30.0), 12.0)
    by_marks, by_gyro = (d_of(Profile((UP, turn), align=a), "scale", "gz")[-1] for a in ("marks", "gyro"))
    assert by_marks < TESTABLE < by_gyro


def test_more_motion_never_tells_less() -> None:
    swing = Sine("outer", math.radians(20.0), 0.3, 10.0)
    told = detectability.of_motion(Profile((UP, DOWN, Rate("inner", 0.5, 10.0), swing)))
    for before, after in itertools.pairwise(told):
        assert all(after[q] >= before[q] - 1e-6 * (1.0 + before[q]) for q in before)


def test_six_positions_tell_all_biases_and_scale_factors_of_the_accelerometers() -> None:
    """The ready-made profile is worth a newcomer's four minutes."""
    six = operator_steps.ready_made()[0]
    items = " | ".join(
        item for step in operator_steps.steps(operator_steps.load(six.file, six.text)) for item in step.shows
    )
    for word in ("bias ax ay az", "scale factor ay az", "scale factor ax", "g-sensitivity", "tilt of base"):
        assert word in items


def test_every_ready_made_profile_reads_back() -> None:
    for offer in operator_steps.ready_made():
        profile = operator_steps.load(offer.file, offer.text)
        assert (len(profile.segments), profile.align) == (offer.segments, offer.align)
        assert offer.seconds == profile.duration


def test_what_to_do_is_said_with_units() -> None:
    steps = operator_steps.steps(operator_steps.load("a.toml", TOML))
    assert [(step.text, step.seconds) for step in steps] == [
        ("go to outer 0°, middle 90°, inner 0°", 12.5),
        ("turn inner at -30 deg/s", 4.0),
        ("swing middle by ±10° at 0.5 Hz", 20.0),
    ]


def test_files_that_are_meant_as_profiles_are_offered_and_bad_ones_say_why(tmp_path: Path) -> None:
    (tmp_path / "good.toml").write_text(TOML)
    (tmp_path / "bad.toml").write_text(TOML.replace('"rate"', '"spin"'))
    (tmp_path / "angles.csv").write_text("t, outer, middle, inner\n0,0,0,0\n10,0,0,0\n")
    (tmp_path / "path.csv").write_text("t,lat,lon,h,vn,ve,vd\n0,1,2,3,0,0,0\n")
    (tmp_path / "imutui.toml").write_text('[paths]\nlogs = "x"\n')
    ready = len(operator_steps.ready_made())
    found = {offer.name: offer for offer in operator_steps.offers([tmp_path, tmp_path, tmp_path / "none"])[ready:]}
    assert sorted(found) == ["angles.csv", "bad.toml", "good.toml"]
    assert "segment 2: `kind` is 'spin'" in found["bad.toml"].error
    assert found["good.toml"].segments == 3
    assert not found["good.toml"].error


def test_each_segment_is_looked_at_once_however_many_there_are() -> None:
    """Rows of all segments, and not all rows for each segment."""
    number = np.array([1, 0, 0, -1, 2, 2, 0])
    rows = detectability._rows_of_segments(number, 4)
    assert [own.tolist() for own in rows] == [np.flatnonzero(number == k).tolist() for k in range(4)]


def test_samples_of_a_virtual_units_profile_are_refused_with_what_does_instead(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text('samples = "angles.csv"\n')
    assert "here name the CSV file itself, whose heading is t,outer,middle,inner" in operator_steps.offer_of(path).error


def test_a_file_that_is_not_there_and_a_trajectory_say_so(tmp_path: Path) -> None:
    assert "No such file" in operator_steps.offer_of(tmp_path / "none.toml").error
    assert operator_steps.offer_of(tmp_path).error == operator_steps.offer_of(Path("/dev/zero")).error == "is no file"
    (tmp_path / "path.csv").write_text("t,lat,lon,h,vn,ve,vd\n0,1,2,3,0,0,0\n1,1,2,3,0,0,0\n")
    assert operator_steps.offer_of(tmp_path / "path.csv").error


def test_a_profile_by_hand_is_joined_by_marks() -> None:
    offer = operator_steps.Offer("a", "", TOML, "a.toml", 3, 0.0, "none")
    by_hand = operator_steps.by_hand(offer)
    assert by_hand is not None
    made, was = operator_steps.load("a.toml", by_hand.text), operator_steps.load("a.toml", TOML)
    assert made.align == "marks"
    assert made.segments == was.segments
    angles = "t, outer, middle, inner\n0,0,0,0\n10,0,0,0\n"
    assert operator_steps.by_hand(operator_steps.Offer("b", "", angles, "b.csv", 1, 10.0, "none")) is None


def test_the_command_prints_the_guided_list(home: Path) -> None:
    (home / "a.toml").write_text(TOML)
    printed = imutui("profile", "a.toml").stdout
    assert "turn inner at -30 deg/s, 4 s" in printed
    assert "makes testable: bias gx gy gz" in printed
    document = imutui_json("profile", "six positions, 30 s each")
    assert set(document) == {"version", "profile", "align", "duration_s", "segments"}
    assert set(document["segments"][2]) == {"number", "text", "seconds", "makes_testable"}
    assert document["segments"][2]["makes_testable"][0] == "bias ax ay az"
    listed = imutui_json("profile")
    assert [entry["name"] for entry in listed][-1] == "a.toml"
    assert "can't be read" in imutui("profile", "none.toml", check=3).stderr


def test_the_command_exports_a_profile_and_replaces_none(home: Path) -> None:
    imutui("profile", "six positions, 30 s each", "-o", "six.toml")
    copied = operator_steps.offer_of(home / "six.toml")
    assert copied.text == operator_steps.ready_made()[0].text
    assert "--force" in imutui("profile", "six.toml", "-o", "six.toml", check=2).stderr
    assert ".toml" in imutui("profile", "six.toml", "-o", "six.csv", check=2).stderr

"""The guide through a table's profile, on a clock of the test's own; and the table of a virtual unit."""

from pathlib import Path

import numpy as np
import pytest
from helpers.documents import dwell, profile_toml
from helpers.processes import wait_until

from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sampled, Segment, Sine
from imutui.cli.demo import truth
from imutui.logbook import reader
from imutui.session import client, guidance
from imutui.session.guidance import Guide
from imutui.session.plan import VIRTUAL_PORT, Plan

S = 1_000_000_000
PROFILE = Profile(
    (Dwell((0.0, 0.0, 0.0), 5.0), Rate("inner", 0.5, 4.0), Dwell((0.0, 1.5707963267948966, 0.0), 8.0)),
    align="marks",
    accel=0.5,
)


def test_it_waits_for_ever_and_holds_for_each_segments_own_time() -> None:
    one = Guide(PROFILE)
    marks = []
    now = 0
    for k, seconds in enumerate((5.0, 6.0, 8.0)):
        now += 1_000_000 * S
        assert one.snapshot(now, 0) | {"begun": None} == {
            "state": "go", "segment": k, "count": 3, "left_s": None, "begun": None
        }  # fmt: skip
        marks.append(one.do("next", now, recording=True))
        assert one.snapshot(now, 0)["left_s"] == pytest.approx(seconds)
        before = one.snapshot(now + round((seconds - 0.001) * S), 0)
        assert (before["state"], before["segment"]) == ("hold", k)
        now += round(seconds * S)
    assert marks == ["segment 1", "segment 2", "segment 3"]
    end = one.snapshot(now, 1_000_000 * S)
    assert (end["state"], end["segment"], end["left_s"]) == ("done", 2, None)
    assert end["begun"] == pytest.approx([0.0, 1_000_005.0, 2_000_011.0])


def test_what_was_cancelled_half_done_is_done_again() -> None:
    one = Guide(PROFILE)
    one.do("next", 0, recording=True)
    one.do("next", 5 * S, recording=True)
    assert one.cancel(6 * S) == "segment 2 ends"
    assert one.snapshot(6 * S, 0)["begun"] == [0.0, None, None]
    assert one.snapshot(60 * S, 0)["state"] == "cancelled"
    one.do("resume", 61 * S, recording=True)
    assert (one.state, one.segment) == ("go", 1)
    # on the way there is nothing that has begun
    assert one.cancel(61 * S) is None
    one.do("resume", 61 * S, recording=True)
    assert one.do("next", 62 * S, recording=True) == "segment 2"


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        (("next", "next"), "under way for another 5 s; wait, or cancel"),
        (("cancel", "cancel"), "cancelled; resume it"),
        (("cancel", "next"), "cancelled; resume it"),
        (("resume",), "nothing to resume"),
        (("leap",), "not one of: begin, next, cancel, resume"),
    ],
)
def test_what_cannot_be_done_now_is_refused_with_what_can(steps: tuple[str, ...], words: str) -> None:
    one = Guide(PROFILE)
    for step in steps[:-1]:
        one.do(step, 0, recording=True)
    state = one.snapshot(0, 0)
    with pytest.raises(ValueError, match=words):
        one.do(steps[-1], 0, recording=True)
    assert one.snapshot(0, 0) == state


def test_the_end_of_the_recording_cancels_what_is_under_way_only() -> None:
    done = Guide(Profile(PROFILE.segments[:1], align="marks"))
    done.do("next", 0, recording=True)
    done.recording_ended(5 * S)
    assert done.state == "done"
    cut = Guide(PROFILE)
    cut.recording_ended(0)
    assert cut.state == "cancelled"
    with pytest.raises(ValueError, match="begin again"):
        cut.do("resume", 0, recording=False)


def test_a_profile_that_goes_by_its_own_clock_has_no_guide_unless_nothing_is_filtered() -> None:
    """The filter would not wait for the operator; without a filter there is nobody to be misled."""
    clocked = Profile(PROFILE.segments)
    with pytest.raises(ValueError, match='align = "marks"'):
        guidance.guided(clocked, "spkf")
    assert guidance.guided(clocked, "none") is clocked
    assert guidance.guided(PROFILE, "spkf") is PROFILE
    with pytest.raises(ValueError, match="no profile"):
        guidance.guided(None, "spkf")


class Recorded:
    """A mover that is told where to go, and has arrived when a test says so."""

    has_ramps = False

    def __init__(self) -> None:
        self.told: list[object] = []
        self.is_there = False

    def go(self, profile: Profile, segment: Segment, now_ns: int) -> None:
        self.told.append(segment)

    def has_arrived(self, now_ns: int) -> bool:
        there, self.is_there = self.is_there, False
        return there

    def leave(self) -> None:
        self.told.append("leave")


def test_a_mover_is_sent_to_each_segment_once_and_left_when_the_guide_is_cancelled() -> None:
    mover = Recorded()
    one, (first, second, _) = Guide(PROFILE, mover), PROFILE.segments  # type: ignore[arg-type]
    assert (one.look(0), one.look(S)) == (None, None)
    with pytest.raises(ValueError, match="by itself"):
        one.do("next", S, recording=True)
    mover.is_there = True
    assert one.look(2 * S) == "segment 1"
    assert one.look(7 * S) is None
    one.do("cancel", 8 * S, recording=True)
    assert one.look(9 * S) is None
    one.do("resume", 9 * S, recording=True)
    one.look(9 * S)
    assert mover.told == [first, second, "leave", second]


def test_segments_are_described_as_the_operator_sets_them() -> None:
    sampled = Sampled((10.0, 12.0, 13.0), ((0.0, 0.0, 0.0),) * 3)
    (recorded,) = guidance.describe(Profile((sampled,)), "angles.csv")["segments"]
    assert (recorded["kind"], recorded["seconds"]) == ("sampled", 3.0)
    swing = Sine("middle", 0.17453292519943295, 0.5, 20.0)
    told = guidance.describe(Profile((*PROFILE.segments, swing), accel=0.5), "tumble.toml")
    assert told["name"] == "tumble.toml"
    assert [one["kind"] for one in told["segments"]] == ["dwell", "rate", "dwell", "sine"]
    assert told["segments"][2]["text"] == "go to outer 0°, middle 90°, inner 0°"
    assert told["segments"][3]["text"] == "swing middle by ±10° at 0.5 Hz"
    assert [one["seconds"] for one in told["segments"]] == pytest.approx([5.0, 6.0, 8.0, 24.0])


# The table of a virtual unit of an acquisition's own is under command, and what is recorded is right

TURNED = profile_toml(dwell(10.0), dwell(10.0, 90.0), dwell(10.0, middle=-90.0), align="marks", slew_dps=60.0)


def test_a_profile_is_gone_through_on_a_virtual_unit_and_its_biases_are_found(home: Path) -> None:
    plan = Plan(
        VIRTUAL_PORT,
        rate_hz=20.0,
        logs=str(home / "logs"),
        reference="profile",
        reference_file=("three.toml", TURNED),
        virtual=("--seed", "3"),
        controller=VIRTUAL_PORT,
    )
    connection = client.start(plan, timeout=90.0)
    connection.guide("begin", yes_move=True)
    wait_until(lambda: (connection.snapshot(2**62)["guide"] or {}).get("state") == "done")
    result = connection.stop()["result"] or {}
    marks = [event.text for event in reader.read(Path(result["log"])).events if event.name == "mark"]
    assert marks == ["segment 1", "segment 2", "segment 3"]
    found, true = result["final"], truth(3)
    for name in ("gyro_bias_dps", "accel_bias_mg"):
        error = np.subtract(found[name], true[name]) / result["sd"][name]
        assert np.abs(error).max() < 3.0, (name, error)

"""The guide through a table's profile, on a clock of the test's own; and the virtual unit that it turns."""

from pathlib import Path

import numpy as np
import pytest
from helpers.documents import dwell, profile_toml
from helpers.processes import wait_until

from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sampled, Sine
from filters.simulation import Scenario
from imutui.cli.demo import truth
from imutui.cli.virtual_readings import SimulatedReadings, TurnedReadings
from imutui.logbook import reader
from imutui.session import client, operator_guide, table_turner
from imutui.session.operator_guide import Guide
from imutui.session.plan import VIRTUAL_PORT, Plan
from imutui.session.table_turner import TableTurner

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
            "state": "go", "segment": k, "count": 3, "left_s": None, "begun": None, "turns_s": None
        }  # fmt: skip
        marks.append(one.arrive(now))
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
    one.arrive(0)
    one.arrive(5 * S)
    assert one.cancel(6 * S) == "segment 2 ends"
    assert one.snapshot(6 * S, 0)["begun"] == [0.0, None, None]
    assert one.snapshot(60 * S, 0)["state"] == "cancelled"
    one.resume()
    assert (one.state, one.segment) == ("go", 1)
    # on the way there is nothing that has begun
    assert one.cancel(61 * S) is None
    one.resume()
    assert one.arrive(62 * S) == "segment 2"


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
    done.arrive(0)
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
        operator_guide.begin_guide(clocked, "spkf", None, recording=False)
    assert operator_guide.begin_guide(clocked, "none", None, recording=False).state == "go"
    assert operator_guide.begin_guide(PROFILE, "spkf", None, recording=True).state == "go"
    with pytest.raises(ValueError, match="no profile"):
        operator_guide.begin_guide(None, "spkf", None, recording=False)
    with pytest.raises(ValueError, match="cancel it first"):
        operator_guide.begin_guide(PROFILE, "spkf", Guide(PROFILE), recording=True)


def test_segments_are_described_as_the_operator_sets_them() -> None:
    sampled = Sampled((10.0, 12.0, 13.0), ((0.0, 0.0, 0.0),) * 3)
    (recorded,) = operator_guide.describe(Profile((sampled,)), "angles.csv")["segments"]
    assert (recorded["kind"], recorded["seconds"]) == ("sampled", 3.0)
    swing = Sine("middle", 0.17453292519943295, 0.5, 20.0)
    told = operator_guide.describe(Profile((*PROFILE.segments, swing), accel=0.5), "tumble.toml")
    assert told["name"] == "tumble.toml"
    assert [one["kind"] for one in told["segments"]] == ["dwell", "rate", "dwell", "sine"]
    assert told["segments"][2]["text"] == "go to outer 0°, middle 90°, inner 0°"
    assert told["segments"][2]["angles_deg"] == [0.0, 90.0, 0.0]
    assert told["segments"][3]["text"] == "swing middle by ±10° at 0.5 Hz"
    assert [one["seconds"] for one in told["segments"]] == pytest.approx([5.0, 6.0, 8.0, 24.0])
    keys = {"kind", "angles_deg", "axis", "rate_dps", "amplitude_deg", "hz", "seconds", "text"}
    assert all(one.keys() == keys for one in [*told["segments"], recorded])


# A virtual unit of an acquisition's own turns as the operator of a profile says, and what is recorded is right

TURNED = profile_toml(dwell(10.0), dwell(10.0, 90.0), dwell(10.0, middle=-90.0), align="marks", slew_dps=60.0)


def test_the_unit_reads_the_motion_that_the_turner_knows() -> None:
    lines: list[str] = []
    turner = TableTurner(lines.append)
    steps = [Dwell((np.pi / 2, 0.0, 0.0), 5.0), Dwell((np.pi / 2, 0.0, 1.0), 5.0), Rate("inner", 0.5, 2.0)]
    profile = Profile(tuple(steps), sign=(1, 1, -1), align="marks")
    now = 0
    still = SimulatedReadings(Scenario(seed=3))
    turned = TurnedReadings(SimulatedReadings(Scenario(seed=3)), still.unit)
    rate_hz, k = still.unit.rate_hz, 0
    for step in steps:
        turner.turn(profile, step, now)
        with pytest.raises(ValueError, match="turns for another"):
            turner.turn(profile, step, now)
        turned.turn(lines[-1])
        motion = table_turner.motion_of(lines[-1])
        angle = np.zeros(3)
        for _ in range(int((motion.duration + 0.1) * rate_hz)):
            difference = np.subtract(turned.reading(k).rates_dps, still.reading(k).rates_dps)
            angle += difference / rate_hz
            k += 1
        # of what turns about the vertical, and by less than the whole, only the axis that is vertical tells
        moved = np.rad2deg(motion.angles(motion.duration) - motion.angles(0.0))[0]
        assert np.abs(np.abs(angle).max() - np.abs(moved).max()) < 0.5
        assert not turner.has_arrived(now)
        now += round((motion.duration + 1.0) * 1e9)
        assert turner.has_arrived(now)
        assert not turner.has_arrived(now)
    x, y, z = turned.reading(k).accels_g
    assert abs(np.hypot(x, y) - 1.0) < 0.1  # on its side, as the first of them left it
    assert abs(z) < 0.1


def test_a_profile_is_gone_through_on_a_virtual_unit_and_its_biases_are_found(home: Path) -> None:
    plan = Plan(
        VIRTUAL_PORT,
        rate_hz=20.0,
        logs=str(home / "logs"),
        reference="profile",
        reference_file=("three.toml", TURNED),
        virtual=("--seed", "3"),
    )
    connection = client.start(plan, timeout=90.0)

    def guide() -> dict:  # type: ignore[type-arg]
        return dict(connection.snapshot(2**62)["guide"] or {})

    connection.guide("begin")
    for step in range(3):
        wait_until(lambda step=step: (guide()["state"], guide()["segment"]) == ("go", step))  # type: ignore[misc]
        connection.guide("next")
        if step:
            assert guide()["turns_s"] > 0.0
        wait_until(lambda: guide()["state"] in ("hold", "done"))
    wait_until(lambda: guide()["state"] == "done")
    result = connection.stop() or {}
    marks = [event.text for event in reader.read(Path(result["log"])).events if event.name == "mark"]
    assert marks == ["segment 1", "segment 2", "segment 3"]
    found, true = result["final"], truth(3)
    for name in ("gyro_bias_dps", "accel_bias_mg"):
        error = np.subtract(found[name], true[name]) / result["sd"][name]
        assert np.abs(error).max() < 3.0, (name, error)

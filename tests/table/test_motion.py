"""What is refused of motions and profiles, and what is taken for a table that does not follow."""

import math
from dataclasses import replace

import pytest

from filters.errors import InputError
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sine
from imutui.table.follower import Expected, Follower
from imutui.table.motion import (
    AxisLimits,
    Begin,
    Motion,
    Move,
    Readings,
    Swing,
    TableState,
    Turn,
    braking_deg,
    check_profile,
    narrower,
    of_segment,
    parse_limits,
)

INNER = AxisLimits(200.0, 100.0, None, None)
OUTER = AxisLimits(30.0, 50.0, -90.0, 90.0)
LIMITS = {"outer": OUTER, "inner": INNER}
LEVEL = (0.0, 0.0, 0.0)


def rad(*degrees: float) -> tuple[float, float, float]:
    o, m, i = map(math.radians, degrees)
    return o, m, i


def test_limits_are_read_as_they_are_written() -> None:
    assert parse_limits("inner=200/100, outer=30/50/-90/90") == LIMITS
    assert parse_limits("") == {}


@pytest.mark.parametrize("text", ["inner", "inner=200", "inner=0/100", "up=1/2", "outer=1/2/3/3", "inner=nan/1"])
def test_limits_that_are_none_are_refused_with_an_example(text: str) -> None:
    with pytest.raises(InputError, match="outer=30/50/-90/90"):
        parse_limits(text)


def test_of_two_limits_the_narrower_counts() -> None:
    given = {"inner": AxisLimits(50.0, 300.0, -10.0, None), "middle": OUTER}
    assert narrower(LIMITS, given) == {
        "outer": OUTER,
        "middle": OUTER,
        "inner": AxisLimits(50.0, 100.0, -10.0, None),
    }


@pytest.mark.parametrize(
    ("motion", "why"),
    [
        (Move("outer", 91.0, 10.0, 50.0), "91 deg; its limits are -90 to 90"),
        (Move("outer", math.inf, 10.0, 50.0), "inf deg"),
        (Move("outer", 10.0, 31.0, 50.0), "31 deg/s; its limit is 30"),
        (Move("outer", 10.0, 10.0, 51.0), r"51 deg/s\^2; its limit is 50"),
        (Move("outer", 10.0, 0.0, 50.0), "positive"),
        (Move("outer", 10.0, math.nan, 50.0), "nan deg/s"),
        (Turn("inner", -201.0, 50.0), "201 deg/s; its limit is 200"),
        (Turn("inner", -20.0, 0.0), "positive"),
        (Turn("outer", 20.0, 1.0), "turns by 202"),
        (Turn("up", 1.0, 1.0), "not one of: outer"),
        (Swing("inner", 50.0, 2.0, 100.0), "628.319 deg/s"),
        (Swing("inner", 1.0, 0.0, 100.0), "not a size and a frequency"),
    ],
)
def test_a_motion_beyond_limits_is_refused(motion: Motion, why: str) -> None:
    with pytest.raises(InputError, match=why):
        motion.check(Begin(0.0), LIMITS)


@pytest.mark.parametrize("motion", [Move("inner", 10.0, 20.0, 50.0), Swing("inner", 1.0, 0.5, 100.0)])
def test_an_axis_that_turns_is_neither_moved_nor_swung(motion: Motion) -> None:
    with pytest.raises(InputError, match=r"turns, at 5\.00 deg/s; have it stand first"):
        motion.check(Begin(0.0, 5.0, 50.0), LIMITS)


def test_what_is_expected_of_a_turn_is_added_to_the_rate_that_the_axis_has() -> None:
    """From one rate straight to another, and on at it for as long as need be."""
    model = Expected(Turn("inner", -20.0, 50.0), Begin(5.0, 30.0), 0.0, 0.0)
    assert model.at(0.5) == pytest.approx((5.0 + 30.0 * 0.5 - 25.0 * 0.25, 5.0))
    assert model.at(1001.0) == pytest.approx((5.0 + 5.0 - 20.0 * 1000.0, -20.0))


@pytest.mark.parametrize(
    ("segments", "number", "why"),
    [
        ([Dwell(rad(0, 0, 0), 5.0), Dwell(rad(95, 0, 0), 5.0)], 2, "90"),
        ([Dwell(rad(0, 10, 0), 5.0)], 1, "no middle axis"),
        ([Rate("inner", math.radians(250.0), 5.0)], 1, "200"),
        ([Dwell(rad(0, 0, 0), 5.0), Rate("outer", math.radians(20.0), 5.0)], 2, "it has 86.0 deg to its limit"),
        ([Sine("outer", math.radians(5.0), 2.0, 5.0)], 1, "30"),
        ([Dwell(rad(85, 0, 0), 5.0), Sine("outer", math.radians(10.0), 0.1, 5.0)], 2, "90"),
    ],
)
def test_a_profile_that_goes_beyond_limits_is_refused_with_its_segments_number(
    segments: list[Dwell | Rate | Sine], number: int, why: str
) -> None:
    with pytest.raises(InputError, match=rf"segment {number} of the profile: .*{why}"):
        check_profile(Profile(tuple(segments)), LIMITS, LEVEL)


def test_a_profile_at_the_very_limits_is_not_refused() -> None:
    segments = Dwell(rad(90, 0, 270), 5.0), Rate("inner", math.radians(200.0), 100.0), Dwell(rad(-90, 0, 0), 5.0)
    check_profile(Profile(segments, slew=math.radians(500.0)), LIMITS, LEVEL)


def reading(t_s: float, outer: float = 0.0, inner: float = 0.0, rate: float = 0.0, **fields: str) -> TableState:
    said = {"mode": "position", "fault": ""} | fields
    return TableState(round(t_s * 1e9), 0, (outer, 0.0, inner), (0.0, 0.0, rate), said["mode"], said["fault"])


def follower() -> Follower:
    made = Follower(LIMITS)
    assert made.wrong(reading(0.0, mode="off")) == ""
    return made


def run(of: Follower, motion: "list[TableState]") -> tuple[float, str]:
    """When something is wrong first, and what."""
    for state in motion:
        if said := of.wrong(state):
            return state.stamp_ns / 1e9, said
    return math.inf, ""


def steps(until_s: float) -> list[float]:
    return [0.01 * k for k in range(1, round(until_s / 0.01))]


def seen(motion: Motion, states: list[TableState]) -> float:
    """When a motion is there first, of readings since it was commanded; infinity: never."""
    readings = Readings()
    readings.begin(0, [motion])
    for state in states:
        readings.add([state])
        if motion.is_there(readings, LIMITS):
            return state.stamp_ns / 1e9
    return math.inf


def test_a_move_is_there_once_its_axis_has_stood_at_its_angle_for_a_second() -> None:
    """Whole turns do not count of an axis without stops; a rest elsewhere, and a creeping axis, are not there."""
    move = Move("inner", 350.0, 50.0, 100.0)
    model = Expected(Move("inner", -10.0, 50.0, 100.0), Begin(0.0), 0.0, 0.0)
    moving = [reading(t, inner=model.at(t)[0], rate=model.at(t)[1]) for t in steps(4.0)]
    assert seen(move, moving) == pytest.approx(2.0 * math.sqrt(0.1) + 1.0, abs=0.05)
    assert seen(move, [reading(t, inner=-9.97) for t in steps(4.0)]) == math.inf
    assert seen(move, [reading(t, inner=-10.0, rate=0.02) for t in steps(4.0)]) == math.inf
    assert seen(Move("outer", 0.0, 10.0, 10.0), [reading(t, outer=360.0) for t in steps(4.0)]) == math.inf


def test_a_turn_is_there_at_its_rate_and_one_of_zero_when_its_axis_stands() -> None:
    turn = Turn("inner", 40.0, 100.0)
    model = Expected(turn, Begin(0.0), 0.0, 0.0)
    turning = [reading(t, inner=model.at(t)[0], rate=model.at(t)[1]) for t in steps(3.0)]
    assert 0.6 < seen(turn, turning) < 0.8
    assert seen(Turn("inner", 0.0, 100.0), turning) == math.inf
    assert seen(Turn("inner", 0.0, 100.0), [reading(t, inner=7.0) for t in steps(2.0)]) < 0.6


def test_a_swing_is_there_at_nine_tenths_of_its_size_or_at_half_of_it_after_three_periods() -> None:
    swing = Swing("inner", 10.0, 0.5, 100.0)
    for size, when in ((10.0, 2.0), (7.0, 6.0), (4.0, math.inf)):
        swinging = [reading(t, inner=size * math.sin(math.pi * t)) for t in steps(9.0)]
        assert seen(swing, swinging) == pytest.approx(when, abs=0.05)


def test_a_profile_moves_all_axes_at_the_pace_of_the_slowest_and_turns_one_at_its_own() -> None:
    profile = Profile((Dwell(rad(10, 0, 20), 1.0), Rate("inner", 1.0, 1.0)), slew=math.radians(60.0))
    dwell, rate = profile.segments
    assert of_segment(dwell, profile, LIMITS) == (Move("outer", 10.0, 30.0, 50.0), Move("inner", 20.0, 30.0, 50.0))
    assert of_segment(rate, profile, LIMITS) == (Turn("inner", round(math.degrees(1.0), 9), 100.0),)


def test_an_axis_that_moves_as_commanded_a_little_late_is_followed() -> None:
    of = follower()
    of.begin(Move("inner", 170.0, 50.0, 100.0), 0.0)
    model = Expected(Move("inner", 170.0, 50.0, 100.0), Begin(0.0), 0.15, 0.0)
    assert run(of, [reading(t, inner=model.at(t)[0]) for t in steps(10.0)]) == (math.inf, "")
    assert model.at(10.0) == pytest.approx((170.0, 0.0))


def test_an_axis_may_begin_at_any_time_while_its_command_is_sent() -> None:
    """A slow link, or a busy machine, is no axis that does not follow; one that is stuck is told still."""
    for begun_s in (0.0, 0.9):
        of = follower()
        of.begin(Turn("inner", 50.0, 100.0), 0.0, 0.9)
        model = Expected(Turn("inner", 50.0, 100.0), Begin(0.0), begun_s, 0.0)
        turning = [reading(t, inner=model.at(t)[0], rate=model.at(t)[1], mode="rate") for t in steps(10.0)]
        assert run(of, turning) == (math.inf, "")
    of = follower()
    of.begin(Turn("inner", 50.0, 100.0), 0.0, 0.9)
    assert run(of, [reading(t, mode="rate") for t in steps(10.0)])[0] < 3.0


def test_a_stuck_axis_is_told_within_a_second_and_a_half() -> None:
    of = follower()
    of.begin(Move("inner", 170.0, 50.0, 100.0), 0.0)
    when, said = run(of, [reading(t) for t in steps(10.0)])
    assert when < 1.7
    assert "inner does not follow" in said


def test_an_axis_that_sticks_amid_a_long_turn_is_told_though_its_rate_has_an_error() -> None:
    of = follower()
    of.begin(Turn("inner", 50.0, 100.0), 0.0)
    turning = [reading(t, inner=50.3 * t, rate=50.3, mode="rate") for t in steps(300.0)]
    assert run(of, turning) == (math.inf, "")
    stuck = [reading(300.0 + t, inner=50.3 * 300.0, mode="rate") for t in steps(10.0)]
    assert run(of, stuck)[0] < 302.0


def test_a_missed_quarter_of_a_degree_at_the_end_is_let_pass_and_a_whole_one_is_not() -> None:
    for missed, told in ((0.25, False), (1.0, True)):
        of = follower()
        of.begin(Move("inner", 10.0, 50.0, 100.0), 0.0)
        model = Expected(Move("inner", 10.0 - missed, 50.0, 100.0), Begin(0.0), 0.0, 0.0)
        assert (run(of, [reading(t, inner=model.at(t)[0]) for t in steps(5.0)])[1] != "") == told


def test_what_is_out_of_control_is_told_at_once() -> None:
    cases = [
        (reading(0.01, outer=91.0), "beyond its limits"),
        (reading(0.01, rate=230.0), "above its limit"),
        (reading(0.01, fault="interlock open"), "interlock open"),
    ]
    for state, said in cases:
        of = follower()
        of.begin(Move("inner", 0.0, 50.0, 100.0), 0.0)
        assert said in of.wrong(state)


def test_a_rate_towards_a_stop_is_told_while_there_is_room_to_brake() -> None:
    of = follower()
    of.begin(Turn("outer", 20.0, 50.0), 0.0)
    states = [replace(reading(t, outer=20.0 * t, mode="rate"), rates_dps=(20.0, 0.0, 0.0)) for t in steps(10.0)]
    when, said = run(of, states)
    assert "comes to its limit" in said
    assert 20.0 * when + braking_deg(20.0, 50.0) < 90.0


def test_angles_that_a_controller_counts_modulo_360_continue_through_whole_turns() -> None:
    of = follower()
    assert run(of, [reading(t, inner=-40.0 * t % 360.0, mode="off") for t in steps(20.0)]) == (math.inf, "")
    assert of.angles_deg[2] == pytest.approx(-40.0 * steps(20.0)[-1])


def test_a_swing_that_comes_to_a_stop_is_told() -> None:
    of = follower()
    of.begin(Swing("inner", 10.0, 0.5, 100.0), 0.0)
    swing = [reading(t, inner=10.0 * math.sin(math.pi * t), mode="oscillation") for t in steps(20.0)]
    assert run(of, swing) == (math.inf, "")
    stuck = [reading(20.0 + t, mode="oscillation") for t in steps(10.0)]
    assert run(of, stuck)[0] < 24.0


def test_a_controller_that_leaves_its_mode_by_itself_is_told() -> None:
    of = follower()
    of.begin(Move("inner", 0.0, 50.0, 100.0), 0.0)
    when, said = run(of, [reading(t, mode="off") for t in steps(3.0)])
    assert "is off" in said
    assert when < 1.2


def test_a_table_that_is_turned_by_hand_while_nothing_is_commanded_is_none_of_its_business() -> None:
    assert run(follower(), [reading(t, inner=40.0 * t, mode="off") for t in steps(3.0)]) == (math.inf, "")


def test_what_an_axis_was_late_by_when_its_rate_changed_is_no_error_afterwards() -> None:
    of = follower()
    late = 0.07
    of.begin(Turn("inner", 40.0, 100.0), 0.0)
    up = [reading(t, inner=40.0 * max(0.0, t - 0.2 - late), rate=40.0, mode="rate") for t in steps(5.0)]
    assert run(of, up) == (math.inf, "")
    at = 40.0 * (5.0 - 0.2 - late)
    of.begin(Turn("inner", 0.0, 100.0), 5.0)
    down = [reading(5.0 + t, inner=at + 40.0 * min(t, 0.2 + late), mode="rate") for t in steps(20.0)]
    assert run(of, down) == (math.inf, "")
    creeping = [reading(25.0 + t, inner=at + 40.0 * (0.2 + late) + 0.5 * t, mode="rate") for t in steps(20.0)]
    assert run(of, creeping)[0] < 29.0

"""How much is drawn and how often."""

from itertools import pairwise

import pytest

from imutui.tui.terminal.pacing import AUTO, NUMBERS, SCROLL, SWEEP, Load, Pacing, PacingController, is_remote

STUCK = Load(busy=1.0, stuck_s=2.0, queue=9)
IDLE = Load()


def _run(pace: PacingController, load: Load, start: float, seconds: float) -> list[Pacing]:
    """What held, frame after frame at 5 Hz."""
    held = []
    for i in range(int(seconds * 5)):
        pace.judge(start + i / 5, load)
        held.append(pace.pacing)
    return held


def _modes(held: list[Pacing]) -> list[str]:
    return list(dict.fromkeys(pacing.mode for pacing in held))


@pytest.mark.parametrize(("remote", "mode", "fps"), [(False, SCROLL, 10.0), (True, SWEEP, 5.0)])
def test_by_itself_a_local_terminal_scrolls_and_a_remote_one_sweeps(remote: bool, mode: str, fps: float) -> None:
    pacing = PacingController(remote=remote).pacing
    assert (pacing.mode, pacing.fps, pacing.note) == (mode, fps, "")
    assert is_remote({"SSH_CONNECTION": "1.2.3.4 5 6.7.8.9 22"}) is True
    assert is_remote({}) is False


def test_a_terminal_that_falls_behind_gets_less_and_is_told_why() -> None:
    held = _run(PacingController(), STUCK, 0.0, 10.0)
    assert _modes(held) == [SWEEP, NUMBERS]
    assert held[0].note == "link is slow"
    assert held[-1].fps == 2.0
    assert sum(a != b for a, b in pairwise(held)) == 2
    assert held[4] == held[0]


def test_it_goes_up_again_only_after_it_has_kept_up_for_a_while() -> None:
    pace = PacingController()
    _run(pace, STUCK, 0.0, 10.0)
    assert {p.mode for p in _run(pace, IDLE, 10.0, 19.0)} == {NUMBERS}
    assert _modes(_run(pace, IDLE, 29.0, 80.0)) == [NUMBERS, SWEEP, SCROLL]
    assert pace.pacing.note == ""


def test_what_turned_out_too_much_is_tried_less_and_less_often() -> None:
    """A link that only carries a sweep is not tried with more every twenty seconds for ever."""
    pace, tries, at = PacingController(), 0, 0.0
    for _ in range(5 * 3600):
        before = pace.pacing
        pace.judge(at, STUCK if before.mode == SCROLL else IDLE)
        tries += before.mode == SWEEP and pace.pacing.mode == SCROLL
        at += 0.2
    assert 3 <= tries <= 10


def test_a_moment_of_trouble_forgets_the_time_kept_up() -> None:
    pace = PacingController()
    _run(pace, STUCK, 0.0, 10.0)
    for start in range(10, 100, 10):
        _run(pace, IDLE, start, 9.0)
        _run(pace, Load(busy=0.3), start + 9.0, 1.0)
    assert pace.pacing.mode == NUMBERS


def test_a_slow_answer_counts_as_behind() -> None:
    """Behind an SSH link writes never block, but the terminal answers late."""
    assert Load(round_trip_s=3.0).behind
    assert not Load(round_trip_s=0.3).behind
    assert Load(round_trip_s=0.3).keeps_up
    assert not Load(round_trip_s=1.0).keeps_up


def test_a_wish_is_kept_and_only_its_speed_gives_way() -> None:
    pace = PacingController(SCROLL, 8.0, remote=True)
    assert pace.pacing == Pacing(SCROLL, 8.0, 2.5)
    assert _modes(_run(pace, STUCK, 0.0, 20.0)) == [SCROLL]
    assert pace.pacing.fps == 2.0


def test_a_slow_wish_is_not_made_faster() -> None:
    pace = PacingController(AUTO, 1.0)
    _run(pace, STUCK, 0.0, 20.0)
    assert pace.pacing.fps == 1.0


@pytest.mark.parametrize(("remote", "seen"), [(False, [SWEEP, NUMBERS, SCROLL]), (True, [SCROLL, SWEEP, NUMBERS])])
def test_the_key_always_shows_a_difference(remote: bool, seen: list[str]) -> None:
    pace = PacingController(remote=remote)
    modes = [pace.pacing.mode]
    wishes = []
    for _ in range(4):
        modes.append(pace.cycle().mode)
        wishes.append(pace.wish)
    assert modes[1:4] == seen
    assert AUTO in wishes
    assert all(a != b for a, b in pairwise(modes))


def test_an_unknown_wish_is_none() -> None:
    """The configuration is checked where it is read; here anything else is chosen by itself."""
    assert PacingController("braille").wish == AUTO

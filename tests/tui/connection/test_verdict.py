"""The badge: its rules, its words, and that it does not flicker."""

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytest
from helpers.fake_client import FakeClient, bias, estimates
from hypothesis import given
from hypothesis import strategies as st

from imutui.estimates import live_biases
from imutui.tui import messages
from imutui.tui.connection import verdict
from imutui.tui.connection.model import ConnectionModel
from imutui.tui.connection.verdict import HOLD_S, Debounce
from imutui.tui.pages.filter.estimates import two_lines
from imutui.verdict import rules
from imutui.verdict.rules import Verdict

if TYPE_CHECKING:
    from filters.health.finding import HealthEntry

AXES = [f"{axis} {kind}" for kind in ("gyro", "accel") for axis in "xyz"]


def remainder(gz: float | None = 1.2, windows: int = 6) -> list[dict[str, Any]]:
    """Ratios of six channels, one of them chosen."""
    ratios = {"gx": 0.9, "gy": 1.1, "gz": gz, "ax": 1.0, "ay": 0.8, "az": 1.1}
    return [{"channel": name, "ratio": ratio, "windows": windows} for name, ratio in ratios.items()]


def settled(**changes: Any) -> dict[str, Any]:
    """A filter of which nothing bad can be said."""
    biases = [bias(name, 0.1, 0.02 if "gyro" in name else 0.3) for name in AXES]
    return estimates(**{"biases": biases, "remainder": remainder(), **changes})


def with_bias(**changes: Any) -> dict[str, Any]:
    """The same with another z gyro."""
    biases = live_biases(settled())
    biases[2] = bias("z gyro", changes.pop("value", 0.1), changes.pop("sd3", 0.02), **changes)
    return settled(biases=biases)


def judge(estimates: Any, slope_k_per_min: float | None = None, health: Any = (), **named: Any) -> Verdict:
    """The verdict on a filter that has this slope of the temperature."""
    told = estimates and {**estimates, "temperature_k_per_min": slope_k_per_min}
    return rules.judge(told, health, **named)


def test_all_converged_and_nothing_unexplained_is_green() -> None:
    found = judge(settled(), 0.02)
    assert (found.word, found.reason) == ("GREEN", "all 6 biases converged; means over 10 s are as noise allows")
    assert "reading − bias" in found.todo_at_length
    assert found.short == "filter ● GREEN 6 of 6"


@pytest.mark.parametrize("slope", [None, 0.0, 0.1, -0.1, 0.101, 0.42, -0.5])
def test_the_live_page_calls_the_temperature_steady_when_the_badge_does(slope: float | None) -> None:
    """However long the unit is on: page and badge go by one slope and one limit."""
    (check,) = [check for check in judge(settled(), slope).checks if check.name == "temperature"]
    word, said = messages.temperature(32.0, slope)
    assert (word == "T steady") == (check.level == "good")
    assert said.endswith("on for 32 s")
    assert messages.temperature(None, None) == ("", "")


def test_pages_show_the_slope_of_the_filter_that_is_judged() -> None:
    """The readings of the last minute may say otherwise than the filter, which knows the whole run."""
    model = ConnectionModel()
    now = FakeClient().snapshot(0)
    model.take({**now, "filter": settled(temperature_k_per_min=0.02)})
    view = model.view()
    assert view.slope_k_per_min == 0.02
    assert view.verdict is not None
    assert view.verdict.word == "GREEN"


def test_green_says_what_it_has_not_looked_for() -> None:
    found = judge(settled(), 0.02)
    first, second = two_lines(f"{found.reason}\n{found.todo}", 80 - 11 - 1, 80 - 11 - len("  w why "))
    assert (first, second) == (found.reason, found.todo)
    for said in (found.todo, found.todo_at_length):
        assert all(word in said for word in ("motion", "slow"))
    assert "10 s means" in found.todo_at_length
    waiting = judge(estimates(remainder=remainder()), 0.0)
    assert waiting.todo_at_length == waiting.todo


def test_what_is_waited_for_is_named_with_number_and_need() -> None:
    found = judge(estimates(remainder=remainder()), 0.0)
    assert found.word == "AMBER"
    assert found.reason == "5 of 6 biases converged; z gyro: 3 sd 0.2100 deg/s, needs 0.15"
    assert found.short == "filter ▲ AMBER 5 of 6"


def test_a_bias_that_moves_is_said_in_its_own_deviations_and_with_the_temperature() -> None:
    moving = with_bias(converged_s=None, sd3=0.03, change_10s=0.009)
    assert "z gyro moves 0.9 sd in 10 s: temperature +0.4 K/min" in judge(moving, 0.42).reason
    assert judge(moving, 0.01).reason.endswith("z gyro moves 0.9 sd in 10 s")


_ALLOWS = " × what noise allows (AMBER above 2, RED above 3)"


def nis(mean: float, is_test: bool) -> dict[str, Any]:
    return {**estimates()["nis"], "mean": mean, "is_test": is_test}


@pytest.mark.parametrize(
    ("state", "slope", "word", "said"),
    [
        # above 2 look, above 3 act; what is not known is no reason
        *((settled(remainder=remainder(ratio)), 0.0, "GREEN", "10 s") for ratio in (2.0, None)),
        *(
            (settled(remainder=remainder(ratio)), 0.0, word, f"gz 10 s means {ratio:.1f}{_ALLOWS}")
            for ratio, word in ((2.1, "AMBER"), (3.0, "AMBER"), (3.1, "RED"))
        ),
        # one mean of 10 s is beyond twice its deviation in one case of twenty
        (settled(remainder=remainder(2.9, windows=2)), 0.0, "GREEN", "known after 30 s"),
        *((settled(), slope, "GREEN", "all 6 biases converged; ") for slope in (0.1, -0.1)),
        *((settled(), slope, "AMBER", "all 6 biases converged, but ") for slope in (None, 0.11, -3.0)),
        # within its own uncertainty of the limit it may be outside; the first estimates of a run are no alarm
        (with_bias(value=0.99, sd3=0.02), 0.0, "GREEN", "all 6"),
        *((with_bias(value=v, sd3=0.02), 0.0, "RED", "Table 1's ±1 deg/s") for v in (1.03, -1.03)),
        *((with_bias(value=v, sd3=sd3), 0.0, "AMBER", "Table 1's ±1 deg/s") for v, sd3 in ((1.01, 0.02), (3.0, 4.5))),
        # just outside a 95 % band is where one good filter in twenty is
        *((settled(nis=nis(mean, True)), 0.0, "AMBER", "NIS") for mean in (9.15, 8.85)),
        *((settled(nis=nis(mean, True)), 0.0, "RED", "NIS") for mean in (9.3, 5.0)),
        *((settled(nis=nis(mean, mean == 9.0)), 0.0, "GREEN", "all 6") for mean in (9.0, 9.15, 8.85, 9.3, 5.0)),
        (settled(confounded=["z gyro bias: turn both ways"]), 0.0, "AMBER", "z gyro bias: turn both"),
        (estimates(waiting="finding level, 6 s more"), None, "WAIT", "finding level, 6 s more"),
        (estimates(samples=0), None, "WAIT", ""),
        (None, None, "OFF", ""),
    ],
)
def test_a_state_has_its_word_and_its_reason(state: Any, slope: float | None, word: str, said: str) -> None:
    found = judge(state, slope)
    assert found.word == word
    assert said in found.reason
    if "Table 1" not in said:
        assert "Table 1's" not in found.reason


def test_what_to_do_and_the_short_form_follow_the_reason() -> None:
    assert judge(settled(remainder=remainder(2.1)), 0.0).todo == "t traces this recording"
    assert judge(settled(), None).short == "filter ▲ AMBER T not known"
    assert judge(settled(), 0.11).short == "filter ▲ AMBER T moves"
    assert {judge(state).level for state in (None, estimates(waiting="finding level"))} == {"none"}


def test_alarms_come_first_and_are_counted() -> None:
    found = judge(settled(alarms=["innovations too large", "another"]), 0.0)
    assert (found.word, found.reason) == ("RED", "2 alarms: innovations too large")
    assert found.short == "filter × RED 2 alarms"


def test_a_filter_that_stopped_says_why_and_what_to_do() -> None:
    failure = "the filter stopped, recording goes on: sample 7"
    found = judge(settled(failure=failure, alarms=[failure]), 0.0)
    assert (found.word, found.reason, found.sudden) == ("RED", failure, True)
    assert "r starts anew" in found.todo


def test_what_cannot_be_observed_is_not_waited_for() -> None:
    biases = live_biases(settled())
    biases[3] = bias("x accel", None, None, observable=False, converged_s=None, change_10s=None)
    found = judge(settled(biases=biases), 0.0)
    assert found.word == "GREEN"
    assert found.reason == (
        "5 of 5 observable biases converged; means over 10 s are as noise allows; not observable here: x accel"
    )
    hidden = [row._replace(observable=False) for row in biases]
    assert judge(settled(biases=hidden), 0.0).word == "AMBER"


def test_a_key_that_begins_a_sentence_stays_as_it_is_typed() -> None:
    found = judge(settled(remainder=remainder(5.0)), 0.0)
    assert found.followed_by(found.todo_at_length).endswith(". t traces this recording.")
    assert found.followed_by("wait").endswith(". Wait.")


def test_a_frozen_channel_is_named_as_the_reason_why_a_bias_is_not_observable() -> None:
    biases = live_biases(settled())
    biases[1] = bias("y gyro", None, None, observable=False, converged_s=None, change_10s=None)
    fault: HealthEntry = {"channel": "gy", "kind": "frozen", "since_s": 5.0, "level": "bad", "said": "gy is frozen"}
    found = judge(settled(biases=biases), 0.0, health=[fault])
    (said,) = [check.said for check in found.checks if check.name == "converged"]
    assert found.word == "RED"
    assert said.endswith("not observable here: y gyro (gy is frozen)")


@pytest.mark.parametrize(
    ("profile", "guide", "recording", "said"),
    [
        (True, None, None, "5 Table, b begins it"),
        (True, {"state": "cancelled"}, None, "5 Table, b begins it"),
        (True, {"state": "cancelled"}, {"path": "a.mcap"}, "5 Table, b resumes it"),
        (True, {"state": "go"}, {"path": "a.mcap"}, "no bias is observable in this setup"),
        (False, None, None, "no bias is observable in this setup"),
    ],
)
def test_a_profile_that_waits_is_what_hides_the_biases(
    profile: bool, guide: dict[str, Any] | None, recording: dict[str, Any] | None, said: str
) -> None:
    """Where no bias is observable because nobody has begun the profile, the badge says which key begins it."""
    waits = verdict.waiting_profile({"reference": {"profile": profile}, "guide": guide, "recording": recording})
    hidden = settled(biases=[row._replace(observable=False) for row in live_biases(settled())])
    found = judge(hidden, 0.0, waiting_profile=waits)
    assert found.word == "AMBER"
    assert said in found.reason
    assert judge(settled(), 0.0, waiting_profile=waits).word == "GREEN"


def test_an_acquisition_that_has_ended_has_no_word_of_the_present() -> None:
    last = verdict.ended(judge(settled(), 0.0))
    assert last is not None
    assert (last.short, last.level) == ("filter – ENDED", "none")
    assert last.reason.endswith("at its end: GREEN, all 6 biases converged; means over 10 s are as noise allows")
    assert verdict.ended(last) is last
    off = judge(None)
    assert verdict.ended(off) is off


def test_old_estimates_are_not_green() -> None:
    assert judge(settled(), 0.0, silent="NO DATA for 8.0 s").word == "AMBER"
    silent = {**FakeClient().snapshot(), "silent_s": 8.0}
    assert verdict.stale(silent) is not None
    assert verdict.stale({**silent, "silent_s": 1.5}) is None


def test_every_word_fits_the_header_beside_the_pages() -> None:
    cases = [judge(settled(), slope) for slope in (0.0, -12.3)]
    cases += [judge(settled(alarms=["x"] * 12)), judge(settled(remainder=remainder(98.7))), judge(None)]
    cases += [judge(with_bias(value=2.0)), judge(settled(failure="x")), judge(estimates()), judge(estimates(samples=0))]
    assert max(len(found.short) for found in cases) <= 24


@pytest.mark.parametrize(("mean", "word"), [(12.0, "above"), (5.0, "below"), (9.0, "inside"), (None, "no samples")])
def test_nis_is_judged_by_its_band(mean: float | None, word: str) -> None:
    nis = {"mean": mean, "band95": [8.9, 9.1], "is_test": True, "why": ""}
    assert rules.nis_meaning(nis).startswith(word)


def test_nis_that_is_no_test_is_not_judged() -> None:
    """With an exact reference a tiny NIS means nothing, and the reason is given, in full on request."""
    nis = estimates()["nis"]
    assert rules.nis_meaning(nis) == "no test: exact reference"
    assert "by construction" in rules.nis_meaning(nis, whole=True)


STATES = st.lists(st.tuples(st.floats(0.02, 3.0), st.sampled_from(["good", "wait", "bad"])), min_size=1, max_size=60)


def _shown(steps: list[tuple[float, str]]) -> list[tuple[float, Verdict]]:
    hold, t, out = Debounce(), 0.0, []
    for step, level in steps:
        t += step
        out.append((t, hold.take(t, Verdict(level, rules.WORDS[level], level))))
    return out


@given(STATES)
def test_a_word_stands_for_two_seconds(steps: list[tuple[float, str]]) -> None:
    """However the filter's state jumps, the badge does not flicker."""
    shown = _shown(steps)
    changes = [t for (_, a), (t, b) in pairwise(shown) if a.word != b.word]
    assert all(b - a >= HOLD_S for a, b in pairwise(changes))


@given(STATES, st.sampled_from(["good", "wait", "bad"]))
def test_a_state_that_lasts_is_shown(steps: list[tuple[float, str]], last: str) -> None:
    shown = _shown([*steps, *[(0.1, last)] * 45])
    assert shown[-1][1].level == last


@given(STATES)
def test_a_better_word_is_earned(steps: list[tuple[float, str]]) -> None:
    rank = {"good": 1, "wait": 2, "bad": 3}
    shown = _shown(steps)
    for i in range(1, len(shown)):
        (t, now), before = shown[i], shown[i - 1][1]
        if rank[now.level] < rank[before.level]:
            recent = [level for (at, _), (_, level) in zip(shown[: i + 1], steps, strict=False) if at > t - HOLD_S]
            assert rank[now.level] >= max(rank[level] for level in recent)


def test_a_filter_that_stops_is_said_at_once() -> None:
    hold = Debounce()
    hold.take(1.0, judge(settled(), 0.0))
    assert hold.take(1.1, judge(settled(failure="broke down"), 0.0)).word == "RED"
    assert hold.take(1.2, judge(None)).word == "OFF"
    assert hold.take(1.3, judge(settled(), 0.0)).word == "GREEN"


def test_what_to_do_has_room_beside_a_long_reason() -> None:
    assert two_lines("all is well\nuse it", 30, 20) == ("all is well", "use it")
    first, second = two_lines("a reason that is much longer than one line has room for it\nstop here", 30, 38)
    assert (first, second) == ("a reason that is much longer", "than one line has room …; stop here")
    assert all(len(line) <= 20 for line in two_lines("word " * 30 + "\n" + "do " * 30, 20, 20))

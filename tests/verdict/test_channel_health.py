"""Faults of channels in the verdict: the sensor is judged beside what a filter makes of it, and before it."""

from typing import Any

import pytest
from helpers.fake_client import bias, estimates

from filters.health.finding import ADVICE, BAD, of_kind
from imutui.logbook.health import entries
from imutui.verdict import rules

QUIET = [{"channel": name, "ratio": 1.1, "windows": 6} for name in ("gx", "gy", "gz", "ax", "ay", "az")]
AXES = [f"{axis} {kind}" for kind in ("gyro", "accel") for axis in "xyz"]


def settled(**changes: Any) -> Any:
    """A filter of which nothing bad can be said."""
    biases = [bias(name, 0.1, 0.02 if "gyro" in name else 0.3) for name in AXES]
    return estimates(**{"biases": biases, "remainder": QUIET, "temperature_k_per_min": 0.02, **changes})


def fault(kind: Any, channel: str = "gy") -> Any:
    return entries([of_kind(kind, channel, 0.0, f"{channel} is {kind}")])


@pytest.mark.parametrize("kind", ADVICE)
def test_no_fault_of_a_channel_is_green_and_each_says_what_helps(kind: Any) -> None:
    found = rules.judge(settled(), fault(kind))
    assert found.word == ("RED" if kind in BAD else "AMBER")
    assert (found.reason, found.todo, found.fault) == (f"gy is {kind}", ADVICE[kind], f"gy {kind}")
    assert not found.passes


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize(
    "standing",
    [None, settled(waiting="finding level"), settled()],
    ids=["no filter", "waiting", "settled"],
)
def test_a_bad_channel_is_red_at_once(kind: Any, standing: Any) -> None:
    found = rules.judge(standing, fault(kind))
    assert (found.word, found.sudden, found.short) == ("RED", True, f"channels × RED gy {kind}")


def test_without_a_filter_and_without_a_fault_nothing_is_judged() -> None:
    assert (rules.judge(None).word, rules.judge(None).passes) == ("OFF", True)
    assert rules.judge(None, fault("noisy")).word == "AMBER"


def test_channels_with_the_same_fault_are_one_check() -> None:
    health = [*fault("dead", "gx"), *fault("dead", "gy"), *fault("noisy", "ax")]
    checks = [check for check in rules.judge(None, health).checks if check.name == rules.CHANNELS_CHECK]
    assert [(check.level, check.brief) for check in checks] == [("bad", "gx gy dead"), ("wait", "ax noisy")]
    assert "gy" in checks[0].said


def test_a_fault_is_its_own_channel_s_only() -> None:
    assert rules.bias_levels(settled(), fault("dead")) == ["good", "bad", "good", "good", "good", "good"]


def test_no_fault_is_a_check_that_says_so() -> None:
    (check,) = [one for one in rules.judge(settled()).checks if one.name == rules.CHANNELS_CHECK]
    assert (check.level, check.said) == ("good", "no fault shows")

"""The demo of the screen: a unit with an effect to be found."""

from dataclasses import replace
from pathlib import Path

from helpers.runs import run_of

from filters.tracing import trace
from imutui.scenario import load_scenario
from imutui.session.plan import VIRTUAL_PORT, Plan, demo


def test_the_demo_leaves_the_configuration_of_real_units_out() -> None:
    """Where and by whom is the configuration's; mounting and signs are the virtual unit's own."""
    plan = demo(Plan("/dev/x", 133.0, logs="/data", operator="ana", mount="x,-y,-z", accel_sign=1), seed=3)
    assert (plan.port, plan.rate_hz, plan.record, plan.logs, plan.operator) == (
        VIRTUAL_PORT,
        20.0,
        True,
        "/data",
        "ana",
    )
    assert (plan.mount, plan.accel_sign) == ("x,y,z", -1)
    assert plan.virtual[:2] == ("--seed", "3")


def test_two_minutes_of_the_demo_are_traced_to_its_effect() -> None:
    """What a newcomer records first has a finding: the y gyro's 0.13 Hz, with its amplitude, and nothing else.

    And the error is less with it.
    """
    scenario = load_scenario(Path(demo(Plan(VIRTUAL_PORT)).virtual[3]))
    document = trace.trace([run_of(replace(scenario, seed=0), seconds=120.0)], None).document
    found = document["findings"]
    error = next(e for e in document["error"] if (e["metric"], e["channel"]) == ("e10", "gy"))
    assert error["after"] is not None
    assert error["before"] is not None
    assert error["after"] < 0.75 * error["before"]
    assert [(finding["effect"], finding["channels"]) for finding in found] == [("tone", ["gy"])]
    values = {param["name"]: param["value"] for param in found[0]["params"]}
    assert abs(values["frequency"] - 0.13) < 0.002

"""What the curves of a trace are drawn over."""

import pytest

from filters.effects import catalogue
from imutui.jobs import driver_curves


@pytest.mark.parametrize(
    ("effect", "channel", "parameters", "over"),
    [
        ("thermal_lin", "gx", {}, ("temperature",)),
        ("thermal_lag", "gx", {"tau_s": 20.0}, ()),
        ("scale", "gy", {}, ("wy",)),
        ("cross_axis", "gx", {"axes": "yz"}, ("wy", "wz")),
        ("cross_axis", "ay", {"axes": "xz"}, ("fx", "fz")),
        ("g_sensitivity", "gz", {"axes": "xyz"}, ("fx", "fy", "fz")),
        ("ramp", "gx", {}, ()),
    ],
)
def test_an_effect_is_drawn_over_each_quantity_that_it_follows_at_once(
    effect: str, channel: str, parameters: dict[str, float | str], over: tuple[str, ...]
) -> None:
    assert driver_curves._drivers(catalogue.hypothesis(effect, (channel,), parameters)) == over

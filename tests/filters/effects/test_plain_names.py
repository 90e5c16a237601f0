"""Plain words: one for each effect of the catalogue and for each driver."""

import pytest

from filters.effects import catalogue, plain_names
from filters.effects.drivers import SCALARS


def test_no_code_name_stands_for_words_but_where_it_is_one() -> None:
    for name in catalogue.EFFECTS:
        assert name == "spikes" or plain_names.effect(name) != name.replace("_", " ")
    for name in SCALARS:
        assert name in ("temperature", "time") or plain_names.driver(name) != name


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (plain_names.state("gy thermal_lin k (rad/s/K)"), "gy: bias follows temperature"),
        (plain_names.state("gx/gy thermal_poly k2 (K)"), "gx gy: bias is a curve in temperature, quadratic term"),
        (plain_names.state("gy tone"), "gy: oscillates"),
        (plain_names.effect("nonlinearity_cubic"), "cubic nonlinearity"),
        (plain_names.driver("wy*fz"), "the rate about y times the specific force along z"),
        (plain_names.driver("angle_inner"), "the inner angle"),
        (plain_names.effect("driver:temperature*wx"), "error is a function of temperature times the rate about x"),
    ],
)
def test_states_effects_and_drivers_have_words(made: str, words: str) -> None:
    assert made == words

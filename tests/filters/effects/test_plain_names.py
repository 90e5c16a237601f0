"""Plain words: one for each effect of the catalogue, the same as its hypotheses say, and one for each driver."""

from filters.effects import additive, catalogue, plain_names, reference_errors
from filters.effects.drivers import SCALARS
from filters.effects.hypothesis import ChannelEffect


def test_every_effect_has_words() -> None:
    """No code name stands for words, but where it is one."""
    for name in catalogue.EFFECTS:
        assert name == "spikes" or plain_names.effect(name) != name.replace("_", " ")


def test_words_are_those_of_the_hypotheses() -> None:
    """What a rival is called in one place it is called in all."""
    for h in (*additive.hypotheses(0), *additive.hypotheses(3), *reference_errors.shared()):
        if isinstance(h, ChannelEffect):
            assert plain_names.effect(h.effect) == h.text
        else:
            assert plain_names.effect(h.effect) == h.label


def test_a_state_of_the_filter_has_words() -> None:
    """Channels, effect, and the parameter where the effect has several; the code of none of them."""
    assert plain_names.state("gy thermal_lin k (rad/s/K)") == "gy: bias follows temperature"
    assert plain_names.state("gx/gy thermal_poly k2 (K)") == "gx gy: bias is a curve in temperature, quadratic term"
    assert plain_names.state("gy tone") == "gy: oscillates"
    assert plain_names.effect("nonlinearity_cubic") == "cubic nonlinearity"


def test_every_driver_has_words() -> None:
    """Products and what follows the table's axes too."""
    for name in SCALARS:
        assert name == "temperature" or name == "time" or plain_names.driver(name) != name
    assert plain_names.driver("wy*fz") == "the rate about y times the specific force along z"
    assert plain_names.driver("angle_inner") == "the inner angle"
    assert plain_names.effect("driver:temperature*wx") == ("error is a function of temperature times the rate about x")

"""What can be asked of a kind of unit, for who fills in a plan."""

from dataclasses import dataclass

from imutui.instrument import registry
from imutui.session.plan import MIN_RATE_HZ


@dataclass(frozen=True, slots=True)
class Offer:
    """What a kind of unit gives."""

    name: str  # what files of such units begin with
    # least_rate_hz, most_rate_hz: bounds of the output rate
    least_rate_hz: float
    most_rate_hz: float
    # rates, rising, at which each packet of a stream is a sample; at others samples are means of packets
    rates_hz: tuple[float, ...]
    # mode, mode_words: what its packets are, in two words and in a line
    mode: str
    mode_words: str
    zeroes_rates: bool  # whether it has a command that zeroes its rate sensors


NAMES = tuple(registry.INSTRUMENTS)
"""What files of all units begin with."""


def of_model(model: str) -> Offer:
    """What a unit of some model gives; that of the usual instrument where it is none of those known."""
    it = registry.of_model(model)
    rates_hz = tuple(sorted(it.rates_hz))
    return Offer(it.name, MIN_RATE_HZ, it.most_rate_hz, rates_hz, it.mode, it.mode_words, it.zeroes_rates)

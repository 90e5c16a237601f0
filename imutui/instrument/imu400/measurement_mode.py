"""Packets of a unit that measures in volts again, as after power-up, though it was told to measure in scaled units.

Both kinds of packet have the same length and header; what tells them is that voltage words are of 12 bits, and that
both words say the same: 2.5 V stands for zero, 0 and 5 V for the ends of the scaled range.
"""

from imutui.instrument.host import DataPacket

_MOST_VOLTS = 4095
_VOLTS_AT_ZERO = 2048
_SCALED_A_VOLT_COUNT = 16
# an eighth of the range within a packet's time; and no word of scaled packets in a row goes so far in three channels
_MOVED = 256
_JUMPED = 512
_JUMPS = 3


def may_be_volts(packet: DataPacket) -> bool:
    """Whether all six words would do as voltages."""
    return all(0 <= word <= _MOST_VOLTS for word in _words(packet))


def is_volts(packet: DataPacket, scaled: DataPacket) -> bool:
    """Whether a packet says in volts what one of about the same moment said in scaled units."""
    now, then = _words(packet), _words(scaled)
    expected = [_VOLTS_AT_ZERO + word // _SCALED_A_VOLT_COUNT for word in then]
    agrees = all(abs(word - volts) <= _MOVED for word, volts in zip(now, expected, strict=True))
    jumps = sum(abs(word - old) > _JUMPED for word, old in zip(now, then, strict=True))
    return may_be_volts(packet) and agrees and jumps >= _JUMPS


def _words(packet: DataPacket) -> tuple[int, ...]:
    return (*packet.rates, *packet.accels)

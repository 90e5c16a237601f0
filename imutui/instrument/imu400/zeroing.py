"""Zeroing the unit's rate sensors.

The unit, held still, averages its rate sensors and subtracts the mean from then on; it answers `Z` when that is done
and sends nothing meanwhile. Documents dispute how long an average the argument asks for: ten or a hundred samples for
each unit of it.
"""

import time
from collections.abc import Callable

from filters.errors import InputError
from filters.imu import LOOP_HZ
from imutui.instrument.imu400 import handshake
from imutui.instrument.imu400.crossbow import Decoder, RatesZeroed, ZeroRateSensors, encode
from imutui.instrument.port import Port

MAX_ARGUMENT = 255
_MAX_SAMPLES_PER_UNIT = 100
_MARGIN_S = 10.0


def patience_s(argument: int) -> float:
    """How long to wait for the answer, s: the longest that any document allows, and some more."""
    return _MARGIN_S + 1.1 * _MAX_SAMPLES_PER_UNIT * argument / LOOP_HZ


def check(argument: int) -> None:
    """Refuse what cannot be sent.

    Raises InputError with the argument and what it may be.
    """
    if not 0 <= argument <= MAX_ARGUMENT:
        raise InputError(
            f"`argument` is {argument}; it travels as one byte, 0 to {MAX_ARGUMENT}; 0 erases the stored zero"
        )


def zero(port: Port, argument: int, stopping: Callable[[], bool]) -> float | None:
    """Stop the unit's packets and have it zero its rate sensors.

    `port`: of a unit that may stream; it is polled afterwards.
    `argument`: length of the average, 0 to 255; 0 erases the stored zero.
    `stopping`: whether to give up.
    Returns seconds until it said that it is done; None if it did not in time, and may be at it still.
    Raises PortError if the line goes away.
    """
    handshake.stop_stream(port)
    command = ZeroRateSensors(argument)
    decoder = Decoder()
    decoder.expect_reply(command)
    port.write(encode(command))
    began = time.monotonic()
    while not stopping() and time.monotonic() - began < patience_s(argument):
        data = port.read(decoder.missing)
        if RatesZeroed() in (decoder.feed(data) if data else decoder.quiet()):
            return time.monotonic() - began
    return None

"""Zeroing the unit's rate sensors, and what to say of it.

The unit, held still, averages its rate sensors and subtracts the mean from then on; it answers `Z` when that is done
and sends nothing meanwhile. Documents dispute how long an average the argument asks for: ten or a hundred samples for
each unit of it.
"""

import time
from collections.abc import Callable

import numpy as np

from imutui.instrument.crossbow import Decoder, RatesZeroed, ZeroRateSensors, encode
from imutui.instrument.port import Port
from imutui.session import handshake
from imutui.session.plan import MAX_RATE_HZ

MAX_ARGUMENT = 255
_MAX_SAMPLES_PER_UNIT = 100
_MARGIN_S = 10.0


def patience_s(argument: int) -> float:
    """How long to wait for the answer, s: the longest that any document allows, and some more."""
    return _MARGIN_S + 1.1 * _MAX_SAMPLES_PER_UNIT * argument / MAX_RATE_HZ


def check(argument: int) -> None:
    """Refuse what cannot be sent.

    Raises
    ------
    ValueError
        With the argument and what it may be.
    """
    if not 0 <= argument <= MAX_ARGUMENT:
        raise ValueError(
            f"`argument` is {argument}; it travels as one byte, 0 to {MAX_ARGUMENT}; 0 erases the stored zero"
        )


def zero(port: Port, argument: int, stopping: Callable[[], bool]) -> float | None:
    """Stop the unit's packets and have it zero its rate sensors.

    Parameters
    ----------
    port : Port
        Of a unit that may stream; it is polled afterwards.
    argument : int
        Length of the average, 0 to 255; 0 erases the stored zero.
    stopping : callable
        Whether to give up.

    Returns
    -------
    float or None
        Seconds until it said that it is done; None if it did not in time, and may be at it still.

    Raises
    ------
    PortError
        If the line goes away.
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


def in_words(argument: int, seconds: float, before_dps: np.ndarray | None) -> str:
    """What came of it.

    Parameters
    ----------
    argument : int
        As it was sent.
    seconds : float
        Until the unit said that it is done.
    before_dps : np.ndarray or None
        What the rate sensors read before, deg/s, shape (3,).
    """
    done = "erased its stored zero" if argument == 0 else "zeroed its rate sensors"
    read = ""
    if before_dps is not None:
        x, y, z = before_dps
        read = f"; before, they read x {x:+.4f}, y {y:+.4f}, z {z:+.4f} deg/s"
    return f"the unit says that it has {done} ({seconds:.1f} s){read}. The filter begins anew."


def unanswered(argument: int) -> str:
    """What to say when it did not answer in time."""
    return (
        f"the unit did not say within {patience_s(argument):.0f} s that its rate sensors are zeroed (argument"
        f" {argument}). Whether they are is not known: look at the rates when packets come again. If none come, power"
        " it off and on, then connect again."
    )

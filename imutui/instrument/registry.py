"""The instruments that there are, by name."""

from imutui.command_line import command
from imutui.instrument.imu400.host import IMU400CD
from imutui.instrument.instrument import Instrument
from imutui.instrument.names import DEFAULT
from imutui.instrument.port import Port
from imutui.instrument.uut.host import IMU381

INSTRUMENTS: dict[str, Instrument] = {each.name: each for each in (IMU400CD, IMU381)}


def which_answers(port: Port) -> Instrument:
    """The instrument that answers at an open port; the usual one if none does.

    First all are asked at the usual one's own speed, itself last. At another speed it hears other bytes than were sent:
    of `UUPK` at 57600 baud, at 38400 a `b`, by which it would set out to change its speed.
    """
    baud, usual = port.baud, INSTRUMENTS[DEFAULT]
    others = [each for each in INSTRUMENTS.values() if each is not usual]
    for instrument in (*others, usual):
        if instrument.host(port, None).answers(usual.power_up_bauds[0]):
            return instrument
    for instrument in others:
        if instrument.host(port, None).answers():
            return instrument
    port.set_baud(baud)
    return usual


def nor_the_others() -> str:
    """What to say where the usual instrument, and none of the others, has answered."""
    others = [name for name in INSTRUMENTS if name != DEFAULT]
    return (
        f"Nor did any of the others answer: {', '.join(others)}. One that is quiet and slow to answer has to be named:"
        f" {command('record', '--instrument', others[0])}."
    )


def is_known(model: str) -> bool:
    """Whether a unit of some model is one of them."""
    return any(model.upper().startswith(each.models) for each in INSTRUMENTS.values())


def of_model(model: str) -> Instrument:
    """The instrument that a unit of some model is; the usual one where it is none of those known."""
    known = (each for each in INSTRUMENTS.values() if model.upper().startswith(each.models))
    return next(known, INSTRUMENTS[DEFAULT])

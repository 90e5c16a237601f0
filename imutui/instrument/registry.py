"""The instruments that imutui has drivers of, by name."""

from imutui.command_line import command
from imutui.instrument.driver import Driver
from imutui.instrument.imu400.driver import Imu400cd
from imutui.instrument.names import DEFAULT
from imutui.instrument.port import Port
from imutui.instrument.uut.driver import Imu381

INSTRUMENTS: dict[str, type[Driver]] = {each.name: each for each in (Imu400cd, Imu381)}


def which_answers(port: Port) -> type[Driver]:
    """Return the instrument that answers at an open port; the usual one if none does.

    First all are asked at the usual one's own speed, itself last. At another speed it receives other bytes than were
    sent: of `UUPK` at 57600 baud, at 38400 a `b`, by which it would set out to change its speed.
    """
    baud, usual = port.baud, INSTRUMENTS[DEFAULT]
    others = [each for each in INSTRUMENTS.values() if each is not usual]
    for instrument in (*others, usual):
        if instrument(port).answers(usual.power_up_bauds[0]):
            return instrument
    for instrument in others:
        if instrument(port).answers():
            return instrument
    port.set_baud(baud)
    return usual


def nor_the_others() -> str:
    """Return the sentence for a port at which the usual instrument, and none of the others, has answered."""
    others = [name for name in INSTRUMENTS if name != DEFAULT]
    return (
        f"Nor did any of the others answer: {', '.join(others)}. One that is quiet and slow to answer has to be named:"
        f" {command('record', '--instrument', others[0])}."
    )


def is_known(model: str) -> bool:
    """Return True if a unit of this model is one of the instruments."""
    return any(model.upper().startswith(each.models) for each in INSTRUMENTS.values())


def of_model(model: str) -> type[Driver]:
    """Return the instrument of a model; the usual one if the model is not known."""
    known = (each for each in INSTRUMENTS.values() if model.upper().startswith(each.models))
    return next(known, INSTRUMENTS[DEFAULT])

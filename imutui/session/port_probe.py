"""What answers at a port, for a list of ports: the first steps of the opening dialogue and no more."""

import os

from imutui.instrument.driver import InstrumentError
from imutui.instrument.names import DEFAULT
from imutui.instrument.port import Port, PortError, resolve
from imutui.instrument.registry import INSTRUMENTS, nor_the_others, which_answers
from imutui.session.identity import model_of
from imutui.session.snapshot import ProbeAnswer


def probe(port: str) -> ProbeAnswer:
    """Open a port, stop what streams, ping, ask for version and serial number; see `client.probe`."""
    try:
        with Port(port, INSTRUMENTS[DEFAULT].power_up_bauds[0]) as line:
            instrument = which_answers(line)
            host = instrument(line)
            try:
                identity = host.find()
            except InstrumentError as error:
                raise InstrumentError(f"{error} {nor_the_others()}") from error
            found = not_answered(port, None)
            found["answers"], found["baud"] = True, line.baud
            found["instrument"] = model_of(identity.version) or instrument.model
            found["serial_number"], found["firmware"] = identity.serial_number, identity.version
            try:
                host.check_model(identity)
            except InstrumentError as error:
                found["error"] = str(error)
            return found
    except (PortError, InstrumentError) as error:
        return not_answered(port, str(error))


def not_answered(port: str, error: str | None) -> ProbeAnswer:
    """Record of a port where nothing answered, and why."""
    return {
        "port": port,
        "answers": False,
        "instrument": "",
        "serial_number": "",
        "firmware": "",
        "baud": None,
        "error": error,
    }


def same_port(one: str, other: str) -> bool:
    """Whether two names mean the same line."""
    if "://" in one or "://" in other:
        return one == other
    return os.path.realpath(resolve(one)) == os.path.realpath(resolve(other))

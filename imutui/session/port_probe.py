"""What answers at a port, for a list of ports: the first steps of the opening dialogue and no more."""

import os
import re

from imutui.instrument.host import InstrumentError
from imutui.instrument.port import Port, PortError, resolve
from imutui.instrument.registry import DEFAULT, INSTRUMENTS
from imutui.session.snapshot import ProbeAnswer


def probe(port: str) -> ProbeAnswer:
    """Open a port, stop what streams, ping, ask for version and serial number; see `client.probe`."""
    try:
        instrument = INSTRUMENTS[DEFAULT]
        with Port(port, instrument.power_up_bauds[0]) as line:
            host = instrument.host(line, None)
            identity = host.find()
            found: ProbeAnswer = {
                "port": port,
                "answers": True,
                "instrument": _model(identity.version) or instrument.model,
                "serial_number": identity.serial_number,
                "firmware": identity.version,
                "baud": line.baud,
                "error": None,
            }
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


def _model(version: str) -> str:
    """Model in a version text such as "IMU400CD-200 1.07"; empty if it names none."""
    named = re.match(r"[A-Z]{2,}[ -]?\d+[A-Z]*(-\d+)?", version.strip(), re.IGNORECASE)
    return named[0] if named else ""

"""What answers at a port, for a list of ports: the first steps of the opening dialogue and no more."""

import os
import re

from imutui.instrument.messages import POWER_UP_BAUD
from imutui.instrument.port import Port, PortError, resolve
from imutui.session import handshake
from imutui.session.handshake import InstrumentError
from imutui.session.snapshot import ProbeAnswer


def probe(port: str) -> ProbeAnswer:
    """Open a port, stop what streams, ping, ask for version and serial number; see `client.probe`."""
    try:
        with Port(port, POWER_UP_BAUD) as line:
            handshake.find_speed(line, POWER_UP_BAUD)
            identity = handshake.identify(line)
            found: ProbeAnswer = {
                "port": port,
                "answers": True,
                "instrument": _model(identity.version),
                "serial_number": identity.serial_number,
                "firmware": identity.version,
                "baud": line.baud,
                "error": None,
            }
            try:
                handshake.check_model(line, identity)
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
    """Model in a version text such as "IMU400CD-200 1.07"; that of the unit we know if it names none."""
    named = re.match(r"[A-Z]{2,}[ -]?\d+[A-Z]*(-\d+)?", version.strip(), re.IGNORECASE)
    return named[0] if named else "IMU400CD-200"

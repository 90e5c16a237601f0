"""A port that is not there, is not allowed, or is somebody else's."""

import fcntl
import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path

from helpers.commands import imutui
from helpers.fake_devices import Device, Habits, answers
from helpers.processes import LIMIT_S, command_line

from imutui.instrument.imu400.crossbow import POWER_UP_BAUD
from imutui.instrument.port import Port, PortError

_NOBODY = 65534
_UNPRIVILEGED = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"]
# asks whether TIOCEXCL is set; Python has no name for it
_TIOCGEXCL = 0x80045440
_GOOD = Habits(answers(), streams=None)


def unprivileged() -> list[str] | None:
    """What makes of a command line one without root's powers, nothing for others than root; None if that can't be."""
    if os.getuid() != 0:
        return []
    if shutil.which("setpriv") is None:
        return None
    tried = subprocess.run(
        [*_UNPRIVILEGED, sys.executable, "-c", ""], capture_output=True, timeout=LIMIT_S, check=False
    )
    return _UNPRIVILEGED if tried.returncode == 0 else None


def deny(path: Path) -> None:
    """Let nobody but root use it."""
    if os.getuid() == 0:
        os.chown(path, _NOBODY, -1)
    path.chmod(0)


Refusals = dict[str, tuple[int, str]]  # exit code and words of `imutui record`, by what is wrong with its port


def refusals(folder: Path) -> Refusals:
    """Record from a port that is absent, one that is in use, and one without permission, where that can be had."""
    found = {"absent": _record(folder / "no-such-port")}
    with Device(_GOOD) as device:
        descriptor = os.open(device.port, os.O_RDWR | os.O_NOCTTY)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        found["busy"] = _record(Path(device.port))
        os.close(descriptor)
        without = unprivileged()
        if without is not None:
            deny(Path(device.port))
            line = [*without, *command_line("record", "--port", device.port, "--json")]
            done = subprocess.run(line, capture_output=True, text=True, timeout=LIMIT_S, check=False)
            assert done.stdout == ""
            found["permission"] = done.returncode, done.stderr
    return found


def _record(port: Path) -> tuple[int, str]:
    done = imutui("record", "--port", port, "--json", check=None)
    assert done.stdout == ""
    return done.returncode, done.stderr


def second_openings() -> dict[str, bool]:
    """Whether a second opening is refused, by who comes second after whom."""
    with Device(_GOOD) as device:
        with Port(device.port, POWER_UP_BAUD):
            found = {
                "imutui after imutui": _is_refused(device.port),
                "any program after imutui": is_exclusive(device.port),
            }
            found["a program that locks after imutui"] = not _locks(device.port)
        descriptor = os.open(device.port, os.O_RDWR | os.O_NOCTTY)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        found["imutui after a program that locks"] = _is_refused(device.port)
        os.close(descriptor)
    return found


def _is_refused(port: str) -> bool:
    try:
        Port(port, POWER_UP_BAUD).close()
    except PortError as error:
        assert "in use" in str(error)
        return True
    return False


def _locks(port: str) -> bool:
    try:
        descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True


def is_exclusive(path: str) -> bool:
    """Whether a terminal may not be opened again, by ioctl_tty(2); root may, so the mark itself is looked at."""
    if os.getuid() != 0:
        try:
            os.close(os.open(path, os.O_RDWR | os.O_NOCTTY))
        except OSError:
            return True
        return False
    descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        return bool(struct.unpack("i", fcntl.ioctl(descriptor, _TIOCGEXCL, bytes(4)))[0])
    finally:
        os.close(descriptor)

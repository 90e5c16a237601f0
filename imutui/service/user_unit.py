"""The unit of a user's systemd that records with one instrument for good, and the settings of each instance."""

import os
import pwd
import re
import subprocess
import sys
import tempfile
from importlib import resources
from pathlib import Path

import platformdirs

from filters.errors import InputError
from imutui import service
from imutui.plain_text import in_line

FILE = "imutui@.service"
LINGER = Path("/var/lib/systemd/linger")

_VERIFY_S = 60.0
_PLAIN = re.compile(r"[\w@%+:,./=$-]+", re.ASCII)  # needs no quotes, in a unit or a file of settings
_ESCAPED = re.compile(r'["\\`$]')


def text() -> str:
    """The unit, for this installation of imutui."""
    return resources.files(__package__).joinpath(FILE).read_text().replace("@IMUTUI@", _command())


def settings_text(port: str, logs: str) -> str:
    """Settings of one instance: what its command line and its environment are.

    `port`: of its instrument.
    `logs`: folder of its recordings.
    """
    return (
        f"# settings of this instance; `systemctl --user restart` takes them up\nPORT={env_value(port)}\n"
        "# further options of `imutui record`\nOPTIONS=--rotate-minutes 60\n"
        "# any setting that `imutui config` shows, in capitals: paths.logs is\n"
        f"IMUTUI_PATHS_LOGS={env_value(logs)}\n"
    )


def unit_path() -> Path:
    """Where the unit belongs."""
    return Path(platformdirs.user_config_dir("systemd")) / "user" / FILE


def settings_path(name: str) -> Path:
    """Where the settings of an instance belong, %E/imutui/NAME.env in the unit."""
    return Path(platformdirs.user_config_dir("imutui")) / f"{name}.env"


def verified(unit: str) -> str | None:
    """What `systemd-analyze verify --user` says of a unit: "" if nothing, None if this machine does not have it."""
    program = service.program("systemd-analyze")
    if program is None:
        return None
    with tempfile.TemporaryDirectory(prefix="imutui-") as folder:
        path = Path(folder) / FILE
        path.write_text(unit)
        done = subprocess.run(
            [program, "verify", "--user", "--man=no", str(path)],
            capture_output=True,
            text=True,
            timeout=_VERIFY_S,
            check=False,
            # it looks for a folder of the user's, whether or not this was started in one of their sessions
            env={**os.environ, "XDG_RUNTIME_DIR": os.environ.get("XDG_RUNTIME_DIR") or folder},
        )
    said = (done.stdout + done.stderr).strip()
    return said or ("" if done.returncode == 0 else f"systemd-analyze ended with {done.returncode}")


def lingers() -> bool:
    """Whether this user's services run without a log-in."""
    try:
        return (LINGER / pwd.getpwuid(os.getuid()).pw_name).exists()
    except (KeyError, OSError):  # a user id without a name
        return False


def _command() -> str:
    """Command line of this installation's program as a unit has it."""
    program = Path(sys.executable).with_name("imutui")
    words = [str(program)] if program.is_file() else [sys.executable, "-P", "-m", "imutui"]
    return " ".join(_quoted(word) for word in words)


def _quoted(word: str) -> str:
    # % and $ stand for something in a unit; within quotes systemd reads C's escapes
    escaped = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$").replace("\n", "\\n")
    return escaped if _PLAIN.fullmatch(word) else f'"{escaped}"'


def env_value(value: str) -> str:
    """Return a value as a file for systemd's `EnvironmentFile=` has it, which reads the same value back.

    In double quotes systemd takes every character as it is, line breaks too, except that a backslash before `"`, a
    backslash, `` ` `` or `$` stands for that character (systemd.exec(5), `EnvironmentFile=`).
    Raises InputError for bytes that are no text: systemd refuses a file with them.
    """
    if _PLAIN.fullmatch(value):
        return value
    if any("\ud800" <= character <= "\udfff" or character == "\0" for character in value):
        raise InputError(f"{in_line(value)} cannot stand in a file of settings: systemd reads UTF-8 only")
    escaped = _ESCAPED.sub(r"\\\g<0>", value)
    return f'"{escaped}"'

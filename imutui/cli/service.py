"""`imutui service`."""

import re
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from imutui.cli.exit_codes import FINDINGS, FINE, USAGE, answer, fail, refuse_existing, say, tell
from imutui.cli.options import Force, Json, Output

if TYPE_CHECKING:
    from imutui.service.udev_rule import UsbAdapter

_NAME = r"[A-Za-z0-9][A-Za-z0-9_.:-]{0,63}"


class CheckedFile(TypedDict):
    """A file of the service: where it belongs, whether it is there, and what was found of it.

    `verified_by` names what looked at it; `problems` is empty if all is well.
    """

    path: str
    installed: bool
    verified_by: list[str]
    problems: list[str]


def command(
    unit: Annotated[bool, typer.Option("--unit", help="Print the unit of the user's systemd.")] = False,
    udev: Annotated[
        bool, typer.Option("--udev", help="Print the udev rule: for one adapter with --port, else for all usual ones.")
    ] = False,
    check: Annotated[
        bool, typer.Option("--check", help="Verify both: those that are installed, else those that would be.")
    ] = False,
    install: Annotated[
        bool, typer.Option("--install", help="Write the unit, and the settings of NAME, to where they belong.")
    ] = False,
    name: Annotated[str, typer.Option("--name", help="Of the acquisition, and of the unit's instance.")] = "default",
    port: Annotated[str | None, typer.Option("--port", help="Of its instrument.")] = None,
    output: Output = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Have an acquisition run by itself: started at boot, and again when it ends with an error.

    Without an option: what is to be done, step by step. Nothing here needs root or starts anything; where root is
    needed the command to type is printed.

    Exit code of --check: 0, or 1 if something is wrong or could not be verified.

    Example: imutui service --install --name table --port /dev/ttyUSB0
    """
    from imutui.service import udev_rule, user_unit

    if not re.fullmatch(_NAME, name):
        raise fail(
            USAGE, f'--name "{name}": letters, digits, "_", ".", ":" and "-" only, since it is part of file names.'
        )
    if sum((unit, udev, check, install)) > 1:
        raise fail(USAGE, "--unit, --udev, --check and --install: one at a time.")
    if check:
        _check(_adapter(port), name, json=json)
    elif install:
        _install(name, port, force=force)
    elif unit or udev:
        _write(user_unit.text() if unit else udev_rule.text(_adapter(port), name), output, force=force)
    else:
        tell(_steps(name, port))


def _adapter(port: str | None) -> "UsbAdapter | None":
    from imutui.instrument.port import resolve
    from imutui.service import udev_rule

    return None if port is None else udev_rule.of_port(resolve(port))


def _write(text: str, output: Path | None, *, force: bool) -> None:
    from imutui.logbook import atomic_file

    if output is None:
        tell(text.removesuffix("\n"))
        return
    refuse_existing(output, force)
    atomic_file.write(output, text, overwrite=force)


def _install(name: str, port: str | None, *, force: bool) -> None:
    from imutui import config
    from imutui.instrument.port import lasting_name
    from imutui.service import user_unit

    if port is None:
        raise fail(USAGE, "--install needs --port: of the instrument. `imutui devices` lists the ports.")
    logs = Path(config.load().text("paths.logs")).resolve()
    files = {user_unit.unit_path(): user_unit.text()}
    files[user_unit.settings_path(name)] = user_unit.settings_text(_absolute(lasting_name(port)), str(logs))
    wanted = {path: text for path, text in files.items() if not _is(path, text)}
    for path in wanted:
        refuse_existing(path, force, "leave it as it is and edit it")
    for path, text in wanted.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        _write(text, path, force=force)
    for path in files:
        say(f"{'wrote' if path in wanted else 'is there already:'} {path}")
    tell(_steps(name, port))


def _absolute(port: str) -> str:
    """A port as a program finds it that is started in another folder."""
    return port if "://" in port or port == "virtual" else str(Path(port).absolute())


def _is(path: Path, text: str) -> bool:
    try:
        return path.read_text() == text
    except OSError:
        return False


def _steps(name: str, port: str | None) -> str:
    """What to do, with what is done already."""
    from imutui import command_line
    from imutui.command_line import joined
    from imutui.service import udev_rule, user_unit

    where = port or "/dev/ttyUSB0"
    flags = ("--name", name, "--port", where)
    rule = joined("sudo", "tee", udev_rule.FOLDER / udev_rule.file_name(name))
    ready = user_unit.unit_path().exists() and user_unit.settings_path(name).exists()
    rest = [
        (command_line.command("service", "--install", *flags), f"unit and settings{': done' if ready else ''}"),
        (f"$EDITOR {joined(user_unit.settings_path(name))}", "rate, files, note: options of `imutui record`"),
        (f"{command_line.command('service', '--udev', *flags)} | {rule}", "for a USB adapter: name, group, latency"),
        ("sudo udevadm control --reload && sudo udevadm trigger", "takes the rule up; or plug it in again"),
        (f"sudo usermod -aG {udev_rule.group()} $USER", "the right to open it; then log in again"),
        (
            "loginctl enable-linger",
            f"runs from boot on{': done' if user_unit.lingers() else ', and after you log out'}",
        ),
        ("systemctl --user daemon-reload", ""),
        (f"systemctl --user enable --now imutui@{name}", "begins to record"),
        (f"imutui status; {command_line.command('attach', '--name', name)}", "how it goes"),
        (f"journalctl --user -u imutui@{name}", "what it said"),
        (f"systemctl --user stop imutui@{name}", "finishes the file"),
    ]
    return "\n".join(
        f"{number:2}. {typed}{f'    # {why}' if why else ''}" for number, (typed, why) in enumerate(rest, 1)
    )


def _check(adapter: "UsbAdapter | None", name: str, *, json: bool) -> None:
    from imutui.document_shape import VERSION

    found = {"unit": _checked_unit(), "rule": _checked_rule(adapter, name)}
    answer({"version": VERSION, **found}, lambda: "\n".join(starmap(_told, found.items())), json=json)
    raise typer.Exit(FINDINGS if any(file["problems"] for file in found.values()) else FINE)


def _told(what: str, file: CheckedFile) -> str:
    where = f"{what} {file['path']}, {'installed' if file['installed'] else 'not installed'}"
    by = ", ".join(file["verified_by"]) or "nothing"
    return "\n  ".join([f"{where}: {'problems' if file['problems'] else 'fine'}, verified by {by}", *file["problems"]])


def _checked_unit() -> CheckedFile:
    from imutui.service import user_unit

    path = user_unit.unit_path()
    installed = path.is_file()
    said = user_unit.verified(path.read_text() if installed else user_unit.text())
    missing = "this machine has no systemd-analyze (Debian's package systemd), so that it was not verified"
    by = [] if said is None else ["systemd-analyze verify --user"]
    problems = [missing] if said is None else said.splitlines()
    return {"path": str(path), "installed": installed, "verified_by": by, "problems": problems}


def _checked_rule(adapter: "UsbAdapter | None", name: str) -> CheckedFile:
    """What udev says of the rule where it can verify; else whether it is the one that imutui makes."""
    from imutui.service import udev_rule

    path = udev_rule.FOLDER / udev_rule.file_name(name)
    installed, made = path.is_file(), udev_rule.text(adapter, name)
    text = path.read_text() if installed else made
    by, problems = ["imutui"] if text == made else [], []
    said = udev_rule.verified_by_udevadm(text)
    if said is not None:
        by.append("udevadm verify")
        problems = said.splitlines()
    elif text != made:
        problems = [
            "it is not what `imutui service --udev` prints with the same options, and this machine has no `udevadm"
            " verify` (systemd 254 and later), so that it was not verified"
        ]
    return {"path": str(path), "installed": installed, "verified_by": by, "problems": problems}

"""The commands, one file each; the only place with exit codes.

What is no command: `exit_codes` how a command ends · `options`, `session_options` what several commands take ·
`each_log` one job over logs named on the command line · `follow_acquisition` what `record` and the headless demo show ·
`virtual_units` which virtual instrument runs, `virtual_readings` what it reads.

0 fine · 1 findings (RED, not converged, damaged file) · 2 usage · 3 input unreadable · 4 instrument or port · 5 disk ·
130 interrupted. Each command imports what it needs when it runs, so that help is instant.
"""

import atexit
import gc
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from imutui.cli.exit_codes import USAGE, fail, flush, handled, tell, told

_KINDS = {"valid integer": "a whole number", "valid number": "a number", "valid float": "a number"}
"""What versions of typer say of a text that is none, and what it is none of."""


_NEGATIVE = re.compile(r"-[0-9.]+")


class Command(TyperCommand):
    """A command that names the option whose value is not a number, or not a finite one."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Parse the arguments; raises the exit for a value that is not a finite number where one belongs."""
        given = list(args)
        # a negative number is no option
        if any(_NEGATIVE.fullmatch(word) for word in args):
            extra["ignore_unknown_options"] = True
        try:
            context = super().make_context(info_name, args, parent, **extra)
        except typer.BadParameter as error:
            said = _words(error, given, info_name or "")
            if said is None:
                raise
            raise fail(USAGE, said) from error
        for option in self.params:
            value = context.params.get(option.name or "")
            if isinstance(value, float) and not math.isfinite(value):
                raise fail(USAGE, f"{option.opts[0]} is {value}, not a finite number. Help: imutui {info_name} -h")
        return context


def _words(error: typer.BadParameter, args: Sequence[str], command: str) -> str | None:
    """What is wrong, or None where it is something else than a number."""
    option: Any = error.param
    kind = next((kind for words, kind in _KINDS.items() if words in str(error)), None)
    found = None if kind is None or option is None else _given(option.opts, args)
    if found is None:
        return None
    name, value = found
    return f'{name} is "{value}", not {kind}. {option.help or ""} All options: imutui {command} -h'.replace("  ", " ")


def _given(names: Sequence[str], args: Sequence[str]) -> tuple[str, str] | None:
    """The option as it was typed, and its value; the last one counts."""
    found = None
    for place, word in enumerate(args):
        name, equals, value = word.partition("=")
        if name in names and equals:
            found = name, value
        elif word in names and place + 1 < len(args):
            found = word, args[place + 1]
    return found


# ---------------------------------------------------------------------------------------------------------------- cli

COMMANDS = (
    "demo",
    "devices",
    "record",
    "attach",
    "status",
    "mark",
    "note",
    "stop",
    "foxglove",
    "virtual",
    "table",
    "import",
    "export",
    "info",
    "check",
    "recover",
    "replay",
    "trace",
    "investigate",
    "apply",
    "report",
    "campaign",
    "collect",
    "profile",
    "config",
)
"""Names of the commands, in the order of help; each has a module, which is loaded when it is needed."""


def command_of(name: str) -> Callable[..., None]:
    """Return the function of a command."""
    function: Callable[..., None] = import_module(f"imutui.cli.{_MODULES.get(name, name)}").command
    return function


_MODULES = {"import": "import_"}


def _version(wanted: bool) -> None:
    if wanted:
        import imutui

        tell(f"imutui {imutui.__version__}")
        raise typer.Exit


def _root(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Acquire, calibrate and trace an IMU on a turn table.

    Without a command: the terminal UI. It attaches to the running acquisition, else offers to connect.

    New here? `imutui demo` runs the whole job on a virtual instrument.
    """
    if context.invoked_subcommand is None:
        from imutui.cli import attach

        handled(attach.open_ui)()


def _program(names: Iterable[str]) -> typer.Typer:
    """Return the program with some of the commands."""
    app = typer.Typer(
        no_args_is_help=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
        epilog=(
            "Exit codes: 0 fine, 1 findings, 2 usage, 3 input unreadable, 4 instrument or port, 5 disk, 130"
            " interrupted."
        ),
    )
    app.callback(invoke_without_command=True)(_root)
    for name in names:
        app.command(name, cls=Command)(handled(command_of(name)))
    return app


def main() -> None:
    """Run the command that the command line names; `imutui.__main__` is where the program begins."""
    # a filter step works on 15×15 matrices: threads of the linear algebra library only get in each other's way
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # what is loaded stays: looking through it for garbage takes longer than loading much of it
    gc.set_threshold(30_000, 5, 5)
    # and so does looking through all of it once more when Python ends
    atexit.register(gc.freeze)
    try:
        try:
            # loading all commands takes longer than loading one
            named = [name for name in sys.argv[1:2] if name in COMMANDS]
            _program([] if sys.argv[1:] == ["--version"] else named or COMMANDS)(prog_name="imutui")
        finally:
            flush()
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001 - what is no command's own, such as help
        sys.exit(told(error))

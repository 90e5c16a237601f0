"""`imutui attach`, and `imutui` without a command: the terminal UI."""

import os
import sys
from typing import TYPE_CHECKING

import typer

from imutui.cli.exit_codes import USAGE, fail
from imutui.cli.options import Name

if TYPE_CHECKING:
    from imutui.session.client import Client
    from imutui.tui.terminal.appearance import Appearance


def command(name: Name = None) -> None:
    """Open the terminal UI on the running acquisition.

    Example: imutui attach
    """
    from imutui.session import client

    _show(client.attach(name, stays=True))


def open_ui() -> None:
    """Attach to the running acquisition, else offer to connect."""
    from imutui.session import client

    names = client.running()
    _show(client.attach(names[0], stays=True) if len(names) == 1 else None)


def appearance() -> "Appearance":
    """How the configuration wants the screen; InputError if that cannot be."""
    from imutui import config
    from imutui.tui.terminal.appearance import Appearance

    settings = config.load()
    return Appearance(
        settings.text("screen.theme"),
        settings.text("screen.glyphs"),
        settings.number("screen.fps"),
        settings.text("screen.plot"),
    )


def has_screen() -> bool:
    """Whether the terminal UI has something to show itself on: a terminal, or a driver of its own (a browser)."""
    return bool(os.environ.get("TEXTUAL_DRIVER")) or (sys.stdin.isatty() and sys.stderr.isatty())


def _show(connection: "Client | None") -> None:
    from imutui import config
    from imutui.cli.session_options import plan_from

    if not has_screen():
        raise fail(
            USAGE, "the terminal UI needs a terminal. Without one: `imutui record`, `imutui status`, `imutui --help`."
        )
    wanted = appearance()
    from imutui.tui import app

    defaults = plan_from(config.load(), None, checked=False, port="virtual")
    raise typer.Exit(app.run(connection, defaults=defaults, appearance=wanted))

"""`imutui attach`, and `imutui` without a command: the terminal UI."""

import os
import sys
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from imutui.cli.exit_codes import USAGE, fail
from imutui.cli.options import Name

if TYPE_CHECKING:
    from imutui.session.client import Client
    from imutui.tui.terminal.appearance import Appearance


def command(
    name: Name = None,
    batch: Annotated[str | None, typer.Option("--batch", metavar="NAME", help="All units of a batch.")] = None,
) -> None:
    """Open the terminal UI on the running acquisition, or on the units of a batch.

    Example: imutui attach --batch lot2
    """
    from imutui.session import batch as session_batch
    from imutui.session import client

    if batch is not None:
        session_batch.names(batch)  # says what runs instead
        show_batch(batch)
    _show(client.attach(name))


def open_ui() -> None:
    """Attach to the only running acquisition, or to the only running batch; otherwise offer to connect."""
    from imutui.session import batch, client

    names, batches = client.running(), batch.running()
    if len(batches) == 1 and batch.names(batches[0]) == names:
        show_batch(batches[0])
    _show(client.attach(names[0]) if len(names) == 1 else None)


def show_batch(name: str) -> NoReturn:
    """Open the terminal UI on the units of a batch."""
    _show(None, name)


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


def _show(connection: "Client | None", batch: str = "") -> NoReturn:
    from imutui import config
    from imutui.cli.session_options import plan_from

    if not has_screen():
        raise fail(
            USAGE, "the terminal UI needs a terminal. Without one: `imutui record`, `imutui status`, `imutui --help`."
        )
    wanted = appearance()
    from imutui.tui import app

    defaults = plan_from(config.load(), None, checked=False, port="virtual")
    raise typer.Exit(app.run(connection, defaults=defaults, appearance=wanted, batch=batch))

"""`imutui attach`, and `imutui` without a command: the terminal UI."""

import typer

from imutui.cli.options import Name


def command(name: Name = None) -> None:
    """Open the terminal UI on the running acquisition.

    Example: imutui attach
    """
    from imutui.session import client

    _show(client.attach(name))


def open_ui() -> None:
    """Attach to the running acquisition, else offer to connect."""
    from imutui.session import client

    names = client.running()
    _show(client.attach(names[0]) if len(names) == 1 else None)


def _show(connection: "object | None") -> None:
    import sys

    from imutui import config
    from imutui.cli.outcome import USAGE, fail
    from imutui.cli.session_options import plan_from
    from imutui.session.client import Client
    from imutui.tui import app

    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise fail(
            USAGE, "the terminal UI needs a terminal. Without one: `imutui record`, `imutui status`, `imutui --help`."
        )
    assert connection is None or isinstance(connection, Client)
    raise typer.Exit(app.run(connection, defaults=plan_from(config.load(), None, port="virtual")))

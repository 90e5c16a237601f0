"""`imutui config`."""

from typing import Annotated

import typer

from imutui.cli.options import Json


def command(
    show: Annotated[bool, typer.Option("--show", help="Print every setting (the default).")] = True, json: Json = False
) -> None:
    """Print each effective setting with its source.

    Flags win over the environment (IMUTUI_PATHS_LOGS for paths.logs), ./imutui.toml, the user's file, and defaults.

    Example: imutui config --show
    """
    from imutui import config
    from imutui.cli.outcome import say
    from imutui.logbook.results import dumps

    loaded = config.load()
    for warning in loaded.warnings:
        say(f"imutui: {warning}")
    if json:
        print(dumps({key: {"value": s.value, "source": s.source} for key, s in loaded.settings.items()}))
    elif show:
        for key, s in loaded.settings.items():
            print(f"{key} = {s.value!r:30}  # {s.source}")

"""`imutui mark`."""

from typing import Annotated

import typer

from imutui.cli.exit_codes import tell
from imutui.cli.options import Name


def command(text: Annotated[str, typer.Argument(help="What to write into the recording.")], name: Name = None) -> None:
    """Put a mark into the running recording.

    Example: imutui mark "table at 90 deg"
    """
    from imutui.session import client

    acquisition = client.attach(name)
    acquisition.mark(text)
    tell(f"marked in {acquisition.name}: {text}")

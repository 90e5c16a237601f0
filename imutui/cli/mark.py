"""`imutui mark`."""

from typing import Annotated

import typer

from imutui.cli.options import Name, OfBatch, ask_each


def command(
    text: Annotated[str, typer.Argument(help="What to write into the recording.")],
    name: Name = None,
    batch: OfBatch = None,
) -> None:
    """Put a mark into the running recording, or into those of a batch.

    Where a table profile is joined by marks, "segment 3" says that the table has arrived there, to every unit on it.

    Example: imutui mark "table at 90 deg"
    """
    ask_each(name, batch, lambda acquisition: acquisition.mark(text), f"marked in {{}}: {text}")

"""`imutui note`."""

from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.exit_codes import USAGE, fail, tell
from imutui.cli.options import Flags, Name, OfBatch, ask_each, takes_settings


@takes_settings("acquisition.operator")
def command(
    *,
    text: Annotated[str | None, typer.Argument(help='The note; "" for none.')] = None,
    flags: Flags,
    log: Annotated[
        Path | None,
        typer.Option("--log", metavar="LOG", help="A finished log instead; the note goes into a file beside it."),
    ] = None,
    name: Name = None,
    batch: OfBatch = None,
) -> None:
    """Say or change the note of the running recording, or of those of a batch, or add one to a log.

    Of a recording that runs, note and operator go into its file. Of a log that is there, they go into
    LOG.mcap.notes.toml beside it, with the time and your user name: the log and its SHA-256 stay as they are.

    Example: imutui note "second cold start" --log logs/sample.mcap
    """
    operator = flags.get("acquisition.operator")
    if text is None and operator is None:
        raise fail(USAGE, 'nothing to write: say a note, --operator, or both, such as: imutui note "cold start".')
    if log is None:
        wanted = "written into the file that {} is recording"
        ask_each(name, batch, lambda acquisition: acquisition.describe(text, operator), wanted)
        return
    from imutui.jobs import log_files

    tell(f"added to {log_files.annotate(log, text, operator)}; {log.name} is unchanged")

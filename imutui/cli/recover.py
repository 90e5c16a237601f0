"""`imutui recover`."""

from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.each_log import progress, width
from imutui.cli.exit_codes import FINDINGS, FINE, answer, check_output
from imutui.cli.options import Force, Json


def command(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log that is unfinished or damaged.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to make.")],
    force: Force = False,
    json: Json = False,
) -> None:
    """Make a finished, indexed log of an unfinished or damaged one.

    Every whole record is kept, also behind damage, and nothing is doubled. The new file is read back before this says
    that it is done; the source is never touched. What was lost is told here and in the new file.

    Exit code 0: all that was written is there, 1: parts were lost, 3: nothing can be read.

    Example: imutui recover logs/broken.mcap -o logs/fixed.mcap
    """
    from imutui import config
    from imutui.jobs.recover import recover
    from imutui.report.logs import recover_text

    check_output(output, force, log)
    document = recover(log, output, force, progress, config.load().file_mode)
    answer(document, lambda: recover_text(document, width()), json=json)
    raise typer.Exit(FINE if document["complete"] else FINDINGS)

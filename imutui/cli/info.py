"""`imutui info`."""

from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.options import Json


def command(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs, finished or not.")], json: Json = False
) -> None:
    """Say what is in logs.

    Instrument, operator, rate, length, temperature, reference, effects, marks, topics, attachments, and whether the
    file is finished. Damaged parts are passed over; `imutui check` names them.

    Example: imutui info logs/sample.mcap
    """
    from imutui.cli.each_log import over
    from imutui.jobs.info import info
    from imutui.report.logs import info_text

    over(logs, info, info_text, json=json)

"""`imutui check`."""

from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.each_log import over
from imutui.cli.options import Json, ReadAs, states_reading


@states_reading
def command(
    read_as: ReadAs,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs, finished or not.")],
    json: Json = False,
) -> None:
    """Look logs through: is the file whole, and do its parts agree.

    Checksums, the SHA-256 beside the file, index, every message; times, numbers, packets lost, samples against packets,
    gaps, limits, health of the channels, metadata, reference. Each finding says what, where, and what to do next.

    Exit code 0: fine, 1: findings, 3: unreadable.

    Example: imutui check logs/*.mcap
    """
    from imutui.jobs.check import check
    from imutui.report.logs import check_text

    reading = read_as()
    over(
        logs,
        lambda path, show: check(path, show, reading),
        check_text,
        json=json,
        fine=lambda document: bool(document["fine"]),
    )

"""`imutui info`."""

from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.each_log import over
from imutui.cli.exit_codes import USAGE, answer, fail
from imutui.cli.options import Json, ReadAs, states_reading


@states_reading
def command(
    read_as: ReadAs,
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...|FOLDER...", help="Logs, finished or not; or folders of logs.")
    ],
    json: Json = False,
) -> None:
    """Say what is in logs.

    Instrument, operator, rate, length, temperature, reference, effects, marks, topics, attachments, and whether the
    file is finished. Damaged parts are passed over; `imutui check` names them.

    Of a folder: a table with a row for each log, newest first, from the files' first and last few kilobytes; with
    --json a list of what is in the table.

    Example: imutui info logs/sample.mcap
    """
    if any(path.is_dir() for path in logs):
        _folders(logs, json=json)
        return
    from imutui.jobs.info import info
    from imutui.report.logs import info_text

    reading = read_as()
    over(logs, lambda path, show: info(path, show, reading), info_text, json=json)


def _folders(folders: list[Path], *, json: bool) -> None:
    from imutui.jobs.info import folder_logs, row
    from imutui.report import log_table

    file = next((path for path in folders if not path.is_dir()), None)
    if file is not None:
        raise fail(USAGE, f"{file} is no folder, and others are: ask for logs or for folders, one after the other.")
    found = {folder: folder_logs(folder) for folder in folders}
    tables = (log_table.text(str(folder), briefs, _columns()) for folder, briefs in found.items())
    answer([row(brief) for briefs in found.values() for brief in briefs], lambda: "\n\n".join(tables), json=json)


def _columns() -> int | None:
    """Columns of the terminal; None where the output goes elsewhere, so that nothing is cut."""
    import shutil
    import sys

    return shutil.get_terminal_size((80, 24)).columns if sys.stdout.isatty() else None

"""`imutui collect`."""

from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.exit_codes import FINDINGS, FINE, USAGE, answer, fail, say
from imutui.cli.options import Force, Json


def command(
    parts: Annotated[list[Path], typer.Argument(metavar="PART...", help="Folders of results, such as of shards.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="RESULTS", help="Folder for all of the results.")],
    force: Force = False,
    json: Json = False,
) -> None:
    """Make one folder of results of several: of the shards of a campaign, or of several machines.

    Parts with different settings are refused. A log that several parts have is taken once.

    Exit code 0: every log converged and is whole, and no part is missing, 1: else.

    Example: imutui collect part1 part2 part3 part4 -o results
    """
    from imutui import config
    from imutui.cli.campaign import check_results, counted, say_no_table
    from imutui.jobs.campaign import results_folder
    from imutui.jobs.campaign.collect import collect

    check_results(output, force)
    if any(part.exists() and output.exists() and part.samefile(output) for part in parts):
        raise fail(USAGE, f"-o names one of the parts, {output}; name another folder.")
    if results_folder.has_results(output):
        if not force:
            again = "--force replaces them, or name another folder with -o"
            raise fail(USAGE, f"{output} has results already, which are left as they are. {again}.")
        results_folder.remove_results(output)
    document = collect(parts, output, config.load().file_mode)
    for note in document["notes"]:
        say(f"imutui: {note}")
    if document["table"] is None and document["complete"]:
        say_no_table()
    counts = counted(document["logs"], document["errors"], document["not_fine"])
    answer(document, lambda: f"{document['results']}: {counts}", json=json)
    fine = document["complete"] and not document["errors"] and not document["not_fine"]
    raise typer.Exit(FINE if fine else FINDINGS)

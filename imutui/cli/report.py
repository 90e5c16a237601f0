"""`imutui report`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.exit_codes import USAGE, fail, lacking, print_json, refuse_existing, say, show_progress
from imutui.cli.options import Force, Json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from imutui.report.page import Result


def command(
    results: Annotated[
        list[Path], typer.Argument(metavar="RESULT...", help="JSON of `imutui trace --json` or `imutui replay --json`.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the page and its figures.")],
    force: Force = False,
    json: Json = False,
) -> None:
    """Make pages to hand over from results of replay and trace, and compare them where there are several.

    Unit and files, verdict, what to do, error before and after, figures, how to apply it, data quality, provenance: as
    HTML in one file that requests nothing, as JSON, as PDF where chromium or chrome is at hand, with the
    figures as SVG and PNG. Figures over time need the logs, where the results say that they are, unchanged.

    Example: imutui report before.json after.json -o page
    """
    check_folder(output, force, "-o")
    from imutui.jobs import result_files

    documents = []
    for path in results:
        documents += result_files.read(path)
    written, notes = write_page(output, documents)
    if json:
        files, folder = [path.name for path in written], str(output.resolve())
        print_json({"version": 1, "folder": folder, "results": len(documents), "files": files, "notes": notes})


def write_page(folder: Path, documents: "Sequence[Result]") -> tuple[list[Path], list[str]]:
    """Write the page of results into a folder, printed too where a browser is at hand, and say what was left out.

    Returns what was written, the page first.
    Returns what was left out, sentences.
    """
    from imutui.jobs import page_data, result_files
    from imutui.report import page

    documents, notes = result_files.completed(documents)
    try:
        stories = [
            page.Story(d, page_data.of_result(d, lambda name: show_progress(f"reading {name}"))) for d in documents
        ]
        show_progress("drawing")
        written = page.write(folder, stories)
        notes += [sentence.rstrip(".") for story in stories for sentence in story.log.missing]
        show_progress("printing")
        written.append(page.print_page(written[0], folder / page.PRINT))
    except page.PrintError as error:
        notes.append(f"no PDF: {error}")
    for note in notes:
        say(f"imutui: {note}")
    say(f"imutui: {written[0]}: page with {sum(path.suffix == '.png' for path in written)} figures")
    return written, notes


def check_folder(folder: Path, force: bool, option: str) -> None:
    """Refuse what cannot be made before minutes are spent on it: no library to draw with, a folder that is taken."""
    from imutui.report import figures

    if not figures.available():
        raise lacking("a page has figures, drawn with matplotlib", "report")
    if folder.exists() and not folder.is_dir():
        raise fail(USAGE, f"{folder} is a file; {option} names a folder.")
    from imutui.report import page

    for name in page.NAMES:
        refuse_existing(folder / name, force, f"name another folder with {option}")

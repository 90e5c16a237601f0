"""`imutui report`."""

from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.options import Force


def command(
    results: Annotated[
        list[Path], typer.Argument(metavar="RESULT...", help="JSON of `imutui trace --json` or `imutui replay --json`.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the page and its figures.")],
    force: Force = False,
) -> None:
    """Make a page to hand over from results: unit and files, verdict, what to do, error before and after, figures.

    One HTML file that needs nothing else; figures as SVG and PNG and the results beside it. Where the logs are still
    where the results say, unchanged, dates and temperatures are taken from them.

    Example: imutui report trace.json -o report
    """
    check_folder(output, force, "-o")
    from imutui.cli.exit_codes import UNREADABLE, fail, say
    from imutui.jobs import result_files
    from imutui.report import page

    documents = []
    for path in results:
        documents += result_files.read(path)
    completed, notes = result_files.completed(documents)
    for note in notes:
        say(f"imutui: {note}")
    try:
        written = page.write(output, completed)
    except (ArithmeticError, IndexError, KeyError, TypeError, ValueError) as error:
        names = ", ".join(map(str, results))
        why = f"{names}: no page can be made of what stands there ({type(error).__name__}: {error})"
        raise fail(UNREADABLE, f"{why}. Make the result again with `imutui trace` or `imutui replay`.") from None
    say(f"imutui: {written[0]}: page with {sum(path.suffix == '.png' for path in written)} figures")


def check_folder(folder: Path, force: bool, option: str) -> None:
    """Refuse what cannot be made before minutes are spent on it: no library to draw with, a folder that is taken."""
    from imutui.cli.exit_codes import USAGE, fail, refuse_existing
    from imutui.cli.installed_from import command_for
    from imutui.report import figures

    if not figures.available():
        raise fail(
            USAGE,
            "a page has figures, which are drawn with matplotlib, and that is not installed here. Type this, then the"
            f" same command again:\n\n    {command_for('report')}\n",
        )
    if folder.exists() and not folder.is_dir():
        raise fail(USAGE, f"{folder} is a file; {option} names a folder.")
    refuse_existing(folder / "index.html", force, f"name another folder with {option}")

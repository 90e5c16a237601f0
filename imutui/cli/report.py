"""`imutui report`."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.each_log import width
from imutui.cli.exit_codes import (
    FINDINGS,
    FINE,
    USAGE,
    answer,
    fail,
    lacking,
    print_json,
    say,
    show_progress,
)
from imutui.cli.options import Force, Json

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from imutui.jobs.result_files import Result


def command(
    results: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="RESULT...",
            help="JSON of `imutui trace --json` or `imutui replay --json`. With --batch logs, or folders of them.",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder for the page and its figures.")
    ] = None,
    batch: Annotated[
        str | None,
        typer.Option("--batch", metavar="NAME", help="Result of a batch, of the logs in `paths.logs` unless named."),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Make pages to hand over from results of replay and trace, and compare them where there are several.

    Unit and files, verdict, what to do, error before and after, figures, how to apply it, data quality, provenance: as
    HTML in one file that requests nothing, as JSON, as PDF where chromium or chrome is at hand, with the
    figures as SVG and PNG. Figures over time need the logs, where the results say that they are, unchanged.

    --batch: filters the logs of a batch and tells on one page which units pass, which fail and why, and what is the
    table's or the room's because all units show it; behind it a page a unit. DIR holds rows for `imutui campaign
    --summary DIR` and `imutui collect` too. Exit code 0: all units pass, 1: else.

    Example: imutui report before.json after.json -o page

    Example: imutui report --batch july -o july
    """
    if output is None or not (results or batch):
        raise fail(USAGE, "what is asked for? Name results, or --batch NAME, and a folder with -o. imutui report -h")
    from imutui.document_shape import VERSION
    from imutui.report import page

    if batch is not None:
        _batch(batch, results or [], output, force=force, json=json)
        return
    check_folder(output, force, "-o", page.may_write)
    from imutui.jobs import result_files

    assert results is not None

    documents = []
    for path in results:
        documents += result_files.read(path)
    written, notes = write_page(output, documents, force=force)
    if json:
        files, folder = [path.name for path in written], str(output.resolve())
        print_json({"version": VERSION, "folder": folder, "results": len(documents), "files": files, "notes": notes})


def write_page(
    folder: Path, documents: "Sequence[Result]", *, force: bool, own: "Collection[str]" = ()
) -> tuple[list[Path], list[str]]:
    """Write the page of results into a folder, printed too where a browser is at hand, and say what was left out.

    `force`: replace files; which ones is said.
    `own`: names that may be replaced anyway, since the caller has written them.
    Returns what was written, the page first.
    Returns what was left out, sentences.
    """
    from imutui.jobs import page_data, result_files
    from imutui.report import page

    documents, notes = result_files.completed(documents)
    before = names_in(folder)
    try:
        stories = [
            page.Story(d, page_data.of_result(d, lambda name: show_progress(f"reading {name}"))) for d in documents
        ]
        show_progress("drawing")
        written = page.write(folder, stories, overwrite=force, own=own)
        notes += [sentence.rstrip(".") for story in stories for sentence in story.log.missing]
        show_progress("printing")
        written.append(page.print_page(written[0], folder / page.PRINT, overwrite=force))
    except page.PrintError as error:
        notes.append(f"no PDF: {error}")
    say_replaced(folder, before - {*own}, written)
    for note in notes:
        say(f"imutui: {note}")
    say(f"imutui: {written[0]}: page with {sum(path.suffix == '.png' for path in written)} figures")
    return written, notes


def names_in(folder: Path) -> set[str]:
    """Return the names of a folder's entries; none if there is no such folder."""
    return {path.name for path in folder.iterdir()} if folder.is_dir() else set()


def say_replaced(folder: Path, before: set[str], written: "Sequence[Path]") -> None:
    """Say which files of a folder were replaced or removed; `before`: their names before the writing."""
    for done, names in (
        ("replaced", before & {path.name for path in written}),
        ("removed, of an earlier page", before - names_in(folder)),
    ):
        if names:
            say(f"imutui: {folder}: {done}: {', '.join(sorted(names))}")


def _batch(name: str, logs: "Sequence[Path]", output: Path, *, force: bool, json: bool) -> None:
    """Write the pages of a batch, print its result, and end with the exit code that it has."""
    import os

    from imutui import config
    from imutui.jobs.campaign import batch, local, log_list, run, stored_rows
    from imutui.jobs.campaign.one_log import Settings
    from imutui.report import batch_report, page

    effective = config.load()
    check_folder(output, force, "-o", (batch_report.INDEX, batch_report.DOCUMENT).__contains__)
    asked = log_list.find([str(log) for log in logs] or [effective.text("paths.logs")])
    found = batch.logs_of(name, asked, lambda text: say(f"imutui: {text}"))
    for folder in sorted(batch.folders_of(found)):
        check_folder(output / folder, force, "-o", page.may_write)
    head = stored_rows.head_of(output)
    found = found if head is None else found.below(head["root"])
    campaign = run.Campaign(found, Settings(), output, mode=effective.file_mode)
    workers = partial(local.rows, workers=len(os.sched_getaffinity(0)))
    run.run(campaign, workers, lambda pace: show_progress(f"{pace.done} of {pace.wanted} logs"))
    rows = stored_rows.read(output).rows
    document = batch.result(name, [rows[log] for log in found.logs], found.root, str(output), show_progress)
    for unit in document["units"]:
        if unit["verdict"] is not None:
            own = [Path(found.root) / log for log in unit["logs"]]
            _unit_page(output / batch.folder_of(unit["name"]), own, force=force)
    before = names_in(output)
    written = batch_report.write(output, document, overwrite=force)
    say_replaced(output, before, written)
    say(f"imutui: {written[0]}: page of the batch")
    answer(document, lambda: batch_report.text(document, width()), json=json)
    raise typer.Exit(FINE if batch.is_fine(document) else FINDINGS)


def _unit_page(folder: Path, logs: "Sequence[Path]", *, force: bool) -> None:
    """Write the page of a unit: of its logs those that can be filtered."""
    from filters.errors import InputError
    from imutui.jobs import replay

    documents: list[Result] = []
    for log in logs:
        show_progress(f"filtering {log.name}")
        try:
            documents.append(replay.replay(log))
        except InputError:  # the batch's page says it
            continue
    folder.mkdir(exist_ok=True)
    write_page(folder, documents, force=force)


def check_folder(folder: Path, force: bool, option: str, may_write: "Callable[[str], bool]") -> None:
    """Raise the exit before any work for a page that cannot be made: no library to draw with, files in its place.

    `may_write`: whether the page may write a file of this name.
    """
    from imutui.report import figures

    if not figures.available():
        raise lacking("a page has figures, drawn with matplotlib", "report")
    if folder.exists() and not folder.is_dir():
        raise fail(USAGE, f"{folder} is a file; {option} names a folder.")
    there = sorted(name for name in names_in(folder) if may_write(name))
    if there and not force:
        raise fail(
            USAGE,
            f"{folder} has files that would be replaced, and stays as it is: {', '.join(there)}. --force replaces them,"
            f" or name another folder with {option}.",
        )

"""One job over logs named on the command line, one after the other: one log's trouble is not the others'."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import typer

from imutui.cli.exit_codes import FINDINGS, FINE, in_words, print_json, say, show_progress, tell
from imutui.cli.options import say_assumed

_WIDEST = 100

D = TypeVar("D", bound=Mapping[str, object])  # a result document
Progress = Callable[[float, str], None]


def over(
    logs: list[Path],
    job: Callable[[Path, Progress], D],
    text: Callable[[D, int], str],
    *,
    json: bool,
    fine: Callable[[D], bool] = lambda document: True,
) -> None:
    """Print what a job finds in each log and end with the worst exit code.

    `job`: takes a path and a callable for its progress; returns a document.
    `text`: makes text of a document, so many columns wide.
    """
    documents: list[D] = []
    code = FINE
    logs = _without_sums(logs)
    for log in logs:
        try:
            document = job(log, progress)
        except Exception as error:  # noqa: BLE001 - the same words that the command itself would end with
            wrong, words = in_words(error)
            say(f"imutui: {words}")
            code = max(code, wrong)
            continue
        assumed = document.get("assumed")
        say_assumed(log, assumed if isinstance(assumed, list) else [])
        code = max(code, FINE if fine(document) else FINDINGS)
        if not json:
            tell(("\n" if documents else "") + text(document, width()))
        documents.append(document)
    if json and (documents or len(logs) > 1):
        print_json(documents if len(logs) > 1 else documents[0])
    raise typer.Exit(code)


def _without_sums(logs: list[Path]) -> list[Path]:
    """Pass over the checksum of each log that is named too, as a shell names both for `logs/*`."""
    from imutui.logbook import checksum_file

    sums = {checksum_file.path_of(log) for log in logs}
    kept = [log for log in logs if log not in sums]
    if passed := len(logs) - len(kept):
        say(f"passed over {passed} checksum {'file' if passed == 1 else 'files'}: each is used with its log")
    return kept


def progress(share: float, what: str) -> None:
    """Show how far a job is, on a terminal only."""
    show_progress(f"{share * 100:3.0f} %  {what}" if share < 1.0 else "")


def width() -> int:
    """Columns for sentences: those of the terminal, but no more than read well."""
    return min(_WIDEST, shutil.get_terminal_size((80, 24)).columns)

"""Results of replays and traces in files of JSON: read and checked, and completed from the logs that they are of."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias, cast

from filters.tracing.trace_document import TraceDocument
from imutui import outside_file
from imutui.jobs import info
from imutui.logbook import reader
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.results import ResultDocument

Result: TypeAlias = TraceDocument | ResultDocument

LIMIT = 64 * 2**20
"""Longest file of results, bytes."""
_TRACE = {"version": int, "runs": list, "findings": list, "error": list, "status": dict}
_REPLAY = {"version": int, "log": str, "kind": str, "filter": str, "samples": int}
_RUN = {"id": str, "kind": str, "rate_hz": (int, float), "seconds": (int, float)}
_FILTERED = {"final": dict, "sd": dict, "converged_s": dict, "nis": dict, "noise": dict, "alarms": list}


def read(path: Path) -> list[Result]:
    """Results in a file.

    Parameters
    ----------
    path : Path
        What `imutui replay --json` or `imutui trace --json` printed.

    Raises
    ------
    UnreadableLogError
        If there are none in it; the message says what it is not.
    """
    how = "`imutui trace LOG... --json` and `imutui replay LOG... --json` print results"
    try:
        content = json.loads(outside_file.read(path, LIMIT))
    except OSError as error:
        raise UnreadableLogError(f"{path}: {error.strerror or error}. {how}") from error
    except (ValueError, RecursionError) as error:
        raise UnreadableLogError(f"{path} is no JSON of a result: {error}. {how}") from error
    found = content if isinstance(content, list) else [content]
    if not found:
        raise UnreadableLogError(f"{path} has no result in it. {how}")
    for document in found:
        if problem := _problem(document):
            raise UnreadableLogError(f"{path} is no result of a trace or a replay: {problem}. {how}")
    return cast("list[Result]", found)


def completed(results: Sequence[Result]) -> tuple[list[Result], list[str]]:
    """Results with date and temperature from their logs, and a sentence for each log that could not be asked.

    A log is asked only if it is where the result says and has the SHA-256 that stands there.

    Parameters
    ----------
    results : sequence of Result
        Of `read`; replays are replaced, not changed.
    """
    made: list[Result] = []
    notes: list[str] = []
    for result in results:
        if "findings" in result or "start_utc" in result:
            made.append(result)
            continue
        known, why = _of_log(Path(result["log"]), result["log_sha256"])
        made.append(cast("ResultDocument", {**result, **known}))
        notes += [why] if why else []
    return made, notes


def _of_log(path: Path, sha256: str | None) -> tuple[dict[str, Any], str]:
    lost = "when it was recorded and at which temperature is not stated in the page"
    try:
        if not path.is_file():
            return {}, f"{path} is not there: {lost}"
        if reader.sha256(path) != sha256:
            return {}, f"{path} is not the file that the result is of, its SHA-256 differs: {lost}"
        told = info.info(path)
    except (OSError, ValueError, UnreadableLogError) as error:
        return {}, f"{path} cannot be read ({error}): {lost}"
    temperature = told["temperature_degc"]
    return {
        "start_utc": "" if told["sampling"] == "imported" else told["start_utc"] or "",
        "temperature_degc": None if temperature is None else [temperature["min"], temperature["max"]],
    }, ""


def _problem(document: object) -> str:
    """What a document lacks to be a result; empty if it is one."""
    if not isinstance(document, dict):
        return "it is not an object"
    if "findings" in document:
        wrong = _wrong(document, _TRACE)
        return wrong or next((w for run in document["runs"] if (w := _wrong(run, _RUN))), "") or _none(document["runs"])
    return _wrong(document, _REPLAY) or (_wrong(document, _FILTERED) if "final" in document else "")


def _none(runs: list[object]) -> str:
    return "" if runs else "`runs` is empty"


def _wrong(document: object, fields: dict[str, Any]) -> str:
    if not isinstance(document, dict):
        return "a record of it is not an object"
    return next((f"`{key}` is {'absent' if key not in document else 'something else'}" for key, kind in fields.items()
                 if not isinstance(document.get(key), kind)), "")  # fmt: skip

"""Results of replays and traces in files of JSON: read and checked, and completed from the logs that they are of."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, cast

from filters.errors import InputError
from filters.tracing.trace_document import TraceDocument
from imutui import document_shape, outside_file
from imutui.command_line import command
from imutui.jobs import info
from imutui.jobs.investigation_diary import DiaryDocument
from imutui.logbook import added_notes, effects_file, reader
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.results import ReadingsDocument, ResultDocument

Result: TypeAlias = TraceDocument | ResultDocument | ReadingsDocument

T = TypeVar("T")

LIMIT = 64 * 2**20  # longest file of results, bytes


def read(path: Path) -> list[Result]:
    """Results in a file.

    `path`: what `imutui replay --json` or `imutui trace --json` printed.
    Raises UnreadableLogError if there are none in it; the message says what it is not.
    """
    how = "`imutui trace LOG... --json` and `imutui replay LOG... --json` print results"
    try:
        content = outside_file.read_json(path, LIMIT)
    except OSError as error:
        raise UnreadableLogError(f"{path}: {error.strerror or error}. {how}") from error
    except InputError as error:
        raise UnreadableLogError(f"{path} is no JSON of a result: {error}. {how}") from error
    found = content if isinstance(content, list) else [content]
    if not found:
        raise UnreadableLogError(f"{path} has no result in it. {how}")
    for document in found:
        if problem := _problem(document):
            raise UnreadableLogError(f"{path} is no result of a trace or a replay: {problem}. {_anew(document) or how}")
    return cast("list[Result]", found)


def completed(results: Sequence[Result]) -> tuple[list[Result], list[str]]:
    """Results with date and temperature from their logs, and with what was said of the logs later.

    A log is asked only if it is where the result says and has the SHA-256 that stands there; notes beside it that
    `imutui note` added are taken wherever the result says that it is.

    `results`: of `read`; they are replaced, not changed.
    Returns the same with what is known now.
    Returns a sentence for each log that could not be asked.
    """
    made: list[Result] = []
    notes: list[str] = []
    for result in results:
        if "findings" in result:
            runs = [_noted(run, Path(run["log"])) for run in result["runs"]]
            made.append(cast("TraceDocument", {**result, "runs": runs}))
            continue
        path = Path(result["log"])
        known: dict[str, Any] | None = {}
        if result["start_utc"] is None:
            known, why = of_log(path, result["log_sha256"], _start)
            lost = "when it was recorded and at which temperature is not stated in the page"
            notes += [f"{why}: {lost}"] if why else []
        made.append(cast("ResultDocument", _noted(result, path) | (known or {})))
    return made, notes


def _noted(of: Mapping[str, Any], log: Path) -> dict[str, Any]:
    """A run or a result whose identity has the note and the operator that were added to its log later."""
    note, operator = added_notes.latest(added_notes.read_or_none(log))
    if note is None and operator is None:
        return dict(of)
    said = {"note": note, "operator": operator}
    later = {key: f"{value or 'none'} (added later)" for key, value in said.items() if value is not None}
    return {**of, "identity": {**of["identity"], **later}}


def of_log(path: Path, sha256: str | None, read: Callable[[Path], T]) -> tuple[T | None, str]:
    """Return what is read from a log that is where a result says and unchanged, or why there is nothing."""
    try:
        if not path.is_file():
            return None, f"{path} is not there"
        if reader.sha256(path) != sha256:
            return None, f"{path} is not the file that the result is of (its SHA-256 differs)"
        return read(path), ""
    except (OSError, InputError) as error:
        return None, f"{path} cannot be read ({error})"


def _start(path: Path) -> dict[str, Any]:
    """Return when a log was recorded and at which temperature, as a result has it."""
    told = info.info(path)
    temperature = told["temperature_degc"]
    return {
        "start_utc": "" if told["sampling"] == "imported" else told["start_utc"] or "",
        "temperature_degc": None if temperature is None else [temperature["min"], temperature["max"]],
    }


def _problem(document: object) -> str:
    """What keeps a document from being a result; empty if it is one."""
    if not isinstance(document, dict):
        return "it is not an object"
    if "findings" in document:
        told = document_shape.fault(document, TraceDocument, "result")
        told = told or ("" if document["runs"] else "`result.runs` is empty") or _nameless(document["runs"])
        return told or _uneven(document) or _effects(document) or _diary(document)
    shape = ResultDocument if "final" in document else ReadingsDocument
    return document_shape.fault(document, shape, "result") or _nameless([document])


def _anew(document: Any) -> str:
    """The command that makes a result of another version anew; empty where it names no logs."""
    runs = document.get("runs", [document]) if isinstance(document, dict) else None
    named = [run.get("log") for run in runs if isinstance(run, dict)] if isinstance(runs, list) else []
    logs = [Path(log) for log in named if isinstance(log, str) and log]
    made = command("trace" if "runs" in document else "replay", *logs, "--json")
    return f"`{made}` makes it anew." if logs else ""


def _nameless(of_logs: list[dict[str, Any]]) -> str:
    return next((f"`log` is {of['log']!r}, the name of no file" for of in of_logs if not Path(of["log"]).name), "")


def _effects(document: dict[str, Any]) -> str:
    """What is wrong with its effects file."""
    try:
        effects_file.parse(document["effects_file"].encode("utf-8", "replace"))
    except InputError as error:
        return f"`result.effects_file`: {error}"
    return ""


def _diary(document: dict[str, Any]) -> str:
    """What is wrong with its diary, if it has one."""
    return "" if document["diary"] is None else document_shape.fault(document["diary"], DiaryDocument, "diary")


def _uneven(document: dict[str, Any]) -> str:
    """Which curve has not as many points along one axis as along the other."""
    curves = [("common", c["curve"]["t_s"], [c["curve"]["y"]]) for c in document["common"]]
    curves += [
        ("driver_curve", c["x"], [c["y"], *([c["sd"]] if c["sd"] else [])])
        for f in document["findings"]
        if (c := f["driver_curve"])
    ]
    curves += [
        (kind, channel[kind]["x"], [channel[kind]["before"], channel[kind]["after"]])
        for run in document["curves"]
        for channel in run["channels"].values()
        for kind in ("residual", "spectrum", "allan")
    ]
    return next((f"`{name}` has not as many points along one axis as along the other" for name, x, ys in curves
                 if any(len(y) != len(x) for y in ys)), "")  # fmt: skip

"""The row of one log: the one function that every way of running a campaign calls, here or on another machine.

A path goes in and a small record comes out; whatever is wrong with a log is said in its row.
"""

import gc
import json
import platform
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np

import imutui
from filters.errors import InputError
from imutui import defects
from imutui.document_shape import empty
from imutui.estimates import MeanNis, MeasuredNoise
from imutui.jobs import replay
from imutui.jobs.campaign.rows import (
    FindingField,
    Row,
    SettingsFields,
    VerdictField,
    VersionsField,
)
from imutui.jobs.quantities import utc_text
from imutui.jobs.replay import Replayed
from imutui.logbook import power_on, reader
from imutui.logbook.reading import AS_STATED, Reading
from imutui.verdict import sources

# ------------------------------------------------------------------------------------------------------------ one log


@dataclass(frozen=True, slots=True)
class Settings:
    """What a campaign is asked for, the same for all of its logs; they can be pickled, so that they reach workers."""

    reading: Reading = AS_STATED
    trace: bool = False  # whether each log is traced too, on its own

    def document(self) -> SettingsFields:
        """Return the settings as results have them."""
        return {"reading": self.reading.document(), "trace": self.trace}


@dataclass(frozen=True, slots=True)
class Task:
    """A log to compute."""

    log: str  # its name in the row
    path: str  # where it lies
    settings: Settings  # how to read it
    settings_sha256: str  # hash of these
    unless_sha256: str | None = None  # hash of the log that there is a row for: if it is still the same, none is made


Rows: TypeAlias = Iterator[tuple[Task, Row | None]]
"""Tasks with their rows, in any order; None for a log that is the one that there is a row for."""


@cache
def prepare() -> VersionsField:
    """Load what is compiled, once in a process; returns what rows will be computed with."""
    from filters.kalman import runner

    runner.warm_up()
    # what is loaded stays: looking through it again and again for garbage costs time in each log
    gc.collect()
    gc.freeze()
    return versions()


@cache
def versions() -> VersionsField:
    """Of what decides the numbers in a row; loads nothing."""
    return {
        "imutui": imutui.__version__,
        "numpy": np.__version__,
        "numba": metadata.version("numba"),
        "python": platform.python_version(),
    }


def row_of(task: Task) -> Row | None:
    """The row of a log; None if the log is the one that there is a row for.

    Nothing that is wrong with a log raises: it is the row's `error`.
    """
    prepare()
    started = time.perf_counter()
    try:
        row = _made(task)
    except InputError as error:
        row = error_row(task, str(error), retry=False)
    except MemoryError:
        row = error_row(task, f"memory ran out on {socket.gethostname()}", retry=True)
    except FileNotFoundError:
        row = error_row(task, f"{task.path} is not there on {socket.gethostname()}", retry=True)
    except OSError as error:
        words = f"{task.path}: {error.strerror or error} on {socket.gethostname()}"
        row = error_row(task, words, retry=True)
    except Exception as error:  # noqa: BLE001 - one log must never end a campaign of a million
        error.add_note(f"log: {task.path}")
        row = error_row(task, defects.told(error), retry=False)
    if row is not None:
        row["wall_s"] = time.perf_counter() - started
    return row


def _made(task: Task) -> Row | None:
    path = Path(task.path)
    # before it is read: what is written into it meanwhile shows as a change the next time
    known = path.stat()
    if task.unless_sha256 is not None and reader.sha256(path) == task.unless_sha256:
        return None
    try:
        found = replay.replayed(path, task.settings.reading)
        row = _row(task, found)
        if task.settings.trace:
            row["findings"], row["trace_error"] = _traced(path, task.settings)
        json.dumps(row, allow_nan=False)
    except InputError as error:
        row = error_row(task, str(error), retry=False)
        row["log_sha256"] = reader.sha256(path)
    row["log_bytes"], row["log_mtime_ns"] = known.st_size, known.st_mtime_ns
    return row


_OF_IDENTITY = ("instrument", "serial_number", "operator")


def error_row(task: Task, error: str, *, retry: bool) -> Row:
    """The row of a log without a result.

    `retry`: whether another try may do, though nothing about the log has changed.
    """
    known = {"log": task.log, "error": error, "retry": retry, "settings_sha256": task.settings_sha256}
    return cast("Row", empty(Row) | known | {"kind": "unknown", "versions": versions()})


def _row(task: Task, found: Replayed) -> Row:
    """What the result says under the names of a row, and what a row says in its own way."""
    row, d, info = error_row(task, "", retry=False), found.result, found.info
    verdict = sources.of_document(d)
    same: Any = {key: value for key, value in d.items() if key in row}
    told: dict[str, Any] = {
        "log": task.log,
        "error": None,
        **{key: value for key, value in d["identity"].items() if key in _OF_IDENTITY},
        # an import's stamps begin when its file was last changed
        "start_utc": None if info.sampling == "imported" else utc_text(found.first_ns),
        "batch": info.batch or None,
        "unit": (info.batch and info.acquisition.partition(":")[2]) or None,
        "power_on": power_on.power_on_id(info, d["log_sha256"] or ""),
        "temperature_degc": found.temperature and dict(zip(("mean", "min", "max"), found.temperature, strict=True)),
        "nis": {key: same["nis"][key] for key in MeanNis.__annotations__},
        "noise": {key: same["noise"][key] for key in MeasuredNoise.__annotations__},
        "gaps": {"count": len(d["gaps"]), "seconds": sum(gap["seconds"] for gap in d["gaps"])},
        "verdict": {name: getattr(verdict, name) for name in VerdictField.__annotations__},
    }
    return cast("Row", row | same | told)


def _traced(path: Path, settings: Settings) -> tuple[list[FindingField] | None, str | None]:
    """Findings of a trace of this log alone, or why it has none."""
    from imutui.jobs.trace import trace

    try:
        found = trace([path], replace(settings.reading, effects=None))
    except InputError as error:
        return None, str(error)
    return [
        {
            "effect": finding["effect"],
            "label": finding["label"],
            "channels": finding["channels"],
            "params": [
                {"name": p["name"], "value": p["value"], "sd": p["sd"], "unit": p["unit"]} for p in finding["params"]
            ],
            "confirmed": finding["confirmed"],
        }
        for finding in found["findings"]
    ], None

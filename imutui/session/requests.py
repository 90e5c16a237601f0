"""What viewers ask of an acquisition over its socket, and what it replies: the shapes of both, as JSON objects.

`python -m imutui.session` answers, `client` asks, `ipc` carries. Of a request that may be anything the fields are read
one by one: nothing in it is taken for granted, and what is wrong has a name. A request that could not be
carried out gets a `Refusal`.
"""

import dataclasses
import math
import pwd
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, NotRequired, TypedDict, cast

from filters.errors import InputError
from imutui.estimate_history import HistorySnapshot
from imutui.plain_text import NAME_LIMIT, one_line
from imutui.session.plan import RecordingWish
from imutui.session.snapshot import ProfileDescription, Snapshot, StatisticsSnapshot

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument

LONGEST_WAIT_S = 86400.0
CHANGES = ("begin_statistics", "mark", "record", "describe", "configure", "zero", "guide", "stop_recording")
"""Requests that change something: one whose viewer has ceased to wait is not carried out later."""


class FilterChanges(TypedDict, total=False):
    """What the filter takes from now on; what lacks stays as it is.

    `reference` is a name, `reference_file` name and text of a profile or trajectory, `effects` the text of an effects
    file, empty for none.
    """

    reference: str
    reference_file: tuple[str, str]
    effects: str


class Request(TypedDict):
    """Any request; the fields beyond `ask` belong to the kinds that say so."""

    ask: str  # what; `imutui.session.__main__.carry_out` has which there are
    patience_s: NotRequired[float]  # any of `CHANGES`: how long the viewer waits until it is begun
    since: NotRequired[int]  # snapshot: number of the first packet wanted in the series
    run: NotRequired[int]  # history: the run that the viewer has rows of
    estimates_s: NotRequired[float | None]  # history: instant of the last row of estimates that the viewer has
    temperature_s: NotRequired[float | None]  # history: instant of the last row of temperature that the viewer has
    channel: NotRequired[int]  # statistics: number of the channel, 0 to 6
    text: NotRequired[str]  # mark: what the operator says
    wish: NotRequired[Mapping[str, object]]  # record, guide: of the recording that begins, fields of `RecordingWish`
    # describe: of the file that is being written; None leaves it as it is
    note: NotRequired[str | None]
    operator: NotRequired[str | None]
    changes: NotRequired[FilterChanges]  # configure: what the filter takes from now on
    argument: NotRequired[int]  # zero: length of the average
    do: NotRequired[str]  # guide: begin, next, cancel, resume
    yes_move: NotRequired[bool]  # guide: somebody has said that a table under command may move
    timeout_s: NotRequired[float | None]  # wait: how long at most; None for ever
    # stop, and any of `CHANGES`: the program that asks, in words, and its terminal, as the viewer states them
    by: NotRequired[str]
    terminal: NotRequired[str]
    peer: NotRequired[
        tuple[int, int]
    ]  # user id and process id at the other end, as the kernel knows them; `ipc` adds it


class EndFinding(TypedDict):
    """What must be said of an acquisition that has ended without failing; `exit_code` is of a `record` that saw it."""

    exit_code: int
    text: str


class Reply(TypedDict, total=False):
    """What is replied; which fields there are besides `ok` depends on the request."""

    ok: Literal[True]
    snapshot: Snapshot  # snapshot: state for a screen
    history: HistorySnapshot  # history: biases and temperature of the run, what the viewer lacks of them
    statistics: StatisticsSnapshot  # statistics: Allan deviation, spectrum and histogram of the channel
    path: str  # record: of the file that has begun
    said: str  # zero: what came of it
    profile: ProfileDescription | None  # profile: what the reference comes from; None if from no table profile
    result: "RunDocument | None"  # stop_recording, stop, wait: of the last recording
    error: str | None  # stop, wait: why the acquisition failed, if it did
    exit_code: int  # stop, wait: of the acquisition's process
    findings: list[EndFinding]  # stop, wait: what must be said of one that did not fail
    by_itself: bool  # stop, wait: whether nobody asked for the end
    ended_by: str  # stop, wait: who or what asked for the end, in words
    runs: bool  # wait: true if it runs still; the other fields of an end are not there then


class Refusal(TypedDict):
    """What could not be carried out, and why, for the user."""

    ok: Literal[False]
    error: str


class StartReport(TypedDict):
    """First line of the acquisition process on stdout: whether it runs; `error` and `exit_code` if it does not."""

    ok: bool
    pid: NotRequired[int]
    error: NotRequired[str]
    exit_code: NotRequired[int]


def who(request: Request) -> str:
    """Return who asks, in words: program, user, terminal and process, such as `imutui stop, ana on pts/3, pid 42`.

    User and process are those that the kernel knows; program and terminal are what the viewer states.
    """
    program = one_line(text(request, "by"), NAME_LIMIT) if "by" in request else "a viewer that did not say who it is"
    terminal = one_line(text(request, "terminal"), NAME_LIMIT) if "terminal" in request else ""
    if "peer" not in request:
        return program
    uid, pid = request["peer"]
    return f"{program}, {user_name(uid)}{f' on {terminal}' if terminal else ''}, pid {pid}"


def user_name(uid: int) -> str:
    """Return the name of a user, or the id of one without a name."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


# -- fields of a request that may be anything -------------------------------------------------------------------------


def _field(request: Request, name: str) -> object:
    return cast("Mapping[str, object]", request).get(name)


def text(request: Request, name: str) -> str:
    """A text that the request must have; raises InputError if it has none."""
    value = _field(request, name)
    if not isinstance(value, str):
        raise InputError(f"the request's `{name}` is no text")
    return value


def text_or_none(request: Request, name: str, limit: int) -> str | None:
    """A text on one line, cut to a length; None if it lacks. Raises InputError if it is something else."""
    return None if _field(request, name) is None else one_line(text(request, name), limit)


def whole(request: Request, name: str, default: int | None = None) -> int:
    """A whole number; raises InputError if it is none, or lacks and there is no default."""
    value = _field(request, name) if name in request else default
    if isinstance(value, bool) or not isinstance(value, int) or not -(2**63) <= value < 2**63:
        raise InputError(f"the request's `{name}` is no whole number")
    return value


def seconds(request: Request, name: str, least: float = -math.inf, most: float = math.inf) -> float | None:
    """A finite time within bounds, s; None if it lacks. Raises InputError if it is something else."""
    value: Any = _field(request, name)
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or not least <= value <= most:
        bounds = f" from {least:g} to {most:g} s" if math.isfinite(most) else " in seconds"
        raise InputError(f"the request's `{name}` is no time{bounds}")
    return float(value)


def wish(request: Request) -> RecordingWish:
    """What is wished of a recording; raises InputError with the field that is unknown or does not fit."""
    fields, known = _table(request, "wish"), [field.name for field in dataclasses.fields(RecordingWish)]
    unknown = sorted(set(fields) - set(known))
    if unknown:
        raise InputError(f"`{unknown[0][:NAME_LIMIT]}` is unknown in `wish`; known: {', '.join(known)}")
    return RecordingWish(**fields)


def changes(request: Request) -> FilterChanges:
    """What the filter is to take; raises InputError with the field that does not fit."""
    # which of them there are is said by whoever takes them
    fields = _table(request, "changes")
    for name in ("reference", "effects"):
        if not isinstance(fields.get(name, ""), str):
            raise InputError(f"the request's `{name}` is no text")
    file = fields.get("reference_file", ("", ""))
    if not isinstance(file, list | tuple) or len(file) != 2 or not all(isinstance(part, str) for part in file):
        raise InputError("the request's `reference_file` is not a name and a text")
    if len(file[0]) > NAME_LIMIT:
        raise InputError(f"the reference's name is longer than {NAME_LIMIT} characters")
    return cast("FilterChanges", fields)


def _table(request: Request, name: str) -> dict[str, Any]:
    fields = _field(request, name) if name in request else {}
    if not isinstance(fields, dict):
        raise InputError(f"the request's `{name}` is no JSON object")
    return fields

"""The requests of viewers to an acquisition over its socket, and the replies, as JSON objects.

`python -m imutui.session` answers, `client` asks, `ipc` carries. Each request has a type; what arrives is not trusted,
and is read as the type that its `ask` names. A request that cannot be carried out gets a `Refusal`.
"""

import pwd
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, NotRequired, TypeAlias, TypedDict

from filters.errors import InputError
from imutui.declared import Meta, read
from imutui.estimate_history import HistorySnapshot
from imutui.plain_text import NAME_LIMIT
from imutui.session.plan import HistoryWish, RecordingWish
from imutui.session.snapshot import ProfileDescription, Snapshot, StatisticsSnapshot
from imutui.settings import Name, Note

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument

LONGEST_WAIT_S = 86400.0
CHANGES = ("begin_statistics", "mark", "record", "describe", "configure", "zero", "guide", "stop_recording")
"""Requests that change something: one whose viewer has ceased to wait is not carried out later."""
Seconds = Annotated[float, Meta(least=0.0, most=LONGEST_WAIT_S)]
Request: TypeAlias = Mapping[str, object]
"""A request as it travels: a JSON object that `parse` has not read yet."""


def _short(name: str) -> str:
    if len(name) > NAME_LIMIT:
        raise InputError(f"the reference's name is longer than {NAME_LIMIT} characters")
    return name


class FilterChanges(TypedDict, total=False):
    """What the filter takes from now on; a field that is absent stays as it is.

    `reference` is a name, `reference_file` name and text of a profile or trajectory, `effects` the text of an effects
    file, empty for none.
    """

    reference: str
    reference_file: Annotated[tuple[Annotated[str, Meta(make=_short)], str], Meta(words="a name and a text")]
    effects: str


class SnapshotRequest(NamedTuple):
    """State for a screen."""

    since: int = 0  # number of the first packet wanted in the series
    ask: Literal["snapshot"] = "snapshot"


class StatisticsRequest(NamedTuple):
    """Allan deviation, spectrum and histogram of a channel, 0 to 6."""

    channel: int
    ask: Literal["statistics"] = "statistics"


class BeginStatisticsRequest(NamedTuple):
    """Begin the statistics of all channels anew."""

    ask: Literal["begin_statistics"] = "begin_statistics"


class MarkRequest(NamedTuple):
    """Put a mark of the operator into the recording."""

    text: str
    ask: Literal["mark"] = "mark"


class RecordRequest(NamedTuple):
    """Begin a recording."""

    wish: RecordingWish = RecordingWish()
    ask: Literal["record"] = "record"


class DescribeRequest(NamedTuple):
    """Change note and operator of the file that is being written; None leaves one as it is."""

    note: Note | None = None
    operator: Name | None = None
    ask: Literal["describe"] = "describe"


class ConfigureRequest(NamedTuple):
    """Change what the filter takes."""

    changes: FilterChanges
    ask: Literal["configure"] = "configure"


class ZeroRequest(NamedTuple):
    """Have the unit zero its rate sensors."""

    argument: int  # length of the average
    ask: Literal["zero"] = "zero"


class ProfileRequest(NamedTuple):
    """The table profile that the reference comes from."""

    ask: Literal["profile"] = "profile"


class GuideRequest(NamedTuple):
    """Guide the operator through the profile: begin, next, cancel or resume."""

    do: str
    wish: RecordingWish = RecordingWish()
    yes_move: bool = False  # the user has allowed a table under command to move
    ask: Literal["guide"] = "guide"


class StopRecordingRequest(NamedTuple):
    """Finish the file."""

    ask: Literal["stop_recording"] = "stop_recording"


class StopRequest(NamedTuple):
    """End the acquisition."""

    ask: Literal["stop"] = "stop"


class WaitRequest(NamedTuple):
    """Wait for the end."""

    timeout_s: Seconds | None = None  # None: for ever
    ask: Literal["wait"] = "wait"


Asked: TypeAlias = (
    SnapshotRequest | HistoryWish | StatisticsRequest | BeginStatisticsRequest | MarkRequest | RecordRequest
    | DescribeRequest | ConfigureRequest | ZeroRequest | ProfileRequest | GuideRequest | StopRecordingRequest
    | StopRequest | WaitRequest
)  # fmt: skip


class Sender(NamedTuple):
    """Fields that any request may have beside its own: who asks, and for how long it waits."""

    by: Name = "a viewer that did not say who it is"  # the program, as the viewer states it
    terminal: Name = ""  # as the viewer states it
    peer: tuple[int, int] | None = None  # user id and process id as the kernel knows them; `ipc` adds it
    patience_s: Seconds | None = None  # how long the viewer waits until the request is begun; None: as is usual

    @property
    def who(self) -> str:
        """Program, user, terminal and process, such as `imutui stop, ana on pts/3, pid 42`."""
        if self.peer is None:
            return self.by
        uid, pid = self.peer
        return f"{self.by}, {user_name(uid)}{f' on {self.terminal}' if self.terminal else ''}, pid {pid}"


def parse(request: Request) -> tuple[Asked, Sender]:
    """Return a request as its type, and its sender; raises InputError with the field that does not fit."""
    any_of: Any = Asked
    own = {key: value for key, value in request.items() if key not in Sender._fields}
    asked: Asked = read(own, any_of)
    return asked, read({key: value for key, value in request.items() if key in Sender._fields}, Sender)


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


def user_name(uid: int) -> str:
    """Return the name of a user, or the id of one without a name."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)

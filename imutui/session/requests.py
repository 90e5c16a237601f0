"""The requests of viewers to an acquisition over its socket.

Each request is a method of `Requests`. Its parameters are the fields of the JSON object that a viewer sends beside
`ask`, the method's name, and those of `Sender`; its result is the field `reply` of what the viewer gets. What arrives
is not trusted: it is read by the types of the parameters.
"""

from collections.abc import Callable, Mapping
from dataclasses import field, make_dataclass
from functools import cache
from inspect import signature
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, TypeVar, get_type_hints

from imutui.declared import Meta, read
from imutui.estimate_history import HistorySnapshot
from imutui.session import observe
from imutui.session.acquisition import Acquisition
from imutui.session.engine import PATIENCE_S, Engine
from imutui.session.lifecycle import EndReport
from imutui.session.metadata import user_name
from imutui.session.plan import FilterChanges, HistoryWish, RecordingWish
from imutui.session.snapshot import ProfileDescription, Snapshot, StatisticsSnapshot
from imutui.settings import Name, Note

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument

LONGEST_WAIT_S = 86400.0
Seconds = Annotated[float, Meta(least=0.0, most=LONGEST_WAIT_S)]
_AS_PLANNED = RecordingWish()
T = TypeVar("T")


class Sender(NamedTuple):
    """Fields of every request: the viewer that asks, and how long it waits."""

    by: Name = "a viewer that did not say who it is"  # the program, as the viewer states it
    terminal: Name = ""  # as the viewer states it
    peer: tuple[int, int] | None = None  # user id and process id as the kernel knows them; `ipc` adds it
    # how long the viewer waits until the request is begun; one that it has given up is not carried out later
    patience_s: Seconds = PATIENCE_S

    @property
    def who(self) -> str:
        """Program, user, terminal and process, such as `imutui stop, ana on pts/3, pid 42`."""
        if self.peer is None:
            return self.by
        uid, pid = self.peer
        return f"{self.by}, {user_name(uid)}{f' on {self.terminal}' if self.terminal else ''}, pid {pid}"


class Requests:
    """What viewers may ask of an acquisition; `client.Client` has the same methods, and documents them.

    Each raises InputError with what is wrong with the request, or why it cannot be carried out now.
    """

    def __init__(self, engine: Engine, sender: Sender) -> None:
        self._engine, self._sender = engine, sender

    def _call(self, function: Callable[[Acquisition], T], *, late: bool = False) -> T:
        return self._engine.call(function, self._sender.patience_s, late=late)

    def snapshot(self, since: int = 0) -> Snapshot:
        return self._call(lambda acquisition: observe.snapshot(acquisition, since), late=True)

    def history(self, wish: HistoryWish) -> HistorySnapshot:
        return self._call(lambda acquisition: acquisition.history(wish), late=True)

    def statistics(self, channel: int) -> StatisticsSnapshot:
        return self._call(lambda acquisition: acquisition.channel_statistics(channel), late=True)

    def begin_statistics(self) -> None:
        self._call(lambda acquisition: acquisition.begin_statistics())

    def mark(self, text: str) -> None:
        self._call(lambda acquisition: acquisition.mark(text, self._sender.who))

    def record(self, wish: RecordingWish = _AS_PLANNED) -> str:
        return self._call(lambda acquisition: acquisition.record(wish))

    def describe(self, note: Note | None = None, operator: Name | None = None) -> None:
        self._call(lambda acquisition: acquisition.recording.describe(note, operator))

    def configure(self, changes: FilterChanges) -> None:
        self._call(lambda acquisition: acquisition.configure(changes))

    def zero(self, argument: int) -> str:
        return self._engine.zero(argument, self._sender.patience_s)

    def profile(self) -> ProfileDescription | None:
        return self._call(lambda acquisition: acquisition.profile(), late=True)

    def guide(self, do: str, wish: RecordingWish = _AS_PLANNED, yes_move: bool = False) -> None:
        if do == "cancel":
            self._engine.stop_table()  # before the worker comes to it, which may be busy with the recording
        self._call(lambda acquisition: acquisition.guide(do, wish, self._sender.who, may_move=yes_move))

    def stop_recording(self) -> "RunDocument":
        return self._call(lambda acquisition: acquisition.stop_recording(self._sender.who))

    def stop(self) -> EndReport:
        self._engine.request_stop(self._sender.who)
        self._engine.lifecycle.ended.wait()
        return end_of(self._engine)

    def wait(self, timeout_s: Seconds | None = None) -> EndReport | None:
        """Return the end; None if the acquisition still runs after the timeout."""
        return end_of(self._engine) if self._engine.lifecycle.ended.wait(timeout_s) else None


def end_of(engine: Engine) -> EndReport:
    """Return the record of the end of an acquisition that has ended."""
    return engine.lifecycle.report(by_itself=engine.ended_by_itself, result=engine.result)


_METHODS = {name: method for name, method in vars(Requests).items() if not name.startswith("_")}
_Asked: Any = Literal[tuple(_METHODS)]


def carry_out(engine: Engine, request: Mapping[str, object]) -> object:
    """Carry out the request of a viewer, and return what the viewer gets; raises InputError as `Requests` does."""
    ask: str = read(request.get("ask"), _Asked, "ask")
    sender = read({key: value for key, value in request.items() if key in Sender._fields}, Sender)
    own = {key: value for key, value in request.items() if key != "ask" and key not in Sender._fields}
    return _METHODS[ask](Requests(engine, sender), **vars(read(own, _fields(ask))))


@cache
def _fields(ask: str) -> type:
    """Return a record whose fields are the parameters of a request's method."""
    hints = get_type_hints(_METHODS[ask], {**globals(), "RunDocument": object}, include_extras=True)
    fields = list[Any]()
    for name, each in signature(_METHODS[ask]).parameters.items():
        if name != "self":
            fields.append((name, hints[name], *([] if each.default is each.empty else [field(default=each.default)])))
    return make_dataclass(ask, fields)

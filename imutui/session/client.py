"""Start an acquisition, find one that runs, and talk to it."""

import contextlib
import json
import os
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Unpack, cast

from imutui import document_shape
from imutui.command_line import command, joined
from imutui.estimate_history import HistorySnapshot
from imutui.instrument.names import DEFAULT
from imutui.session import ipc, lifecycle, processes
from imutui.session.lifecycle import EndReport as EndReport
from imutui.session.plan import FilterChanges, HistoryWish, Plan, RecordingWish, batch_of
from imutui.session.processes import Parent
from imutui.session.snapshot import NO_SERIES, ProbeAnswer, ProfileDescription, Snapshot, StatisticsSnapshot

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument

_REPLY_S = 5.0
_STOP_S = 60.0
_EXIT_S = 5.0
_LEEWAY_S = 15.0
_PATIENCE_S, _PATIENCE_SHARE = 30.0, 0.9


class SessionError(Exception):
    """A request to an acquisition failed; the message is for the user, the code is the command's exit code."""

    def __init__(self, message: str, exit_code: int = lifecycle.INSTRUMENT) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class SessionGoneError(SessionError):
    """The acquisition process has ended."""


class SessionConnectingError(SessionError):
    """The acquisition process lives, but does not answer viewers yet or any more."""


class Client:
    """A connection to a running acquisition. Calls may come from any thread; each blocks until its reply."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self.pid = int(self.snapshot(since=NO_SERIES)["pid"])

    def snapshot(self, since: int = 0) -> Snapshot:
        """Return the state for a screen; `series` holds the packets from number `since` on."""
        return cast("Snapshot", self._ask("snapshot", since=since))

    def history(self, wish: HistoryWish) -> HistorySnapshot:
        """Return a piece of the run's past that a viewer with `wish` lacks."""
        return cast("HistorySnapshot", self._ask("history", wish=wish))

    def statistics(self, channel: int) -> StatisticsSnapshot:
        """Return Allan deviation, spectrum and histogram of a channel, 0 to 6, over all packets since they began."""
        return cast("StatisticsSnapshot", self._ask("statistics", channel=channel))

    def begin_statistics(self) -> None:
        """Begin the statistics of all channels anew, for every viewer; earlier packets count no more."""
        self._ask("begin_statistics")

    def mark(self, text: str) -> None:
        """Put a mark of the operator into the recording."""
        self._ask("mark", text=text)

    def record(self, wish: RecordingWish | None = None) -> str:
        """Start recording; returns the file's path. The filter starts anew with the file."""
        return cast("str", self._ask("record", wish=wish or RecordingWish()))

    def describe(self, note: str | None = None, operator: str | None = None) -> None:
        """Change note and operator of the file that is being written; None leaves one as it is."""
        self._ask("describe", note=note, operator=operator)

    def configure(self, **changes: Unpack[FilterChanges]) -> None:
        """Change the filter's input; the filter starts anew. Refused while recording."""
        self._ask("configure", changes=changes)

    def zero(self, argument: int) -> str:
        """Have the unit, held still, zero its rate sensors; returns its result in words. Snapshots go on meanwhile.

        The argument is the average's length, 0 to 255; whether in tens or in hundreds of samples, documents dispute. 0
        erases the stored zero. Refused while recording.
        Raises SessionError if it cannot be done now, or the unit did not answer in time; the message says what next.
        """
        from imutui.instrument.registry import INSTRUMENTS

        limit = max(each.zeroing_patience_s(max(0, argument)) for each in INSTRUMENTS.values()) + _LEEWAY_S
        return cast("str", self._ask_separately("zero", limit, argument=argument))

    def profile(self) -> ProfileDescription | None:
        """Return the table profile that the reference comes from; None if there is none."""
        return cast("ProfileDescription | None", self._ask("profile"))

    def guide(self, do: str, wish: RecordingWish | None = None, *, yes_move: bool = False) -> None:
        """Guide the operator: "begin" (records as wished if nothing does), "next", "cancel" or "resume".

        `yes_move`: the user has allowed a table under command to move, as "begin" and "resume" make it do.
        """
        self._ask("guide", do=do, wish=wish or RecordingWish(), yes_move=yes_move)

    def stop_recording(self) -> "RunDocument":
        """Finish the file; returns the result document. Snapshots go on meanwhile."""
        return cast("RunDocument", self._ask_separately("stop_recording", _STOP_S))

    def stop(self, by: str | None = None) -> EndReport:
        """End the acquisition; returns the record of its end.

        `by`: what asks for it, such as "Ctrl+C in imutui record"; None for this program. The user is added.
        Raises SessionError if the acquisition failed.
        """
        return self._ended(self._ask_separately("stop", _STOP_S, **({} if by is None else {"by": by})))

    def wait(self, timeout: float | None = None) -> EndReport:
        """Wait for the end; returns and raises as `stop` does, and TimeoutError if it takes longer."""
        limit = timeout and timeout + _REPLY_S
        return self._ended(self._ask_separately("wait", limit, timeout_s=timeout))

    def end(self) -> EndReport | None:
        """Return the record of the end that the process left; None if there is none, as of one that was killed."""
        return lifecycle.read_end(self.name, self.pid)

    def close(self) -> None:
        """Leave; the acquisition goes on."""
        with self._lock:
            self._drop()

    def _ended(self, reply: object) -> EndReport:
        if reply is None:
            raise TimeoutError
        # the name must be free again before the caller starts another acquisition
        deadline = time.monotonic() + _EXIT_S
        while self.name in ipc.names() and time.monotonic() < deadline:
            time.sleep(0.01)
        end = cast("EndReport", reply)
        if end["error"] is not None:
            raise SessionError(end["error"], end["exit_code"])
        return end

    def _ask_separately(self, ask: str, timeout: float | None, **fields: object) -> object:
        """Send a request that takes long over a connection of its own."""
        with contextlib.closing(_connect(self.name)) as connection:
            try:
                return _exchange(connection, self.name, timeout, ask, fields)
            except TimeoutError as error:
                said = f'the acquisition "{self.name}" has not answered for {timeout:.0f} s; it may still do what was'
                raise SessionError(f"{said} asked. `imutui status` shows how it is.") from error

    def _ask(self, ask: str, **fields: object) -> object:
        with self._lock:
            if self._socket is None:
                self._socket = _connect(self.name)
            try:
                return _exchange(self._socket, self.name, _REPLY_S, ask, fields)
            except (TimeoutError, SessionGoneError) as error:
                self._drop()
                if isinstance(error, SessionGoneError):
                    raise
                said = f'the acquisition "{self.name}" does not answer; it may be busy. Try again.'
                raise SessionError(said) from error

    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def running() -> list[str]:
    """Return the names of this user's running acquisitions."""
    return ipc.names()


def attach(name: str | None = None) -> Client:
    """Return a client of the running acquisition of that name, or of the only one.

    Raises SessionError if there is none, or several and no name, or no place for another viewer.
    """
    names = running()
    if name is None and len(names) > 1:
        batches = sorted({*map(batch_of, names)} - {""})
        one = f" {joined('--batch', batches[0])} takes all of one batch." if batches else ""
        said = f"several acquisitions are running: {', '.join(names)}. Say which with --name.{one}"
        raise SessionError(said, lifecycle.USAGE)
    if not names or (name is not None and name not in names):
        which = "no acquisition is running" if name is None else f'no acquisition named "{name}" is running'
        others = f" Running: {', '.join(names)}." if names else ""
        raise SessionError(
            f"{which}.{others} `imutui record` or `imutui` starts one; `imutui demo` needs no instrument."
        )
    return Client(name or names[0])


class Starting:
    """An acquisition on its way up, in a process and session of its own.

    `select` finds it ready when the process has reported its start; that has `timeout` seconds, and the first packet's
    period. `parent`: see `start`.
    """

    def __init__(self, plan: Plan, timeout: float = 30.0, parent: Parent | None = None) -> None:
        self.plan, self._timeout = plan, timeout
        self._missing = processes.missing_folders(plan)
        self._process, self._output = processes.begin(plan, ipc.log_path(plan.name), parent)
        self.deadline = time.monotonic() + timeout + plan.period_s

    def fileno(self) -> int:
        """Return the descriptor of the process's stdout."""
        return self._output.fileno()

    def client(self) -> Client:
        """Wait for the first packet; raises SessionError as `start` does."""
        plan = self.plan
        try:
            with self._output:
                end = self._reported()
            if end is None:
                return Client(plan.name)
        except BaseException:
            self.give_up()
            raise
        name = _holder(plan.port) if end["exit_code"] == lifecycle.INSTRUMENT else None
        held = name is not None and name != plan.name
        raise SessionError(_in_use(plan.port, name) if held else str(end["error"]), end["exit_code"])

    def _reported(self) -> EndReport | None:
        """Return None once the acquisition runs; the record of its end if it did not begin."""
        name, text = self.plan.name, b""
        while not text.endswith(b"\n"):
            if not select.select([self._output], [], [], max(0.0, self.deadline - time.monotonic()))[0]:
                self.give_up()
                error = f"the acquisition process did not begin within {self._timeout:.0f} s; see {ipc.folder()}."
                end = lifecycle.read_end(name, self._process.pid)
                if end is not None and end["result"] is not None:
                    error += f" What had come by then is in {end['result']['log']}."
                return lifecycle.failed(name, lifecycle.INSTRUMENT, error)
            part = os.read(self._output.fileno(), 65536)
            if not part:
                self._process.send(signal.SIGKILL)
                error = f"the acquisition process ended before it began; see {ipc.folder()}."
                return lifecycle.failed(name, lifecycle.INSTRUMENT, error)
            text += part
        return cast("EndReport | None", json.loads(text))

    def give_up(self) -> None:
        """End the process, as after Ctrl+C: a command that has not seen it begin must not leave it behind."""
        processes.end_unbegun(self._process, self._missing)


def start(plan: Plan, timeout: float = 30.0, parent: Parent | None = None) -> Client:
    """Start an acquisition in a process and session of its own; returns when its first packet has come.

    `parent`: a process that it is forked from, so that several share what they have loaded; None to load it anew.
    Raises SessionError if it could not start; the message says why and what to do next.
    """
    return Starting(plan, timeout, parent).client()


def ports() -> list[tuple[str, str]]:
    """Return the serial ports of this machine: name to connect with, description."""
    from imutui.instrument.port import available

    return [(p.stable_id, f"{p.device} {p.description}".strip()) for p in available()]


def probe(port: str) -> ProbeAnswer:
    """Return which unit answers at a port: what streams is stopped, then version and serial number are asked.

    A port that an acquisition of this user has is not opened. It takes up to some seconds where nothing answers.
    """
    from imutui.instrument.driver import InstrumentError
    from imutui.instrument.port import Port, PortError
    from imutui.instrument.registry import INSTRUMENTS, nor_the_others, which_answers

    if (name := _holder(port)) is not None:
        return not_answered(port, _in_use(port, name))
    found = not_answered(port)
    try:
        with Port(port, INSTRUMENTS[DEFAULT].power_up_bauds[0]) as line:
            instrument = which_answers(line)
            host = instrument(line)
            try:
                identity = host.find()
            except InstrumentError as error:
                raise InstrumentError(f"{error} {nor_the_others()}") from error
            found["answers"], found["baud"] = True, line.baud
            found["instrument"] = identity.model or instrument.model
            found["serial_number"], found["firmware"] = identity.serial_number, identity.version
            host.check_model(identity)
    except (PortError, InstrumentError) as error:
        found["error"] = str(error)
    return found


def not_answered(port: str, error: str | None = None) -> ProbeAnswer:
    """Return the record of a port where no unit answers, and why."""
    found: ProbeAnswer = document_shape.empty(ProbeAnswer)
    found["port"], found["error"] = port, error
    return found


def _is_same(one: str, other: str) -> bool:
    """Return True if two names mean the same port."""
    from imutui.instrument.port import resolve

    if "://" in one or "://" in other:
        return one == other
    return os.path.realpath(resolve(one)) == os.path.realpath(resolve(other))


def _holder(port: str) -> str | None:
    """Return the name of this user's acquisition that has a port."""
    for name in running():
        with contextlib.suppress(SessionError):
            if _is_same(str(Client(name).snapshot(since=NO_SERIES)["port"]), port):
                return name
    return None


def _in_use(port: str, name: str | None) -> str:
    attach, stop = (command(word, "--name", name or "") for word in ("attach", "stop"))
    return (
        f'{port} is in use by the acquisition "{name}". `{attach}` shows it, `{stop}` ends it; another unit is on'
        " another port."
    )


def _connect(name: str) -> socket.socket:
    try:
        return ipc.connect(name, _REPLY_S)
    except OSError as error:
        if name in ipc.names():
            raise SessionConnectingError(
                f'the acquisition "{name}" is connecting to its instrument, or just ending. Try again in a few seconds.'
            ) from error
        raise SessionGoneError(_ended_message(name)) from error


def _exchange(
    connection: socket.socket, name: str, timeout: float | None, ask: str, fields: Mapping[str, object]
) -> object:
    request = {"ask": ask, "by": _this_program(), "terminal": _terminal(), **fields}
    if timeout is not None:
        # the acquisition gives up before the viewer does, and says whether the request is still carried out
        request["patience_s"] = min(_PATIENCE_S, _PATIENCE_SHARE * timeout)
    try:
        pid = ipc.peer_of(connection)[1]
        connection.settimeout(timeout)
        with contextlib.suppress(BrokenPipeError):  # a viewer that is refused has its reply already
            connection.sendall(json.dumps(request, default=asdict).encode() + b"\n")
        data = bytearray()
        while not data.endswith(b"\n"):
            part = connection.recv(1 << 16)
            if not part:
                raise SessionGoneError(_ended_message(name))
            data += part
    except TimeoutError:
        raise
    except OSError as error:
        raise SessionGoneError(_ended_message(name)) from error
    reply = json.loads(data)
    if wrong := document_shape.wrong_version(reply):
        raise SessionError(
            f'another version of imutui runs the acquisition "{name}": of its reply, {wrong}. `kill {pid}` ends it and'
            " finishes its file; `imutui record` or `imutui` then starts it anew."
        )
    if not reply["ok"]:
        raise SessionError(reply["error"])
    return reply["reply"]


def _this_program() -> str:
    """Return the name of this program, with the command of imutui that it carries out."""
    path = Path(sys.argv[0])
    name = path.parent.name if path.name == "__main__.py" else path.name
    return " ".join([name, *(word for word in sys.argv[1:2] if word.isalpha())])


def _terminal() -> str:
    """Return the terminal of this program, such as pts/3; empty if it has none."""
    for stream in (0, 2, 1):
        with contextlib.suppress(OSError):
            return os.ttyname(stream).removeprefix("/dev/")
    return ""


def _ended_message(name: str) -> str:
    return (
        f'the acquisition "{name}" has ended. What it recorded is on the disk up to the last second;'
        " `imutui replay FILE` reads it, finished or not."
    )

"""How viewers start an acquisition, find it again, and talk to it."""

import contextlib
import json
import os
import select
import socket
import subprocess
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Unpack, cast

from imutui import document_shape
from imutui.command_line import command, joined
from imutui.estimate_history import HistorySnapshot
from imutui.session import end_report, ipc, lifecycle, preloaded, requests
from imutui.session.end_report import EndReport as EndReport
from imutui.session.plan import HistoryWish, Plan, RecordingWish, batch_of
from imutui.session.preloaded import Forked, Parent
from imutui.session.requests import CHANGES, Asked, EndFinding, FilterChanges, Reply, StartReport
from imutui.session.snapshot import NO_SERIES, ProbeAnswer, ProfileDescription, Snapshot, StatisticsSnapshot

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument

_REPLY_S = 5.0
_STOP_S = 60.0
_EXIT_S = 5.0
_LEEWAY_S = 15.0
_PATIENCE_S, _PATIENCE_SHARE = 30.0, 0.9


class SessionError(Exception):
    """What was asked of an acquisition did not work; the message is for the user, the code for its command's end."""

    def __init__(self, message: str, exit_code: int = lifecycle.INSTRUMENT) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class SessionGoneError(SessionError):
    """The acquisition process has ended."""


class SessionConnectingError(SessionError):
    """The acquisition process lives but does not talk to viewers yet, or no more."""


class Client:
    """A connection to a running acquisition. Calls may come from any thread; each blocks until its reply."""

    def __init__(self, name: str) -> None:
        self.name = name
        # once `stop` or `wait` has returned its result: what must be said of the acquisition, whether nobody had asked
        # for its end, and who or what had, in words
        self.findings: list[EndFinding] = []
        self.ended_by_itself = False
        self.ended_by = ""
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self.pid = int(self.snapshot(since=NO_SERIES)["pid"])

    def snapshot(self, since: int = 0) -> Snapshot:
        """State for a screen; `series` holds the packets from number `since` on."""
        return self._ask(requests.SnapshotRequest(since))["snapshot"]

    def history(self, wish: HistoryWish) -> HistorySnapshot:
        """What a viewer that has `wish` lacks of the run's past, a piece of it."""
        return self._ask(wish)["history"]

    def statistics(self, channel: int) -> StatisticsSnapshot:
        """Allan deviation, spectrum and histogram of a channel, 0 to 6, over all packets since they were begun."""
        return self._ask(requests.StatisticsRequest(channel))["statistics"]

    def begin_statistics(self) -> None:
        """Begin the statistics of all channels anew, for every viewer: what was before counts no more."""
        self._ask(requests.BeginStatisticsRequest())

    def mark(self, text: str) -> None:
        """Put a mark into the recording."""
        self._ask(requests.MarkRequest(text))

    def record(self, wish: RecordingWish | None = None) -> str:
        """Start recording; returns the file's path. The filter starts anew with the file."""
        return self._ask(requests.RecordRequest(wish or RecordingWish()))["path"]

    def describe(self, note: str | None = None, operator: str | None = None) -> None:
        """Change note and operator of the file that is being written; None leaves one as it is."""
        self._ask(requests.DescribeRequest(note, operator))

    def configure(self, **changes: Unpack[FilterChanges]) -> None:
        """Change what the filter takes from now on; it starts anew. Refused while recording."""
        self._ask(requests.ConfigureRequest(changes))

    def zero(self, argument: int) -> str:
        """Have the unit, held still, zero its rate sensors; returns what came of it. Snapshots do not wait meanwhile.

        The argument is the average's length, 0 to 255: ten or a hundred samples for each, documents dispute it. 0
        erases the stored zero. Refused while recording.
        Raises SessionError if it cannot be done now, or the unit did not answer in time; the message says what next.
        """
        from imutui.instrument.registry import INSTRUMENTS

        limit = max(each.zeroing_patience_s(max(0, argument)) for each in INSTRUMENTS.values()) + _LEEWAY_S
        return self._ask_separately(requests.ZeroRequest(argument), limit)["said"]

    def profile(self) -> ProfileDescription | None:
        """The table profile that the reference comes from; None if there is none."""
        return self._ask(requests.ProfileRequest())["profile"]

    def guide(self, do: str, wish: RecordingWish | None = None, *, yes_move: bool = False) -> None:
        """Guide the operator: "begin" (records as wished if nothing does), "next", "cancel" or "resume".

        `yes_move`: somebody has said that a table under command may move, which "begin" and "resume" have it do.
        """
        self._ask(requests.GuideRequest(do, wish or RecordingWish(), yes_move))

    def stop_recording(self) -> "RunDocument":
        """Finish the file; returns the result document. Snapshots do not wait meanwhile."""
        result = self._ask_separately(requests.StopRecordingRequest(), _STOP_S)["result"]
        assert result is not None
        return result

    def stop(self, by: str | None = None) -> "RunDocument | None":
        """End the acquisition; returns the result document of its last recording, if there was one.

        `by`: what asks for it, such as "Ctrl+C in imutui record"; None for this program. Who runs it is added.
        Raises SessionError if it ended with an error of its own.
        """
        return self._ending(requests.StopRequest(), _STOP_S, by)

    def wait(self, timeout: float | None = None) -> "RunDocument | None":
        """Wait for the end; returns and raises as `stop` does, and TimeoutError if it takes longer."""
        return self._ending(requests.WaitRequest(timeout), timeout and timeout + _REPLY_S)

    def end(self) -> EndReport | None:
        """How the acquisition ended, once it has; None if it left no word, as one that was killed leaves none."""
        return end_report.read(self.name, self.pid)

    def close(self) -> None:
        """Leave; the acquisition goes on."""
        with self._lock:
            self._drop()

    def _ask_separately(self, request: Asked, timeout: float | None, by: str | None = None) -> Reply:
        """Ask what takes its time on a connection of its own."""
        with contextlib.closing(_connect(self.name)) as connection:
            try:
                return _exchange(connection, request, timeout, self.name, by)
            except TimeoutError as error:
                said = f'the acquisition "{self.name}" has not answered for {timeout:.0f} s; it may still do what was'
                raise SessionError(f"{said} asked. `imutui status` shows how it is.") from error

    def _ending(self, request: Asked, timeout: float | None, by: str | None = None) -> "RunDocument | None":
        reply = self._ask_separately(request, timeout, by)
        if "runs" in reply:
            raise TimeoutError
        self._await_exit()
        if reply["error"] is not None:
            raise SessionError(reply["error"], reply["exit_code"])
        self.findings = reply["findings"]
        self.ended_by_itself = reply["by_itself"]
        self.ended_by = reply["ended_by"]
        return reply["result"]

    def _await_exit(self) -> None:
        """Wait until the name is free again, so that what is done next does not meet the process on its way out."""
        deadline = time.monotonic() + _EXIT_S
        while self.name in ipc.names() and time.monotonic() < deadline:
            time.sleep(0.01)

    def _ask(self, request: Asked, timeout: float = _REPLY_S) -> Reply:
        with self._lock:
            if self._socket is None:
                self._socket = _connect(self.name)
            try:
                return _exchange(self._socket, request, timeout, self.name)
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
    """Names of this user's running acquisitions."""
    return ipc.names()


def attach(name: str | None = None) -> Client:
    """Client of the running acquisition of that name, or of the only one.

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
    """An acquisition on its way up, in a process and session of its own; `select` finds it when it has said how it is.

    It has `timeout` seconds, and its first packet's period. `parent`: see `start`.
    """

    def __init__(self, plan: Plan, timeout: float = 30.0, parent: Parent | None = None) -> None:
        self.plan, self._timeout = plan, timeout
        self._missing = end_report.missing_folders(plan)
        self._process, self._output = _begun(plan, parent)
        self.deadline = time.monotonic() + timeout + plan.period_s

    def fileno(self) -> int:
        """Of what it says."""
        return self._output.fileno()

    def client(self) -> Client:
        """Wait for its first packet; raises SessionError as `start` does."""
        plan, process = self.plan, self._process
        try:
            with self._output:
                answer = _first_line(process, self._output, self.deadline)
                if answer is None:
                    end_report.end_unbegun(process, self._missing)
                    answer = _did_not_begin(plan.name, process.pid, self._timeout)
            # the process outlives this one by design; a thread takes its exit status so that no zombie stays
            threading.Thread(target=process.wait, daemon=True).start()
            if answer["ok"]:
                return Client(plan.name)
        except BaseException:
            self.give_up()
            raise
        name = _holder(plan.port) if answer["exit_code"] == lifecycle.INSTRUMENT else None
        held = name is not None and name != plan.name
        raise SessionError(_in_use(plan.port, name) if held else answer["error"], answer["exit_code"])

    def give_up(self) -> None:
        """End it, as after Ctrl+C: a command that has not seen it begin must not leave it behind."""
        end_report.end_unbegun(self._process, self._missing)


def start(plan: Plan, timeout: float = 30.0, parent: Parent | None = None) -> Client:
    """Start an acquisition in a process and session of its own; returns when its first packet has come.

    `parent`: a process that it is forked from, so that several share what they have loaded; None to load it anew.
    Raises SessionError if it could not start; the message says why and what to do next.
    """
    return Starting(plan, timeout, parent).client()


def _begun(plan: Plan, parent: Parent | None) -> tuple["subprocess.Popen[bytes] | Forked", BinaryIO]:
    """The process of an acquisition, which has its plan, and what it says."""
    log = ipc.log_path(plan.name).open("ab")
    if parent is not None:
        ours, theirs = os.pipe()
        return parent.fork(plan.dumps(), os.fdopen(theirs, "wb"), log), os.fdopen(ours, "rb")
    with log:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "imutui.session"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            start_new_session=True,
            env=preloaded.environment(),
        )
    assert process.stdin is not None
    assert process.stdout is not None
    with process.stdin:
        process.stdin.write(plan.dumps().encode() + b"\n")
    return process, cast("BinaryIO", process.stdout)


def ports() -> list[tuple[str, str]]:
    """Serial ports of this machine: name to connect with, description."""
    from imutui.instrument.port import available

    return [(p.stable_id, f"{p.device} {p.description}".strip()) for p in available()]


def probe(port: str) -> ProbeAnswer:
    """What answers at a port, found as at the beginning of an acquisition: packets are stopped, the unit is asked.

    A port that an acquisition of this user has is not touched. It takes up to some seconds where nothing answers.
    """
    from imutui.session import port_probe

    name = _holder(port)
    return port_probe.probe(port) if name is None else port_probe.not_answered(port, _in_use(port, name))


def _holder(port: str) -> str | None:
    """Name of this user's acquisition that has a port."""
    from imutui.session import port_probe

    for name in running():
        with contextlib.suppress(SessionError):
            if port_probe.same_port(str(Client(name).snapshot(since=NO_SERIES)["port"]), port):
                return name
    return None


def _in_use(port: str, name: str | None) -> str:
    attach, stop = (command(word, "--name", name or "") for word in ("attach", "stop"))
    return (
        f'{port} is in use by the acquisition "{name}". `{attach}` shows it, `{stop}` ends it; another unit is on'
        " another port."
    )


def _did_not_begin(name: str, pid: int, timeout: float) -> StartReport:
    error = f"the acquisition process did not begin within {timeout:.0f} s; see {ipc.folder()}."
    report = end_report.read(name, pid)
    if report is not None and report["result"] is not None:
        error += f" What had come by then is in {report['result']['log']}."
    return {"ok": False, "error": error, "exit_code": lifecycle.INSTRUMENT}


def _first_line(process: "subprocess.Popen[bytes] | Forked", output: BinaryIO, deadline: float) -> StartReport | None:
    """What the process says of its start; None if it says nothing by then."""
    text = b""
    while not text.endswith(b"\n"):
        ready, _, _ = select.select([output], [], [], max(0.0, deadline - time.monotonic()))
        if not ready:
            return None
        part = os.read(output.fileno(), 65536)
        if not part:
            process.kill()
            error = f"the acquisition process ended before it began; see {ipc.folder()}."
            return {"ok": False, "error": error, "exit_code": lifecycle.INSTRUMENT}
        text += part
    report: StartReport = json.loads(text)
    return report


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
    connection: socket.socket, request: Asked, timeout: float | None, name: str, by: str | None = None
) -> Reply:
    fields = request._asdict()
    if request.ask in ("stop", *CHANGES):
        fields |= {"by": by or _this_program(), "terminal": _terminal()}
    if timeout is not None and request.ask in CHANGES:
        # the acquisition gives up before the viewer does, and says whether the request is still carried out
        fields["patience_s"] = min(_PATIENCE_S, _PATIENCE_SHARE * timeout)
    try:
        pid = ipc.peer_of(connection)[1]
        connection.settimeout(timeout)
        with contextlib.suppress(BrokenPipeError):  # whoever is refused is told so first
            connection.sendall(json.dumps(fields, default=asdict).encode() + b"\n")
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
    answer: Reply = reply
    return answer


def _this_program() -> str:
    """Name of this program, with the command of imutui that it carries out."""
    path = Path(sys.argv[0])
    name = path.parent.name if path.name == "__main__.py" else path.name
    return " ".join([name, *(word for word in sys.argv[1:2] if word.isalpha())])


def _terminal() -> str:
    """Terminal of this program, such as pts/3; empty if it has none."""
    for stream in (0, 2, 1):
        with contextlib.suppress(OSError):
            return os.ttyname(stream).removeprefix("/dev/")
    return ""


def _ended_message(name: str) -> str:
    return (
        f'the acquisition "{name}" has ended. What it recorded is on the disk up to the last second;'
        " `imutui replay FILE` reads it, finished or not."
    )

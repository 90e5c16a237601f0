"""The acquisition process: `python -m imutui.session`, with a plan on its stdin, answers on a Unix socket.

Its first line on stdout says whether it runs, as JSON; started by `client.start`, in a session of its own. With a
socket's descriptor as its argument it is the process that others are forked from: see `preloaded`.
"""

import array
import contextlib
import gc
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn, TypeVar

from filters.errors import InputError
from filters.motion.profile import Profile
from imutui import defects, origin_gate
from imutui.command_line import command
from imutui.instrument.driver import Driver, InstrumentError
from imutui.instrument.names import DEFAULT
from imutui.instrument.port import Port, PortError
from imutui.instrument.registry import INSTRUMENTS, nor_the_others, which_answers
from imutui.origin_gate import AddressError
from imutui.plain_text import visible
from imutui.session import end_report, ipc, lifecycle, observe, requests
from imutui.session.acquisition import Acquisition
from imutui.session.commanded_table import CommandedTable
from imutui.session.engine import PATIENCE_S, Engine
from imutui.session.ipc import NameTakenError
from imutui.session.lifecycle import Lifecycle
from imutui.session.metadata import motion_of
from imutui.session.plan import VIRTUAL_PORT, HistoryWish, Plan, batch_of
from imutui.session.preloaded import LOADING, PLAN_LIMIT
from imutui.session.recording import DiskSpace, disk_message
from imutui.session.requests import Reply, Request, StartReport
from imutui.session.watches import FoxgloveFollower

_SWITCH_S = 0.0005
_LAST_REPLIES_S = 2.0
_START_GRACE_S = 5.0
_TERMINATED_GRACE_S = 1.2
_ORPHANED_S = 5.0  # real time
_SIGNALS = {
    signal.SIGTERM: "the signal SIGTERM, as `kill` and a shutdown send it",
    signal.SIGINT: "the signal SIGINT, as Ctrl+C sends it",
}

T = TypeVar("T")


def run(text: str) -> NoReturn:
    """Run one acquisition, of the plan in a text, and end the process."""
    code = main(text)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    # everything is closed; an interpreter that ends would wait for a compiler in another thread to let it
    os._exit(code)


def main(text: str) -> int:
    """Run one acquisition, of the plan in a text; returns the exit code."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    # the reader must get the interpreter soon after the kernel wakes it: its stamps are taken then
    sys.setswitchinterval(_SWITCH_S)
    # and what is loaded stays: a search through all of it for garbage would hold everything up
    gc.freeze()
    gc.set_threshold(10_000, 5, 5)
    plan = Plan.loads(text)
    # until here there is nothing to be left in order
    for number in _SIGNALS:
        signal.signal(number, _end_early)
    stands = Lifecycle()
    # an exception that a thread does not expect ends the acquisition, whichever thread it is
    threading.excepthook = lambda thread: stands.defect(thread.exc_value or thread.exc_type())
    try:
        if plan.record:  # before the unit is touched
            folder = Path(plan.output).parent if plan.output else Path(plan.logs)
            DiskSpace(plan.min_free_mb).refuse(folder)
        with contextlib.ExitStack() as stack:
            stack.callback(os.close, ipc.lock(plan.name))
            end_report.forget(plan.name)
            if plan.foxglove_port:  # what Foxglove can't have is reported before the unit is touched
                origin_gate.listen(plan.foxglove_host, plan.foxglove_port).close()
            if plan.port == VIRTUAL_PORT:
                name, url = stack.enter_context(_virtual(plan))
            else:
                name, url = plan.port, plan.controller
            table = stack.enter_context(_table(plan, url)) if url else None
            port = stack.enter_context(Port(name, INSTRUMENTS[plan.instrument or DEFAULT].power_up_bauds[0]))
            return _acquire(plan, port, stack, table, stands)
    except NameTakenError:
        own = () if plan.name == "default" else ("--name", plan.name)
        return _refuse(
            lifecycle.INSTRUMENT,
            f'an acquisition named "{plan.name}" is running. `{command("attach", *own)}` shows it,'
            f" `{command('stop', *own)}` ends it; --name starts another beside it.",
        )
    except Exception as error:  # noqa: BLE001 - whoever started this must hear of it, and nobody see a traceback
        code, message = _in_words(error)
        # whoever asks later for the units of a batch must hear why this one is not there
        end_report.write(plan.name, "", message)
        return _refuse(code, message)


class EndedEarlyError(Exception):
    """A signal asks for the end while there is no acquisition yet that could end; says which."""


def _end_early(number: int, _: object) -> NoReturn:
    # once is enough: the unit has to be left as it was found
    for each in _SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    raise EndedEarlyError(_SIGNALS[signal.Signals(number)])


@contextlib.contextmanager
def _left_as_found(host: Driver) -> Iterator[None]:
    """Put back what was changed of a unit if it comes to no acquisition that would."""
    try:
        yield
    except BaseException:
        with contextlib.suppress(PortError):
            if said := host.leave():
                print(visible(said), file=sys.stderr)
        raise


@contextlib.contextmanager
def _table(plan: Plan, url: str) -> Iterator[CommandedTable]:
    """A table under command; what its profile can't have is refused before anything moves, or is recorded."""
    # most virtual units are never moved
    table = CommandedTable(url, plan.limits, starts=plan.controller != VIRTUAL_PORT)
    try:
        motion = motion_of(plan)
        if plan.yes_move and plan.record and isinstance(motion, Profile):
            table.check(motion)
        yield table
    finally:
        table.close()


def _acquire(
    plan: Plan,
    port: Port,
    stack: contextlib.ExitStack,
    table: CommandedTable | None,
    stands: Lifecycle,
) -> int:
    was_asked = not plan.instrument
    is_named = not was_asked and plan.port != VIRTUAL_PORT
    usual = DEFAULT if plan.port == VIRTUAL_PORT else ""  # a virtual unit of our own
    plan = plan.of_instrument(plan.instrument or usual or which_answers(port).name)
    host = INSTRUMENTS[plan.instrument](port, plan.rate_hz if plan.sampling == "stream" else None)
    with _left_as_found(host):
        try:
            identity = host.open(plan.baud)
        except InstrumentError as error:
            if is_named:
                only = f"Only an {plan.instrument} was looked for; without --instrument the unit is asked which it is."
                raise InstrumentError(f"{error} {only}") from error
            if plan.port != VIRTUAL_PORT and was_asked:
                raise InstrumentError(f"{error} {nor_the_others()}") from error
            raise
        stack.enter_context(_own_serial(plan, identity.serial_number))
        foxglove = stack.enter_context(contextlib.closing(FoxgloveFollower(plan))) if plan.foxglove_port else None
        engine = Engine(plan, host, identity, foxglove, table, stands)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _: engine.terminate(_SIGNALS[signal.Signals(number)]))
    engine.start()
    try:
        _serve(plan, engine)
    except Exception as error:
        stands.fail(*_in_words(error), error)
        stands.ended.wait()  # the file is finished
        raise
    if stands.error is not None:
        print(visible(stands.error), file=sys.stderr)
    return engine.exit_code


def _serve(plan: Plan, engine: Engine) -> None:
    """Answer viewers until the acquisition has ended, and those who ask how it ended for some seconds more."""
    end_reported = threading.Event()

    def answer(request: Request) -> Reply:
        reply = carry_out(engine, request)
        if "exit_code" in reply:
            end_reported.set()
        return reply

    server = ipc.Server(plan.name, answer)
    threading.Thread(target=server.serve_forever, name="viewers", daemon=True).start()
    _say({"ok": True, "pid": os.getpid()})
    begun = time.monotonic()
    limit_s = plan.ends_unwatched_s
    while not engine.lifecycle.ended.wait(0.5):
        if limit_s is not None and server.unwatched_s > limit_s:
            engine.request_stop(f"itself: nobody had looked on for {limit_s:g} s, and its unit is a virtual one")
        if plan.needs_viewer and server.unwatched_s > _ORPHANED_S:
            engine.request_stop("itself: whoever gave the table its motion has gone")
    stands = engine.lifecycle
    end_report.write(plan.name, stands.ended_by, stands.error, stands.findings, engine.result)
    # who started it may not have asked yet how it goes; it must hear how it went
    report_by = begun + _START_GRACE_S
    asked_ns = engine.lifecycle.stopping_since_ns
    if engine.lifecycle.terminated and asked_ns is not None:
        report_by = min(report_by, asked_ns / 1e9 + _TERMINATED_GRACE_S)
    end_reported.wait(max(0.0, report_by - time.monotonic()))
    # the server's own end would take it up to half a second more, and nobody finds it any longer
    ipc.socket_path(plan.name).unlink(missing_ok=True)
    server.wait_idle(_LAST_REPLIES_S)


@contextlib.contextmanager
def _own_serial(plan: Plan, serial_number: str) -> Iterator[None]:
    """Hold the unit's serial number within its batch.

    Raises InstrumentError if another unit of the batch has it: their recordings could not be told apart.
    """
    batch = batch_of(plan.name)
    if not batch or not serial_number:
        yield
        return
    with ipc.claimed_serial(batch, serial_number, plan.name) as holder:
        if holder is not None:
            raise InstrumentError(
                f'the units "{holder}" and "{plan.name}" (at {plan.port}) have the same serial number, {serial_number}.'
                f' "{holder}" goes on. Check that each port leads to a unit of its own; a virtual unit takes another'
                " --seed or --serial-number."
            )
        yield


def carry_out(engine: Engine, request: Request) -> Reply:
    """Do what a viewer asks; raises InputError with what is wrong with it, or what stands against it."""
    asked, sender = requests.parse(request)
    patience_s = PATIENCE_S if sender.patience_s is None else sender.patience_s
    who = sender.who

    def call(function: Callable[[Acquisition], T], *, late: bool = False) -> T:
        return engine.call(function, patience_s, late=late)

    match asked:
        case requests.SnapshotRequest(since):
            return {"snapshot": call(lambda acquisition: observe.snapshot(acquisition, since), late=True)}
        case HistoryWish():
            return {"history": call(lambda acquisition: acquisition.history(asked), late=True)}
        case requests.StatisticsRequest(channel):
            return {"statistics": call(lambda acquisition: acquisition.channel_statistics(channel), late=True)}
        case requests.BeginStatisticsRequest():
            call(lambda acquisition: acquisition.begin_statistics())
        case requests.MarkRequest(text):
            call(lambda acquisition: acquisition.mark(text, who))
        case requests.RecordRequest(wish):
            return {"path": call(lambda acquisition: acquisition.record(wish))}
        case requests.DescribeRequest(note, operator):
            call(lambda acquisition: acquisition.recording.describe(note, operator))
        case requests.ConfigureRequest(changes):
            call(lambda acquisition: acquisition.configure(changes))
        case requests.ZeroRequest(argument):
            return {"said": engine.zero(argument, patience_s)}
        case requests.ProfileRequest():
            return {"profile": call(lambda acquisition: acquisition.profile(), late=True)}
        case requests.GuideRequest(do, wish, may_move):
            if do == "cancel":
                engine.stop_table()  # before the worker comes to it, which may be busy with the recording
            call(lambda acquisition: acquisition.guide(do, wish, who, may_move=may_move))
        case requests.StopRecordingRequest():
            return {"result": call(lambda acquisition: acquisition.stop_recording(who))}
        case requests.StopRequest():
            engine.request_stop(who)
            return _ending(engine)
        case requests.WaitRequest(timeout_s):
            return _ending(engine) if engine.lifecycle.ended.wait(timeout_s) else {"runs": True}
    return {}


def _ending(engine: Engine) -> Reply:
    stands = engine.lifecycle
    stands.ended.wait()
    return {
        "result": engine.result,
        "error": stands.error,
        "exit_code": stands.exit_code,
        "findings": stands.findings,
        "by_itself": engine.ended_by_itself,
        "ended_by": stands.ended_by,
    }


@contextlib.contextmanager
def _virtual(plan: Plan) -> Iterator[tuple[str, str]]:
    """Run a virtual instrument of our own; it ends with us even if we are killed, because its stdin then closes.

    Gives its port and the URL of its table's controller, which is that of the plan if it does not stand on its own.
    """
    own = plan.controller == VIRTUAL_PORT
    table = ("--controller", "127.0.0.1:0") if own else ()
    command = [sys.executable, "-P", "-m", "imutui", "virtual", "--while-stdin", *table, *plan.virtual]
    unit = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert unit.stdin is not None
    assert unit.stdout is not None
    try:
        path = unit.stdout.readline().strip()
        if not path:
            raise InstrumentError("the virtual instrument did not start; `imutui virtual` says why.")
        yield path, unit.stdout.readline().strip() if own else plan.controller
    finally:
        with contextlib.suppress(OSError):
            unit.stdin.close()
        unit.wait()


def _in_words(error: Exception) -> tuple[int, str]:
    """Exit code and message of what an acquisition did not begin for."""
    match error:
        case PortError() | InstrumentError() | AddressError():
            return lifecycle.INSTRUMENT, str(error)
        case EndedEarlyError():
            said = f"ended by {error} before the first packet came: nothing was recorded."
            return lifecycle.INSTRUMENT, said
        case FileExistsError():
            return lifecycle.USAGE, f"{error.filename} exists; --force replaces it, or choose another name."
        case InputError():
            return lifecycle.USAGE, str(error)
        case OSError():
            return lifecycle.DISK, disk_message(None, error)
    return lifecycle.OWN_ERROR, defects.told(error)


def _refuse(code: int, message: str) -> int:
    _say({"ok": False, "error": message, "exit_code": code})
    print(visible(message), file=sys.stderr)
    return code


def _say(message: StartReport) -> None:
    # nobody may be there to hear it: whoever started us can have gone
    with contextlib.suppress(OSError):
        print(json.dumps(message), flush=True)


def _load(steps: int) -> None:
    """Load all that an acquisition does at some time, and run the filter's compiled steps, as many as are wanted."""
    from imutui.logbook import schemas

    for name in schemas.TYPES.values():
        schemas.definition(name)
    if steps:
        from filters.kalman import runner
        from imutui.session import live_filter

        live_filter.load()
        for effects in (False, True)[:steps]:
            runner.warm_up(effects=effects)


@contextlib.contextmanager
def _beating(asked: socket.socket) -> Iterator[None]:
    """Send once a second that this process lives; the thread has ended before anything is forked."""
    done = threading.Event()

    def beat() -> None:
        with contextlib.suppress(OSError):  # the other side has gone
            while not done.wait(1.0):
                asked.send(LOADING)

    thread = threading.Thread(target=beat)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def fork(descriptor: int, steps: int) -> None:
    """Fork an acquisition for each plan that comes over a socket, with stdout and stderr; ends when that is closed."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    asked = socket.socket(fileno=descriptor)
    with _beating(asked):
        _load(steps)
    gc.collect()
    gc.freeze()  # no search for garbage writes to what is shared
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for them here
    while True:
        plan, descriptors, _, _ = socket.recv_fds(asked, PLAN_LIMIT, 2)
        if not plan:
            return
        pid = os.fork()
        if not pid:
            _become(asked, descriptors)
            run(plan.decode())
        for descriptor in descriptors:
            os.close(descriptor)
        asked.send(str(pid).encode())


def _become(asked: socket.socket, descriptors: "list[int] | array.array[int]") -> None:
    """Be a process of its own, as one that was started alone."""
    asked.close()
    os.setsid()
    for number, descriptor in enumerate(descriptors, 1):
        os.dup2(descriptor, number)
        os.close(descriptor)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


if __name__ == "__main__":
    if sys.argv[1:]:
        fork(*map(int, sys.argv[1:]))
    else:
        run(sys.stdin.readline())

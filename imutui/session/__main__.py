"""The acquisition process: `python -m imutui.session` reads a plan from stdin and answers viewers on a Unix socket.

`client.start` starts it. Its first line on stdout is JSON: null once it runs, else the record of its end. With a
socket's descriptor as its argument it is the process that acquisitions are forked from: see `processes.Parent`.
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
from collections.abc import Iterator, Mapping
from typing import NoReturn

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
from imutui.session import ipc, lifecycle, requests
from imutui.session.commanded_table import CommandedTable
from imutui.session.engine import Engine
from imutui.session.ipc import NameTakenError
from imutui.session.lifecycle import EndReport, Lifecycle
from imutui.session.metadata import motion_of
from imutui.session.plan import VIRTUAL_PORT, Plan, batch_of
from imutui.session.processes import LOADING, PLAN_LIMIT
from imutui.session.recording import DiskSpace, disk_message
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
    # modules stay loaded: a search through all of them for garbage would hold every thread up
    gc.freeze()
    gc.set_threshold(10_000, 5, 5)
    plan = Plan.loads(text)
    # before this, an end by a signal leaves nothing behind
    for number in _SIGNALS:
        signal.signal(number, _end_early)
    stands = Lifecycle(plan.name)
    # an exception that a thread does not expect ends the acquisition, whichever thread it is
    threading.excepthook = lambda thread: stands.defect(thread.exc_value or thread.exc_type())
    try:
        if plan.record:  # before the unit is touched
            DiskSpace(plan.min_free_mb).refuse(plan.folder)
        with contextlib.ExitStack() as stack:
            stack.callback(os.close, ipc.lock(plan.name))
            lifecycle.forget_end(plan.name)
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
        message = (
            f'an acquisition named "{plan.name}" is running. `{command("attach", *own)}` shows it,'
            f" `{command('stop', *own)}` ends it; --name starts another beside it."
        )
        return _refuse(lifecycle.failed(plan.name, lifecycle.INSTRUMENT, message))
    except Exception as error:  # noqa: BLE001 - the caller needs a message, and no traceback
        end = lifecycle.failed(plan.name, *_in_words(error))
        # a viewer of the batch looks here for why this unit is missing
        lifecycle.write_end(end)
        return _refuse(end)


class EndedEarlyError(Exception):
    """A signal has asked for the end before there is an acquisition; the text names the signal."""


def _end_early(number: int, _: object) -> NoReturn:
    # once is enough: the unit has to be left as it was found
    for each in _SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    raise EndedEarlyError(_SIGNALS[signal.Signals(number)])


@contextlib.contextmanager
def _left_as_found(host: Driver) -> Iterator[None]:
    """Put a unit back as it was if no acquisition begins that would do so at its end."""
    try:
        yield
    except BaseException:
        with contextlib.suppress(PortError):
            if said := host.leave():
                print(visible(said), file=sys.stderr)
        raise


@contextlib.contextmanager
def _table(plan: Plan, url: str) -> Iterator[CommandedTable]:
    """Yield a table under command; a profile beyond its limits is refused before anything moves or is recorded."""
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
    named, is_our_own = plan.instrument, plan.port == VIRTUAL_PORT
    plan = plan.of_instrument(named or (DEFAULT if is_our_own else which_answers(port).name))
    host = INSTRUMENTS[plan.instrument](port, plan.rate_hz if plan.sampling == "stream" else None)
    with _left_as_found(host):
        try:
            identity = host.open(plan.baud)
        except InstrumentError as error:
            if is_our_own:
                raise
            only = f"Only an {named} was looked for; without --instrument the unit is asked which it is."
            raise InstrumentError(f"{error} {only if named else nor_the_others()}") from error
        _lock_serial(plan, identity.serial_number)
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
    """Answer viewers until the acquisition has ended, and for some seconds more those that ask for its end."""
    end_reported = threading.Event()

    def answer(request: Mapping[str, object]) -> object:
        reply = requests.carry_out(engine, request)
        if request["ask"] in ("stop", "wait") and reply is not None:
            end_reported.set()
        return reply

    server = ipc.Server(plan.name, answer)
    threading.Thread(target=server.serve_forever, name="viewers", daemon=True).start()
    _report(None)
    begun = time.monotonic()
    limit_s = plan.ends_unwatched_s
    while not engine.lifecycle.ended.wait(0.5):
        if limit_s is not None and server.unwatched_s > limit_s:
            engine.request_stop(f"itself: nobody had looked on for {limit_s:g} s, and its unit is a virtual one")
        if plan.needs_viewer and server.unwatched_s > _ORPHANED_S:
            engine.request_stop("itself: whoever gave the table its motion has gone")
    lifecycle.write_end(requests.end_of(engine))
    # the viewer that started the acquisition may not have asked for its end yet
    report_by = begun + _START_GRACE_S
    asked_ns = engine.lifecycle.stopping_since_ns
    if engine.lifecycle.terminated and asked_ns is not None:
        report_by = min(report_by, asked_ns / 1e9 + _TERMINATED_GRACE_S)
    end_reported.wait(max(0.0, report_by - time.monotonic()))
    # the server is not shut down, which would take up to half a second more: no viewer finds it any longer
    ipc.socket_path(plan.name).unlink(missing_ok=True)
    server.wait_idle(_LAST_REPLIES_S)


def _lock_serial(plan: Plan, serial_number: str) -> None:
    """Hold the unit's serial number within its batch for the life of this process.

    Raises InstrumentError if another unit of the batch has it: their recordings could not be told apart.
    """
    batch = batch_of(plan.name)
    if not batch or not serial_number:
        return
    try:
        ipc.lock_serial(batch, serial_number, plan.name)
    except NameTakenError as holder:
        raise InstrumentError(
            f'the units "{holder}" and "{plan.name}" (at {plan.port}) have the same serial number, {serial_number}.'
            f' "{holder}" goes on. Check that each port leads to a unit of its own; a virtual unit takes another'
            " --seed or --serial-number."
        ) from holder


@contextlib.contextmanager
def _virtual(plan: Plan) -> Iterator[tuple[str, str]]:
    """Run a virtual instrument; it ends with this process even if that is killed, because its stdin then closes.

    Yields its port and the URL of its table's controller; the plan's if the instrument has no table of its own.
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
    """Return exit code and message of the error that kept an acquisition from beginning."""
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


def _refuse(end: EndReport) -> int:
    _report(end)
    print(visible(end["error"] or ""), file=sys.stderr)
    return end["exit_code"]


def _report(end: EndReport | None) -> None:
    """Write the first line of stdout; the process that started this one may have gone."""
    with contextlib.suppress(OSError):
        print(json.dumps(end), flush=True)


def _load(steps: int) -> None:
    """Load every module that an acquisition uses, and run that many of the filter's compiled steps."""
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
    """Report once a second that this process lives, from a thread that ends before the first fork."""
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
    """Fork an acquisition for each plan, stdout and stderr that come over a socket; returns when that is closed."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    asked = socket.socket(fileno=descriptor)
    with _beating(asked):
        _load(steps)
    gc.collect()
    gc.freeze()  # no search for garbage writes to what is shared
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # this process waits for none of them
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
    """Make a forked process like one that was started alone."""
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

"""Processes under test: started so that they can be interrupted, waited for with a limit, and never left behind."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

LIMIT_S = 120.0  # longer than anything that is waited for takes on a busy machine


def wait_until(true: Callable[[], bool], timeout: float = LIMIT_S, pause: float = 0.02) -> None:
    """Wait for a state of affairs; fails if it does not come. It is looked at after a pause (s), again and again."""
    deadline = time.monotonic() + timeout
    while not true():
        assert time.monotonic() < deadline, "it did not come"
        time.sleep(pause)


def command_line(*arguments: str) -> list[str]:
    """This installation's program, which need not be on the path."""
    return [sys.executable, "-m", "imutui", *arguments]


@contextmanager
def started(line: list[str], **options: Any) -> Iterator["subprocess.Popen[str]"]:
    """A process that is killed at the end if it still runs; its stdout and stderr are pipes unless options say else.

    It can be interrupted as one can that was started in a terminal, wherever the tests were started: nohup, and a
    shell that runs something in the background, have SIGINT ignored by all that they start.
    """
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL}
    # what has a handler here begins with the default there
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        process = subprocess.Popen(line, text=True, **(pipes | options))
    finally:
        signal.signal(signal.SIGINT, before)
    try:
        yield process
    finally:
        process.kill()
        process.wait(LIMIT_S)
        for stream in (process.stdin, process.stdout, process.stderr):
            if stream is not None:
                stream.close()


@contextmanager
def virtual_process(*arguments: str) -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    """A virtual instrument in a process of its own: its port, and the process."""
    with started(command_line("virtual", *arguments)) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip(), process


def end_owner(lock: Path) -> None:
    """Kill the process that holds a lock file, if one does, and wait until it is gone."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            holds = any(os.path.realpath(fd) == str(lock) for fd in (process / "fd").iterdir())
        except OSError:
            continue
        if holds and int(process.name) != os.getpid():
            os.kill(int(process.name), signal.SIGKILL)
            wait_until(lambda pid=int(process.name): has_ended(pid))  # type: ignore[misc]


def state_of(pid: int) -> str:
    """A letter: of a process that is gone Z, as of one that its parent has not looked at; of a stopped one T."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "Z"


def has_ended(pid: int) -> bool:
    return state_of(pid) == "Z"


def processor_s(pid: int, *, ended_children: bool = False) -> float:
    """Processor time of a running process so far, with that of its children that have ended if so wanted."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11 : 15 if ended_children else 13])) / os.sysconf("SC_CLK_TCK")


def children(pid: int) -> list[int]:
    """Processes that one has started and that are not gone."""
    found: list[int] = []
    for thread in Path(f"/proc/{pid}/task").glob("*"):
        try:
            found += [int(child) for child in (thread / "children").read_text().split()]
        except OSError:
            continue  # the thread has ended meanwhile
    return found


def family(pid: int) -> list[int]:
    """A process and those below it, nearest first."""
    return [pid, *(below for child in children(pid) for below in family(child))]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return int(found.getsockname()[1])


def listens(port: int) -> bool:
    """Whether a process of this machine listens at a TCP port."""
    with suppress(OSError):
        socket.create_connection(("127.0.0.1", port)).close()
        return True
    return False

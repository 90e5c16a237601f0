"""The recorder is killed, or told to end."""

import json
import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from helpers.processes import LIMIT_S, command_line, family, has_ended, started, wait_until
from helpers.readers import packets_by_reader
from helpers.tap import packets_of

from imutui.jobs.recover import recover
from imutui.logbook import reader, summary
from imutui.session import client
from imutui.session.plan import Plan
from reliability.setting import (
    NOTHING_NEW,
    PERIOD_S,
    Acquired,
    acquiring,
    log_packets,
    seconds_until_ended,
)


@dataclass(frozen=True)
class Killed:
    """What a kill -9 cost."""

    lost_s: float  # packets that had reached the host's queue and are not in the file, in seconds
    held: int  # packets in the file
    read: dict[str, int]  # packets that others read in the file once it was recovered, by reader


def kill_nine(folder: Path, seconds: float = 1.5) -> Killed:
    """Kill a recorder after so many seconds of packets, and recover its file; a unit of its own ends with it."""
    tap = folder / "tap"
    plan = Plan("virtual", logs=str(folder / "logs"), record=True, filter="none", virtual=("--tap", str(tap)))
    connection = client.start(plan)
    wait_until(lambda: connection.snapshot(NOTHING_NEW)["packets"] * PERIOD_S > seconds)
    path = Path(connection.snapshot(NOTHING_NEW)["recording"]["path"])
    assert summary.read(path).state == "being written"
    processes = family(connection.pid)
    os.kill(connection.pid, signal.SIGKILL)
    sent = packets_of(tap)
    wait_until(lambda: all(has_ended(pid) for pid in processes))
    held = [tuple(row[1:]) for row in log_packets(path).tolist()]
    assert held == sent[: len(held)], "nothing is lost but the end"
    _tell_viewer(connection)
    return Killed((len(sent) - len(held)) * PERIOD_S, len(held), packets_by_reader(recovered(path)))


def _tell_viewer(connection: client.Client) -> None:
    try:
        connection.snapshot()
    except client.SessionGoneError as error:
        assert "imutui replay" in str(error)
    else:
        raise AssertionError("it answers still")


def recovered(path: Path) -> Path:
    """A whole file made of an unfinished one, beside it."""
    output = path.with_name(f"{path.stem}_recovered.mcap")
    assert summary.read(path).state == "unfinished"
    recover(path, output)
    assert np.array_equal(reader.read(output).samples.stamp_ns, reader.read(path).samples.stamp_ns)
    return output


@dataclass(frozen=True)
class Ended:
    """How an end that was asked for went."""

    # file_s, gone_s: until the file had its footer, and until the process was gone, s
    file_s: float
    gone_s: float
    exit_code: int  # of the acquisition, as whoever follows it is told


def after_a_hangup(it: Acquired) -> None:
    """After it was told that a terminal has gone, which is not its own: it goes on."""
    os.kill(it.client.pid, signal.SIGHUP)
    it.goes_on()


def in_a_flush(it: Acquired) -> None:
    """Just as bytes go to the disk."""
    size = it.path.stat().st_size
    path = it.path
    wait_until(lambda: path.stat().st_size > size)


def told_to_end(folder: Path, number: signal.Signals, when: Callable[[Acquired], None]) -> Ended:
    with acquiring(folder) as it:
        it.goes_on()
        path = it.path
        with ThreadPoolExecutor(1) as pool:
            told = pool.submit(it.client.wait, LIMIT_S)
            when(it)
            ended = _timed(path, it.client.pid, lambda: os.kill(it.client.pid, number))
            told.result(LIMIT_S)
    return ended


def _timed(path: Path, pid: int, end: Callable[[], None], code: Callable[[], int] = lambda: 0) -> Ended:
    since = time.monotonic()
    end()
    wait_until(lambda: _has_footer(path))
    file_s = time.monotonic() - since
    gone_s = seconds_until_ended(pid, since)
    assert reader.read(path).finished
    return Ended(file_s, gone_s, code())


def interrupted(folder: Path) -> Ended:
    """Ctrl+C under `imutui record` in the foreground."""
    path, name = folder / "out.mcap", "ended-by-hand"  # others of the same user may run beside it
    line = command_line("record", "--port", "virtual", "--rate", "20", "--filter", "none", "--json", "-o", str(path))
    line += ["--name", name]
    said = folder / "said.txt"
    with said.open("w") as stream, started(line, cwd=folder, stderr=stream) as run:
        # an interrupt before it says so ends an acquisition that it does not follow yet, and has no result
        wait_until(lambda: f"acquisition {name}," in said.read_text())
        connection = _attached(name)
        wait_until(lambda: connection.snapshot(NOTHING_NEW)["packets"] > 50)
        ended = _timed(path, run.pid, lambda: run.send_signal(signal.SIGINT), lambda: run.wait(LIMIT_S))
        out, _ = run.communicate(timeout=LIMIT_S)
    assert "Traceback" not in said.read_text()
    assert json.loads(out)["samples"] == reader.read(path).samples.stamp_ns.size
    return ended


def _attached(name: str) -> client.Client:
    found: list[client.Client] = []

    def answers() -> bool:
        try:
            found.append(client.attach(name))
        except client.SessionError:
            return False
        return True

    wait_until(answers)
    return found[0]


def _has_footer(path: Path) -> bool:
    with path.open("rb") as stream:
        stream.seek(-8, os.SEEK_END)
        return stream.read() == b"\x89MCAP0\r\n"

"""Recordings over the wire faster than real time: pseudo terminal, acquisition process and log as they are.

`imutui virtual --speed` makes a faster unit: the host's clock then goes slower than the unit's, and the log holds
what a clock on the wall saw. Here both processes take the time of the unit, which goes on when the host has read what
was sent. So an acquisition is as fast as the machine, and no load makes a packet late.
"""

import os
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

_HERE = Path(__file__).parent
_LIMIT_S = 280.0
SLOW_LINE = ("--baud", "9600")
"""Of `imutui record`, for long recordings: on such a line a unit sends every third reading, a third of the work."""


@contextmanager
def unit(scenario: Path, power_on: int, *options: str) -> Iterator[tuple[str, dict[str, str]]]:
    """A virtual unit of a scenario on a time of its own: port, and the environment for `imutui record`."""
    with virtual("--scenario", str(scenario), "--power-on", str(power_on), *options) as found:
        yield found


@contextmanager
def virtual(*arguments: str) -> Iterator[tuple[str, dict[str, str]]]:
    """`imutui virtual` with these arguments, on a time of its own: port, and the environment for `imutui record`."""
    with _clock() as folder:
        command = [sys.executable, str(_HERE / "virtual.py"), folder, "--while-stdin", *arguments]
        with _running(command) as port:
            yield port, {**os.environ, **_environment(folder)}


@contextmanager
def own() -> Iterator[None]:
    """Acquisitions that are started meanwhile from here, of port "virtual", are on the time of their own unit.

    One at a time, and with an end: it costs a processor as long as it runs.
    """
    with _clock() as folder, patch.dict(os.environ, _environment(folder)):
        yield


@contextmanager
def _clock() -> Iterator[str]:
    """Folder of a clock that stands still, and of the pipe by which the host acknowledges."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "clock").write_bytes(struct.pack("q", time.monotonic_ns()))
        os.mkfifo(Path(folder) / "read")
        yield folder


def _environment(folder: str) -> dict[str, str]:
    path = os.pathsep.join(filter(None, (str(_HERE / "host"), os.environ.get("PYTHONPATH"))))
    return {"PYTHONPATH": path, "IMUTUI_TEST_UNIT_TIME": folder}


def acquire(
    scenario: Path, power_on: int, log: Path, seconds: float, *options: str
) -> "subprocess.CompletedProcess[str]":
    """Record one power-on of a scenario with `imutui record`, 20 Hz without a filter unless options say otherwise."""
    with unit(scenario, power_on) as (port, environment):
        return record(port, environment, log, seconds, *options)


def acquire_in_real_time(
    scenario: Path, power_on: int, log: Path, seconds: float, *options: str
) -> "subprocess.CompletedProcess[str]":
    """The same from a plain `imutui virtual`."""
    with virtual_in_real_time("--scenario", str(scenario), "--power-on", str(power_on)) as (port, environment):
        return record(port, environment, log, seconds, *options)


@contextmanager
def virtual_in_real_time(*arguments: str) -> Iterator[tuple[str, dict[str, str]]]:
    """A plain `imutui virtual` with these arguments: port, and the environment for `imutui record`."""
    with _running([sys.executable, "-m", "imutui", "virtual", "--while-stdin", *arguments]) as port:
        yield port, dict(os.environ)


@contextmanager
def _running(command: list[str]) -> Iterator[str]:
    """Port of a unit that runs."""
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        port = process.stdout.readline().strip()
        if not port:
            raise RuntimeError(process.communicate()[1])
        yield port
    finally:
        process.terminate()
        try:
            process.communicate(timeout=10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def record(
    port: str, environment: dict[str, str], log: Path, seconds: float, *options: str
) -> "subprocess.CompletedProcess[str]":
    """Record a unit that runs with `imutui record`, 20 Hz without a filter unless options say otherwise.

    Exit code 1 is as good as 0: the recording is complete, and a channel or the filter is at fault. Raises RuntimeError
    for any other.
    """
    command = [sys.executable, "-m", "imutui", "record", "--port", port, "-o", str(log), "--name", log.stem]
    command += ["--duration", f"{seconds:g}"]
    if "--filter" not in options:
        command += ["--filter", "none"]
    if "--rate" not in options:
        command += ["--rate", "20"]
    done = subprocess.run(
        [*command, *options],
        env=environment,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=_LIMIT_S + seconds,
        check=False,
    )
    if done.returncode not in (0, 1):
        raise RuntimeError(f"exit {done.returncode}\n{done.stdout}\n{done.stderr}")
    return done

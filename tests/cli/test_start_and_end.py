"""Ctrl+C at any moment of a program's start, and standard streams that a shell has closed."""

import shlex
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers.paths import ROOT, SAMPLE
from helpers.processes import LIMIT_S, command_line, started, wait_until

from imutui.cli import exit_codes
from imutui.session import ipc

ENTRY = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]["imutui"]
# says when the first thing is loaded that the program does not begin with; what comes before is Python's own start,
# where nothing of ours could answer, and the import of the module of the entry point
PROGRAM = """
import os, sys
from {module} import {function}
sys.addaudithook(lambda event, of: os.write(1, b"\\n") if event == "import" and of[0] == "imutui.cli" else None)
sys.exit({function}())
"""
_RUNS_ON = "600"


@contextmanager
def beginning(line: str) -> Iterator["subprocess.Popen[str]"]:
    """The program, from when the import of its commands begins."""
    module, function = ENTRY.split(":")
    command = [sys.executable, "-c", PROGRAM.format(module=module, function=function), *line.split(" ")]
    with started(command) as program:
        assert program.stdout is not None
        assert program.stdout.read(1) == "\n"
        yield program


@pytest.mark.parametrize(
    ("line", "moments"),
    [
        (f"info {SAMPLE}", 40),
        (f"demo --headless --seconds {_RUNS_ON}", 10),
        (f"record --port virtual --rate 20 --duration {_RUNS_ON}", 10),
    ],
)
def test_ctrl_c_at_any_moment_of_the_start_ends_in_one_line(home: Path, line: str, moments: int) -> None:
    with beginning(line) as program:  # how long its start takes on this machine, now
        begun = time.monotonic()
        if line.endswith(_RUNS_ON):
            wait_until(lambda: bool(ipc.names()), LIMIT_S)
            program.send_signal(signal.SIGINT)
        program.communicate(timeout=LIMIT_S)
        whole_s = time.monotonic() - begun
    for k in range(moments):
        with beginning(line) as program:
            begun = time.monotonic()
            while time.monotonic() - begun < 0.8 * whole_s * k / moments:
                time.sleep(0.001)
            program.send_signal(signal.SIGINT)
            _, err = program.communicate(timeout=LIMIT_S)
        assert "Traceback" not in err, f"moment {k}: {err}"
        assert "KeyboardInterrupt" not in err, f"moment {k}: {err}"
        # a command that was done already may have ended well, or be gone before it could say anything
        wanted = (130,) if line.endswith(_RUNS_ON) else (130, 0, -signal.SIGINT)
        assert program.returncode in wanted, f"moment {k}: {err}"
        assert program.returncode != 130 or err, f"moment {k}"
    wait_until(lambda: not ipc.names(), LIMIT_S)


def test_ctrl_c_amid_the_making_of_a_class_is_one_too(capsys: pytest.CaptureFixture[str]) -> None:
    """Python 3.11 wraps what `__set_name__` raises; later versions do not."""

    class Interrupts:
        def __set_name__(self, owner: type, name: str) -> None:
            raise KeyboardInterrupt

    with pytest.raises((RuntimeError, KeyboardInterrupt)) as wrapped:
        type("Made", (), {"attribute": Interrupts()})
    assert exit_codes.told(wrapped.value) == 130
    assert capsys.readouterr().err == "imutui: interrupted\n"


CLOSED = "imutui: the standard output is closed, and what is asked for goes there. `>/dev/null` throws it away.\n"


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (f"info {SAMPLE}", 0),
        ("info --help", 0),
        ("--version", 0),
        (f"export {SAMPLE} --format csv -o readings.csv --force", 0),
        ("demo --headless --seconds 1", 1),
        ("info none.mcap", 3),
        ("replay --nonsense", 2),
        ("", 2),
    ],
)
def test_a_closed_stream_is_told_in_words_or_does_not_matter(home: Path, line: str, code: int) -> None:
    command = shlex.join(command_line(*line.split(" ")) if line else command_line())

    def run(closed: str) -> "subprocess.CompletedProcess[str]":
        # a shell, since closing is what shells do
        return subprocess.run(
            f"exec {command} {closed}", shell=True, capture_output=True, text=True, timeout=LIMIT_S, check=False
        )

    prints = code in (0, 1)
    without = run(">&-")
    assert without.returncode == (5 if prints else code), without.stderr
    assert without.stderr.endswith(CLOSED) == prints, without.stderr
    assert "Errno" not in without.stderr
    for closed in ("2>&-", "<&-"):
        outcome = run(closed)
        assert outcome.returncode == code, outcome.stderr
        assert bool(outcome.stdout) == prints
    assert run("<&- >&- 2>&-").returncode == (5 if prints else code)


def test_a_file_does_not_take_the_place_of_a_closed_stream(home: Path) -> None:
    """Or what is printed would be written into it."""
    line = f"exec {shlex.join(command_line('recover', str(SAMPLE), '-o', 'new.mcap', '--json'))}"
    for closed in (">&-", "2>&-", "<&- >&- 2>&-"):
        Path("new.mcap").unlink(missing_ok=True)
        subprocess.run(f"{line} {closed}", shell=True, capture_output=True, timeout=LIMIT_S, check=False)
        subprocess.run(command_line("check", "new.mcap"), capture_output=True, timeout=LIMIT_S, check=True)

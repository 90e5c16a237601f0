"""The maker's own program for the IMU381 connects to the virtual one, reads and sets it, and records it."""

import csv
import os
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers.processes import LIMIT_S, wait_until
from helpers.units import Still, served

from filters.imu import STANDARD_GRAVITY
from imutui.instrument.uut.unit import VirtualUnit
from imutui.instrument.uut.unit_options import UnitOptions

ROWS = 100
KILLED_ITSELF = -9


class Program:
    """A program that is typed to and answers on its standard output."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self.process = process
        self.said = ""
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        while data := self.process.stdout.read(1):
            self.said += data

    def expect(self, text: str) -> None:
        """Wait until it has said this."""
        wait_until(lambda: text in self.said or self.process.poll() is not None)
        assert text in self.said, self.said

    def type(self, line: str, answer: str = ">>") -> None:
        """Type a line, and wait for what it should say; it prompts by default."""
        assert self.process.stdin is not None
        self.said = ""
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        self.expect(answer)


@contextmanager
def openimu(port: str, home: Path) -> Iterator[Program]:
    """`openimu`, unmodified, on a port; it keeps what it writes in its home."""
    program = os.environ.get("OPENIMU", "")
    if not program:
        pytest.skip(
            "needs OPENIMU naming the program of the package openimu, in an environment with python-can and scapy"
        )
    words = [program, "--device-type", "DMU", "-b", "115200", "-c", port]
    environment = {"HOME": str(home), "PATH": os.environ["PATH"], "PYTHONUNBUFFERED": "1"}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(words, env=environment, cwd=home, text=True, **pipes) as process:
        try:
            yield Program(process)
        finally:
            process.kill()


def rows_in(home: Path) -> list[list[str]]:
    """What it has recorded so far, without the heading."""
    found = list(home.rglob("data_S1.csv"))
    return list(csv.reader(found[0].read_text().splitlines()))[1:] if found else []


def test_the_makers_program_connects_reads_sets_and_records(tmp_path: Path) -> None:
    heard: list[str] = []
    options = UnitOptions(text="IMU381ZA-200 VIRTUAL SIM")
    unit = VirtualUnit(Still(), options)
    with served(unit, log=heard.append) as port, openimu(port, tmp_path) as program:
        program.expect("# Connected DMU #")
        program.type("connect", "IMU381ZA-200")
        program.type("get type", "S1")
        program.type("get orien", "+X+Y+Z")
        program.type("set type S1")
        program.type("record")
        wait_until(lambda: len(rows_in(tmp_path)) > ROWS)
        program.type("stop")
        program.type("exit", answer="")
        assert program.process.wait(LIMIT_S) == KILLED_ITSELF
    assert "PK: ping" in heard
    assert "SF: set in RAM 0003=5331" in heard
    still = [0.0, 0.0, 0.998 * STANDARD_GRAVITY, 0.1, -0.2, 0.3, *[25.0] * 4]
    one_count = [0.003] * 3 + [0.02] * 3 + [0.004] * 4
    for row in rows_in(tmp_path)[:ROWS]:
        assert all(abs(float(x) - y) < count for x, y, count in zip(row, still, one_count, strict=False)), row

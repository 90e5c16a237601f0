"""`imutui record --batch` whose forking process hangs: units start without it, and Ctrl+C ends all at once."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.processes import LIMIT_S, children, command_line, has_ended, started, wait_until
from helpers.units import Still, served

from imutui.cli.virtual_readings import SIMULATED
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.session import client

HANGS = """
import os, signal, sys
if sys.orig_argv[-3:-2] == ["imutui.session"]:
    os.kill(os.getpid(), signal.SIGSTOP)
if "record" in sys.orig_argv:
    from imutui.session import processes
    processes._SILENT_S = {silent_s}
"""


@pytest.fixture
def batch(home: Path) -> Iterator[Path]:
    """File of a batch of two units that are there."""
    path = home / "two.toml"
    path.write_text("".join(f'[[unit]]\nport = "{home}/{name}"\n' for name in ("one", "two")))
    units = [VirtualUnit(Still(), UnitOptions(version=SIMULATED, serial_number=number)) for number in (41, 42)]
    with served(units[0], link=home / "one"), served(units[1], link=home / "two"):
        yield path


def hanging(home: Path, monkeypatch: pytest.MonkeyPatch, silent_s: float) -> None:
    (home / "sitecustomize.py").write_text(HANGS.format(silent_s=silent_s))
    monkeypatch.setenv("PYTHONPATH", str(home))


def test_units_start_without_a_process_that_hangs(home: Path, monkeypatch: pytest.MonkeyPatch, batch: Path) -> None:
    hanging(home, monkeypatch, 1.0)
    line = command_line("record", "--batch", str(batch), "--filter", "none", "--duration", "1.5")
    with started(line) as process:
        _, said = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, said
    assert len(list((home / "logs").glob("*.mcap"))) == 2


def test_the_first_ctrl_c_ends_it(home: Path, monkeypatch: pytest.MonkeyPatch, batch: Path) -> None:
    hanging(home, monkeypatch, 1e6)
    with started(command_line("record", "--batch", str(batch), "--filter", "none")) as process:
        wait_until(lambda: len(children(process.pid)) == 1)
        (parent,) = children(process.pid)
        wait_until(lambda: Path(f"/proc/{parent}/stat").read_text().split()[2] == "T")
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert has_ended(parent)
    assert client.running() == []

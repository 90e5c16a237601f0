"""How long an acquisition lasts, and how it ends when its unit has fallen silent."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from helpers.commands import imutui
from helpers.processes import wait_until
from helpers.units import Still, served

from imutui.instrument.faults import FaultyLine, LineFault
from imutui.instrument.imu400 import handshake
from imutui.instrument.imu400.crossbow import POWER_UP_BAUD
from imutui.instrument.imu400.host import Imu400Host
from imutui.instrument.imu400.unit import VirtualUnit
from imutui.instrument.port import Port
from imutui.logbook import reader
from imutui.session import client, observe
from imutui.session.engine import Engine
from imutui.session.plan import Plan

SILENT_FROM_S = 0.4
FOR_EVER_S = 1e6


@contextmanager
def falling_silent(seconds: float = FOR_EVER_S) -> Iterator[str]:
    """Port of a unit that is not heard for so long, from 0.4 s after it was first asked for data."""
    line = FaultyLine([LineFault(SILENT_FROM_S, "silence", seconds=seconds)])
    with served(VirtualUnit(Still()), line=line) as path:
        yield path


@contextmanager
def acquiring(path: str, home: Path, **fields: Any) -> Iterator[Engine]:
    """An acquisition in this process, which records without a filter."""
    with Port(path, POWER_UP_BAUD) as port:
        plan = Plan(path, **{"logs": str(home / "logs"), "record": True, "filter": "none", "rate_hz": 20.0} | fields)
        engine = Engine(plan, Imu400Host(port), handshake.open_dialogue(port, plan.baud))
        engine.start()
        yield engine


@pytest.mark.parametrize("sampling", ["stream", "polled"])
def test_the_duration_is_over_by_the_clock_though_the_unit_is_silent(home: Path, sampling: str) -> None:
    """Within half a second, with the file finished, the silence told in it and exit code 4."""
    with falling_silent() as path, acquiring(path, home, sampling=sampling, duration_s=2.0) as engine:
        began = time.monotonic()
        assert engine.lifecycle.ended.wait(30.0)
        assert 1.5 < time.monotonic() - began < 8.0
    assert engine.lifecycle.error is None
    assert engine.lifecycle.state == "stopped"
    assert engine.exit_code == 4
    # on a busy machine a polled rate may not have been kept before, which is told too
    [finding] = [each for each in engine.lifecycle.findings if "silent at the end" in each["text"]]
    assert finding["exit_code"] == 4
    assert engine.result is not None
    log = reader.read(Path(engine.result["log"]))
    assert log.finished
    assert any("silent at the end" in event.text for event in log.events)
    assert log.events[-1].text == "ended by its duration of 2 s"


def test_a_gap_counts_as_time_and_a_unit_that_is_back_by_the_end_is_fine(home: Path) -> None:
    """1.2 s of silence in 2.5 s: it ends 2.5 s after the first packet, with exit code 0."""
    with falling_silent(1.2) as path, acquiring(path, home, rate_hz=133.0, duration_s=2.5) as engine:
        assert engine.lifecycle.ended.wait(30.0)
    assert engine.exit_code == 0
    assert engine.lifecycle.findings == []
    assert engine.result is not None
    seconds = reader.read(Path(engine.result["log"])).seconds()
    assert seconds[-1] == pytest.approx(2.5, abs=0.5)


def test_silence_alone_ends_nothing_and_whoever_asks_for_the_end_gets_it(home: Path) -> None:
    """No duration: it listens on; the process that is told to stop ends with 0, and tells the silence."""
    with falling_silent() as path, acquiring(path, home, duration_s=None) as engine:
        # longer than what counts as a silence, and looked at once a second
        wait_until(lambda: "no packets for" in str(engine.call(lambda a: observe.snapshot(a, 2**62))["events"]), 30.0)
        assert engine.lifecycle.state == "running"
        engine.request_stop()
        assert engine.lifecycle.ended.wait(30.0)
    assert engine.exit_code == 0
    assert "silent at the end" in engine.lifecycle.findings[0]["text"]


def test_the_command_says_that_the_unit_was_silent_at_the_end(home: Path) -> None:
    """`record --duration`: its result on stdout, the silence on stderr, exit 4, a finished file."""
    record = ("record", "--rate", "20", "--filter", "none", "--duration", "2", "--json", "-o", "a.mcap")
    with falling_silent() as path:
        done = imutui(*record, "--port", path, check=4)
    assert json.loads(done.stdout)["finished"]
    assert "silent at the end" in done.stderr
    assert reader.read(home / "a.mcap").finished


def test_status_and_stop_say_that_the_unit_is_silent(home: Path) -> None:
    """`status` while it lasts; `stop` finishes the file, says it, and ends with 1: something is to be looked at."""
    with falling_silent() as path:
        connection = client.start(Plan(path, 20.0, logs=str(home / "logs"), record=True, filter="none"))
        wait_until(lambda: (connection.snapshot(2**62)["silent_s"] or 0.0) > 1.1)
        assert "NO DATA" in imutui("status").stdout
        assert "silent at the end" in imutui("stop", check=1).stderr
        [log] = (home / "logs").glob("*.mcap")
        assert reader.read(log).finished

"""How long an acquisition lasts, and how it ends when its unit has fallen silent."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers.acquisitions import acquiring
from helpers.commands import imutui
from helpers.processes import wait_until
from helpers.units import Still, served

from imutui.instrument.faults import FaultyLine, LineFault
from imutui.instrument.imu400.unit import VirtualUnit
from imutui.logbook import reader
from imutui.session import client
from imutui.session.plan import Plan

SILENT_FROM_S = 0.4
FOR_EVER_S = 1e6


@contextmanager
def falling_silent(seconds: float = FOR_EVER_S) -> Iterator[str]:
    """Port of a unit that is not heard for so long, from 0.4 s after it was first asked for data."""
    line = FaultyLine([LineFault(SILENT_FROM_S, "silence", seconds=seconds)])
    with served(VirtualUnit(Still()), line=line) as path:
        yield path


@pytest.mark.parametrize("sampling", ["stream", "polled"])
def test_the_duration_is_over_by_the_clock_though_the_unit_is_silent(home: Path, sampling: str) -> None:
    with (
        falling_silent() as path,
        acquiring(home, path, packets=0, rate_hz=20.0, sampling=sampling, duration_s=2.0) as run,
    ):
        result, engine = run.wait_until_ended(), run.engine
    assert engine.lifecycle.error is None
    assert engine.lifecycle.state == "stopped"
    assert engine.exit_code == 4
    # on a busy machine a polled rate may not have been kept before, which is told too
    [finding] = [each for each in engine.lifecycle.findings if "silent at the end" in each["text"]]
    assert finding["exit_code"] == 4
    log = reader.read(Path(result["log"]))
    assert log.finished
    assert any("silent at the end" in event.text for event in log.events)
    assert log.events[-1].text == "ended by its duration of 2 s"


def test_a_gap_counts_as_time_and_a_unit_that_is_back_by_the_end_is_fine(home: Path) -> None:
    with falling_silent(1.2) as path, acquiring(home, path, packets=0, duration_s=2.5) as run:
        result = run.wait_until_ended()
    assert (run.engine.exit_code, run.findings()) == (0, [])
    seconds = reader.read(Path(result["log"])).seconds()
    assert seconds[-1] == pytest.approx(2.5, abs=0.5)


def test_silence_alone_ends_nothing_and_whoever_asks_for_the_end_gets_it(home: Path) -> None:
    with falling_silent() as path, acquiring(home, path, packets=0, rate_hz=20.0) as run:
        # longer than what counts as a silence, and looked at once a second
        wait_until(lambda: "no packets for" in str(run.seen()["events"]))
        assert run.seen()["state"] == "running"
        run.end()
    assert run.engine.exit_code == 0
    assert "silent at the end" in run.engine.lifecycle.findings[0]["text"]


def test_the_command_says_that_the_unit_was_silent_at_the_end(home: Path) -> None:
    record = ("record", "--rate", "20", "--filter", "none", "--duration", "2", "--json", "-o", "a.mcap")
    with falling_silent() as path:
        done = imutui(*record, "--port", path, check=4)
    assert json.loads(done.stdout)["finished"]
    assert "silent at the end" in done.stderr
    assert reader.read(home / "a.mcap").finished


def test_status_and_stop_say_that_the_unit_is_silent(home: Path) -> None:
    with falling_silent() as path:
        connection = client.start(Plan(path, 20.0, logs=str(home / "logs"), record=True, filter="none"))
        wait_until(lambda: (connection.snapshot(2**62)["silent_s"] or 0.0) > 1.1)
        assert "NO DATA" in imutui("status").stdout
        assert "silent at the end" in imutui("stop", check=1).stderr
        [log] = (home / "logs").glob("*.mcap")
        assert reader.read(log).finished

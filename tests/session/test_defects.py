"""A fault of the program's own, in any thread of an acquisition: it ends as failed, and its file is finished."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ros_messages
from helpers.acquisitions import acquiring
from helpers.commands import imutui_process
from helpers.processes import wait_until
from helpers.units import virtual

from filters.kalman import runner
from imutui.instrument.frame_search import FrameDecoder
from imutui.logbook import reader
from imutui.session import client, lifecycle
from imutui.session.channel_statistics import ChannelStatistics
from imutui.session.plan import VIRTUAL_PORT, Plan
from imutui.session.run import Run

REPORTED = "a defect of imutui, and not of what it was given: ValueError: zero-size array"


@pytest.fixture(autouse=True)
def reports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the reports of defects written here."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("imutui.defects._reports", {})


def broken(*_: object, **__: object) -> Any:
    """Raise numpy's own error, as a fault of ours does."""
    return np.empty(0).min()


@pytest.mark.parametrize(
    ("place", "filter_name"),
    [
        ((FrameDecoder, "feed"), "none"),
        ((Run, "_take_block"), "none"),
        ((Run, "flush"), "none"),
        ((ChannelStatistics, "add"), "none"),
        ((runner, "rows"), "spkf"),
    ],
)
def test_a_fault_in_the_reader_or_the_worker_ends_the_acquisition_as_failed(
    home: Path, monkeypatch: pytest.MonkeyPatch, place: tuple[Any, str], filter_name: str
) -> None:
    with acquiring(home, filter=filter_name) as run:
        with monkeypatch.context() as patch:
            patch.setattr(*place, broken)
            run.wait_until_ended()
        engine = run.engine
    assert (engine.lifecycle.state, engine.exit_code) == ("failed", lifecycle.OWN_ERROR)
    assert REPORTED in str(engine.lifecycle.error)
    log = reader.read(run.first, raw=True)
    assert log.finished
    assert len(ros_messages.packets(log)) >= 20
    assert any(REPORTED in event.text for event in log.events)


def test_a_fault_while_the_file_is_finished_costs_the_result_and_not_the_file(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("imutui.logbook.results.document", broken)
    with acquiring(home, filter="spkf") as run:
        wait_until(lambda: bool((run.seen()["filter"] or {}).get("samples")))
        run.end()
    assert run.engine.exit_code == lifecycle.OWN_ERROR
    assert reader.read(run.first).finished


# The process: a fault is put into it by a module that Python loads at its start

SPOILED = """
import sys, threading
if "imutui.session" in sys.orig_argv:
    import pathlib, time
    import numpy
    def broken(*_, **__):
        numpy.empty(0).min()
    def spoil():
        while not any(pathlib.Path({home!r}).rglob("*.mcap")):
            time.sleep(0.1)
        time.sleep(1.0)
        {spoil}
    threading.Thread(target=spoil, daemon=True).start()
"""
PLACES = {
    "reader": "from imutui.instrument.frame_search import FrameDecoder; FrameDecoder.feed = broken",
    "a thread of its own": "threading.Thread(target=broken).start()",
    "viewers": "from imutui.session import ipc; ipc.Server.service_actions = broken",
    "main": "from imutui.session import ipc; ipc.Server.unwatched_s = property(broken)",
}


@contextmanager
def spoiled(home: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> Iterator[str]:
    """Port of a unit, while an acquisition that is started meets a fault a second after its file has begun."""
    (home / "spoil").mkdir()
    (home / "spoil" / "sitecustomize.py").write_text(SPOILED.format(spoil=PLACES[place], home=str(home)))
    monkeypatch.setenv("PYTHONPATH", str(home / "spoil"))
    with virtual() as port:
        yield port


@pytest.mark.parametrize("place", PLACES)
def test_whoever_follows_it_hears_of_the_fault_and_gets_exit_code_1(
    home: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    with spoiled(home, monkeypatch, place) as port:
        # what the main thread looks at, of a unit of the acquisition's own only, is for how long there was no viewer
        port = VIRTUAL_PORT if place == "main" else port
        plan = Plan(port, record=True, filter="none", logs=str(home / "logs"), unattended=True)
        connection = client.start(plan)
        wait_until(lambda: client.running() == [])
    report = lifecycle.read_end("default", connection.pid)
    assert report is not None
    assert REPORTED in str(report["error"])
    [log] = (home / "logs").glob("*.mcap")
    assert reader.read(log).finished
    assert "Traceback" not in (home / "run" / "imutui" / "default.log").read_text()


@pytest.mark.parametrize("command", [("record", "--unattended", "--port"), ("record", "--json", "--port")])
def test_the_command_that_records_ends_with_exit_code_1(
    home: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    with spoiled(home, monkeypatch, "reader") as port:
        done = imutui_process(*command, port, "--filter", "none", "-o", "a.mcap", check=None)
    assert done.returncode == 1
    assert REPORTED in done.stderr
    assert Path(re.findall(r"Attach (\S+),", done.stderr)[0]).parent == home
    assert reader.read(home / "a.mcap").finished

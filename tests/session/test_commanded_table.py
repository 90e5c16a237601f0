"""A table under an acquisition's command: real processes, a virtual unit, and a virtual controller in this process."""

import math
import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.commands import imutui
from helpers.documents import dwell, profile_toml, rate, sine
from helpers.processes import LIMIT_S, family, wait_until
from helpers.tables import Served, served, strike
from helpers.units import virtual

from filters.simulation import TableFault
from imutui.logbook import reader
from imutui.session import client
from imutui.session.client import Client, SessionError
from imutui.session.plan import Plan

RUN = profile_toml(
    dwell(1.0),
    dwell(1.0, outer=10.0, inner=-20.0),
    rate("inner", 40.0, 1.0),
    sine("middle", 3.0, 1.0, 1.0),
    dwell(1.0),
    align="marks",
    slew_dps=60.0,
)
TURN = profile_toml(rate("inner", 20.0, 600.0), align="marks")


def plan(home: Path, it: Served, port: str, profile: str = RUN, **fields: Any) -> Plan:
    usual: dict[str, Any] = {
        "logs": str(home / "logs"), "record": True, "filter": "none", "reference": "profile",
        "reference_file": ("run.toml", profile), "controller": it.url, "yes_move": True,
    }  # fmt: skip
    return Plan(port, **(usual | fields))


@contextmanager
def turning(home: Path, it: Served, **fields: Any) -> Iterator[tuple[Client, ExitStack]]:
    """An acquisition whose table turns, and what unplugs its unit."""
    with ExitStack() as unit:
        connection = client.start(plan(home, it, unit.enter_context(virtual()), TURN, **fields))
        wait_until(lambda: (connection.snapshot(2**62)["guide"] or {}).get("state") == "hold")
        yield connection, unit


def stands(it: Served) -> bool:
    return all(axis.is_idle for axis in it.table.axes.values())


def the_log(home: Path) -> Path:
    return next((home / "logs").glob("*.mcap"))


def test_a_profile_runs_by_itself_and_is_recorded_with_what_the_table_did(home: Path) -> None:
    with served() as it, virtual() as port:
        connection = client.start(plan(home, it, port))
        end = connection.wait(120.0)
        assert (end["by_itself"], end["findings"]) == (True, [])
        result = end["result"]
        assert result is not None
        assert stands(it)
    log = reader.read(Path(result["log"]))
    assert (log.finished, log.damage) == (True, "")
    assert log.info.controller == it.url
    assert "VIRTUAL SIM TABLE" in log.info.controller_identity
    assert np.isnan(log.table.rates_dps).all()  # while it turns, a reference of zero would be false
    marks = {event.text: event.stamp_ns for event in log.events if event.name == "mark"}
    assert list(marks) == [f"segment {n}" for n in range(1, 6)]
    states = log.states
    assert (np.diff(states.stamp_ns) > 0).all()

    def between(first: str, seconds: float) -> np.ndarray:
        """Angles and rates in a segment, which was begun up to half a second before it was marked."""
        inside = (states.stamp_ns >= marks[first]) & (states.stamp_ns <= marks[first] + seconds * 1e9)
        assert np.count_nonzero(inside) > 10
        return np.hstack([states.angles_deg, states.rates_dps])[inside]

    at_rest = between("segment 2", 1.0)
    assert np.abs(at_rest[:, :3] - [10.0, 0.0, -20.0]).max() < 0.05
    assert np.abs(between("segment 3", 1.0)[:, 5].mean() - 40.0) < 1.0
    assert np.ptp(between("segment 4", 1.0)[:, 1]) > 4.0


def test_esc_stops_the_table_at_once_and_it_goes_on_after_another_yes(home: Path) -> None:
    with served() as it, turning(home, it) as (connection, _):
        with pytest.raises(SessionError, match="by itself"):
            connection.guide("next")
        connection.guide("cancel")
        wait_until(lambda: stands(it))
        guide = connection.snapshot(2**62)["guide"]
        assert guide is not None
        assert guide["state"] == "cancelled"
        with pytest.raises(SessionError, match="say that it may"):
            connection.guide("resume")
        connection.guide("resume", yes_move=True)
        wait_until(lambda: abs(it.table.axes["inner"].rate) > math.radians(15.0))
        connection.stop()
        wait_until(lambda: stands(it))


@pytest.mark.parametrize("victim", ["acquisition", "keeper"])
def test_the_table_stands_when_either_process_is_killed(home: Path, victim: str) -> None:
    with served() as it, turning(home, it) as (connection, _):
        keeper = next(p for p in family(connection.pid) if b"imutui.table" in Path(f"/proc/{p}/cmdline").read_bytes())
        os.kill(keeper if victim == "keeper" else connection.pid, signal.SIGKILL)
        wait_until(lambda: stands(it))
        if victim == "keeper":
            findings = connection.wait(LIMIT_S)["findings"]
            assert any("keeper of the table" in finding["text"] for finding in findings)
        assert reader.read(the_log(home)).finished == (victim == "keeper")


@pytest.mark.parametrize("wrong", ["unit", "interlock", "stuck"])
def test_the_table_stands_the_file_is_whole_and_it_is_said(home: Path, wrong: str) -> None:
    with served() as it, turning(home, it) as (connection, unit):
        if wrong == "unit":
            unit.close()
        else:
            strike(it, TableFault(0.0, wrong))
        wait_until(lambda: stands(it))
        findings = connection.wait(LIMIT_S)["findings"]
        said = {"unit": "line to the unit", "interlock": "interlock", "stuck": "does not follow"}[wrong]
        assert any("in segment 1: " in f["text"] and said in f["text"] for f in findings)
        assert max(finding["exit_code"] for finding in findings) == 4
    log = reader.read(the_log(home))
    assert (log.finished, log.damage) == (True, "")
    assert [event.text for event in log.events if event.name == "mark"] == ["segment 1", "segment 1 ends"]


def test_a_profile_beyond_limits_is_refused_before_anything_moves_or_is_recorded(home: Path) -> None:
    with served() as it, virtual() as port:
        with pytest.raises(SessionError, match="segment 3 of the profile") as refused:
            client.start(plan(home, it, port, limits="inner=30/100"))
        assert refused.value.exit_code == 2
        assert it.told == []
        assert not (home / "logs").exists()


def test_a_controller_without_a_profile_is_recorded_and_never_commanded(home: Path) -> None:
    with served() as it, virtual() as port:
        still = plan(home, it, port, reference="level", reference_file=("", ""), yes_move=False, duration_s=1.0)
        result = client.start(still).wait(LIMIT_S)["result"]
        assert it.told == []
    assert result is not None
    assert reader.read(Path(result["log"])).states.stamp_ns.size > 10


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (("--reference", "run.toml"), "--yes-move"),
        (("--reference", "clock.toml"), 'align = "marks"'),
        (("--yes-move", "--limits", "inner=fast"), "outer=30/50"),
    ],
)
def test_what_can_not_be_asked_is_refused_with_what_next(home: Path, asked: tuple[str, ...], said: str) -> None:
    (home / "run.toml").write_text(RUN)
    (home / "clock.toml").write_text(RUN.replace("marks", "none"))
    controller = "acutrol://192.0.2.1:9888"
    done = imutui("record", "--port", "/dev/ttyUSB9", "--controller", controller, *asked, check=2)
    assert said in done.stderr

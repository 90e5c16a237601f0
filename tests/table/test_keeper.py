"""The keeper of a table, and its owner: what is never sent, and that the table stands whatever goes wrong."""

import math
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from helpers.processes import wait_until
from helpers.tables import Served, served, strike

from filters.errors import InputError
from filters.simulation import TableFault, TableModel
from imutui.table import messages, owner
from imutui.table.links import TableError
from imutui.table.messages import Command, Report
from imutui.table.motion import AxisLimits, Motion, Move, Swing, TableState, Turn
from imutui.table.owner import KeptTable

TURNING = math.radians(5.0)
STOPS = TableModel(seed=3, low=math.radians(-90.0), high=math.radians(90.0))


@contextmanager
def kept(it: Served, limits: str = "", **options: object) -> Iterator[KeptTable]:
    table = KeptTable(it.url, limits, **options)  # type: ignore[arg-type]
    try:
        yield table
    finally:
        table.close()


def go(table: KeptTable, *motions: Motion) -> None:
    """Have motions begin, and wait until they are commanded."""
    table.ask(Command("go", motions))


def turning(it: Served, table: KeptTable, dps: float = 30.0) -> None:
    """Have the inner axis turn, and wait until it does."""
    table.ask(Command("enable"))
    go(table, Turn("inner", dps, 500.0))
    wait_until(lambda: abs(it.table.axes["inner"].rate) > TURNING)


def stands(it: Served) -> bool:
    """Whether all axes rest, with their modes off, so that they stay so."""
    rests = all(abs(axis.rate) < math.radians(0.01) for axis in it.table.axes.values())
    return rests and all(axis.is_idle for axis in it.table.axes.values())


def test_it_says_what_the_table_may_do_and_asks_its_angles_all_the_time() -> None:
    with served(STOPS) as it, kept(it, "inner=50/100, outer=20/30/-10/10") as table:
        assert table.axes == ("outer", "middle", "inner")
        assert (table.limits["inner"].rate_dps, table.limits["outer"].high_deg) == (50.0, 10.0)
        wait_until(lambda: len(table.states) > 20)
        assert it.told == []


def test_nothing_moves_before_it_is_enabled() -> None:
    with served() as it, kept(it) as table:
        for motion in (Move("inner", 5.0, 10.0, 10.0), Turn("inner", 5.0, 10.0), Swing("inner", 1.0, 0.1, 10.0)):
            with pytest.raises(TableError, match="before it is enabled"):
                go(table, motion)
        assert it.told == []


@pytest.mark.parametrize(
    ("motions", "why"),
    [
        ([Turn("inner", 60.0, 50.0)], "its limit is 50"),
        ([Turn("inner", 10.0, 200.0)], "its limit is 100"),
        ([Turn("inner", 10.0, 0.0)], "positive"),
        ([Turn("up", 10.0, 50.0)], "up"),
        ([Turn("inner", math.nan, 50.0)], "nan deg/s"),
        ([Turn("inner", 10.0, 50.0), Move("middle", 91.0, 10.0, 10.0)], "-90 to 90"),
        ([Move("middle", 9.0, 0.0, 10.0)], "positive"),
        ([Swing("inner", 10.0, 2.0, 100.0)], "its limit is 50"),
        ([Swing("inner", 1.0, 1.0, 10.0)], "brakes more gently"),
        ([Turn("inner", 10.0, 50.0), Turn("inner", -10.0, 50.0)], "of one axis"),
    ],
)
def test_a_motion_outside_of_limits_is_refused_and_none_of_its_command_is_sent(motions: list[Motion], why: str) -> None:
    with served(STOPS) as it, kept(it, "inner=50/100") as table:
        table.ask(Command("enable"))
        before = list(it.told)
        with pytest.raises(TableError, match=why):
            go(table, *motions)
        assert it.told == before
        assert not table.has_ended


def test_it_moves_rests_and_is_let_go_with_its_interlock_open() -> None:
    with served() as it:
        with kept(it) as table:
            table.ask(Command("enable"))
            go(table, *(Move(axis, 7.0 * (axis == "inner"), 20.0, 50.0) for axis in table.axes))
            wait_until(lambda: abs(math.degrees(it.table.axes["inner"].angle) - 7.0) < 0.01)
        assert stands(it)
        assert it.told[-3:] == [f":interlock:open {n}" for n in (1, 2, 3)]
        assert table.error == ""


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (TableFault(0.0, "interlock"), "interlock"),
        (TableFault(0.0, "limit", axis="inner"), "interlock"),
        (TableFault(0.0, "stuck", axis="inner"), "does not follow"),
        (TableFault(0.0, "silent", seconds=2.0), "does not answer"),
        (TableFault(0.0, "cut", seconds=1.0), "link"),
    ],
    ids=lambda value: value.kind if isinstance(value, TableFault) else "",
)
def test_the_table_stands_after_a_fault_and_why_is_said(fault: TableFault, said: str) -> None:
    with served() as it, kept(it) as table:
        turning(it, table)
        strike(it, fault)
        wait_until(lambda: table.has_ended)
        wait_until(lambda: stands(it))  # one whose drive was off already brakes by itself
        assert said in table.error
        assert "It was stopped: rate zero, mode off." in table.error


def test_the_owner_stops_the_table_when_its_keeper_is_killed() -> None:
    with served() as it, kept(it) as table:
        turning(it, table)
        os.kill(table._process.pid, signal.SIGKILL)
        wait_until(lambda: table.has_ended)
        assert stands(it)
        assert "were sent from here" in table.error


def test_a_keeper_that_hangs_is_killed_and_the_table_stopped() -> None:
    with served() as it, kept(it) as table:
        turning(it, table)
        os.kill(table._process.pid, signal.SIGSTOP)
        wait_until(lambda: table.has_ended)
        assert stands(it)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_keeper_that_is_told_to_end_stops_the_table_first(number: signal.Signals) -> None:
    with served() as it, kept(it) as table:
        turning(it, table)
        os.kill(table._process.pid, number)
        wait_until(lambda: table.has_ended)
        assert stands(it)
        assert number.name in table.error


def test_an_owner_that_does_its_work_no_more_commands_no_table() -> None:
    lives = [True]
    with served() as it, kept(it, lives=lambda: lives[0]) as table:
        turning(it, table)
        lives[0] = False
        wait_until(lambda: table.has_ended)
        assert stands(it)
        assert "said nothing" in table.error


_OWNER = """
import sys
from imutui.table.messages import Command
from imutui.table.motion import Turn
from imutui.table.owner import KeptTable
table = KeptTable(sys.argv[1])
table.ask(Command("enable"))
table.ask(Command("go", (Turn("inner", 30.0, 500.0),)))
print("turns", flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_table_stands_when_its_owner_is_killed_or_stopped(number: signal.Signals) -> None:
    with served() as it:
        owner = subprocess.Popen(
            [sys.executable, "-c", _OWNER, it.url], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        try:
            assert owner.stdout is not None
            assert owner.stdout.readline() == "turns\n"
            wait_until(lambda: abs(it.table.axes["inner"].rate) > TURNING)
            os.kill(owner.pid, number)
            wait_until(lambda: stands(it) and it.told[-1] == ":interlock:open 3")
        finally:
            owner.kill()
            owner.communicate()


def test_a_stop_gets_in_between_the_commands_of_a_move_on_a_slow_link() -> None:
    """No axis is set going after it, and the first line after it is a stop's."""
    with served() as it, kept(it) as table:
        table.ask(Command("enable"))
        it.server._of_link.append(TableFault(0.0, "slow", delay=0.25))
        table.send(Command("go", tuple(Move(axis, 90.0, 20.0, 100.0) for axis in table.axes)))
        wait_until(lambda: ":mode:position 1" in it.told)
        before = len(it.told)
        os.kill(table._process.pid, signal.SIGINT)
        wait_until(lambda: table.has_ended)
        assert stands(it)
        after = [told for told in it.told[before:] if "limit" not in told]
        assert after[0] in [f":demand:rate {n},0" for n in (1, 2, 3)]
        assert not [told for told in after if "position" in told]


def test_a_second_command_does_not_take_a_table_that_turns_under_anothers() -> None:
    with served() as it, kept(it) as table:
        turning(it, table, 100.0)
        before = list(it.told)
        with kept(it) as other, pytest.raises(TableError, match=r"in mode rate.*another host commands the table"):
            other.ask(Command("enable"))
        assert it.told == before
        assert not table.has_ended
        assert abs(it.table.axes["inner"].rate) > TURNING


def test_messages_are_read_as_they_were_written() -> None:
    motions = Move("inner", 1.0, 2.0, 3.0), Turn("outer", -1.0, 2.0), Swing("middle", 1.0, 2.0, 3.0)
    for command in (Command("beat"), Command("go", motions, stops=2, number=7)):
        assert messages.command(messages.encode(command)) == command
    state = TableState(1, 2, (0.0, 1.0, 2.0), (3.0, 4.0, 5.0), "rate", "")
    limits = {"inner": AxisLimits(1.0, 2.0, None, 3.0)}
    for report in (
        Report(),
        Report("table", ("inner",), limits),
        Report(state=state, to=3, refused="no"),
        Report(ended=True),
    ):
        assert messages.report(messages.encode(report)) == report
    with pytest.raises(InputError, match="not whole"):
        messages.report(messages.encode(Report(state=state))[:-9])


def test_an_answer_belongs_to_its_command() -> None:
    with served() as it, kept(it) as table:
        table.send(Command("go", (Turn("inner", 5.0, 100.0),)))  # refused: the table is not enabled
        table.ask(Command("enable"))
        with pytest.raises(TableError, match="not one of"):
            go(table, Turn("up", 5.0, 100.0))


def test_a_keeper_that_hangs_on_its_link_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(owner, "_START_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"acutrol://127.0.0.1:{listener.getsockname()[1]}"
        with pytest.raises(TableError, match=r"has not answered the table's keeper within 0\.3 s"):
            KeptTable(url)


def test_a_controller_that_is_not_there_is_told() -> None:
    with pytest.raises(TableError, match="can't be reached"):
        KeptTable("acutrol://127.0.0.1:9")

"""`imutui investigate`: what it asks for, how it is stopped, how its page looks."""

import contextlib
import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from helpers.commands import imutui
from helpers.processes import LIMIT_S, command_line, started, wait_until
from helpers.tables import rests, served
from helpers.traces import whole_document

from imutui.cli import investigate
from imutui.cli.investigation_page import ended, page
from imutui.jobs.investigation_diary import DIARY, LAST_GOOD, Diary, DiaryDocument, RoundEntry
from imutui.report import trace_report
from imutui.report.blocks import Table
from imutui.session import client
from imutui.table.acutrol import connect

pytestmark = pytest.mark.usefixtures("home")

ENOUGH = ("--port", "/dev/null", "--controller", "acutrol://127.0.0.1:9", "--hours", "1")


def entry(number: int, **changes: Any) -> RoundEntry:
    made: Any = {
        "kind": "round", "start_s": 200.0 * number, "motion": f"turn the inner axis both ways, motion {number}",
        "minutes": 3.1, "expected_bits": 1.25, "why": "scale factor or cubic nonlinearity on gz (0.9 bits)",
        "log": f"logs/{number:02d}.mcap", "power_on": 0,
        "rivals": [{"channel": "gz", "names": ["scale", "nonlinearity_cubic"], "odds": [420.0, 7.5]}],
        "status": {c: "confounded" if c == "gz" else "clean" for c in ("gx", "gy", "gz", "ax", "ay", "az")},
        "came": "gz: scale over nonlinearity_cubic 3 → 56",
    }  # fmt: skip
    return made | changes


def diary(*rounds: RoundEntry, **changes: Any) -> DiaryDocument:
    made: Any = {"version": 1, "hours": 2.0, "spent_s": 3600.0, "power_on": 0, "outcome": "", "takes": []}
    return made | {"rounds": list(rounds)} | changes


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (ENOUGH, "-o DIR"),
        ((*ENOUGH[:4], "-o", "DIR"), "--hours"),
        ((*ENOUGH[2:], "-o", "DIR"), "--port"),
        ((*ENOUGH[:4], "--hours", "0", "-o", "DIR", "--yes-move"), "--hours is 0"),
        ((*ENOUGH[:4], "--hours", "nan", "-o", "DIR", "--yes-move"), "--hours is nan"),
        (("--hours", "inf", "-o", "DIR", "--resume", "--yes-move"), "--hours is inf"),
        (("--hours", "1e9", "-o", "DIR", "--resume", "--yes-move"), "--hours is 1e+09"),
        ((*ENOUGH, "-o", "DIR"), "--yes-move"),
        ((*ENOUGH, "-o", "DIR", "--switched"), "--resume"),
        (("-o", "DIR", "--resume"), "nothing to go on with"),
        (
            ("--port", "/dev/null", "--controller", "nobody://x", "--hours", "1", "-o", "DIR", "--yes-move"),
            "acutrol://",
        ),
    ],
)
def test_what_lacks_is_said_and_nothing_moves(tmp_path: Path, arguments: tuple[str, ...], said: str) -> None:
    """A usage error names what is missing; nobody's word that the table may move is taken for granted."""
    placed = [str(tmp_path / "made") if argument == "DIR" else argument for argument in arguments]
    assert said in imutui("investigate", *placed, check=2).stderr
    assert not list(tmp_path.rglob("*.mcap"))


def test_a_new_investigation_replaces_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "unit7"
    (folder / "logs").mkdir(parents=True)
    for name in ("effects.toml", "logs/01.mcap", "notes.txt"):
        (folder / name).write_text("mine")
    line = ("--port", "/dev/none", "--controller", "acutrol://127.0.0.1:1", "--hours", "1", "--yes-move")
    said = imutui("investigate", *line, "-o", folder, check=2).stderr
    assert "has files that would be replaced, and stays as it is: effects.toml, logs/01.mcap. Name another" in said
    assert sorted(path.name for path in folder.iterdir()) == ["effects.toml", "logs", "notes.txt"]


def test_a_controller_that_is_not_there_is_said(tmp_path: Path) -> None:
    """Exit code 4, with where it was sought."""
    told = imutui("investigate", *ENOUGH, "-o", tmp_path / "made", "--yes-move", check=4).stderr
    assert "127.0.0.1:9" in told


def test_too_short_a_time_is_refused_before_it_is_asked_whether_the_table_may_move(tmp_path: Path) -> None:
    """The question is the last thing before the table moves."""
    with served() as it:
        asked = ("--port", "/dev/null", "--controller", it.url, "--hours", "0.2", "-o", str(tmp_path / "made"))
        terminal, its_end = os.openpty()
        with started(command_line("investigate", *asked), stdin=its_end) as process:
            _, said = process.communicate(timeout=LIMIT_S)
        os.close(terminal)
        os.close(its_end)
        assert process.returncode == 2
        assert "`hours` is 0.2" in said
        assert "WILL MOVE" not in said
        assert not (tmp_path / "made").exists()


def test_a_diary_that_cannot_be_read_is_taken_from_its_last_good_copy(tmp_path: Path) -> None:
    """No number that is not finite gets into one."""
    kept = Diary.begun(2.0, tmp_path)
    kept.save()
    kept.document["spent_s"] = 60.0
    kept.save()
    kept.document["hours"] = float("nan")
    with pytest.raises(ValueError, match="Out of range"):
        kept.save()
    assert Diary.read(tmp_path).document["spent_s"] == 60.0
    for spoilt in ("", "{", '{"version": 1, "hours": NaN}', json.dumps(diary(hours=-1.0))):
        (tmp_path / DIARY).write_text(spoilt)
        read = Diary.read(tmp_path)
        assert (read.document["hours"], read.document["spent_s"]) == (2.0, 0.0)
        assert "Its last good copy" in read.said
    read.save()
    assert json.loads((tmp_path / LAST_GOOD).read_text())["hours"] == 2.0


def test_folders_of_one_name_have_acquisitions_of_their_own(tmp_path: Path) -> None:
    """Else one investigation would take the other's for what a killed session has left behind, and end it."""
    first, second = tmp_path / "a/unit", tmp_path / "b/unit"
    assert investigate._name_of(first) == investigate._name_of(tmp_path / "b/../a/unit") != investigate._name_of(second)


def test_whatever_stops_it_stops_the_table_and_the_motion_is_made_again(tmp_path: Path) -> None:
    """Ctrl+C, then SIGTERM after going on: both times the mode is off, and the diary has no log of what was cut."""
    folder = tmp_path / "unit"
    with started(command_line("virtual", "--controller", "127.0.0.1:0")) as virtual:
        assert virtual.stdout is not None
        port, url = (virtual.stdout.readline().strip() for _ in range(2))
        begin = ["--port", port, "--controller", url, "--hours", "1", "-o", str(folder), "--yes-move"]
        resume = ["--resume", "-o", str(folder), "--yes-move"]
        with contextlib.closing(connect(url)) as controller:
            for options, number in ((begin, signal.SIGINT), (resume, signal.SIGTERM)):
                with started(command_line("investigate", *options)) as process:
                    wait_until(lambda: controller.read().mode != "off", pause=0.1)
                    process.send_signal(number)
                    _, told = process.communicate(timeout=LIMIT_S)
                assert process.returncode == 130, told
                assert f"--resume -o {folder}" in told
                state = controller.read()
                assert state.mode == "off"
                assert rests(state)
                kept = json.loads((folder / DIARY).read_text())
                assert [(r["kind"], r["log"]) for r in kept["rounds"]] == [("start", "")]
                assert kept["spent_s"] > 0.0


def test_the_table_stands_when_whoever_investigates_is_killed_and_the_motion_is_made_again(tmp_path: Path) -> None:
    """After kill -9 its acquisition ends by itself; one that somebody looks at still is ended by who goes on."""
    folder = tmp_path / "unit"
    with started(command_line("virtual", "--controller", "127.0.0.1:0")) as virtual:
        assert virtual.stdout is not None
        port, url = (virtual.stdout.readline().strip() for _ in range(2))
        begin = ["--port", port, "--controller", url, "--hours", "1", "-o", str(folder), "--yes-move"]
        resume = ["--resume", "-o", str(folder), "--yes-move"]
        name = investigate._name_of(folder)
        with contextlib.closing(connect(url)) as controller:
            with started(command_line("investigate", *begin)) as process:
                wait_until(lambda: controller.read().mode != "off", pause=0.1)
                process.kill()
            wait_until(lambda: controller.read().mode == "off" and name not in client.running(), pause=0.1)
            with started(command_line("investigate", *resume)) as process:
                wait_until(lambda: controller.read().mode != "off", pause=0.1)
                viewer = client.attach(name)
                process.kill()
            with contextlib.closing(viewer), started(command_line("investigate", *resume)) as process:
                assert process.stderr is not None
                assert "it is ended" in process.stderr.readline()
                assert "hold positions" in process.stderr.readline()
                wait_until(lambda: controller.read().mode != "off", pause=0.1)
                process.send_signal(signal.SIGINT)
                process.communicate(timeout=LIMIT_S)
            assert controller.read().mode == "off"


@pytest.mark.parametrize("rounds", [0, 1, 30])
def test_the_page_fits_a_small_terminal(rounds: int) -> None:
    """80 columns and 24 rows have all of it, however many motions there were and however long the reason is."""
    of = diary(*(entry(k, motion="long " * 30, came="said " * 40) for k in range(1, rounds + 1)))
    lines = list(page(of, "why it is made " * 40, "TABLE MOVES  " + "123.45 " * 20, 1800.0, 80))
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80
    assert any("Esc" in line for line in lines)
    assert any("30 of 120 min left" in line for line in lines)


def test_the_page_has_odds_of_what_is_still_possible() -> None:
    """By channel, the likelier name first, in words."""
    (line,) = [line for line in page(diary(entry(1)), "", "", 0.0, 80) if line.startswith("  gz")]
    assert line.index("scale factor is off 420:1") < line.index("cubic nonlinearity 7.5:1")


def test_the_end_says_what_it_would_take() -> None:
    """Time, result and what lacks are told."""
    of = diary(entry(1), outcome="not_here", takes=["gz: another power-on"])
    assert list(ended(of, "The sentence."))[1:] == ["The sentence.", "gz: another power-on"]


def test_the_report_ends_with_the_diary() -> None:
    """Why each motion, what was expected, what came; a trace that nobody planned has no such section."""
    of_trace: Any = whole_document()
    assert "Diary" not in [section.title for section in trace_report.article(of_trace).sections]
    of = diary(entry(1), entry(2, expected_bits=0.0), outcome="time", takes=["gz: more time"])
    last = trace_report.article(of_trace | {"diary": of}).sections[-1]
    assert last.title == "Diary"
    (table,) = [block for block in last.blocks if isinstance(block, Table)]
    assert [row[4] for row in table.rows] == ["1.2", ""]
    assert all(r["why"] in row and r["came"] in row for r, row in zip(of["rounds"], table.rows, strict=True))

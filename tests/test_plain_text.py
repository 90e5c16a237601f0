"""Text from outside at every way out of the program: nothing in it acts on a terminal, a page or a file."""

import ast
import json
import os
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from helpers import traces
from helpers.commands import imutui
from helpers.fake_client import FakeClient
from helpers.logs import START, recorded
from helpers.paths import ROOT
from helpers.pilot import shows, text_of
from helpers.shapes import whole
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer

from filters.tracing.trace_document import RunEntry, TraceDocument
from imutui import toml_text
from imutui.jobs.info import brief
from imutui.jobs.linear_correction import Term
from imutui.jobs.page_data import LogData
from imutui.logbook import SessionInfo, reader, schemas
from imutui.logbook.session_info import METADATA
from imutui.plain_text import NAME_LIMIT, NOTE_LIMIT, in_line, masked, one_line, quoted, visible
from imutui.report import page
from imutui.session.plan import Plan, RecordingWish
from imutui.tui.app import ImutuiApp

ACTING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]")
"""What must reach no terminal, page or file for people."""
NASTY = "\x1b[31mred\x1b]0;title\x07 \x9b2J \u202eeslaf\u2066 [red]x[/red] <b>&\"' $\\frac$ \x7f\x00end\r\nanother line"
NAME = "log\x1b[2J\u202e$x$[b].mcap"


def hostile_log(path: Path) -> Path:
    """A log with such a text wherever another program can have put one: metadata, events, topics, attachments."""
    source = recorded(path.with_name("source.mcap"))
    session = SessionInfo(rate_hz=20, kind="simulated").strings()
    for field in ("note", "operator", "place", "table", "firmware", "instrument", "source", "port", "host", "software"):
        session[field] = NASTY
    log = reader.read(source, raw=False)
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library=NASTY)
        writer.add_metadata(METADATA, session)
        writer.add_metadata("imutui.recovered", {"source": NASTY, "lost": NASTY})
        writer.add_attachment(0, 0, NASTY, "text/plain", b"x")
        writer.add_attachment(0, 0, "summary.json", "application/json", json.dumps({"alarms": [NASTY]}).encode())
        numbers = {}
        for topic in (schemas.IMU, schemas.EVENTS, f"/{NASTY}"):
            typename = schemas.TYPES.get(topic, NASTY)
            text = schemas.definition(typename).encode() if topic in schemas.TYPES else b""
            numbers[topic] = writer.register_channel(topic, "cdr", writer.register_schema(typename, "ros2msg", text))
        for stamp, gyro, accel in zip(log.samples.stamp_ns.tolist(), log.samples.gyro, log.samples.accel, strict=True):
            writer.add_message(numbers[schemas.IMU], stamp, schemas.encode_imus(stamp, gyro, accel)[0], stamp)
        event = schemas.encode_event(START, "mark", NASTY.replace("\x00", ""))
        writer.add_message(numbers[schemas.EVENTS], START, event, START)
        writer.finish()
    return path


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return hostile_log(tmp_path / NAME)


@given(st.text(st.characters(codec=None, categories=None)))
def test_nothing_visible_acts(text: str) -> None:
    shown = visible(text)
    assert not ACTING.search(shown)
    assert visible(shown) == shown
    assert shown.count("\n") == text.count("\n")
    assert "\n" not in in_line(text)
    assert len(masked(text)) == len(text) - sum(len(run) - 1 for run in re.findall("[\t\n\r]+", text))
    shown.encode()


@given(st.text(st.characters(codec=None, categories=None)))
def test_quoted_text_is_toml_and_reads_back(text: str) -> None:
    """But for halves of pairs, which TOML cannot hold; and the file itself acts on no terminal that shows it."""
    line = f"x = {quoted(text)}"
    assert not ACTING.search(line)
    if not re.search("[\ud800-\udfff]", text):
        assert tomllib.loads(line)["x"] == text


def test_what_people_write_stays_as_it_is() -> None:
    for text in ("0.5 °/√h – ±3 σ", "Größe", "水平台 で", "שלום", "👩‍🔬 at work", "C:\\x"):
        assert visible(text) == text
        assert one_line(text, NOTE_LIMIT) == text


def test_text_is_cleaned_and_cut_on_the_way_in() -> None:
    for record in (RecordingWish(note=NASTY, operator="a" * 5000), Plan("virtual", note=NASTY, operator="a" * 5000)):
        assert not ACTING.search(record.note)
        assert "\n" not in record.note
        assert len(record.operator) == NAME_LIMIT
    assert len(Plan("virtual", note="n" * 10**6).note) == NOTE_LIMIT
    formats = (ROOT / "docs/formats.md").read_text()
    assert f" {NOTE_LIMIT:,} ".replace(",", " ") in formats
    assert f" {NAME_LIMIT} " in formats


def test_the_configuration_in_a_log_is_toml_whatever_was_typed() -> None:
    """Signs beyond the basic plane too, which JSON's escapes would have spoilt."""
    plan = Plan("virtual", note="👩‍🔬 " + NASTY, virtual=("--x", NASTY))
    read = tomllib.loads(plan.configuration())
    assert read["note"] == plan.note
    assert read["virtual"] == ["--x", NASTY]
    assert tomllib.loads(f"x = {toml_text.value(NASTY)}") == {"x": NASTY}


@pytest.mark.parametrize("command", ["info", "check", "recover", "replay"])
def test_commands_over_a_hostile_log_print_nothing_that_acts(command: str, log: Path, tmp_path: Path) -> None:
    more = ("-o", str(tmp_path / f"out{NAME}")) if command == "recover" else ()
    done = imutui(command, log, *more, check=None)
    assert done.returncode in (0, 1)
    assert not ACTING.search(done.stdout + done.stderr)
    assert NAME.replace("\x1b", r"\x1b").replace("\u202e", r"\u202e") in "".join(done.stdout.split("\n"))


def test_json_holds_the_data_itself(log: Path) -> None:
    told = imutui("info", "--json", log).stdout
    assert not ACTING.search(told)
    assert json.loads(told)["note"] == NASTY


def test_a_refusal_that_quotes_a_name_prints_nothing_that_acts(tmp_path: Path) -> None:
    name = os.fsdecode(b"\xff\x9b2J\x1b[31m.mcap")
    assert r"\xff\x9b2J\x1b[31m.mcap" in imutui("info", tmp_path / name, check=3).stderr
    assert len(imutui("replay", "--set", f"filter.{'x' * 10**6}=1", tmp_path / "a", check=2).stderr) < 5000


def test_a_name_of_several_lines_says_none_of_its_own(log: Path, tmp_path: Path) -> None:
    """What `check` finds of it would stand beside a line that the name made up."""
    bad = log.rename(tmp_path / "bad\nfine: safe.mcap")
    said = imutui("check", bad, check=2)
    assert "fine" not in said.stdout
    assert "has a line break in it. Rename it" in said.stderr
    assert len(said.stderr.splitlines()) == 1


def test_a_list_of_logs_shows_nothing_that_acts(log: Path) -> None:
    shown = brief(log)
    assert not ACTING.search(shown.name + shown.note + shown.operator + shown.instrument)
    assert r"\x1b[31mred" in shown.note


def test_a_page_shows_nothing_that_acts(tmp_path: Path) -> None:
    curve = {"t_s": [1.0, 2.0], "y": [0.0, 1.0], "run": [NASTY, NASTY]}
    common = {
        "kind": "event", "label": NASTY, "channels": ["ax", "ay"], "coherence": 0.9, "t_start_s": 1.0,
        "t_end_s": 2.0, "curve": curve, "unit": "mg", "run": NASTY, "p": 1e-9, "record": [],
        "sizes": [{"channel": "ax", "value": 2.75, "sd": 0.1, "unit": "mg"}],
    }  # fmt: skip
    named = dict.fromkeys(("instrument", "serial_number", "operator", "table", "place", "note", "firmware"), NASTY)
    run = whole(
        RunEntry, id=NASTY, kind="simulated", rate_hz=20.0, seconds=900.0, reference="level", log=NASTY, source=NASTY,
        log_sha256=NASTY, start_utc=NASTY, identity=named,
    )  # fmt: skip
    error: Any = {**traces.document()["error"][0], "channel": NASTY, "unit": NASTY}
    document: Any = whole(TraceDocument, traces.document()) | {
        "runs": [run],
        "notes": [NASTY],
        "library": NASTY,
        "common": [common],
    }
    made = document | {"findings": [], "error": [error], "source": f"trace of {NASTY}"}
    log = LogData(effects=NASTY, missing=(NASTY,), terms=(Term((), NASTY, "", "", 1.0),))
    page.write(tmp_path, [page.Story(made, log)])
    text = (tmp_path / page.INDEX).read_text()
    assert not ACTING.search(text)
    assert "<b>" not in text
    assert len((tmp_path / "common_1.csv").read_text().splitlines()) == 3


async def test_the_screen_obeys_no_text_from_outside(tmp_path: Path, home: Path) -> None:
    client = FakeClient()
    client.changes |= {"note": NASTY, "operator": NASTY, "instrument": NASTY, "port": NASTY, "logs": str(home / "logs")}
    client.changes["events"] = [{"utc": "10:00:00", "name": NASTY, "text": NASTY}]
    (home / "logs").mkdir()
    hostile_log(home / "logs" / NAME)
    app = ImutuiApp(client)  # type: ignore[arg-type]
    async with app.run_test(size=(140, 40)) as pilot:
        await shows(pilot, "SIMULATED")
        for key in "136":
            await pilot.press(key)
            await pilot.pause(0.05)
            assert not ACTING.search(text_of(app).replace("\n", ""))
        await shows(pilot, r"log\x1b[2J\u202e$x$[b]")


def test_every_command_prints_through_the_gate() -> None:
    wrong = []
    for path in sorted((ROOT / "imutui/cli").glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
                inside = [ast.unparse(a.func) for a in node.args if isinstance(a, ast.Call)]
                if path.name != "exit_codes.py" and inside != ["dumps"]:
                    wrong.append(f"{path.name}:{node.lineno}")
    assert not wrong

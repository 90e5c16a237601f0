"""Text at every width: no word alone on a paragraph's last line, no number that touches what stands before it."""

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import pytest
from helpers import traces
from helpers.fake_client import FakeClient, acquisition, bias, estimates
from helpers.pilot import opened
from helpers.shapes import whole

from imutui.logbook.results import ResultDocument
from imutui.report import plain, trace_tables, wrapping
from imutui.report.blocks import Table
from imutui.tui.connection.model import ConnectionModel
from imutui.tui.pages.base import PAGES
from imutui.tui.pages.connect.text import ZERO_TEXT
from imutui.tui.pages.dialogs.help import HELP
from imutui.tui.pages.filter.text import explanation
from imutui.tui.pages.logs import text as logs_text
from imutui.tui.pages.record import text as record_text

_GLUED = re.compile(r"[a-z]{2,}[-+]?\d+\.\d|\d\.\d+[-+]\d|\d\.\d+\.\d|[a-z)]\d+\.\d+ ")


def orphans(text: str, width: int) -> Iterator[str]:
    """Last lines of one short word in paragraphs whose line before could have given it company."""
    lines = text.splitlines()
    for before, line in pairwise(lines):
        alone = len(line.split()) == 1 and len(line.strip()) < 10 and line.startswith(" ") >= before.startswith(" ")
        if alone and len(before.split()) >= 3 and len(f"{before} {line.strip()}") > width:
            yield f"{before}\n{line}"


def why() -> str:
    """What `w` says of a filter with long alarms."""
    model = ConnectionModel()
    client = FakeClient()
    alarm = "ax: the readings and the reference do not belong together; look at mounting, sign and level of the table"
    client.changes["filter"] = estimates(alarms=[alarm, f"{alarm} again"])
    model.take(client.snapshot())
    return explanation(model.view())


def test_no_paragraph_of_a_dialog_ends_in_a_word_alone() -> None:
    texts = [wrapping.joined(HELP), why(), ZERO_TEXT, logs_text.NOTE_HINT, logs_text.RENAME_HINT]
    texts.append(logs_text.deletion("a.mcap", ["a.mcap.sha256", "a_trace.json", "a_effects.toml"], 323_000))
    for text in texts:
        for width in range(44, 200):
            made = wrapping.reflowed(text, width)
            assert max(map(len, made.splitlines())) <= width
            assert list(orphans(made, width)) == []
            assert made.split() == text.split()


def test_no_sentence_of_a_trace_ends_in_a_word_alone() -> None:
    document = traces.of_two_runs(runs=[{**traces.RUN, "seconds": 90.0}])
    made = trace_tables.sections(document, trace_tables.TERMINAL)
    said = [replace(s, blocks=tuple(b for b in s.blocks if not isinstance(b, Table))) for s in made]
    for width in range(56, 200, 3):
        assert list(orphans(plain.text(said, width), width)) == []


def test_text_in_columns_goes_on_under_its_column() -> None:
    told = wrapping.joined("  r        start a recording; r again\n           finishes the file\n  m        a mark")
    assert told == "  r        start a recording; r again finishes the file\n  m        a mark"
    assert wrapping.reflowed(told, 34).splitlines()[:3] == [
        "  r        start a recording; r",
        "           again finishes the file",
        "  m        a mark",
    ]


def test_biases_of_a_finished_file_stand_apart_from_their_names() -> None:
    final = {"gyro_bias_dps": [-3.16, 0.0, 0.0], "accel_bias_mg": [-3.16, 0.0, 0.0]}
    rows = record_text.finished(None, whole(ResultDocument, final=final, converged=True))
    assert [name for name, _ in rows if len(name) > 8] == []
    assert rows[-1] == ("accel", "bias -3.16 0.00 0.00 mg")


@pytest.mark.parametrize("size", [(80, 24), (120, 40)])
async def test_no_number_runs_into_what_stands_before_it(size: tuple[int, int]) -> None:
    client = acquisition(recording=True)
    rows = [bias(f"{axis} gyro", -3.1612, 12.9, change_10s=-10.0011) for axis in "xyz"]
    rows += [bias(f"{axis} accel", -1234.56, 123.4, change_10s=-100.02) for axis in "xyz"]
    client.changes["filter"] = found = estimates(rows)
    found["final"] |= {"position_deg_m": [-23.2, -145.8, -641.2], "velocity_mps": [-25.663, -125.6, -2.5],
                       "rpy_deg": [-179.999, -89.999, -179.999]}  # fmt: skip
    async with opened(client, size=size) as see:
        await see("→ REC")
        for key, name in PAGES:
            await see(f"{key} →")
            await see.until(lambda name=name: see.app.page is not None and name == see.app.page.TITLE)  # type: ignore[misc]
            await see.pilot.pause(0.05)
            assert [line for line in see.text().splitlines() if _GLUED.search(line)] == []

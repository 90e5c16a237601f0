"""`imutui report`, and what it says where it cannot draw."""

import json
import os
import re
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import batches, traces
from helpers.commands import Done, imutui
from helpers.paths import ROOT
from helpers.traces import REPLAY

from filters.types import Array
from imutui import declared
from imutui.cli import installed_from
from imutui.jobs.campaign import batch
from imutui.jobs.replay import replay
from imutui.logbook import added_notes
from imutui.logbook.reading import Reading
from imutui.report import figures, page
from imutui.report.html import STYLE


def report(*arguments: str | Path, check: int = 0) -> Done:
    return imutui("report", *arguments, check=check)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are empty, and no browser is here: what is around them is looked at."""
    monkeypatch.setattr(figures, "available", lambda: True)
    monkeypatch.setattr(figures, "file", lambda figure, kind: b"")
    monkeypatch.setattr(figures, "picture", lambda panel, label, prefix: "<svg></svg>")
    monkeypatch.setattr(page, "browser", lambda: None)


def test_results_of_both_kinds_make_one_page(home: Path, undrawn: None) -> None:
    (home / "trace.json").write_text(json.dumps({**traces.whole_document(), "curves": []}))
    done = report("trace.json", REPLAY, "-o", "page", "--json")
    text = (home / "page" / "index.html").read_text()
    assert text.count("<article") == 2
    assert "<h1>2 results</h1>" in text
    names = {path.name for path in (home / "page").iterdir()}
    assert {"1-error.svg", "2-biases.png", "2-imu.yaml"} <= names
    assert len(json.loads((home / "page" / "result.json").read_text())) == 2
    assert set(json.loads(done.stdout)["files"]) == names
    assert "/data/sample.mcap is not there: biases and NIS over time" in done.stderr
    assert "no PDF: it takes chromium or chrome" in done.stderr
    report(REPLAY, "-o", "page", check=2)
    report(REPLAY, "-o", "page", "--force")
    assert not (home / "page" / "1-error.svg").exists()
    for name, content, why in (
        ("absent.json", None, "No such file"),
        ("list.json", "[]", "no result in it"),
        ("other.json", '{"version": 1, "units": {}}', "is missing"),
        ("newer.json", json.dumps({**json.loads(REPLAY.read_text()), "version": 2}), "its version is 2, not 1"),
        ("effects.json", json.dumps({**traces.whole_document(), "effects_file": "version = 9"}), "effects_file"),
    ):
        if content is not None:
            (home / name).write_text(content)
        assert why in report(name, "-o", "other", check=3).stderr
    assert not (home / "other").exists()


def test_a_log_at_hand_gives_its_page_what_the_result_has_not(home: Path, undrawn: None) -> None:
    log = home / "sample.mcap"
    log.write_bytes((ROOT / "logs" / "sample.mcap").read_bytes())
    added_notes.add(log, note="on the oven", operator="ben")
    asked = Reading(start=2.0, end=22.0, overrides={"filter": "ekf"})
    (home / "r.json").write_text(json.dumps(replay(log, asked)))
    report("r.json", "-o", "page")
    names = {path.name for path in (home / "page").iterdir()}
    assert {"convergence.svg", "nis.png", "allan.svg", "residual.svg"} <= names
    text = (home / "page" / "index.html").read_text()
    assert "<dt>Operator</dt><dd>ben (added later)</dd>" in text
    assert "sample.mcap: on the oven (added later)" in text
    assert "start 2 s, end 22 s, filter ekf" in text
    assert "Left out of this page" not in text
    log.write_bytes(log.read_bytes() + b"x")
    assert "its SHA-256 differs" in report("r.json", "-o", "page", "--force").stderr
    assert not (home / "page" / "convergence.svg").exists()


def test_a_page_is_printed_where_a_browser_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if page.browser() is None:
        pytest.skip("no chromium here: apt-get install chromium")
    (tmp_path / "index.html").write_text(f"<!doctype html><style>{STYLE}</style><p>one page")
    page.print_page(tmp_path / "index.html", tmp_path / "report.pdf")
    content = (tmp_path / "report.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    box = re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", content)
    assert box is not None
    assert [round(float(side) / 72.0 * 25.4) for side in box.groups()] == [210, 297]
    monkeypatch.setattr(page, "browser", lambda: "/bin/false")
    with pytest.raises(page.PrintError, match="false"):
        page.print_page(tmp_path / "index.html", tmp_path / "other.pdf")
    assert {path.name for path in tmp_path.iterdir()} == {"index.html", "report.pdf"}


def test_without_matplotlib_it_is_said_what_to_type(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "available", lambda: False)
    said = report("absent.json", "-o", "page", check=2).stderr
    assert "\n    " in said
    assert "pip install" in said
    assert "absent.json" not in said


class Installed:
    """A distribution as `importlib.metadata` gives it."""

    requires = ("rich>=14", 'matplotlib>=3.10; extra == "report"', "mkdocs>=1.6; extra == 'docs'")

    def __init__(self, origin: dict[str, Any] | None) -> None:
        self._origin = origin

    def read_text(self, name: str) -> str | None:
        assert name == "direct_url.json"
        return None if self._origin is None else json.dumps(self._origin)


def test_an_extra_is_installed_from_where_the_program_came(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = home / "a folder"
    source.mkdir()
    url = source.as_uri()
    cases: list[tuple[dict[str, Any] | None, str]] = [
        ({"url": url, "dir_info": {}}, f"'{source}[report]'"),
        ({"url": url, "dir_info": {"editable": True}}, f"-e '{source}[report]'"),
        ({"url": "file:///no/such/folder", "dir_info": {}}, "'matplotlib>=3.10'"),
        ({"url": "https://x.org/i.git", "vcs_info": {"vcs": "git", "commit_id": "1f"}},
         "'imutui[report] @ git+https://x.org/i.git@1f'"),
        ({"url": "https://x.org/i.whl", "archive_info": {}}, "'imutui[report] @ https://x.org/i.whl'"),
        (None, "'imutui[report]'"),
    ]  # fmt: skip
    for origin, what in cases:
        monkeypatch.setattr(metadata, "distribution", lambda name, origin=origin: Installed(origin))
        assert installed_from.command_for("report") == f"{sys.executable} -m pip install {what}"


def test_a_batch_on_one_page_names_the_bad_unit_and_what_is_the_tables(home: Path, undrawn: None) -> None:
    """The folder has rows for a campaign's summary too, and is taken by `imutui collect`."""

    def step(t: Array) -> Array:
        return batches.along(3, 0.12 * (t > 60.0))

    def bad(t: Array) -> Array:
        return batches.along(1, np.full(t.size, np.deg2rad(-2.5)))

    (home / "logs").mkdir()
    batches.batch(home / "logs", common=step, own={1: bad})
    os.mkfifo(home / "logs" / "x.mcap")  # a pipe among the logs is named, and not waited for
    done = report("--batch", "B7", "-o", "b7", check=1)
    assert "x.mcap: is a pipe, not a file" in " ".join(done.stderr.split())
    assert max(map(len, done.stdout.splitlines())) <= 80
    words = " ".join(done.stdout.split())
    assert "Batch B7: 0 of 4 units pass" in words
    assert "U2 FAIL Bias of gy -" in words
    assert "U1 table RED: ax 10 s means" in words
    assert "Step at 2026-11-21T10:31:00.000Z and stays, in all units: fx 1" in words
    assert "It is the table's, its supply's or the room's, no unit's" in words
    page_text = (home / "b7" / "index.html").read_text()
    assert '<a href="U2/index.html">U2/index.html</a>' in page_text
    assert "<dd>U2</dd>" in (home / "b7" / "U2" / "index.html").read_text()
    document = json.loads((home / "b7" / "batch.json").read_text())
    assert declared.problem(document, batch.BatchDocument, "batch") == ""
    assert [unit["outcome"] for unit in document["units"]] == ["fail", "table", "table", "table"]
    assert "Unit U2 FAILS: bias of gy" in imutui("campaign", "--summary", "b7").stdout
    imutui("collect", "b7", "-o", "all", check=1)
    assert {row["batch"] for row in json.loads((home / "all" / "results.json").read_text())["rows"]} == {"B7"}
    assert "There are logs of: B7." in report("--batch", "B8", "-o", "b8", check=3).stderr
    report("-o", "none", check=2)
    assert "b7 has files that would be replaced, and stays as it is: batch.json, index.html. --force" in " ".join(
        report("--batch", "B7", "-o", "b7", check=2).stderr.split()
    )
    for name in ("batch.json", "index.html"):
        (home / "b7" / name).unlink()
    assert "b7/U1 has files" in report("--batch", "B7", "-o", "b7", check=2).stderr


def test_a_report_is_refused_before_any_work_where_a_file_would_be_replaced(home: Path, undrawn: None) -> None:
    for name in ("imu.yaml", "allan.png", "effects.toml", "experiment.toml", "2-common_1.csv", "photo.png"):
        (home / name).write_text("mine")
    said = report("absent.json", "-o", home, check=2).stderr
    assert "2-common_1.csv, allan.png, effects.toml, experiment.toml, imu.yaml. --force replaces them" in said
    assert "photo" not in said
    said = imutui("trace", "absent.mcap", "--report", home, check=2).stderr
    assert "imu.yaml. --force replaces them, or name another folder with --report" in said
    done = report(REPLAY, "-o", home, "--force")
    assert f"{home}: replaced: imu.yaml" in done.stderr
    assert {(home / name).read_text() for name in ("allan.png", "effects.toml", "photo.png")} == {"mine"}
    (home / "results").mkdir()
    (home / "results" / "chart-1.svg").write_text("mine")
    said = imutui("campaign", "--summary", "absent", "--report", "results", check=2).stderr
    assert "results has files that would be replaced, and stays as it is: chart-1.svg" in said

"""`imutui report`, and what it says where it cannot draw."""

import json
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from helpers import traces

from imutui import cli
from imutui.cli import installed_from
from imutui.report import figures

REPLAY = Path(traces.__file__).with_name("replay_result.json")


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["imutui", "report", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


def test_results_of_both_kinds_make_one_page(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With contents; not over another one unless forced."""
    pytest.importorskip("matplotlib")
    (home / "trace.json").write_text(json.dumps({**traces.whole_document(), "curves": []}))
    assert run(monkeypatch, "trace.json", REPLAY, "-o", "page") == 0
    text = (home / "page" / "index.html").read_text()
    assert text.count("<article") == 2
    assert "<h1>2 results</h1>" in text
    assert "was made by an older imutui" in text
    assert {"1-error.svg", "2-biases.png"} <= {path.name for path in (home / "page").iterdir()}
    assert len(json.loads((home / "page" / "result.json").read_text())) == 2
    assert "is not there" in capsys.readouterr().err
    assert run(monkeypatch, REPLAY, "-o", "page") == 2
    assert run(monkeypatch, "absent.json", "-o", "other") == 3
    assert not (home / "other").exists()


def test_without_matplotlib_it_is_said_what_to_type(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before anything is read."""
    monkeypatch.setattr(figures, "available", lambda: False)
    assert run(monkeypatch, "absent.json", "-o", "page") == 2
    said = capsys.readouterr().err
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
    """By the pip of the running environment; from a folder that is gone, what the extra needs."""
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

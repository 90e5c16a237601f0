"""Files of results: what is taken, what is refused and in which words, what a log adds."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers import traces
from helpers.paths import SAMPLE
from helpers.traces import REPLAY

from imutui.jobs import result_files
from imutui.logbook import reader
from imutui.logbook.reader import UnreadableLogError


def written(folder: Path, content: object) -> Path:
    path = folder / "result.json"
    path.write_text(json.dumps(content))
    return path


def test_results_are_taken_one_or_many(tmp_path: Path) -> None:
    replay, trace = json.loads(REPLAY.read_text()), traces.whole_document()
    assert result_files.read(REPLAY) == [replay]
    assert result_files.read(written(tmp_path, trace)) == [trace]
    assert len(result_files.read(written(tmp_path, [replay, replay]))) == 2


CHANGES: dict[str, tuple[Callable[[Any], object], str]] = {
    "list": (lambda d: [], "has no result"),
    "text": (lambda d: "imutui", "not an object"),
    "runs": (lambda d: {**d, "runs": []}, "`result.runs` is empty"),
    "seconds": (
        lambda d: {**d, "runs": [{**d["runs"][0], "seconds": "60"}]},
        "result, runs 1: `seconds` is '60', not a finite number",
    ),
    "status": (lambda d: {**d, "status": {"gx": "fine"}}, "result, status: `gx` is 'fine', not one of: "),
    "ends": (
        lambda d: {**d, "error": [{**d["error"][0], "ci95": [1.0]}]},
        "result, error 1: `ci95` is [1.0], not a list of 2",
    ),
    "huge": (
        lambda d: {**d, "error": [{**d["error"][0], "before": 1e300}]},
        "result, error 1: `before` is 1e+300, not a number of plausible size",
    ),
    "lack": (lambda d: {key: value for key, value in d.items() if key != "weak"}, "result: `weak` is missing"),
    "other": (lambda d: {"name": "x"}, "it states no version"),
}


@pytest.mark.parametrize("case", CHANGES)
def test_what_is_no_result_is_refused_with_the_place(tmp_path: Path, case: str) -> None:
    change, said = CHANGES[case]
    with pytest.raises(UnreadableLogError) as told:
        result_files.read(written(tmp_path, change(traces.whole_document())))
    assert said in str(told.value)
    assert "`imutui trace " in str(told.value)


@pytest.mark.parametrize("version", [0, 2, None, True, "1"])
def test_a_result_of_another_version_is_refused_with_the_command_that_makes_it_anew(
    tmp_path: Path, version: object
) -> None:
    replay, trace = json.loads(REPLAY.read_text()), traces.whole_document()
    for document, anew in (
        (replay, "imutui replay /data/sample.mcap --json"),
        (trace, "imutui trace /data/a.mcap /data/b.mcap --json"),
    ):
        said = "its version is" if version is not None else "it states no version"
        with pytest.raises(UnreadableLogError, match=said) as told:
            result_files.read(written(tmp_path, {**document, "version": version}))
        assert str(told.value).endswith(f"`{anew}` makes it anew.")


def test_a_log_says_when_and_how_warm_only_if_it_is_the_one(tmp_path: Path) -> None:
    log = tmp_path / "a.mcap"
    shutil.copy(SAMPLE, log)
    (bare,) = result_files.read(REPLAY)
    result = {**bare, "log": str(log), "log_sha256": reader.sha256(log)}
    (known,), notes = result_files.completed([result])
    assert known["start_utc"].startswith("20")
    assert len(known["temperature_degc"]) == 2
    assert notes == []
    for changed, said in (({"log_sha256": "0" * 64}, "not the file"), ({"log": str(tmp_path / "b")}, "is not there")):
        (same,), (note,) = result_files.completed([{**result, **changed}])
        assert same["start_utc"] is None
        assert said in note

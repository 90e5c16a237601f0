"""What a campaign computes and what it keeps, shards and how they are joined; rows by this very process."""

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import pytest
from helpers import many_logs
from helpers.many_logs import here, rows_of

from filters.errors import InputError
from imutui import defects
from imutui.jobs import replay
from imutui.jobs.campaign import cluster, log_list, one_log, stored_rows
from imutui.jobs.campaign.collect import collect
from imutui.jobs.campaign.log_list import LogList, Shard
from imutui.jobs.campaign.one_log import Settings
from imutui.jobs.campaign.run import Campaign, RunDocument, run
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.reading import Reading


@pytest.fixture
def few(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two logs, and one that is none, in the folder `logs` of the working folder."""
    monkeypatch.chdir(tmp_path)
    for seed in range(2):
        many_logs.still(tmp_path / "logs" / "deep" / f"{seed}.mcap", seed)
    (tmp_path / "logs" / "bad.mcap").write_bytes(b"no log")
    return tmp_path


def ran(*arguments: str, results: str = "results", **options: Any) -> RunDocument:
    """A campaign over what the arguments name, `logs` if nothing."""
    overrides = options.pop("overrides", {})
    settings = Settings(Reading(overrides=overrides), options.pop("trace", False))
    head = stored_rows.head_of(Path(results))
    logs = log_list.find(arguments or ["logs"])
    return run(Campaign(logs if head is None else logs.below(head["root"]), settings, Path(results), **options), here)


def counts(**options: Any) -> tuple[int, int, int, int]:
    """How many rows were computed and kept, how many of these were touched, and how many have an error."""
    told = ran(**options)
    return told["computed"], told["kept"], told["unchanged"], told["errors"]


def test_only_what_changed_is_computed_anew(few: Path) -> None:
    assert counts() == (3, 0, 0, 1)
    assert counts() == (0, 3, 0, 1)
    assert counts(retry=True) == (1, 2, 0, 1)
    before = rows_of(few / "results")
    os.utime(few / "logs" / "deep" / "0.mcap")
    many_logs.still(few / "logs" / "deep" / "1.mcap", 7)
    many_logs.still(few / "logs" / "bad.mcap", 8)
    assert counts() == (2, 1, 1, 0)
    after = rows_of(few / "results")
    assert [a == b for a, b in zip(before, after, strict=True)] == [False, True, False]
    assert counts(again=True) == (3, 0, 0, 0)
    assert rows_of(few / "results") == after


def test_other_settings_are_other_rows(few: Path) -> None:
    ran()
    before = rows_of(few / "results")
    told = ran(overrides={"measurements": "drawn"})
    assert (told["computed"], told["other_settings"]) == (3, 0)
    drawn = rows_of(few / "results")
    assert [a["final"] == b["final"] for a, b in zip(before, drawn, strict=True)] == [True, False, False]
    assert counts() == (0, 3, 0, 1)
    assert rows_of(few / "results") == before
    assert ran("logs/deep", overrides={"filter": "spkf-paper"})["other_settings"] == 1


def test_the_root_is_that_of_the_first_run(few: Path) -> None:
    """Rows of logs that are not asked for stay; logs above the root have no name below it, and are refused."""
    ran()
    told = ran("logs/deep/*.mcap")
    assert (told["logs"], told["computed"], told["beyond"]) == (2, 0, 1)
    many_logs.still(few / "above.mcap", 3)
    with pytest.raises(ValueError, match="name another folder with -o"):
        ran(str(few))


def test_results_do_without_their_journal(few: Path) -> None:
    ran()
    rows = rows_of(few / "results")
    (few / "results" / "rows.jsonl").unlink()
    assert collect([few / "results"], few / "all", 0o640)["logs"] == 3
    assert counts() == (0, 3, 0, 1)
    assert rows_of(few / "results") == rows_of(few / "all") == rows
    (few / "results" / "rows.jsonl").unlink()
    (few / "results" / "results.json").write_text('{"rows": [1]}')
    with pytest.raises(UnreadableLogError, match="is no result of a campaign"):
        ran()


def test_a_trace_of_each_log_is_in_its_row(few: Path) -> None:
    told = ran(trace=True)
    assert (told["errors"], told["not_fine"]) == (1, 2)
    row = rows_of(few / "results")[-1]
    assert row["error"] is None
    assert row["findings"] is None
    assert "in less than 20 means" in row["trace_error"]


def test_a_log_that_vanishes_is_tried_again(few: Path) -> None:
    """What only a machine lacks is no property of the log."""
    ran()
    logs = LogList(str(few / "logs"), ("deep/0.mcap", "gone.mcap"))
    for _ in range(2):
        told = run(Campaign(logs, Settings(), Path("results")), here)
        assert (told["computed"], told["errors"]) == (1, 1)
        assert "is not there on" in told["first_errors"][0]


def test_four_shards_joined_are_the_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pyarrow import parquet

    monkeypatch.chdir(tmp_path)
    many_logs.two_hundred(tmp_path / "logs")
    told = [ran(results=f"part{k}", shard=Shard(k, 4)) for k in range(1, 5)]
    assert sum(one["logs"] for one in told) == 200
    assert min(one["logs"] for one in told) > 30
    ran()
    parts = [Path(f"part{k}") for k in range(1, 5)]
    lacking = collect([parts[0], *parts[2:]], Path("lacking"), 0o640)
    assert not lacking["complete"]
    assert lacking["notes"] == ["no part is of shard 2/4"]
    done = collect(parts, Path("all"), 0o640)
    assert (done["logs"], done["errors"], done["twice"], done["notes"]) == (200, 3, 0, [])
    expected = rows_of(Path("results"))
    assert rows_of(Path("all")) == expected
    table = parquet.read_table("all/results.parquet").to_pylist()
    assert [row["log"] for row in table] == [row["log"] for row in expected]
    row, own = table[-1], expected[-1]
    assert [row[f"final_gyro_bias_dps_{axis}"] for axis in "xyz"] == own["final"]["gyro_bias_dps"]
    assert (row["verdict_word"], row["nis_band95_low"]) == (own["verdict"]["word"], own["nis"]["band95"][0])


def test_parts_that_do_not_agree_are_refused_or_told(few: Path) -> None:
    ran()
    ran(results="other", overrides={"filter": "spkf-paper"})
    with pytest.raises(ValueError, match=r'overrides \{\} and \{"filter": "spkf-paper"\}'):
        collect([Path("results"), Path("other")], Path("all"), 0o640)
    many_logs.still(few / "logs" / "deep" / "0.mcap", 9)
    ran(results="later")
    for order in (["results", "later"], ["later", "results"]):
        told = collect([Path(name) for name in order], Path(f"all of {order[0]}"), 0o640)
        assert told["twice"] == 3
        assert "1 log has rows that differ" in told["notes"][0]
        assert rows_of(Path(f"all of {order[0]}")) == rows_of(Path("later"))


def test_patterns_folders_and_files_name_logs(few: Path) -> None:
    (few / "logs" / ".hidden").mkdir()
    (few / "logs" / ".hidden" / "x.mcap").touch()
    (few / "logs" / "notes.txt").touch()
    all_of_them = ("bad.mcap", "deep/0.mcap", "deep/1.mcap")
    assert log_list.find(["logs"]) == LogList(str(few / "logs"), all_of_them)
    assert log_list.find([f"{few}/lo*/**/*.mcap"]) == LogList(str(few), tuple(f"logs/{log}" for log in all_of_them))
    assert log_list.find(["logs/deep", "logs/bad.mcap"]) == LogList(str(few / "logs"), all_of_them)
    for nothing in ("none", "none/*.mcap"):
        with pytest.raises(UnreadableLogError, match="no such file or folder"):
            log_list.find([nothing])
    (few / "bare").mkdir()
    with pytest.raises(UnreadableLogError, match="there is no log"):
        log_list.find(["bare"])


@pytest.mark.parametrize("text", ["0/4", "5/4", "4", "1/0", "a/b", "-1/4"])
def test_a_shard_is_counted_from_one(text: str) -> None:
    with pytest.raises(ValueError, match="such as 1/4"):
        log_list.parse_shard(text)


def test_a_row_is_small_and_holds_no_samples(few: Path) -> None:
    """It is what travels from workers and what a million of lie in one file."""
    ran()
    assert all(len(json.dumps(row)) < 4000 for row in rows_of(few / "results"))
    assert dataclasses.asdict(Shard(1, 2)) == {"number": 1, "of": 2}


@pytest.mark.parametrize(
    ("there", "told"),
    [
        ({}, ""),
        ({"numpy": "1.0"}, "has numpy 1.0, and here it is"),
        ({"numba": None}, "has no numba"),
        ({"python": "3.4.1.final.0"}, "has python 3.4, and here it is"),
    ],
)
def test_a_worker_with_other_versions_is_told_by_name(there: dict[str, str | None], told: str) -> None:
    """Its numbers might be others; of Python the last number makes none."""

    class Client:
        """A cluster of one worker."""

        def get_versions(self, packages: list[str]) -> dict[str, Any]:
            """As dask tells them."""
            assert packages == ["imutui", "numba"]
            own = {**one_log.versions(), "python": f"{'.'.join(one_log.versions()['python'].split('.')[:2])}.0.final.0"}
            return {"workers": {"tcp://there:1": {"packages": {**own, **there}}}}

    if not told:
        cluster._check_versions(Client())  # type: ignore[arg-type]
        return
    with pytest.raises(cluster.ClusterError, match=f"the worker tcp://there:1 {told}"):
        cluster._check_versions(Client())  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", [InputError, ValueError])
def test_a_row_says_whether_its_log_or_imutui_is_at_fault(
    few: Path, monkeypatch: pytest.MonkeyPatch, kind: type
) -> None:
    """A campaign goes on over both; what a million rows say of a defect leads to one report, with the first log."""

    def replayed(path: Path, *_: object) -> None:
        raise kind(f"{path.name} is bent")

    monkeypatch.setattr(replay, "replayed", replayed)
    monkeypatch.setattr(defects, "_reports", {})
    monkeypatch.setattr("tempfile.tempdir", str(few))
    ran()
    said = [row["error"] for row in rows_of(Path("results")) if row["log"] != "bad.mcap"]
    assert len(said) == 2
    assert all("is bent" in error for error in said)
    assert all(error.startswith("a defect of imutui, ") == (kind is ValueError) for error in said)
    reports = {error.partition("Attach ")[2].partition(",")[0] for error in said}
    assert len(reports) == 1
    assert kind is InputError or "log: " in Path(*reports).read_text()

"""Campaigns over 200 short logs: every way gives the same rows; what is killed, interrupted or changed costs little."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from helpers import many_logs
from helpers.commands import imutui, imutui_json
from helpers.many_logs import rows_of
from helpers.processes import LIMIT_S, command_line, started, wait_until
from helpers.shared import once

from imutui.cli import campaign
from imutui.jobs.campaign.run import Pace

BAD = ["corrupt.mcap", "empty.mcap", "foreign.mcap"]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """200 logs, three of which are none."""

    def make(folder: Path) -> None:
        many_logs.two_hundred(folder / "logs")

    return once(tmp_path_factory, "campaign_logs", make) / "logs"


@pytest.fixture(scope="module")
def expected(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Rows of a campaign that nothing befell, by two processes."""

    def make(folder: Path) -> None:
        told = imutui_json("campaign", logs, "-o", folder / "plain", "--workers", "2", check=1)
        assert (told["logs"], told["computed"], told["kept"], told["errors"]) == (200, 200, 0, 3)

    return rows_of(once(tmp_path_factory, "campaign_rows", make) / "plain")


@pytest.mark.parametrize(
    ("errors", "not_fine", "said"),
    [
        (0, 0, "200 logs, all fine"),
        (3, 0, "200 logs, 3 with an error"),
        (0, 1200, "200 logs, 1,200 not converged, RED or damaged"),
        (3, 4, "200 logs, 3 with an error, 4 not converged, RED or damaged"),
    ],
)
def test_what_is_not_as_it_should_be_is_counted_in_the_first_line(errors: int, not_fine: int, said: str) -> None:
    assert campaign.counted(200, errors, not_fine) == said


def test_on_a_terminal_a_campaign_is_shown_in_place_until_it_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", screen)
    show, pace = campaign._progress(), Pace(3)
    show(pace)
    assert "0 of 3 logs, workers start" in screen.getvalue()
    pace.done = 3
    show(pace)
    assert screen.getvalue().endswith("\r\x1b[K")
    assert "\n" not in screen.getvalue()


def test_in_a_file_a_campaign_says_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not one a log: a night's campaign has thousands."""
    monkeypatch.setattr(sys, "stderr", StringIO())
    monkeypatch.setattr(Pace, "per_second", lambda pace: 1.0)
    show, pace = campaign._progress(), Pace(9)
    for pace.done in range(1, 5):
        show(pace)
    assert sys.stderr.getvalue() == ""
    monkeypatch.setattr(campaign, "_SPARSE_S", 0.0)
    show(pace)
    assert sys.stderr.getvalue() == "imutui: 4 of 9 logs, 60 a minute, 5 s left\n"


def lines(results: Path) -> int:
    """How many rows are in the journal."""
    journal = results / "rows.jsonl"
    return journal.read_bytes().count(b'{"log":') if journal.exists() else 0


def workers_of(parent: int) -> list[int]:
    """Processes that a campaign has started to compute rows."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            is_child = int(status.read_text().rsplit(")", 1)[1].split()[1]) == parent
            if is_child and b"spawn_main" in status.with_name("cmdline").read_bytes():
                found.append(int(status.parent.name))
        except (OSError, IndexError):
            continue
    return found


def test_a_bad_log_is_a_row_with_its_error(expected: list[dict[str, Any]]) -> None:
    assert len(expected) == 200
    assert [row["log"] for row in expected if row["error"]] == BAD
    for row in expected:
        assert (row["final"] is None) == (row["log"] in BAD), row["log"]
        assert not row["retry"]
    assert "is empty" in next(row["error"] for row in expected if row["log"] == "empty.mcap")


def test_a_row_is_what_a_replay_tells(logs: Path, expected: list[dict[str, Any]]) -> None:
    row = expected[-1]
    own = imutui_json("replay", logs / row["log"], check=None)
    for key in ("final", "sd", "spread", "converged_s", "log_sha256", "config_sha256", "samples", "alarms", "kind"):
        assert row[key] == own[key], key
    assert row["serial_number"] == own["identity"]["serial_number"]
    assert row["temperature_degc"] == {"mean": 20.0, "min": 20.0, "max": 20.0} or row["temperature_degc"]["min"] >= 20.0
    assert row["start_utc"].startswith("2026-")


def test_an_interrupted_campaign_goes_on_where_it_was(
    logs: Path, expected: list[dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    results = tmp_path / "results"
    line = command_line("campaign", str(logs), "-o", "results", "--workers", "2")
    with started(line, start_new_session=True) as run:
        wait_until(lambda: lines(results) >= 20, LIMIT_S)
        # held, or it could be done before another one has begun
        os.killpg(run.pid, signal.SIGSTOP)
        refused = imutui("campaign", logs, "-o", "results", check=2)
        os.killpg(run.pid, signal.SIGINT)
        os.killpg(run.pid, signal.SIGCONT)
        _, err = run.communicate(timeout=LIMIT_S)
    assert "another campaign is writing" in refused.stderr
    assert run.returncode == 130, err
    assert "Traceback" not in err
    made = json.loads((results / "results.json").read_text())
    assert f"{len(made['rows'])} rows are kept in results; the same command goes on from there" in err
    assert 20 <= len(made["rows"]) < 200
    assert not made["complete"]
    # what a cut in the middle of a line leaves
    with (results / "rows.jsonl").open("a") as stream:
        stream.write('{"log": "half')
    told = imutui_json("campaign", logs, "-o", "results", check=1)
    assert (told["kept"], told["computed"], told["broken_lines"]) == (len(made["rows"]), 200 - len(made["rows"]), 1)
    assert rows_of(results) == expected
    assert lines(results) == 201


def test_a_killed_worker_costs_only_the_log_that_it_was_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is tried once more by another process; one that kills that too is a row with an error, tried again later."""
    monkeypatch.chdir(tmp_path)
    for seed in range(4):
        many_logs.still(tmp_path / "logs" / f"{seed}.mcap", seed)
    # no log, and its checksum takes minutes: the file is large, and takes no room on the disk
    with (tmp_path / "logs" / "stuck.mcap").open("wb") as stream:
        stream.truncate(1 << 38)
    with started(command_line("campaign", "logs", "-o", "results", "--workers", "1", "--json")) as run:
        killed: set[int] = set()
        for _ in range(2):
            wait_until(lambda: lines(tmp_path / "results") >= 4 and bool({*workers_of(run.pid)} - killed), LIMIT_S)
            for pid in workers_of(run.pid):
                os.kill(pid, signal.SIGKILL)
                killed.add(pid)
        out, _ = run.communicate(timeout=LIMIT_S)
    assert run.returncode == 1
    told = json.loads(out)
    assert (told["logs"], told["errors"]) == (5, 1)
    assert "killed" in told["first_errors"][0]
    (tmp_path / "logs" / "stuck.mcap").unlink()
    many_logs.still(tmp_path / "logs" / "stuck.mcap", 9)
    told = imutui_json("campaign", "logs", "-o", "results", check=1)
    assert (told["kept"], told["computed"], told["errors"]) == (4, 1, 0)


@pytest.fixture
def scheduler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, list["subprocess.Popen[str]"]]]:
    """Address of a scheduler of dask's on loopback, and two workers of its."""
    # so long it tries to fetch rows from a worker that is dead, half a minute by default
    monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT", "2s")
    place = tmp_path / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "dask"]
    options = ["--no-dashboard", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(place)]
    with ExitStack() as stack:
        stack.enter_context(started([*dask, "scheduler", *options], **quiet))
        wait_until(place.exists, LIMIT_S)
        address = json.loads(place.read_text())["address"]
        line = [*dask, "worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        line += ["--local-directory", str(tmp_path / "dask")]
        yield address, [stack.enter_context(started(line, **quiet)) for _ in range(2)]


def test_a_cluster_gives_the_same_rows_though_a_worker_is_killed(
    logs: Path, expected: list[dict[str, Any]], tmp_path: Path, scheduler: tuple[str, list["subprocess.Popen[str]"]]
) -> None:
    address, workers = scheduler
    results = tmp_path / "results"
    with started(command_line("campaign", str(logs), "-o", str(results), "--cluster", address, "--json")) as run:
        wait_until(lambda: lines(results) >= 20, LIMIT_S)
        workers[0].kill()
        out, err = run.communicate(timeout=LIMIT_S)
    assert run.returncode == 1, err
    assert json.loads(out)["errors"] == 3
    assert rows_of(results) == expected


def test_a_scheduler_that_does_not_answer_is_told_with_what_to_do(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from imutui.jobs.campaign import cluster

    monkeypatch.setattr(cluster, "_CONNECT_S", 0.2)
    done = imutui("campaign", logs, "-o", tmp_path / "r", "--cluster", "tcp://127.0.0.1:9", check=4)
    assert "dask scheduler" in done.stderr
    wrong = imutui("campaign", logs, "-o", tmp_path / "r", "--cluster", "here", check=2)
    assert "tcp://host:8786" in wrong.stderr

import os
import signal
import sys
from pathlib import Path

import pytest
from helpers import jobs_for_workers as jobs
from helpers import processes
from helpers.processes import wait_until

from imutui.jobs.worker import Worker


def ended(worker: Worker) -> Worker:
    assert worker.wait(60.0)
    return worker


def started(*job: object) -> Worker:
    worker = Worker(*job)  # type: ignore[arg-type]
    worker.start()
    return worker


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def test_a_job_tells_its_progress_and_gives_its_result() -> None:
    worker = Worker(jobs.add, 2, 3)
    assert worker.state == "waiting"
    worker.start()
    ended(worker)
    assert (worker.state, worker.result, worker.failure) == ("done", 5, None)
    assert [text for _, text in worker.poll()] == ["step 0", "step 1", "step 2"]
    assert worker.poll() == []


def test_a_result_larger_than_a_pipe_comes_whole() -> None:
    assert ended(started(jobs.large, 3_000_000)).result == bytes(3_000_000)


def test_progress_that_nobody_reads_holds_up_no_job() -> None:
    worker = ended(started(jobs.chatty, 3000))
    assert worker.result == 3000
    assert 0 < len(worker.poll()) <= 256


def test_an_error_comes_as_words() -> None:
    refused = ended(started(jobs.wrong)).failure
    assert refused == ("InputError", "`x` is 3; it must be positive")
    assert ended(started(jobs.wordless)).failure == ("MemoryError", "MemoryError")
    absent = ended(started(jobs.missing, Path("/nowhere/at all"))).failure
    assert absent == ("FileNotFoundError", "/nowhere/at all: No such file or directory")
    assert ended(started(jobs.unpicklable)).state == "failed"


def test_a_defect_comes_as_one_with_its_report() -> None:
    failure = ended(started(jobs.broken)).failure
    assert failure is not None
    assert failure.kind == "Defect"
    assert failure.text.startswith("a defect of imutui, and not of what it was given: ValueError: zero-size array")
    report = Path(failure.text.split("Attach ")[1].split(",")[0])
    assert "in broken" in report.read_text()
    report.unlink()


@pytest.mark.parametrize(
    ("job", "kind", "word"), [((jobs.leaves, 3), "Crashed", "code 3"), ((jobs.is_killed,), "Killed", "memory")]
)
def test_a_process_that_dies_is_a_failure_in_words(job: tuple[object, ...], kind: str, word: str) -> None:
    failure = ended(started(*job)).failure
    assert failure is not None
    assert failure.kind == kind
    assert word in failure.text


def test_a_cancelled_job_cleans_up_and_is_gone(tmp_path: Path) -> None:
    worker = started(jobs.patient, tmp_path)
    wait_until((tmp_path / "pid").exists)
    assert worker.state == "running"
    assert (tmp_path / "result.part").exists()
    worker.cancel()
    ended(worker)
    assert worker.state == "cancelled"
    assert not (tmp_path / "result.part").exists()
    assert not alive(int((tmp_path / "pid").read_text()))


def test_a_job_that_does_not_listen_is_ended_all_the_same(tmp_path: Path) -> None:
    worker = started(jobs.stubborn, tmp_path)
    wait_until(lambda: bool(worker.poll()))
    worker.cancel()
    assert ended(worker).state == "cancelled"


def test_a_worker_ends_when_whoever_started_it_is_killed(tmp_path: Path) -> None:
    """A dead screen leaves no job behind, and the job cleans up."""
    script = (
        "import signal, sys; from pathlib import Path; from helpers import jobs_for_workers as jobs\n"
        "from imutui.jobs.worker import Worker\n"
        f"Worker(jobs.patient, Path({str(tmp_path)!r})).start(); signal.pause()"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with processes.started([sys.executable, "-c", script], env=environment) as parent:
        wait_until((tmp_path / "pid").exists)
        pid = int((tmp_path / "pid").read_text())
        assert alive(pid)
        parent.send_signal(signal.SIGKILL)
        parent.wait(processes.LIMIT_S)
    wait_until(lambda: not alive(pid))
    wait_until(lambda: not (tmp_path / "result.part").exists())

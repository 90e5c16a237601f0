"""One job in several processes: order, Ctrl+C, and a process that the kernel kills."""

import os
import signal
import sys
from pathlib import Path

import pytest
from helpers import jobs_for_workers as jobs
from helpers.processes import LIMIT_S, started, wait_until

from imutui.jobs.parallel import each, interrupts_held


def alive(group: int) -> bool:
    """Whether a process of that group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_results_come_in_the_order_of_the_items() -> None:
    assert list(each(jobs.doubled_late, range(5))) == [0, 2, 4, 6, 8]


def test_a_killed_process_is_an_error_in_words() -> None:
    """Waiting for it would be for ever."""
    with pytest.raises(MemoryError, match="killed"):
        list(each(jobs.is_killed, [1, 2]))


def test_ctrl_c_while_a_process_is_started_is_not_lost() -> None:
    """It would leave somebody pressing it again, or a campaign going on to its end."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # nohup has it ignored
    try:
        with pytest.raises(KeyboardInterrupt), interrupts_held():
            os.kill(os.getpid(), signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def test_ctrl_c_ends_all_processes_and_only_the_first_says_so(tmp_path: Path) -> None:
    """A terminal sends it to the whole group."""
    marks = [tmp_path / "a", tmp_path / "b"]
    program = (
        f"import sys; sys.path += {sys.path!r}; from pathlib import Path\n"
        "from imutui.jobs.parallel import each\nfrom helpers import jobs_for_workers as jobs\n"
        f"try: list(each(jobs.begun, [Path(p) for p in {[str(p) for p in marks]!r}]))\n"
        "except KeyboardInterrupt: print('interrupted')\n"
    )
    with started([sys.executable, "-c", program], start_new_session=True) as run:
        wait_until(lambda: any(mark.exists() for mark in marks))
        os.killpg(run.pid, signal.SIGINT)
        out, err = run.communicate(timeout=LIMIT_S)
    assert out == "interrupted\n"
    assert err == ""
    wait_until(lambda: not alive(run.pid))


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGKILL, -9)])
def test_a_command_that_is_killed_leaves_no_process_behind(tmp_path: Path, number: signal.Signals, code: int) -> None:
    """A service manager, or `timeout`, ends the command alone, and not its group."""
    marks = [tmp_path / "a", tmp_path / "b"]
    program = (
        f"import sys; sys.path += {sys.path!r}; from pathlib import Path\n"
        "from imutui.jobs.parallel import each\nfrom helpers import jobs_for_workers as jobs\n"
        f"list(each(jobs.begun, [Path(p) for p in {[str(p) for p in marks]!r}]))\n"
    )
    with started([sys.executable, "-c", program], start_new_session=True) as run:
        wait_until(lambda: any(mark.exists() for mark in marks))
        os.kill(run.pid, number)
        run.wait(LIMIT_S)
        wait_until(lambda: not alive(run.pid))
        err = run.communicate()[1]
    assert run.returncode == code
    assert number == signal.SIGKILL or err == ""

"""One job in several processes: order, Ctrl+C, and a process that the kernel kills."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import wait_until

from imutui.jobs.parallel import each


def doubled_late(number: int) -> int:
    """Later ones are ready earlier."""
    time.sleep(0.2 / (1 + number))
    return 2 * number


def killed(number: int) -> int:
    """What happens when memory runs out."""
    os.kill(os.getpid(), signal.SIGKILL)
    return number


def begun(path: Path) -> None:
    """Say that this process runs, and stay."""
    path.touch()
    time.sleep(600.0)


def alive(group: int) -> bool:
    """Whether a process of that group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_results_come_in_the_order_of_the_items() -> None:
    """Whichever is ready first."""
    assert list(each(doubled_late, range(5))) == [0, 2, 4, 6, 8]


def test_a_killed_process_is_an_error_in_words() -> None:
    """Waiting for it would be for ever."""
    with pytest.raises(MemoryError, match="killed"):
        list(each(killed, [1, 2]))


def test_ctrl_c_ends_all_processes_and_only_the_first_says_so(tmp_path: Path) -> None:
    """A terminal sends it to the whole group."""
    marks = [tmp_path / "a", tmp_path / "b"]
    program = (
        f"import sys; sys.path += {sys.path!r}\n"
        "from pathlib import Path\nfrom test_parallel import begun\nfrom imutui.jobs.parallel import each\n"
        f"try: list(each(begun, [Path(p) for p in {[str(p) for p in marks]!r}]))\n"
        "except KeyboardInterrupt: print('interrupted')\n"
    )
    own = [sys.executable, "-c", program]
    with subprocess.Popen(
        own, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as run:
        wait_until(lambda: any(mark.exists() for mark in marks), timeout=60.0)
        os.killpg(run.pid, signal.SIGINT)
        out, err = run.communicate(timeout=60)
    assert out == "interrupted\n"
    assert err == ""
    wait_until(lambda: not alive(run.pid))

"""What tests share: where measured recordings lie, and acquisitions that cannot meet each other."""

import os

# threads of the linear algebra library only get in each other's way on 15×15 matrices; read when numpy is imported
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "logs" / "sample.mcap"
DATA = ROOT.parent / "shared" / "data"


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile once, before processes under test would all do so at the same time and miss their deadlines."""
    if not hasattr(session.config, "workerinput"):
        from filters.kalman import runner
        from imutui.logbook import reader

        runner.warm_up()
        reader.read(SAMPLE, raw=True)


@pytest.fixture
def recording() -> Callable[[str], Path]:
    """Path of a measured recording; skips the test where the folder of recordings is absent."""

    def find(name: str) -> Path:
        path = DATA / name
        if not path.exists():
            pytest.skip(f"measured recording {name} is not on this machine (../shared/data)")
        return path

    return find


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working folder with sockets, cache and configuration of its own; acquisitions left in it are ended."""
    runtime = tmp_path / "run"
    runtime.mkdir(mode=0o700)
    for name in ("cache", "config"):
        monkeypatch.setenv(f"XDG_{name.upper()}_HOME", str(tmp_path / name))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    for name in [name for name in os.environ if name.startswith("IMUTUI_")]:
        monkeypatch.delenv(name)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for lock in (runtime / "imutui").glob("*.lock"):
        end_owner(lock)


def end_owner(lock: Path) -> None:
    """Kill the process that holds a lock file, if one does, and wait until it is gone."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            holds = any(os.path.realpath(fd) == str(lock) for fd in (process / "fd").iterdir())
        except OSError:
            continue
        if holds and int(process.name) != os.getpid():
            os.kill(int(process.name), signal.SIGKILL)
            wait_until(lambda process=process: not process.exists() or _is_zombie(process))


def _is_zombie(process: Path) -> bool:
    try:
        return (process / "stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except OSError:
        return True


def wait_until(true: Callable[[], bool], timeout: float = 60.0) -> None:
    """Wait for a state of affairs; fails if it does not come."""
    deadline = time.monotonic() + timeout
    while not true():
        assert time.monotonic() < deadline, "it did not come"
        time.sleep(0.02)


def imutui(*arguments: str, check: int | None = 0, timeout: float = 120.0) -> "subprocess.CompletedProcess[str]":
    """Run a command of imutui; its exit code must be `check` unless that is None."""
    command = [sys.executable, "-m", "imutui", *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=timeout, stdin=subprocess.DEVNULL, check=False
    )
    if check is not None:
        assert done.returncode == check, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stderr
    return done

"""What tests share: where measured recordings lie, and acquisitions that cannot meet each other."""

import gc
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import hypothesis
import pytest
from helpers import environment
from helpers.paths import DATA, SAMPLE
from helpers.places import own_places
from helpers.processes import end_owner

COMPILE_FOR_EFFECTS = "from filters.kalman import runner; runner.warm_up(effects=True)"
TOLD = "told_of_compiling.txt"
"""In the folder of compiled code: what was told when it was compiled, for the test of that."""


environment.make()


def pytest_configure() -> None:
    """No example is wrong because a busy machine is slow."""
    slow = [hypothesis.HealthCheck.too_slow]
    hypothesis.settings.register_profile("busy", hypothesis.settings(), deadline=None, suppress_health_check=slow)
    hypothesis.settings.load_profile("busy")


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Two more than there are cores: a good part of the tests waits, for units, for processes, for the clock."""
    del config
    return (os.cpu_count() or 1) + 2


LONG = (
    *("undeclared", "test_trace_wire.py", "test_tmux.py", "remote", "test_snapshots.py", "test_dialogs.py"),
    *("test_personalities.py", "test_replies.py", "test_bad_devices.py", "test_driver.py"),
)
"""Folders and modules whose tests take longest, at work or waiting."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest first: at the end one worker would be at them alone."""
    items.sort(key=lambda item: not any(part in LONG for part in item.path.parts))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Tests and modules stay: looking through them for garbage again and again would take a fifth of their time."""
    del session
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 10, 3)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile once, before processes under test would all do so at the same time and miss their deadlines."""
    if not hasattr(session.config, "workerinput"):
        from filters.kalman import runner
        from imutui.logbook import reader

        # the step for states of effects beside it, on the other core
        other = subprocess.Popen([sys.executable, "-P", "-c", COMPILE_FOR_EFFECTS])
        told: list[str] = []
        runner.warm_up(told.append)
        reader.read(SAMPLE, raw=True)
        other.wait()
        if told:
            (Path(os.environ["NUMBA_CACHE_DIR"]) / TOLD).write_text("\n".join(told))


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
    runtime = own_places(monkeypatch, tmp_path)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for lock in (runtime / "imutui").glob("*.lock"):
        end_owner(lock)

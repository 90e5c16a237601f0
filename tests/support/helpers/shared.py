"""What takes long to make and several tests only read: made once, however many processes the tests run in."""

import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest


def once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """Folder of this run of the tests, filled by whoever needs it first; others wait meanwhile.

    `factory`: the fixture.
    `name`: of the folder.
    `make`: fills it. Whoever comes next tries again if it fails.
    """
    base = factory.getbasetemp()
    # a worker's own folder lies in that of the run
    root = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder, complete = root / name, root / f"{name}.complete"
    with (root / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not complete.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            make(folder)
            complete.touch()
    return folder

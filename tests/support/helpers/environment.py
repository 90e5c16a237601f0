"""The environment of the tests, and of every process that they start: made here, from nothing but what they need.

A terminal's size and kind, a language, settings of imutui and of Python, and whatever else somebody's shell exports
would change what is under test. A test that needs such a variable sets it itself.
"""

import atexit
import os
import shutil
import sys
import tempfile
from pathlib import Path

import platformdirs

_KEPT = {
    *("PATH", "HOME", "USER", "LOGNAME", "TMPDIR"),
    *("VIRTUAL_ENV", "PYTHONPATH", "LD_LIBRARY_PATH"),  # where an installation needs them
    *("NUMBA_CACHE_DIR", "NPM_READERS", "OPENIMU"),  # what CONTRIBUTING.md tells to set
    "CI",  # pytest and hypothesis look at it
}
_KEPT_PREFIXES = ("PYTEST_", "COV_CORE_", "COVERAGE_", "OPENBLAS_")
"""Of the test runner and its plug-ins; and what the linear algebra library is told of a machine's processor."""


def make() -> None:
    """Have this process's environment so, before numpy and numba are imported, which read it."""
    kept = {name: value for name, value in os.environ.items() if name in _KEPT or name.startswith(_KEPT_PREFIXES)}
    os.environ.clear()
    # readline, which pytest loads, puts the terminal's size where children find it and os.environ does not
    for name in ("COLUMNS", "LINES"):
        os.unsetenv(name)
    os.environ.update(kept)
    # threads of the linear algebra library only get in each other's way on 15×15 matrices
    os.environ.update({"LANG": "C.UTF-8", "SHELL": "/bin/sh", "OPENBLAS_NUM_THREADS": "1"})
    os.environ.setdefault("NUMBA_CACHE_DIR", str(_compiled()))
    os.environ.update(_temporary())
    # read before this: hundreds of processes would compile every module anew
    sys.dont_write_bytecode = False


def _temporary() -> dict[str, str]:
    """A folder for temporary files that goes with the tests: reports of defects that tests cause lie there.

    The folders that pytest itself makes stay where they were: their names must be short enough for sockets.
    """
    before = os.environ.get("PYTEST_DEBUG_TEMPROOT", tempfile.gettempdir())
    folder = tempfile.mkdtemp(prefix="imutui-tests-")
    tempfile.tempdir = folder
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return {"TMPDIR": folder, "PYTEST_DEBUG_TEMPROOT": before}


def _compiled() -> Path:
    """Folder of compiled code that outlives the tests: each of them has a cache folder of its own, new and empty."""
    folder = platformdirs.user_cache_path("imutui") / "tests"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # an account without a home
        folder = Path(tempfile.gettempdir()) / f"imutui-tests-{os.getuid()}"
    return folder

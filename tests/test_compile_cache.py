"""Where compiled code is kept."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from imutui import compile_cache

KEPT = """
import os, sys
{first}
import imutui
from filters.kalman.kernels import step
from filters.tracing import whitening
folders = {{whitening._whiten._cache.cache_path, step.advance._cache.cache_path}}
print(*sorted(folders), sep="\\n")
print(os.environ["NUMBA_CACHE_DIR"])
"""


def places(tmp_path: Path, first: str = "", **environment: str) -> list[str]:
    """Cache folders of a tracer's loop and of the filter's step, and what child processes are told."""
    mine = {name: value for name, value in os.environ.items() if name != compile_cache.VARIABLE}
    mine |= {"XDG_CACHE_HOME": str(tmp_path / "cache"), **environment}
    done = subprocess.run(
        [sys.executable, "-c", KEPT.format(first=first)], capture_output=True, text=True, check=True, env=mine
    )
    return done.stdout.splitlines()


@pytest.mark.parametrize("first", ["", "import numba"])
def test_compiled_code_lies_in_the_users_cache_folder(tmp_path: Path, first: str) -> None:
    """Of every module that compiles, whether or not somebody imported numba before; children are told the same."""
    *found, told = places(tmp_path, first)
    assert told == str(tmp_path / "cache" / "imutui" / "numba")
    assert len(found) == 2
    assert all(place.startswith(f"{told}{os.sep}") for place in found), found


def test_a_folder_that_the_user_chose_stays(tmp_path: Path) -> None:
    chosen = str(tmp_path / "chosen")
    *found, told = places(tmp_path, NUMBA_CACHE_DIR=chosen)
    assert told == chosen
    assert all(place.startswith(f"{chosen}{os.sep}") for place in found), found


HOMELESS = {"HOME": "/proc/nowhere", "NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator"}
"""An account that can write neither a home nor beside the sources; the kernel lets no user write there."""


def homeless(*words: str, **more: str) -> subprocess.CompletedProcess[str]:
    """Run this Python without a home, without a folder for compiled code and without a runtime folder."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "NUMBA_"))}
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, env=kept | HOMELESS | more)


def test_without_a_folder_that_can_be_written_functions_are_compiled_all_the_same() -> None:
    done = homeless("-c", "import imutui; from filters.tracing.whitening import _whiten as f; print(f.signatures)")
    assert (done.returncode, done.stdout) == (0, "[]\n"), done.stderr


@pytest.mark.parametrize("words", [("status",), ("devices",), ("config", "--show")])
def test_commands_work_without_a_home(words: tuple[str, ...], tmp_path: Path) -> None:
    done = homeless("-m", "imutui", *words, TMPDIR=str(tmp_path))
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


def test_an_account_without_an_entry_has_a_home_that_libraries_can_ask_for() -> None:
    code = "import os; os.path.expanduser = str; import imutui; print(os.environ['HOME'])"
    done = homeless("-c", code)
    assert done.stdout == "/nonexistent\n", done.stderr


def test_that_nothing_can_be_kept_is_said_with_a_command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(compile_cache.VARIABLE, str(tmp_path / "new" / "folder"))
    assert compile_cache.warning() == ""
    monkeypatch.setenv(compile_cache.VARIABLE, "/proc/nowhere/numba")
    assert "export NUMBA_CACHE_DIR=FOLDER" in compile_cache.warning()


def test_a_switched_off_compiler_is_named_with_the_cure() -> None:
    done = homeless("-m", "imutui", "profile", NUMBA_DISABLE_JIT="1")
    assert (done.returncode, done.stdout) == (2, "")
    assert "type `unset NUMBA_DISABLE_JIT`" in done.stderr


RELEASED = """
import re
from filters.kalman import runner
import numba
from imutui import compile_cache

def resident_kb():
    return int(re.search(r"VmRSS:\\s+(\\d+)", open("/proc/self/status").read())[1])

runner.warm_up(effects=False)
before = resident_kb()
compile_cache.release()
print(before - resident_kb())
runner.warm_up(effects=False)
print(numba.njit(lambda x: x * x)(3.0))
"""


def test_the_memory_of_the_compiler_is_given_back_and_it_still_compiles() -> None:
    """Some 70 MB of a process that has loaded the filter's step are pages of the compiler's library."""
    done = subprocess.run([sys.executable, "-c", RELEASED], capture_output=True, text=True, check=True)
    released_kb, squared = done.stdout.split()
    assert int(released_kb) > 30_000
    assert squared == "9.0"

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

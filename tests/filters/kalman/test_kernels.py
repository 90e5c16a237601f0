"""What holds of the compiled step apart from its mathematics: what it is kept for, and what is told of compiling it."""

import ast
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import filters.kalman.kernels
from filters.kalman.kernels import step

FOLDER = Path(filters.kalman.kernels.__file__).parent
COMPILING = """
from filters.kalman import runner
told = []
runner.warm_up(told.append)
print(told)
"""


def test_a_change_in_any_file_that_is_compiled_into_the_step_is_noticed() -> None:
    """Numba looks at the file of the step alone: all others that the kernels take anything from are in its digest."""
    names = {module.__name__ for module in step.SOURCES} | {step.__name__}
    for path in FOLDER.glob("*.py"):
        if path.stem == "__init__":
            continue
        assert f"{filters.kalman.kernels.__name__}.{path.stem}" in names
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("filters"):
                found = {str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)}
                assert found & (names | {"filters.types", "filters.compilation"}), (
                    f"{path.name} takes from {node.module}"
                )


def _told(place: Path) -> list[str]:
    """What was told when all was compiled: the tests' own first time (conftest.py), else in a place of its own."""
    own = Path(os.environ["NUMBA_CACHE_DIR"]) / "told_of_compiling.txt"
    changed = max(path.stat().st_mtime for path in FOLDER.glob("*.py"))
    if own.exists() and own.stat().st_mtime > changed:
        return own.read_text().splitlines()
    return _compile(os.environ | {"NUMBA_CACHE_DIR": str(place)})


def _compile(environment: Mapping[str, str]) -> list[str]:
    """What a process is told that compiles."""
    # -P: the package that is installed, and not the folder that the tests are run in
    command = [sys.executable, "-P", "-c", COMPILING]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return list(ast.literal_eval(done.stdout))


def test_compiling_is_told_part_by_part_and_done_once(tmp_path: Path) -> None:
    told = _told(tmp_path)
    assert len(told) > 10
    assert f"this machine: 1 of {len(told)} parts" in told[0]
    assert f"{len(told)} of {len(told)} parts" in told[-1]
    assert _compile(os.environ) == []

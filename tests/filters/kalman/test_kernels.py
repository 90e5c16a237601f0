"""What holds of the compiled step apart from its mathematics: what it is kept for, and what is told of compiling it."""

import ast
import os
import subprocess
import sys
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
        if path.stem in ("__init__", "progress"):
            continue
        assert f"{filters.kalman.kernels.__name__}.{path.stem}" in names
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("filters"):
                found = {str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)}
                assert found & (names | {"filters.types"}), f"{path.name} takes from {node.module}"


def test_compiling_is_told_part_by_part_and_done_once() -> None:
    """From the first part to the last the first time on a machine; the second time there is nothing to tell."""
    # the tests' own first time, which takes half a minute: see conftest.py
    told = (Path(os.environ["NUMBA_CACHE_DIR"]) / "told_of_compiling.txt").read_text().splitlines()
    assert len(told) > 10
    assert f"this machine: 1 of {len(told)} parts" in told[0]
    assert f"{len(told)} of {len(told)} parts" in told[-1]
    again = subprocess.run([sys.executable, "-P", "-c", COMPILING], capture_output=True, text=True, check=True)
    assert again.stdout == "[]\n"

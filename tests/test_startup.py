"""What commands load: those that filter nothing start at once."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

from helpers.paths import SAMPLE

PROGRAM = """
import contextlib, io, json, sys
from imutui.cli import main

loaded = {}
for arguments in json.loads(sys.argv[1]):
    sys.argv = ["imutui", *arguments]
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code
    heavy = {"numba", "llvmlite", "scipy", "textual", "matplotlib", "pandas"} & set(sys.modules)
    loaded[" ".join(arguments)] = [code, sorted(heavy), said.getvalue()]
print(json.dumps(loaded))
"""


def run(commands: list[list[str]]) -> dict[str, list[object]]:
    """Exit code, heavy libraries loaded by then, and words of commands that run in one process, one after the other."""
    command = [sys.executable, "-c", PROGRAM, json.dumps(commands)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL)
    loaded: dict[str, list[object]] = json.loads(done.stdout)
    return loaded


def test_commands_that_filter_nothing_load_neither_compiler_nor_solvers(home: Path) -> None:
    shutil.copy(SAMPLE, "whole.mcap")
    Path("cut.mcap").write_bytes(SAMPLE.read_bytes()[:200_000])
    Path("bad.mcap").write_bytes(b"no log")
    expected = {
        "--help": 0,
        "status": 0,
        "status --json": 0,
        "devices": 0,
        "devices --json": 0,
        "config --show": 0,
        "config --json": 0,
        "mark x": 4,
        "stop": 4,
        "info whole.mcap": 0,
        "info whole.mcap --json": 0,
        "info cut.mcap bad.mcap none.mcap": 3,
        "check whole.mcap": 0,
        "check cut.mcap --json": 1,
        "recover cut.mcap -o made.mcap": 0,
        "recover whole.mcap -o made.mcap --json": 2,
        "collect none -o all": 3,
    }
    found = run([command.split() for command in expected])
    assert {command: heavy for command, (_, heavy, _) in found.items()} == {command: [] for command in expected}
    codes = {command: (code, words) for command, (code, _, words) in found.items() if code != expected[command]}
    assert not codes


def test_what_was_loaded_is_not_looked_through_at_the_end() -> None:
    program = "import atexit, gc; atexit.register(lambda: print(len(gc.get_objects())))\n"
    program += "from imutui.cli import main\nimport sys; sys.argv = ['imutui', '--version']; main()"
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert int(said.split()[-1]) < 1000

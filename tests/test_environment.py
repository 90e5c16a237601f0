"""The tests find the same environment whoever runs them, in whatever terminal."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.paths import ROOT
from helpers.processes import LIMIT_S
from helpers.terminal import Terminal

HOSTILE = {
    "TERM": "tmux-256color",
    "TMUX": "/tmp/tmux-0/default,1,0",
    "NO_COLOR": "1",
    "FORCE_COLOR": "1",
    "LC_ALL": "C",
    "SSH_CONNECTION": "10.0.0.1 1 10.0.0.2 22",
    "XDG_CONFIG_HOME": "/etc",
    "IMUTUI_SCREEN_GLYPHS": "ascii",
    "PYTHONUNBUFFERED": "1",
}
LOOK = "import json, os; print(json.dumps([dict(os.environ), [os.isatty(fd) for fd in range(3)]]))"


def test_a_process_under_test_gets_nothing_of_the_shell_and_no_terminal() -> None:
    """Nor the size of a terminal: readline puts that into what children inherit, unseen by this process's Python."""
    done = subprocess.run([sys.executable, "-c", LOOK], capture_output=True, text=True, check=True)
    variables, terminals = json.loads(done.stdout)
    assert not variables.keys() & {"COLUMNS", "LINES", *HOSTILE}
    assert variables == dict(os.environ)
    assert variables["LANG"] == "C.UTF-8"
    assert not any(terminals)
    assert Path(variables["TMPDIR"]).name.startswith("imutui-tests-"), "temporary files go with the tests"


@pytest.mark.parametrize("workers", ["-n0", "-n1"])
def test_so_it_is_in_a_terminal_of_another_size_and_language(workers: str) -> None:
    this = f"{__file__}::{test_a_process_under_test_gets_nothing_of_the_shell_and_no_terminal.__name__}"
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", workers, this]
    terminal = Terminal(command, (150, 50), ROOT, controlling=True, **HOSTILE)
    try:
        terminal.read_until("1 passed in", timeout=LIMIT_S)
    finally:
        terminal.close()

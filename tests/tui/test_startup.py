"""What the first frame waits for."""

import subprocess
import sys

_PROGRAM = """
import sys
from imutui import config
from imutui.cli import attach
from imutui.cli.session_options import plan_from
from imutui.session import client
from imutui.tui import app
plan_from(config.load(), None, checked=False, port="virtual")
print(*sorted({"numba", "scipy", "mcap", "rosbags", "matplotlib", "serial"} & set(sys.modules)))
"""


def test_the_screen_loads_neither_filters_nor_logs() -> None:
    """Compilers, solvers, log readers and ports are loaded by whoever needs them: seconds before the first frame."""
    found = subprocess.run([sys.executable, "-c", _PROGRAM], capture_output=True, text=True, timeout=120, check=True)
    assert found.stdout.split() == []

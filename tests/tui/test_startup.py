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


_TEXT = (
    "formatting", "messages", "connection.model", "connection.poller", "connection.verdict",
    "pages.connect.text", "pages.record.text", "pages.table.text", "pages.logs.text", "pages.logs.result_text",
    "pages.logs.recordings", "pages.filter.text",
)  # fmt: skip
"""What says something, or judges, and shows nothing."""


def test_what_is_said_knows_no_widget() -> None:
    program = "import sys\n" + "".join(f"import imutui.tui.{name}\n" for name in _TEXT)
    program += "print(*sorted(name for name in sys.modules if name.partition('.')[0] == 'textual'))"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert found.stdout.split() == []


def test_pages_are_loaded_when_they_are_opened() -> None:
    program = "import sys, imutui.tui.app\nprint(*(n for n in sys.modules if n.startswith('imutui.tui.pages.')))"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not [name for name in found.stdout.split() if name.endswith(".page")]

"""What a user is told of a defect, which is no input's, and which exit code it has."""

import stat
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.commands import imutui
from helpers.paths import SAMPLE
from helpers.processes import LIMIT_S
from helpers.terminal import Terminal

from filters.errors import InputError
from imutui import cli, defects

NUMPY = "zero-size array to reduction operation minimum which has no identity"
TOLD = "a defect of imutui, and not of what it was given: "

INSIDE = {
    f"info {SAMPLE}": "imutui.logbook.scan.Scan.items",
    f"check {SAMPLE}": "imutui.logbook.scan.Scan.items",
    f"recover {SAMPLE} -o new.mcap": "imutui.logbook.scan.Scan.items",
    f"replay {SAMPLE}": "imutui.jobs.replay.motion_of",
    f"trace {SAMPLE}": "imutui.jobs.runs.read_run",
    f"export {SAMPLE} --format csv -o new.csv": "imutui.logbook.reader.records",
    "import readings.csv -o new.mcap": "imutui.logbook.importing.rows.check_order",
    "campaign . -o results": "imutui.jobs.campaign.log_list.find",
    "profile": "imutui.jobs.operator_steps.ready_made",
    "config --show": "imutui.config._file",
    "status": "imutui.session.ipc.names",
    "record --port virtual": "imutui.session.plan.settle",
}
"""Commands, and a function deep inside of what each does."""


def broken(*_: object, **__: object) -> Any:
    """numpy's own error, as a fault of ours has it."""
    return np.empty(0).min()


def report_of(said: str) -> Path:
    """The file that the sentence names."""
    return Path(said.split("Attach ")[1].split(",")[0])


@pytest.fixture(autouse=True)
def unreported(monkeypatch: pytest.MonkeyPatch, home: Path) -> None:
    """No defect is known yet in this process, and some readings lie in the working folder."""
    monkeypatch.setattr(defects, "_reports", {})
    monkeypatch.setenv("TMPDIR", str(home))
    monkeypatch.setattr("tempfile.tempdir", None)
    names = "t,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n"
    Path("readings.csv").write_text(names + "".join(f"{k / 20},0,0,0,0,0,-1\n" for k in range(40)))


@pytest.mark.parametrize("line", INSIDE)
def test_numpys_own_error_is_a_defect_of_any_command(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(INSIDE[line], broken)
    outcome = imutui(*line.split(" "), check=None)
    assert outcome.returncode == 1, outcome.stderr
    said = outcome.stderr.splitlines()[-1]
    assert said.startswith(f"imutui: {TOLD}ValueError: {NUMPY}. Attach ")
    assert said.endswith("to a report where imutui was obtained from. Recordings are not affected.")
    assert report_of(said).is_file()


def test_the_same_said_of_the_input_is_wrong_usage(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who raises an InputError has looked at what was given."""

    def refuse(*_: object) -> None:
        raise InputError(f"{SAMPLE}: {NUMPY}")

    monkeypatch.setattr("imutui.jobs.replay.motion_of", refuse)
    assert imutui("replay", SAMPLE, check=2).stderr == f"imutui: {SAMPLE}: {NUMPY}\n"


def test_a_report_has_what_is_needed_and_is_its_users_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imutui.jobs.replay.motion_of", broken)
    report = report_of(imutui("replay", SAMPLE, "--json", check=None).stderr)
    assert stat.S_IMODE(report.stat().st_mode) == 0o600
    text = report.read_text()
    assert f"imutui replay {SAMPLE} --json" in text
    assert f"numpy      {np.__version__}\n" in text
    for name in ("time", "imutui", "numba", "python", "platform"):
        assert f"\n{name}" in f"\n{text}"
    assert "in broken" in text.split("Traceback")[1]
    again = imutui("replay", SAMPLE, check=None).stderr
    assert report_of(again) == report, "the same defect is reported once"


def test_a_defect_that_cannot_be_written_down_is_told_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", "/nowhere")
    monkeypatch.setattr("imutui.jobs.replay.motion_of", broken)
    said = imutui("replay", SAMPLE, check=None).stderr
    assert said.startswith(f"imutui: {TOLD}ValueError: {NUMPY}. Its details could not be written (No such file or")


@pytest.mark.parametrize("place", ["imutui.tui.app.ImutuiApp.action_help", "imutui.tui.pages.connect.text.rates"])
def test_a_screen_that_meets_a_defect_leaves_the_terminal_as_it_was(home: Path, place: str) -> None:
    module, _, name = place.rpartition(".")
    script = (
        "import numpy, pkgutil; from imutui import cli\n"
        f"setattr(pkgutil.resolve_name({module!r}), {name!r}, lambda *_: numpy.empty(0).min())\n"
        "cli.main()"
    )
    terminal = Terminal([sys.executable, "-c", script], (100, 30), cwd=home)
    try:
        if name == "action_help":
            terminal.read_until("Connect")
            terminal.press(b"?")
        terminal.read_until_sent(b"\x1b[?1049l")  # the screen that was there before
        shown = " ".join(terminal.read_until(TOLD[:30], "Attach").split())
        assert terminal.process.wait(LIMIT_S) == 1
        assert f"{TOLD}ValueError: {NUMPY}" in shown
        assert "Traceback" not in shown
        assert terminal.modes_now() == terminal.modes
    finally:
        terminal.close()


def test_every_command_that_reads_is_looked_at() -> None:
    assert {line.split(" ")[0] for line in INSIDE} <= set(cli.COMMANDS)

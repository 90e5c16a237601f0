"""The whole job in a real terminal of 80×24: tmux drives the real program on the virtual instrument's wire."""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest
from helpers.processes import LIMIT_S, wait_until
from helpers.units import virtual
from unit_time import acquire

from imutui.logbook import reader
from imutui.session import client, plan
from imutui.session.plan import Plan

_LOOK_S = 0.15  # each look at the terminal is a process


class Terminal:
    """A tmux server of our own with one window of 80×24.

    `logs`: where recordings go that are begun in it.
    """

    def __init__(self, folder: Path) -> None:
        self.logs = folder / "logs"
        self._tmux = ["tmux", "-S", str(folder / "tmux"), "-f", "/dev/null"]
        fixed = ("start-server", ";", "set-option", "-g", "default-terminal", "tmux-256color", ";")
        self._run(*fixed, "new-session", "-d", "-x", "80", "-y", "24", "sh")
        self._run("set-option", "-g", "escape-time", "0")

    def _run(self, *arguments: str) -> str:
        line = [*self._tmux, *arguments]
        return subprocess.run(line, capture_output=True, text=True, timeout=LIMIT_S, check=True).stdout

    def type(self, text: str) -> None:
        """Type characters as they are."""
        self._run("send-keys", "-l", text)

    def press(self, *keys: str) -> None:
        """Press keys by name."""
        self._run("send-keys", *keys)

    def screen(self) -> str:
        """What the terminal shows."""
        return self._run("capture-pane", "-p")

    def see(self, key: str, *words: str) -> str:
        """Press a key by name, and wait until the screen shows all these words."""
        self.press(key)
        return self.wait_for(*words)

    def wait_for_any(self, *words: str) -> None:
        """Wait until the screen shows one of these words."""
        wait_until(lambda: any(word in self.screen() for word in words), pause=_LOOK_S)

    def wait_for(self, *words: str) -> str:
        """Wait until the screen shows all these words."""
        shown = ""

        def all_there() -> bool:
            nonlocal shown
            shown = self.screen()
            # a terminal breaks a line that is too long for it where it ends, in mid-word
            return all(word in shown or word in shown.replace("\n", "") for word in words)

        try:
            wait_until(all_there, pause=_LOOK_S)
        except AssertionError:
            pytest.fail(f"the screen never showed {words}:\n{shown}")
        return shown

    def close(self) -> None:
        """End the server and all in it."""
        subprocess.run([*self._tmux, "kill-server"], check=False, capture_output=True, timeout=LIMIT_S)


@pytest.fixture
def terminal(home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    """In a folder with a short path, wherever temporary files go.

    The address of tmux's socket may have 107 bytes, and a message that names a long path covers what is waited for.
    """
    if shutil.which("tmux") is None:
        pytest.skip("needs tmux")
    with tempfile.TemporaryDirectory(prefix="imutui", dir="/tmp") as folder:
        monkeypatch.chdir(folder)
        made = Terminal(Path(folder))
        try:
            yield made
        finally:
            made.close()
            monkeypatch.chdir(home)


def test_connect_record_mark_detach_attach_and_stop(home: Path, terminal: Terminal) -> None:
    program = f"{sys.executable} -m imutui"
    terminal.type(f"{program}\n")
    terminal.wait_for("virtual instrument", "rate, Hz", "press v for the DEMO")
    choose_virtual_at_20_hz(terminal)
    live = terminal.wait_for("SIMULATED", "gx", "deg/s", "asked 20", "not recording", "? help")
    assert all(len(line) <= 80 for line in live.splitlines())
    assert "K/min" in live or "its trend is known" in live

    terminal.see("r", "A note for this recording")
    terminal.see("Enter", "● REC", "imu400cd_9911750_", "flush")
    terminal.see("m", "Mark in the recording")
    terminal.type("table level")
    terminal.see("Enter", "marked: table level")
    terminal.see("4", "x gyro", "z accel", "Table 1 limit", "NIS", "no test", "pitch")

    terminal.see("d", "Come back: imutui attach", "imutui stop")
    assert client.running() == ["default"]
    terminal.type(f"clear; {program} attach\n")
    terminal.wait_for("● REC", "asked 20", "measured")
    terminal.see("?", "ON THE", "PAGE")
    terminal.press("Escape")
    # a key right behind Escape would be Alt and that key
    wait_until(lambda: "ON THE" not in terminal.screen(), pause=_LOOK_S)
    terminal.see("q", "leave it", "finish the file, stop", "cancel")
    terminal.see("s", "finished", "samples", "gyro bias")
    wait_until(lambda: client.running() == [])
    (path,) = terminal.logs.glob("*.mcap")
    log = reader.read(path)
    assert log.finished
    assert "table level" in [event.text for event in log.events if event.name == "mark"]
    assert log.info.rate_hz == 20.0


def choose_virtual_at_20_hz(terminal: Terminal) -> None:
    """On the Connect screen: the virtual instrument whatever ports there are, the rate field, Enter."""
    choose(terminal, "virtual, 133 Hz")
    for _ in range(3):
        terminal.press("Tab")
    terminal.press("C-a")
    terminal.see("C-k", "not a number; 0.1 to 133 Hz")
    terminal.type("20")
    terminal.wait_for("virtual, 20 Hz")
    terminal.press("Enter")


def chosen(terminal: Terminal) -> str:
    """On the Connect screen: what its button says it would do."""
    return next((line for line in terminal.screen().splitlines() if line.strip().startswith("Connect ")), "")


def choose(terminal: Terminal, wanted: str) -> None:
    """On the Connect screen: go down the list until this is what Enter would take."""
    wait_until(lambda: chosen(terminal).strip() not in ("", "Connect"), pause=_LOOK_S)
    for _ in range(10):
        before = chosen(terminal)
        if wanted in before:
            return
        terminal.press("Down")
        wait_until(lambda before=before: chosen(terminal) not in ("", before), pause=_LOOK_S)  # type: ignore[misc]
    pytest.fail(f"{wanted} is not in the list:\n{terminal.screen()}")


def test_the_demo_shows_itself_and_leaves_nothing_behind(home: Path, terminal: Terminal) -> None:
    terminal.type(f"{sys.executable} -m imutui demo --seed 3\n")
    terminal.wait_for("SIMULATED", "● REC", "gx", "asked 20")
    (pid,) = [client.attach("demo").pid]
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    terminal.see("q", "finish the file, stop")
    terminal.see("s", "finished")
    wait_until(lambda: client.running() == [] and not any(Path(f"/proc/{c}").exists() for c in children))
    assert len(list(terminal.logs.glob("*demo.mcap"))) == 1


def goes_on(connection: client.Client) -> None:
    """Wait for two more seconds of samples at 20 Hz."""
    before = connection.snapshot(2**62)["recording"]["samples"]
    wait_until(lambda: connection.snapshot(2**62)["recording"]["samples"] > before + 40)


def test_the_whole_job(home: Path, terminal: Terminal) -> None:
    terminal.type(f"{sys.executable} -m imutui\n")
    terminal.wait_for("not connected", "press v for the DEMO", "virtual instrument", "v demo", "? help", "q quit")
    terminal.see("v", "SIMULATED", "● REC", "gx", "asked 20")
    # a minute of the same unit, faster than real time, while the filter converges: what is shorter cannot be traced
    scenario, log = Path(plan.__file__).with_name("demo.toml"), terminal.logs / "minute.mcap"
    with ThreadPoolExecutor(1) as pool:
        minute = pool.submit(acquire, scenario, 0, log, 62.0)
        record_until_converged(terminal)
        minute.result()
    trace_and_load(terminal)
    path = next(terminal.logs.glob("*_demo.mcap"))
    finished = reader.read(path)
    assert finished.finished
    assert "table level" in [event.text for event in finished.events if event.name == "mark"]


def record_until_converged(terminal: Terminal) -> None:
    """Mark, look at the recording, wait for the filter, finish the file."""
    terminal.see("m", "Mark in the recording")
    terminal.type("table level")
    terminal.see("Enter", "marked: table level")
    terminal.see("3", "● RECORDING", "note      demo", "table level", "disk full in", "lost 0")
    terminal.see("4", "Table 1", "x gyro")
    terminal.wait_for_any("all 6 biases converged", "gy oscillates")  # the second comes soon after the first
    terminal.see("r", "not recording", "finished")
    terminal.see("3", "NOT RECORDING", "6 Logs opens it")


def choose_log(terminal: Terminal, detail: str) -> None:
    """Put the cursor on one of two recordings; which of them was written to last is not known."""
    if detail not in terminal.wait_for("· IMU400CD-200"):
        terminal.see("Down", detail)


def trace_and_load(terminal: Terminal) -> None:
    """Replay the new recording, trace the long one, load what it found, stop and quit."""
    terminal.see("6", "2 recordings, newest first", "_demo", "minute")
    choose_log(terminal, "_demo.mcap · IMU400CD-200")
    terminal.see("p", "replay of imu400cd", "converged:", "at 20.00 Hz, SIMULATED", "x gyro", "z accel", "Esc")
    terminal.see("PageDown", "NIS", "no test")
    terminal.see("Escape", "2 recordings")
    choose_log(terminal, "minute.mcap · IMU400CD-200")
    terminal.see("t", "trace of minute.mcap", "oscillation 0.1", "load")
    terminal.see("e", "loaded gy: oscillates: the filter began anew")
    connection = client.attach("demo")
    assert connection.snapshot(2**62)["effects"] == ["gy tone"]
    terminal.see("4", "oscillates", "Table 1")
    terminal.see("q", "stop the acquisition and quit", "cancel", "leave it")
    terminal.see("s", "the acquisition is stopped")
    wait_until(lambda: client.running() == [])


def test_several_acquisitions_are_to_be_chosen_from(home: Path, terminal: Terminal) -> None:
    with ExitStack() as units:
        for name in ("east", "west"):
            port, logs = units.enter_context(virtual()), str(terminal.logs)
            asked = Plan(port, rate_hz=20.0, name=name, logs=logs, filter="none")
            units.callback(client.start(asked).stop)
        terminal.type(f"{sys.executable} -m imutui\n")
        terminal.wait_for("Several acquisitions are running: choose one", '"east"', '"west"')
        choose(terminal, 'looks at the running acquisition "west"')
        terminal.see("Enter", "SIMULATED", "gx")
        terminal.see("1", 'acquisition "west"')

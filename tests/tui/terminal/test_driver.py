"""The application in a terminal of its own, as a process."""

import contextlib
import signal
import sys
from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from helpers.paths import ROOT
from helpers.terminal import Terminal

from imutui.tui.terminal import driver

_PROGRAM = """
import sys
from helpers.fake_client import FakeClient
from imutui.tui.app import run
sys.exit(run(FakeClient()))
"""
_PLAIN = """
from imutui.tui.terminal import textual_private
textual_private.HIDDEN |= {*textual_private.DRAWING, *textual_private.MEASURING, "_color_system"}
"""


@contextlib.contextmanager
def screen(before: str = "", **environ: str) -> Iterator[Terminal]:
    """The application on canned snapshots, in an 80×24 terminal, once it shows the Live page."""
    terminal = Terminal([sys.executable, "-c", before + _PROGRAM], cwd=ROOT / "tests" / "support", **environ)
    try:
        terminal.read_until("asked 20 measured")
        yield terminal
    finally:
        terminal.close()


def test_the_terminal_is_as_before_after_detaching() -> None:
    with screen(NO_COLOR="1") as terminal:
        terminal.press(b"d")
        terminal.read_until("Come back: imutui attach")
        assert terminal.process.wait(10.0) == 0
        assert terminal.raw.rindex(b"\x1b[?1049l") < terminal.raw.rindex(b"Come back")
        assert terminal.modes_now() == terminal.modes


def test_without_textuals_private_names_the_screen_is_drawn_plainly() -> None:
    with screen(_PLAIN) as terminal:
        terminal.press(b"4")
        terminal.read_until("x gyro")
        terminal.press(b"2")
        terminal.read_until("gx, deg/s")
        terminal.press(b"d")
        terminal.read_until("Come back: imutui attach")
        assert terminal.process.wait(10.0) == 0
        assert terminal.modes_now() == terminal.modes


def test_the_linux_console_gets_blocks_and_sixteen_colours() -> None:
    with screen(TERM="linux") as terminal:
        shown = terminal.shown()
        assert "SIMULATED" in shown
        assert "█" in shown
        assert not any("\u2800" < sign < "\u2900" for sign in shown)
        assert b"38;2;" not in terminal.raw
        assert b"38;5;" not in terminal.raw


def test_a_hangup_signal_ends_the_ui_in_order() -> None:
    with screen() as terminal:
        terminal.process.send_signal(signal.SIGHUP)
        assert terminal.process.wait(20.0) == 0
        assert terminal.modes_now() == terminal.modes


def test_a_frozen_terminal_neither_stops_the_ui_nor_is_sent_old_frames() -> None:
    with screen() as terminal:
        terminal.read_until("scroll, autoscale")
        terminal.press(b"\x1b[?2026;2$y")
        # how long it takes to fill what the kernel holds depends on how much is drawn
        for seconds in (4.0, 8.0, 16.0, 32.0):
            terminal.freeze(seconds)
            with contextlib.suppress(AssertionError):
                terminal.read_until("link is slow", timeout=5.0)
                break
        terminal.read_until("link is slow")
        terminal.press(b"d")
        terminal.read_until("Come back: imutui attach")
        assert terminal.process.wait(10.0) == 0


def test_an_answer_that_is_awaited_is_as_late_as_it_is_by_now(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(driver, "time", SimpleNamespace(monotonic=lambda: now))
    meter, late = driver.Meter(), []
    assert not meter.ask()  # nobody has ever answered
    meter.answered()
    for pause, do in ((9.0, meter.ask), (0.25, meter.answered), (9.0, meter.ask), (0.125, str), (1.375, str)):
        now += pause
        do()
        late.append(meter.load(0).round_trip_s)
    assert late == [None, 0.25, 0.25, 0.25, 1.5]

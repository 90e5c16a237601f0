"""Pictures of every page, compared with the ones that somebody has looked at.

    pytest tests/tui/test_snapshots.py --snapshot-update

makes them anew in `__snapshots__`, one SVG each: look at them before they are committed. A picture that is missing or
no longer made is a failure. What the pages show is fed to them by a clock that stands still, with a minute behind it.
"""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.fake_batch import Batch
from helpers.fake_client import FakeClient, estimates
from helpers.paths import SAMPLE
from helpers.pilot import text_of
from syrupy.assertion import SnapshotAssertion
from syrupy.extensions.single_file import SingleFileSnapshotExtension, WriteMode
from textual.pilot import Pilot
from textual.widgets import Input

from imutui.estimates import FilterSnapshot, live_biases
from imutui.session import client as session
from imutui.session.snapshot import Snapshot
from imutui.tui.app import ImutuiApp
from imutui.tui.terminal.appearance import Appearance

PORTS = [("/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A9-if00-port0", "FT232R USB UART"), ("/dev/ttyS0", "ttyS0")]
PAGES = {
    "live": (["2"], "asked 20"),
    "allan": (["w"], "averaged over"),
    "histogram": (["w", "w"], "Gaussian"),
    "connect": (["escape", "1"], "IMU400CD 1.2"),
    "record": (["3"], "flushed"),
    "filter": (["4"], "x gyro"),
    "table": (["5"], "makes testable"),
    "logs": (["6"], "sample.mcap"),
    "help": (["1", "question_mark"], "FIRST STEPS"),
    "quit": (["escape", "2", "q"], "cancel"),
}
"""Keys that lead to a page from the one before, and a text that is on it."""
LOOKS: dict[str, tuple[tuple[int, int], dict[str, str], str]] = {
    "80x24": ((80, 24), {}, ""),
    "120x40": ((120, 40), {}, ""),
    "200x60": ((200, 60), {}, ""),
    "80x24-no-color": ((80, 24), {"NO_COLOR": "1"}, ""),
    "80x24-light": ((80, 24), {}, "light"),
}
"""Size, environment, theme."""
_STEP_S, _STEPS = 5, 12
pytestmark = pytest.mark.pictures
_ALIKE = 3


class Picture(SingleFileSnapshotExtension):
    """An SVG file for each picture, named after test, look and page."""

    file_extension = "svg"
    _write_mode = WriteMode.TEXT


class Clock:
    """Stands still unless it is set."""

    def __init__(self) -> None:
        self.seconds = 1000.0

    def __call__(self) -> float:
        return self.seconds


class Telling(FakeClient):
    """A recording whose filter has settled over its last minute, some seconds a poll; then its clock stands still."""

    def __init__(self, clock: Clock) -> None:
        super().__init__(history_s=1.0, clock=clock)
        self.recording = True
        self.changes["logs"] = "logs"
        self._told = clock

    def snapshot(self, since: int = 0) -> Snapshot:
        """The state some seconds later, until a minute has passed."""
        seconds = _STEP_S * min(self.polls + 1, _STEPS)
        self._told.seconds = 1000.0 + seconds
        self.changes["filter"] = settling(seconds)
        return super().snapshot(since)

    @property
    def stands(self) -> bool:
        """Whether the last minute has been told, and its end once more."""
        return self.polls > _STEPS + 1


def settling(seconds: float) -> FilterSnapshot:
    """Estimates some time after the beginning: errors and certainties that shrink with its root."""
    rows = []
    for k, bias in enumerate(live_biases(estimates())):
        assert bias.value is not None
        assert bias.sd is not None
        value = bias.value + (-1) ** k * 0.9 * bias.sd / seconds**0.5
        rows.append(bias._replace(value=value, sd=bias.sd * (_STEP_S * _STEPS / seconds) ** 0.5))
    return estimates(rows, duration_s=seconds)


@pytest.fixture
def place(home: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with one log and one profile, ports that are always the same, a terminal that promises all."""
    (home / "logs").mkdir()
    shutil.copy2(SAMPLE, home / "logs")
    monkeypatch.setattr(session, "ports", lambda: PORTS)
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLORTERM", "truecolor")
    return home


@pytest.fixture(params=LOOKS)
def look(request: pytest.FixtureRequest, place: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Name of a look, in whose environment the test then is."""
    for name, value in LOOKS[request.param][1].items():
        monkeypatch.setenv(name, value)
    return str(request.param)


async def test_pages_look_as_they_did(look: str, place: Path, snapshot: SnapshotAssertion) -> None:
    """Every page of a recording, help, and the dialog that quits: three sizes, no colour, a light theme."""
    client = Telling(Clock())
    pictures = {}
    async with application(client, look).run_test(size=LOOKS[look][0]) as pilot:
        await _until(pilot, lambda: client.stands)
        for page, (keys, text) in PAGES.items():
            await pilot.press(*keys)
            pictures[page] = await _still(pilot, text)
    assert_as_before(pictures, look, place, snapshot)


async def test_the_first_page_looks_as_it_did(look: str, place: Path, snapshot: SnapshotAssertion) -> None:
    async with application(None, look).run_test(size=LOOKS[look][0]) as pilot:
        picture = await _still(pilot, "virtual instrument")
    assert_as_before({"first": picture}, look, place, snapshot)


async def test_the_rack_looks_as_it_did(
    look: str, place: Path, snapshot: SnapshotAssertion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four units at a step of a profile: one is not there, one has a bad axis, one has lost packets."""
    batch = Batch(monkeypatch, Clock())
    for unit in batch.units.values():
        unit.at("go", 3)
    batch.units["lot:1"].changes |= {"lost_packets": 2, "lost_packets_max": 2}
    batch.units["lot:4"].gone = "the acquisition has ended."
    rack = batch.rack()
    app = ImutuiApp(rack=rack, appearance=Appearance(theme=LOOKS[look][2]))
    async with app.run_test(size=LOOKS[look][0]) as pilot:
        await _until(pilot, lambda: len(rack.units()) == 4 and all(unit.answer for unit in rack.units()))
        await pilot.press("w", "j")
        picture = await _still(pilot, "worst first")
    rack.close()
    assert_as_before({"rack": picture}, look, place, snapshot)


def application(client: FakeClient | None, look: str) -> ImutuiApp:
    return ImutuiApp(client, appearance=Appearance(theme=LOOKS[look][2]))  # type: ignore[arg-type]


def assert_as_before(pictures: dict[str, str], look: str, place: Path, snapshot: SnapshotAssertion) -> None:
    """Compare pictures with those on file; where they differ, say where the new one lies."""
    changed = []
    for page, picture in pictures.items():
        if picture != snapshot(name=page, extension_class=Picture):
            path = place / f"{page}-{look}.svg"
            path.write_text(picture)
            changed.append(str(path))
    if changed:
        pytest.fail("other than in tests/tui/__snapshots__, or not there:\n" + "\n".join(changed), pytrace=False)


async def _still(pilot: Pilot[Any], text: str) -> str:
    """A picture of the page as soon as it has this text and moves no more."""
    for field in pilot.app.screen.query(Input):
        field.cursor_blink = False
    shown: list[str] = []

    def stands_still() -> bool:
        shown.append(text_of(pilot.app))  # type: ignore[arg-type]
        return len(shown) > _ALIKE and text in shown[-1] and len(set(shown[-_ALIKE:])) == 1

    await _until(pilot, stands_still)
    # names of classes and clips carry a checksum of the whole; without it a picture differs where it does
    return re.sub(r"terminal-\d+-", "terminal-", pilot.app.export_screenshot(title="imutui", simplify=True))


async def _until(pilot: Pilot[Any], truth: Callable[[], bool]) -> None:
    for _ in range(1000):
        if truth():
            return
        await pilot.pause(0.05)
    raise AssertionError(text_of(pilot.app))  # type: ignore[arg-type]

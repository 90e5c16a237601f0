"""What is expected of an acquisition when something goes wrong around it: the table of `docs/reliability.md`.

Each test makes it happen to real processes and holds what came of it to a generous limit, for machines that are busy
with other tests; `benchmarks/reliability.py` measures the same, beside the bars.
"""

import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from helpers.places import own_places
from reliability import endings, screens
from reliability.setting import Acquired, acquiring

When = Callable[[Acquired], None]
FACTOR = 5.0
"""By how much a busy machine may miss a bar in time."""


@pytest.fixture(scope="module")
def recorder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Acquired, Path]]:
    """An acquisition that several tests look at, and its folder."""
    folder = tmp_path_factory.mktemp("recorder")
    with pytest.MonkeyPatch.context() as patch:
        own_places(patch, folder)
        with acquiring(folder) as it:
            yield it, folder


@pytest.fixture
def recording(recorder: tuple[Acquired, Path], monkeypatch: pytest.MonkeyPatch) -> Acquired:
    """It, found by screens that are started now."""
    own_places(monkeypatch, recorder[1])
    return recorder[0]


def test_kill_nine_loses_at_most_a_flush_interval(home: Path) -> None:
    """A second at most and what is in flight; three readers by others open what `recover` makes of the file."""
    found = endings.kill_nine(home, 1.5)
    assert 0.0 <= found.lost_s < 1.0 * FACTOR
    assert found.held > 0
    assert len(found.read) >= 2
    assert set(found.read.values()) == {found.held}


@pytest.mark.parametrize(
    ("number", "when"), [(signal.SIGTERM, endings.after_a_hangup), (signal.SIGINT, endings.in_a_flush)]
)
def test_a_signal_to_end_finishes_the_file_within_two_seconds(home: Path, number: signal.Signals, when: When) -> None:
    """An indexed file, and the process gone, in mid-flush too; SIGHUP ends nothing."""
    found = endings.told_to_end(home, number, when)
    assert found.exit_code == 0
    assert max(found.file_s, found.gone_s) < 2.0 * FACTOR


def test_ctrl_c_in_the_foreground_finishes_the_file_within_two_seconds(home: Path) -> None:
    """Exit 130."""
    found = endings.interrupted(home)
    assert found.exit_code == 130
    assert max(found.file_s, found.gone_s) < 2.0 * FACTOR


def test_a_dropped_link_leaves_the_recorder_going_on_and_no_screen_behind(recording: Acquired) -> None:
    """The screen is gone within a second, by itself; coming back shows the same session; nothing spins."""
    found = screens.link_dropped(recording, 1.0)
    assert found.gone_s < 1.0 * FACTOR
    assert found.processor < 0.5
    assert found.lost == 0


def test_a_frozen_terminal_costs_no_sample(recording: Acquired) -> None:
    """Nor does it touch the stamps."""
    found = screens.frozen(recording, 1.5)
    assert found.lost == 0
    assert found.packets > 100
    assert found.median_ms < 5.0


def test_the_busiest_screen_makes_no_stamp_late(recording: Acquired) -> None:
    """Largest terminal, most frames: no packet is lost, and stamps stay within a packet's time."""
    found = screens.busy(recording, 1.5)
    assert found.lost == 0
    assert found.median_ms < 5.0


def test_a_suspended_screen_costs_no_sample_and_comes_back(recording: Acquired) -> None:
    """Ctrl+Z stops the screen only; in the foreground again it is put up anew."""
    assert screens.suspended(recording, 0.5) == 0


def test_a_recorder_that_dies_is_told_on_the_screen_at_once(home: Path) -> None:
    """And never does it show that it records when nothing is written; another start is offered."""
    with acquiring(home) as it:
        assert screens.killed_under_the_screen(it) < 1.0 * FACTOR

"""What is expected of an acquisition when something goes wrong around it: the table of `docs/reliability.md`.

Each test makes it happen to real processes and holds what came of it to a generous limit, for machines that are busy
with other tests; `benchmarks/reliability.py` measures the same, beside the bars.
"""

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from helpers.acquisitions import mounts
from helpers.paths import SAMPLE
from helpers.places import own_places
from reliability import clocks, endings, files, lines, ports, screens
from reliability.setting import Acquired, acquiring
from reliability.shared import once_measured

from imutui.tui import messages

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


def test_kill_nine_loses_at_most_a_flush_interval(tmp_path_factory: pytest.TempPathFactory) -> None:
    """A second at most and what is in flight; three readers by others open what `recover` makes of the file."""
    found, _ = once_measured(tmp_path_factory, "killed", endings.kill_nine)
    assert 0.0 <= found.lost_s < 1.0 * FACTOR
    assert found.held > 0
    assert len(found.read) >= 2
    assert set(found.read.values()) == {found.held}


def test_each_flush_is_on_the_disk_and_a_cut_anywhere_leaves_a_true_beginning(tmp_path: Path) -> None:
    """As power may go at any byte: the reader never fails and never lies."""
    found = files.synced(tmp_path, 5)
    assert found.data == found.flushes
    assert found.folder >= 1
    cut = files.cuts(tmp_path, 10)
    assert cut.wrong == 0
    assert cut.samples == {0, 3, 6}


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


def test_the_same_unit_is_found_again_and_no_other_one(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Noticed within a second, back within two of its return, under another name; the gap is in the same file."""
    found, _ = once_measured(tmp_path_factory, "unplugged", lines.unplugged)
    assert found.noticed_s < 1.0 * FACTOR
    assert found.back_s < 2.0 * FACTOR


def test_noise_costs_what_it_hits_and_invents_nothing() -> None:
    """Bits, bytes more and bytes less, headers in packets: two good packets each at most, every byte accounted for."""
    found = lines.noise(7, 200)
    assert found.invented == 0
    assert found.lost <= 2
    assert found.uncounted == 0


def test_silence_is_told_after_three_periods_and_over_with_the_first_packet(home: Path) -> None:
    """A second at least, 30 s at 0.1 Hz; nothing ends."""
    assert messages.silence_limit_s(0.1) == 30.0
    found = lines.silent(home, 2.5)
    assert 1.0 <= found.told_s < 1.0 * FACTOR
    assert found.over_s < 1.0 * FACTOR


@mounts
def test_a_full_disk_leaves_all_up_to_the_last_flush_once(home: Path) -> None:
    """A clean stop with exit code 5 and what to do; by stream and by index of the recovered file the same packets."""
    with files.small_disk(home) as disk:
        found = files.disk_full(home, disk)
    assert found.exit_code == 5
    assert all(words in found.words for words in ("No space left", "imutui replay", "Free some space")), found.words
    assert found.recovered == found.streamed > 50


def test_a_clock_that_is_set_moves_no_stamp(home: Path) -> None:
    """An hour on, and back: each an event; log time never goes back, and stamps keep the unit's period."""
    found = clocks.clock_set(home, (3600.0, -3600.0))
    assert found.told_s == pytest.approx([3600.0, -3600.0], abs=1.0)
    assert found.backwards == 0
    assert found.worst_step_ms < 5.0


def test_a_port_that_cannot_be_had_is_told_by_why_with_the_remedy(home: Path) -> None:
    """Absent, busy, without permission: three different messages, exit code 4, no traceback."""
    found = ports.refusals(home)
    said = {"absent": "imutui demo", "busy": f"pid {os.getpid()}", "permission": "usermod -aG"}
    for why, (code, words) in found.items():
        assert code == 4
        assert said[why] in words
        assert words.count("\n") == 1
    assert len({words for _, words in found.values()}) == len(found) >= 2


def test_a_port_is_held_alone() -> None:
    """By lock and by ioctl: no second imutui, no program that asks for the lock, and none without."""
    assert set(ports.second_openings().values()) == {True}


def test_nothing_is_overwritten_and_no_two_recordings_have_one_name(tmp_path: Path) -> None:
    """Names have unit, UTC and note; an unfinished file is told by its missing footer, not by its name."""
    found = files.overwritten(tmp_path)
    assert found.refused
    assert found.unchanged
    assert found.names_are_right, found.names
    assert found.unfinished_told


def test_a_byte_that_changed_after_the_end_is_found(tmp_path: Path) -> None:
    """By the SHA-256 beside the file."""
    assert files.flipped(tmp_path, 3) == 0


def test_a_replay_gives_the_same_at_any_speed() -> None:
    """In every field but the timings, to the last bit."""
    assert clocks.replays_that_differ(SAMPLE, (None, None, 1e6)) == 0


def test_a_suspended_screen_costs_no_sample_and_comes_back(recording: Acquired) -> None:
    """Ctrl+Z stops the screen only; in the foreground again it is put up anew."""
    assert screens.suspended(recording, 0.5) == 0


def test_a_recorder_that_dies_is_told_on_the_screen_at_once(home: Path) -> None:
    """And never does it show that it records when nothing is written; another start is offered."""
    with acquiring(home) as it:
        assert screens.killed_under_the_screen(it) < 1.0 * FACTOR

"""When a file is full, what the next is called, and how much room there is."""

import shutil
from pathlib import Path

import pytest

from imutui.session.disk_space import FreeSpace, GrowthRate
from imutui.session.plan import Plan
from imutui.session.rotation import RecordingParts

S = 1_000_000_000


@pytest.mark.parametrize(
    ("minutes", "mb", "seconds", "size", "full"),
    [
        (0.0, 0.0, 1e9, 10**12, False),
        (1.0, 0.0, 59.9, 10**12, False),
        (1.0, 0.0, 60.0, 0, True),
        (0.0, 2.0, 1e9, 1_999_999, False),
        (0.0, 2.0, 5.0, 2_000_000, True),
        (60.0, 2.0, 5.0, 2_000_000, True),
        (1e-6, 1e-6, 0.9, 10**9, False),
    ],
)
def test_a_file_is_full_by_time_or_by_size(minutes: float, mb: float, seconds: float, size: int, full: bool) -> None:
    """Whichever comes first; 0 is never; and no limit makes files of less than a second."""
    assert RecordingParts(Path("a.mcap"), minutes, mb).is_full(seconds, size) is full


def test_parts_are_named_after_the_first_and_replace_nothing(tmp_path: Path) -> None:
    """a_p2, a_p3, beside whatever lies there from before."""
    parts = RecordingParts(tmp_path / "a.mcap", 1.0, 0.0)
    assert parts.next_path() == tmp_path / "a_p2.mcap"
    (tmp_path / "a_p2.mcap").touch()
    assert parts.next_path() == tmp_path / "a_p2_2.mcap"
    parts.number = 2
    assert parts.next_path() == tmp_path / "a_p3.mcap"


def test_only_a_recording_in_several_files_tells_its_parts() -> None:
    """The result of one file is as it was; that of the last of several names them all."""
    parts = RecordingParts(Path("a.mcap"), 1.0, 0.0)
    assert parts.add_result({"log": "a.mcap", "converged": True}) == {"log": "a.mcap", "converged": True}
    assert parts.add_result({"log": "a_p2.mcap", "converged": False})["parts"] == [
        {"log": "a.mcap", "converged": True},
        {"log": "a_p2.mcap", "converged": False},
    ]


@pytest.mark.parametrize("limits", [{"rotate_minutes": -1.0}, {"rotate_mb": float("nan")}, {"rotate_mb": float("inf")}])
def test_limits_that_make_no_sense_are_refused(limits: dict[str, float]) -> None:
    """By name, as a plan is made."""
    with pytest.raises(ValueError, match=next(iter(limits))):
        Plan("virtual", **limits)  # type: ignore[arg-type]


def test_a_reference_told_from_one_logs_start_keeps_the_recording_in_one_file() -> None:
    """A second file could not use it."""
    assert Plan("virtual", rotate_minutes=1.0).rotates
    assert not Plan("virtual", rotate_minutes=1.0, reference="profile", reference_file=("t.toml", "x")).rotates
    assert not Plan("virtual").rotates


def test_room_is_that_of_the_nearest_folder_there_is(tmp_path: Path) -> None:
    """The folder of logs is made with the first one; the disk is asked once a second however many ask."""
    room = FreeSpace()
    missing = tmp_path / "logs" / "deep"
    free = room.free_bytes(missing, 5 * S)
    assert free is not None
    assert free == pytest.approx(shutil.disk_usage(tmp_path).free, rel=0.05)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda path: pytest.fail("asked again within the second"))
        assert room.free_bytes(missing, 6 * S - 1) == free
    (tmp_path / "logs").touch()
    assert room.free_bytes(missing, 6 * S) is not None


def test_the_rate_of_growth_is_told_through_all_files() -> None:
    """Nothing in the first 10 s; a new file begins at zero and the rate does not."""
    growth = GrowthRate()
    for second in range(10):
        growth.add(second * S, 1000 * second)
        assert growth.bytes_per_s() is None
    growth.add(10 * S, 10_000)
    assert growth.bytes_per_s() == pytest.approx(1000.0)
    for second in range(11, 200):
        growth.add(second * S, 2000 * (second - 10))
    assert growth.bytes_per_s() == pytest.approx(2000.0)

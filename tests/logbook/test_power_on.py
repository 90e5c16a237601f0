"""A log that continues another: where its time begins, what it says of the other, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import imutui

from imutui.logbook import power_on, reader
from imutui.logbook.session_info import SessionInfo

N, PERIOD = 200, 0.05


def recording(path: Path, begins: float, seed: int = 1) -> Path:
    rng = np.random.default_rng(seed)
    np.savez(
        path,
        t=begins + PERIOD * np.arange(N),
        gyro=rng.normal(size=(N, 3)) * 0.1,
        accel=rng.normal(size=(N, 3)) * 1e-3 + [0.0, 0.0, 0.998],
        temp=np.full(N, 25.0),
    )
    return path


@pytest.fixture
def first(tmp_path: Path) -> Path:
    imutui("import", recording(tmp_path / "a.npz", 100.0), "-o", tmp_path / "a.mcap")
    return tmp_path / "a.mcap"


def continued(first: Path, begins: float, *more: str, check: int = 0) -> tuple[Path, str]:
    output = first.with_name("b.mcap")
    source = recording(first.with_name("b.npz"), begins, seed=2)
    done = imutui("import", source, "-o", output, "--continues", first, *more, check=check)
    return output, done.stderr


def test_time_after_the_end_counts_on_the_clock_of_the_log(first: Path) -> None:
    output, said = continued(first, 130.0)
    a, b = reader.read(first), reader.read(output)
    assert (b.samples.stamp_ns[0] - a.samples.stamp_ns[0]) / 1e9 == pytest.approx(30.0, abs=1e-6)
    assert "on that log's clock" in said
    assert b.info.stamps.endswith("after a.mcap")


@pytest.mark.parametrize("begins", [0.0, 100.0, 100.0 + PERIOD * (N - 1)])
def test_other_time_is_placed_one_period_after_the_end(first: Path, begins: float) -> None:
    output, said = continued(first, begins)
    a, b = reader.read(first), reader.read(output)
    assert (b.samples.stamp_ns[0] - a.samples.stamp_ns[-1]) / 1e9 == pytest.approx(PERIOD, abs=1e-6)
    assert "one period after" in said


def test_the_metadata_name_the_log_and_the_power_on(first: Path) -> None:
    output, _ = continued(first, 130.0)
    a, b = reader.read(first).info, reader.read(output).info
    assert a.power_on == a.log_id != ""
    assert (b.continues, b.continues_id, b.continues_sha256) == ("a.mcap", a.log_id, reader.sha256(first))
    assert (b.power_on, b.part) == (a.power_on, 2)
    assert b.log_id not in ("", a.log_id)
    third = first.with_name("c.mcap")
    source = recording(first.with_name("c.npz"), 170.0, seed=3)
    imutui("import", source, "-o", third, "--continues", output)
    c = reader.read(third)
    assert (c.info.power_on, c.info.part, c.info.continues_id) == (a.power_on, 3, b.log_id)
    assert c.info.power_on_ns == reader.read(first).samples.stamp_ns[0]
    assert (c.samples.stamp_ns[0] - c.info.power_on_ns) / 1e9 == pytest.approx(70.0, abs=1e-6)


def test_a_log_without_an_id_is_known_by_its_hash() -> None:
    """Logs that were written before logs had ids can be continued too."""
    old, sha = SessionInfo(), "0123456789abcdef" * 4
    part = power_on.continued(SessionInfo(), old, Path("old.mcap"), sha, 5)
    assert (part.power_on, part.continues_id) == (sha[:16], sha[:16])
    assert power_on.power_on_id(old, sha) == part.power_on
    assert part.power_on_ns == 5


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--accel-sign", "+1", "--reference", "gravity"), "--accel-sign -1"),
        (("--mount", "y,-x,z", "--reference", "gravity"), '--mount "x,y,z"'),
        (("--gyro-sign", "-1,1,1"), '--gyro-sign "1,1,1"'),
    ],
)
def test_another_unit_or_mounting_is_refused_with_the_cure(first: Path, flags: tuple[str, ...], words: str) -> None:
    output, said = continued(first, 130.0, *flags, check=2)
    assert words in said
    assert "a.mcap" in said
    assert not output.exists()


def test_another_instrument_or_unit_of_g_is_refused_and_none_is_the_same(first: Path) -> None:
    log = power_on.preceding(first)
    named = replace(log, info=replace(log.info, instrument="A"))
    with pytest.raises(ValueError, match='--instrument "A"'):
        power_on.check_same_unit(named, replace(log.info, instrument="B"))
    with pytest.raises(ValueError, match=r"g_unit = 9\.80665"):
        power_on.check_same_unit(log, replace(log.info, g_unit=9.8))
    unnamed = replace(log.info, instrument="")
    power_on.check_same_unit(named, unnamed)
    assert power_on.continuing(named, unnamed, 130.0)[0].instrument == "A"


def test_a_log_that_cannot_be_read_is_exit_3(first: Path, tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("no log")
    for log in ("missing.mcap", "text.mcap"):
        _, said = continued(tmp_path / log, 130.0, check=3)
        assert log in said
    _, said = continued(first, 1.7e9, check=2)
    assert "one clock" in said


def test_a_log_cannot_continue_itself(first: Path) -> None:
    """-o and --continues with one name would destroy what is continued."""
    source = recording(first.with_name("b.npz"), 130.0)
    done = imutui("import", source, "-o", first, "--continues", first, "--force", check=2)
    assert "itself" in done.stderr
    assert reader.read(first).finished

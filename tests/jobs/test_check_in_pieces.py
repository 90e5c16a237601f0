"""`check` and `info` of a long log: told from parts of it, the same as from all of it, in bounded memory."""

import json
import random
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers.logs import LAYOUTS, START, recorded, rewritten
from helpers.paths import SAMPLE
from mcap.writer import IndexType

from imutui.jobs import check_times
from imutui.jobs.check import check
from imutui.jobs.check_times import StepCounts
from imutui.jobs.info import info
from imutui.logbook import SessionInfo, audit, walk
from imutui.logbook.audit import Audit, HeadRun, joined_runs, run_of
from imutui.logbook.mcap_stream import MESSAGE_HEAD
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.scan import Scan
from imutui.logbook.writer import LogWriter


def said(path: Path) -> str:
    """All that both commands say."""
    try:
        return json.dumps((check(path), info(path)))
    except UnreadableLogError as error:
        return str(error)


def with_gaps(path: Path) -> Path:
    """Samples with a gap, some that are no numbers or no readings, and a channel that is never read."""
    rng = np.random.default_rng(3)
    log = LogWriter(path, SessionInfo(rate_hz=20.0, sampling="imported", kind="simulated"), "", START)
    t = np.cumsum(np.where(np.arange(400) == 211, 3.0, 0.05) + 1e-3 * rng.random(400))
    for k, stamp in enumerate((START + t * 1e9).astype(np.int64).tolist()):
        gyro, accel = rng.normal(size=3), rng.normal(size=3)
        gyro[1] = np.nan
        accel[2] = np.inf if k in (217, 300) else accel[2]
        log.imu(stamp, stamp, gyro, accel, valid=k % 150 != 149)
        if k % 20 == 19:
            log.flush()
    log.finish({}, START)
    return path


def sources(folder: Path) -> dict[str, bytes]:
    """Logs as they are written here and elsewhere."""
    plain, other = recorded(folder / "a.mcap"), folder / "b.mcap"
    made = {"gaps": with_gaps(folder / "gaps.mcap").read_bytes(), "sample": SAMPLE.read_bytes()}
    for name in ("small chunks", "no chunks", "no index", "schemas in the chunks only"):
        options = LAYOUTS[name] | ({"index_types": IndexType.NONE} if "index_types" in LAYOUTS[name] else {})
        made[name] = rewritten(plain, other, **options).read_bytes()
    return made


def test_parts_of_any_size_say_what_the_whole_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng, spoilt, whole_parts = random.Random(7), tmp_path / "c.mcap", audit.MESSAGES
    findings = 0
    for content in sources(tmp_path).values():
        for k in range(5):
            damaged = bytearray(content[: rng.randrange(len(content))] if k == 1 else content)
            for _ in range(max(0, k - 1)):
                damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
            if k == 4:
                first = rng.randrange(len(damaged))
                del damaged[first : first + rng.randrange(len(damaged) // 4)]
            spoilt.write_bytes(damaged)
            each = []
            for messages in (whole_parts, 70, 1):
                monkeypatch.setattr(audit, "MESSAGES", messages)
                each.append(said(spoilt))
            assert len(set(each)) == 1
            findings += each[0].count('"code"')
    assert findings > 50


def test_what_a_log_lacks_and_where_it_is_no_number_is_known_from_all_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(audit, "MESSAGES", 1)
    found = {f["code"]: f["what"] for f in check(with_gaps(tmp_path / "a.mcap"))["findings"]}
    assert "2 samples are not numbers" in found["stamps"]
    assert "2 samples are flagged" in found["limits"]
    assert found["gaps"].startswith("1 gap between samples, the longest 3.0")
    assert info(tmp_path / "a.mcap")["unread_channels"] == ["gy"]


def test_no_more_than_a_part_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(audit, "MESSAGES", 100)
    known = Audit()
    sizes = [len(part.samples) + part.packets.size for part in audit.parts(Scan(SAMPLE), known)]
    assert sum(sizes) == known.samples + known.packets > 1000
    assert max(sizes) < 500


def test_numbers_and_times_of_messages_can_be_told_in_parts() -> None:
    rng = np.random.default_rng(1)
    for _ in range(40):
        heads = np.zeros(30, MESSAGE_HEAD)
        heads["sequence"] = 5 + np.cumsum(rng.choice([1, 1, 1, 1, 3, 0], 30))
        heads["log_ns"] = np.cumsum(rng.choice([10, 10, 10, -5], 30)) + 1000
        edges = [0, *np.sort(rng.choice(np.arange(1, 30), 4, replace=False)).tolist(), 30]
        run: HeadRun | None = None
        for first, last in pairwise(edges):
            run = joined_runs(run, run_of(heads[first:last]))
        assert run == audit.run_of(heads)
        steps = np.diff(heads["sequence"].astype(int))
        assert run.missing == np.sum(steps[steps > 1] - 1)
        assert run.since_zero.missing - run.missing == heads["sequence"][0]


def test_steps_are_counted_exactly_and_the_median_is_that_of_all() -> None:
    rng = np.random.default_rng(2)
    stamps = START + np.cumsum(rng.integers(7_400_000, 7_400_040, 2001))
    steps, codes = np.diff(stamps).astype(float), rng.integers(0, 3, 2000)
    table = StepCounts()
    for first in range(0, 2000, 150):
        rows = slice(first, min(first + 150, 2000))
        table.take(steps[rows], codes[rows], stamps[first : rows.stop + 1])
    assert table.median() == np.median(steps)
    assert table.counts.sum() == len(table) == 2000
    row = table.first(table.codes == 2)
    k = int(np.argmax(codes == 2))
    assert (table.before_ns[row], table.after_ns[row], table.steps[row]) == (stamps[k], stamps[k + 1], steps[k])


def test_steps_that_never_repeat_take_no_more_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_times, "MOST", 300)
    rng, table = np.random.default_rng(4), StepCounts()
    steps = rng.normal(7.5e6, 1e5, 20_000)
    for first in range(0, 20_000, 1000):
        table.take(steps[first : first + 1000], None, np.arange(1001))
    assert table.steps.size <= 300
    assert table.counts.sum() == 20_000
    assert table.median() == pytest.approx(np.median(steps), rel=1e-3)


def test_a_mark_is_found_across_the_borders_of_what_is_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import mmap

    monkeypatch.setattr(walk, "WINDOW", 4096)
    content = random.Random(1).randbytes(20_000)
    (tmp_path / "a").write_bytes(content)
    with (tmp_path / "a").open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        for at in (0, 4090, 8191, 19_992):
            assert walk.find(data, content[at : at + 8], 0) == at
            assert walk.find(data, content[at : at + 8], at + 1) == -1
        walk.forget(data, 100, 19_000)
        assert data[:] == content

"""A long log is replayed in pieces: the same to the last bit as one that is read at once, whatever the pieces."""

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.paths import SAMPLE

from filters import simulation
from filters.kalman import series_evidence
from imutui.jobs import replay_input
from imutui.jobs.replay import EstimatesFile, replayed
from imutui.jobs.replay_input import Gaps
from imutui.logbook import SessionInfo, pieces, reader, schemas
from imutui.logbook.reading import AS_STATED, Reading
from imutui.logbook.results import TIMINGS
from imutui.logbook.writer import LogWriter


def still(path: Path, seconds: float = 60.0, reference: str = "level", *, bursts: bool = False) -> Path:
    """A simulated log with a pause of 3 s, samples that are no readings, and temperatures; or one stamped in bursts."""
    samples, _ = simulation.simulate(rate_hz=20.0, seconds=seconds, seed=4)
    info = SessionInfo(rate_hz=20.0, reference=reference, kind="simulated")
    log = LogWriter(path, info, "", 0)
    base = 1_700_000_000_000_000_000
    for k, t in enumerate(samples.t.tolist()):
        if 20.0 < t < 23.0:
            continue
        stamp = base + round((t - 0.0499 * (k % 4) if bursts else t) * 1e9)
        log.imu(stamp, stamp, samples.gyro[k], samples.accel[k], valid=k % 97 != 5)
        if k % 7 == 0:
            log.encoded(schemas.TEMPERATURE, schemas.encode_temperatures(stamp, 20.0 + t / 10.0)[0], stamp, stamp)
        if k % 20 == 0:
            angles = [0.0, 0.0, 0.0] if reference == "level" else [float("nan")] * 3
            row = schemas.encode_table_references(stamp, reference, angles, [0.0] * 3)[0]
            log.encoded(schemas.REFERENCE, row, stamp, stamp)
        if k % 50 == 0:
            log.flush()
    log.finish({}, base)
    return path


def result(path: Path, reading: Reading, **wanted: bool) -> dict[str, Any]:
    """All that a replay says but the timings."""
    made = replayed(path, reading, **wanted)
    told = {key: value for key, value in made.result.items() if key not in TIMINGS}
    return {**told, "first_ns": made.first_ns, "temperature": made.temperature, "info": made.info}


@pytest.fixture
def in_pieces(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Makes any log a long one, read in pieces of so many samples."""

    def make(rows: int) -> None:
        monkeypatch.setattr(replay_input, "WHOLE_BYTES", 0)
        monkeypatch.setattr(pieces, "ROWS", rows)

    return make


CASES = {
    "level": ("level", Reading()),
    "part": ("level", Reading(start=3.0, end=40.0)),
    "course": ("level", Reading()),
    "gravity": ("gravity", Reading()),
    "drawn": ("level", Reading(overrides={"measurements": "drawn", "seed": 3})),
    "ekf": ("level", Reading(overrides={"filter": "ekf"})),
}


@pytest.mark.parametrize("case", CASES)
def test_a_log_in_pieces_gives_the_same_result(tmp_path: Path, case: str, in_pieces: Callable[[int], None]) -> None:
    reference, reading = CASES[case]
    path = still(tmp_path / "a.mcap", reference=reference)
    whole = result(path, reading, course=case == "course")
    for rows in (1, 333):
        in_pieces(rows)
        found = result(path, reading, course=case == "course")
        # a mean of parts may differ in the last bit
        assert found.pop("temperature") == pytest.approx(whole["temperature"], rel=1e-14)
        assert found == {key: value for key, value in whole.items() if key != "temperature"}
    assert whole["gaps"]


def test_estimates_in_a_file_are_the_same(tmp_path: Path, in_pieces: Callable[[int], None]) -> None:
    whole, parts = tmp_path / "whole.mcap", tmp_path / "parts.mcap"
    replayed(SAMPLE, Reading(), output=EstimatesFile(whole, 0.0))
    in_pieces(100)
    replayed(SAMPLE, Reading(), output=EstimatesFile(parts, 0.0))
    data = [b"".join(m.data for m in _estimates(path)) for path in (whole, parts)]
    assert data[0] == data[1]
    assert len(data[0]) > 100_000


def _estimates(path: Path) -> list[Any]:
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        return [message for _, _, message in make_reader(stream).iter_messages(topics=[schemas.ESTIMATE])]


@pytest.mark.parametrize("bursts", [False, True])
def test_noise_measured_in_pieces_is_that_of_the_whole(
    tmp_path: Path, in_pieces: Callable[[int], None], bursts: bool
) -> None:
    path = still(tmp_path / "a.mcap", bursts=bursts)
    options = Reading(overrides={"noise": "log"})
    whole = replayed(path, options).result
    assert whole["gaps"]
    for rows in (1, 200):
        in_pieces(rows)
        known = replay_input.outline_of_long(path, AS_STATED)
        assert known is not None
        found = replayed(path, options).result
        for name, values in whole["noise"]["used"].items():
            if name != "source":
                assert found["noise"]["used"][name] == pytest.approx(values, rel=1e-9)
        assert found["final"]["gyro_bias_dps"] == pytest.approx(whole["final"]["gyro_bias_dps"], rel=1e-6)


def test_noise_of_a_longer_log_takes_no_more_memory(
    tmp_path: Path, in_pieces: Callable[[int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Replayed in pieces of 200 samples: it grows by less than half of what the further samples themselves take."""
    # what is held of the longest means at a time, whatever is in them
    monkeypatch.setattr(replay_input, "_OVERLAP", 64)
    options = Reading(overrides={"noise": "log"})
    in_pieces(200)
    series_evidence.prepare()  # nor does that grow with a log
    replayed(still(tmp_path / "first.mcap"), options)
    most = []
    # by then the filter's watch of its residual has all the blocks that it looks at
    for seconds in (200.0, 500.0):
        path = still(tmp_path / f"{seconds}.mcap", seconds)
        tracemalloc.start()
        try:
            replayed(path, options)
            most.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert most[1] - most[0] < 0.5 * 6000 * 7 * 8


def test_an_empty_part_of_a_long_log_is_refused_in_words(tmp_path: Path, in_pieces: Callable[[int], None]) -> None:
    in_pieces(200)
    with pytest.raises(ValueError, match="leave no sample"):
        replayed(still(tmp_path / "a.mcap"), Reading(start=1e6))


def test_no_more_than_a_piece_is_held(tmp_path: Path, in_pieces: Callable[[int], None]) -> None:
    longest = []
    for seconds in (60.0, 240.0):
        path = still(tmp_path / f"{seconds}.mcap", seconds)
        in_pieces(200)
        known = replay_input.outline_of_long(path, AS_STATED)
        assert known is not None
        fed = replay_input.in_pieces(known, None, None)
        lengths = [len(part) for part in fed.parts()]
        assert sum(lengths) == np.count_nonzero(reader.read(path).samples.valid)
        longest.append(max(lengths))
    assert longest[1] <= longest[0] + 50 < 800


def test_gaps_of_parts_are_those_of_the_whole() -> None:
    """Wherever the parts end: within a stretch, at a gap, or after a single sample."""
    t = np.delete(np.arange(3000) * 0.01, [*range(400, 500), *range(2000, 2010)])
    whole = Gaps(0.01)
    whole.take(t)
    assert whole.steps == pytest.approx([1.01, 0.11])
    assert whole.longest_stretch() == (400, 1900)
    for edges in ([400], [399, 401, 1900], [1, 2, 2500]):
        parts = Gaps(0.01)
        for part in np.split(t, edges):
            parts.take(part)
        assert parts.steps.tolist() == whole.steps.tolist()
        assert parts.longest_stretch() == (400, 1900)


def test_many_gaps_are_bursts_of_the_host() -> None:
    bursts = Gaps(0.01)
    bursts.take(np.repeat(np.arange(100) * 0.1, 10))
    assert bursts.bursts
    assert bursts.longest_stretch() == (0, 1000)

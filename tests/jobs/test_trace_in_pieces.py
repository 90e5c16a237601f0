"""A log that is too long to be held is traced in pieces, and says what the whole would say."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from filters.imu import STANDARD_GRAVITY
from filters.tracing.trace_document import TraceDocument
from imutui.jobs import replay_input, runs, tasks
from imutui.jobs.trace import trace
from imutui.logbook import SessionInfo, pieces, schemas
from imutui.logbook.reading import Reading
from imutui.logbook.writer import LogWriter

HZ, SECONDS, START = 50.0, 1800.0, 1_700_000_000_000_000_000


def faulty(path: Path, seed: int = 0, reference: str = "level", *, dead: bool = False) -> Path:
    """A unit at rest whose x gyro follows temperature, with a line, spikes, readings that are none, and a gap.

    `dead`: the z gyro does not move.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(SECONDS * HZ)) / HZ
    t = t[(t < 700.0) | (t > 703.0)]
    T = 20.0 - 12.0 * np.expm1(-t / 400.0) + 2.0 * np.sin(t / 100.0)
    gyro = rng.standard_normal((t.size, 3)) * 5e-4
    accel = rng.standard_normal((t.size, 3)) * 5e-3 - [0.0, 0.0, STANDARD_GRAVITY]
    gyro[:, 0] += 2e-5 * (T - 20.0)
    accel[:, 1] += 4e-3 * np.sin(2.0 * np.pi * 11.3 * t)
    accel[[4000, 30_000, 61_000], 0] += 0.3
    if dead:
        gyro[:, 2] = 0.01
    log = LogWriter(path, SessionInfo(rate_hz=HZ, kind="simulated", reference=reference), "", START)
    for k, stamp in enumerate((START + np.rint(t * 1e9).astype(np.int64)).tolist()):
        log.imu(stamp, stamp, gyro[k], accel[k], valid=not 40_000 <= k < 40_010)
        if k % 50 == 0:
            log.encoded(schemas.TEMPERATURE, schemas.encode_temperatures(stamp, float(T[k]))[0], stamp, stamp)
    log.finish({}, START)
    return path


@pytest.fixture
def in_pieces(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Makes any log a long one, read in pieces of a few minutes."""

    def make() -> None:
        monkeypatch.setattr(replay_input, "WHOLE_BYTES", 0)
        monkeypatch.setattr(runs, "_HELD", 1 << 14)
        monkeypatch.setattr(runs, "_BEGINNING", 1 << 16)
        monkeypatch.setattr(pieces, "ROWS", 1 << 14)

    return make


def said(document: TraceDocument) -> dict[str, Any]:
    return {
        "status": document["status"],
        "findings": {(f["effect"], *f["channels"]) for f in document["findings"]},
        "faults": {(f["effect"], *f["channels"]): f["count"] for f in document["integrity"]},
        "lines": [line["channels"] for line in document["lines"]],
        "run": [(run["samples"], round(run["rate_hz"], 3), run["reference"]) for run in document["runs"]],
    }


@pytest.mark.parametrize(("reference", "dead"), [("level", False), ("gravity", True)])
def test_in_pieces_as_at_once(tmp_path: Path, in_pieces: Callable[[], None], reference: str, dead: bool) -> None:
    """Faults, lines, causes, sizes, errors and status are those of the log that is read at once."""
    log = faulty(tmp_path / "a.mcap", reference=reference, dead=dead)
    whole = trace([log], Reading())
    in_pieces()
    parts = trace([log], Reading())
    assert said(parts) == said(whole)
    assert {"spikes", "dropout", *(["stuck"] if dead else [])} <= {fault["effect"] for fault in whole["integrity"]}
    # the gap makes the rate of the whole less than that of its samples
    assert [line["hz"] for line in parts["lines"]] == pytest.approx([11.3], abs=0.002)
    assert [line["hz"] for line in whole["lines"]] == pytest.approx([11.3], abs=0.03)
    for one, other in zip(parts["findings"], whole["findings"], strict=True):
        for p, q in zip(one["params"], other["params"], strict=True):
            assert p["value"] == pytest.approx(q["value"], abs=0.5 * (q["sd"] or 0.0))
    for after, before in zip(parts["error"], whole["error"], strict=True):
        assert after["after"] == pytest.approx(before["after"], rel=0.05)


def test_one_log_judges_another_in_pieces(tmp_path: Path, in_pieces: Callable[[], None]) -> None:
    """Logs that are long only together are all read in pieces, and the last one is held out."""
    logs = [faulty(tmp_path / f"{name}.mcap", seed) for seed, name in enumerate("ab")]
    whole = trace(logs, Reading())
    in_pieces()
    parts = trace(logs, Reading())
    assert said(parts) == said(whole)
    assert [f["confirmed"] for f in parts["findings"]] == [f["confirmed"] for f in whole["findings"]]


def test_the_beginning_of_a_long_log_is_told_before_the_rest_is_read(
    tmp_path: Path, in_pieces: Callable[[], None]
) -> None:
    """What the first minutes say stands below what is being done, to the end; shares never go back."""
    in_pieces()
    told: list[tuple[float, str]] = []
    tasks.trace_logs([faulty(tmp_path / "a.mcap")], lambda share, what: told.append((share, what)))
    number = next(k for k, (_, what) in enumerate(told) if "\n" in what)
    assert not any("reading a.mcap" in what for _, what in told[:number])
    text = r"[^\n]+\nProvisional, of the first 2\d min: gx: linear in temperature"
    assert all(re.match(text, what) for _, what in told[number:])
    assert any("means of a" in what for _, what in told)
    assert [share for share, _ in told] == sorted(share for share, _ in told)

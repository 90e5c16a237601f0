"""A log that is too long to be held is traced in pieces, and says what the whole would say."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from filters.imu import STANDARD_GRAVITY
from filters.tracing.trace_document import TraceDocument
from imutui.jobs import replay_input, runs
from imutui.jobs.trace import TraceOptions, trace
from imutui.logbook import SessionInfo, pieces, schemas
from imutui.logbook.writer import LogWriter

HZ, SECONDS, START = 50.0, 1800.0, 1_700_000_000_000_000_000


def faulty(path: Path) -> Path:
    """A unit at rest whose x gyro follows temperature, with a line, spikes, readings that are none, and a gap."""
    rng = np.random.default_rng(0)
    t = np.arange(round(SECONDS * HZ)) / HZ
    t = t[(t < 700.0) | (t > 703.0)]
    T = 20.0 - 12.0 * np.expm1(-t / 400.0) + 2.0 * np.sin(t / 100.0)
    gyro = rng.standard_normal((t.size, 3)) * 5e-4
    accel = rng.standard_normal((t.size, 3)) * 5e-3 - [0.0, 0.0, STANDARD_GRAVITY]
    gyro[:, 0] += 2e-5 * (T - 20.0)
    accel[:, 1] += 4e-3 * np.sin(2.0 * np.pi * 11.3 * t)
    accel[[4000, 30_000, 61_000], 0] += 0.3
    log = LogWriter(path, SessionInfo(rate_hz=HZ, kind="simulated"), "", START)
    for k, stamp in enumerate((START + np.rint(t * 1e9).astype(np.int64)).tolist()):
        log.imu(stamp, stamp, gyro[k], accel[k], valid=not 40_000 <= k < 40_010)
        if k % 50 == 0:
            log.encoded(schemas.TEMPERATURE, schemas.encode_temperature(stamp, float(T[k])), stamp, stamp)
    log.finish({}, START)
    return path


def said(document: TraceDocument) -> dict[str, Any]:
    return {
        "status": document["status"],
        "findings": {(f["effect"], *f["channels"]) for f in document["findings"]},
        "faults": {(f["effect"], *f["channels"]): f["count"] for f in document["integrity"]},
        "lines": [line["channels"] for line in document["lines"]],
        "run": [(run["samples"], round(run["rate_hz"], 3), run["reference"]) for run in document["runs"]],
    }


def test_in_pieces_as_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Faults, lines, causes, sizes, errors and status are those of the log that is read at once."""
    log = faulty(tmp_path / "a.mcap")
    whole = trace([log], TraceOptions())
    monkeypatch.setattr(replay_input, "WHOLE_BYTES", 0)
    monkeypatch.setattr(runs, "_HELD", 1 << 14)
    monkeypatch.setattr(runs, "_BEGINNING", 1 << 16)
    monkeypatch.setattr(pieces, "ROWS", 1 << 14)
    told: list[tuple[float, str]] = []
    first: list[str] = []
    parts = trace([log], TraceOptions(), lambda share, what: told.append((share, what)), first.append)
    assert said(parts.document) == said(whole.document)
    assert {"spikes", "dropout"} <= {fault["effect"] for fault in whole.document["integrity"]}
    # the gap makes the rate of the whole less than that of its samples
    assert [line["hz"] for line in parts.document["lines"]] == pytest.approx([11.3], abs=0.002)
    assert [line["hz"] for line in whole.document["lines"]] == pytest.approx([11.3], abs=0.03)
    for one, other in zip(parts.document["findings"], whole.document["findings"], strict=True):
        for p, q in zip(one["params"], other["params"], strict=True):
            assert p["value"] == pytest.approx(q["value"], abs=0.5 * (q["sd"] or 0.0))
    for one, other in zip(parts.document["error"], whole.document["error"], strict=True):
        assert one["after"] == pytest.approx(other["after"], rel=0.05)
    (text,) = first
    assert re.match(r"Provisional, of the first 2\d min: gx: linear in temperature", text)
    assert any("means of a" in what for _, what in told)
    assert [share for share, _ in told] == sorted(share for share, _ in told)

"""How whole the readings of a log are: gaps, readings that are none, losses, temperatures, what `check` finds."""

from dataclasses import dataclass

import numpy as np

from filters.kalman.settings import GAP_PERIODS
from imutui.jobs import check
from imutui.logbook.reader import Log

_BURSTS = 0.001


@dataclass(frozen=True, slots=True)
class Quality:
    """How whole the readings of a log are."""

    log: str  # its path
    seconds: float  # from its first sample to its last
    # samples, without_reading: all of them, and those flagged as none: a count at its limit
    samples: int
    without_reading: int
    gaps: int  # steps of more than two and a half periods
    # longest_gap_s, missing_s: the longest, and all of them together less a period each
    longest_gap_s: float
    missing_s: float
    # lost_packets, bad_checksums: as the recorder counted; None of an imported log
    lost_packets: int | None
    bad_checksums: int | None
    temperature_degc: tuple[float, float] | None  # least and greatest; None without any
    findings: tuple[str, ...]  # of `imutui check`, with where


def of_log(log: Log) -> Quality:
    """How whole the readings of a log are, with what `imutui check` finds."""
    t, counters = log.seconds(), log.diagnostics
    steps = np.diff(t)
    seconds = float(t[-1] - t[0])
    period = 1.0 / log.info.rate_hz if log.own else seconds / max(steps.size, 1)
    gaps = steps[steps > GAP_PERIODS * period]
    # bursts of a host's stamps are no gaps in the samples
    gaps = gaps[:0] if not counters and gaps.size > max(1.0, _BURSTS * t.size) else gaps
    known = log.temperature_degc[np.isfinite(log.temperature_degc)]
    return Quality(
        str(log.path),
        seconds,
        int(t.size),
        int(np.count_nonzero(~log.valid)),
        int(gaps.size),
        float(gaps.max()) if gaps.size else 0.0,
        float((gaps - period).sum()),
        int(counters["lost_packets"]) if "lost_packets" in counters else None,
        int(counters["bad_checksums"]) if "bad_checksums" in counters else None,
        (float(known.min()), float(known.max())) if known.size else None,
        tuple(f"{found['what']} {found['where']}".strip() for found in check.check(log.path)["findings"]),
    )

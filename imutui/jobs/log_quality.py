"""How whole the readings of a log are: gaps, readings that are none, losses, temperatures, what `check` finds."""

from dataclasses import dataclass

import numpy as np

from filters.kalman.settings import GAP_PERIODS
from imutui.jobs import check
from imutui.logbook.reader import Log

_BURSTS = 0.001


@dataclass(frozen=True, slots=True)
class Quality:
    """How whole the readings of a log are.

    Attributes
    ----------
    log : str
        Its path.
    seconds : float
        From its first sample to its last.
    samples, without_reading : int
        All of them, and those flagged as none: a count at its limit.
    gaps : int
        Steps of more than two and a half periods.
    longest_gap_s, missing_s : float
        The longest, and all of them together less a period each.
    lost_packets, bad_checksums : int or None
        As the recorder counted; None of an imported log.
    temperature_degc : tuple of float or None
        Least and greatest; None without any.
    findings : tuple of str
        Of `imutui check`, with where.
    """

    log: str
    seconds: float
    samples: int
    without_reading: int
    gaps: int
    longest_gap_s: float
    missing_s: float
    lost_packets: int | None
    bad_checksums: int | None
    temperature_degc: tuple[float, float] | None
    findings: tuple[str, ...]


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

"""The verdict on the filter of a running acquisition: from its snapshots, with a memory of 2 s.

The rules are those of `imutui.verdict`.
"""

import math
from collections import deque
from dataclasses import replace

from imutui.session.snapshot import Snapshot
from imutui.tui import messages
from imutui.verdict import rules
from imutui.verdict.rules import ENDED, RANK, Verdict

HOLD_S = 2.0
STALE_S = 5.0  # silence of the line that makes estimates old; shorter ones are only said


def stale(snapshot: Snapshot) -> str | None:
    """That the unit is away, or silent for long enough to make the estimates old, in words; None if it is not."""
    said, silent_s = messages.silence(snapshot), snapshot["silent_s"]
    old = snapshot["reconnecting"] is not None or (silent_s is not None and silent_s > STALE_S)
    return said if old else None


def waiting_profile(snapshot: Snapshot) -> str | None:
    """That the reference is a profile whose guide has not begun or is cancelled, in words; None if it is not."""
    guide = snapshot["guide"]
    if not snapshot["reference"]["profile"] or (guide is not None and guide["state"] != "cancelled"):
        return None
    does = "begins" if guide is None or snapshot["recording"] is None else "resumes"
    return f"the table profile waits: 5 Table, b {does} it"


def of_snapshot(snapshot: Snapshot) -> Verdict:
    """Return the verdict on channels and filter."""
    silent, waits = stale(snapshot), waiting_profile(snapshot)
    return rules.judge(snapshot["filter"], snapshot["health"], silent=silent, waiting_profile=waits)


def ended(last: Verdict | None) -> Verdict | None:
    """Verdict once the acquisition has ended: what was shown last, as something of the past."""
    if last is None or last.word in (ENDED, "OFF"):
        return last
    reason = f"the acquisition has ended; at its end: {last.word}, {last.reason}"
    return replace(last, level="none", word=ENDED, reason=reason, todo="1 connects again", brief="", sudden=True)


class Debounce:
    """Keeps the badge from flickering: a word stands 2 s at least, and yields to a better one only after 2 s of it."""

    def __init__(self) -> None:
        self._shown: Verdict | None = None
        self._since = -math.inf
        self._recent: deque[tuple[float, Verdict]] = deque()

    def take(self, t: float, verdict: Verdict) -> Verdict:
        """Take a verdict at `t` s of the acquisition's clock; returns the one to show."""
        self._recent.append((t, verdict))
        while self._recent[0][0] <= t - HOLD_S:
            self._recent.popleft()
        if self._shown is None or verdict.sudden or self._shown.sudden:
            self._recent = deque([(t, verdict)])
            return self._show(t, verdict)
        # the worst of the last 2 s, and of those the latest
        worst = max((v for _, v in reversed(self._recent)), key=lambda v: RANK[v.level])
        if worst.word == self._shown.word or t - self._since >= HOLD_S:
            return self._show(t, worst)
        return self._shown

    def _show(self, t: float, verdict: Verdict) -> Verdict:
        if self._shown is None or verdict.word != self._shown.word:
            self._since = t
        self._shown = verdict
        return verdict

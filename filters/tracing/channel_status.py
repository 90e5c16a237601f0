"""The status of a channel in a word.

One of clean, explained, confounded, partial, stochastic, run_specific, unexplained. "Explained" never means proved: no
rival fits as well, no drift is needed beside it, nothing remains, and a held-out run is at its floor. Faults that were
set aside explain nothing: a channel that has only those is clean.
"""

from filters.channels import CHANNELS
from filters.tracing.assessment import Assessment
from filters.tracing.trace_document import Status

_IN_BAND = 1.2
_SURE = 1.7


def statuses(assessment: Assessment) -> dict[str, Status]:
    """Status of every channel by name, but those that no run has."""
    lacking = assessment.design.stack.unread
    return {name: status(assessment, c) for c, name in enumerate(CHANNELS) if c not in lacking}


def status(assessment: Assessment, channel: int) -> Status:
    """Status of a channel."""
    found = [f for f in assessment.findings if channel in f.channels]
    if any(channel in x.finding.channels for x in assessment.refuted):
        return "partial" if any(f.confirmed is not False for f in found) else "unexplained"
    drifts = channel in assessment.drifting
    remains = any(r.channel == channel for r in assessment.remainder)
    if not found:
        if drifts:
            return "stochastic"
        if remains or (channel in assessment.channels and _out_of_band(assessment, channel)):
            return "unexplained"
        return "explained" if assessment.screening.concerns(channel) else "clean"
    lasting = [f for f in found if f.lasting]
    if any(f.rivals for f in lasting):
        return "confounded"
    if _one_power_on(assessment) and any(f.term.hypothesis.source != "motion" for f in lasting):
        return "confounded"
    doubted = any(f.confirmed is False for f in lasting)
    if drifts or remains or doubted or (lasting and _out_of_band(assessment, channel)):
        return "partial"
    return "explained" if lasting else "run_specific"


def _one_power_on(assessment: Assessment) -> bool:
    """Whether nothing was judged on a power-on of its own: what goes with time or temperature may be chance then."""
    heldout = assessment.heldout
    if heldout is not None and heldout.is_part:
        return True
    return assessment.design.stack.begins.size + _has_verdict(assessment) == 1


def _has_verdict(assessment: Assessment) -> bool:
    """Whether there is a held-out run, long enough for a verdict."""
    return assessment.heldout is not None and assessment.heldout.long_enough


def _out_of_band(assessment: Assessment, channel: int) -> bool:
    """Whether the held-out error is above its floor's band."""
    if not _has_verdict(assessment):
        return False
    for figure in assessment.errors:
        if figure.channel == CHANNELS[channel] and figure.metric == "e10" and figure.heldout != "folds":
            # one channel in forty is outside the 95 % band by chance: a verdict asks for a thousandth
            limit = figure.floor + _SURE * (figure.floor_band95[1] - figure.floor)
            limit = max(limit, _IN_BAND * figure.floor)
            if figure.after > limit:
                return True
    return False

"""What is known of a selection: its findings, what a held-out run confirms, error before and after, what remains.

Every part is a record that a function returns; `assess` puts them together. A channel that is called explained is not
proved to be: no rival fits as well, no drift is needed beside it, nothing remains, and a held-out run is at its floor.
Faults that were set aside explain nothing: a channel that has only those is clean. What it leaves out: how it is said
(`report`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from filters.channels import CHANNELS
from filters.effects import noise
from filters.effects.drivers import Driver
from filters.tracing import detectability, experiment
from filters.tracing.common_causes import CommonCause, common_causes
from filters.tracing.design_matrix import Design
from filters.tracing.error_figure import ErrorFigure
from filters.tracing.findings import Finding, findings_of
from filters.tracing.held_out_run import HeldOutRun, folded_errors, held_out_errors
from filters.tracing.judgement import Refuted, judge
from filters.tracing.result import SeparatingExperiment
from filters.tracing.screening import Screening
from filters.tracing.selection import Selection
from filters.tracing.stack import Stack
from filters.tracing.trace_document import SEPARATES, LimitEntry, RemainderEntry, Status

REMAINDER = 1e-4 / 24.0  # probability below which a whitened residual is not white: 1e-4 over all channels and scales
_SCALES_S = (1.0, 4.0, 16.0, 64.0)
_DISPUTED, _RIVALS = 3, 4


@dataclass(frozen=True, kw_only=True)
class Assessment:
    """All that is known of a selection."""

    selection: Selection  # what was selected, with the design
    channels: tuple[int, ...]  # those with data
    screening: Screening  # what was found beside it
    findings: tuple[Finding, ...]  # the best score first, without those that are
    refuted: tuple[Refuted, ...]  # contradicted by the held-out run
    heldout: HeldOutRun | None  # what nothing was fitted to
    # before and after, on the held-out run or within the runs, with all that the runs at hand chose
    errors: tuple[ErrorFigure, ...]
    remainder: tuple[RemainderEntry, ...]  # what is not explained
    limits: tuple[LimitEntry, ...]  # of effects that were asked about
    experiment: SeparatingExperiment | None  # the run to make next
    seed: int  # of intervals and bands
    common: tuple[CommonCause, ...] = ()  # what moves several channels at once and nothing logged explains

    @property
    def design(self) -> Design:
        """Data and columns of the runs at hand."""
        return self.selection.design

    @property
    def joining(self) -> tuple[Finding, ...]:
        """Findings that the held-out run confirms, or cannot, of those that the filter can have: the effects file's."""
        return tuple(f for f in self.findings if f.confirmed is not False and _in_filter(f))

    @property
    def drifting(self) -> tuple[int, ...]:
        """Channels with drift that nothing logged explains."""
        return tuple(c for c in self.channels if self.design.drift[c].level > 0.0)


def _in_filter(finding: Finding) -> bool:
    h = finding.term.hypothesis
    return not isinstance(h, Driver) or h.in_filter


def assess(
    chosen: Selection,
    channels: Sequence[int],
    screening: Screening,
    heldout: Stack | None,
    asked: Sequence[str],
    seed: int,
) -> Assessment:
    """Assess a selection.

    `heldout`: a run that nothing was fitted to.
    `asked`: effects whose limit of detection is to be said.
    """
    design = chosen.design
    found = findings_of(chosen)
    run = None if heldout is None else HeldOutRun.of(heldout, design, found)
    # what belongs to one run alone is judged within it
    within = channels if run is None else {c for f in found if not f.lasting for c in f.channels}
    errors, found = folded_errors(design, found, sorted(within), seed)
    refuted: list[Refuted] = []
    if run is not None:
        errors = held_out_errors(run, found, design, channels, seed)
        found, refuted = judge(run, found, design, channels, seed)
    known = {f.term.key for f in found}
    return Assessment(
        selection=chosen,
        channels=tuple(channels),
        screening=screening,
        findings=tuple(found),
        refuted=tuple(refuted),
        heldout=run,
        errors=tuple(errors),
        remainder=tuple(_remainder(chosen, channels)),
        limits=tuple(x for effect in asked for x in detectability.limits(design, list(channels), effect, known)),
        experiment=_experiment(chosen, found),
        seed=seed,
        common=tuple(common_causes(chosen, channels)),
    )


def _remainder(chosen: Selection, channels: Sequence[int]) -> list[RemainderEntry]:
    """What white noise does not explain of what is left."""
    design, stack = chosen.design, chosen.design.stack
    scales = [max(1, round(s / stack.period)) for s in _SCALES_S]
    found: list[RemainderEntry] = []
    for c in channels:
        white = np.where(stack.weight[:, c] > 0.0, design.residual(chosen.terms, c), np.nan)
        ratios = noise.variance_ratio(white, scales)
        found += [
            {"channel": CHANNELS[c], "scale_s": m * stack.period, "ratio": ratio, "p": p, "common": None}
            for m, ratio, p in ratios
            if p < REMAINDER
        ]
    return found


def _experiment(chosen: Selection, found: Sequence[Finding]) -> SeparatingExperiment | None:
    """The run to make next: for the first finding that one separates from a rival, else what comes nearest."""
    disputed = [f for f in found if f.rivals][:_DISPUTED]
    if not disputed:
        return None
    design = chosen.design
    run = design.stack.blocks[0].run
    candidates = experiment.CandidateRuns(design, run)
    best: SeparatingExperiment | None = None
    for f in disputed:
        rest = [term for term in chosen.terms if term is not f.term]
        others = [r.term for r in f.rivals[:_RIVALS]]
        made = experiment.separating(design, f.term, f.theta, others, run, rest, candidates)
        if made is not None and (best is None or made.d_expected > best.d_expected):
            best = made
        if best is not None and best.d_expected >= SEPARATES:
            break
    return best


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
    remains = any(r["channel"] == CHANNELS[channel] for r in assessment.remainder)
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

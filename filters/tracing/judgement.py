"""What the held-out run says of each finding: its error falls with it, rises beyond chance, or neither can be told.

Of the 10 s means after the bias hold, E with everything and c what one finding says of them, in floors,

    D = mean of E² - (E + c)²,   below zero if the finding lowers the error

with an interval from windows drawn again in blocks, for neighbours are alike where there is drift, and from the noise
of the hold, which all windows share. What raises the error beyond the interval is refuted. What lowers it, or the
squares of the bias filter's innovations, beyond theirs is confirmed. The rest is neither.

Nothing here changes an error that is told: `held_out_run` has them with all that the runs at hand chose.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from filters.channels import error_unit
from filters.tracing import validation
from filters.tracing.design_matrix import Design
from filters.tracing.error_figure import DRAWS, rms
from filters.tracing.findings import Finding
from filters.tracing.held_out_run import HeldOutRun
from filters.tracing.whitening import whiten
from filters.types import Array

_FELT = 0.02  # of a block's noise: a correction that varies by less is not felt on the run
_LEAST = 8  # windows; fewer refute nothing


@dataclass(frozen=True, kw_only=True)
class Refuted:
    """A finding that the held-out run contradicts.

    Attributes
    ----------
    finding : Finding
    metric : str
        Of the errors,
    channel : int
        on the channel where they differ most,
    after_with, after_without : float
        with all that was chosen, and with what the effects file has, in
    unit : str
        this unit.
    """

    finding: Finding
    metric: str
    channel: int
    after_with: float
    after_without: float
    unit: str


@dataclass(frozen=True)
class _Errors:
    """Errors of the windows of a channel, over their floors.

    Attributes
    ----------
    none : Array
        Without any finding, shape (m,).
    of : dict
        What each finding says of them, by its term's key, shape (m,).
    hold : Array
        Standard deviation of the hold's bias in each, shape (m,).
    scale : float
        The nominal floor, SI.
    """

    none: Array
    of: dict[object, Array]
    hold: Array
    scale: float

    def after(self, found: Iterable[Finding]) -> Array:
        """Errors with findings, shape (m,)."""
        return self.none - sum((self.of[f.term.key] for f in found if f.term.key in self.of), np.zeros(self.none.size))


def judge(
    run: HeldOutRun, found: Sequence[Finding], design: Design, channels: Collection[int], seed: int
) -> tuple[list[Finding], list[Refuted]]:
    """Judge findings on a run that nothing was fitted to.

    Parameters
    ----------
    run : HeldOutRun
        With columns of all of them.
    found : sequence of Finding
        All that the runs at hand chose; each is judged beside all others.
    design : Design
        Of the runs at hand, for noise and drift.
    channels : collection of int
        Those with data.
    seed : int
        Of intervals.

    Returns
    -------
    list of Finding
        Those that are not refuted, with `confirmed` and `share`.
    list of Refuted
        Those that are.
    """
    lasting = [f for f in found if f.lasting]
    errors = {c: own for c in channels if (own := _errors(run, lasting, c)) is not None}
    judged = [_judged(run, f, lasting, design, errors, seed) for f in found]
    refuted: set[object] = {f.term.key for f, bad in judged if bad}
    joining = [f for f, bad in judged if not bad and f.lasting and f.confirmed]
    refuted |= _harmful_together(joining, errors, seed)
    used = [f for f in joining if f.term.key not in refuted]
    held = [
        replace(f, share=_share(f, used, errors) if f.lasting else f.share)
        for f, _ in judged
        if f.term.key not in refuted
    ]
    return held, [_refuted(f, lasting, used, errors) for f, _ in judged if f.term.key in refuted]


def _judged(
    run: HeldOutRun,
    f: Finding,
    lasting: Sequence[Finding],
    design: Design,
    errors: dict[int, _Errors],
    seed: int,
) -> tuple[Finding, bool]:
    """A finding with whether it is confirmed, and whether it is refuted."""
    if not f.lasting:
        return f, False
    own = run.correction([f])
    felt = [c for c in f.channels if not np.ptp(own[:, c]) < _FELT * design.sd[c]]
    there = [c for c in felt if c in errors]
    low, high = -np.inf, np.inf
    if there:
        parts = [(errors[c].after(lasting), errors[c].of[f.term.key], errors[c].hold) for c in there]
        low, high = _interval(parts, seed)
        if low > 0.0 and min(e.size for e, *_ in parts) >= _LEAST:
            return replace(f, confirmed=False), True
    lowers = high < 0.0 or (bool(felt) and _surprises(run, f, lasting, design, felt, seed)[1] < 0.0)
    return replace(f, confirmed=lowers), False


def _harmful_together(joining: Sequence[Finding], errors: dict[int, _Errors], seed: int) -> set[object]:
    """Keys of findings that help beside each other and together raise the error of their channel."""
    out: set[object] = set()
    for c, own in errors.items():
        mine = [f for f in joining if c in f.channels]
        if len(mine) < 2 or own.none.size < _LEAST:
            continue
        after = own.after(mine)
        if _interval([(after, own.none - after, own.hold)], seed)[0] > 0.0:
            out |= {f.term.key for f in mine if len(f.channels) == 1}
    return out


def _errors(run: HeldOutRun, found: Sequence[Finding], c: int) -> _Errors | None:
    own = [f for f in found if c in f.term.places]
    columns = np.column_stack([run.stack.y[:, c], *(run.columns[f.term.key, c] @ f.theta for f in own)])
    after = validation.after_hold(run.stack, columns, c)
    if after is None or len(after.seconds) < 2:
        return None
    white = float(run.white[c])
    floors = white * np.sqrt(1.0 / after.seconds + 1.0 / validation.HOLD_S)
    errors = after.errors / floors[:, None]
    hold = max(white / np.sqrt(validation.HOLD_S), after.hold_sd)
    nominal = white * float(np.sqrt(1.0 / validation.WINDOW_S + 1.0 / validation.HOLD_S))
    return _Errors(errors[:, 0], {f.term.key: errors[:, 1 + k] for k, f in enumerate(own)}, hold / floors, nominal)


def _interval(parts: Sequence[tuple[Array, Array, Array]], seed: int) -> tuple[float, float]:
    """95 % interval of D, summed over channels, each of errors with the finding, what it says, the hold's deviation."""
    rng = np.random.default_rng(seed)
    total = np.zeros(DRAWS)
    for e, c, hold in parts:
        picks = _blocks(rng, e.size)
        shared = rng.standard_normal(DRAWS) * np.mean((2.0 * hold * c)[picks], axis=1)
        total += np.mean((-2.0 * e * c - c**2)[picks], axis=1) - shared
    low, high = np.quantile(total, [0.025, 0.975])
    return float(low), float(high)


def _blocks(rng: np.random.Generator, m: int) -> Array:
    """Numbers of m windows drawn again in blocks of √m neighbours, shape (DRAWS, m)."""
    length = max(1, round(np.sqrt(m)))
    count = -(-m // length)
    first = rng.integers(0, m, (DRAWS, count, 1))
    return np.asarray(((first + np.arange(length)) % m).reshape(DRAWS, -1)[:, :m])


def _surprises(
    run: HeldOutRun, f: Finding, lasting: Sequence[Finding], design: Design, felt: Sequence[int], seed: int
) -> tuple[float, float]:
    """95 % interval of what a finding adds to the squares of the bias filter's innovations, over channels."""
    parts = []
    for c in felt:
        own = run.columns[f.term.key, c] @ f.theta
        everything = run.stack.y[:, c] - run.correction(lasting)[:, c]
        w = validation.windows(run.stack, np.column_stack([everything, own]), c)
        if w.t.size < 4:
            continue
        variance = float(run.white[c]) ** 2 / w.seconds
        nu = whiten(w.mean, w.t, np.array([0]), variance, design.drift[c])[0]
        parts.append((nu[:, 0], nu[:, 1], np.zeros(w.t.size)))
    return _interval(parts, seed) if parts else (-np.inf, np.inf)


def _share(f: Finding, used: Sequence[Finding], errors: dict[int, _Errors]) -> float | None:
    """Share of the excess of E10² over its floor that a finding removes beside those that are used; 0 to 1."""
    rest = [x for x in used if x is not f and x.term.key != f.term.key]
    there = [errors[c] for c in f.channels if c in errors]
    removed = sum(rms(own.after(rest)) ** 2 - rms(own.after([*rest, f])) ** 2 for own in there)
    excess = sum(rms(own.none) ** 2 - 1.0 for own in there)
    return validation.share_of(removed, excess, sum(own.none.size for own in there))


def _refuted(f: Finding, lasting: Sequence[Finding], used: Sequence[Finding], errors: dict[int, _Errors]) -> Refuted:
    def change(c: int) -> float:
        return rms(errors[c].after(lasting)) ** 2 - rms(errors[c].after(used)) ** 2

    c = max((c for c in f.channels if c in errors), key=change)
    unit, si = error_unit(c)
    scale = errors[c].scale / si
    return Refuted(
        finding=f,
        metric="e10",
        channel=c,
        after_with=rms(errors[c].after(lasting)) * scale,
        after_without=rms(errors[c].after(used)) * scale,
        unit=unit,
    )

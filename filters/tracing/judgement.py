"""What the held-out run says of each finding: its error falls with it, rises beyond chance, or neither can be told.

Of the 10 s means after the bias hold, E with all findings and c what one of them says, in floors,

    D = mean of E² - (E + c)²,   below zero if the finding lowers the error

with an interval from windows drawn again in blocks, for neighbours are alike where there is drift, and from the noise
of the hold, which all windows share. What raises the error beyond the interval is refuted. What lowers it beyond that,
or lowers it and the squares of the bias filter's innovations beyond theirs, is confirmed. The rest is neither. What is
not confirmed is left out one by one, the worst first, and the others are judged beside what is left: of two that stand
for each other one stays, and what only mends another's harm goes with it.

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
    """A finding that the held-out run contradicts."""

    finding: Finding
    metric: str  # of the errors,
    channel: int  # on the channel where they differ most,
    # after_with, after_without: with all that was chosen, and with what the effects file has, in
    after_with: float
    after_without: float
    unit: str


@dataclass(frozen=True)
class _Verdict:
    """D, whether it is below zero beyond chance, and whether above."""

    change: float
    confirmed: bool
    refuted: bool


@dataclass(frozen=True)
class _Errors:
    """Errors of the windows of a channel, over their floors."""

    none: Array  # without any finding, shape (m,)
    of: dict[object, Array]  # what each finding says of them, by its term's key, shape (m,)
    hold: Array  # standard deviation of the hold's bias in each, shape (m,)
    scale: float  # the nominal floor, SI

    def after(self, found: Iterable[Finding]) -> Array:
        """Errors with findings, shape (m,)."""
        return self.none - sum((self.of[f.term.key] for f in found if f.term.key in self.of), np.zeros(self.none.size))


def judge(
    run: HeldOutRun, found: Sequence[Finding], design: Design, channels: Collection[int], seed: int
) -> tuple[list[Finding], list[Refuted]]:
    """Judge findings on a run that nothing was fitted to.

    `found`: all that the runs at hand chose; each is judged beside all others.
    Returns those that are not refuted, with `confirmed` and `share`.
    Returns those that are.
    """
    lasting = [f for f in found if f.lasting]
    errors = {c: own for c in channels if (own := _errors(run, lasting, c)) is not None}
    bench = _Bench(run, design, errors, seed)
    used, doubted, refuted = bench.divided(lasting)
    told = {**dict.fromkeys((f.term.key for f in used), True), **dict.fromkeys((f.term.key for f in doubted), False)}
    held = [
        replace(f, confirmed=told[f.term.key], share=_share(f, used, errors)) if f.lasting else f
        for f in found
        if not f.lasting or f.term.key in told
    ]
    return held, [_refuted(f, lasting, used, errors) for f in refuted]


@dataclass(frozen=True)
class _Bench:
    """The held-out run with what is needed to judge on it."""

    run: HeldOutRun
    design: Design
    errors: dict[int, _Errors]
    seed: int

    def divided(self, lasting: Sequence[Finding]) -> tuple[list[Finding], list[Finding], list[Finding]]:
        """Findings that are confirmed beside each other, those that are neither, and those that are refuted."""
        used, doubted, refuted = list(lasting), list[Finding](), list[Finding]()
        while used:
            verdicts = [self._verdict(f, used) for f in used]
            left = [n for n, verdict in enumerate(verdicts) if not verdict.confirmed]
            if not left:
                break
            worst = max(left, key=lambda n: (verdicts[n].refuted, verdicts[n].change))
            (refuted if verdicts[worst].refuted else doubted).append(used.pop(worst))
        harmful = self._harmful_together(used)
        return [f for f in used if f not in harmful], doubted, refuted + harmful

    def _verdict(self, f: Finding, used: Sequence[Finding]) -> _Verdict:
        """On a finding beside others that are used with it."""
        own = self.run.correction([f])
        felt = [c for c in f.channels if not np.ptp(own[:, c]) < _FELT * self.design.sd[c]]
        parts = [self._part(f, used, c) for c in felt if c in self.errors]
        if not felt:
            return _Verdict(0.0, confirmed=False, refuted=False)
        if not parts:
            low, high = self._surprises(f, used, felt)
            return _Verdict(low, confirmed=high < 0.0, refuted=False)
        low, high = _interval(parts, self.seed)
        change = sum(float(np.mean(-2.0 * e * c - c**2)) for e, c, _ in parts)
        many = min(e.size for e, *_ in parts) >= _LEAST
        if low > 0.0 and many:
            return _Verdict(change, confirmed=False, refuted=True)
        lowers = high < 0.0 or (change < 0.0 and self._surprises(f, used, felt)[1] < 0.0)
        return _Verdict(change, confirmed=lowers, refuted=False)

    def _part(self, f: Finding, used: Sequence[Finding], c: int) -> tuple[Array, Array, Array]:
        own = self.errors[c]
        return own.after(used), own.of[f.term.key], own.hold

    def _harmful_together(self, used: Sequence[Finding]) -> list[Finding]:
        """Findings that help beside each other and together raise the error of their channel."""
        out: list[Finding] = []
        for c, own in self.errors.items():
            mine = [f for f in used if c in f.channels]
            if len(mine) < 2 or own.none.size < _LEAST:
                continue
            after = own.after(mine)
            if _interval([(after, own.none - after, own.hold)], self.seed)[0] > 0.0:
                out += [f for f in mine if len(f.channels) == 1]
        return out

    def _surprises(self, f: Finding, used: Sequence[Finding], felt: Sequence[int]) -> tuple[float, float]:
        """95 % interval of what a finding adds to the squares of the bias filter's innovations, over channels."""
        parts, run = [], self.run
        after = run.stack.y - run.correction(used)
        for c in felt:
            own = run.columns[f.term.key, c] @ f.theta
            w = validation.windows(run.stack, np.column_stack([after[:, c], own]), c)
            if w.t.size < 4:
                continue
            variance = float(run.white[c]) ** 2 / w.seconds
            nu = whiten(w.mean, w.t, np.array([0]), variance, self.design.drift[c])[0]
            parts.append((nu[:, 0], nu[:, 1], np.zeros(w.t.size)))
        return _interval(parts, self.seed) if parts else (-np.inf, np.inf)


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
        drawn = _redrawn(rng, np.column_stack([-2.0 * e * c - c**2, 2.0 * hold * c]))
        total += drawn[:, 0] - rng.standard_normal(DRAWS) * drawn[:, 1]
    low, high = np.quantile(total, [0.025, 0.975])
    return float(low), float(high)


def _redrawn(rng: np.random.Generator, values: Array) -> Array:
    """Means of m rows drawn again in blocks of √m neighbours, shape (DRAWS, k)."""
    m = len(values)
    length = max(1, round(np.sqrt(m)))
    sums = np.cumsum(np.vstack([np.zeros(values.shape[1]), values, values[:length]]), axis=0)
    blocks = (sums[length : length + m] - sums[:m]) / length
    return np.asarray(blocks[rng.integers(0, m, (DRAWS, -(-m // length)))].mean(axis=1))


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

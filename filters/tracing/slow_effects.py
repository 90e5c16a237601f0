"""Slow effects of a design as rivals of the drift of a channel: families of hypotheses, judged by evidence.

A family shares the prior probability of one cause: an effect's shapes and sizes. Chains of operators that do best are
sought between the numbers of their grid too.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import logsumexp

from filters.effects.drivers import Driver, near
from filters.effects.run_specific import RunSpecific, Tone
from filters.tracing.beside_drift import by_seconds, is_judged, rows_of
from filters.tracing.columns import Term, columns_on
from filters.tracing.design_matrix import Design
from filters.tracing.evidence import PICKS, VARIES, Candidates, Judge
from filters.tracing.spectrum import Whitening
from filters.tracing.whitening import Rows

# of the grid's spacing: how near to each other numbers of a chain are tried, one after the other
_REFINED = (1.0 / 3.0, 1.0 / 9.0, 1.0 / 27.0)
_ROWS, _ROWS_IN_ALL = 300, 1200  # at most of a power-on, and in all
_WITH_SLOPE = ("thermal_lag", "hysteresis", "thermal_rate", "cause:kink(temperature)", "cause:hold(temperature)")
_SPANNED = 0.9  # share of a term in others of its effect from which on they are not told apart
_DRIFT_ITSELF = ("driver:time hat",)  # a free curve in time is what drift is, in a single power-on


@dataclass(frozen=True)
class _Group:
    """Terms that act together; `is_sum`: with one factor, as a slope and its lag do in what follows T_tau."""

    terms: tuple[Term, ...]
    is_sum: bool = False


@dataclass(frozen=True)
class SlowRival:
    """A family of slow effects on a channel, by its most likely hypothesis: one term, or a slope and another."""

    terms: tuple[Term, ...]
    probability: float  # of the family
    gain: float  # as of `Rival`


class SlowEffects:
    """Slow effects of a design as rivals of drift."""

    def __init__(self, design: Design) -> None:
        self._design = design
        stack = design.stack
        longest = max(float(np.ptp(part)) for part in np.split(stack.t, stack.begins[1:]))
        self._row_s = max(1.0, stack.period, longest / _ROWS, stack.t.size * stack.period / _ROWS_IN_ALL)
        self._made: dict[object, Candidates] = {}
        self._known: dict[object, list[SlowRival]] = {}

    def rivals(self, selected: Sequence[Term], channel: int) -> list[SlowRival]:
        """Families that drift alone does not do for, beside what is selected, the most probable first."""
        # a tone that is faster than rows changes nothing in them
        kept = [a for a in selected if not (isinstance(a.hypothesis, Tone) and a.hypothesis.hz * self._row_s > 1.0)]
        key = channel, tuple(a.key for a in kept if channel in a.places)
        if key not in self._known:
            self._known[key] = self._judged(kept, channel)
        return self._known[key]

    def _judged(self, selected: Sequence[Term], channel: int) -> list[SlowRival]:
        taken = {a.key for a in selected}
        groups = [g for g in self._groups(channel) if g.terms[-1].key not in taken]
        if not groups:
            return []
        rows = rows_of(self._design, selected, channel, seconds=self._row_s)
        candidates = self._candidates(rows, channel, groups)
        used = candidates.whitening.used
        beside = rows.values[used, 1:]
        size = np.linalg.norm(beside, axis=0)
        beside = beside[:, size > VARIES * float(size.max(initial=0.0))]
        count = len(groups)
        refined = partial(self._refined, groups, channel, candidates.whitening)
        found = Judge(candidates, rows.values[used, 0], beside, refined).rivals()
        return [
            SlowRival(self._in_design(groups[r.best], taken, is_new=r.best >= count), r.probability, r.gain)
            for r in found
        ]

    def _in_design(self, group: _Group, taken: Collection[object], *, is_new: bool) -> tuple[Term, ...]:
        """Terms of a group that are not selected yet, with their columns in the design."""
        if not is_new:
            return tuple(a for a in group.terms if a.key not in taken)
        (term,) = group.terms
        columns = columns_on(self._design.stack, [term])
        return (self._design.add(term.hypothesis, columns[term.key, term.hypothesis.channel]),)

    def _refined(self, groups: list[_Group], channel: int, whitening: Whitening, judge: Judge) -> Candidates | None:
        """Chains between those of the grid that do best: one of each family, which `groups` then has too."""
        made, shares = [], []
        for numbers in judge.best(most=PICKS).values():
            found = [h for k in numbers if isinstance(h := groups[k].terms[-1].hypothesis, Driver) and h.refines]
            same = [a.hypothesis for g in groups for a in g.terms if found and a.hypothesis.effect == found[0].effect]
            grid = [own for own in same if isinstance(own, Driver)]
            for share in _REFINED if len(grid) > 1 else ():
                chains = [own.on(channel) for h in found for own in near(h, grid, share)]
                candidates = self._over([_of_one(own) for own in chains], channel, whitening)
                found = [chains[k] for own in judge.best(candidates).values() for k in own] or found
            for h in (h for h in found[:1] if h not in grid):
                made.append(_of_one(h))
                # it stands for as many of the numbers between those of the grid as do as well
                values = judge.values(candidates)
                size = len(h.shape) * float(np.log(share))
                shares.append(min(0.0, float(logsumexp(values) - values.max()) + size))
        groups += [_Group((term,)) for term in made]
        if not made:
            return None
        more = self._over(made, channel, whitening)
        more.shares = np.array(shares)[more.numbers]
        return more

    def _over(self, terms: Sequence[Term], channel: int, whitening: Whitening) -> Candidates:
        """Terms of one column that the design does not have, over the rows of a channel."""
        known = columns_on(self._design.stack, terms)
        raw = np.hstack([known[a.key, channel] for a in terms])
        columns = by_seconds(self._design, channel, raw, self._row_s).values[whitening.used]
        return Candidates(whitening, columns, list(np.arange(len(terms))[:, None]), [_family(a) for a in terms])

    def _groups(self, channel: int) -> list[_Group]:
        terms = [a for a in self._design.terms if channel in a.places and is_judged(a)]
        if self._design.stack.begins.size == 1:
            terms = [a for a in terms if _family(a) not in _DRIFT_ITSELF]
        slope = [a for a in terms if a.hypothesis.effect == "thermal_lin"]
        pairs = [(b, a) for b in slope for a in terms if _family(a) in _WITH_SLOPE]
        sums = [_Group(pair, is_sum=True) for pair in pairs if pair[1].hypothesis.effect == "thermal_lag"]
        return [*(_Group((a,)) for a in terms), *(_Group(pair) for pair in pairs), *sums]

    def _candidates(self, rows: Rows, channel: int, groups: Sequence[_Group]) -> Candidates:
        """Groups over the rows of a channel; channels with the same rows share them."""
        unit = float(np.median(rows.variance[np.isfinite(rows.variance)]))
        numbers = [np.concatenate([a.places[channel] for a in g.terms]) for g in groups]
        key = np.round(rows.variance / unit, 3).tobytes(), tuple(n.tobytes() for n in numbers)
        if key not in self._made:
            distinct, inverse = np.unique(np.concatenate(numbers), return_inverse=True)
            columns = by_seconds(self._design, channel, self._design.columns[:, distinct], self._row_s).values
            own = np.split(inverse, np.cumsum([n.size for n in numbers])[:-1])
            for k in (k for k, g in enumerate(groups) if g.is_sum):
                columns = np.column_stack([columns, columns[:, own[k]].sum(axis=1)])
                own[k] = np.array([columns.shape[1] - 1])
            whitening = Whitening(rows.t, rows.starts, rows.variance, self._row_s)
            families = [_family(g.terms[-1]) for g in groups]
            self._made[key] = Candidates(whitening, columns[whitening.used], own, families)
        return self._made[key]


def _of_one(h: Driver) -> Term:
    """A hypothesis of one column that no design has."""
    return Term(h, {h.channel: np.zeros(1, int)})


def _family(term: Term) -> str:
    """What shares the probability of one cause: an effect's shapes; of free curves those of one basis."""
    h = term.hypothesis
    if not isinstance(h, Driver):
        return h.effect
    if h.source == "motion" and (h.chain or h.kind == "settling"):
        return f"driver:{h.kind}"
    return h.effect if h.chain else f"{h.effect} {h.kind}"


def is_collinear(design: Design, accepted: Sequence[Term], term: Term) -> bool:
    """Return True if accepted terms of a slow term's own effect and channel span nearly all that it is.

    Each would take what the other lacks, with amplitudes that cancel where the data are and nowhere else.
    """
    if not is_judged(term) or isinstance(term.hypothesis, RunSpecific) or term.size != 1:
        return False
    (c,) = term.places
    family = [a for a in accepted if a.hypothesis.effect == term.hypothesis.effect and c in a.places and a is not term]
    return bool(family) and design.spanned(family, term, c) > _SPANNED

"""Which motion to make next: the one that is expected to tell most for each minute that it takes.

What a motion is expected to tell is counted in bits, of four kinds:

* between rivals: two hypotheses A and B of probabilities p and 1 - p, whose readings would differ by d standard
  deviations of the noise (`experiment`), are told apart by a Gaussian test of mutual information

      I(p, d) = H(p) - E[H(p | x)],   x ~ N(d, 1) under A, N(0, 1) under B;

  a finding and each of its rivals, and what scored and did not join, against nothing;
* on what is corrected: ½ log₂ of the ratio of each parameter's variance before and after;
* on what may act besides: the same of effects of the catalogue, times the probability that there is such an effect,
  greater on channels that are not explained;
* on what no effect of the catalogue stands for, such as memories of motion: one for a kind of motion that was not made.

Variances are those of all effects of the catalogue at once, each with its plausible size as prior, so that what only
others could be mixed to counts little. What it leaves out: which motions a table can make (`table_motions`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from filters.channels import CHANNELS
from filters.effects.run_specific import RunSpecific
from filters.tracing.assessment import Assessment, statuses
from filters.tracing.blocks import average
from filters.tracing.candidate_motions import CandidateMotion
from filters.tracing.columns import ColumnsByTerm, columns_on
from filters.tracing.design_matrix import first_parameters, parameters_on
from filters.tracing.experiment import Pair, white_on
from filters.tracing.stack import Stack
from filters.tracing.trace_document import odds_of
from filters.types import Array

WORTH = 1.0  # bits that a motion must be expected to tell
_BLOCK_S = 0.5
_SETTLED, _OPEN = 0.05, 0.3  # probability of a further effect on a channel that is explained, and on one that is not
_LEAST_ODDS = 1.0 / 32.0
EVIDENCE = 6.0  # of score, beyond which evidence would have decided
_RIVALS, _WEAK = 3, 6
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(41)


@dataclass(frozen=True)
class Dispute:
    """Two hypotheses of which one may be true."""

    channels: tuple[str, ...]
    # effects, the second "nothing" where it is whether the first acts at all, and the odds of each against drift alone
    names: tuple[str, str]
    odds: tuple[float, float]
    probability: float  # of the first, if it is one of the two
    pair: Pair
    share: float  # probability that it is one of the two


@dataclass(frozen=True)
class Expectation:
    """What a motion is expected to tell, bits."""

    motion: CandidateMotion
    rivals: float
    corrected: float
    besides: float
    new: float
    between: Dispute | None  # what it decides most of

    @property
    def bits(self) -> float:
        """All of it."""
        return self.rivals + self.corrected + self.besides + self.new


def disputes(known: Assessment) -> list[Dispute]:
    """What is not decided: findings against their rivals, and what scored and did not join against nothing."""
    design, chosen = known.design, known.selection
    made = []
    for f in known.findings:
        if not f.lasting:
            continue
        rest = [term for term in chosen.terms if term is not f.term]
        rivals = f.rivals[:_RIVALS]
        total = f.odds + sum(r.odds for r in rivals)
        for r in rivals:
            pair = Pair(design, f.term, f.theta, r.term, rest)
            names = f.term.hypothesis.effect, r.term.hypothesis.effect
            # explains the same part though its score is less: that may be a small error of form, so odds tell nothing
            even = r.score_difference < -EVIDENCE
            share = 1.0 if even else (f.odds + r.odds) / total
            probability = 0.5 if even else f.odds / (f.odds + r.odds)
            channels = tuple(CHANNELS[c] for c in f.channels)
            made.append(Dispute(channels, names, (f.odds, r.odds), probability, pair, share))
    weak = [(w, odds_of(w.score) if w.odds is None else w.odds) for w in chosen.weak]
    weak = [(w, odds) for w, odds in weak if odds > _LEAST_ODDS and not isinstance(w.term.hypothesis, RunSpecific)]
    for w, odds in sorted(weak, key=lambda each: -each[1])[:_WEAK]:
        channels = tuple(CHANNELS[c] for c in w.term.places)
        pair = Pair(design, w.term, w.theta, None, chosen.terms)
        made.append(
            Dispute(channels, (w.term.hypothesis.effect, "nothing"), (odds, 1.0), odds / (odds + 1.0), pair, 1.0)
        )
    return made


def information(p: float, d: float) -> float:
    """Bits that a Gaussian test of separation d tells between hypotheses of probabilities p and 1 - p."""
    if not 0.0 < p < 1.0:
        return 0.0
    weights = _WEIGHTS / _WEIGHTS.sum()
    prior = math.log(p / (1.0 - p))
    # log odds after: prior + d x - d²/2
    after = [prior + d * (_NODES + shift) - 0.5 * d * d for shift in (d, 0.0)]
    left = p * float(weights @ _entropy(after[0])) + (1.0 - p) * float(weights @ _entropy(after[1]))
    return max(0.0, float(_entropy(np.array(prior))) - left)


def _entropy(log_odds: Array) -> Array:
    """Of a choice of two, bits."""
    x = np.minimum(np.abs(log_odds), 500.0)
    small = np.exp(-x) / (1.0 + np.exp(-x))
    return np.asarray((np.log1p(np.exp(-x)) + small * x) / math.log(2.0))


class Planner:
    """What motions are expected to tell beside the runs at hand.

    `known`: what these show.
    `motions`: that can be made.
    `at_s`: when the next one begins, s since power-on.
    `overhead_s`: that comes to each motion: moves, begin and end of a recording.
    `before`: motions that were made, by their descriptions.
    """

    def __init__(
        self,
        known: Assessment,
        motions: Sequence[CandidateMotion],
        at_s: float,
        overhead_s: float,
        before: Sequence[str] = (),
    ) -> None:
        self.disputes = disputes(known)
        self._kinds = {_kind(description) for description in before}
        self._parameters = _Parameters(known)
        self._overhead = overhead_s
        self._told = [0.0] * len(self.disputes)  # bits that motions taken so far are expected to tell
        lasting = {term.key: term for each in self.disputes for term in each.pair.lasting}
        lasting |= {term.key: term for term in self._parameters.terms}
        like = replace(known.design.stack.blocks[-1].run, power_on="", begins=at_s, history_known=False)
        self._made: dict[int, tuple[CandidateMotion, Stack, ColumnsByTerm]] = {}
        for number, motion in enumerate(motions):
            run = replace(motion.run(like), begins=at_s)
            stack = Stack.of([average(run, max(_BLOCK_S, 1.0 / motion.rate_hz))])
            self._made[number] = motion, stack, columns_on(stack, list(lasting.values()))

    def chosen(self, seconds: float, *, only_new: bool = False) -> list[Expectation]:
        """The motions to make next, the best one at least, and others as long as they fit into some seconds.

        Each is what tells most for its time beside those before it. Empty where no motion is worth it; with `only_new`
        those are not which are of a kind that was made.
        """
        out: list[Expectation] = []
        while self._made:
            every = {number: self._expectation(number) for number in self._made}
            each = {number: e for number, e in every.items() if e.bits >= WORTH and (e.new > 0.0 or not only_new)}
            if not each:
                break
            number = max(each, key=lambda n: each[n].bits / (each[n].motion.seconds + self._overhead))
            left = seconds - sum(e.motion.seconds + self._overhead for e in out)
            if out and each[number].motion.seconds + self._overhead > left:
                break
            out.append(each[number])
            self._take(number)
        return out

    def best_bits(self) -> float:
        """Most that a motion is expected to tell."""
        return max((self._expectation(number).bits for number in self._made), default=0.0)

    def _expectation(self, number: int) -> Expectation:
        motion, stack, columns = self._made[number]
        told = [
            max(0.0, q.share * information(q.probability, q.pair.added(stack, columns)) - before)
            for q, before in zip(self.disputes, self._told, strict=True)
        ]
        best = int(np.argmax(told)) if told and max(told) > 0.01 else None
        corrected, besides = self._parameters.told(stack, columns)
        new = 0.0 if _kind(motion.description) in self._kinds else WORTH
        return Expectation(motion, sum(told), corrected, besides, new, None if best is None else self.disputes[best])

    def _take(self, number: int) -> None:
        motion, stack, columns = self._made.pop(number)
        self._kinds.add(_kind(motion.description))
        for place, q in enumerate(self.disputes):
            self._told[place] = q.share * information(q.probability, q.pair.added(stack, columns))
            q.pair.take(stack, columns)
        self._parameters.take(stack, columns)


def _kind(description: str) -> str:
    """What a motion is, at whatever tilt it is made."""
    return description.partition(" with ")[0]


class _Parameters:
    """Parameters of what is corrected and of all else in the catalogue that motion shows, with what is known."""

    def __init__(self, known: Assessment) -> None:
        self._design = design = known.design
        found = [f.term for f in known.findings if f.lasting]
        own = {term.key for term in found}
        status = statuses(known)
        others = [
            term
            for term in design.terms
            if term.key not in own
            and not term.hypothesis.is_free
            and term.hypothesis.source == "motion"
            and not term.hypothesis.at_blocks
            and any(design.sd[c] > 0.0 for c in term.places)
        ]
        self.terms = [*found, *others]
        self._firsts = first_parameters(self.terms)
        size = sum(term.size for term in self.terms)
        self._weight, prior = np.ones(size), np.empty(size)
        for first, term in zip(self._firsts, self.terms, strict=True):
            place = slice(first, first + term.size)
            prior[place] = [max(abs(p.prior * p.si), 1e-300) for p in term.hypothesis.parameters]
            if term.key not in own:
                open_ = any(status.get(CHANNELS[c]) not in ("clean", "explained", None) for c in term.places)
                self._weight[place] = (_OPEN if open_ else _SETTLED) / term.size
        self._corrected = np.arange(size) < sum(term.size for term in found)
        self._prior = prior
        known_of = np.zeros((size, size))
        for c in known.channels:
            rows, places = parameters_on(self.terms, self._firsts, c)
            known_of[np.ix_(rows, rows)] += design.gram(c)[0][np.ix_(places, places)]
        self._known = np.eye(size) + known_of * np.outer(prior, prior)
        self._before = np.diag(np.linalg.inv(self._known)) if size else np.zeros(0)
        self._channels = known.channels

    def told(self, stack: Stack, columns: ColumnsByTerm) -> tuple[float, float]:
        """Bits on what is corrected, and on what may act besides."""
        if not self.terms:
            return 0.0, 0.0
        after = np.diag(np.linalg.inv(self._known + self._information(stack, columns)))
        bits = 0.5 * np.log2(np.maximum(self._before / after, 1.0)) * self._weight
        return float(bits[self._corrected].sum()), float(bits[~self._corrected].sum())

    def take(self, stack: Stack, columns: ColumnsByTerm) -> None:
        """Count a motion as one that is made."""
        if self.terms:
            self._known += self._information(stack, columns)
            self._before = np.diag(np.linalg.inv(self._known))

    def _information(self, stack: Stack, columns: ColumnsByTerm) -> Array:
        """WᵀW of all parameters on a further run, over their priors."""
        out = np.zeros_like(self._known)
        for c in self._channels:
            here = [(first, term) for first, term in zip(self._firsts, self.terms, strict=True) if c in term.places]
            if not here:
                continue
            rows = np.concatenate([np.arange(first, first + term.size) for first, term in here])
            raw = np.column_stack([columns[term.key, c] for _, term in here]) * self._prior[rows]
            W = white_on(self._design, stack, raw, c)
            out[np.ix_(rows, rows)] += W.T @ W
        return out

"""Which effects are there: greedy selection among all hypotheses, run-specific effects and drift, on one scale.

    score = gain - K ln(n_s) - 2 ln(grid),   n_s seconds of data

A candidate joins if its score is above 9, if it also gains on cells that its fit has not seen (`unseen_gain`), and if
it still does so when both models have their own best drift process (`guarded_score`). Slow effects of a channel are
judged as rivals of its drift (`slow_effects`) and join at odds of 9:1. What scores and does not join is weak, with its
size and the size that would have joined.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from filters.effects.run_specific import RunSpecific, Step, Telegraph, Tone
from filters.tracing.beside_drift import (
    drift_price,
    fitted_beside,
    guarded_score,
    guarded_shared,
    is_judged,
    likeliest_drift,
    of_columns,
)
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design, Fit
from filters.tracing.left_out_runs import transfer_gains, unseen_gain
from filters.tracing.run_specific_search import search
from filters.tracing.slow_effects import SlowEffects, SlowRival, is_collinear
from filters.tracing.thermal_forms import JointChoice
from filters.tracing.trace_document import odds, odds_of
from filters.tracing.whitening import NONE, Drift
from filters.types import Array

ACCEPT = 9.0
KEEP = 4.5
_ROUNDS = 24
_TRIES = 6
_TEMPERATURE_SHARE = 0.9
_RANK = 0.01
_MOST_WEAK = 4  # of a channel
_PROBABLE = 0.9  # that some slow effect acts, from which the most probable is taken: odds of 9:1
_LIKELIER = 0.5  # the same where two levels would join otherwise, of which nothing is known
_ONCE = 0.7  # share of what an effect explains in 40 s from which on it is an event
_LISTED = 0.03  # probability of a slow effect below which it is not listed
_EVENT_CELLS = 4
_ACCEPT_ON_DRIFT = 30.0
"""Of a step, or of what channels share, beside drift: real drift has sudden turns that no Gaussian process has."""


@dataclass(frozen=True, kw_only=True)
class Weak:
    """What scored and was not accepted."""

    term: Term
    score: float  # without the guard,
    guarded: float  # and with it; 0 where it did not come so far
    why: str  # in words
    # theta, covariance: parameters as they would be, SI, shape (k,), and their covariance, shape (k, k)
    theta: Array
    covariance: Array
    # size of the first parameter, SI, that would have been accepted; None where size is not what it lacks
    limit: float | None
    odds: float | None = None  # of a slow effect beside drift, against drift alone


@dataclass
class Selection:
    """What was found."""

    design: Design  # data and columns
    terms: list[Term] = field(default_factory=list)  # accepted, in order
    weak: list[Weak] = field(default_factory=list)
    # gain on cells that the fit had not seen, by term's key
    unseen_gain: dict[object, float] = field(default_factory=dict)
    averages: dict[object, JointChoice] = field(default_factory=dict)  # averages of thermal forms, by term's key
    odds: dict[object, float] = field(default_factory=dict)  # of what was told by evidence, by term's key
    slow: SlowEffects = field(init=False, repr=False)  # slow effects as rivals of drift

    def __post_init__(self) -> None:
        self.slow = SlowEffects(self.design)

    def price(self, term: Term) -> float:
        """What a term's parameters and its choice cost."""
        h = term.hypothesis
        if isinstance(h, RunSpecific):
            k = term.size // 2 + 2 if isinstance(h, Tone) else term.size
            return k * self.log_seconds(term) + h.penalty
        return term.size * self.log_seconds(term) + 2.0 * float(np.log(h.grid))

    def log_seconds(self, term: Term) -> float:
        """ln of the seconds of data of its channels."""
        return float(np.log(max(2.0, float(np.mean([self.design.stack.seconds(c) for c in term.places])))))

    def own_gain(self, term: Term) -> float:
        """Gain of an accepted term beside the others."""
        rest = [a for a in self.terms if a is not term]
        return float(self.design.gains(rest, [term])[0])

    def odds_of(self, term: Term) -> float:
        """Odds that an accepted term acts, against drift and noise alone."""
        return self.odds.get(term.key, odds_of(self.own_gain(term) - self.price(term)))

    def fit(self) -> Fit:
        """Joint least-squares fit of all selected terms."""
        return self.design.fit(self.terms)

    def on(self, channel: int) -> list[Term]:
        """Accepted terms that act on a channel."""
        return [a for a in self.terms if channel in a.places]


def select(
    design: Design, channels: Sequence[int], progress: Callable[[float], None] = lambda share: None
) -> Selection:
    """Find what the data show.

    `design`: with the noise's multipliers set; its drifts are set here.
    """
    chosen = Selection(design)
    usable = [a for a in design.terms if any(c in channels for c in a.places)]
    memory: _Memory = {}
    for n in range(_ROUNDS):
        progress(n / _ROUNDS)
        if not _round(chosen, usable, channels, memory):
            gone = _drop_untransferred(chosen)
            if gone is None:
                break
            usable = [a for a in usable if a is not gone]
    _settle_drift(chosen, channels)
    _prune(chosen, KEEP)
    _list_weak(chosen, channels)
    progress(1.0)
    return chosen


@dataclass(frozen=True)
class _Candidate:
    """A term, or two, or a drift, of a channel (-1: shared); `drift` is the best beside it, None as it is."""

    score: float
    gain: float
    terms: tuple[Term, ...]
    channel: int
    drift: Drift | None = None
    odds: float | None = None  # of what is told by its evidence beside drift


@dataclass
class _Searched:
    """What is known of a channel in a state: candidates that were sought there, keys of those that failed a test."""

    state: object
    found: list[_Candidate] | None = None
    failed: set[object] = field(default_factory=set)


_Memory = dict[int, _Searched]  # by channel


def _known(chosen: Selection, channel: int, memory: _Memory) -> _Searched:
    """What is known of a channel as it is now."""
    state = tuple(a.key for a in chosen.on(channel)), chosen.design.drift[channel]
    if channel not in memory or memory[channel].state != state:
        memory[channel] = _Searched(state)
    return memory[channel]


def _round(chosen: Selection, usable: list[Term], channels: Sequence[int], memory: _Memory) -> bool:
    """Accept the best candidate that stands its tests; False if none does."""
    tries = dict.fromkeys((*channels, -1), 0)
    for candidate in _candidates(chosen, usable, channels, memory):
        if candidate.score <= ACCEPT:
            return False
        if not candidate.terms:
            assert candidate.drift is not None
            chosen.design.set_drift(candidate.channel, candidate.drift)
            _prune(chosen, KEEP)
            return True
        if tries[candidate.channel] >= _TRIES:
            continue
        tries[candidate.channel] += 1
        key = tuple(a.key for a in candidate.terms)
        known = _known(chosen, candidate.channel, memory) if candidate.channel >= 0 else _Searched(None)
        if key not in known.failed and _stands(chosen, candidate):
            _accept(chosen, candidate)
            return True
        known.failed.add(key)
    return False


def _accept(chosen: Selection, candidate: _Candidate) -> None:
    for term in candidate.terms:
        h = term.hypothesis
        if isinstance(h, RunSpecific) and not any(term is a for a in chosen.design.terms):
            term = chosen.design.add(h, h.made)
        chosen.terms.append(term)
        chosen.weak = [w for w in chosen.weak if _kind(w.term) != _kind(term)]
    if _by_evidence(candidate.terms[0]):
        _judge_again(chosen, candidate)
    for c in candidate.terms[0].places:
        if chosen.design.drift[c].level > 0.0:
            chosen.design.set_drift(c, likeliest_drift(chosen.design, chosen.terms, c)[1])
    _prune(chosen, KEEP)


def _judge_again(chosen: Selection, latest: _Candidate) -> None:
    """Let another slow effect take the place of one that was taken before the latest, if beside it that does better."""
    (c,) = latest.terms[0].places
    for term in [a for a in chosen.on(c) if _by_evidence(a) and a not in latest.terms]:
        rest = [a for a in chosen.terms if a is not term]
        rivals = chosen.slow.rivals(rest, c)
        if sum(r.probability for r in rivals) <= _PROBABLE:
            chosen.terms = rest
        elif rivals[0].terms and not any(a is term or is_collinear(chosen.design, rest, a) for a in rivals[0].terms):
            chosen.terms = [*rest, *rivals[0].terms]
            chosen.odds |= {a.key: _odds(rivals) for a in rivals[0].terms}


def _odds(rivals: Sequence[SlowRival]) -> float:
    """That one of some rivals acts, against drift alone."""
    p = sum(r.probability for r in rivals)
    return odds(p / max(1.0 - p, 1e-12))


def _by_evidence(term: Term) -> bool:
    """Whether a term is slow, of one channel and of all power-ons, and so is judged by its evidence beside drift."""
    return is_judged(term) and not isinstance(term.hypothesis, RunSpecific)


def _prune(chosen: Selection, least: float) -> None:
    """Drop terms whose own score has fallen: others explain it now."""
    while chosen.terms:
        scores = [_own_score(chosen, a) for a in chosen.terms]
        worst = int(np.argmin(scores))
        if scores[worst] >= least:
            return
        chosen.terms.pop(worst)


def _own_score(chosen: Selection, term: Term) -> float:
    """Score of an accepted term beside the others; of one told beside drift the gain under one drift says little."""
    drifts = chosen.design.drift[term.hypothesis.channel].level > 0.0
    if drifts and _by_evidence(term):
        return np.inf
    # a step beside drift leaves at half of what it joins at, as all else does
    more = 0.5 * (_ACCEPT_ON_DRIFT - ACCEPT) if drifts and isinstance(term.hypothesis, Step) else 0.0
    return chosen.own_gain(term) - chosen.price(term) - more


def _drop_untransferred(chosen: Selection) -> Term | None:
    """Drop the term that loses most on power-ons that are left out in turn; None if all gain there."""
    gains = transfer_gains(chosen.design, chosen.terms)
    lost = [a for a in chosen.terms if gains.get(a.key, 1.0) <= 0.0]
    if not lost:
        return None
    worst = min(lost, key=lambda a: gains[a.key])
    chosen.terms = [a for a in chosen.terms if a is not worst]
    score = float(chosen.design.gains(chosen.terms, [worst])[0]) - chosen.price(worst)
    why = "does not carry over from one power-on to the next"
    chosen.weak.append(weak_of(chosen, chosen.terms, worst, score, 0.0, why, None))
    return worst


def _candidates(
    chosen: Selection, usable: list[Term], channels: Sequence[int], memory: _Memory
) -> Iterator[_Candidate]:
    """All candidates, the best score first."""
    taken = {a.key for a in chosen.terms}
    free = [a for a in usable if a.key not in taken]
    gains = chosen.design.gains(chosen.terms, free)
    # of two that do as well the plainer one, which the catalogue has first
    scored = [
        _Candidate(
            float(g) - chosen.price(a) - _RANK * a.hypothesis.rank,
            float(g),
            (a,),
            next(iter(a.places)) if len(a.places) == 1 else -1,
        )
        for a, g in zip(free, gains, strict=True)
        if g > ACCEPT
    ]
    # what is slow is judged beside drift, which may be taken for it
    found = [x for x in scored if not is_judged(x.terms[0])]
    for c in channels:
        slow = [x for x in scored if x.channel == c and is_judged(x.terms[0])]
        own = _of_channel(chosen, c, memory, max((x.score for x in slow), default=0.0))
        found += _laws_first(own, [x for x in slow if x.terms[0].hypothesis.source == "temperature"])
    return iter(sorted(found, key=lambda candidate: -candidate.score))


def _laws_first(found: list[_Candidate], laws: list[_Candidate]) -> list[_Candidate]:
    """Candidates of a channel, steps after what follows temperature and gains nearly as much.

    Its rate steps where heating is turned on, and a step is sharper there than what is known of that rate.
    """
    most = max((x.gain for x in laws), default=0.0)
    alike = [x for x in laws if x.gain > _TEMPERATURE_SHARE * most]
    told = (x for x in found if x.odds is not None and x.terms[0].hypothesis.source == "temperature")
    law = next(told, min(alike, key=lambda x: x.terms[0].hypothesis.rank, default=None))
    steps = [x for x in found if x.terms and isinstance(x.terms[0].hypothesis, Step)]
    if law is None or not any(law.gain > _TEMPERATURE_SHARE * x.gain for x in steps):
        return found
    others = (x for x in found if x is not law)
    return [law, *(replace(x, score=min(x.score, law.score - _RANK)) if x in steps else x for x in others)]


def _of_channel(chosen: Selection, channel: int, memory: _Memory, slow: float) -> list[_Candidate]:
    """Run-specific and slow effects and drift of a channel, sought again only when something has changed there.

    `slow`: the best score of a slow effect beside drift as it is.
    """
    design = chosen.design
    known = _known(chosen, channel, memory)
    if known.found is not None:
        return known.found
    made = search(design, chosen.terms, channel)
    found = [_Candidate(gain - chosen.price(term), gain, (term,), channel) for term, gain in made]
    drifts = design.drift[channel].level > 0.0
    if not drifts:
        gain, drift = likeliest_drift(design, chosen.terms, channel)
        found.append(_Candidate(gain - drift_price(design, channel), gain, (), channel, drift))
    rivals = chosen.slow.rivals(chosen.terms, channel) if drifts or slow > ACCEPT else []
    # drift with its steps and levels has been weighed against it; a cause of levels that would join needs no more
    events = [x.score for x in found if x.terms and not isinstance(x.terms[0].hypothesis, Tone)]
    levels = any(x.score > ACCEPT and x.terms and isinstance(x.terms[0].hypothesis, Telegraph) for x in found)
    if sum(r.probability for r in rivals) > (_LIKELIER if levels else _PROBABLE):
        score = max(ACCEPT + rivals[0].gain, slow, *(x + _RANK for x in events))
        found.append(_Candidate(score, rivals[0].gain, rivals[0].terms, channel, odds=_odds(rivals)))
    known.found = found
    return found


def _stands(chosen: Selection, candidate: _Candidate) -> bool:
    """Whether a candidate gains on unseen cells, and beside drift; what it lacks is noted."""
    design, term = chosen.design, candidate.terms[0]
    if any(is_collinear(design, chosen.terms, each) for each in candidate.terms):
        _note(chosen, candidate, 0.0, "is not told from another of its family")
        return False
    if candidate.odds is not None:
        return _is_law(chosen, candidate)
    h = term.hypothesis
    made = h.made if isinstance(h, RunSpecific) else None
    if not isinstance(h, Step) and not _holds(chosen, candidate, made):
        if not isinstance(h, Telegraph):
            _note(chosen, candidate, 0.0, "does not hold on cells that were left out")
        return False
    drifts = any(design.drift[c].level > 0.0 for c in term.places)
    if len(term.places) > 1:
        guarded = guarded_shared(design, chosen.terms, term, chosen.price(term))
    else:
        guarded = guarded_score(design, chosen.terms, term, made, chosen.price(term))
        drifts &= isinstance(h, Step)
    if guarded <= (_ACCEPT_ON_DRIFT if drifts else ACCEPT):
        _note(chosen, candidate, guarded, "not told from drift")
        return False
    return True


def _is_law(chosen: Selection, candidate: _Candidate) -> bool:
    """Whether slow effects that were told by their evidence showed more than once: else it was an event."""
    design, c, terms = chosen.design, candidate.channel, candidate.terms
    drift = likeliest_drift(design, [*chosen.terms, *terms], c)[1] if design.drift[c].level > 0.0 else NONE
    columns = np.column_stack([design.columns[:, a.places[c]] for a in terms])
    theta, _ = fitted_beside(design, chosen.terms, c, columns, drift)
    said = np.bincount(design.stack.cell, design.white((columns @ theta)[:, None], c, drift)[:, 0] ** 2)
    # what happens at the end of a cell goes on in the next
    together = np.convolve(said, [1.0, 1.0])
    if together.max() > _ONCE * said.sum():
        _note(chosen, candidate, 0.0, "shows once only: an event would do as well")
        return False
    for term in terms:
        others = [*chosen.terms, *(a for a in terms if a is not term)]
        drifts = [drift if k == c else d for k, d in enumerate(design.drift)]
        chosen.unseen_gain[term.key] = unseen_gain(design, others, term, None, drifts)[0]
        chosen.odds[term.key] = candidate.odds or 0.0
    return True


def _holds(chosen: Selection, candidate: _Candidate, made: Array | None) -> bool:
    """Whether a term gains enough on unseen cells."""
    (term,) = candidate.terms
    # noise of two levels is there all the time: what happened a few times is an event
    spread = isinstance(term.hypothesis, Telegraph)
    total, without = unseen_gain(chosen.design, chosen.terms, term, made, None, _EVENT_CELLS if spread else 1)
    chosen.unseen_gain[term.key] = total
    return total > 0.5 * candidate.gain and without > (0.3 * candidate.gain if spread else 0.0)


def _note(chosen: Selection, candidate: _Candidate, guarded: float, why: str) -> None:
    """List a candidate as weak, in the place of the same effect there where that scored less."""
    for term in candidate.terms:
        rest = [*chosen.terms, *(a for a in candidate.terms if a is not term)]
        made = weak_of(chosen, rest, term, candidate.score, guarded, why, candidate.drift)
        others = [w for w in chosen.weak if _kind(w.term) == _kind(term)]
        if all(w.score < made.score or w.term.key == term.key for w in others):
            chosen.weak = [*(w for w in chosen.weak if _kind(w.term) != _kind(term)), made]


def _kind(term: Term) -> tuple[str, tuple[int, ...]]:
    return term.hypothesis.effect, term.hypothesis.channels


def weak_of(
    chosen: Selection, rest: Sequence[Term], term: Term, score: float, guarded: float, why: str, drift: Drift | None
) -> Weak:
    """A term that is not accepted, with its size and the size that would have been.

    `rest`: what it is fitted beside.
    `score`, `guarded`: without the guard and with it; `guarded` 0 where it did not come so far.
    `drift`: that of its channel beside it; None: as it is.
    """
    design, h = chosen.design, term.hypothesis
    if len(term.places) > 1:
        theta, covariance = design.fit([*rest, term]).of(len(rest))
    else:
        ((c, places),) = term.places.items()
        columns = h.made if isinstance(h, RunSpecific) else design.columns[:, places]
        if drift is None and not isinstance(h, Tone):
            # where drift would do as well its sd is that beside drift
            drift = of_columns(design, rest, c, columns).likeliest_with(0)
        theta, covariance = fitted_beside(design, rest, c, columns, design.drift[c] if drift is None else drift)
    gain = min(score, guarded or score) + chosen.price(term)
    limit = None
    if min(score, guarded or score) <= ACCEPT and gain > 0.0 and theta.size == 1:
        limit = float(abs(theta[0]) * np.sqrt((ACCEPT + chosen.price(term)) / gain))
    return Weak(term=term, score=score, guarded=guarded, why=why, theta=theta, covariance=covariance, limit=limit)


def _list_weak(chosen: Selection, channels: Sequence[int]) -> None:
    """List slow effects whose odds against drift are too small to be used: the best form of each."""
    taken = {_kind(a) for a in (*chosen.terms, *(w.term for w in chosen.weak))}
    for c in (c for c in channels if chosen.design.drift[c].level > 0.0):
        rivals = [r for r in chosen.slow.rivals(chosen.terms, c) if r.probability > _LISTED]
        for r in [r for r in rivals if not r.terms[-1].hypothesis.is_free or len(rivals) == 1][:_MOST_WEAK]:
            if _kind(r.terms[-1]) not in taken:
                why = "may act beside drift, which alone would do as well"
                made = weak_of(chosen, [*chosen.terms, *r.terms[:-1]], r.terms[-1], r.gain, 0.0, why, None)
                chosen.weak.append(replace(made, odds=_odds([r])))


def _settle_drift(chosen: Selection, channels: Sequence[int]) -> None:
    """Drift as it is beside all that was found; none where none is needed any more."""
    for c in channels:
        if chosen.design.drift[c].level > 0.0:
            gain, drift = likeliest_drift(chosen.design, chosen.terms, c)
            chosen.design.set_drift(c, drift if gain - drift_price(chosen.design, c) > KEEP else NONE)

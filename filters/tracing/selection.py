"""Which effects are there: greedy selection among all hypotheses, run-specific effects and drift, on one scale.

    score = gain - K ln(n_s) - 2 ln(grid),   n_s seconds of data

A candidate joins if its score is above 9, if it also gains on cells that its fit has not seen (`unseen_cells`), and if
it still does so when both models have their own best drift process (`drift_guard`). What fails the guard is weak: not
told from drift.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from filters.effects.run_specific import RunSpecific, Step, Tone
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design, Fit
from filters.tracing.drift_guard import drift_price, guarded_score, likeliest_drift
from filters.tracing.run_specific_search import search
from filters.tracing.unseen_cells import unseen_gain
from filters.tracing.whitening import NONE, Drift
from filters.types import Array

ACCEPT = 9.0
KEEP = 4.5
_ROUNDS = 24
_TRIES = 6
_TEMPERATURE_SHARE = 0.9
_RANK = 0.01
_ORDER = (
    "thermal_lin",
    "scale",
    "cross_axis",
    "warmup",
    "ramp",
    "thermal_rate",
    "thermal_lag",
    "g_sensitivity",
    "asymmetry",
    "nonlinearity_quadratic",
    "nonlinearity_cubic",
    "g_squared",
    "harmonic",
    "thermal_poly",
    "hysteresis",
    "thermal_scale",
)


@dataclass(frozen=True)
class Weak:
    """What scored and could not be told from drift, or did not gain on cells that it had not seen.

    Attributes
    ----------
    term : Term
    score : float
        Without the guard,
    guarded : float
        and with it; 0 where it did not come so far.
    why : str
        In words.
    """

    term: Term
    score: float
    guarded: float
    why: str


@dataclass
class Selection:
    """What was found.

    Attributes
    ----------
    design : Design
        Data and columns.
    terms : list of Term
        Accepted, in order.
    weak : list of Weak
    unseen_gain : dict
        Gain on cells that the fit had not seen, by term's key.
    """

    design: Design
    terms: list[Term] = field(default_factory=list)
    weak: list[Weak] = field(default_factory=list)
    unseen_gain: dict[object, float] = field(default_factory=dict)

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

    Parameters
    ----------
    design : Design
        With the noise's multipliers set; its drifts are set here.
    channels : sequence of int
        Those with data.
    progress : callable
        Told a share from 0 to 1.

    Returns
    -------
    Selection
    """
    chosen = Selection(design)
    usable = [a for a in design.terms if any(c in channels for c in a.places)]
    searched: _Searched = {}
    for n in range(_ROUNDS):
        progress(n / _ROUNDS)
        if not _round(chosen, usable, channels, searched):
            break
    _settle_drift(chosen, channels)
    _prune(chosen, KEEP)
    progress(1.0)
    return chosen


@dataclass(frozen=True)
class _Candidate:
    score: float
    gain: float
    term: Term | None
    channel: int
    drift: Drift = NONE


_Searched = dict[int, tuple[object, list[_Candidate]]]  # by channel: the state it was searched in, and what was found


def _round(chosen: Selection, usable: list[Term], channels: Sequence[int], searched: _Searched) -> bool:
    """Accept the best candidate that stands its tests; False if none does."""
    tries = dict.fromkeys((*channels, -1), 0)
    for candidate in _candidates(chosen, usable, channels, searched):
        if candidate.score <= ACCEPT:
            return False
        if candidate.term is None:
            chosen.design.set_drift(candidate.channel, candidate.drift)
            _prune(chosen, KEEP)
            return True
        if tries[candidate.channel] >= _TRIES:
            continue
        tries[candidate.channel] += 1
        if _stands(chosen, candidate):
            _accept(chosen, candidate)
            return True
    return False


def _accept(chosen: Selection, candidate: _Candidate) -> None:
    term = candidate.term
    assert term is not None
    h = term.hypothesis
    if isinstance(h, RunSpecific) and not any(term is a for a in chosen.design.terms):
        term = chosen.design.add(h, h.made)
    chosen.terms.append(term)
    chosen.weak = [w for w in chosen.weak if w.term.key != term.key]
    for c in term.places:
        if chosen.design.drift[c].level > 0.0:
            chosen.design.set_drift(c, likeliest_drift(chosen.design, chosen.terms, c)[1])
    _prune(chosen, KEEP)


def _prune(chosen: Selection, least: float) -> None:
    """Drop terms whose own score has fallen: others explain it now."""
    while chosen.terms:
        scores = [chosen.own_gain(a) - chosen.price(a) for a in chosen.terms]
        worst = int(np.argmin(scores))
        if scores[worst] >= least:
            return
        chosen.terms.pop(worst)


def _candidates(
    chosen: Selection, usable: list[Term], channels: Sequence[int], searched: _Searched
) -> Iterator[_Candidate]:
    """All candidates, the best score first."""
    taken = {a.key for a in chosen.terms}
    free = [a for a in usable if a.key not in taken]
    gains = chosen.design.gains(chosen.terms, free)
    _strike_time(free, gains)
    # of two that do as well the plainer one, which the catalogue has first
    found = [
        _Candidate(
            float(g) - chosen.price(a) - _RANK * rank(a),
            float(g),
            a,
            next(iter(a.places)) if len(a.places) == 1 else -1,
        )
        for a, g in zip(free, gains, strict=True)
        if g > ACCEPT
    ]
    for c in channels:
        found += _of_channel(chosen, c, searched)
    return iter(sorted(found, key=lambda candidate: -candidate.score))


def _of_channel(chosen: Selection, channel: int, searched: _Searched) -> list[_Candidate]:
    """Run-specific effects and drift of a channel, sought again only when something has changed there."""
    design = chosen.design
    state = tuple(a.key for a in chosen.on(channel)), design.drift[channel]
    before, found = searched.get(channel, (None, []))
    if before == state:
        return found
    made = search(design, chosen.terms, channel)
    found = [_Candidate(gain - chosen.price(term), gain, term, channel) for term, gain in made]
    if design.drift[channel].level == 0.0:
        gain, drift = likeliest_drift(design, chosen.terms, channel)
        found.append(_Candidate(gain - drift_price(design, channel), gain, None, channel, drift))
    searched[channel] = state, found
    return found


def rank(term: Term) -> int:
    """Place of an effect in the catalogue; free curves come last."""
    name = term.hypothesis.effect
    return _ORDER.index(name) if name in _ORDER else len(_ORDER)


def _strike_time(terms: list[Term], gains: Array) -> None:
    """Time is nobody's cause: a curve in it goes where temperature does nearly as well. In place."""
    best = np.zeros(6)
    for term, gain in zip(terms, gains.tolist(), strict=True):
        if term.hypothesis.source == "temperature":
            c = next(iter(term.places))
            best[c] = max(best[c], gain)
    for k, term in enumerate(terms):
        if term.hypothesis.effect == "driver:time" and best[next(iter(term.places))] > _TEMPERATURE_SHARE * gains[k]:
            gains[k] = 0.0


def _stands(chosen: Selection, candidate: _Candidate) -> bool:
    """Whether a candidate gains on unseen cells, and beside drift; what it lacks is noted."""
    term, design = candidate.term, chosen.design
    assert term is not None
    h = term.hypothesis
    made = h.made if isinstance(h, RunSpecific) else None
    if not isinstance(h, Step):
        total, without = unseen_gain(design, chosen.terms, term, made)
        if not (total > 0.5 * candidate.gain and without > 0.0):
            _note(chosen, candidate, 0.0, "does not hold on cells that were left out")
            return False
        chosen.unseen_gain[term.key] = total
    if len(term.places) > 1:
        return True
    guarded = guarded_score(design, chosen.terms, term, made, chosen.price(term), ACCEPT)
    if guarded <= ACCEPT:
        _note(chosen, candidate, guarded, "not told from drift")
        return False
    return True


def _note(chosen: Selection, candidate: _Candidate, guarded: float, why: str) -> None:
    assert candidate.term is not None
    chosen.weak = [w for w in chosen.weak if w.term.key != candidate.term.key]
    chosen.weak.append(Weak(candidate.term, candidate.score, guarded, why))


def _settle_drift(chosen: Selection, channels: Sequence[int]) -> None:
    """Drift as it is beside all that was found; none where none is needed any more."""
    for c in channels:
        if chosen.design.drift[c].level > 0.0:
            gain, drift = likeliest_drift(chosen.design, chosen.terms, c)
            chosen.design.set_drift(c, drift if gain - drift_price(chosen.design, c) > KEEP else NONE)

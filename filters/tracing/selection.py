"""Which effects are there: greedy selection among all hypotheses, events and drift, on one scale.

    score = gain - K ln(n_s) - 2 ln(grid),   n_s seconds of data

A candidate joins if its score is above 9, if it also gains on cells that its fit has not seen, and if it still does so
when both models have their own best drift process (the drift guard). What fails the guard is weak: not told from drift.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from filters.effects import run_specific
from filters.effects.run_specific import RunSpecific
from filters.tracing.design_matrix import Design, Fit, Term
from filters.tracing.whitening import NONE, Drift, best_drift, best_pair, unbiased
from filters.types import Array

ACCEPT = 9.0
KEEP = 4.5
_ROUNDS = 24
_TRIES = 6
_DRIFT_GRID = 20.0
_SECOND = 1.0
_FAST_HZ = 0.2
"""Faster tones are lost in means of 1 s."""
_TEMPERATURE_SHARE = 0.9
_BAND = 0.01
_TONES_A_BAND = 3
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
    """What scored and could not be told from drift, or did not gain on cells that it had not seen."""

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
    heldout : dict
        Gain on unseen cells by term's key.
    """

    design: Design
    terms: list[Term] = field(default_factory=list)
    weak: list[Weak] = field(default_factory=list)
    heldout: dict[object, float] = field(default_factory=dict)
    _searched: dict[int, tuple[object, list["_Candidate"]]] = field(default_factory=dict)

    def price(self, term: Term) -> float:
        """What a term's parameters and its choice cost."""
        h = term.hypothesis
        if isinstance(h, RunSpecific):
            k = term.size // 2 + 2 if isinstance(h, run_specific.Tone) else term.size
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
        """Joint fit of all."""
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
    for n in range(_ROUNDS):
        progress(n / _ROUNDS)
        if not _round(chosen, usable, channels):
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


def _round(chosen: Selection, usable: list[Term], channels: Sequence[int]) -> bool:
    """Accept the best candidate that stands its tests; False if none does."""
    tries = dict.fromkeys((*channels, -1), 0)
    for candidate in _candidates(chosen, usable, channels):
        if candidate.score <= ACCEPT:
            return False
        if candidate.term is None:
            _set_drift(chosen.design, candidate.channel, candidate.drift)
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
            _set_drift(chosen.design, c, _drift_of(chosen, c)[1])
    _prune(chosen, KEEP)


def _prune(chosen: Selection, least: float) -> None:
    """Drop terms whose own score has fallen: others explain it now."""
    while chosen.terms:
        scores = [chosen.own_gain(a) - chosen.price(a) for a in chosen.terms]
        worst = int(np.argmin(scores))
        if scores[worst] >= least:
            return
        chosen.terms.pop(worst)


def _candidates(chosen: Selection, usable: list[Term], channels: Sequence[int]) -> Iterator[_Candidate]:
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
        found += _searched(chosen, c)
    return iter(sorted(found, key=lambda candidate: -candidate.score))


def _searched(chosen: Selection, channel: int) -> list[_Candidate]:
    """Events and drift of a channel, sought again only when something has changed there."""
    state = tuple(a.key for a in chosen.on(channel)), chosen.design.drift[channel]
    before, found = chosen._searched.get(channel, (None, []))
    if before == state:
        return found
    found = _events(chosen, channel)
    if chosen.design.drift[channel].level == 0.0:
        gain, drift = _drift_of(chosen, channel)
        price = 2.0 * float(np.log(chosen.design.stack.seconds(channel))) + 2.0 * float(np.log(_DRIFT_GRID))
        found.append(_Candidate(gain - price, gain, None, channel, drift))
    chosen._searched[channel] = state, found
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


def _events(chosen: Selection, channel: int) -> list[_Candidate]:
    """The best tone, step and two-level noise of a channel."""
    design, stack = chosen.design, chosen.design.stack
    white = design.residual(chosen.terms, channel)
    variance = design.variance(channel)
    r = chosen.design.unexplained(chosen.terms, channel)
    plain = unbiased(r[:, None], stack.run, variance)[:, 0]
    own = np.concatenate([a.places[channel] for a in chosen.on(channel)]) if chosen.on(channel) else np.zeros(0, int)
    basis = np.zeros((stack.t.size, 0))
    if own.size:
        basis = np.linalg.qr(unbiased(design.columns[:, own], stack.run, variance))[0]
    made: list[RunSpecific | None] = [
        run_specific.tone(channel, white, stack.t, stack.starts, stack.period, run_specific.TONE_HZ)
    ]
    if _uneven(plain):
        made.append(run_specific.step(channel, plain, basis, stack.t, stack.starts))
        mean = np.bincount(stack.run, r / variance) / np.maximum(np.bincount(stack.run, 1.0 / variance), 1e-300)
        made.append(run_specific.telegraph(channel, r - mean[stack.run], np.sqrt(variance), stack.starts))
    taken = {a.key for a in chosen.terms}
    out = []
    for event in made:
        if event is None or _crowded(chosen, event):
            continue
        term = Term(event, {channel: np.arange(event.made.shape[1])})
        if term.key in taken:
            continue
        gain = _event_gain(chosen, event, channel, own)
        out.append(_Candidate(gain - chosen.price(term), gain, term, channel))
    return out


def _crowded(chosen: Selection, event: RunSpecific) -> bool:
    """Whether so many tones are here already that one more is part of a narrow band, not a tone of its own."""
    near = [
        a
        for a in chosen.on(event.channel)
        if isinstance(a.hypothesis, run_specific.Tone)
        and isinstance(event, run_specific.Tone)
        and abs(a.hypothesis.hz - event.hz) < _BAND * event.hz
    ]
    return len(near) >= _TONES_A_BAND


def _uneven(white: Array) -> bool:
    """Whether sums over 16 rows vary more than white noise lets them: else there is no step to look for."""
    size = white.size // 16 * 16
    sums = white[:size].reshape(-1, 16).sum(axis=1)
    return bool(float(sums @ sums) / max(1, sums.size) / 16.0 > 1.0 + 2.0 * np.sqrt(2.0 / max(1, sums.size)))


def _event_gain(chosen: Selection, event: RunSpecific, channel: int, own: Array) -> float:
    W = chosen.design.white(
        np.column_stack([chosen.design.stack.y[:, channel], chosen.design.columns[:, own.astype(int)], event.made]),
        channel,
    )
    return _drop(W, own.size)


def _drop(W: Array, size: int) -> float:
    """Drop of the squared norm of column 0 when those after the first `size` join the fit."""
    y, X = W[:, 0], W[:, 1:]
    scale = np.linalg.norm(X, axis=0)
    X = X / np.where(scale > 0.0, scale, 1.0)
    full = X @ np.linalg.lstsq(X.T @ X, X.T @ y, rcond=1e-9)[0]
    part = X[:, :size] @ np.linalg.lstsq(X[:, :size].T @ X[:, :size], X[:, :size].T @ y, rcond=1e-9)[0]
    return float(np.sum((y - part) ** 2) - np.sum((y - full) ** 2))


# ------------------------------------------------------------------------------------------------------------- tests


def _stands(chosen: Selection, candidate: _Candidate) -> bool:
    """Held-out cells and the drift guard."""
    term, design = candidate.term, chosen.design
    assert term is not None
    h = term.hypothesis
    columns = h.made if isinstance(h, RunSpecific) else None
    if not isinstance(h, run_specific.Step):
        total, without = design.heldout(chosen.terms, term, columns)
        if not (total > 0.5 * candidate.gain and without > 0.0):
            _note(chosen, candidate, 0.0, "does not hold on cells that were left out")
            return False
        chosen.heldout[term.key] = total
    if len(term.places) > 1:
        return True
    guarded = _guard(chosen, term, columns)
    if guarded <= ACCEPT:
        _note(chosen, candidate, guarded, "not told from drift")
        return False
    return True


def _note(chosen: Selection, candidate: _Candidate, guarded: float, why: str) -> None:
    assert candidate.term is not None
    chosen.weak = [w for w in chosen.weak if w.term.key != candidate.term.key]
    chosen.weak.append(Weak(candidate.term, candidate.score, guarded, why))


def _guard(chosen: Selection, term: Term, columns: Array | None) -> float:
    """Score of a term when both models have their own best drift, of one process or, if that passes, of two."""
    design = chosen.design
    (c,) = term.places
    own = columns if columns is not None else design.columns[:, term.places[c]]
    fast = isinstance(term.hypothesis, run_specific.Tone) and term.hypothesis.hz > _FAST_HZ
    seconds = design.stack.period if fast else _SECOND
    rows = _drift_rows(chosen, c, np.zeros((own.shape[0], 0)), design.fit(chosen.terms), seconds)
    # an event's columns are not in the design: what is shared stays as it was then
    fit = design.fit(chosen.terms if columns is not None else [*chosen.terms, term])
    with_it = _drift_rows(chosen, c, own, fit, seconds)
    before, after = (best_drift(*each) for each in (rows, with_it))
    single = min(before[0], before[2]) - min(after[0], after[2]) - chosen.price(term)
    if single <= ACCEPT:
        return single
    pairs = [min(one[0], one[2], best_pair(*each, one[1])) for each, one in ((rows, before), (with_it, after))]
    return min(single, pairs[0] - pairs[1] - chosen.price(term))


def _drift_of(chosen: Selection, channel: int) -> tuple[float, Drift]:
    """Gain of the best drift process of a channel, and it."""
    rows = _drift_rows(chosen, channel, np.zeros((chosen.design.stack.t.size, 0)), chosen.fit())
    best, drift, none = best_drift(*rows)
    walk = best_drift(*rows, taus=(np.inf,))
    # a walk has one parameter less
    if walk[0] - best < np.log(chosen.design.stack.seconds(channel)):
        return none - walk[0], walk[1]
    return none - best, drift


def _drift_rows(
    chosen: Selection, channel: int, more: Array, fit: Fit, seconds: float = _SECOND
) -> tuple[Array, Array, NDArray[np.int_], Array, float]:
    """Rows of 1 s, or so many, for `best_drift`: what is selected, and more columns; shared effects as in a fit."""
    design, stack = chosen.design, chosen.design.stack
    y = stack.y[:, channel].copy()
    for term, theta in zip(fit.terms, fit.theta, strict=True):
        if channel in term.places and len(term.places) > 1:
            y -= design.columns[:, term.places[channel]] @ theta
    own = [design.columns[:, a.places[channel]] for a in chosen.on(channel) if len(a.places) == 1]
    raw = np.column_stack([y, *own, more])
    return (*by_seconds(design, channel, raw, seconds), max(seconds, stack.period))


def by_seconds(
    design: Design, channel: int, raw: Array, seconds: float = _SECOND
) -> tuple[Array, Array, NDArray[np.int_], Array]:
    """Rows of blocks averaged over so many seconds: columns, time, first row of each run, variance."""
    stack = design.stack
    per = max(1, round(seconds / stack.period))
    label = stack.run * (1 << 40) + (stack.t // (per * stack.period)).astype(np.int64)
    edges = np.flatnonzero(np.diff(label, prepend=-1))
    precision = 1.0 / design.variance(channel)
    total = np.add.reduceat(precision, edges)
    with np.errstate(invalid="ignore", divide="ignore"):
        rows = np.add.reduceat(raw * precision[:, None], edges, axis=0) / total[:, None]
        variance = 1.0 / total
    t = np.add.reduceat(stack.t, edges) / np.diff(np.append(edges, stack.t.size))
    starts = np.searchsorted(edges, stack.starts)
    return np.nan_to_num(rows), t, starts, variance


def _set_drift(design: Design, channel: int, drift: Drift) -> None:
    design.drift[channel] = drift
    design.forget(channel)


def _settle_drift(chosen: Selection, channels: Sequence[int]) -> None:
    """Drift as it is beside all that was found; none where none is needed any more."""
    for c in channels:
        if chosen.design.drift[c].level > 0.0:
            gain, drift = _drift_of(chosen, c)
            price = 2.0 * np.log(chosen.design.stack.seconds(c)) + 2.0 * np.log(_DRIFT_GRID)
            _set_drift(chosen.design, c, drift if gain - price > KEEP else NONE)

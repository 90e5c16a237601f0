"""Joint choice of curve, memory and drift where temperature went far: what takes the place of single thermal effects.

The greedy selection takes effects one by one, and what it takes first distorts what it takes next. Where temperature
went through 20 K or more, all thermal forms of a channel are therefore fitted and averaged once more together
(`thermal_forms`), and their average takes the place of the channel's effects of temperature and time unless these have
much more evidence than its best form. What was judged is what joins the filter: the same columns, the same average.

Where temperature went one way only, a curve in it and a memory of it are the same, and they part on the way back: the
gap between the two ways may be twice as large as hysteresis of such units is. Of a curve with a span s, and with h for
the catalogue's plausible hysteresis, 1 - (2 h / s)² is carried over, and nothing where that is negative: the bias is
held there. With a carried over, the standard deviation of the amplitude is √(1 - a²): if the part of a curve that is
hysteresis has the variance q, the way back is the curve times 1 - 2 q, and the variance of that factor 4 q (1 - q).

What forms that fit alike say of the way back differs more than what they say of the way there. The filter has a state
for each of the directions in which they differ most.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from filters.effects.deterministic import hysteresis
from filters.effects.inputs import LAGS
from filters.effects.temperature import lag, plays
from filters.effects.thermal_average import ThermalAverage, columns
from filters.tracing.beside_drift import likeliest_drift
from filters.tracing.columns import Term
from filters.tracing.selection import ACCEPT, KEEP, Selection
from filters.tracing.thermal_forms import Average, JointChoice, Rows, average, rows_of, score_before
from filters.types import Array

_CERTAIN = 1e-3
"""Standard deviation of the mean's amplitude where all of it is carried over: what is not known is in the spreads."""


def choose_jointly(chosen: Selection, channels: Sequence[int]) -> None:
    """Let averages take the place of thermal effects where they have more evidence; `chosen` is changed."""
    for c in channels:
        own = [a for a in chosen.on(c) if replaceable(a)]
        if own or chosen.design.drift[c].level > 0.0:
            _choose(chosen, c, own)


def replaceable(term: Term) -> bool:
    """Whether a term is of one channel and a function of temperature or time."""
    return len(term.places) == 1 and term.hypothesis.source in ("temperature", "time")


def _choose(chosen: Selection, c: int, own: list[Term]) -> None:
    design = chosen.design
    y = design.unexplained(chosen.terms, c, only_shared=True)
    others = [a for a in chosen.on(c) if len(a.places) == 1 and not replaceable(a)]
    rows = rows_of(design, c, y, _columns(chosen, others, c), _columns(chosen, own, c))
    if rows is None:
        return
    found = average(rows)
    before = score_before(rows, sum(chosen.price(a) for a in own))
    if _has_to_stay(own, rows, before - found.score):
        return
    _replace(chosen, c, own, rows, found)
    for term in others:
        if chosen.own_gain(term) - chosen.price(term) < KEEP:
            chosen.terms = [a for a in chosen.terms if a is not term]


def _has_to_stay(own: Sequence[Term], rows: Rows, better: float) -> bool:
    """Whether what was selected is kept: it has much more evidence than the forms, or there is nothing to replace.

    After one way only no evidence tells what carries over, and forms say what does not.
    """
    if not own:
        return better < ACCEPT
    follows_temperature = any(a.hypothesis.source == "temperature" for a in own)
    return better < -ACCEPT and not (follows_temperature and went_one_way(rows))


def _columns(chosen: Selection, terms: Sequence[Term], c: int) -> Array:
    """Columns of terms on a channel, SI, shape (n, m)."""
    made = [chosen.design.columns[:, a.places[c]] for a in terms]
    return np.column_stack(made) if made else np.zeros((chosen.design.stack.t.size, 0))


def _replace(chosen: Selection, c: int, own: list[Term], rows: Rows, found: Average) -> None:
    """Take an average in the place of a channel's own terms."""
    design = chosen.design
    carried = carried_over(rows, found, c)
    across = spreads(way_back(rows), found.covariance)
    leading = found.families[0][0].effect
    curves = tuple(tuple(x.tolist()) for x in (found.weights, *across))
    h = ThermalAverage.of(c, leading, found.low, found.high, curves)
    made = np.concatenate([h.columns(b.slow(), c) for b in design.stack.blocks])
    term = design.add(h, made)
    chosen.terms = [a for a in chosen.terms if not any(a is b for b in own)] + [term]
    theta = np.array([carried, *np.zeros(len(across))])
    sd = np.array([max(float(np.sqrt(1.0 - carried**2)), _CERTAIN), *np.ones(len(across))])
    chosen.averages[term.key] = JointChoice(found, theta, sd)
    chosen.weak = [w for w in chosen.weak if not (replaceable(w.term) and c in w.term.places)]
    design.set_drift(c, likeliest_drift(design, chosen.terms, c)[1])


# --------------------------------------------------------------------------------------------------- thermal transfer
# How much of what follows temperature is carried over to other runs: all of it, or less after one way only.
#
# Where temperature went one way only, a curve in it and a memory of it are the same, and they part on the way back: the
# gap between the two ways may be twice as large as hysteresis of such units is. Of a curve with a span s, and with h
# for
# the catalogue's plausible hysteresis, 1 - (2 h / s)² is carried over, and nothing where that is negative: the bias is
# held there. With a carried over, the standard deviation of the amplitude is √(1 - a²): if the part of a curve that is
# hysteresis has the variance q, the way back is the curve times 1 - 2 q, and the variance of that factor 4 q (1 - q).
#
# What forms that fit alike say of the way back differs more than what they say of the way there. The filter has a state
# for each of the directions in which they differ most.

_BOTH_WAYS = 0.5  # of the range of temperature, gone through upwards and downwards
_BINS = 20
_TURN = 0.1  # of the range: what temperature goes back by less is no turn
_NOTHING = 1e-12


def carried_over(rows: Rows, found: Average, channel: int) -> float:
    """Amplitude with which an average is carried over to other runs.

    `channel`: which: how large hysteresis may be is the catalogue's plausible size.
    """
    own = rows.columns @ found.weights
    if not went_one_way(rows) or not np.ptp(own) > 0.0:
        return 1.0
    plausible = hysteresis(channel).parameters[0].prior
    return max(0.0, 1.0 - (2.0 * plausible / float(np.ptp(own))) ** 2)


def went_one_way(rows: Rows) -> bool:
    """Whether temperature went one way only, through most of its range."""
    return both_ways(rows) < _BOTH_WAYS


def both_ways(rows: Rows) -> float:
    """Share of the range of temperature that was gone through upwards and downwards, 0 to 1."""
    seen = np.zeros((2, _BINS), bool)
    for begin, end in zip(rows.begins, [*rows.begins[1:], rows.t.size], strict=True):
        u = rows.columns[begin:end, 0]
        for a, b in _legs(u, 2.0 * _TURN):
            first, last = sorted((_bin(u[a]), _bin(u[b])))
            seen[int(u[b] > u[a]), first : last + 1] = True
    return float(np.mean(seen.all(axis=0)))


def _bin(u: float) -> int:
    return int(np.clip((u + 1.0) * 0.5 * _BINS, 0, _BINS - 1))


def _legs(u: Array, turn: float) -> list[tuple[int, int]]:
    """First and last row of each stretch that goes one way, not back by more than `turn`."""
    ends, at, way = [0], 0, 0
    for k, value in enumerate(u.tolist()):
        ahead = value - float(u[at])
        if way == 0:
            if abs(ahead) > turn:
                way, at = (1 if ahead > 0.0 else -1), k
        elif way * ahead > 0.0:
            at = k
        elif way * ahead < -turn:
            ends.append(at)
            way, at = -way, k
    ends.append(at)
    return [(a, b) for a, b in itertools.pairwise(ends) if a != b]


def way_back(rows: Rows) -> Array:
    """Columns of the forms were the last power-on's temperature to go back the way it came; shape (n, K)."""
    middle, half = 0.5 * (rows.low + rows.high), 0.5 * (rows.high - rows.low)
    T = middle + half * rows.columns[int(rows.begins[-1]) :, 0]
    there_and_back = np.concatenate([T, T[::-1]])
    period = float(np.median(np.diff(rows.t)))
    lagged = np.stack([lag(there_and_back, tau / period) for tau in LAGS], axis=1)
    made = columns(there_and_back, lagged, plays(there_and_back - T[0])[0], rows.low, rows.high)
    return np.column_stack(made)[T.size :]


def spreads(back: Array, covariance: Array, count: int = 2) -> list[Array]:
    """Directions in which the forms differ most on the way back, each one standard deviation long; (K,) each.

    `back`: from `way_back`.
    `covariance`: of the columns' factors, shape (K, K).
    `count`: at most so many.
    """
    root = np.asarray(np.linalg.qr(back - back.mean(axis=0)).R)
    values, vectors = np.linalg.eigh(root @ covariance @ root.T)
    largest = np.argsort(-values)[:count].tolist()
    return [
        covariance @ root.T @ vectors[:, k] / np.sqrt(values[k]) for k in largest if values[k] > _NOTHING * values.max()
    ]

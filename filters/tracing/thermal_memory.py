"""Joint choice of curve, memory and drift where temperature went far: what takes the place of single thermal effects.

The greedy selection takes effects one by one, and what it takes first distorts what it takes next. Where temperature
went through 20 K or more, all thermal forms of a channel are therefore fitted and averaged once more together
(`thermal_forms`), and their average takes the place of the channel's effects of temperature and time unless these have
much more evidence than its best form. What was judged is what joins the filter: the same columns, the same average.
"""

from collections.abc import Sequence

import numpy as np

from filters.effects.thermal_average import ThermalAverage
from filters.tracing.beside_drift import likeliest_drift
from filters.tracing.columns import Term
from filters.tracing.selection import ACCEPT, KEEP, Selection
from filters.tracing.thermal_forms import Average, Rows, average, rows_of, score_before
from filters.tracing.thermal_transfer import JointChoice, carried_over, spreads, way_back, went_one_way
from filters.types import Array

_CERTAIN = 1e-3
"""Standard deviation of the mean's amplitude where all of it is carried over: what is not known is in the spreads."""


def choose_jointly(chosen: Selection, channels: Sequence[int]) -> None:
    """Let averages take the place of thermal effects where they have more evidence; `chosen` is changed.

    `chosen`: what the greedy selection found.
    `channels`: those with data.
    """
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

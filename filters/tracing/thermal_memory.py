"""Joint choice of curve, memory and drift where temperature went far: what takes the place of single thermal effects.

The greedy selection takes effects one by one, and what it takes first distorts what it takes next. Where temperature
went through 20 K or more, all thermal forms of a channel are therefore fitted and averaged once more together
(`thermal_forms`), and their average takes the place of the channel's effects of temperature and time unless these have
much more evidence than its best form. What was judged is what joins the filter: the same columns, the same average.

What is foretold has a covariance, which is small for what temperature has done and large for what it has not. A new
power-on goes the way that is known or the other one: of the way there and back of the power-on with the widest range,
with S the mean square of the mean since the start or the turn, and V that of its standard deviation, a = S / (S + V) is
carried over. That is the amplitude which a mean of such a size and such an error earns; its standard deviation is
√(1 - a), what is not known over all there may be.

The filter has a state for each of the directions in which the way back is known least.
"""

from collections.abc import Sequence

import numpy as np

from filters.effects.inputs import LAGS
from filters.effects.temperature import lag, plays
from filters.effects.thermal_average import ThermalAverage, columns
from filters.tracing.beside_drift import likeliest_drift
from filters.tracing.columns import Term
from filters.tracing.selection import ACCEPT, KEEP, Selection
from filters.tracing.thermal_forms import Average, JointChoice, Rows, average, rows_of, score_before
from filters.types import Array

_KNOWN = 0.9
"""Share that carries over from which single effects may stay."""


def choose_jointly(chosen: Selection, channels: Sequence[int]) -> None:
    """Let averages take the place of thermal effects where they have more evidence; `chosen` is changed."""
    for c in channels:
        own = [a for a in chosen.on(c) if replaceable(a)]
        if own:
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
    found = average(rows, c)
    there, back = there_and_back(rows)
    carried = carried_over(there, back, found)
    before = score_before(rows, sum(chosen.price(a) for a in own))
    if _has_to_stay(own, before - found.score, carried):
        return
    _replace(chosen, c, own, back, found, carried)
    for term in others:
        if chosen.own_gain(term) - chosen.price(term) < KEEP:
            chosen.terms = [a for a in chosen.terms if a is not term]


def _has_to_stay(own: Sequence[Term], better: float, carried: float) -> bool:
    """Whether what was selected is kept: it has much more evidence than the forms.

    Where it is not known how much carries over, evidence does not tell, and what is foretold says how little it is.
    """
    follows_temperature = any(a.hypothesis.source == "temperature" for a in own)
    return better < -ACCEPT and not (follows_temperature and carried < _KNOWN)


def _columns(chosen: Selection, terms: Sequence[Term], c: int) -> Array:
    """Columns of terms on a channel, SI, shape (n, m)."""
    made = [chosen.design.columns[:, a.places[c]] for a in terms]
    return np.column_stack(made) if made else np.zeros((chosen.design.stack.t.size, 0))


def _replace(chosen: Selection, c: int, own: list[Term], back: Array, found: Average, carried: float) -> None:
    """Take an average in the place of a channel's own terms."""
    design = chosen.design
    across = spreads(back, found.covariance)
    leading = found.families[0][0].effect
    curves = tuple(tuple(x.tolist()) for x in (found.weights, *across))
    h = ThermalAverage.of(c, leading, found.low, found.high, curves)
    made = np.concatenate([h.columns(b.slow(), c) for b in design.stack.blocks])
    term = design.add(h, made)
    chosen.terms = [a for a in chosen.terms if not any(a is b for b in own)] + [term]
    theta = np.array([carried, *np.zeros(len(across))])
    sd = np.array([float(np.sqrt(1.0 - carried)), *np.ones(len(across))])
    chosen.averages[term.key] = JointChoice(found, theta, sd)
    known = [chosen.odds[a.key] for a in own if a.key in chosen.odds]
    if known:
        chosen.odds[term.key] = max(known)
    chosen.weak = [w for w in chosen.weak if not (replaceable(w.term) and c in w.term.places)]
    design.set_drift(c, likeliest_drift(design, chosen.terms, c)[1])


# --------------------------------------------------------------------------------------------------- thermal transfer

_NOTHING = 1e-12


def carried_over(there: Array, back: Array, found: Average) -> float:
    """Amplitude with which an average is carried over to other runs, 0 to 1.

    `there`, `back`: from `there_and_back`.
    """
    made = np.concatenate([there - there[0], back - back[0]])
    known = float(np.sum((made @ found.weights) ** 2))
    unknown = float(np.einsum("ij,ij->", made @ found.covariance, made))
    return known / (known + unknown)


def there_and_back(rows: Rows) -> tuple[Array, Array]:
    """Columns on the way of the power-on with the widest range of temperature, and were it to go back; (n, K) each."""
    ends = [*rows.begins[1:].tolist(), rows.t.size]
    first, last = max(zip(rows.begins.tolist(), ends, strict=True), key=lambda x: np.ptp(rows.columns[x[0] : x[1], 0]))
    there = rows.columns[first:last]
    T = 0.5 * (rows.low + rows.high) + 0.5 * (rows.high - rows.low) * there[:, 0]
    whole = np.concatenate([T, T[::-1]])
    period = float(np.median(np.diff(rows.t)))
    lagged = np.stack([lag(whole, tau / period) for tau in LAGS], axis=1)
    made = columns(whole, lagged, plays(whole - T[0])[0], rows.low, rows.high)
    return there, np.column_stack(made)[T.size :]


def spreads(back: Array, covariance: Array, count: int = 2) -> list[Array]:
    """Directions in which the way back is known least, each one standard deviation long; (K,) each.

    `back`: from `there_and_back`.
    `covariance`: of the columns' factors, shape (K, K).
    `count`: at most so many.
    """
    root = np.asarray(np.linalg.qr(back - back.mean(axis=0)).R)
    values, vectors = np.linalg.eigh(root @ covariance @ root.T)
    largest = np.argsort(-values)[:count].tolist()
    return [
        covariance @ root.T @ vectors[:, k] / np.sqrt(values[k]) for k in largest if values[k] > _NOTHING * values.max()
    ]

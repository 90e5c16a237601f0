"""Findings: selected terms with their parameters and their rivals: same evidence, or the same part explained."""

import math
from dataclasses import dataclass

import numpy as np

from filters.effects import deterministic
from filters.effects.deterministic import hysteresis, thermal_lag, thermal_poly
from filters.effects.hypothesis import Parameter
from filters.effects.inputs import BANKS, LAGS
from filters.effects.run_specific import RunSpecific
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.tracing.selection import Selection
from filters.tracing.thermal_forms import Form, JointChoice, curve_in_kelvins
from filters.tracing.trace_document import ParameterEntry, odds
from filters.types import Array

_MATERIAL = 9.0  # chi-square that a shared effect explains of a channel that it matters on
_MATERIAL_SHARE = 0.002  # of the most that it explains of any


@dataclass(frozen=True)
class Rival:
    """Another effect that would do in the place of one that was found; `weight` where forms were averaged."""

    term: Term
    score_difference: float
    odds: float
    weight: float | None = None


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A selected term with all that is said of it."""

    term: Term
    # theta, covariance: parameters, SI, shape (k,), and their covariance, shape (k, k)
    theta: Array
    covariance: Array
    # score, gain: in chi-square, with and without the price of its parameters
    score: float
    gain: float
    odds: float  # that it acts, against drift and noise alone
    rivals: tuple[Rival, ...]  # what else would do
    channels: tuple[int, ...]  # those on which it matters
    # whether it lowers the error of the held-out run beyond chance; None without one, or for what is run-specific
    confirmed: bool | None = None
    # of the excess of E10² over its floor, on its channels, that it removes on data to which it was not fitted, 0 to 1;
    # None where there is no such excess, and until that is known
    share: float | None = None
    joint: JointChoice | None = None  # what it is an average of

    @property
    def lasting(self) -> bool:
        """Whether it carries over to other runs."""
        return not isinstance(self.term.hypothesis, RunSpecific)


def findings_of(chosen: Selection) -> list[Finding]:
    """Findings of a selection, the best score first."""
    fit = chosen.fit()
    found = []
    for number, term in enumerate(chosen.terms):
        theta, covariance = fit.of(number)
        joint = chosen.averages.get(term.key)
        if joint is not None:
            theta, covariance = joint.theta, joint.covariance
        gain = chosen.own_gain(term)
        where = _channels_of(chosen, term, theta)
        found.append(
            Finding(
                term=term,
                theta=theta,
                covariance=covariance,
                score=gain - chosen.price(term),
                gain=gain,
                odds=chosen.odds_of(term),
                rivals=tuple(_rivals(chosen, term, joint)),
                channels=where,
                joint=joint,
            )
        )
    return sorted(found, key=lambda f: -f.score)


def _rivals(chosen: Selection, term: Term, joint: JointChoice | None) -> list[Rival]:
    if joint is None:
        return rivals(chosen, term)
    return rivals_of(joint, chosen.design, next(iter(term.places)), chosen.odds_of(term))


def _channels_of(chosen: Selection, term: Term, theta: Array) -> tuple[int, ...]:
    """Channels on which an effect matters."""
    if len(term.places) == 1:
        return tuple(term.places)
    drops = {}
    for c, places in term.places.items():
        G = chosen.design.gram(c)[0][np.ix_(places, places)]
        drops[c] = float(theta @ G @ theta)
    most = max(drops.values())
    return tuple(c for c, d in drops.items() if d > _MATERIAL and d > _MATERIAL_SHARE * most) or tuple(term.places)


# ------------------------------------------------------------------------------------------------------------- rivals
# What else would do in the place of an effect that was found: same evidence, or the same part explained.

_EVIDENCE = 6.0
_SAME_PART = 0.97
_MOST = 6


def rivals(chosen: Selection, term: Term) -> list[Rival]:
    """Effects that would explain the same, the best first, one form of each.

    `chosen`: with the term in it.
    `term`: whose place they would take.
    """
    design, known = chosen.design, chosen.odds_of(term)
    if isinstance(term.hypothesis, RunSpecific):
        return []
    rest = [a for a in chosen.terms if a is not term]
    own = float(design.gains(rest, [term])[0])
    score = own - chosen.price(term)
    taken = {a.key for a in rest}
    others = [
        b
        for b in design.terms
        if b.key not in taken
        and b.hypothesis.effect != term.hypothesis.effect
        and (set(term.places) <= set(b.places) or (len(term.places) > 1 and len(b.places) > 1))
    ]
    gains = design.gains(rest, others)
    found: dict[str, Rival] = {}
    if term.hypothesis.effect == "gravity":  # always a pair: no motion separates them
        found["scale"] = Rival(Term(deterministic.common_scale(), term.places), 0.0, known)
    for b, gain in sorted(zip(others, gains.tolist(), strict=True), key=lambda pair: chosen.price(pair[0]) - pair[1]):
        difference = gain - chosen.price(b) - score
        close = difference > -_EVIDENCE or (gain >= _SAME_PART * own and b.size <= term.size + 1)
        if not close or b.hypothesis.effect in found or contains(b, term):
            continue
        found[b.hypothesis.effect] = Rival(b, difference, _beside(known, difference))
        if len(found) >= _MOST:
            break
    return list(found.values())


def _beside(known: float, difference: float) -> float:
    """Odds of what scores so much more than what has known odds."""
    return odds(known * math.exp(min(0.5 * difference, 100.0)))


def contains(b: Term, a: Term) -> bool:
    """Whether b is a wider form of a: the same physics, or a free curve over what a is a function of."""
    h, wide = a.hypothesis, b.hypothesis
    if wide.effect == "thermal_poly":
        return b.size > a.size and h.effect == "thermal_lin"
    free = wide.effect == f"driver:{h.over[0]}" if len(h.over) == 1 else False
    return free or (wide.is_free and len(wide.over) == 1 and wide.over == h.over and wide.source != "motion")


_IMPLAUSIBLE = 5.0


def rivals_of(joint: JointChoice, design: Design, channel: int, leading_odds: float) -> list[Rival]:
    """Other effects among the forms, each by its best one, with the evidence of all its forms."""
    (leading, most), *others = joint.average.families
    found = []
    for form, weight in others:
        term = _term(form, design, channel)
        if term is not None:
            found.append(Rival(term, leading.score - form.score, odds(leading_odds * weight / most), weight))
    return found


def _term(form: Form, design: Design, channel: int) -> Term | None:
    """The effect of the catalogue that a form is named after, where the design has it."""
    wanted: dict[str, object] = {}
    if form.effect == "thermal_lag":
        wanted = {"tau_s": LAGS[form.lag or 0]}
    elif form.effect == "hysteresis":
        wanted = dict(hysteresis(channel, form.bank or 0).shape)
    elif form.effect == "thermal_poly":
        wanted = {"order": float(form.order)}
    for term in design.terms:
        h = term.hypothesis
        if h.effect == form.effect and list(term.places) == [channel] and dict(h.shape) == wanted:
            return term
    return None


def parameters_of(joint: JointChoice, channel: int) -> list[ParameterEntry]:
    """What the leading form has: its curve, its lag and play; how much is carried over, and its share of the evidence.

    `joint`: what was selected.
    """
    average = joint.average
    form, weight = average.families[0]
    entries: list[ParameterEntry] = []
    factors, covariance = curve_in_kelvins(form, average.low, average.high)
    curve = thermal_poly(channel, 3).parameters
    if form.order or form.bank is not None:
        entries += [
            fitted(p, value, sd)
            for p, value, sd in zip(curve, factors.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=False)
        ]
    half = 0.5 * (average.high - average.low)
    if form.lag is not None:
        entries += _memory(form, form.order, 1.0 / half, thermal_lag(channel, form.lag).parameters[0], "k_lag")
        entries.append(fixed("tau", LAGS[form.lag], "s"))
    if form.bank is not None:
        width, start = BANKS[form.bank]
        entries += _memory(form, -1, width / half, hysteresis(channel, form.bank).parameters[0], "k_play")
        entries += [fixed("width", width, "K"), fixed("start", start, "1")]
    carried: ParameterEntry = {**fixed("carried_over", float(joint.theta[0]), "1"), "sd": float(joint.sd[0])}
    return [*entries, carried, fixed("weight", weight, "1")]


def _memory(form: Form, place: int, scale: float, parameter: Parameter, name: str) -> list[ParameterEntry]:
    value, sd = float(form.theta[place]) * scale, float(np.sqrt(form.covariance[place, place])) * scale
    return [{**fitted(parameter, value, sd), "name": name}]


def fitted(p: Parameter, value: float, sd: float) -> ParameterEntry:
    """A parameter as the document has it; value and standard deviation in its unit."""
    plausible = bool(p.prior <= 0.0 or abs(value) <= _IMPLAUSIBLE * p.prior)
    return {"name": p.name, "value": value, "sd": sd, "unit": p.unit, "plausible": plausible}


def fixed(name: str, value: float, unit: str) -> ParameterEntry:
    """What fixes an effect's shape and was not fitted."""
    return {"name": name, "value": value, "sd": None, "unit": unit, "plausible": True}

"""What is said of an average of thermal forms: parameters of the leading one, the others as rivals with weights."""

import numpy as np

from filters.effects.deterministic import hysteresis, thermal_lag, thermal_poly
from filters.effects.hypothesis import Parameter
from filters.effects.inputs import BANKS, LAGS
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.tracing.rivals import Rival
from filters.tracing.thermal_forms import Form, curve_in_kelvins
from filters.tracing.thermal_transfer import JointChoice
from filters.tracing.trace_document import ParameterEntry

_IMPLAUSIBLE = 5.0


def rivals_of(joint: JointChoice, design: Design, channel: int) -> list[Rival]:
    """Other effects among the forms, each by its best one, with the evidence of all its forms."""
    (leading, _), *others = joint.average.families
    found = []
    for form, weight in others:
        term = _term(form, design, channel)
        if term is not None:
            found.append(Rival(term, leading.score - form.score, weight))
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
            _fitted(p, value, sd)
            for p, value, sd in zip(curve, factors.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=False)
        ]
    half = 0.5 * (average.high - average.low)
    if form.lag is not None:
        entries += _memory(form, form.order, 1.0 / half, thermal_lag(channel, form.lag).parameters[0], "k_lag")
        entries.append(_shape("tau", LAGS[form.lag], "s"))
    if form.bank is not None:
        width, start = BANKS[form.bank]
        entries += _memory(form, -1, width / half, hysteresis(channel, form.bank).parameters[0], "k_play")
        entries += [_shape("width", width, "K"), _shape("start", start, "1")]
    carried = ParameterEntry(
        name="carried_over", value=float(joint.theta[0]), sd=float(joint.sd[0]), unit="1", plausible=True
    )
    return [*entries, carried, _shape("weight", weight, "1")]


def _memory(form: Form, place: int, scale: float, parameter: Parameter, name: str) -> list[ParameterEntry]:
    value, sd = float(form.theta[place]) * scale, float(np.sqrt(form.covariance[place, place])) * scale
    return [{**_fitted(parameter, value, sd), "name": name}]


def _fitted(p: Parameter, value: float, sd: float) -> ParameterEntry:
    plausible = bool(p.prior <= 0.0 or abs(value) <= _IMPLAUSIBLE * p.prior)
    return {"name": p.name, "value": value, "sd": sd, "unit": p.unit, "plausible": plausible}


def _shape(name: str, value: float, unit: str) -> ParameterEntry:
    return {"name": name, "value": value, "sd": None, "unit": unit, "plausible": True}

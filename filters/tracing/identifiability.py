"""What a log can't show: effects that equal the constant bias, that nothing excited, or that look like another."""

import numpy as np

from filters.channels import CHANNELS
from filters.effects import deterministic
from filters.effects.hypothesis import Hypothesis
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.tracing.trace_document import UntestableEntry
from filters.types import Array

_COLLINEAR = 0.995


def untestable(design: Design, channels: list[int]) -> list[UntestableEntry]:
    """Deterministic effects of the catalogue that the log at hand can't show, computed from its regressors.

    `design`: whitened without drift, before anything was selected.
    """
    best: dict[str, list[Term]] = {}
    for term in design.terms:
        if not term.hypothesis.is_free and any(c in channels for c in term.places):
            best.setdefault(term.hypothesis.effect, []).append(term)
    out = []
    for effect, moving in _catalogue().items():
        terms = [a for a in best.get(effect, []) if _excited(design, a)]
        if not terms:
            out.append(_hidden(effect, moving, design))
    shown = [a for name, terms in best.items() for a in terms if _excited(design, a) and a.size == 1]
    return out + _collinear(design, shown)


def _catalogue() -> dict[str, str]:
    """Deterministic effects and what they are functions of."""
    return {h.effect: h.source for h in _deterministic()}


def _deterministic() -> list[Hypothesis]:
    """Hypotheses of all deterministic effects."""
    of_sensors = (h for c in (0, 3) for h in deterministic.of_sensor(c))
    return [*of_sensors, *deterministic.shared(), *deterministic.harmonics(0)]


def _hidden(effect: str, source: str, design: Design) -> UntestableEntry:
    """Without excitation: nothing to see, or a constant, which is the bias."""
    runs = [b.run for b in design.stack.blocks]
    known = all(r.temperature is not None for r in runs)
    if effect == "thermal_scale" and known:
        return _entry(effect, "collinear_with", "thermal_lin", 1.0)
    if source == "temperature" or effect == "thermal_scale":
        return _entry(effect, "equals_bias" if known else "no_excitation")
    if effect in ("delay", "lever_arm") and all(r.still for r in runs):
        return _entry(effect, "no_excitation")
    return _entry(effect, "equals_bias")


def _entry(effect: str, reason: str, partner: str | None = None, rho: float | None = None) -> UntestableEntry:
    return {"effect": effect, "reason": reason, "with": partner, "rho": rho}


def _excited(design: Design, term: Term) -> bool:
    """Whether a plausible size of it would show: beyond the constant bias, at half a sigma at least for 5 times it."""
    for k, p in enumerate(term.hypothesis.parameters):
        information = sum(design.gram(c)[0][places[k], places[k]] for c, places in term.places.items())
        raw = max(float(design.raw[places[k]] ** 2) for places in term.places.values())
        n = design.stack.t.size
        weight = max(1.0 / design.sd[c] ** 2 for c in term.places if design.sd[c] > 0.0)
        varies = information > 1e-9 * raw * n * weight
        if varies and np.sqrt(information) * p.prior * p.si * 5.0 > 1.0:
            return True
    return False


def _collinear(design: Design, terms: list[Term]) -> list[UntestableEntry]:
    """Pairs of effects on a channel whose regressors are the same beside the bias."""
    out: dict[tuple[str, str], UntestableEntry] = {}
    for c in range(len(CHANNELS)):
        own = [a for a in terms if list(a.places) == [c]]
        if len(own) < 2:
            continue
        places = np.array([a.places[c][0] for a in own])
        rho = _correlations(design.gram(c)[0][np.ix_(places, places)])
        for i, j in zip(*np.nonzero(np.triu(np.abs(rho) > _COLLINEAR, 1)), strict=True):
            a, b = own[i].hypothesis.effect, own[j].hypothesis.effect
            if a != b and (a, b) not in out:
                out[a, b] = _entry(a, "collinear_with", b, float(abs(rho[i, j])))
    return list(out.values())


def _correlations(G: Array) -> Array:
    scale = np.sqrt(np.maximum(np.diag(G), 1e-300))
    return np.asarray(G / np.outer(scale, scale))

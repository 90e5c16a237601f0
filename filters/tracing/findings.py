"""Findings: selected terms with their parameters and their rivals."""

from dataclasses import dataclass

import numpy as np

from filters.effects.run_specific import RunSpecific
from filters.tracing.averaged_findings import rivals_of
from filters.tracing.columns import Term
from filters.tracing.rivals import Rival, rivals
from filters.tracing.selection import Selection
from filters.tracing.thermal_transfer import JointChoice
from filters.types import Array

_MATERIAL = 9.0  # chi-square that a shared effect explains of a channel that it matters on
_MATERIAL_SHARE = 0.002  # of the most that it explains of any


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
                rivals=tuple(_rivals(chosen, term, joint)),
                channels=where,
                joint=joint,
            )
        )
    return sorted(found, key=lambda f: -f.score)


def _rivals(chosen: Selection, term: Term, joint: JointChoice | None) -> list[Rival]:
    if joint is None:
        return rivals(chosen, term)
    return rivals_of(joint, chosen.design, next(iter(term.places)))


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

"""What carries over to the next power-on: of each kind of effect the part of the unit and the spread of power-ons.

Every power-on is fitted by itself, with the effects that all of them together ask for. A kind of effect (bias, scale
factor, …) has one standard deviation between power-ons, which its axes and parameters share: what differs beyond the
standard deviations of the fits (`filters.fleet.components`). It matters where it makes errors at rests or turns twice
as large as those that a fit of the power-on itself leaves.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from filters.channels import ACCELS, CHANNELS
from filters.effects import plain_names
from filters.effects.hypothesis import Hypothesis
from filters.fleet import components, readings
from filters.multiposition import least_squares
from filters.multiposition.accelerometer import Rests
from filters.multiposition.choice import Choice, unseen_residuals
from filters.multiposition.least_squares import Fit
from filters.multiposition.turns import Turns
from filters.tracing.trace_document import CarryOverEntry
from filters.types import Array

Observed = Rests | Turns
_WITHIN = 0.975
_MATTERS = 2.0  # times the error that a fit of the power-on itself leaves, rms


@dataclass(frozen=True)
class Spread:
    """How a kind of effect differs from power-on to power-on of a unit, SI."""

    effects: tuple[Hypothesis, ...]  # of the kind, on all axes
    sd: float  # likeliest
    # low, high: ends of the interval that holds 95 %; `low` is 0 where no difference is told
    low: float
    high: float
    expected: float  # standard deviation such that 1.96 of it hold 95 % of the next power-ons: few power-ons widen it
    matters: bool | None  # whether a new power-on must be measured again; None where these power-ons do not tell


def spreads(chosen: Choice, fitted: Observed, apart: Observed | None) -> tuple[Spread, ...]:
    """How every kind of effect differs between power-ons; nothing of a single one.

    `fitted`: what the effects were chosen on.
    `apart`: of one more power-on.
    """
    alone = [fitted.of_power_on(k) for k in range(fitted.logs)] if fitted.logs > 1 else [fitted]
    starts = chosen.own
    if apart is not None:
        alone.append(apart)
        starts.append(chosen.mean)
    if len(alone) < 2 or not chosen.triad.size:
        return ()
    made = _fits(chosen, alone, starts)
    kinds = dict.fromkeys(e.effect for e in chosen.triad.effects)
    return tuple(_spread(chosen, made, [e for e in chosen.triad.effects if e.effect == kind]) for kind in kinds)


def measured_again(chosen: Choice, found: Sequence[Spread], apart: Rests) -> tuple[Array, Array]:
    """Parameters of a power-on with what must be measured again fitted to it, and errors at its rests, each left out.

    `found`: what differs, and by how much; all else is as it was chosen on other power-ons. Errors in m/s².
    """
    own = [[e for e in one.effects if e in chosen.triad.effects] for one in found]
    at = _places(chosen, [e for effects in own for e in effects])
    expected = [one.expected * np.sqrt(1.0 + 1.0 / chosen.logs) for one in found]
    prior = np.repeat(expected, [_places(chosen, effects).size for effects in own])
    mean, theta = chosen.mean, chosen.mean

    def residuals(part: Array) -> tuple[Array, Array]:
        theta[at] = mean[at] + part
        residual, slope = apart.residuals(chosen.triad, theta)
        return residual, slope[:, at]

    group = np.zeros(apart.judged, np.int64)
    made = least_squares.fit(residuals, np.zeros(at.size), apart.noise, group, prior, chosen.fit.excess)
    theta[at] = mean[at] + made.theta
    return theta, unseen_residuals(made, apart.blocks)


def _places(chosen: Choice, effects: Sequence[Hypothesis]) -> NDArray[np.int_]:
    """Where effects stand among the parameters of one power-on."""
    every = np.arange(chosen.triad.size)
    return np.concatenate([every[:0], *(every[chosen.triad.places(e)] for e in effects)])


def _fits(chosen: Choice, alone: Sequence[Observed], starts: Sequence[Array]) -> list[Fit]:
    """Fits of every power-on by itself, with one error of the model: that of all, weighted by their freedom."""
    first = [own.fit(chosen.triad, start) for own, start in zip(alone, starts, strict=True)]
    freedom = np.array([max(1, fit.residual.size - chosen.triad.size) for fit in first])
    excess = freedom @ np.array([fit.excess for fit in first]) / freedom.sum()
    return [own.fit(chosen.triad, fit.theta, excess) for own, fit in zip(alone, first, strict=True)]


def _spread(chosen: Choice, made: Sequence[Fit], effects: Sequence[Hypothesis]) -> Spread:
    at = _places(chosen, effects)
    values, sds = (np.array([getattr(fit, what)[at] for fit in made]).ravel() for what in ("theta", "sd"))
    names = [str(number) for number in range(len(made)) for _ in at]
    found = components.estimate(readings.power_ons(values, sds, [str(k) for k in at] * len(made), names))
    between = found.between_power_ons
    if between is None:
        raise ValueError("`made` has one fit: what differs between power-ons takes two")
    expected = between.sd * float(special.stdtrit(between.dof, _WITHIN) / special.ndtri(_WITHIN))
    # errors that a deviation of 1 makes, in the standard deviations of what a fit leaves
    weight = max(_weight(fit, at) for fit in made)
    matters = None
    if between.low * weight > 1.0 and between.sd * weight > _MATTERS:
        matters = True
    elif expected * weight < _MATTERS or between.high * weight < _MATTERS:
        matters = False
    return Spread(tuple(effects), between.sd, between.low, between.high, expected, matters)


def _weight(fit: Fit, at: NDArray[np.int_]) -> float:
    """Root mean square error that a deviation of 1 of parameters makes, over what a fit leaves; at rests or turns."""
    squares = np.sum(fit.slope[:, at] ** 2, axis=1) / fit.variance
    return max(float(np.sqrt(squares[fit.group == g].mean())) for g in np.unique(fit.group))


# ---------------------------------------------------------------------------------------------------------- in words


def entries(chosen: Choice, found: Sequence[Spread], power_ons: int) -> list[CarryOverEntry]:
    """Every kind of effect of a triad; of one power-on without what differs from it to others, for that can't be known.

    `power_ons`: how many there are.
    """
    kinds = dict.fromkeys(e.effect for e in chosen.triad.effects)
    by_kind = {spread.effects[0].effect: spread for spread in found}
    out: list[CarryOverEntry] = []
    for kind in kinds:
        effects = [e for e in chosen.triad.effects if e.effect == kind]
        spread, p = by_kind.get(kind), effects[0].parameters[0]
        out.append({
            "effect": kind,
            "channels": [CHANNELS[e.channel] for e in effects],
            "power_ons": power_ons,
            "unit": p.unit,
            "session_sd": spread.sd / p.si if spread else None,
            "session_ci95": [spread.low / p.si, spread.high / p.si] if spread else None,
            "expected_sd": spread.expected / p.si if spread else None,
            "measure_again": spread.matters if spread else None,
        })  # fmt: skip
    return out


def sentence(entries: Sequence[CarryOverEntry]) -> str:
    """Which part is the unit's, and what a new power-on must measure again."""
    if not entries:
        return ""
    count = entries[0]["power_ons"]
    if count < 2:
        return (
            " Of one power-on: what of this holds at the next can't be known; trace logs of several power-ons together."
        )
    text = f" Over {count} power-ons"
    again = [f"{_named(e)} (differs by {e['session_sd']:.2g}{_unit(e)})" for e in entries if e["measure_again"]]
    text += f" a new one must measure again: {', '.join(again)}." if again else " nothing is seen to differ."
    if kept := [_named(e) for e in entries if e["measure_again"] is False]:
        text += f" Carries over: {', '.join(kept)}."
    if open_ := [_named(e) for e in entries if e["measure_again"] is None]:
        text += f" Not told by so few: {', '.join(open_)}."
    return text


def _named(entry: CarryOverEntry) -> str:
    whose = "accelerometers" if entry["channels"][0] in [CHANNELS[c] for c in ACCELS] else "gyros"
    return f"{plain_names.short(entry['effect'])} of the {whose}"


def _unit(entry: CarryOverEntry) -> str:
    return f" {entry['unit']}" if entry["unit"] != "1" else ""

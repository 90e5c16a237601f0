"""A calibration of a unit turned by hand as a trace: the fields of every trace, a sentence, effects for the filter."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from filters.channels import ACCELS, CHANNELS, DPS, GYROS, MG
from filters.effects.hypothesis import Hypothesis
from filters.effects.records import Included, State
from filters.multiposition.calibration import Calibration, HeldOut, own_biases
from filters.multiposition.choice import KEEP, Choice, unseen_residuals
from filters.multiposition.rests import has_gyros, recorded
from filters.tracing.error_figure import DRAWS, rms
from filters.tracing.result import Trace
from filters.tracing.trace_document import (
    FindingEntry,
    LimitEntry,
    ParameterEntry,
    RefutedEntry,
    RivalEntry,
    Status,
    TraceFindings,
    UntestableEntry,
)
from filters.types import Array

# ----------------------------------------------------------------------------------------------------------- verdicts
# What a log that nothing was fitted to says of each effect: confirmed, refuted, or neither.
#
# An effect is refuted if the error with it is larger than without it beyond the 95 % interval of the difference, rests
# or
# turns drawn again; confirmed if it is smaller beyond it.


@dataclass(frozen=True)
class Verdict:
    """On one effect."""

    effect: Hypothesis
    confirmed: bool | None  # none where nothing judges it: without a log held out, and of the bias of each power-on
    refuted: bool  # whether it raises the error
    # metric, unit: which error
    metric: str
    unit: str
    # with_it, without: that error with everything that was chosen, and without all that is not confirmed
    with_it: float
    without: float


def verdicts(found: Calibration, seed: int) -> dict[Hypothesis, Verdict]:
    """Verdict on each effect that was chosen."""
    out: dict[Hypothesis, Verdict] = {}
    for chosen in (found.accelerometers, found.gyros):
        if chosen is not None:
            out |= _of_triad(found, chosen, seed)
    return out


def _of_triad(found: Calibration, chosen: Choice, seed: int) -> dict[Hypothesis, Verdict]:
    apart, gyros = found.heldout, chosen is found.gyros
    metric, unit, si = ("gravity_direction", "deg", DPS) if gyros else ("gravity_norm", "mg", MG)
    judged = [e for e in chosen.triad.effects if not (gyros and e.effect == "bias")]
    if apart is None or (gyros and not found.angles.size):
        judged = []
    unknown = float("nan")
    out = {e: Verdict(e, None, False, metric, unit, unknown, unknown) for e in chosen.triad.effects}
    if not judged or apart is None:
        return out
    with_all = _errors(apart, chosen, [])
    intervals = {e: _difference(with_all, _errors(apart, chosen, [e]), seed) for e in judged}
    left_out = [e for e in judged if intervals[e][1] >= 0.0]
    without = rms(_errors(apart, chosen, left_out)) / si
    for e, (low, high) in intervals.items():
        out[e] = Verdict(e, high < 0.0, low > 0.0, metric, unit, rms(with_all) / si, without)
    return out


def _errors(apart: HeldOut, chosen: Choice, gone: Sequence[Hypothesis]) -> Array:
    """Errors on the log held out, without some effects."""
    if gone:
        places = np.concatenate([chosen.places(e) for e in gone])
        triad = chosen.triad
        for effect in gone:
            triad = triad.without(effect)
        chosen = Choice(triad, chosen.fit.without(places), (), chosen.count, chosen.logs)
    if chosen.triad.channels == ACCELS:
        return apart.observed.errors(chosen.triad, chosen.fit.theta)
    assert apart.turned is not None
    return apart.turned.angles(chosen.triad, own_biases(chosen, apart.turned))


def _difference(with_it: Array, without: Array, seed: int) -> tuple[float, float]:
    """Interval of the difference of mean squares, 95 %."""
    difference = with_it**2 - without**2
    picks = np.random.default_rng(seed).integers(0, difference.size, (DRAWS, difference.size))
    low, high = np.quantile(difference[picks].mean(axis=1), [0.025, 0.975])
    return float(low), float(high)


# ------------------------------------------------------------------------------------------------------------- report

_IMPLAUSIBLE = 5.0
_RIVAL = -6.0
_LIMIT_SD = 5.0
_AT_FLOOR = 1.2  # rests left out of a fit are a little off by what the fit itself does not know
_NEVER = ("mounting", "tilt", "lever_arm", "delay", "earth_rate")
"""What rests and turns cannot show: how the triads sit in the case, what the turns leave open, Earth's rate."""


def report(found: Calibration, asked: Sequence[str], seed: int) -> Trace:
    """Everything that is known, as records for reports, files and the filter.

    `found`: of one unit.
    `asked`: effects whose smallest visible size is to be said.
    `seed`: of intervals.
    """
    judged = verdicts(found, seed)
    listed = [
        (chosen, effect)
        for chosen in (found.accelerometers, found.gyros)
        if chosen is not None
        for effect in chosen.triad.effects
        if chosen.score(effect) >= KEEP
    ]
    findings = [_finding(found, chosen, e, judged[e]) for chosen, e in listed if not judged[e].refuted]
    findings.sort(key=lambda f: -f["score"])
    document: TraceFindings = {
        "untestable": _untestable(found),
        "integrity": [],
        "lines": [],
        "noise_level": [],
        "findings": findings,
        "refuted": [_refuted(judged[e]) for _, e in listed if judged[e].refuted],
        "common": [],
        "weak": [],
        "drift": [],
        "remainder": [],
        "status": _status(found, findings, judged),
        "error": [figure.entry() for figure in found.figures],
        "limits": [entry for effect in asked for entry in _limits(found, effect)],
        "seed": seed,
        "sentence": _sentence(found, findings),
    }
    kept = [(chosen, e) for chosen, e in listed if not judged[e].refuted and judged[e].confirmed is not False]
    included, correlation = _included(found, kept)
    return Trace(document, included, correlation, ())


def notes(found: Calibration) -> list[str]:
    """Sentences on the rests and turns that were used, and on what the logs lack."""
    out = []
    logs = [*zip(found.runs, found.rests, strict=True)]
    if found.heldout is not None:
        logs.append((found.heldout.run, found.heldout.rests))
    for run, own in logs:
        total = sum(rest.seconds for rest in own)
        out.append(f"{run.name}: {len(own)} rests, {total:.0f} s in all, were found in the readings")
        if not has_gyros(run):
            lack = ", ".join(CHANNELS[c] for c in GYROS if not recorded(run)[c])
            why = "not recorded, or dead: of the gyros nothing is said, only of the accelerometers"
            out.append(f"{run.name}: {lack} {why}")
    if found.turned is not None:
        out.append(f"{len(found.turned.turns)} turns between rests were used")
    return out


# ----------------------------------------------------------------------------------------------------------- findings


def _finding(found: Calibration, chosen: Choice, effect: Hypothesis, verdict: Verdict) -> FindingEntry:
    gain, share = _unseen(found, chosen, effect)
    return {
        "effect": effect.effect,
        "label": effect.label,
        "channels": [CHANNELS[effect.channel]],
        "params": _parameters(found, chosen, effect),
        "shape": dict(effect.shape),
        "score": chosen.score(effect),
        "gain": chosen.gain(effect),
        "heldout_gain": gain,
        "share_of_excess": share,
        "driver_curve": None,
        "proposed_form": None,
        "rivals": _rivals(chosen, effect),
        "include_as": "A",
        "confirmed": verdict.confirmed,
    }


def _parameters(found: Calibration, chosen: Choice, effect: Hypothesis) -> list[ParameterEntry]:
    """Values with their standard deviations; of a gyro's bias one a power-on."""
    at = chosen.places(effect)
    parameters = effect.parameters * (at.size // len(effect.parameters))
    names = [p.name for p in parameters]
    if at.size > len(effect.parameters):
        power_ons = found.turned.power_ons if found.turned is not None else ()
        names = [f"{p.name} {run}" for p, run in zip(parameters, power_ons, strict=True)]
    return [
        {
            "name": name,
            "value": float(value / p.si),
            "sd": float(sd / p.si),
            "unit": p.unit,
            "plausible": bool(abs(value / p.si) <= _IMPLAUSIBLE * p.prior),
        }
        for name, p, value, sd in zip(names, parameters, chosen.fit.theta[at], chosen.fit.sd[at], strict=True)
    ]


def _unseen(found: Calibration, chosen: Choice, effect: Hypothesis) -> tuple[float, float | None]:
    """Gain of an effect on rests and turns left out of the fit in turn, and its share of the excess over noise."""
    fit = chosen.fit
    less = fit.without(chosen.places(effect))
    if chosen is found.gyros and found.turned is not None:
        turns = 2 * len(found.turned.turns)
        blocks = [np.array([2 * k, 2 * k + 1]) for k in range(turns // 2)]
        blocks += [np.arange(k, k + 3) for k in range(turns, fit.residual.size, 3)]
    else:
        turns = fit.residual.size
        blocks = [np.array([k]) for k in range(turns)]
    after, before = unseen_residuals(fit, blocks), unseen_residuals(less, blocks)
    gain = float(np.sum((before**2 - after**2) / fit.variance))
    metric = "gravity_direction" if effect.channel in GYROS else "gravity_norm"
    figure = next((f for f in found.figures if f.metric == metric), None)
    if figure is None or (effect.channel in GYROS and effect.effect == "bias"):
        return gain, None
    si = DPS if effect.channel in GYROS else MG
    count = len(found.turned.turns) if effect.channel in GYROS and found.turned is not None else turns
    drop = float(np.sum(before[:turns] ** 2 - after[:turns] ** 2)) / max(1, count) / si**2
    excess = figure.before**2 - figure.floor**2
    return gain, float(np.clip(drop / excess, 0.0, 1.0)) if excess > 0.0 else None


def _rivals(chosen: Choice, effect: Hypothesis) -> list[RivalEntry]:
    """Gravity's magnitude, where one scale factor common to all accelerometers would do as well as three."""
    scales = [e for e in chosen.triad.effects if e.effect == "scale"]
    if effect.effect != "scale" or effect.channel not in ACCELS or len(scales) < len(ACCELS):
        return []
    at = np.concatenate([chosen.places(e) for e in scales])
    contrast = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    apart = contrast @ chosen.fit.theta[at]
    spread = contrast @ chosen.fit.covariance[np.ix_(at, at)] @ contrast.T
    loss = float(apart @ np.linalg.solve(spread, apart))
    difference = 2.0 * float(np.log(max(2, chosen.count))) - loss
    if difference <= _RIVAL:
        return []
    return [{"effect": "gravity", "label": "gravity has another magnitude", "score_difference": difference}]


def _refuted(verdict: Verdict) -> RefutedEntry:
    return {
        "effect": verdict.effect.effect,
        "label": verdict.effect.label,
        "channels": [CHANNELS[verdict.effect.channel]],
        "metric": verdict.metric,
        "after_with": verdict.with_it,
        "after_without": verdict.without,
        "unit": verdict.unit,
    }


# ----------------------------------------------------------------------------------------------------- all the others


def _untestable(found: Calibration) -> list[UntestableEntry]:
    out: list[UntestableEntry] = [
        {"effect": name, "reason": "no_excitation", "with": None, "rho": None} for name in _NEVER
    ]
    out.append({"effect": "gravity", "reason": "collinear_with", "with": "scale", "rho": 1.0})
    missing = [e.effect for c in (found.accelerometers, found.gyros) if c is not None for e in c.undetermined]
    if found.gyros is None:
        missing.append("g_sensitivity")
    out += [{"effect": name, "reason": "no_excitation", "with": None, "rho": None} for name in dict.fromkeys(missing)]
    return out


def _status(
    found: Calibration, findings: Sequence[FindingEntry], judged: dict[Hypothesis, Verdict]
) -> dict[str, Status]:
    out: dict[str, Status] = {}
    have = recorded(found.runs[0])
    for c in (*GYROS, *ACCELS):
        if not have[c]:
            continue
        own = [f for f in findings if f["channels"] == [CHANNELS[c]]]
        contradicted = any(v.refuted for e, v in judged.items() if e.channel == c)
        metric = "gravity_norm" if c in ACCELS else "gravity_direction"
        figure = next((f for f in found.figures if f.metric == metric), None)
        at_floor = figure is not None and figure.ci95[0] <= _AT_FLOOR * figure.floor_band95[1]
        if any(f["rivals"] for f in own):
            out[CHANNELS[c]] = "confounded"
        elif own:
            out[CHANNELS[c]] = "explained" if at_floor and not contradicted else "partial"
        else:
            out[CHANNELS[c]] = "clean" if at_floor and not contradicted else "unexplained"
    return out


def _limits(found: Calibration, name: str) -> list[LimitEntry]:
    """Smallest size of an effect that would be told, five standard deviations of each of its parameters."""
    out: list[LimitEntry] = []
    for chosen in (found.accelerometers, found.gyros):
        if chosen is None:
            continue
        for effect in (e for e in chosen.triad.effects if e.effect == name):
            sd = chosen.fit.sd[chosen.places(effect)]
            for p, value in zip(effect.parameters, sd, strict=False):
                limit = _LIMIT_SD * float(value / p.si)
                said = f" {p.unit}" if p.unit != "1" else ""
                text = f"shown from {limit:.3g}{said} on, {p.name}"
                entry: LimitEntry = {
                    "effect": name, "channels": [CHANNELS[effect.channel]], "limit": limit, "unit": p.unit, "text": text
                }  # fmt: skip
                out.append(entry)
    if not out:
        text = "no parameter of what rests and turns ask for"
        out.append({"effect": name, "channels": [], "limit": None, "unit": "", "text": text})
    return out


# -------------------------------------------------------------------------------------------------------- the filter


def _included(found: Calibration, kept: Sequence[tuple[Choice, Hypothesis]]) -> tuple[tuple[Included, ...], Array]:
    """Effects as constant states with the covariance of the fit."""
    included = []
    blocks: list[Array] = []
    for chosen in (found.accelerometers, found.gyros):
        own = [e for c, e in kept if c is chosen]
        if chosen is None or not own:
            continue
        mean, covariance = _over_logs(chosen, own)
        sd = np.sqrt(np.diag(covariance))
        blocks.append(covariance / np.outer(sd, sd))
        first = 0
        for effect in own:
            states = tuple(
                State(p.name, p.unit, float(mean[first + k] / p.si), float(sd[first + k] / p.si))
                for k, p in enumerate(effect.parameters)
            )
            first += len(states)
            included.append(Included(effect.effect, (CHANNELS[effect.channel],), "A", dict(effect.shape), states))
    size = sum(len(block) for block in blocks)
    correlation = np.eye(size)
    first = 0
    for block in blocks:
        correlation[first : first + len(block), first : first + len(block)] = block
        first += len(block)
    return tuple(included), 0.5 * (correlation + correlation.T)


def _over_logs(chosen: Choice, effects: Sequence[Hypothesis]) -> tuple[Array, Array]:
    """Values and covariance of some effects; a bias that each log has its own of is their mean, as wide as they lie."""
    rows, spread = [], []
    for effect in effects:
        at = chosen.places(effect)
        size = len(effect.parameters)
        pick = np.zeros((size, chosen.fit.theta.size))
        for k in range(size):
            own = at[k::size]
            pick[k, own] = 1.0 / own.size
            spread.append(float(np.var(chosen.fit.theta[own], ddof=1)) if own.size > 1 else 0.0)
        rows.append(pick)
    picked = np.vstack(rows)
    return picked @ chosen.fit.theta, picked @ chosen.fit.covariance @ picked.T + np.diag(spread)


# ------------------------------------------------------------------------------------------------------- the sentence


def _sentence(found: Calibration, findings: Sequence[FindingEntry]) -> str:
    """The result in a few sentences."""
    count = len(found.observed.mean)
    text = f"Turned by hand, {count} rests in {found.directions} directions: "
    names = list(dict.fromkeys(f["label"] for f in findings))
    text += ("; ".join(names) if names else "nothing was found beyond the noise") + "."
    how = "on a log not used" if found.heldout is not None else "with rests left out in turn"
    for figure in found.figures:
        what = "magnitude of gravity" if figure.metric == "gravity_norm" else "direction of gravity after a turn"
        text += (
            f" The {what}, {how}: {figure.before:.3g} → {figure.after:.2g} {figure.unit},"
            f" where noise alone leaves {figure.floor:.2g}."
        )
    if found.directions < 9:
        text += " Misalignment takes at least nine directions: put the unit down in more of them."
    elif findings:
        text += " Next: write the effects with -o and give them to the filter with --effects."
    return text

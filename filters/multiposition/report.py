"""A calibration of a unit turned by hand as a trace: the fields of every trace, a sentence, effects for the filter."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from filters.channels import ACCELS, CHANNELS, GYROS
from filters.effects.hypothesis import Hypothesis
from filters.effects.records import Included, State
from filters.multiposition import carry_over
from filters.multiposition.accelerometer import Rests
from filters.multiposition.calibration import Calibration, Sensors
from filters.multiposition.choice import KEEP, Choice, unseen_residuals
from filters.multiposition.rests import has, power_ons, recorded
from filters.multiposition.turns import Turns
from filters.tracing.error_figure import DRAWS, ErrorFigure, rms
from filters.tracing.report import integrity
from filters.tracing.result import Trace
from filters.tracing.trace_document import (
    ErrorEntry,
    FindingEntry,
    LimitEntry,
    ParameterEntry,
    RefutedEntry,
    RivalEntry,
    Status,
    TraceFindings,
    UntestableEntry,
    odds_of,
)
from filters.types import Array

# ----------------------------------------------------------------------------------------------------------- verdicts
# What a log that nothing was fitted to says of each effect: confirmed, refuted, or neither.
#
# An effect is refuted if the error with it is larger than without it beyond the 95 % interval of the difference, rests
# or turns drawn again; confirmed if it is smaller beyond it.


@dataclass(frozen=True)
class Verdict:
    """On one effect."""

    confirmed: bool | None  # none where nothing judges it: without a log held out, and of the bias of each power-on
    refuted: bool = False  # whether it raises the error
    # with_it, without: the error with everything that was chosen, and without all that is not confirmed, in its unit;
    # where power-ons differ without this effect alone, and with all else that differs measured on the log
    with_it: float = float("nan")
    without: float = float("nan")


def _verdicts(sensors: Sensors, seed: int) -> dict[Hypothesis, Verdict]:
    """Verdict on each effect that was chosen."""
    chosen, si = sensors.chosen, sensors.metric.si
    judged = [e for e in chosen.triad.effects if not _of_power_on(e)]
    out = dict.fromkeys(chosen.triad.effects, Verdict(None))
    if not judged or not sensors.errors().size:
        return out
    both = {e: (sensors.errors_again(but=e), _errors(sensors, [e])) for e in judged}
    intervals = {e: _difference(*both[e], seed) for e in judged}
    if not (sensors.again or sensors.sensed_again):
        without = _errors(sensors, [e for e in judged if intervals[e][1] >= 0.0])
        both = {e: (with_it, without) for e, (with_it, _) in both.items()}
    for e, (low, high) in intervals.items():
        out[e] = Verdict(high < 0.0, low > 0.0, *(rms(errors) / si for errors in both[e]))
    return out


def _of_power_on(effect: Hypothesis) -> bool:
    """Whether every power-on has its own: a rest shows the bias of a gyro by itself."""
    return effect.effect == "bias" and effect.channel in GYROS


def _errors(sensors: Sensors, gone: Sequence[Hypothesis]) -> Array:
    """Errors on the log held out, without some effects; what it must measure again counts as measured on it."""
    chosen = sensors.chosen
    if not gone:
        return sensors.errors_again()
    triad = replace(chosen.triad, effects=tuple(e for e in chosen.triad.effects if e not in gone))
    fit = chosen.fit.without(np.concatenate([chosen.places(e) for e in gone]))
    return sensors.errors_again(Choice(triad, fit, (), chosen.count, chosen.logs))


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
    judged = {e: verdict for sensors in found.sensors for e, verdict in _verdicts(sensors, seed).items()}
    listed = [(own, e) for own in found.sensors for e in own.chosen.triad.effects if own.chosen.score(e) >= KEEP]
    names = power_ons([run for run, _ in found.logs[: len(found.logs) - found.heldout]])[0]
    findings = [_finding(own, e, judged[e], names) for own, e in listed if not judged[e].refuted]
    findings.sort(key=lambda f: -f["score"])
    count = found.power_ons
    carried = [e for own in found.sensors for e in carry_over.entries(own.chosen, own.spreads, count)]
    document: TraceFindings = {
        "untestable": _untestable(found),
        "integrity": integrity(found.faults),
        "lines": [],
        "noise_level": [],
        "findings": findings,
        "refuted": [_refuted(own, e, judged[e]) for own, e in listed if judged[e].refuted],
        "common": [],
        "weak": [],
        "drift": [],
        "remainder": [],
        "status": _status(found, findings, judged),
        "error": [_error(own, own.figure) for own in found.sensors if own.figure is not None],
        "limits": [entry for effect in asked for entry in _limits(found, effect)],
        "carries_over": carried,
        "seed": seed,
        "sentence": _sentence(found, findings) + carry_over.sentence(carried),
    }
    kept = [e for _, e in listed if not judged[e].refuted and judged[e].confirmed is not False]
    included, correlation = _included(found, kept)
    return Trace(document, included, correlation, ())


def notes(found: Calibration) -> list[str]:
    """Sentences on the rests and turns that were used, and on what the logs lack."""
    out = []
    for run, own in found.logs:
        total = sum(rest.seconds for rest in own)
        out.append(f"{run.name}: {len(own)} rests, {total:.0f} s in all, were found in the readings")
        if not has(run, GYROS):
            lack = ", ".join(CHANNELS[c] for c in GYROS if not recorded(run)[c])
            why = "not recorded, or dead: of the gyros nothing is said, only of the accelerometers"
            out.append(f"{run.name}: {lack} {why}")
    if found.gyros is not None and isinstance(found.gyros.observed, Turns):
        spoilt = found.gyros.observed.spoilt
        left = f", {spoilt} left out: samples are missing in them, or stand at a limit" if spoilt else ""
        out.append(f"{found.gyros.observed.judged // 2} turns between rests were used{left}")
    return out


# ----------------------------------------------------------------------------------------------------------- findings


def _finding(sensors: Sensors, effect: Hypothesis, verdict: Verdict, power_ons: Sequence[str]) -> FindingEntry:
    gain, share = _unseen(sensors, effect)
    chosen = sensors.chosen
    return {
        "effect": effect.effect,
        "label": effect.label,
        "channels": [CHANNELS[effect.channel]],
        "params": _parameters(sensors.chosen, effect, power_ons),
        "shape": dict(effect.shape),
        "score": chosen.score(effect),
        "odds": odds_of(chosen.score(effect)),
        "gain": chosen.gain(effect),
        "heldout_gain": gain,
        "share_of_excess": share,
        "driver_curve": None,
        "proposed_form": None,
        "rivals": _rivals(chosen, effect),
        "include_as": "A",
        "confirmed": verdict.confirmed,
        "common": None,
    }


def _parameters(chosen: Choice, effect: Hypothesis, power_ons: Sequence[str]) -> list[ParameterEntry]:
    """Values with their standard deviations; of a bias one a power-on."""
    at = chosen.places(effect)
    parameters = effect.parameters * (at.size // len(effect.parameters))
    names = [p.name for p in parameters]
    if at.size > len(effect.parameters):
        names = [f"{p.name} {run}" for run in power_ons for p in effect.parameters]
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


def _unseen(sensors: Sensors, effect: Hypothesis) -> tuple[float, float | None]:
    """Gain of an effect on rests and turns left out of the fit in turn, and its share of the excess over noise."""
    fit, observed, figure = sensors.chosen.fit, sensors.observed, sensors.figure
    less = fit.without(sensors.chosen.places(effect))
    after, before = unseen_residuals(fit, observed.blocks), unseen_residuals(less, observed.blocks)
    gain = float(np.sum((before**2 - after**2) / fit.variance))
    if figure is None or _of_power_on(effect):
        return gain, None
    n = observed.judged
    count = max(1, n // sensors.metric.freedom)
    drop = float(np.sum(before[:n] ** 2 - after[:n] ** 2)) / count / sensors.metric.si**2
    excess = figure.before**2 - figure.floor**2
    return gain, float(np.clip(drop / excess, 0.0, 1.0)) if excess > 0.0 else None


def _rivals(chosen: Choice, effect: Hypothesis) -> list[RivalEntry]:
    """Gravity's magnitude, where one scale factor common to all accelerometers would do as well as three."""
    scales = [e for e in chosen.triad.effects if e.effect == "scale"]
    if effect.effect != "scale" or effect.channel not in ACCELS or len(scales) < len(ACCELS):
        return []
    at = np.concatenate([chosen.places(e) for e in scales])
    if at.size > len(ACCELS):  # what differs from power-on to power-on is not gravity
        return []
    contrast = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    apart = contrast @ chosen.fit.theta[at]
    spread = contrast @ chosen.fit.covariance[np.ix_(at, at)] @ contrast.T
    loss = float(apart @ np.linalg.solve(spread, apart))
    difference = 2.0 * float(np.log(max(2, chosen.count))) - loss
    if difference <= _RIVAL:
        return []
    odds = odds_of(min(chosen.score(e) for e in scales) + difference)
    label = "gravity has another magnitude"
    return [{"effect": "gravity", "label": label, "score_difference": difference, "odds": odds, "weight": None}]


def _refuted(sensors: Sensors, effect: Hypothesis, verdict: Verdict) -> RefutedEntry:
    return {
        "effect": effect.effect,
        "label": effect.label,
        "channels": [CHANNELS[effect.channel]],
        "metric": sensors.metric.name,
        "after_with": verdict.with_it,
        "after_without": verdict.without,
        "unit": sensors.metric.unit,
    }


# ----------------------------------------------------------------------------------------------------- all the others


def _error(sensors: Sensors, figure: ErrorFigure) -> ErrorEntry:
    out = figure.entry()
    if figure.heldout == "run" and (sensors.sensed_again or (sensors.again and isinstance(sensors.apart, Rests))):
        out["after_again"] = rms(sensors.errors_again()) / sensors.metric.si
    return out


def _untestable(found: Calibration) -> list[UntestableEntry]:
    out: list[UntestableEntry] = [
        {"effect": name, "reason": "no_excitation", "with": None, "rho": None} for name in _NEVER
    ]
    out.append({"effect": "gravity", "reason": "collinear_with", "with": "scale", "rho": 1.0})
    missing = [e.effect for own in found.sensors for e in own.chosen.undetermined]
    if found.gyros is None:
        missing.append("g_sensitivity")
    out += [{"effect": name, "reason": "no_excitation", "with": None, "rho": None} for name in dict.fromkeys(missing)]
    return out


def _status(
    found: Calibration, findings: Sequence[FindingEntry], judged: dict[Hypothesis, Verdict]
) -> dict[str, Status]:
    out: dict[str, Status] = {}
    have = recorded(found.logs[0][0])
    floors = {c: _at_floor(own) for own in found.sensors for c in own.chosen.triad.channels}
    for c in (*GYROS, *ACCELS):
        if not have[c]:
            continue
        own = [f for f in findings if f["channels"] == [CHANNELS[c]]]
        contradicted = any(v.refuted for e, v in judged.items() if e.channel == c)
        at_floor = floors.get(c, False)
        if any(f["rivals"] for f in own):
            out[CHANNELS[c]] = "confounded"
        elif own:
            out[CHANNELS[c]] = "explained" if at_floor and not contradicted else "partial"
        else:
            out[CHANNELS[c]] = "clean" if at_floor and not contradicted else "unexplained"
    return out


def _at_floor(sensors: Sensors) -> bool:
    """Whether the error is at its floor, once what differs from power-on to power-on is measured again."""
    if (figure := sensors.figure) is None:
        return False
    again = _error(sensors, figure)["after_again"]
    return min(figure.ci95[0] if again is None else again, figure.ci95[0]) <= _AT_FLOOR * figure.floor_band95[1]


def _limits(found: Calibration, name: str) -> list[LimitEntry]:
    """Smallest size of an effect that would be told, five standard deviations of each of its parameters."""
    out: list[LimitEntry] = []
    for chosen in (own.chosen for own in found.sensors):
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


def _included(found: Calibration, kept: Sequence[Hypothesis]) -> tuple[tuple[Included, ...], Array]:
    """Effects as constant states with the covariance of the fit."""
    included = []
    blocks: list[Array] = []
    for sensors in found.sensors:
        own = [e for e in sensors.chosen.triad.effects if e in kept]
        if not own:
            continue
        mean, covariance = _over_logs(sensors, own)
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
    correlation = linalg.block_diag(*blocks) if blocks else np.eye(0)
    return tuple(included), 0.5 * (correlation + correlation.T)


def _over_logs(sensors: Sensors, effects: Sequence[Hypothesis]) -> tuple[Array, Array]:
    """Values and covariance of some effects at a power-on yet unknown: the unit's part, as wide as power-ons differ."""
    chosen, rows, spread = sensors.chosen, [], []
    expected = {e: one.expected for one in sensors.spreads for e in one.effects}
    for effect in effects:
        at = chosen.places(effect)
        size = len(effect.parameters)
        pick = np.zeros((size, chosen.fit.theta.size))
        for k in range(size):
            own = at[k::size]
            pick[k, own] = 1.0 / own.size
            spread.append(expected.get(effect, 0.0) ** 2 * (1.0 + 1.0 / chosen.logs))
        rows.append(pick)
    picked = np.vstack(rows)
    return picked @ chosen.fit.theta, picked @ chosen.fit.covariance @ picked.T + np.diag(spread)


# ------------------------------------------------------------------------------------------------------- the sentence


def _sentence(found: Calibration, findings: Sequence[FindingEntry]) -> str:
    """The result in a few sentences."""
    count = found.accelerometers.observed.judged
    text = f"Turned by hand, {count} rests in {found.directions} directions: "
    names = list(dict.fromkeys(f["label"] for f in findings))
    text += ("; ".join(names) if names else "nothing was found beyond the noise") + "."
    how = "on a log not used" if found.heldout else "with rests left out in turn"
    for own in found.sensors:
        if (figure := own.figure) is None:
            continue
        what = "magnitude of gravity" if figure.metric == "gravity_norm" else "direction of gravity after a turn"
        text += (
            f" The {what}, {how}: {figure.before:.3g} → {figure.after:.2g} {figure.unit},"
            f" where noise alone leaves {figure.floor:.2g}."
        )
        if (again := _error(own, figure)["after_again"]) is not None:
            text = f"{text[:-1]}; {again:.2g} with what differs measured again."
    if found.directions < 9:
        text += " Misalignment takes at least nine directions: put the unit down in more of them."
    elif findings:
        text += " Next: write the effects with -o and give them to the filter with --effects."
    return text

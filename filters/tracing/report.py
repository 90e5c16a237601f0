"""An assessment as a report: fields of docs/formats.md, a sentence, residuals before and after for figures."""

from collections.abc import Callable

import numpy as np
from scipy import optimize

from filters.channels import CHANNELS, error_unit
from filters.effects.drivers import Driver
from filters.effects.hypothesis import Hypothesis
from filters.effects.lines import SpectralLine
from filters.effects.run_specific import RunSpecific, Step, Tone
from filters.tracing import common_causes, sentence
from filters.tracing.assessment import Assessment, statuses
from filters.tracing.findings import Finding, Rival, fitted, fixed, parameters_of
from filters.tracing.held_out_run import correction
from filters.tracing.inclusion import included_effects
from filters.tracing.judgement import Refuted
from filters.tracing.result import RunSeries, Trace
from filters.tracing.screening import FaultOfRun
from filters.tracing.selection import Weak
from filters.tracing.stack import Stack
from filters.tracing.trace_document import (
    DriftEntry,
    DriverCurveEntry,
    FindingEntry,
    IntegrityEntry,
    LineEntry,
    ParameterEntry,
    RefutedEntry,
    RemainderEntry,
    RivalEntry,
    TraceFindings,
    WeakEntry,
)
from filters.tracing.whitening import Drift
from filters.types import Array

_NARROW_BAND = 0.01  # of the frequency: tones of a channel nearer together are told as one band


def report(assessment: Assessment) -> Trace:
    """Everything that is known, as records for reports, files and the filter."""
    included, correlation = included_effects(assessment)
    document = _document(assessment)
    made = assessment.experiment
    next_run = "" if made is None else sentence.next_run(made.duration_s, made.d_expected, (made.a, made.b))
    document["sentence"] = sentence.sentence(
        document, next_run=next_run, joining=[(x.effect, x.channels) for x in included]
    )
    return Trace(document, included, correlation, _series(assessment), made)


def _document(assessment: Assessment) -> TraceFindings:
    """All but its sentence."""
    screening = assessment.screening
    drift = assessment.design.drift
    logged = [blocks.run for blocks in assessment.design.stack.blocks]
    has_temperature = any(run.temperature is not None for run in logged)
    return {
        "untestable": list(screening.untestable),
        "integrity": integrity(screening.faults),
        "lines": [_line(line) for line in screening.lines],
        "noise_level": [
            {"channels": [CHANNELS[x.channel]], "driver": x.driver, "ratio": x.ratio} for x in screening.noise_drivers
        ],
        "findings": [*_findings(assessment), *screening.noise_findings],
        "refuted": [_refuted(x) for x in assessment.refuted],
        "common": common_causes.entries(assessment.common, [run.name for run in logged], has_temperature),
        "weak": [_weak(w, assessment.design.stack) for w in assessment.selection.weak],
        "drift": [_drift(c, drift[c], assessment) for c in assessment.drifting],
        "remainder": [_remainder(x, assessment) for x in assessment.remainder],
        "status": statuses(assessment),
        "error": [figure.entry() for figure in assessment.errors],
        "limits": list(assessment.limits),
        "carries_over": [],
        "seed": assessment.seed,
        "sentence": "",
    }


def _series(assessment: Assessment) -> tuple[RunSeries, ...]:
    """Residuals of every run before and after all that was chosen, the held-out one last."""
    stack, heldout = assessment.design.stack, assessment.heldout
    used = (*assessment.findings, *(x.finding for x in assessment.refuted))
    made = _series_of(stack, stack.y - correction(assessment.design, used))
    if heldout is not None:
        made += _series_of(heldout.stack, heldout.stack.y - heldout.correction(used))
    return tuple(made)


def _series_of(stack: Stack, after: Array) -> list[RunSeries]:
    made = []
    for start, blocks in zip(stack.starts.tolist(), stack.blocks, strict=True):
        rows = slice(start, start + blocks.t.size)
        hide = np.where(blocks.weight > 0.0, 0.0, np.nan)
        made.append(RunSeries(blocks.run.name, blocks.period, blocks.t, blocks.y + hide, after[rows] + hide))
    return made


# ----------------------------------------------------------------------------------------------------------- findings


def _findings(assessment: Assessment) -> list[FindingEntry]:
    """Findings as the report has them; tones of a channel within 1 % of each other are one narrow band."""
    out: list[FindingEntry] = []
    bands: list[tuple[Tone, FindingEntry, list[float]]] = []
    for f in assessment.findings:
        h = f.term.hypothesis
        entry = _finding(f, assessment)
        if isinstance(h, Tone):
            band = next((known for known in bands if _same_band(known[0], h)), None)
            if band is not None:
                _merge(h, entry, *band[1:])
                continue
            bands.append((h, entry, [h.hz]))
        out.append(entry)
    return out


def _label(h: Hypothesis, stack: Stack) -> str:
    """In words; of a step the run by its name, with the time since that run's start."""
    if not isinstance(h, Step) or h.run < 0:
        return h.label
    after = np.flatnonzero((stack.power_on == h.run) & (stack.t >= h.at))
    if not after.size:
        return h.label
    run = stack.blocks[int(np.searchsorted(stack.starts, after[0], side="right")) - 1].run
    return f"bias steps at {h.at - run.begins:.1f} s of {run.name}"


def _finding(f: Finding, assessment: Assessment) -> FindingEntry:
    h = f.term.hypothesis
    curve = curve_of(h, f.theta, f.covariance) if isinstance(h, Driver) else None
    return {
        "effect": h.effect,
        "label": _label(h, assessment.design.stack),
        "channels": [CHANNELS[c] for c in f.channels],
        "params": _parameters(f),
        "shape": dict(h.shape),
        "score": f.score,
        "odds": f.odds,
        "gain": f.gain,
        "heldout_gain": assessment.selection.unseen_gain.get(f.term.key),
        "share_of_excess": f.share,
        "driver_curve": curve,
        "proposed_form": None if curve is None else proposed_form(curve),
        "rivals": [_rival(r) for r in f.rivals],
        "include_as": "S" if isinstance(h, RunSpecific) else "A",
        "confirmed": f.confirmed,
        "common": common_causes.number_of_step(assessment.common, h),
    }


def _rival(r: Rival) -> RivalEntry:
    h = r.term.hypothesis
    return {
        "effect": h.effect,
        "label": h.label,
        "score_difference": r.score_difference,
        "odds": r.odds,
        "weight": r.weight,
    }


def _parameters(f: Finding | Weak) -> list[ParameterEntry]:
    """What was fitted, then what fixes the shape; of a tone its amplitude and frequency."""
    h = f.term.hypothesis
    if isinstance(f, Finding) and f.joint is not None:
        return parameters_of(f.joint, f.channels[0])
    if isinstance(h, Tone):
        return _tone(f, h)
    sd = np.sqrt(np.maximum(np.diag(f.covariance), 0.0))
    params = [
        fitted(p, float(value / p.si), float(s / p.si)) for p, value, s in zip(h.parameters, f.theta, sd, strict=True)
    ]
    return params + [_shape(name, value) for name, value in h.shape.items() if not isinstance(value, str)]


def _tone(f: Finding | Weak, h: Tone) -> list[ParameterEntry]:
    """Amplitude over the runs, root mean square, and frequency; of each one standard deviation."""
    _, si = error_unit(h.channel)
    # of a run that lacks the channel nothing is known
    seen = np.diag(f.covariance).reshape(-1, 2).any(axis=1)
    pairs = f.theta.reshape(-1, 2)[seen]
    size = np.maximum(np.linalg.norm(pairs, axis=1), 1e-300)
    along = pairs / size[:, None]
    blocks = [f.covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in np.flatnonzero(seen)]
    variance = np.array([u @ P @ u for u, P in zip(along, blocks, strict=True)])
    whole = float(np.sqrt(np.mean(size**2)))
    sd = float(np.sqrt(np.sum(size**2 * variance))) / (len(pairs) * whole)
    amplitude: ParameterEntry = {**fitted(h.parameters[0], whole / si, sd / si), "name": "amplitude"}
    return [amplitude, fixed("frequency", h.hz, "Hz")]


def _shape(name: str, value: float) -> ParameterEntry:
    base, _, unit = name.rpartition("_")
    units = {"s": "s", "k": "K", "degc": "degC", "hz": "Hz"}
    return (
        fixed(base, value, units[unit]) if unit in units and base else fixed(name, value, "Hz" if name == "hz" else "1")
    )


def _same_band(a: Tone, b: Tone) -> bool:
    return a.channel == b.channel and abs(a.hz - b.hz) < _NARROW_BAND * a.hz


def _merge(tone: Tone, entry: FindingEntry, into: FindingEntry, frequencies: list[float]) -> None:
    """Another tone of a narrow band into the first one's finding, whose frequencies so far are given."""
    frequencies.append(tone.hz)
    into["shape"]["all_hz"] = frequencies
    into["label"] = f"narrow band at {min(frequencies):.5g}-{max(frequencies):.5g} Hz"
    into["score"] += entry["score"]
    into["gain"] += entry["gain"]
    # powers add
    into["params"][0]["value"] = float(np.hypot(into["params"][0]["value"], entry["params"][0]["value"]))


# ----------------------------------------------------------------------------------------------------- all the others


def integrity(faults: tuple[FaultOfRun, ...]) -> list[IntegrityEntry]:
    """Faults of one kind on the same channels are one entry over all runs."""
    merged: dict[tuple[str, tuple[str, ...]], IntegrityEntry] = {}
    for x in faults:
        fault = x.fault
        entry = merged.setdefault(
            (fault.effect, fault.channels),
            {"effect": fault.effect, "channels": list(fault.channels), "count": 0, "where": "", "size": fault.size},
        )
        entry["count"] += fault.count
        entry["where"] += ("; " if entry["where"] else "") + f"{x.run}: {fault.where}"
    return list(merged.values())


def _line(line: SpectralLine) -> LineEntry:
    c = CHANNELS.index(line.channels[0])
    unit, si = error_unit(c)
    return {
        "channels": list(line.channels),
        "hz": line.hz,
        "width_hz": line.width_hz,
        "rms": float(line.rms[c]) / si,
        "unit": unit,
        "harmonics": list(line.harmonics),
        "rivals": [],
    }


def _refuted(x: Refuted) -> RefutedEntry:
    h = x.finding.term.hypothesis
    return {
        "effect": h.effect,
        "label": h.label,
        "channels": [CHANNELS[c] for c in x.finding.channels],
        "metric": x.metric,
        "after_with": x.after_with,
        "after_without": x.after_without,
        "unit": x.unit,
    }


def _weak(w: Weak, stack: Stack) -> WeakEntry:
    h = w.term.hypothesis
    return {
        "effect": h.effect,
        "label": _label(h, stack),
        "channels": [CHANNELS[c] for c in h.channels],
        "params": _parameters(w),
        "score": w.score,
        "guarded_score": w.guarded,
        "limit": None if w.limit is None else w.limit / h.parameters[0].si,
        "why": w.why,
        "odds": w.odds,
    }


def _drift(c: int, drift: Drift, assessment: Assessment) -> DriftEntry:
    unit, si = error_unit(c)
    return {
        "channels": [CHANNELS[c]],
        "kind": drift.kind,
        "tau_s": None if drift.is_walk else drift.tau,
        "level": drift.level / si,
        "unit": f"{unit}/√s" if drift.is_walk else unit,
        "common": common_causes.number_of_drift(assessment.common, c),
    }


def _remainder(x: RemainderEntry, assessment: Assessment) -> RemainderEntry:
    return {**x, "common": common_causes.number_of_drift(assessment.common, CHANNELS.index(x["channel"]))}


def curve_of(driver: Driver, theta: Array, covariance: Array) -> DriverCurveEntry | None:
    """Curve with its standard deviations at the knots, or over the turn; None for a driver with one slope only."""
    y_unit, si = error_unit(driver.channel)
    if driver.kind == "hat":
        x = np.array(driver.knots)
        B = np.vstack([np.zeros(x.size - 1), np.eye(x.size - 1)])
        unit = driver.unit
    elif driver.kind == "fourier" and driver.name.startswith("angle_"):
        x = np.linspace(-180.0, 180.0, 49)
        orders = np.arange(1, len(driver.parameters) // 2 + 1)
        phase = np.deg2rad(x)[:, None] * orders
        B = np.hstack([np.sin(phase), np.cos(phase)])
        unit = "deg"
    else:
        return None
    sd = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", B, covariance, B), 0.0))
    return {
        "driver": driver.name, "unit": unit, "x": x.tolist(), "y": (B @ theta / si).tolist(), "sd": (sd / si).tolist(),
        "y_unit": y_unit,
    }  # fmt: skip


_SHAPES: dict[str, tuple[Callable[[Array, float, float], Array], int]] = {
    "line": (lambda u, a, b: u, 1),
    "absolute value": (lambda u, a, b: np.abs(u - a), 2),
    "quadratic": (lambda u, a, b: (u - a) ** 2, 2),
    "cubic": (lambda u, a, b: (u - a) ** 3, 2),
    "tanh": (lambda u, a, b: np.tanh((u - a) / b), 3),
    "exponential": (lambda u, a, b: np.exp(-(u + 1.0) / b), 2),
    "threshold": (lambda u, a, b: (u > a).astype(np.float64), 2),
    "Gaussian bump": (lambda u, a, b: np.exp(-0.5 * ((u - a) / b) ** 2), 3),
    "sine": (lambda u, a, b: np.sin((u - a) / b), 3),
}


def proposed_form(found: DriverCurveEntry) -> str:
    """The simplest form that fits a curve, by BIC.

    Returns one of line, absolute value, quadratic, cubic, tanh, exponential, threshold, Gaussian bump, sine.
    """
    x, y = np.array(found["x"]), np.array(found["y"])
    u = 2.0 * (x - x.min()) / max(float(np.ptp(x)), 1e-12) - 1.0
    sd = np.maximum(found["sd"], 0.02 * max(float(np.ptp(y)), 1e-12))
    best, name = np.inf, "line"
    for form, (shape, parameters) in _SHAPES.items():
        chi2 = _least(shape, u, y, sd)
        bic = chi2 + (parameters + 1) * np.log(u.size)
        if bic < best - 1e-9:
            best, name = bic, form
    return name


def _least(shape: Callable[[Array, float, float], Array], u: Array, y: Array, sd: Array) -> float:
    """Least chi-square over centre and width; scale and offset are linear."""

    def chi2(p: Array) -> float:
        width = float(np.exp(np.clip(p[1], -4.0, 4.0)))
        X = np.column_stack([np.ones(u.size), shape(u, float(p[0]), width)]) / sd[:, None]
        theta = np.linalg.lstsq(X, y / sd, rcond=None)[0]
        return float(np.sum((y / sd - X @ theta) ** 2))

    grid = [(a, b) for a in np.linspace(-0.8, 0.8, 7) for b in np.log([0.15, 0.4, 1.0])]
    start = min(grid, key=lambda p: chi2(np.array(p)))
    return float(min(chi2(np.array(start)), optimize.minimize(chi2, np.array(start), method="Nelder-Mead").fun))

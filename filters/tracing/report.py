"""A judgement as a report: fields of contracts section 6, a sentence, what joins the filter, series for figures."""

from typing import Any

import numpy as np

from filters.channels import CHANNELS, error_unit
from filters.effects import lines, run_specific
from filters.effects.drivers import Driver
from filters.effects.records import Included, RunSeries, State, Trace
from filters.effects.run_specific import RunSpecific
from filters.tracing import driver_curve, selection
from filters.tracing.assessment import Finding, Judgement
from filters.tracing.whitening import Drift
from filters.types import Array

_IMPLAUSIBLE = 5.0
_SPIKE = 7.0
_TONE_S = 600.0


class Document:
    """Says what a judgement holds.

    Parameters
    ----------
    judged : Judgement
        With everything judged.
    """

    def __init__(self, judged: Judgement) -> None:
        self._judged = judged

    def trace(self) -> Trace:
        """Everything as records."""
        included, correlation = self._included()
        document: dict[str, Any] = {
            "version": 1,
            "untestable": [u.document() for u in self._judged.untestable],
            "integrity": self._integrity(),
            "lines": [_line(line) for line in self._judged.lines],
            "noise_level": [
                {"channels": [CHANNELS[x.channel]], "driver": x.driver, "ratio": x.ratio} for x in self._judged.levels
            ],
            "findings": self._documents() + self._judged.structure,
            "weak": [_weak(w) for w in self._judged.chosen.weak],
            "drift": [
                _drift(c, self._judged.design.drift[c])
                for c in self._judged.channels
                if self._judged.design.drift[c].level > 0.0
            ],
            "remainder": self._judged.remainder,
            "status": self._judged.status,
            "separating_experiment": self._judged.experiment,
            "error": [figure.document() for figure in self._judged.figures],
            "limits": self._judged.limits,
            "seed": self._judged.seed,
        }
        document["sentence"] = self._sentence()
        return Trace(document, included, correlation, self._series())

    def _integrity(self) -> list[dict[str, Any]]:
        merged: dict[tuple[str, tuple[str, ...]], dict[str, Any]] = {}
        for fault, run in zip(self._judged.faults, self._judged.fault_runs, strict=True):
            entry = merged.setdefault(
                (fault.effect, fault.channels),
                {"effect": fault.effect, "channels": list(fault.channels), "count": 0, "where": "", "size": fault.size},
            )
            entry["count"] += fault.count
            entry["where"] += ("; " if entry["where"] else "") + f"{run}: {fault.where}"
        return list(merged.values())

    def _documents(self) -> list[dict[str, Any]]:
        """Findings as the report has them; tones of a channel within 1 % of each other are one narrow band."""
        out: list[dict[str, Any]] = []
        bands: list[tuple[Finding, dict[str, Any]]] = []
        for f in self._judged.found:
            h = f.term.hypothesis
            document = self._finding(f)
            if isinstance(h, run_specific.Tone):
                first = next((d for g, d in bands if _same_band(g, f)), None)
                if first is not None:
                    _merge(first, document)
                    continue
                bands.append((f, document))
            out.append(document)
        return out

    def _finding(self, f: Finding) -> dict[str, Any]:
        h = f.term.hypothesis
        sd = np.sqrt(np.maximum(np.diag(f.covariance), 0.0))
        params = [
            {
                "name": p.name,
                "value": float(value / p.si),
                "sd": float(s / p.si),
                "unit": p.unit,
                "plausible": bool(p.prior <= 0.0 or abs(value / p.si) <= _IMPLAUSIBLE * p.prior),
            }
            for p, value, s in zip(h.parameters(), f.theta, sd, strict=True)
        ]
        params += [_shape(name, value) for name, value in h.shape().items() if not isinstance(value, str)]
        curve = driver_curve.curve(h, f.theta, f.covariance) if isinstance(h, Driver) else None
        return {
            "effect": h.effect,
            "label": h.label,
            "channels": [CHANNELS[c] for c in f.channels],
            "params": params,
            "shape": dict(h.shape()),
            "score": f.score,
            "gain": f.gain,
            "heldout_gain": self._judged.chosen.heldout.get(f.term.key),
            "share_of_excess": f.share,
            "driver_curve": None if curve is None else curve.document(),
            "proposed_form": None if curve is None else driver_curve.proposed_form(curve),
            "rivals": [
                {
                    "effect": r.term.hypothesis.effect,
                    "label": r.term.hypothesis.label,
                    "score_difference": r.score_difference,
                }
                for r in f.rivals
            ],
            "include_as": "S" if isinstance(h, RunSpecific) else "A",
            "confirmed": f.confirmed,
        }

    def _included(self) -> tuple[tuple[Included, ...], Array]:
        """What joins the filter: findings that carry over and were not refuted, and drift."""
        fit = self._judged.chosen.fit()
        used = [
            f for f in self._judged.found if f.confirmed is not False and not isinstance(f.term.hypothesis, RunSpecific)
        ]
        out, rows = [], []
        for f in used:
            h = f.term.hypothesis
            at = fit.offsets[self._judged.chosen.terms.index(f.term)]
            rows += list(range(at, at + f.term.size))
            sd = np.sqrt(np.maximum(np.diag(f.covariance), 0.0))
            states = tuple(
                State(p.name, p.unit, float(v / p.si), float(s / p.si))
                for p, v, s in zip(h.parameters(), f.theta, sd, strict=True)
            )
            parameters: dict[str, Any] = dict(h.shape())
            if isinstance(h, Driver) and h.knots:
                parameters["knots"] = list(h.knots)
            names = tuple(CHANNELS[c] for c in h.channels)
            out.append(Included(h.effect, names, "A", parameters, states))
        tones = [f for f in self._judged.found if isinstance(f.term.hypothesis, run_specific.Tone)]
        P = fit.covariance[np.ix_(rows, rows)] if rows else np.zeros((0, 0))
        walks = [c for c in self._judged.channels if self._judged.design.drift[c].level > 0.0]
        out += [_included_drift(c, self._judged.design.drift[c]) for c in walks]
        out += [
            Included(
                "noise_level",
                (CHANNELS[level.channel],),
                "N",
                {"driver": level.driver, "knots": list(level.knots), "ratio": list(level.at)},
            )
            for level in self._judged.levels
            if level.knots and not level.driver.startswith(("since_motion", "table_accel"))
        ]
        out += self._gates()
        out += [_included_tone(f) for f in tones]
        total = np.eye(len(rows) + len(walks) + 2 * len(tones))
        if rows:
            scale = np.sqrt(np.diag(P))
            total[: len(rows), : len(rows)] = P / np.outer(scale, scale)
        return tuple(out), total

    def _gates(self) -> list[Included]:
        """Readings that the filter is to predict through: spikes and limits."""
        out = []
        for effect in ("spikes", "saturation"):
            for c in self._judged.channels:
                sizes = [
                    f.size for f in self._judged.faults if f.effect == effect and CHANNELS[c] in f.channels and f.size
                ]
                if not sizes:
                    continue
                unit = error_unit(c)[1]
                rough = [b.rough[:, c].sum() / max(1.0, b.pairs[:, c].sum()) for b in self._judged.stack.blocks]
                limit = _SPIKE * float(np.sqrt(0.5 * np.median(rough))) if effect == "spikes" else min(sizes)
                out.append(Included(effect, (CHANNELS[c],), "P", {"limit": limit / unit}))
        return out

    def _series(self) -> tuple[RunSeries, ...]:
        made = []
        stacks = [self._judged.stack] if self._judged.heldout is None else [self._judged.stack, self._judged.heldout]
        for stack in stacks:
            used = [f for f in self._judged.found if f.confirmed is not False]
            after = stack.y - self._judged.correction(used, held=stack is self._judged.heldout)
            for start, blocks in zip(stack.starts.tolist(), stack.blocks, strict=True):
                rows = slice(start, start + blocks.t.size)
                hide = np.where(blocks.weight > 0.0, 0.0, np.nan)
                made.append(RunSeries(blocks.run.name, blocks.period, blocks.t, blocks.y + hide, after[rows] + hide))
        return tuple(made)

    def _sentence(self) -> str:
        if self._judged.found:
            f = self._judged.found[0]
            h = f.term.hypothesis
            where = ", ".join(CHANNELS[c] for c in f.channels)
            text = f"{where}: {h.label}"
            if f.term.size == 1 and f.theta.size:
                p, sd = h.parameters()[0], float(np.sqrt(f.covariance[0, 0]))
                text += f", {f.theta[0] / p.si:.4g} ± {sd / p.si:.2g}{f' {p.unit}' if p.unit != '1' else ''}"
            text += f", explains {100.0 * f.share:.0f} % of what the constant bias does not"
            if f.rivals:
                names = " or ".join(r.term.hypothesis.effect for r in f.rivals[:3])
                text += f"; this log does not tell it from {names}"
            more = len(self._judged.found) - 1
            text += f"; {more} more finding{'s' if more > 1 else ''}" if more else ""
            return text + "." + self._error_words(f)
        drifting = [CHANNELS[c] for c in self._judged.channels if self._judged.design.drift[c].level > 0.0]
        if drifting:
            return f"{', '.join(drifting)}: drift that no logged variable explains; nothing else was found."
        if self._judged.structure:
            first = self._judged.structure[0]
            return f"{', '.join(first['channels'])}: {first['label']}; no other effect was found."
        if self._judged.faults or self._judged.lines or self._judged.levels:
            return "Faults, lines or an uneven noise level were found, and no effect beyond them."
        return "Nothing was found: constant biases and white noise explain these data, as far as their motion can show."

    def _error_words(self, f: Finding) -> str:
        own = [x for x in self._judged.figures if x.metric == "e10" and x.channel in {CHANNELS[c] for c in f.channels}]
        if not own:
            return ""
        x = max(own, key=lambda figure: figure.before / figure.floor)
        how = "on a run not used" if x.heldout == "run" else "within the run, which does not show transfer"
        return f" Error {x.before / x.floor:.2g} → {x.after / x.floor:.2g} × floor {how}."


def _same_band(a: Finding, b: Finding) -> bool:
    p, q = a.term.hypothesis, b.term.hypothesis
    assert isinstance(p, run_specific.Tone)
    assert isinstance(q, run_specific.Tone)
    return p.channel == q.channel and abs(p.hz - q.hz) < 0.01 * p.hz


def _merge(into: dict[str, Any], more: dict[str, Any]) -> None:
    """Another tone of a narrow band into the first one's finding."""
    own = into["shape"].setdefault("all_hz", [into["shape"]["hz"]])
    own.append(more["shape"]["hz"])
    into["label"] = f"narrow band at {min(own):.5g}-{max(own):.5g} Hz"
    into["score"] += more["score"]
    into["gain"] += more["gain"]


def _line(line: lines.SpectralLine) -> dict[str, Any]:
    c = CHANNELS.index(line.channels[0])
    unit, si = error_unit(c)
    value = float(line.rms[c]) / si
    return {
        "channels": list(line.channels),
        "hz": line.hz,
        "width_hz": line.width_hz,
        "rms": value,
        "unit": unit,
        "harmonics": list(line.harmonics),
    }


def _shape(name: str, value: float) -> dict[str, Any]:
    base, _, unit = name.rpartition("_")
    units = {"s": "s", "k": "K", "degc": "degC", "hz": "Hz"}
    if unit in units and base:
        return {"name": base, "value": value, "sd": None, "unit": units[unit], "plausible": True}
    return {"name": name, "value": value, "sd": None, "unit": "Hz" if name == "hz" else "1", "plausible": True}


def _weak(w: selection.Weak) -> dict[str, Any]:
    h = w.term.hypothesis
    return {
        "effect": h.effect,
        "label": h.label,
        "channels": [CHANNELS[c] for c in h.channels],
        "score": w.score,
        "guarded_score": w.guarded,
        "why": w.why,
    }


def _included_tone(f: Finding) -> Included:
    """A slow tone as two states that forget in ten minutes: its phase is every run's own."""
    h = f.term.hypothesis
    assert isinstance(h, run_specific.Tone)
    unit, si = error_unit(h.channel)
    amplitude = float(np.sqrt(np.mean(f.theta**2))) / si
    q = amplitude * float(np.sqrt(2.0 / _TONE_S))
    states = tuple(State(name, unit, 0.0, amplitude, _TONE_S, q) for name in ("sin", "cos"))
    return Included("tone", (CHANNELS[h.channel],), "S", {"hz": h.hz}, states)


def _drift(c: int, drift: Drift) -> dict[str, Any]:
    unit, si = error_unit(c)
    walk = bool(np.isinf(drift.tau))
    return {
        "channels": [CHANNELS[c]],
        "kind": drift.kind,
        "tau_s": None if walk else drift.tau,
        "level": drift.level / si,
        "unit": f"{unit}/√s" if walk else unit,
    }


def _included_drift(c: int, drift: Drift) -> Included:
    unit, si = error_unit(c)
    walk = bool(np.isinf(drift.tau))
    level = drift.level / si
    q = level if walk else level * float(np.sqrt(2.0 / drift.tau))
    state = State("drift", unit, 0.0, 1e-9 if walk else level, drift.tau, q)
    return Included(drift.kind, (CHANNELS[c],), "S", {}, (state,))

"""From runs to findings: faults and lines out, noise levelled, effects selected, rivals named, the held-out run judged.

`selection` decides what is there; this module gives it clean blocks, checks what it found on data it has not seen, and
says in the fields of a report what is known, what may be, and what can't be told.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from filters import curves, experiment, levels, residual, selection, untestable, verification
from filters.effects import events, faults, lines, noise
from filters.effects.drivers import Driver
from filters.effects.events import Event
from filters.effects.hypothesis import CHANNELS, DPS, MG
from filters.effects.record import Included, Series, State, Trace
from filters.evidence import Atom, Design, Stack, columns_on
from filters.residual import Run
from filters.selection import Rival, Selection
from filters.types import Array
from filters.whitening import NONE, Drift, unbiased

LEAST_S = 60.0
"""A run must be this long to be used at all."""
REMAINDER = 1e-4 / 24.0
_SCALES_S = (1.0, 4.0, 16.0, 64.0)
_IMPLAUSIBLE = 5.0
_MATERIAL = 9.0
_LONG_S = 4.0 * 3600.0
_IN_BAND = 1.2
_DISPUTED, _RIVALS = 3, 4
_SURE = 1.7
_LEAST_CORRELATION = 0.03
_SPIKE = 7.0
_WORSE = 1.1
_TONE_S = 600.0

Progress = Callable[[float, str], None]


def trace(
    runs: Sequence[Run],
    heldout: Run | None,
    *,
    asked: Sequence[str] = (),
    seed: int = 0,
    progress: Progress = lambda share, text: None,
) -> Trace:
    """Trace what the model of constant biases lacks.

    Parameters
    ----------
    runs : sequence of Run
        Power-ons to learn from, at least one.
    heldout : Run or None
        A power-on that nothing is fitted to; without one, folds of the runs judge.
    asked : sequence of str
        Effects whose limit of detection is to be said.
    seed : int
        Of intervals and bands.
    progress : callable
        Told a share from 0 to 1 and what is being done.

    Returns
    -------
    Trace

    Raises
    ------
    ValueError
        If there is no run, or one is too short.
    """
    _check(runs, heldout)
    progress(0.0, "looking for faults")
    clean = [_cleaned(run) for run in (*runs, *([heldout] if heldout else []))]
    spectral = _lines(clean[: len(runs)])
    ready = [_without_lines(run, spectral) for run, _ in clean]
    progress(0.2, "averaging")
    total = sum(run.seconds for run in runs)
    moving = any(not run.still for run in runs)
    block_s = residual.BLOCK_S if total < _LONG_S or not moving else min(1.0, residual.BLOCK_S * total / _LONG_S)
    blocks = [residual.blocks(run, block_s) for run in ready]
    design = Design(Stack.of(blocks[: len(runs)]))
    channels = [c for c in range(6) if design.sd[c] > 0.0 and design.stack.seconds(c) > 0.5 * LEAST_S]
    progress(0.35, "levelling the noise")
    design.multiplier, level = levels.levels(design, channels)
    hidden = untestable.untestable(design, channels)
    progress(0.4, "comparing effects")
    chosen = selection.select(design, channels, lambda share: progress(0.4 + 0.4 * share, "comparing effects"))
    progress(0.8, "judging")
    work = _Report(chosen, channels, seed, Stack.of(blocks[len(runs) :]) if heldout else None)
    work.faults = [fault for _, own in clean for fault in own]
    work.fault_runs = [run.name for run, own in clean for _ in own]
    work.lines, work.levels, work.untestable = spectral, level, hidden
    work.judge(ready, asked)
    progress(1.0, "done")
    return work.trace(ready)


def _check(runs: Sequence[Run], heldout: Run | None) -> None:
    if not runs:
        raise ValueError("`runs` is empty: there is nothing to trace")
    for run in (*runs, *([heldout] if heldout else [])):
        if run.t.size < 8 or run.seconds < LEAST_S:
            raise ValueError(
                f"{run.name} lasts {run.seconds:.1f} s: a run must last {LEAST_S:.0f} s at least, and a held-out one"
                f" {verification.LEAST_S:.0f} s for a verdict"
            )


def _cleaned(run: Run) -> tuple[Run, list[faults.Fault]]:
    """A run with its faults flagged."""
    flagged, found = faults.find(run.t, run.reading, residual.perfect(run), run.lsb)
    if run.flagged is not None:
        flagged |= run.flagged
    # the steps of averaged samples are uneven by design, and their stamps say so truly
    return replace(run, flagged=flagged), [f for f in found if not (run.averaged and f.effect == "jitter")]


def _lines(clean: Sequence[tuple[Run, list[faults.Fault]]]) -> list[lines.Line]:
    return lines.find([(run.rate_hz, residual.residual(run)) for run, _ in clean])


def _without_lines(run: Run, spectral: list[lines.Line]) -> Run:
    """A run without its lines."""
    if not spectral:
        return run
    r = residual.residual(run)
    less = lines.removed(spectral, run.rate_hz, r) - r
    return replace(run, reading=run.reading + np.nan_to_num(less))


# -------------------------------------------------------------------------------------------------------- the report


@dataclass(frozen=True)
class _Found:
    """A finding with all that is said of it."""

    atom: Atom
    theta: Array
    covariance: Array
    score: float
    gain: float
    share: float
    rivals: list[Rival]
    channels: tuple[int, ...]
    confirmed: bool | None = None


class _Report:
    """Gathers what a report says; one method a part."""

    def __init__(self, chosen: Selection, channels: list[int], seed: int, heldout: Stack | None) -> None:
        self.chosen = chosen
        self.design = chosen.design
        self.stack = chosen.design.stack
        self.channels = channels
        self.seed = seed
        self.heldout = heldout
        self.white = self.design.sd * np.sqrt(self.stack.period)
        self.faults: list[faults.Fault] = []
        self.fault_runs: list[str] = []
        self.lines: list[lines.Line] = []
        self.levels: list[levels.Level] = []
        self.untestable: list[untestable.Untestable] = []
        self.structure: list[dict[str, Any]] = []
        self.limits: list[dict[str, Any]] = []
        self.found: list[_Found] = []
        self._held_columns: dict[tuple[object, int], Array] = {}
        self.figures: list[verification.Figure] = []
        self.remainder: list[dict[str, Any]] = []
        self.status: dict[str, str] = {}
        self.experiment: dict[str, Any] | None = None

    def judge(self, runs: list[Run], asked: Sequence[str]) -> None:
        """Fill in everything."""
        training = runs[: len(self.stack.blocks)]
        series = [(run.rate_hz, residual.residual(run)) for run in training]
        self.structure = _structure(series, training)
        self._findings()
        self._confirm()
        self._errors()
        self._remainder()
        self.status = {CHANNELS[c]: self._status(c) for c in range(6)}
        self.limits = [limit for effect in asked for limit in self._limits(effect)]
        self._experiment()

    # ---------------------------------------------------------------------------------------------------- findings

    def _findings(self) -> None:
        fit = self.chosen.fit()
        left = {c: self._left(c) for c in self.channels}
        for number, atom in enumerate(self.chosen.atoms):
            theta, covariance = fit.of(number)
            gain = self.chosen.own_gain(atom)
            where = self._where(atom, number)
            share = gain / (gain + sum(left.get(c, 0.0) for c in where))
            others = selection.rivals(self.chosen, atom)
            score = gain - self.chosen.price(atom)
            self.found.append(_Found(atom, theta, covariance, score, gain, share, others, where))
        self.found.sort(key=lambda f: -f.score)

    def _left(self, channel: int) -> float:
        """Chi-square of a channel that nothing found explains, beyond what chance gives sums over 16 blocks."""
        r = self.design.unexplained(self.chosen.atoms, channel)
        white = unbiased(r[:, None], self.stack.run, self.design.variance(channel))[:, 0]
        size = white.size // 16 * 16
        sums = white[:size].reshape(-1, 16).sum(axis=1) ** 2 / 16.0
        return max(0.0, float(sums.sum() - sums.size - 2.0 * np.sqrt(2.0 * sums.size)))

    def _where(self, atom: Atom, number: int) -> tuple[int, ...]:
        """Channels on which an effect matters."""
        if len(atom.places) == 1:
            return tuple(atom.places)
        fit = self.chosen.fit()
        theta = fit.theta[number]
        drops = {}
        for c, places in atom.places.items():
            G = self.design.gram(c)[0][np.ix_(places, places)]
            drops[c] = float(theta @ G @ theta)
        most = max(drops.values())
        return tuple(c for c, d in drops.items() if d > _MATERIAL and d > 0.002 * most) or tuple(atom.places)

    # --------------------------------------------------------------------------------------------- on unseen data

    def _held(self, atom: Atom, c: int) -> Array:
        """Columns of a finding on the held-out run, shape (n, k)."""
        if not self._held_columns and self.heldout is not None:
            lasting = [f.atom for f in self.found if not isinstance(f.atom.hypothesis, Event)]
            self._held_columns = columns_on(self.heldout, lasting)
        return self._held_columns[atom.key, c]

    def _correction(self, found: Sequence[_Found], held: bool = True) -> Array:
        """What findings that carry over say of the held-out run's residual, or of the others', shape (n, 6)."""
        stack = self.heldout if held and self.heldout is not None else self.stack
        out = np.zeros_like(stack.y)
        for f in found:
            if not isinstance(f.atom.hypothesis, Event):
                for c, places in f.atom.places.items():
                    columns = self.design.columns[:, places] if stack is self.stack else self._held(f.atom, c)
                    out[:, c] += columns @ f.theta
        return out

    def _confirm(self) -> None:
        """Whether each finding that carries over lowers error or NIS on the held-out run."""
        if self.heldout is None:
            return
        everything = self._correction(self.found)
        for number, f in enumerate(self.found):
            if isinstance(f.atom.hypothesis, Event):
                continue
            own = self._correction([f])
            better, seen = False, False
            for c in f.channels:
                if np.ptp(own[:, c]) < 0.02 * self.design.sd[c]:
                    continue
                seen = True
                corrected = self.heldout.y[:, c] - everything[:, c]
                better |= self._lowers(c, corrected + own[:, c], corrected)
            self.found[number] = replace(f, confirmed=better if seen else None)

    def _lowers(self, c: int, before: Array, after: Array) -> bool:
        assert self.heldout is not None
        white = self._heldout_white(c)
        error = verification.e10(self.heldout, before, after, c, white, self.seed)
        if error is not None and error.after != error.before:
            if error.after < error.before:
                return True
            if error.after > _WORSE * error.before:
                return False
        honest = verification.nis(self.heldout, before, after, c, white, NONE)
        return honest is not None and honest.after < honest.before

    def _heldout_white(self, c: int) -> float:
        assert self.heldout is not None
        own = self.heldout.white_sd()[c]
        return float(own if own > 0.0 else self.design.sd[c]) * float(np.sqrt(self.heldout.period))

    def _errors(self) -> None:
        if self.heldout is None:
            self._errors_by_folds()
            return
        used = [f for f in self.found if f.confirmed is not False]
        after = self.heldout.y - self._correction(used)
        white = np.array([self._heldout_white(c) for c in range(6)])
        for c in self.channels:
            before = self.heldout.y[:, c]
            made = [
                verification.e10(self.heldout, before, after[:, c], c, white[c], self.seed),
                verification.nis(
                    self.heldout, before, after[:, c], c, white[c], self.design.drift[c], self._uncertainty(used, c)
                ),
                *verification.prediction(self.heldout, before, after[:, c], c, white[c], self.design.drift[c]),
            ]
            self.figures += [figure for figure in made if figure is not None]
        if len(self.channels) == 6:
            for seconds in (10.0, 60.0):
                drift = verification.drift(
                    self.heldout, self.heldout.y, after, white, self.design.drift, seconds, self.seed
                )
                self.figures += [drift] if drift is not None else []

    def _uncertainty(self, used: Sequence[_Found], c: int) -> Array:
        """Variance of the correction of a channel, about its mean, SI, shape (n,)."""
        assert self.heldout is not None
        out = np.zeros(self.heldout.t.size)
        for f in used:
            if c in f.atom.places and not isinstance(f.atom.hypothesis, Event):
                X = self._held(f.atom, c)
                X = X - X.mean(axis=0)
                out += np.einsum("ij,jk,ik->i", X, f.covariance, X)
        return out

    def _errors_by_folds(self) -> None:
        for c in self.channels:
            own = [self.design.columns[:, f.atom.places[c]] for f in self.found if c in f.atom.places]
            columns = np.column_stack(own) if own else np.zeros((self.stack.t.size, 0))
            figure = verification.folded(self.stack, self.stack.y[:, c], columns, c, self.white[c], self.seed)
            self.figures += [figure] if figure is not None else []

    # -------------------------------------------------------------------------------------------------- remainder

    def _remainder(self) -> None:
        scales = [max(1, round(s / self.stack.period)) for s in _SCALES_S]
        for c in self.channels:
            white = self.design.residual(self.chosen.atoms, c)
            white = np.where(self.stack.weight[:, c] > 0.0, white, np.nan)
            for m, ratio, p in noise.variance_ratio(white, scales):
                if p < REMAINDER:
                    scale = m * self.stack.period
                    self.remainder.append({"channel": CHANNELS[c], "scale_s": scale, "ratio": ratio, "p": p})

    # ----------------------------------------------------------------------------------------------------- status

    def _status(self, c: int) -> str:
        name = CHANNELS[c]
        found = [f for f in self.found if c in f.channels]
        drift = c in self.channels and self.design.drift[c].level > 0.0
        rest = any(r["channel"] == name for r in self.remainder)
        aside = self._aside(name)
        lasting = [f for f in found if not isinstance(f.atom.hypothesis, Event)]
        if not found:
            if drift:
                return "stochastic"
            if rest or (c in self.channels and not aside and self._out_of_band(c)):
                return "unexplained"
            return "explained" if aside else "clean"
        if any(f.rivals for f in lasting):
            return "confounded"
        single = len(self.stack.blocks) + (self.heldout is not None) == 1
        if single and any(f.atom.hypothesis.source != "motion" for f in lasting):
            return "confounded"
        refuted = any(f.confirmed is False for f in lasting)
        if drift or rest or refuted or (lasting and self._out_of_band(c)):
            return "partial"
        return "explained" if lasting else "run_specific"

    def _aside(self, name: str) -> bool:
        """Whether a channel has faults, lines, noise level or noise structure."""
        return (
            any(name in f.channels for f in self.faults)
            or any(name in line.channels for line in self.lines)
            or any(CHANNELS[level.channel] == name for level in self.levels)
            or any(name in s["channels"] for s in self.structure)
        )

    def _out_of_band(self, c: int) -> bool:
        """Whether the held-out error is above its floor's band."""
        for figure in self.figures:
            if figure.channel == CHANNELS[c] and figure.metric == "e10" and figure.heldout == "run":
                # one channel in forty is outside the 95 % band by chance: a verdict asks for a thousandth
                limit = figure.floor + _SURE * (figure.floor_band95[1] - figure.floor)
                limit = max(limit, _IN_BAND * figure.floor)
                if figure.after > limit:
                    return True
        return False

    def _limits(self, effect: str) -> list[dict[str, Any]]:
        """Smallest size of an effect that this log would show on each channel: d = 5."""
        out = []
        for atom in self.design.atoms:
            h = atom.hypothesis
            if h.effect != effect or atom.size != 1 or any(f.atom.key == atom.key for f in self.found):
                continue
            free = self.design.gains([], [atom])
            information = sum(self.design.gram(c)[0][p[0], p[0]] for c, p in atom.places.items())
            if not free.size or information <= 0.0:
                continue
            p = h.parameters()[0]
            limit = 5.0 / float(np.sqrt(information)) / p.si
            channels = [CHANNELS[c] for c in h.channels]
            shape = ", ".join(f"{k} {v}" for k, v in h.shape().items())
            unit = f" {p.unit}" if p.unit != "1" else ""
            text = f"below what this log can show (limit {limit:.3g}{unit}{', ' + shape if shape else ''})"
            out.append({"effect": effect, "channels": channels, "limit": limit, "unit": p.unit, "text": text})
        return out

    def _experiment(self) -> None:
        """The run to make next: for the first finding that one separates from a rival, else what comes nearest."""
        disputed = [f for f in self.found if f.rivals][:_DISPUTED]
        if not disputed:
            return
        run = self.stack.blocks[0].run
        library = experiment.Library(self.design, run)
        best = -1.0
        for f in disputed:
            rest = [atom for atom in self.chosen.atoms if atom is not f.atom]
            others = [r.atom for r in f.rivals[:_RIVALS]]
            made = experiment.separating(self.design, f.atom, f.theta, others, run, rest, library)
            if made is not None and made["d_expected"] > best:
                self.experiment, best = made, made["d_expected"]
            if best >= experiment.SEPARATES:
                return

    # --------------------------------------------------------------------------------------------------- document

    def trace(self, runs: list[Run]) -> Trace:
        """Everything as records."""
        included, correlation = self._included()
        document: dict[str, Any] = {
            "version": 1,
            "untestable": [u.document() for u in self.untestable],
            "integrity": self._integrity(),
            "lines": [_line(line) for line in self.lines],
            "noise_level": [
                {"channels": [CHANNELS[x.channel]], "driver": x.driver, "ratio": x.ratio} for x in self.levels
            ],
            "findings": self._documents() + self.structure,
            "weak": [_weak(w) for w in self.chosen.weak],
            "drift": [_drift(c, self.design.drift[c]) for c in self.channels if self.design.drift[c].level > 0.0],
            "remainder": self.remainder,
            "status": self.status,
            "separating_experiment": self.experiment,
            "error": [figure.document() for figure in self.figures],
            "limits": self.limits,
            "seed": self.seed,
        }
        document["sentence"] = self._sentence()
        return Trace(document, included, correlation, self._series())

    def _integrity(self) -> list[dict[str, Any]]:
        merged: dict[tuple[str, tuple[str, ...]], dict[str, Any]] = {}
        for fault, run in zip(self.faults, self.fault_runs, strict=True):
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
        bands: list[tuple[_Found, dict[str, Any]]] = []
        for f in self.found:
            h = f.atom.hypothesis
            document = self._finding(f)
            if isinstance(h, events.Tone):
                first = next((d for g, d in bands if _same_band(g, f)), None)
                if first is not None:
                    _merge(first, document)
                    continue
                bands.append((f, document))
            out.append(document)
        return out

    def _finding(self, f: _Found) -> dict[str, Any]:
        h = f.atom.hypothesis
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
        curve = curves.curve(h, f.theta, f.covariance) if isinstance(h, Driver) else None
        return {
            "effect": h.effect,
            "label": h.label,
            "channels": [CHANNELS[c] for c in f.channels],
            "params": params,
            "shape": dict(h.shape()),
            "score": f.score,
            "gain": f.gain,
            "heldout_gain": self.chosen.heldout.get(f.atom.key),
            "share_of_excess": f.share,
            "driver_curve": None if curve is None else curve.document(),
            "proposed_form": None if curve is None else curves.proposed_form(curve),
            "rivals": [
                {
                    "effect": r.atom.hypothesis.effect,
                    "label": r.atom.hypothesis.label,
                    "score_difference": r.score_difference,
                }
                for r in f.rivals
            ],
            "include_as": "S" if isinstance(h, Event) else "A",
            "confirmed": f.confirmed,
        }

    def _included(self) -> tuple[tuple[Included, ...], Array]:
        """What joins the filter: findings that carry over and were not refuted, and drift."""
        fit = self.chosen.fit()
        used = [f for f in self.found if f.confirmed is not False and not isinstance(f.atom.hypothesis, Event)]
        out, rows = [], []
        for f in used:
            h = f.atom.hypothesis
            at = fit.offsets[self.chosen.atoms.index(f.atom)]
            rows += list(range(at, at + f.atom.size))
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
        tones = [f for f in self.found if isinstance(f.atom.hypothesis, events.Tone)]
        P = fit.covariance[np.ix_(rows, rows)] if rows else np.zeros((0, 0))
        walks = [c for c in self.channels if self.design.drift[c].level > 0.0]
        out += [_included_drift(c, self.design.drift[c]) for c in walks]
        out += [
            Included(
                "noise_level",
                (CHANNELS[level.channel],),
                "N",
                {"driver": level.driver, "knots": list(level.knots), "ratio": list(level.at)},
            )
            for level in self.levels
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
            for c in self.channels:
                sizes = [f.size for f in self.faults if f.effect == effect and CHANNELS[c] in f.channels and f.size]
                if not sizes:
                    continue
                unit = DPS if c < 3 else MG
                rough = [b.rough[:, c].sum() / max(1.0, b.pairs[:, c].sum()) for b in self.stack.blocks]
                limit = _SPIKE * float(np.sqrt(0.5 * np.median(rough))) if effect == "spikes" else min(sizes)
                out.append(Included(effect, (CHANNELS[c],), "P", {"limit": limit / unit}))
        return out

    def _series(self) -> tuple[Series, ...]:
        made = []
        stacks = [self.stack] if self.heldout is None else [self.stack, self.heldout]
        for stack in stacks:
            used = [f for f in self.found if f.confirmed is not False]
            after = stack.y - self._correction(used, held=stack is self.heldout)
            for start, blocks in zip(stack.starts.tolist(), stack.blocks, strict=True):
                rows = slice(start, start + blocks.t.size)
                hide = np.where(blocks.weight > 0.0, 0.0, np.nan)
                made.append(Series(blocks.run.name, blocks.period, blocks.t, blocks.y + hide, after[rows] + hide))
        return tuple(made)

    def _sentence(self) -> str:
        if self.found:
            f = self.found[0]
            h = f.atom.hypothesis
            where = ", ".join(CHANNELS[c] for c in f.channels)
            text = f"{where}: {h.label}"
            if f.atom.size == 1 and f.theta.size:
                p, sd = h.parameters()[0], float(np.sqrt(f.covariance[0, 0]))
                text += f", {f.theta[0] / p.si:.4g} ± {sd / p.si:.2g}{f' {p.unit}' if p.unit != '1' else ''}"
            text += f", explains {100.0 * f.share:.0f} % of what the constant bias does not"
            if f.rivals:
                names = " or ".join(r.atom.hypothesis.effect for r in f.rivals[:3])
                text += f"; this log does not tell it from {names}"
            more = len(self.found) - 1
            text += f"; {more} more finding{'s' if more > 1 else ''}" if more else ""
            return text + "." + self._judged(f)
        drifting = [CHANNELS[c] for c in self.channels if self.design.drift[c].level > 0.0]
        if drifting:
            return f"{', '.join(drifting)}: drift that no logged variable explains; nothing else was found."
        if self.structure:
            return (
                f"{', '.join(self.structure[0]['channels'])}: {self.structure[0]['label']}; no other effect was found."
            )
        if self.faults or self.lines or self.levels:
            return "Faults, lines or an uneven noise level were found, and no effect beyond them."
        return "Nothing was found: constant biases and white noise explain these data, as far as their motion can show."

    def _judged(self, f: _Found) -> str:
        own = [x for x in self.figures if x.metric == "e10" and x.channel in {CHANNELS[c] for c in f.channels}]
        if not own:
            return ""
        x = max(own, key=lambda figure: figure.before / figure.floor)
        how = "on a run not used" if x.heldout == "run" else "within the run, which does not show transfer"
        return f" Error {x.before / x.floor:.2g} → {x.after / x.floor:.2g} × floor {how}."


def _same_band(a: _Found, b: _Found) -> bool:
    p, q = a.atom.hypothesis, b.atom.hypothesis
    assert isinstance(p, events.Tone)
    assert isinstance(q, events.Tone)
    return p.channel == q.channel and abs(p.hz - q.hz) < 0.01 * p.hz


def _merge(into: dict[str, Any], more: dict[str, Any]) -> None:
    """Another tone of a narrow band into the first one's finding."""
    own = into["shape"].setdefault("all_hz", [into["shape"]["hz"]])
    own.append(more["shape"]["hz"])
    into["label"] = f"narrow band at {min(own):.5g}-{max(own):.5g} Hz"
    into["score"] += more["score"]
    into["gain"] += more["gain"]


def _structure(series: list[tuple[float, Array]], runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Findings on the colour and correlation of the noise."""
    spec = runs[0].bandwidth
    out = []
    for b in noise.bandwidth(series, spec):
        expected = "white" if not np.isfinite(b.spec_hz) else f"a band limit of {b.spec_hz:.3g} Hz"
        label = f"noise is band-limited at {b.hz:.3g} Hz, where {expected} is expected"
        value = {"name": "hz", "value": b.hz, "sd": b.sd_hz, "unit": "Hz", "plausible": True}
        out.append(_plain("bandwidth", label, [b.channel], [value], b.score))
    for x in noise.crosstalk(series):
        if abs(x.correlation) < _LEAST_CORRELATION:
            continue
        value = {"name": "correlation", "value": x.correlation, "sd": x.sd, "unit": "1", "plausible": True}
        label = f"noise of {x.channels[0]} and {x.channels[1]} is correlated"
        out.append(_plain("noise_crosstalk", label, list(x.channels), [value], x.z**2))
    return out


def _plain(effect: str, label: str, channels: list[str], params: list[dict[str, Any]], score: float) -> dict[str, Any]:
    return {
        "effect": effect,
        "label": label,
        "channels": channels,
        "params": params,
        "shape": {},
        "score": score,
        "gain": score,
        "heldout_gain": None,
        "share_of_excess": None,
        "driver_curve": None,
        "proposed_form": None,
        "rivals": [],
        "include_as": "N",
        "confirmed": None,
    }


def _line(line: lines.Line) -> dict[str, Any]:
    gyro = line.channels[0].startswith("g")
    c = CHANNELS.index(line.channels[0])
    value = float(line.rms[c]) / (DPS if gyro else MG)
    unit = "deg/s" if gyro else "mg"
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
    h = w.atom.hypothesis
    return {
        "effect": h.effect,
        "label": h.label,
        "channels": [CHANNELS[c] for c in h.channels],
        "score": w.score,
        "guarded_score": w.guarded,
        "why": w.why,
    }


def _included_tone(f: _Found) -> Included:
    """A slow tone as two states that forget in ten minutes: its phase is every run's own."""
    h = f.atom.hypothesis
    assert isinstance(h, events.Tone)
    unit, si = ("deg/s", DPS) if h.channel < 3 else ("mg", MG)
    amplitude = float(np.sqrt(np.mean(f.theta**2))) / si
    q = amplitude * float(np.sqrt(2.0 / _TONE_S))
    states = tuple(State(name, unit, 0.0, amplitude, _TONE_S, q) for name in ("sin", "cos"))
    return Included("tone", (CHANNELS[h.channel],), "S", {"hz": h.hz}, states)


def _drift(c: int, drift: Drift) -> dict[str, Any]:
    unit, si = ("deg/s", DPS) if c < 3 else ("mg", MG)
    walk = bool(np.isinf(drift.tau))
    return {
        "channels": [CHANNELS[c]],
        "kind": drift.kind,
        "tau_s": None if walk else drift.tau,
        "level": drift.level / si,
        "unit": f"{unit}/√s" if walk else unit,
    }


def _included_drift(c: int, drift: Drift) -> Included:
    unit, si = ("deg/s", DPS) if c < 3 else ("mg", MG)
    walk = bool(np.isinf(drift.tau))
    level = drift.level / si
    q = level if walk else level * float(np.sqrt(2.0 / drift.tau))
    state = State("drift", unit, 0.0, 1e-9 if walk else level, drift.tau, q)
    return Included(drift.kind, (CHANNELS[c],), "S", {}, (state,))

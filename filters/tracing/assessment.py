"""What is known of findings: rivals, whether they hold on a run not used, error before and after, status of a channel.

A status is one of clean, explained, confounded, partial, stochastic, run_specific, unexplained. "Explained" never means
proved: no rival fits as well, no drift is needed beside it, nothing remains, and a held-out run is at its floor.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from filters.channels import CHANNELS
from filters.effects import faults, lines, noise
from filters.effects.run_specific import RunSpecific
from filters.tracing import (
    detectability,
    experiment,
    identifiability,
    noise_level,
    residual,
    validation,
)
from filters.tracing.design_matrix import Stack, Term, columns_on
from filters.tracing.residual import Run
from filters.tracing.rivals import Rival, rivals
from filters.tracing.selection import Selection
from filters.tracing.whitening import NONE, unbiased
from filters.types import Array

REMAINDER = 1e-4 / 24.0
_SCALES_S = (1.0, 4.0, 16.0, 64.0)
_MATERIAL = 9.0
_IN_BAND = 1.2
_SURE = 1.7
_WORSE = 1.1
_DISPUTED, _RIVALS = 3, 4
_LEAST_CORRELATION = 0.03


@dataclass(frozen=True)
class Finding:
    """A finding with all that is said of it."""

    term: Term
    theta: Array
    covariance: Array
    score: float
    gain: float
    share: float
    rivals: list[Rival]
    channels: tuple[int, ...]
    confirmed: bool | None = None


class Judgement:
    """What is known of the findings: rivals, confirmation, error before and after, status; one method a part."""

    def __init__(self, chosen: Selection, channels: list[int], seed: int, heldout: Stack | None) -> None:
        self.chosen = chosen
        self.design = chosen.design
        self.stack = chosen.design.stack
        self.channels = channels
        self.seed = seed
        self.heldout = heldout
        self.white = self.design.sd * np.sqrt(self.stack.period)
        self.faults: list[faults.DataFault] = []
        self.fault_runs: list[str] = []
        self.lines: list[lines.SpectralLine] = []
        self.levels: list[noise_level.NoiseDriver] = []
        self.untestable: list[identifiability.UntestableEffect] = []
        self.structure: list[dict[str, Any]] = []
        self.limits: list[dict[str, Any]] = []
        self.found: list[Finding] = []
        self._held_columns: dict[tuple[object, int], Array] = {}
        self.figures: list[validation.ErrorFigure] = []
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
        known = {f.term.key for f in self.found}
        self.limits = [x for effect in asked for x in detectability.limits(self.design, self.channels, effect, known)]
        self._experiment()

    # ---------------------------------------------------------------------------------------------------- findings

    def _findings(self) -> None:
        fit = self.chosen.fit()
        left = {c: self._left(c) for c in self.channels}
        for number, term in enumerate(self.chosen.terms):
            theta, covariance = fit.of(number)
            gain = self.chosen.own_gain(term)
            where = self._where(term, number)
            share = gain / (gain + sum(left.get(c, 0.0) for c in where))
            others = rivals(self.chosen, term)
            score = gain - self.chosen.price(term)
            self.found.append(Finding(term, theta, covariance, score, gain, share, others, where))
        self.found.sort(key=lambda f: -f.score)

    def _left(self, channel: int) -> float:
        """Chi-square of a channel that nothing found explains, beyond what chance gives sums over 16 blocks."""
        r = self.design.unexplained(self.chosen.terms, channel)
        white = unbiased(r[:, None], self.stack.run, self.design.variance(channel))[:, 0]
        size = white.size // 16 * 16
        sums = white[:size].reshape(-1, 16).sum(axis=1) ** 2 / 16.0
        return max(0.0, float(sums.sum() - sums.size - 2.0 * np.sqrt(2.0 * sums.size)))

    def _where(self, term: Term, number: int) -> tuple[int, ...]:
        """Channels on which an effect matters."""
        if len(term.places) == 1:
            return tuple(term.places)
        fit = self.chosen.fit()
        theta = fit.theta[number]
        drops = {}
        for c, places in term.places.items():
            G = self.design.gram(c)[0][np.ix_(places, places)]
            drops[c] = float(theta @ G @ theta)
        most = max(drops.values())
        return tuple(c for c, d in drops.items() if d > _MATERIAL and d > 0.002 * most) or tuple(term.places)

    # --------------------------------------------------------------------------------------------- on unseen data

    def _held(self, term: Term, c: int) -> Array:
        """Columns of a finding on the held-out run, shape (n, k)."""
        if not self._held_columns and self.heldout is not None:
            lasting = [f.term for f in self.found if not isinstance(f.term.hypothesis, RunSpecific)]
            self._held_columns = columns_on(self.heldout, lasting)
        return self._held_columns[term.key, c]

    def correction(self, found: Sequence[Finding], held: bool = True) -> Array:
        """What findings that carry over say of the held-out run's residual, or of the others', shape (n, 6)."""
        stack = self.heldout if held and self.heldout is not None else self.stack
        out = np.zeros_like(stack.y)
        for f in found:
            if not isinstance(f.term.hypothesis, RunSpecific):
                for c, places in f.term.places.items():
                    columns = self.design.columns[:, places] if stack is self.stack else self._held(f.term, c)
                    out[:, c] += columns @ f.theta
        return out

    def _confirm(self) -> None:
        """Whether each finding that carries over lowers error or NIS on the held-out run."""
        if self.heldout is None:
            return
        everything = self.correction(self.found)
        for number, f in enumerate(self.found):
            if isinstance(f.term.hypothesis, RunSpecific):
                continue
            own = self.correction([f])
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
        error = validation.e10(self.heldout, before, after, c, white, self.seed)
        if error is not None and error.after != error.before:
            if error.after < error.before:
                return True
            if error.after > _WORSE * error.before:
                return False
        honest = validation.nis(self.heldout, before, after, c, white, NONE)
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
        after = self.heldout.y - self.correction(used)
        white = np.array([self._heldout_white(c) for c in range(6)])
        for c in self.channels:
            before = self.heldout.y[:, c]
            made = [
                validation.e10(self.heldout, before, after[:, c], c, white[c], self.seed),
                validation.nis(
                    self.heldout, before, after[:, c], c, white[c], self.design.drift[c], self._uncertainty(used, c)
                ),
                *validation.prediction(self.heldout, before, after[:, c], c, white[c], self.design.drift[c]),
            ]
            self.figures += [figure for figure in made if figure is not None]
        if len(self.channels) == 6:
            for seconds in (10.0, 60.0):
                drift = validation.drift(
                    self.heldout, self.heldout.y, after, white, self.design.drift, seconds, self.seed
                )
                self.figures += [drift] if drift is not None else []

    def _uncertainty(self, used: Sequence[Finding], c: int) -> Array:
        """Variance of the correction of a channel, about its mean, SI, shape (n,)."""
        assert self.heldout is not None
        out = np.zeros(self.heldout.t.size)
        for f in used:
            if c in f.term.places and not isinstance(f.term.hypothesis, RunSpecific):
                X = self._held(f.term, c)
                X = X - X.mean(axis=0)
                out += np.einsum("ij,jk,ik->i", X, f.covariance, X)
        return out

    def _errors_by_folds(self) -> None:
        for c in self.channels:
            own = [self.design.columns[:, f.term.places[c]] for f in self.found if c in f.term.places]
            columns = np.column_stack(own) if own else np.zeros((self.stack.t.size, 0))
            figure = validation.folded(self.stack, self.stack.y[:, c], columns, c, self.white[c], self.seed)
            self.figures += [figure] if figure is not None else []

    # -------------------------------------------------------------------------------------------------- remainder

    def _remainder(self) -> None:
        scales = [max(1, round(s / self.stack.period)) for s in _SCALES_S]
        for c in self.channels:
            white = self.design.residual(self.chosen.terms, c)
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
        lasting = [f for f in found if not isinstance(f.term.hypothesis, RunSpecific)]
        if not found:
            if drift:
                return "stochastic"
            if rest or (c in self.channels and not aside and self._out_of_band(c)):
                return "unexplained"
            return "explained" if aside else "clean"
        if any(f.rivals for f in lasting):
            return "confounded"
        single = len(self.stack.blocks) + self._verdict() == 1
        if single and any(f.term.hypothesis.source != "motion" for f in lasting):
            return "confounded"
        refuted = any(f.confirmed is False for f in lasting)
        if drift or rest or refuted or (lasting and self._out_of_band(c)):
            return "partial"
        return "explained" if lasting else "run_specific"

    def _verdict(self) -> bool:
        """Whether there is a held-out run, long enough for a verdict."""
        return self.heldout is not None and self.heldout.blocks[0].run.seconds >= validation.LEAST_S

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
        if not self._verdict():
            return False
        for figure in self.figures:
            if figure.channel == CHANNELS[c] and figure.metric == "e10" and figure.heldout == "run":
                # one channel in forty is outside the 95 % band by chance: a verdict asks for a thousandth
                limit = figure.floor + _SURE * (figure.floor_band95[1] - figure.floor)
                limit = max(limit, _IN_BAND * figure.floor)
                if figure.after > limit:
                    return True
        return False

    def _experiment(self) -> None:
        """The run to make next: for the first finding that one separates from a rival, else what comes nearest."""
        disputed = [f for f in self.found if f.rivals][:_DISPUTED]
        if not disputed:
            return
        run = self.stack.blocks[0].run
        candidates = experiment.CandidateRuns(self.design, run)
        best = -1.0
        for f in disputed:
            rest = [term for term in self.chosen.terms if term is not f.term]
            others = [r.term for r in f.rivals[:_RIVALS]]
            made = experiment.separating(self.design, f.term, f.theta, others, run, rest, candidates)
            if made is not None and made["d_expected"] > best:
                self.experiment, best = made, made["d_expected"]
            if best >= experiment.SEPARATES:
                return


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

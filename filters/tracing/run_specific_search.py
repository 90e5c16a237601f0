"""The best tone, step and two-level noise of a channel beside what is selected, and what each gains."""

from collections.abc import Sequence

import numpy as np

from filters.effects import run_specific
from filters.effects.run_specific import RunSpecific, Tone
from filters.tracing import step_beside_drift, telegraph_beside_drift
from filters.tracing.beside_drift import gain_beside
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.tracing.whitening import unbiased
from filters.types import Array

_BAND = 0.01  # of the frequency: tones nearer together are one narrow band
_TONES_A_BAND = 3


def search(design: Design, terms: Sequence[Term], channel: int) -> list[tuple[Term, float]]:
    """Run-specific effects of a channel that are not selected yet.

    `design`: data and columns.
    `terms`: what is selected.
    Returns each with its gain. Its columns are its hypothesis' `made`; its places number them, none is in the design.
    """
    stack = design.stack
    on = [a for a in terms if channel in a.places]
    white, variance = design.residual(terms, channel), design.variance(channel)
    r = design.unexplained(terms, channel)
    plain = unbiased(r[:, None], stack.power_on, variance)[:, 0]
    own = np.concatenate([a.places[channel] for a in on]) if on else np.zeros(0, int)
    basis = np.zeros((stack.t.size, 0))
    if own.size:
        basis = np.linalg.qr(unbiased(design.columns[:, own], stack.power_on, variance))[0]
    made: list[RunSpecific | None] = [
        run_specific.tone(channel, white, stack.t, stack.starts, stack.period, run_specific.TONE_HZ)
    ]
    if design.drift[channel].level > 0.0:
        return _new(terms, on, [(x, _gain(design, x, own)) for x in made if x]) + _new(
            terms, on, _beside_drift(design, terms, channel)
        )
    if _uneven(plain):
        made.append(run_specific.step(channel, plain, basis, stack.t, stack.begins))
        own_bias = stack.power_on
        mean = np.bincount(own_bias, r / variance) / np.maximum(np.bincount(own_bias, 1.0 / variance), 1e-300)
        made.append(run_specific.telegraph(channel, r - mean[own_bias], np.sqrt(variance), stack.begins))
    return _new(terms, on, [(x, _gain(design, x, own)) for x in made if x])


def _beside_drift(design: Design, terms: Sequence[Term], channel: int) -> list[tuple[RunSpecific, float]]:
    """A step and two-level noise, drift fitted with and without them."""
    found: list[tuple[RunSpecific, float]] = []
    step = step_beside_drift.step(design, terms, channel)
    if step is not None:
        found.append((step, gain_beside(design, terms, channel, step.made)))
    levels = telegraph_beside_drift.telegraph(design, terms, channel)
    return found if levels is None else [*found, levels]


def _new(
    terms: Sequence[Term], on: Sequence[Term], found: Sequence[tuple[RunSpecific, float]]
) -> list[tuple[Term, float]]:
    """Those that are not selected yet, as terms."""
    taken = {a.key for a in terms}
    made = [
        (Term(effect, {effect.channel: np.arange(effect.made.shape[1])}), gain)
        for effect, gain in found
        if not _crowded(on, effect)
    ]
    return [(term, gain) for term, gain in made if term.key not in taken]


def _crowded(on: Sequence[Term], effect: RunSpecific) -> bool:
    """Whether so many tones are here already that one more is part of a narrow band, not a tone of its own."""
    if not isinstance(effect, Tone):
        return False
    tones = [a.hypothesis for a in on if isinstance(a.hypothesis, Tone)]
    return sum(abs(tone.hz - effect.hz) < _BAND * effect.hz for tone in tones) >= _TONES_A_BAND


def _uneven(white: Array) -> bool:
    """Whether sums over 16 rows vary more than white noise lets them: else there is no step to look for."""
    size = white.size // 16 * 16
    sums = white[:size].reshape(-1, 16).sum(axis=1)
    return bool(float(sums @ sums) / max(1, sums.size) / 16.0 > 1.0 + 2.0 * np.sqrt(2.0 / max(1, sums.size)))


def _gain(design: Design, effect: RunSpecific, own: Array) -> float:
    """Drop of chi-square when an effect joins the columns `own` on its channel."""
    c = effect.channel
    raw = np.column_stack([design.stack.y[:, c], design.columns[:, own.astype(int)], effect.made])
    return _drop(design.white(raw, c), own.size)


def _drop(W: Array, size: int) -> float:
    """Drop of the squared norm of column 0 when those after the first `size` join the fit."""
    y, X = W[:, 0], W[:, 1:]
    scale = np.linalg.norm(X, axis=0)
    X = X / np.where(scale > 0.0, scale, 1.0)
    full = X @ np.linalg.lstsq(X.T @ X, X.T @ y, rcond=1e-9)[0]
    part = X[:, :size] @ np.linalg.lstsq(X[:, :size].T @ X[:, :size], X[:, :size].T @ y, rcond=1e-9)[0]
    return float(np.sum((y - part) ** 2) - np.sum((y - full) ** 2))

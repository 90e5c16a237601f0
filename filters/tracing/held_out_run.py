"""A run that nothing was fitted to: what findings say of it, its error before and after with all of them.

Which of them it confirms or refutes is judged in `judgement`, and changes no figure here.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS
from filters.effects.run_specific import Tone
from filters.tracing import validation
from filters.tracing.columns import ColumnsByTerm, columns_on
from filters.tracing.design_matrix import Design, Fit
from filters.tracing.error_figure import ErrorFigure, chi2_quantiles, drawn_again, rms, rms_interval
from filters.tracing.findings import Finding
from filters.tracing.residual import attitude_and_rate
from filters.tracing.stack import Stack
from filters.tracing.validation import FoldedErrors
from filters.tracing.whitening import NONE, Drift, whiten
from filters.types import Array

if TYPE_CHECKING:
    from filters.tracing.trace_document import HeldOut


_Folded = dict[int, tuple[FoldedErrors, list[object]]]  # by channel, with the key of each group of columns

_SLOW_HZ = 0.05  # faster tones are not in means of 10 s
_FREE_S = (10.0, 60.0)  # of free navigation


@dataclass(frozen=True)
class HeldOutRun:
    """The run, and the columns there of all findings that carry over."""

    stack: Stack  # of the one run
    columns: ColumnsByTerm  # by term's key and channel, shape (n, k)
    white: Array  # white densities, unit·√s, shape (6,)
    is_part: bool = False  # whether it is a part of a power-on that the runs at hand have other parts of

    @classmethod
    def of(cls, stack: Stack, design: Design, found: Sequence[Finding]) -> "HeldOutRun":
        """The run for findings of a design; where it has no noise of its own to tell, the design's counts."""
        own = stack.white_sd()
        sd = np.where(own > 0.0, own, design.sd)
        columns = columns_on(stack, [f.term for f in found if f.lasting])
        for f in found:
            if f.lasting and "time" in (f.term.hypothesis.source, *f.term.hypothesis.over):
                for c in f.term.places:
                    _hold(columns[f.term.key, c], stack.t, design, f, c)
        power_on = stack.blocks[0].run.power_on
        is_part = bool(power_on) and any(b.run.power_on == power_on for b in design.stack.blocks)
        return cls(stack, columns, sd * float(np.sqrt(stack.period)), is_part)

    @property
    def long_enough(self) -> bool:
        """Whether it lasts long enough for a verdict."""
        return self.stack.blocks[0].run.seconds >= validation.LEAST_S

    def correction(self, found: Sequence[Finding]) -> Array:
        """What findings that carry over say of the run's residual, SI, shape (n, 6)."""
        out = np.zeros_like(self.stack.y)
        for f in found:
            if f.lasting:
                for c in f.term.places:
                    out[:, c] += self.columns[f.term.key, c] @ f.theta
        return out

    def unknown(self, found: Sequence[Finding], fit: Fit, channel: int) -> validation.Correction | None:
        """What is not known of the correction of a channel: of findings that carry over, with their joint fit."""
        own = [f for f in found if f.lasting and channel in f.term.places]
        if not own:
            return None
        columns = np.column_stack([self.columns[f.term.key, channel] for f in own])
        return validation.Correction(columns, joint_covariance(own, fit))


def _hold(columns: Array, t: Array, design: Design, f: Finding, channel: int) -> None:
    """Hold a finding's columns, in place, where the run is so far from the data that it could be anything there.

    Away from the times of the data, what it says may differ from what it says at the nearest row by as much as its
    covariance allows. Where that is more than all that was seen of it, it says what it says at the last row before.
    """
    seen = design.stack.t
    away = np.maximum(np.maximum(seen.min() - t, t - seen.max()), 0.0)
    apart = columns - columns[np.argmin(away)]
    sd = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", apart, f.covariance, apart), 0.0))
    told = (away == 0.0) | (sd <= float(np.std(design.columns[:, f.term.places[channel]] @ f.theta)))
    told[np.argmin(away)] = True
    limit = np.flatnonzero(told)[np.argmax(away[told])]
    columns[~told] = columns[limit]


def joint_covariance(found: Sequence[Finding], fit: Fit) -> Array:
    """Covariance of findings' parameters: each one's own, with the correlations of their joint fit; shape (k, k)."""
    rows = [fit.offsets[fit.terms.index(f.term)] + np.arange(f.term.size) for f in found]
    P = fit.covariance[np.ix_(np.concatenate(rows), np.concatenate(rows))]
    root = np.sqrt(np.maximum(np.diag(P), 1e-300))
    own = np.sqrt(np.maximum(np.concatenate([np.diag(f.covariance) for f in found]), 0.0))
    return np.asarray(P * np.outer(own / root, own / root))


def correction(design: Design, found: Sequence[Finding]) -> Array:
    """What findings that carry over say of the residual of the runs at hand, SI, shape (n, 6)."""
    out = np.zeros_like(design.stack.y)
    for f in found:
        if f.lasting:
            for c, places in f.term.places.items():
                out[:, c] += design.columns[:, places] @ f.theta
    return out


def held_out_errors(
    run: HeldOutRun, used: Sequence[Finding], design: Design, channels: Sequence[int], seed: int
) -> list[ErrorFigure]:
    """Errors of the held-out run before and after."""
    stack = run.stack
    after = stack.y - run.correction(used)
    fit = design.fit([f.term for f in used])
    figures: list[ErrorFigure | None] = []
    for c in channels:
        residuals, white, drift = (stack.y[:, c], after[:, c]), float(run.white[c]), design.drift[c]
        figures.append(validation.e10(stack, *residuals, c, white, seed))
        unknown = run.unknown(used, fit, c)
        figures.append(validation.nis(stack, *residuals, c, white, drift, unknown))
        figures += validation.prediction(stack, *residuals, c, white, drift, unknown)
    if len(channels) == len(CHANNELS):
        for seconds in _FREE_S:
            figures.append(free_drift(stack, stack.y, after, run.white, design.drift, seconds, seed))
    heldout: HeldOut = "part" if run.is_part else "run"
    return [replace(figure, heldout=heldout) for figure in figures if figure is not None]


def folded_errors(
    design: Design, found: Sequence[Finding], channels: Sequence[int], seed: int
) -> tuple[list[ErrorFigure], list[Finding]]:
    """Errors within the runs at hand, each cell under fits to the others; findings with the share that each removes."""
    stack = design.stack
    own: _Folded = {}
    for c in channels:
        # what a channel does not see would be fitted to rounding there
        there = [f.term for f in found if c in f.channels]
        groups = [design.columns[:, term.places[c]] for term in there]
        white = float(design.sd[c] * np.sqrt(stack.period))
        made = validation.folded(stack, stack.y[:, c], groups, c, white, seed)
        if made is not None:
            own[c] = made, [term.key for term in there]
    return [errors.figure for errors, _ in own.values()], [replace(f, share=_share(f, own)) for f in found]


def _share(f: Finding, own: _Folded) -> float | None:
    """Share of the excess of E10² over its floor that a finding removes on cells that its fit has not seen."""
    if isinstance(f.term.hypothesis, Tone) and f.term.hypothesis.hz > _SLOW_HZ:
        return None
    there = [own[c] for c in f.channels if c in own]
    removed = sum(errors.removed(keys.index(f.term.key)) for errors, keys in there)
    excess = sum(errors.excess for errors, _ in there)
    return validation.share_of(removed, excess, sum(errors.before.size for errors, _ in there))


# ------------------------------------------------------------------------------------------------------ free inertial
# Position error of free inertial navigation that starts from the true state, with the bias filter's biases.
#
# drift_10s, drift_60s   root mean square over starts a minute apart; the floor is what white noise alone leaves

_START_EVERY_S = 60.0


def free_drift(
    stack: Stack, before: Array, after: Array, white: Array, drifts: Sequence[Drift], seconds: float, seed: int
) -> ErrorFigure | None:
    """Position error of free inertial navigation, to first order in the sensors' errors, started true every minute.

    ε' = C δω, δv' = C δf + ε × f_n, δp' = δv with δω, δf what is left of the readings' errors when the bias filter's
    estimate at the start is taken off: a bias stays, a Gauss-Markov drift is forgotten at its own rate.

    `before`, `after`: residuals of all channels, instrument axes, SI, shape (n, 6).
    `white`: white densities, shape (6,).
    `drifts`: of the six channels, in the bias filter after.
    `seconds`: of free navigation, 10 or 60.
    Returns none with fewer than two starts.
    """
    run = stack.blocks[0].run
    dt = stack.period
    steps = round(seconds / dt)
    starts = np.flatnonzero(np.diff((stack.part_t // _START_EVERY_S).astype(int), prepend=0) > 0)
    starts = starts[starts + steps <= stack.t.size]
    starts = starts[[bool((stack.weight[s : s + steps] > 0.0).all()) for s in starts]]
    if starts.size < 2:
        return None
    C = _attitudes_at(stack)
    values = []
    for r, own in ((before, [NONE] * 6), (after, list(drifts))):
        held = _biases(stack, r, starts, steps, white, own)
        rows = zip(starts.tolist(), held, strict=True)
        values.append(np.array([_position(stack, r[s : s + steps] - b, C, s) for s, b in rows]))
    gamma = run.site.gravity
    gyro, accel = float(np.mean(white[:3] ** 2)), float(np.mean(white[3:] ** 2))
    floor = float(np.sqrt(3.0 * accel * seconds**3 / 3.0 + 2.0 * gamma**2 * gyro * seconds**5 / 20.0))
    rng = np.random.default_rng(seed)
    picks = drawn_again(rng, starts.size)
    low, high = (float(np.sqrt(q / (2 * starts.size))) for q in chi2_quantiles(2 * starts.size))
    return ErrorFigure(
        metric=f"drift_{seconds:.0f}s",
        channel="all",
        unit="m",
        before=rms(values[0]),
        after=rms(values[1]),
        floor=floor,
        ci95=rms_interval(values[1], picks, 1.0),
        before_ci95=rms_interval(values[0], picks, 1.0),
        floor_band95=(low * floor, high * floor),
        n=int(starts.size),
        heldout="run",
    )


def _attitudes_at(stack: Stack) -> Array:
    """C_nb of every block, shape (n or 1, 3, 3)."""
    run = stack.blocks[0].run
    middles = np.minimum((stack.blocks[0].edges[:-1] + stack.blocks[0].edges[1:]) // 2, run.t.size - 1)
    return attitude_and_rate(run, middles)[0]


def _position(stack: Stack, errors: Array, C: Array, start: int) -> float:
    """Position error at the end of readings' errors of shape (steps, 6) from a row on, m."""
    run, dt, steps = stack.blocks[0].run, stack.period, len(errors)
    own = C if len(C) == 1 else C[start : start + steps]
    turn = np.einsum("nij,nj->ni", np.broadcast_to(own, (steps, 3, 3)), run.axes.gyro_to_body(errors[:, :3]))
    push = np.einsum("nij,nj->ni", np.broadcast_to(own, (steps, 3, 3)), run.axes.accel_to_body(errors[:, 3:]))
    # at the middle of each block: sums to its end are 8 % too large over 40 blocks
    tilt = (np.cumsum(turn, axis=0) - 0.5 * turn) * dt
    push = push + np.cross(tilt, np.array([0.0, 0.0, -run.site.gravity]))
    speed = (np.cumsum(push, axis=0) - 0.5 * push) * dt
    return float(np.linalg.norm(np.sum(speed, axis=0) * dt))


def _biases(
    stack: Stack, r: Array, starts: NDArray[np.int_], steps: int, white: Array, drifts: Sequence[Drift]
) -> Array:
    """What the bias filter foretells at each start of the rows that follow it, shape (starts, steps, 6)."""
    out = np.empty((starts.size, steps, 6))
    ahead = np.arange(steps) * stack.period
    for c, drift in enumerate(drifts):
        with np.errstate(divide="ignore"):
            variance = white[c] ** 2 / stack.period / stack.weight[:, c]
        held = np.empty((stack.t.size, 2))
        whiten(r[:, c, None], stack.t, stack.begins, variance, drift, held)
        keep = np.ones(steps) if drift.is_walk else np.exp(-ahead / drift.tau)
        out[:, :, c] = held[starts, :1] + held[starts, 1:] * keep
    return out

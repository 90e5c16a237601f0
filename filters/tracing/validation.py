"""Error before and after: what corrections are worth on data that they were not fitted to.

e10            10 s means, never across a change of motion, after the bias of the first 60 s is taken off
nis            √(NIS / dof) of those means in the bias filter, with drift after: honesty of the covariance, not error
bias_prediction   mean of the next 60 s as the bias filter foretells it
coverage       share of those means within 3 sd of the prediction

Floors are what white noise alone leaves. Position error of free navigation is in `free_inertial`.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS, error_unit
from filters.tracing.blocks import Blocks
from filters.tracing.error_figure import (
    DRAWS,
    ErrorFigure,
    binomial_quantile,
    chi2_quantiles,
    drawn_again,
    rms,
    rms_interval,
    wilson_interval,
)
from filters.tracing.stack import FOLDS, Stack
from filters.tracing.trace_document import HeldOut
from filters.tracing.whitening import NONE, Drift
from filters.tracing.window_filter import Foretold, foretell
from filters.types import Array

HOLD_S = 60.0
WINDOW_S = 10.0
LEAST_S = 300.0  # below this length of a held-out run there is no verdict
_SAME_RATE = np.deg2rad(0.5)
_WITHIN_3_SD = 0.9973


@dataclass(frozen=True, slots=True)
class Windows:
    """Means of at most 10 s within one motion: time (middle), duration (s), mean residual and power-on of each.

    The mean has a column for each of the residuals where several were given.
    """

    t: Array
    seconds: Array
    mean: Array
    run: NDArray[np.int_]


@dataclass(frozen=True, slots=True)
class Correction:
    """What is not known of a correction: its regressors, shape (n, k), and their parameters' covariance, (k, k); SI."""

    columns: Array
    covariance: Array


def windows(stack: Stack, r: Array, channel: int, seconds: float = WINDOW_S) -> Windows:
    """Windowed means of a channel's residual.

    `r`: residual of the channel, SI, shape (n,), or several of them, shape (n, k).
    `channel`: whose weights count.
    `seconds`: longest window.
    """
    edges = _edges(_windows_of(stack, seconds))
    w = stack.weight[:, channel]
    total = np.add.reduceat(w, edges)
    keep = total > 0.0
    # of one column a sum along it, as of several
    wide, deep = (w, total) if r.ndim == 1 else (w[:, None], total[:, None])
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.add.reduceat(wide * r, edges, axis=0) / deep
        t = np.add.reduceat(w * stack.t, edges) / total
    return Windows(t[keep], total[keep] * stack.period, mean[keep], stack.power_on[edges][keep])


def _windows_of(stack: Stack, seconds: float) -> NDArray[np.int_]:
    """What tells the window of each row: run, stretch of unchanging rates, number of the time; shape (3, n)."""
    regime = np.concatenate([_regimes(b) for b in stack.blocks])
    return np.stack([stack.run, regime.astype(np.int64), (stack.part_t // seconds).astype(np.int64)])


def _edges(label: NDArray[np.int_]) -> NDArray[np.int_]:
    """First row of each window."""
    return np.flatnonzero(np.r_[True, (np.diff(label, axis=1) != 0).any(axis=0)])


def _regimes(blocks: Blocks) -> Array:
    """Number of the stretch of unchanging rates that each block of a run is in."""
    run = blocks.run
    if run.still:
        return np.zeros(blocks.t.size)
    rates = np.round(run.rates[blocks.edges[:-1]] / _SAME_RATE)
    return np.cumsum(np.r_[False, (np.diff(rates, axis=0) != 0.0).any(axis=1)]).astype(np.float64)


def e10(stack: Stack, before: Array, after: Array, channel: int, white: float, seed: int) -> ErrorFigure | None:
    """Error of 10 s means after a bias hold of 60 s, on a run.

    `before`, `after`: residual of the channel without and with the correction, SI, shape (n,).
    `white`: white density, unit·√s.
    Returns none if less than two windows follow the hold.
    """
    both = after_hold(stack, np.column_stack([before, after]), channel)
    if both is None or both.seconds.size < 2:
        return None
    floors = white * np.sqrt(1.0 / both.seconds + 1.0 / HOLD_S)
    rng, n = np.random.default_rng(seed), both.seconds.size
    # of noise of the windows and of the minute that the bias was taken from: squares and products, row after row
    scale, share = white / floors, white / floors / np.sqrt(both.seconds)
    rows = (share * rng.standard_normal(n) for _ in range(DRAWS))
    squares, products = np.array([(row @ row / n, scale @ row / n) for row in rows]).T
    of_bias = rng.standard_normal(DRAWS) / np.sqrt(HOLD_S)
    simulated = squares + of_bias * (2.0 * products + of_bias * (scale @ scale / n))
    band = np.quantile(np.sqrt(simulated), [0.025, 0.975])
    picks = drawn_again(rng, n)
    nominal = white * np.sqrt(1.0 / WINDOW_S + 1.0 / HOLD_S)
    errors = both.errors / floors[:, None]
    return _e10_figure(channel, errors[:, 0], errors[:, 1], nominal, band, picks, "run")


def _e10_figure(
    channel: int, before: Array, after: Array, nominal: float, band: Array, picks: NDArray[np.integer], heldout: HeldOut
) -> ErrorFigure:
    """Figure from errors over their floors, the nominal floor (SI), a clean unit's band of ratios, and drawn rows."""
    unit, si = error_unit(channel)
    scale = nominal / si
    return ErrorFigure(
        metric="e10",
        channel=CHANNELS[channel],
        unit=unit,
        before=rms(before) * scale,
        after=rms(after) * scale,
        floor=scale,
        ci95=rms_interval(after, picks, scale),
        before_ci95=rms_interval(before, picks, scale),
        floor_band95=(float(band[0]) * scale, float(band[1]) * scale),
        n=int(before.size),
        heldout=heldout,
    )


@dataclass(frozen=True, slots=True)
class AfterHold:
    """Errors of the windows that follow a bias hold."""

    errors: Array  # of each residual, SI, shape (m, k)
    seconds: Array  # how long each window lasts, shape (m,)
    hold_sd: float  # standard deviation of the first residual's hold as its own windows show it, SI


def after_hold(stack: Stack, columns: Array, channel: int) -> AfterHold | None:
    """Errors of windowed means once the mean of the first 60 s is taken off; None where most of those are missing.

    `columns`: residuals of the channel, SI, shape (n, k).
    """
    w = stack.weight[:, channel]
    hold = (stack.part_t < HOLD_S) & (w > 0.0)
    if hold.sum() * stack.period < 0.5 * HOLD_S:
        return None
    bias = w[hold] @ columns[hold] / w[hold].sum()
    own = windows(stack, columns, channel)
    late = own.t - stack.blocks[0].run.begins > HOLD_S
    held = own.mean[~late, 0]
    sd = float(np.std(held, ddof=1) / np.sqrt(held.size)) if held.size > 1 else 0.0
    return AfterHold(own.mean[late] - bias, own.seconds[late], sd)


def share_of(removed: float, excess: float, n: int) -> float | None:
    """Share of an excess of mean squares over the floor that is removed; None where chance explains the excess.

    `removed`, `excess`: in squares of the floor.
    `n`: errors in the mean.
    """
    if n == 0 or excess <= 2.0 * float(np.sqrt(2.0 / n)):
        return None
    return min(1.0, max(0.0, removed / excess))


@dataclass(frozen=True, slots=True)
class FoldedErrors:
    """Errors of a channel within runs: each cell under fits to the other folds."""

    figure: ErrorFigure
    # before, after: errors of the windows over their floors, without and with the columns, shape (m,)
    before: Array
    after: Array
    of: Array  # what each group of columns says of them, shape (m, groups)

    def removed(self, group: int) -> float:
        """How much less the mean square is with a group of columns than without it, in squares of the floor."""
        return rms(self.after + self.of[:, group]) ** 2 - rms(self.after) ** 2

    @property
    def excess(self) -> float:
        """Mean square without the columns over that of white noise, in squares of the floor."""
        return rms(self.before) ** 2 - 1.0


def folded(
    stack: Stack, y: Array, groups: Sequence[Array], channel: int, white: float, seed: int
) -> FoldedErrors | None:
    """The same on one run: five folds of 20 s cells, bias and effects fitted on the others; shows no transfer.

    `y`: residual of the channel, SI, shape (n,).
    `groups`: columns of each of what was found on it, shape (n, k).
    `white`: white density, unit·√s.
    Returns none if a fold has too little to fit, or less than four windows remain.
    """
    residuals = _folded_residuals(stack, y, groups, channel)
    if residuals is None:
        return None
    own = windows(stack, residuals, channel)
    n = own.t.size
    if n < 4:
        return None
    errors = own.mean / (white / np.sqrt(own.seconds))[:, None]
    picks = drawn_again(np.random.default_rng(seed), n)
    band = np.sqrt(np.array(chi2_quantiles(n)) / n)
    figure = _e10_figure(channel, errors[:, 0], errors[:, 1], white / np.sqrt(WINDOW_S), band, picks, "folds")
    return FoldedErrors(figure, errors[:, 0], errors[:, 1], errors[:, 2:])


def _folded_residuals(stack: Stack, y: Array, groups: Sequence[Array], channel: int) -> Array | None:
    """Of each cell under fits to the other folds: what the biases leave, what all leave, what each group says.

    Shape (n, 2 + groups).
    """
    w = stack.weight[:, channel]
    good = w > 0.0
    constant = (stack.power_on[:, None] == np.unique(stack.power_on)).astype(np.float64)
    X = np.hstack([constant, *groups])
    firsts = np.cumsum([constant.shape[1], *(g.shape[1] for g in groups)])
    # of all rows: what the rows at hand see next to nothing of can't be fitted to them
    X = X / np.maximum(np.linalg.norm(X[good], axis=0), 1e-300)
    out = np.zeros((y.size, 2 + len(groups)))
    for fold in range(FOLDS):
        train, test = good & (stack.cell % FOLDS != fold), stack.cell % FOLDS == fold
        if train.sum() < 20 or not test.any():
            return None
        root = np.sqrt(w[train])
        alone, together = (_least_squares(c[train], y[train], root) for c in (constant, X))
        out[test, 0] = y[test] - constant[test] @ alone
        out[test, 1] = y[test] - X[test] @ together
        for k, (a, b) in enumerate(itertools.pairwise(firsts.tolist())):
            out[test, 2 + k] = X[test, a:b] @ together[a:b]
    # a constant of a group is the biases' matter
    out[:, 2:] -= out[good, 2:].mean(axis=0)
    return out


def _least_squares(X: Array, y: Array, root: Array) -> Array:
    """Weighted least squares; the weights' roots are given."""
    return np.asarray(np.linalg.lstsq(root[:, None] * X, root * y, rcond=1e-10)[0])


def nis(
    stack: Stack,
    before: Array,
    after: Array,
    channel: int,
    white: float,
    drift: Drift,
    correction: Correction | None = None,
) -> ErrorFigure | None:
    """√(NIS/dof) of windowed means in the bias filter, without drift before, with it and the correction's states after.

    `before`, `after`: residual of the channel without and with the correction, SI, shape (n,).
    `white`: white density, unit·√s.
    `drift`: of the filter after.
    `correction`: what is not known of it; None if that is nothing.
    Returns none with less than four windows.
    """
    made = _before_and_after(stack, before, after, channel, white, drift, correction, _windows_of(stack, WINDOW_S))
    return _of_squares("nis", channel, "1", [each.normalised for each in made], 1.0)


def _of_squares(metric: str, channel: int, unit: str, errors: Sequence[Array], floor: float) -> ErrorFigure | None:
    """Root mean squares of normal errors before and after, in the unit; None with less than three of them."""
    n = errors[1].size
    if n < 3:
        return None
    low, high = (float(np.sqrt(q / n)) for q in chi2_quantiles(n))
    before, after = (rms(e) for e in errors)
    return ErrorFigure(
        metric=metric,
        channel=CHANNELS[channel],
        unit=unit,
        before=before,
        after=after,
        floor=floor,
        ci95=(after / high, after / low),
        before_ci95=(before / high, before / low),
        floor_band95=(low * floor, high * floor),
        n=n,
        heldout="run",
    )


def prediction(
    stack: Stack,
    before: Array,
    after: Array,
    channel: int,
    white: float,
    drift: Drift,
    correction: Correction | None = None,
) -> list[ErrorFigure]:
    """How well the bias filter foretells the mean of the next 60 s, and how often within its 3 sd; as in `nis`."""
    label = np.stack([stack.run, (stack.part_t // HOLD_S).astype(np.int64)])
    made = _before_and_after(stack, before, after, channel, white, drift, correction, label)
    w = stack.weight[:, channel]
    edges = _edges(label)
    full = np.add.reduceat(w, edges) * stack.period > 0.5 * HOLD_S
    errors = [each.error[full[each.window]] for each in made]
    sds = [each.sd[full[each.window]] for each in made]
    unit, si = error_unit(channel)
    floor = white / np.sqrt(HOLD_S) / si
    predicted = _of_squares("bias_prediction", channel, unit, [e / si for e in errors], floor)
    if predicted is None:
        return []
    n = predicted.n
    inside = [float(np.mean(np.abs(e) <= 3.0 * sd)) for e, sd in zip(errors, sds, strict=True)]
    covered = ErrorFigure(
        metric="coverage",
        channel=CHANNELS[channel],
        unit="1",
        before=inside[0],
        after=inside[1],
        floor=_WITHIN_3_SD,
        ci95=wilson_interval(inside[1], n),
        before_ci95=wilson_interval(inside[0], n),
        floor_band95=(binomial_quantile(0.025, n, _WITHIN_3_SD) / n, 1.0),
        n=n,
        heldout="run",
    )
    return [predicted, covered]


def _before_and_after(
    stack: Stack,
    before: Array,
    after: Array,
    channel: int,
    white: float,
    drift: Drift,
    correction: Correction | None,
    label: NDArray[np.int_],
) -> list[Foretold]:
    """What the bias filter foretells of windows, given by a label of each row, before and after."""
    edges = _edges(label)
    ends = np.zeros(stack.t.size, np.bool_)
    ends[np.append(edges[1:], stack.t.size) - 1] = True
    begins = np.zeros(stack.t.size, np.bool_)
    begins[stack.begins] = True
    fixed = (stack.t, stack.weight[:, channel], white / float(np.sqrt(stack.period)), ends, begins)
    plain = foretell(before[:, None], *fixed, NONE)
    if correction is None:
        return [plain, foretell(after[:, None], *fixed, drift)]
    corrected = np.column_stack([after, correction.columns])
    return [plain, foretell(corrected, *fixed, drift, correction.covariance)]

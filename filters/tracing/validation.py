"""Error before and after: what corrections are worth on data that they were not fitted to.

e10            10 s means, never across a change of motion, after the bias of the first 60 s is taken off
nis            √(NIS / dof) of those means in the bias filter, with drift after: honesty of the covariance, not error
drift_10s, _60s   position error of free inertial navigation from every minute, started from the true state with the
               filter's biases
bias_prediction   mean of the next 60 s as the bias filter foretells it
coverage       share of those means within 3 sd of the prediction

Floors are what white noise alone leaves.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from filters.channels import CHANNELS, error_unit
from filters.tracing.design_matrix import Stack
from filters.tracing.residual import perfect
from filters.tracing.whitening import Drift, whiten
from filters.types import Array

HOLD_S = 60.0
WINDOW_S = 10.0
LEAST_S = 300.0
"""Below this length of a held-out run there is no verdict."""
_DRAWS = 1000
_SAME_RATE = np.deg2rad(0.5)


@dataclass(frozen=True, slots=True)
class ErrorFigure:
    """One figure of error, contracts section 6."""

    metric: str
    channel: str
    unit: str
    before: float
    after: float
    floor: float
    ci95: tuple[float, float]
    floor_band95: tuple[float, float]
    n: int
    heldout: str
    before_ci95: tuple[float, float]

    def document(self) -> dict[str, object]:
        """As the report has it."""
        return {
            "metric": self.metric,
            "channel": self.channel,
            "unit": self.unit,
            "before": self.before,
            "after": self.after,
            "floor": self.floor,
            "before_x_floor": self.before / self.floor,
            "after_x_floor": self.after / self.floor,
            "ci95": list(self.ci95),
            "before_ci95": list(self.before_ci95),
            "floor_band95": list(self.floor_band95),
            "n": self.n,
            "heldout": self.heldout,
        }


@dataclass(frozen=True, slots=True)
class Windows:
    """Means of at most 10 s within one motion: time (middle), duration (s), mean residual and run of each."""

    t: Array
    seconds: Array
    mean: Array
    run: NDArray[np.int_]


def windows(stack: Stack, r: Array, channel: int, seconds: float = WINDOW_S) -> Windows:
    """Windowed means of a channel's residual.

    Parameters
    ----------
    stack : Stack
        Blocks.
    r : Array
        Residual of the channel, SI, shape (n,).
    channel : int
        Whose weights count.
    seconds : float
        Longest window.
    """
    regime = np.concatenate([_regimes(b) for b in stack.blocks])
    label = np.stack([stack.run, regime, (stack.t // seconds).astype(np.int64)])
    edges = np.flatnonzero(np.r_[True, (np.diff(label, axis=1) != 0).any(axis=0)])
    w = stack.weight[:, channel]
    total = np.add.reduceat(w, edges)
    keep = total > 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.add.reduceat(w * r, edges) / total
        t = np.add.reduceat(w * stack.t, edges) / total
    return Windows(t[keep], total[keep] * stack.period, mean[keep], stack.run[edges][keep])


def _regimes(blocks: object) -> Array:
    """Number of the stretch of unchanging rates that each block of a run is in."""
    run = blocks.run  # type: ignore[attr-defined]
    n = blocks.t.size  # type: ignore[attr-defined]
    if run.still:
        return np.zeros(n)
    rates = np.round(run.rates[blocks._edges[:-1]] / _SAME_RATE)  # type: ignore[attr-defined]
    return np.cumsum(np.r_[False, (np.diff(rates, axis=0) != 0.0).any(axis=1)]).astype(np.float64)


# ---------------------------------------------------------------------------------------------------------------- E10


def e10(stack: Stack, before: Array, after: Array, channel: int, white: float, seed: int) -> ErrorFigure | None:
    """Error of 10 s means after a bias hold of 60 s, on a run.

    Parameters
    ----------
    stack : Stack
        Of the held-out run alone.
    before, after : Array
        Residual of the channel without and with the correction, SI, shape (n,).
    channel : int
        Which.
    white : float
        White density, unit·√s.
    seed : int
        Of the floor's band and the interval.

    Returns
    -------
    ErrorFigure or None
        None if less than two windows follow the hold.
    """
    a, b = (_held(stack, r, channel) for r in (before, after))
    if a is None or b is None or a[0].size < 2:
        return None
    floors = white * np.sqrt(1.0 / a[1] + 1.0 / HOLD_S)
    nominal = white * np.sqrt(1.0 / WINDOW_S + 1.0 / HOLD_S)
    ratios = [float(np.sqrt(np.mean((e / floors) ** 2))) for e in (a[0], b[0])]
    rng = np.random.default_rng(seed)
    own = rng.standard_normal((_DRAWS, a[0].size)) / np.sqrt(a[1])
    simulated = white * (own + rng.standard_normal((_DRAWS, 1)) / np.sqrt(HOLD_S)) / floors
    band = np.quantile(np.sqrt(np.mean(simulated**2, axis=1)), [0.025, 0.975])
    picks = rng.integers(0, b[0].size, (_DRAWS, b[0].size))
    unit, si = error_unit(channel)
    scale = nominal / si
    return ErrorFigure(
        "e10",
        CHANNELS[channel],
        unit,
        ratios[0] * scale,
        ratios[1] * scale,
        scale,
        _spread(b[0] / floors, picks, scale),
        (float(band[0]) * scale, float(band[1]) * scale),
        int(a[0].size),
        "run",
        _spread(a[0] / floors, picks, scale),
    )


def _spread(errors: Array, picks: NDArray[np.int_], scale: float) -> tuple[float, float]:
    """Interval of a root mean square by drawing the errors again, 95 %."""
    low, high = np.quantile(np.sqrt(np.mean(errors[picks] ** 2, axis=1)), [0.025, 0.975])
    return float(low) * scale, float(high) * scale


def _held(stack: Stack, r: Array, channel: int) -> tuple[Array, Array] | None:
    """Errors of the windows after the hold and their durations."""
    w = stack.weight[:, channel]
    hold = (stack.t < HOLD_S) & (w > 0.0)
    if hold.sum() * stack.period < 0.5 * HOLD_S:
        return None
    bias = float(w[hold] @ r[hold] / w[hold].sum())
    own = windows(stack, r, channel)
    late = own.t > HOLD_S
    return own.mean[late] - bias, own.seconds[late]


def folded(stack: Stack, y: Array, columns: Array, channel: int, white: float, seed: int) -> ErrorFigure | None:
    """The same on one run: five folds of 20 s cells, bias and effects fitted on the others; shows no transfer."""
    w = stack.weight[:, channel]
    good = w > 0.0
    constant = (stack.run[:, None] == np.unique(stack.run)).astype(np.float64)
    errors: list[list[Array]] = [[], []]
    durations: list[Array] = []
    before, after = np.zeros(y.size), np.zeros(y.size)
    for fold in range(5):
        train, test = good & (stack.cell % 5 != fold), stack.cell % 5 == fold
        if train.sum() < 20 or not test.any():
            return None
        root = np.sqrt(w[train])[:, None]
        for X, out in ((constant, before), (np.hstack([constant, columns]), after)):
            scale = np.maximum(np.linalg.norm(X[train], axis=0), 1e-300)
            theta = np.linalg.lstsq(root * X[train] / scale, root[:, 0] * y[train], rcond=1e-10)[0] / scale
            out[test] = y[test] - X[test] @ theta
    for r, into in zip((before, after), errors, strict=True):
        own = windows(stack, r, channel)
        into.append(own.mean)
        durations = [own.seconds]
    a, b, seconds = errors[0][0], errors[1][0], durations[0]
    if a.size < 4:
        return None
    floors = white / np.sqrt(seconds)
    nominal = white / np.sqrt(WINDOW_S)
    rng = np.random.default_rng(seed)
    picks = rng.integers(0, b.size, (_DRAWS, b.size))
    band = np.sqrt(stats.chi2.ppf([0.025, 0.975], a.size) / a.size)
    unit, si = error_unit(channel)
    ratios = [float(np.sqrt(np.mean((e / floors) ** 2))) for e in (a, b)]
    scale = nominal / si
    return ErrorFigure(
        "e10",
        CHANNELS[channel],
        unit,
        ratios[0] * scale,
        ratios[1] * scale,
        scale,
        _spread(b / floors, picks, scale),
        (float(band[0]) * scale, float(band[1]) * scale),
        int(a.size),
        "folds",
        _spread(a / floors, picks, scale),
    )


# ---------------------------------------------------------------------------------------------------------------- NIS


def nis(
    stack: Stack, before: Array, after: Array, channel: int, white: float, drift: Drift, more: Array | None = None
) -> ErrorFigure | None:
    """√(NIS/dof) of windowed means in the bias filter, without drift before, with it after.

    `more` is a variance to be added to each row after: that of the correction, SI, shape (n,).
    """
    values = []
    own = windows(stack, before, channel)
    if own.t.size < 4:
        return None
    starts = np.flatnonzero(np.r_[True, np.diff(own.run) != 0])
    for r, process, extra in ((before, Drift(1.0, 0.0), None), (after, drift, more)):
        w = windows(stack, r, channel)
        variance = white**2 / w.seconds
        if extra is not None:
            variance = variance + windows(stack, extra, channel).mean
        nu = whiten(w.mean[:, None], w.t, starts, variance, process)[0][:, 0]
        values.append(nu[nu != 0.0])
    n = values[1].size
    if n < 2:
        return None
    root = [float(np.sqrt(np.mean(nu**2))) for nu in values]
    low, high = stats.chi2.ppf([0.025, 0.975], n) / n
    return ErrorFigure(
        "nis",
        CHANNELS[channel],
        "1",
        root[0],
        root[1],
        1.0,
        (root[1] / float(np.sqrt(high)), root[1] / float(np.sqrt(low))),
        (float(np.sqrt(low)), float(np.sqrt(high))),
        n,
        "run",
        (root[0] / float(np.sqrt(high)), root[0] / float(np.sqrt(low))),
    )


# ------------------------------------------------------------------------------------------- prediction and coverage


def prediction(
    stack: Stack, before: Array, after: Array, channel: int, white: float, drift: Drift
) -> list[ErrorFigure]:
    """How well the bias filter foretells the mean of the next 60 s, and how often within its 3 sd."""
    errors, inside = [], []
    for r, process in ((before, Drift(1.0, 0.0)), (after, drift)):
        e, sd = _foretold(stack, r, channel, white, process)
        if e.size < 3:
            return []
        errors.append(e)
        inside.append(float(np.mean(np.abs(e) <= 3.0 * sd)))
    unit, si = error_unit(channel)
    n = errors[1].size
    rms = [float(np.sqrt(np.mean(e**2))) / si for e in errors]
    floor = white / np.sqrt(HOLD_S) / si
    low, high = np.sqrt(stats.chi2.ppf([0.025, 0.975], n) / n)
    ci = rms[1] / float(high), rms[1] / float(low)
    band = float(low) * floor, float(high) * floor
    first = rms[0] / float(high), rms[0] / float(low)
    made = [ErrorFigure("bias_prediction", CHANNELS[channel], unit, rms[0], rms[1], floor, ci, band, n, "run", first)]
    nominal = 0.9973
    first, ci = (_wilson(share, n) for share in inside)
    floor_band = float(stats.binom.ppf(0.025, n, nominal)) / n, 1.0
    name = CHANNELS[channel]
    made.append(ErrorFigure("coverage", name, "1", inside[0], inside[1], nominal, ci, floor_band, n, "run", first))
    return made


def _wilson(share: float, n: int) -> tuple[float, float]:
    """Interval of a share of n, 95 %."""
    found = stats.binomtest(round(share * n), n).proportion_ci(0.95, "wilson")
    return float(found.low), float(found.high)


def _foretold(stack: Stack, r: Array, channel: int, white: float, drift: Drift) -> tuple[Array, Array]:
    """Mean of each minute less what was foretold before it, and the standard deviation that was foretold."""
    w = stack.weight[:, channel]
    label = (stack.t // HOLD_S).astype(np.int64)
    edges = np.flatnonzero(np.diff(label, prepend=-1))
    total = np.add.reduceat(w, edges)
    keep = total * stack.period > 0.5 * HOLD_S
    mean = (np.add.reduceat(w * r, edges) / np.maximum(total, 1e-9))[keep]
    t = (np.add.reduceat(stack.t, edges) / np.diff(np.append(edges, stack.t.size)))[keep]
    variance = white**2 / (total[keep] * stack.period)
    nu = whiten(mean[:, None], t, np.array([0]), variance, drift)[0][:, 0]
    return _unscaled(mean, t, variance, drift, nu)


def _unscaled(mean: Array, t: Array, variance: Array, drift: Drift, nu: Array) -> tuple[Array, Array]:
    """Innovations in their unit: the filter once more on a column of ones gives each one's scale."""
    # an impulse in a row comes out as one over the innovation's standard deviation there
    sd = np.full(mean.size, np.nan)
    for k in range(1, mean.size):
        impulse = np.zeros((mean.size, 1))
        impulse[k] = 1.0
        out = whiten(impulse[: k + 1], t[: k + 1], np.array([0]), variance[: k + 1], drift)[0][k, 0]
        sd[k] = 1.0 / out if out > 0.0 else np.nan
    good = np.isfinite(sd)
    return (nu * sd)[good], sd[good]


# ------------------------------------------------------------------------------------------------------ free inertial


def drift(
    stack: Stack, before: Array, after: Array, white: Array, drifts: Sequence[Drift], seconds: float, seed: int
) -> ErrorFigure | None:
    """Position error of free inertial navigation, to first order in the sensors' errors, started true every minute.

    ε' = C δω, δv' = C δf + ε × f_n, δp' = δv with δω, δf what is left of the readings' errors when the bias filter's
    estimate at the start is taken off.

    Parameters
    ----------
    stack : Stack
        Of the held-out run alone.
    before, after : Array
        Residuals of all channels, instrument axes, SI, shape (n, 6).
    white : Array
        White densities, shape (6,).
    drifts : sequence of Drift
        Of the six channels, in the bias filter after.
    seconds : float
        Of free navigation, 10 or 60.
    seed : int
        Of the interval.
    """
    run = stack.blocks[0].run
    dt = stack.period
    steps = round(seconds / dt)
    starts = np.flatnonzero(np.diff((stack.t // HOLD_S).astype(int), prepend=0) > 0)
    starts = starts[starts + steps <= stack.t.size]
    starts = starts[[bool((stack.weight[s : s + steps] > 0.0).all()) for s in starts]]
    if starts.size < 2:
        return None
    C = _attitudes_at(stack)
    values = [
        np.array([_position(stack, r, C, int(s), steps, white, own) for s in starts])
        for r, own in ((before, [Drift(1.0, 0.0)] * 6), (after, list(drifts)))
    ]
    gamma = run.site.gravity
    gyro, accel = float(np.mean(white[:3] ** 2)), float(np.mean(white[3:] ** 2))
    floor = float(np.sqrt(3.0 * accel * seconds**3 / 3.0 + 2.0 * gamma**2 * gyro * seconds**5 / 20.0))
    rms = [float(np.sqrt(np.mean(v**2))) for v in values]
    rng = np.random.default_rng(seed)
    picks = rng.integers(0, starts.size, (_DRAWS, starts.size))
    low, high = np.sqrt(stats.chi2.ppf([0.025, 0.975], 2 * starts.size) / (2 * starts.size))
    name = f"drift_{seconds:.0f}s"
    first, ci = (_spread(v, picks, 1.0) for v in values)
    band = float(low) * floor, float(high) * floor
    return ErrorFigure(name, "all", "m", rms[0], rms[1], floor, ci, band, int(starts.size), "run", first)


def _attitudes_at(stack: Stack) -> Array:
    """C_nb of every block, shape (n or 1, 3, 3)."""
    from filters.motion.kinematics import attitudes

    run = stack.blocks[0].run
    if run.C_nb is not None:
        return run.C_nb[None]
    if run.still:
        return attitudes(run.angles)
    middles = np.minimum((stack.blocks[0]._edges[:-1] + stack.blocks[0]._edges[1:]) // 2, run.t.size - 1)
    return attitudes(run.angles[middles])


def _position(stack: Stack, r: Array, C: Array, start: int, steps: int, white: Array, drifts: Sequence[Drift]) -> float:
    run, dt = stack.blocks[0].run, stack.period
    rows = slice(start, start + steps)
    errors = r[rows] - _biases(stack, r, start, white, drifts)
    own = C if len(C) == 1 else C[rows]
    turn = np.einsum("nij,nj->ni", np.broadcast_to(own, (steps, 3, 3)), run.axes.gyro_to_body(errors[:, :3]))
    push = np.einsum("nij,nj->ni", np.broadcast_to(own, (steps, 3, 3)), run.axes.accel_to_body(errors[:, 3:]))
    # at the middle of each block: sums to its end are 8 % too large over 40 blocks
    tilt = (np.cumsum(turn, axis=0) - 0.5 * turn) * dt
    push = push + np.cross(tilt, np.array([0.0, 0.0, -run.site.gravity]))
    speed = (np.cumsum(push, axis=0) - 0.5 * push) * dt
    return float(np.linalg.norm(np.sum(speed, axis=0) * dt))


def _biases(stack: Stack, r: Array, start: int, white: Array, drifts: Sequence[Drift]) -> Array:
    """What the bias filter holds at a row, from the rows before it; shape (6,)."""
    out = np.empty(6)
    for c in range(6):
        w = stack.weight[:start, c]
        age = stack.t[start] - stack.t[:start]
        own = drifts[c]
        if own.level > 0.0:
            # steady state of the filter for a walk: the past counts for √(white² / q) seconds
            q = own.level if np.isinf(own.tau) else own.level * np.sqrt(2.0 / own.tau)
            w = w * np.exp(-age * q / white[c])
        out[c] = float(w @ r[:start, c] / max(float(w.sum()), 1e-12))
    return out


def vertical_sign(stack: Stack) -> float:
    """Mean reading over mean of a perfect unit's along gravity: about 1; -1 for a wrong sign."""
    run = stack.blocks[0].run
    x = perfect(run)[:, 3:]
    mean = run.reading[:, 3:].mean(axis=0)
    return float(mean @ x.mean(axis=0) / max(float(x.mean(axis=0) @ x.mean(axis=0)), 1e-12))

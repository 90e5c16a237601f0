"""Figures of error: one times the floor for white noise, honest bands, first-order drift against the mechanisation."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.runs import QUIET, run_of

from filters.channels import DPS
from filters.earth import curvature
from filters.imu import AxisMap
from filters.kalman import strapdown
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate
from filters.simulation import Scenario
from filters.state import NavState
from filters.tracing.blocks import average
from filters.tracing.held_out_run import free_drift
from filters.tracing.residual import perfect
from filters.tracing.stack import Stack
from filters.tracing.validation import Correction, e10, folded, nis, prediction, share_of, windows
from filters.tracing.whitening import NONE, Drift

DEG = np.pi / 180.0
WHITE = 0.02  # unit·√s
FLOOR = WHITE * np.sqrt(1 / 10 + 1 / 60) / DPS


@cache
def still(seconds: float = 900.0) -> Stack:
    """A unit at rest that leaves nothing."""
    scene = Scenario(spec=QUIET, accel_bias=(0.0,) * 3, gyro_bias=(0.0,) * 3)
    return Stack.of([average(run_of(scene, 0, 8.0, seconds))])


def white(seed: int, stack: Stack | None = None, scale: float = 1.0) -> np.ndarray:
    stack = stack or still()
    return scale * WHITE / np.sqrt(stack.period) * np.random.default_rng(seed).standard_normal(stack.t.size)


def test_white_noise_is_once_the_floor_within_its_band() -> None:
    figures = [e10(still(), white(k), white(k), 0, WHITE, k) for k in range(60)]
    ratio = np.array([f.after / f.floor for f in figures if f])
    inside = [f.floor_band95[0] <= f.after <= f.floor_band95[1] for f in figures if f]
    assert len(ratio) == 60
    assert abs(np.mean(ratio**2) - 1.0) < 4.0 * np.std(ratio**2) / np.sqrt(60)
    assert sum(inside) >= 52
    assert figures[0] is not None
    assert figures[0].floor == pytest.approx(FLOOR)
    assert (figures[0].n, figures[0].heldout, figures[0].unit) == (84, "run", "deg/s")


def test_an_error_that_is_known_is_what_e10_says() -> None:
    stack = still()
    ramp = 1e-3 * stack.t
    figure = e10(stack, ramp, 0.0 * ramp, 0, WHITE, 0)
    assert figure is not None
    expected = 1e-3 * (np.arange(65.0, 900.0, 10.0) - 30.0)
    assert figure.before == pytest.approx(np.sqrt(np.mean(expected**2)) / DPS, rel=1e-3)
    assert figure.after == 0.0


def test_a_run_without_a_hold_or_a_rest_has_no_e10() -> None:
    stack = still()
    weight = stack.weight.copy()
    weight[: round(40.0 / stack.period), 0] = 0.0
    assert e10(replace(stack, weight=weight), white(0), white(0), 0, WHITE, 0) is None
    short = still(65.0)
    assert e10(short, white(0, short), white(0, short), 0, WHITE, 0) is None


def test_windows_do_not_cross_a_change_of_motion() -> None:
    """No longer than ten seconds, together the whole run, each within one rate: else +rate and -rate cancel."""
    profile = Profile((Dwell((0.0,) * 3, 27.0), Rate("inner", 30 * DEG, 17.0), Rate("inner", -30 * DEG, 17.0)))
    scene = Scenario(spec=QUIET, profile=profile)
    stack = Stack.of([average(run_of(scene, 0, 40.0, profile.duration))])
    rates = stack.blocks[0].run.rates[stack.blocks[0].edges[:-1], 2]
    own = windows(stack, rates, 0)
    assert own.seconds.max() <= 10.0 + stack.period
    assert own.seconds.sum() == pytest.approx(stack.t.size * stack.period, abs=stack.period)
    long = own.seconds > 1.0
    assert np.allclose(np.min(np.abs(own.mean[long, None] / DEG - [0.0, 30.0, -30.0]), axis=1), 0.0, atol=0.5)


def test_nis_is_one_for_the_noise_that_is_believed_and_two_for_twice_it() -> None:
    stack = still()
    honest = [nis(stack, white(k), white(k), 0, WHITE, NONE) for k in range(30)]
    values = np.array([f.after for f in honest if f])
    assert np.mean(values**2) == pytest.approx(1.0, abs=0.08)
    assert sum(f.floor_band95[0] < f.after < f.floor_band95[1] for f in honest if f) >= 25
    twice = nis(stack, white(0, scale=2.0), white(0, scale=2.0), 0, WHITE, NONE)
    assert twice is not None
    assert twice.after == pytest.approx(2.0 * values[0])
    q, walked = 0.5 * WHITE / np.sqrt(30.0), []
    for k in range(30):
        steps = np.random.default_rng(1000 + k).standard_normal(stack.t.size)
        y = white(k) + q * np.sqrt(stack.period) * np.cumsum(steps)
        figure = nis(stack, y, y, 0, WHITE, Drift(np.inf, q))
        assert figure is not None
        walked.append((figure.before, figure.after))
    before, after = np.array(walked).T
    assert np.mean(after**2) == pytest.approx(1.0, abs=0.12)
    assert np.mean(before**2) > 3.0


@pytest.mark.parametrize("tau", [2.0, 12.0, 100.0, np.inf])
def test_drift_within_a_window_is_averaged_as_the_readings_are(tau: float) -> None:
    """√NIS with the drift that was drawn is one, whatever its time constant beside 10 s: over sixty runs, 2 %."""
    stack = still()
    drift = Drift(tau, 4.0 * WHITE if np.isfinite(tau) else WHITE / 3.0)
    values = []
    for k in range(60):
        y = white(k) + drawn(drift, stack, 500 + k)
        figure = nis(stack, y, y, 0, WHITE, drift)
        assert figure is not None
        values.append(figure.after)
    squares = np.square(values)
    assert abs(np.mean(squares) - 1.0) < 4.0 * np.std(squares) / np.sqrt(60)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.1)


def drawn(drift: Drift, stack: Stack, seed: int) -> np.ndarray:
    """A course of a drift at the blocks."""
    steps = np.random.default_rng(seed).standard_normal(stack.t.size)
    if drift.is_walk:
        return np.asarray(drift.level * np.sqrt(stack.period) * np.cumsum(steps))
    keep = np.exp(-stack.period / drift.tau)
    g = drift.level * steps[0]
    out = [g]
    for step in steps[1:]:
        g = keep * g + drift.level * np.sqrt(1.0 - keep**2) * step
        out.append(g)
    return np.array(out)


def test_a_correction_that_is_not_quite_known_is_a_state_of_the_filter() -> None:
    stack = still()
    column = (stack.t / 900.0)[:, None]
    sd = 6.0 * WHITE / np.sqrt(60.0)
    known, unknown = [], []
    for k in range(80):
        off = sd * np.random.default_rng(900 + k).standard_normal()
        y = white(k) + off * column[:, 0]
        for figures, correction in ((known, None), (unknown, Correction(column, np.array([[sd**2]])))):
            figure = nis(stack, y, y, 0, WHITE, NONE, correction)
            assert figure is not None
            figures.append(figure.after**2)
    assert abs(np.mean(unknown) - 1.0) < 4.0 * np.std(unknown) / np.sqrt(80)
    assert np.mean(known) > np.mean(unknown) + 0.1


@pytest.mark.parametrize("tau", [5.0, 40.0, np.inf])
def test_free_navigation_forgets_a_drift_at_its_own_rate(tau: float) -> None:
    stack = still(1800.0)
    drift = Drift(tau, 3.0 * WHITE if np.isfinite(tau) else WHITE)
    figures = []
    for k in range(4):
        r = np.zeros((stack.t.size, 6))
        for c in range(3):
            r[:, c] = white(10 * k + c, stack) + drawn(drift, stack, 70 + 10 * k + c)
        with_it = free_drift(stack, r, r, np.full(6, WHITE), [drift] * 3 + [NONE] * 3, 60.0, 0)
        assert with_it is not None
        figures.append((with_it.before, with_it.after))
    before, after = np.sqrt(np.mean(np.square(figures), axis=0))
    assert after < 1.01 * before
    if np.isinf(tau):
        assert after < 0.8 * before


def test_the_next_minute_is_foretold_to_its_floor_and_within_three_sigma() -> None:
    made = [prediction(still(), white(k), white(k), 0, WHITE, NONE) for k in range(30)]
    ratio = np.array([m[0].after / m[0].floor for m in made])
    assert 1.0 < np.sqrt(np.mean(ratio**2)) < 1.25
    assert np.mean([m[1].after for m in made]) > 0.985
    assert made[0][0].metric == "bias_prediction"
    # a walk that is not believed is not covered, one that is believed is
    q = WHITE / np.sqrt(30.0)
    y = white(0) + q * np.sqrt(still().period) * np.cumsum(np.random.default_rng(5).standard_normal(still().t.size))
    lost, found = (
        prediction(still(), y, y, 0, WHITE, Drift(np.inf, q))[1].before,
        prediction(still(), y, y, 0, WHITE, Drift(np.inf, q))[1].after,
    )
    assert lost < 0.8 < found


def test_folds_find_an_effect_and_white_noise_its_floor() -> None:
    stack = still()
    line, other = (stack.t / 900.0)[:, None], np.sin(stack.t / 7.0)[:, None]
    y = white(0) + 0.1 * line[:, 0]
    made = folded(stack, y, [line, other], 0, WHITE, 0)
    assert made is not None
    figure = made.figure
    assert figure.before / figure.floor > 3.0
    assert figure.floor_band95[0] < figure.after < figure.floor_band95[1] * 1.1
    assert figure.heldout == "folds"
    assert share_of(made.removed(0), made.excess, figure.n) == pytest.approx(1.0, abs=0.05)
    assert share_of(made.removed(1), made.excess, figure.n) == pytest.approx(0.0, abs=0.05)


def test_folds_leave_out_what_the_other_cells_do_not_see() -> None:
    """A decay that is over, all but 1e-200 of it, before the fold's cell ends: fitted, it would be anything there."""
    stack = still()
    decay = np.exp(-np.minimum(stack.t * 50.0, 460.0))[:, None]
    made = folded(stack, white(0), [decay], 0, WHITE, 0)
    assert made is not None
    assert made.figure.after == pytest.approx(made.figure.before, rel=0.05)


def test_what_fits_the_noise_of_cells_that_were_seen_is_worse_on_those_that_were_not() -> None:
    """Twenty columns that mean nothing, each a number a cell: fitted to 36 cells they add to the other 9."""
    stack = still()
    columns = np.random.default_rng(2).standard_normal((stack.cell.max() + 1, 20))[stack.cell]
    made = folded(stack, white(0), [columns], 0, WHITE, 0)
    assert made is not None
    assert made.figure.before < made.figure.floor_band95[1]
    assert made.figure.after > 1.2 * made.figure.before


def test_a_share_needs_an_excess_to_be_a_share_of() -> None:
    assert share_of(215.0**2 - 40.0**2, 215.0**2 - 1.0, 90) == pytest.approx(0.9654, abs=1e-3)
    assert share_of(0.1, 0.2, 90) is None
    assert share_of(9.0, 8.0, 90) == 1.0
    assert share_of(-2.0, 8.0, 90) == 0.0


def reached(stack: Stack, r: np.ndarray, start: int, seconds: float) -> float:
    """Horizontal and vertical error of the mechanisation itself, started true with the mean of the past as bias, m."""
    run = stack.blocks[0].run
    axes, site, steps = run.axes, run.site, round(seconds / stack.period)
    reading = np.broadcast_to(perfect(run), r.shape) + r
    bias = r[:start].mean(axis=0)
    state = NavState.at_rest(site, np.eye(3))
    state = replace(state, gyro_bias=axes.gyro_to_body(bias[:3]), accel_bias=axes.accel_to_body(bias[3:]))
    for row in reading[start : start + steps]:
        gyro, accel = axes.gyro_to_body(row[:3]), axes.accel_to_body(row[3:])
        state = strapdown.propagate(state, gyro, accel, stack.period, site.gravity)
    R_n, R_e = curvature(state.latitude, site.height)
    north, east = (state.latitude - site.latitude) * R_n, (state.longitude - site.longitude) * R_e
    return float(np.linalg.norm([north, east * np.cos(site.latitude), state.height - site.height]))


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("seconds", "tolerance"), [(10.0, 0.01), (60.0, 0.01)])
def test_free_inertial_drift_is_that_of_the_mechanisation(sign: int, seconds: float, tolerance: float) -> None:
    scene = Scenario(spec=QUIET, accel_bias=(0.0,) * 3, gyro_bias=(0.0,) * 3, axes=AxisMap(accel_sign=sign))
    stack = Stack.of([average(run_of(scene, 0, 8.0, 240.0))])
    rng = np.random.default_rng(3)
    r = rng.standard_normal((stack.t.size, 6)) * np.repeat([2e-3, 2e-2], 3)
    r += stack.t[:, None] * np.array([2e-5, -1e-5, 3e-5, 2e-4, 1e-4, -3e-4])
    figure = free_drift(stack, r, 0.0 * r, np.repeat([1e-3, 1e-2], 3), [NONE] * 6, seconds, 0)
    assert figure is not None
    starts = [k for k in (240, 480, 720) if k + round(seconds / stack.period) <= stack.t.size]
    own = [reached(stack, r, k, seconds) for k in starts]
    assert figure.n == len(own)
    assert figure.before == pytest.approx(np.sqrt(np.mean(np.square(own))), rel=tolerance)
    assert figure.after == 0.0

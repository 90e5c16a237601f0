"""Evidence: gains against brute-force least squares, what can't be told apart, cells that were left out."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.runs import WHITE, power_ons

from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sine
from filters.simulation import Effect
from filters.tracing.blocks import average
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design, inverse_of
from filters.tracing.left_out_runs import unseen_gain
from filters.tracing.stack import Stack
from filters.tracing.whitening import NONE, Drift

DEG = np.pi / 180.0
TURNED = Profile(
    (
        Dwell((0.0, 0.0, 0.0), 20.0),
        *(Dwell((a * DEG, b * DEG, 0.0), 10.0) for a, b in ((90, 0), (180, 0), (-90, 0), (0, 90), (0, -90), (45, 30))),
        *(Rate(axis, rate * DEG, 6.0) for axis in ("inner", "middle", "outer") for rate in (40.0, -40.0)),
        *(Sine(axis, 15 * DEG, 0.3, 12.0) for axis in ("inner", "middle", "outer")),
    )
)


@cache
def stack(moving: bool) -> Stack:
    effects = (Effect("thermal_lin", ("gy",), {"dps_per_k": 0.02}), Effect("scale", ("gz",), {"relative": 0.01}))
    if moving:
        effects += (Effect("tilt", (), {"north_deg": 0.3}),)
    profile = TURNED if moving else None
    seconds = profile.duration if profile else 400.0
    runs = power_ons(*effects, count=2, seconds=seconds, hz=10.0, profile=profile)
    return Stack.of([average(run) for run in runs])


def design(moving: bool) -> Design:
    made = Design(stack(moving))
    # uneven weights, rows without data: nothing may depend on their being even
    rng = np.random.default_rng(0)
    weight = np.where(rng.random(made.stack.weight.shape) < 0.03, 0.0, rng.uniform(0.5, 1.0, made.stack.weight.shape))
    made.stack = replace(made.stack, weight=weight)
    return made


def named(made: Design, effect: str, *channels: int, **shape: object) -> Term:
    """The one term of that effect, on those channels, of that shape."""
    for a in made.terms:
        h = a.hypothesis
        if h.effect == effect and (not channels or h.channels == channels) and shape.items() <= dict(h.shape).items():
            return a
    raise AssertionError(f"no {effect} on {channels}")


def system(made: Design, terms: list[Term]) -> tuple[np.ndarray, np.ndarray]:
    """Everything in one long system: all channels' rows, the runs' biases as columns, the terms' columns."""
    runs = len(made.stack.starts)
    y, X, root = [], [], []
    for c in range(6):
        rows = np.zeros((made.stack.t.size, 6 * runs + sum(a.size for a in terms)))
        for r in range(runs):
            rows[:, c * runs + r] = made.stack.run == r
        at = 6 * runs
        for a in terms:
            if c in a.places:
                rows[:, at : at + a.size] = made.columns[:, a.places[c]]
            at += a.size
        y.append(made.stack.y[:, c])
        X.append(rows)
        root.append(1.0 / np.sqrt(made.variance(c)))
    w = np.concatenate(root)
    return w * np.concatenate(y), w[:, None] * np.concatenate(X)


def least(made: Design, terms: list[Term]) -> float:
    """Chi-square of a least-squares fit of it."""
    y, X = system(made, terms)
    scale = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    theta = np.linalg.lstsq(X / scale, y, rcond=1e-12)[0]
    return float(np.sum((y - X / scale @ theta) ** 2))


CANDIDATES = (
    ("thermal_lin", (1,)),
    ("thermal_poly", (1,)),
    ("warmup", (1,)),
    ("scale", (2,)),
    ("cross_axis", (0,)),
    ("g_sensitivity", (0,)),
    ("harmonic", (4,)),
    ("driver:temperature", (1,)),
    ("mounting", ()),
    ("lever_arm", ()),
    ("tilt", ()),
    ("delay", ()),
)


@pytest.mark.parametrize("chosen", [(), (("thermal_lin", (1,)), ("scale", (2,))), (("tilt", ()), ("cross_axis", (0,)))])
def test_a_gain_is_the_drop_of_chi_square_of_a_whole_fit(chosen: tuple[tuple[str, tuple[int, ...]], ...]) -> None:
    made = design(moving=True)
    selection = [named(made, effect, *channels) for effect, channels in chosen]
    candidates = [named(made, effect, *channels) for effect, channels in CANDIDATES]
    candidates = [a for a in candidates if a not in selection]
    before = least(made, selection)
    brute = np.array([before - least(made, [*selection, a]) for a in candidates])
    assert np.allclose(made.gains(selection, candidates), brute, rtol=1e-4, atol=1e-4)


def test_a_fit_is_that_of_the_whole_system() -> None:
    made = design(moving=True)
    terms = [named(made, "scale", 2), named(made, "tilt"), named(made, "thermal_lin", 1)]
    y, X = system(made, terms)
    scale = np.linalg.norm(X, axis=0)
    inverse = np.linalg.inv((X / scale).T @ (X / scale)) / np.outer(scale, scale)
    own = slice(X.shape[1] - 4, None)
    fit = made.fit(terms)
    assert np.allclose(np.concatenate(fit.theta), (inverse @ (X.T @ y))[own], rtol=1e-6, atol=1e-12)
    assert np.allclose(fit.covariance, inverse[own, own], rtol=1e-5, atol=1e-15)
    theta, covariance = fit.of(1)
    assert np.array_equal(theta, fit.theta[1])
    assert np.array_equal(covariance, fit.covariance[1:3, 1:3])
    left = sum(made.chi2(terms, c) for c in range(6))
    assert left == pytest.approx(least(made, terms), rel=1e-8)


def test_of_columns_that_are_nowhere_to_be_seen_nothing_is_told() -> None:
    """A run that lacks the channel of a tone leaves zeros: no parameter and no covariance there, all else as ever."""
    rng = np.random.default_rng(0)
    X = rng.standard_normal((50, 6)) * 10.0 ** np.arange(-3.0, 3.0)
    A = np.zeros((10, 10))
    seen = np.array([1, 2, 4, 6, 7, 9])
    A[np.ix_(seen, seen)] = X.T @ X
    inverse = inverse_of(A)
    assert np.allclose(inverse[np.ix_(seen, seen)] @ (X.T @ X), np.eye(6))
    unseen = np.setdiff1d(np.arange(10), seen)
    assert not inverse[unseen].any()
    assert not inverse[:, unseen].any()


def test_gains_with_drift_are_those_of_whitened_columns() -> None:
    made = design(moving=False)
    made.set_drift(1, Drift(30.0, made.sd[1]))
    a, b = named(made, "thermal_lin", 1), named(made, "warmup", 1, tau_s=120.0)
    W = made.whitened(1, np.concatenate([a.places[1], b.places[1]]))
    y, X = W[:, 0], W[:, 1:]
    X = X / np.linalg.norm(X, axis=0)

    def left(k: int) -> float:
        return float(np.sum((y - X[:, :k] @ np.linalg.lstsq(X[:, :k], y, rcond=None)[0]) ** 2))

    assert made.gains([a], [b])[0] == pytest.approx(left(1) - left(2), rel=1e-5)


def test_what_is_in_already_gains_nothing() -> None:
    """Itself, the same under another name (gravity and a common scale factor), a part of what is in."""
    made = design(moving=True)
    thermal = named(made, "thermal_poly", 1, order=3.0)
    assert made.gains([thermal], [named(made, "thermal_lin", 1), thermal]) == pytest.approx([0.0, 0.0], abs=1e-6)
    scales = [named(made, "scale", c) for c in (3, 4, 5)]
    gravity = named(made, "gravity")
    assert made.gains([], [gravity])[0] >= 0.0
    assert made.gains(scales, [gravity])[0] == pytest.approx(0.0, abs=1e-6)
    assert made.gains([named(made, "mounting")], [named(made, "mounting")])[0] == pytest.approx(0.0, abs=1e-6)


def test_at_rest_there_is_no_evidence_of_motion() -> None:
    made = design(moving=False)
    moving = [a for a in made.terms if a.hypothesis.source == "motion" and a.hypothesis.effect != "thermal_scale"]
    assert np.all(made.gains([], moving) < 1e-6)


def test_columns_found_on_the_way_count_like_those_of_the_beginning() -> None:
    made = design(moving=False)
    before = made.gram(1)
    column = (made.stack.t > 200.0).astype(float)[:, None]
    term = made.add(named(made, "ramp", 1).hypothesis, column)
    widened = made.gram(1)
    made.set_drift(1, NONE)
    anew = made.gram(1)
    assert widened[0].shape[0] == before[0].shape[0] + 1
    assert np.allclose(widened[0], anew[0], rtol=1e-9, atol=1e-9)
    assert np.allclose(widened[1], anew[1], rtol=1e-9, atol=1e-9)
    assert made.gains([], [term])[0] > 0.0


def test_cells_that_were_left_out_gain_what_is_there_and_nothing_of_noise() -> None:
    made = design(moving=False)
    true = named(made, "thermal_lin", 1)
    fitted = made.gains([], [true])[0]
    total, without = unseen_gain(made, [], true)
    assert total == pytest.approx(fitted, rel=0.15)
    assert 0.0 < without < total
    rng = np.random.default_rng(1)
    totals = []
    for _ in range(60):
        noise = made.add(true.hypothesis, rng.standard_normal((made.stack.t.size, 1)))
        totals.append(unseen_gain(made, [true], noise)[0])
    assert -3.0 < np.mean(totals) < 0.5


def test_a_fold_of_cells_is_blind_to_itself() -> None:
    """What happens in one cell alone gains by a fit; of the rest it only says that their bias is not bent by it."""
    made = design(moving=False)
    inside = (made.stack.cell == 7).astype(float)[:, None]
    y = made.stack.y.copy()
    y[:, 0] += 5.0 * made.sd[0] * inside[:, 0]
    made.stack = replace(made.stack, y=y)
    only = made.add(named(made, "ramp", 0).hypothesis, inside)
    fitted = made.gains([], [only])[0]
    assert fitted > 1000.0
    assert unseen_gain(made, [], only)[0] < 0.1 * fitted


def test_noise_is_measured_despite_drift_and_steps() -> None:
    runs = power_ons(
        Effect("random_walk", ("gx",), {"dps_per_sqrt_s": 0.005}),
        Effect("step", ("ax",), {"mg": 20.0, "at_s": 100.0}),
        count=2,
        seconds=600.0,
        hz=20.0,
    )
    sd = Stack.of([average(run) for run in runs]).white_sd()
    expected = np.repeat([WHITE.gyro_arw, WHITE.accel_vrw], 3) / np.sqrt(0.25)
    assert np.allclose(sd, expected, rtol=0.06)

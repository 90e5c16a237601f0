"""The past of estimates: bounded, complete in its extremes, as old as the run, the same for whoever looks late."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imutui.estimate_history import EstimateHistory


def filled(t: np.ndarray, values: np.ndarray, capacity: int = 64) -> EstimateHistory:
    """One estimate at each instant, 3 sd of a tenth."""
    history = EstimateHistory(1, capacity)
    for at, value in zip(t, values, strict=True):
        history.add(float(at), np.array([value]), np.array([0.1]))
    return history


@settings(deadline=None)
@given(st.integers(1, 2000), st.integers(0, 1999))
def test_no_excursion_is_lost_however_long_the_run(count: int, where: int) -> None:
    values = np.zeros(count)
    values[where % count] = 5.0
    history = filled(np.arange(count) * 0.7, values)
    assert len(history) <= 64
    low, high = history.estimate(0)
    assert (high.max(), low.min()) == (5.0, 0.0 if count > 1 else 5.0)
    assert history.band(0)[1].max() == pytest.approx(5.1, rel=1e-6)
    assert (np.diff(history.instants()) > 0).all()
    assert history.instants()[0] == 0.0
    assert history.newest == pytest.approx((count - 1) * 0.7)


def test_the_last_part_stays_at_one_hertz() -> None:
    t = np.arange(5000.0)
    history = filled(t, np.sin(t))
    steps = np.diff(history.instants())
    assert (steps[-24:] == 1.0).all()
    assert steps.max() < 4.0 * steps[:32].mean()


def test_estimates_within_a_second_share_a_row() -> None:
    history = filled(np.arange(0.0, 30.0, 0.1), np.tile([1.0, -1.0], 150))
    assert len(history) == 30
    low, high = history.estimate(0)
    assert (low == -1.0).all()
    assert (high == 1.0).all()


def test_another_run_begins_anew() -> None:
    history = filled(np.arange(100.0, 150.0), np.ones(50))
    history.add(0.5, np.array([2.0]), np.array([0.1]))
    assert len(history) == 1


def test_unknown_estimates_hide_nothing() -> None:
    history = filled(np.array([0.0, 0.1, 0.2]), np.array([np.nan, 2.0, np.nan]))
    assert [float(extreme[0]) for extreme in history.estimate(0)] == [2.0, 2.0]


def test_a_frozen_past_stays() -> None:
    history = filled(np.arange(10.0), np.ones(10))
    copy = history.frozen()
    history.add(10.0, np.array([9.0]), np.array([0.1]))
    assert (len(copy), len(history), copy.newest) == (10, 11, 9.0)
    assert copy.estimate(0)[1].max() == 1.0
    assert len(EstimateHistory(6).frozen()) == 0


@settings(deadline=None, max_examples=25)
@given(st.integers(1, 900), st.integers(2, 40), st.integers(32, 128))
def test_what_is_sent_in_pieces_is_the_same_past(count: int, most: int, capacity: int) -> None:
    values = np.sin(np.arange(count)) + np.where(np.arange(count) % 97 == 5, 3.0, 0.0)
    source, seen = filled(np.arange(count) * 0.7, values, capacity), EstimateHistory(1, capacity)
    since = None
    while True:
        piece = json.loads(json.dumps(source.rows(since, most), allow_nan=False))
        seen.extend(piece)
        since = piece["t"][-1]
        if len(piece["t"]) < most:
            break
    np.testing.assert_allclose(seen.instants(), source.instants(), atol=1e-6)
    for mine, sent in zip((*seen.estimate(0), *seen.band(0)), (*source.estimate(0), *source.band(0)), strict=True):
        np.testing.assert_allclose(mine, sent, atol=1e-5)
    source.add(count * 0.7, np.array([9.0]), np.array([0.1]))
    seen.extend(source.rows(since, most))
    assert (len(seen), seen.newest) == (len(source), source.newest)
    assert seen.estimate(0)[1].max() == 9.0


def test_unknown_numbers_travel_as_none() -> None:
    """JSON has no NaN, and a bias that cannot be seen stays unknown."""
    source, seen = filled(np.array([0.0, 1.5]), np.array([np.nan, 2.0])), EstimateHistory(1)
    seen.extend(json.loads(json.dumps(source.rows(None, 10), allow_nan=False)))
    assert np.isnan(seen.estimate(0)[0][0])
    assert seen.estimate(0)[0][1] == 2.0


def test_convergence_is_kept_and_a_moment_without_it_is_seen() -> None:
    history = EstimateHistory(1, 16)
    for k in range(400):
        history.add(k * 0.5, np.zeros(1), np.ones(1), np.array([k > 20 and k != 101]))
    seen = EstimateHistory(1, 16)
    seen.extend(history.rows(None, 100))
    for one in (history, seen):
        converged, t = one.converged(0), one.instants()
        assert not converged[t <= 10.0].any()
        assert converged[-8:].all()
        assert not converged[np.searchsorted(t, 50.5, "right") - 1]


def test_a_pause_is_a_break_and_slow_estimates_are_none() -> None:
    """A lost line leaves a break between what was before and after, however old; one estimate in 10 s is no pause."""
    t = np.concatenate([np.arange(0.0, 100.0, 0.1), np.arange(160.0, 300.0, 0.1)])
    (found,) = filled(t, np.zeros(t.size), 1024).breaks()
    assert found == pytest.approx((100.0, 160.0), abs=1.0)
    (old,) = filled(np.concatenate([t, np.arange(300.0, 900.0)]), np.zeros(t.size + 600), 64).breaks()
    assert old[0] <= 110.0
    assert old[1] == pytest.approx(160.0, abs=20.0)
    assert filled(np.arange(0.0, 500.0, 10.0), np.zeros(50)).breaks() == []


def test_a_slope_is_known_from_the_past_alone() -> None:
    """A viewer that has just attached need not wait half a minute for the temperature's trend."""
    t = np.arange(0.0, 90.0, 0.25)
    assert filled(t, 25.0 + 0.01 * t, 256).slope_per_minute(0) == pytest.approx(0.6, rel=1e-3)
    assert filled(t[:40], t[:40]).slope_per_minute(0) is None

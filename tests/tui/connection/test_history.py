"""The biases' past: bounded, complete in its extremes, as old as the run."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imutui.tui.connection.history import BiasHistory


def filled(t: np.ndarray, values: np.ndarray, capacity: int = 64) -> BiasHistory:
    """One estimate at each instant, 3 sd of a tenth."""
    history = BiasHistory(1, capacity)
    for at, value in zip(t, values, strict=True):
        history.add(float(at), np.array([value]), np.array([0.1]))
    return history


@settings(deadline=None)
@given(st.integers(1, 2000), st.integers(0, 1999))
def test_no_excursion_is_lost_however_long_the_run(count: int, where: int) -> None:
    """One estimate apart from all others is in the extremes for ever, within a bounded memory."""
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
    """Only what is old is thinned, and evenly."""
    t = np.arange(5000.0)
    history = filled(t, np.sin(t))
    steps = np.diff(history.instants())
    assert (steps[-24:] == 1.0).all()
    assert steps.max() < 4.0 * steps[:32].mean()


def test_estimates_within_a_second_share_a_row() -> None:
    """Ten a second cost one row, with all their extremes."""
    history = filled(np.arange(0.0, 30.0, 0.1), np.tile([1.0, -1.0], 150))
    assert len(history) == 30
    low, high = history.estimate(0)
    assert (low == -1.0).all()
    assert (high == 1.0).all()


def test_another_run_begins_anew() -> None:
    """Time that jumps back is another run, and that one has been seen from its begin."""
    history = filled(np.arange(100.0, 150.0), np.ones(50))
    history.attached_late = True
    assert history.begin == 100.0
    history.add(0.5, np.array([2.0]), np.array([0.1]))
    assert (len(history), history.begin, history.attached_late) == (1, 0.0, False)


def test_unknown_estimates_hide_nothing() -> None:
    """A bias that is unknown for a moment keeps what is known of that second."""
    history = filled(np.array([0.0, 0.1, 0.2]), np.array([np.nan, 2.0, np.nan]))
    assert [float(extreme[0]) for extreme in history.estimate(0)] == [2.0, 2.0]


def test_a_frozen_past_stays() -> None:
    """What comes later does not reach the copy."""
    history = filled(np.arange(10.0), np.ones(10))
    copy = history.frozen()
    history.add(10.0, np.array([9.0]), np.array([0.1]))
    assert (len(copy), len(history), copy.newest) == (10, 11, 9.0)
    assert copy.estimate(0)[1].max() == 1.0
    assert len(BiasHistory(6).frozen()) == 0

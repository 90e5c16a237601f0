import numpy as np
import pytest

from imutui.logbook import arrival_stamps
from imutui.logbook.foreign_log import Order

PERIOD = 0.01


def arrivals(instants: np.ndarray, poll: float = 0.05) -> np.ndarray:
    """When a program that looks every `poll` seconds stamps them: in bursts, 1 ms from one to the next."""
    looks = np.ceil(instants / poll) * poll + 0.002
    t = np.empty(instants.size)
    last = -np.inf
    for k, look in enumerate(looks):
        last = t[k] = max(look, last + 0.001)
    return t


def order(t: np.ndarray) -> Order:
    """How instants (s) follow each other."""
    made = Order()
    made.take(np.round(t * 1e9).astype(np.int64))
    return made


def test_bursts_are_seen_and_jitter_is_not() -> None:
    instants = np.arange(2000) * PERIOD
    rng = np.random.default_rng(1)
    assert "10.0" in order(arrivals(instants)).bursts()
    assert order(instants + rng.uniform(0.0, 0.1 * PERIOD, 2000)).bursts() == ""
    assert order(np.delete(instants, slice(300, 900))).bursts() == ""


def test_gaps_lost_samples_and_bursts_do_not_change_the_rate() -> None:
    instants = np.arange(5000) * PERIOD
    rng = np.random.default_rng(2)
    lost = np.delete(instants, rng.choice(5000, 1000, replace=False))
    for t in (instants + 1e4 * (instants > 20.0), lost, arrivals(instants), instants + rng.uniform(0.0, 0.004, 5000)):
        assert order(t).period_ns == pytest.approx(PERIOD * 1e9, rel=0.01)
    assert order(np.floor(np.arange(5000) * 2.5) * 1e-3).period_ns == pytest.approx(2.5e6, rel=0.001)


@pytest.mark.parametrize("period", [0.01, 0.0037, 0.02])
def test_the_instants_of_bursts_are_a_regular_grid_under_them(period: float) -> None:
    """To half a period, but for a constant: how late the least late packet is can't be known."""
    true = 3.0 + np.arange(5000) * period
    fitted = arrival_stamps.from_arrivals(arrivals(true))
    assert fitted.pieces == 1
    error = fitted.t - true
    assert np.ptp(error) < 0.5 * period
    assert 0.0 <= error.mean() < 0.01
    assert fitted.max_late < 0.06
    assert 0.01 < fitted.median_late < 0.05


def test_no_instant_is_after_its_arrival_and_time_increases() -> None:
    rng = np.random.default_rng(3)
    wander = np.cumsum(rng.normal(0.0, 3e-4, 30000))
    true = np.cumsum(PERIOD + np.diff(wander, prepend=0.0))
    late = rng.exponential(0.02, 30000)
    late[::977] += 0.4
    t = np.maximum.accumulate(true + late) + np.arange(30000) * 1e-7
    fitted = arrival_stamps.from_arrivals(t)
    assert fitted.pieces > 1
    assert (np.diff(fitted.t) > 0.0).all()
    assert (t - fitted.t).min() > -1e-9
    assert np.ptp(fitted.t - true) < 0.05


def test_a_stall_that_is_caught_up_with_is_no_silence_and_a_silence_is_not_filled() -> None:
    true = np.arange(6000) * PERIOD
    stalled = true.copy()
    stalled[3000:3200] = true[3199] + np.arange(200) * 1e-4
    assert np.allclose(arrival_stamps.from_arrivals(stalled).t, true, atol=1e-6)
    silent = true.copy()
    silent[3000:] += 2.0
    fitted = arrival_stamps.from_arrivals(silent)
    assert fitted.pieces == 2
    assert np.allclose(fitted.t, silent, atol=1e-6)

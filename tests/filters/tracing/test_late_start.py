"""Laws in time that were fitted to a later part of a power-on say little of its beginning."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from filters.effects import catalogue, deterministic
from filters.effects.inputs import Inputs
from filters.tracing.held_out_run import _hold

FROM_S = 1360.0


def at(t: Any) -> Inputs:
    return cast("Inputs", SimpleNamespace(t=np.asarray(t, np.float64)))


@pytest.mark.parametrize("tau", deterministic.WARMUP_TAUS)
def test_settling_is_anchored_where_the_data_begin_and_never_grows_without_end(tau: float) -> None:
    h = deterministic.warmup(1, tau, FROM_S)
    t = np.array([0.0, FROM_S - tau, FROM_S, FROM_S + tau])
    values = h.columns(at(np.maximum(t, 0.0)), 1)[:, 0]
    assert values[2] == 1.0
    assert values[3] == pytest.approx(np.exp(-1.0))
    assert values.max() <= np.e
    again = catalogue.hypothesis("warmup", ("gy",), dict(h.shape))
    assert again == h
    assert np.array_equal(again.columns(at(t), 1), h.columns(at(t), 1))


def test_a_whole_power_on_has_the_law_as_it_was() -> None:
    t = np.linspace(0.0, 5000.0, 50)
    assert np.array_equal(deterministic.warmup(0, 40.0).columns(at(t), 0)[:, 0], np.exp(-t / 40.0))
    assert dict(deterministic.warmup(0, 40.0).shape) == {"tau_s": 40.0}


@pytest.mark.parametrize(("sd", "held"), [(1e-6, False), (1.0, True)])
def test_a_law_in_time_is_held_where_its_covariance_lets_it_be_anything(sd: float, held: bool) -> None:
    seen = np.arange(1360.0, 3000.0)
    t = np.arange(0.0, 1360.0)
    design: Any = SimpleNamespace(stack=SimpleNamespace(t=seen), columns=seen[:, None])
    term = SimpleNamespace(places={1: np.array([0])})
    found: Any = SimpleNamespace(term=term, theta=np.array([1.0]), covariance=np.array([[sd**2]]))
    columns = t[:, None].copy()
    _hold(columns, t, design, found, 1)
    assert bool(np.ptp(columns) < np.ptp(t)) is held
    assert np.array_equal(columns[-100:, 0], t[-100:])

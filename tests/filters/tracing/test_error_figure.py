"""Intervals of figures of error: the closed forms are scipy.stats' numbers."""

import numpy as np
import pytest
from scipy import stats

from filters.tracing.error_figure import binomial_quantile, chi2_quantiles, rms, rms_interval, wilson_interval


@pytest.mark.parametrize("n", [2, 3, 17, 240, 1500])
def test_quantiles_are_those_of_scipy(n: int) -> None:
    """To the last bit, without loading scipy.stats where a trace runs."""
    assert chi2_quantiles(n) == tuple(stats.chi2.ppf([0.025, 0.975], n).tolist())
    assert binomial_quantile(0.025, n, 0.9973) == stats.binom.ppf(0.025, n, 0.9973)
    for k in (0, n // 2, n):
        expected = stats.binomtest(k, n).proportion_ci(0.95, "wilson")
        assert wilson_interval(k / n, n) == (float(expected.low), float(expected.high))


def test_an_interval_holds_its_root_mean_square() -> None:
    rng = np.random.default_rng(1)
    errors = rng.standard_normal(200)
    low, high = rms_interval(errors, rng.integers(0, 200, (1000, 200)), 2.0)
    assert low < 2.0 * rms(errors) < high
    assert high - low < 0.5

import numpy as np
import pytest
from scipy import signal

from filters.simulation.first_order import first_order


@pytest.mark.parametrize("pole", [0.0, 0.3, 0.9999])
def test_the_recursion_is_that_of_scipy_to_the_last_bit(pole: float) -> None:
    """However the values are cut into blocks."""
    values = np.random.default_rng(4).standard_normal(1000)
    expected, after = signal.lfilter([1.0 - pole], [1.0, -pole], values, zi=np.array([pole * 0.7]))
    first, memory = first_order(values[:333], 1.0 - pole, pole, pole * 0.7)
    second, memory = first_order(values[333:], 1.0 - pole, pole, memory)
    assert np.array_equal(np.concatenate([first, second]), expected)
    assert memory == after[0]

"""First-order recursion: band limits and lags of the simulation.

As `scipy.signal.lfilter` gives it, to the last bit; importing that takes longer than a virtual instrument should take
to start.
"""

import numpy as np

from filters.types import Array


def first_order(values: Array, gain: float, pole: float, memory: float) -> tuple[Array, float]:
    """y_n = gain x_n + pole y_(n-1).

    Parameters
    ----------
    values : Array
        x, shape (N,).
    gain, pole : float
        Of unit gain at zero frequency if the gain is 1 - pole.
    memory : float
        pole · y of the value before the first.

    Returns
    -------
    Array
        y, shape (N,).
    float
        The memory for what comes next.
    """
    out = []
    for driven in (gain * values).tolist():
        y = memory + driven
        memory = pole * y
        out.append(y)
    return np.array(out), memory

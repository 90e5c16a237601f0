"""A first-order lag, sample by sample: what follows temperature with a time constant.

Written out rather than left to `scipy.signal.lfilter`, whose numbers it gives to the last bit: replay and acquisition
take effects along and need nothing else of scipy.signal, which takes longer to load than a short log to filter.
"""

import numpy as np

from filters.types import Array


def first_order(u: Array, pole: float, memory: float) -> tuple[Array, float]:
    """First-order lag of a stretch: y_k = p y_{k-1} + (1 - p) u_k.

    Parameters
    ----------
    u : Array
        Input, shape (N,).
    pole : float
        p, 0 to 1.
    memory : float
        p y_{-1}: p u_0 for a lag that begins in equality.

    Returns
    -------
    Array
        Output, shape (N,), unit of `u`.
    float
        Memory for the stretch that follows.
    """
    gain = 1.0 - pole
    out = []
    for value in u.tolist():
        lagged = memory + gain * value
        out.append(lagged)
        memory = pole * lagged
    return np.array(out, np.float64), memory

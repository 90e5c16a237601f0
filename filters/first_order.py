"""A first-order recursion, value by value: lags and band limits, of the filter's effects and of the simulation.

Written out beside `scipy.signal.lfilter`, whose numbers it gives to the last bit: replay, acquisition and the virtual
instrument need nothing else of scipy.signal, which takes longer to load than a short log to filter. Who has loaded it
for something else, as tracing has, gets its loop, which is fifty times as fast.
"""

import sys

import numpy as np

from filters.types import Array


def first_order(values: Array, gain: float, pole: float, memory: float) -> tuple[Array, float]:
    """First-order recursion over a stretch: y_k = gain x_k + pole y_{k-1}.

    `values`: x, shape (N,).
    `gain`, `pole`: with gain 1 - pole it is a lag: of unit gain at zero frequency.
    `memory`: pole · y_{-1}; pole · x_0 for a lag that begins in equality.
    Returns y, shape (N,), unit of gain · x.
    Returns memory for the stretch that follows.
    """
    signal = sys.modules.get("scipy.signal")
    if signal is not None and values.size:
        y, last = signal.lfilter([gain], [1.0, -pole], values, zi=np.array([memory]))
        return np.asarray(y), float(last[0])
    out = []
    for driven in (gain * values).tolist():
        y = memory + driven
        out.append(y)
        memory = pole * y
    return np.array(out, np.float64), memory

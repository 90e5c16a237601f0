"""The past of a run of samples for viewers: biases with their certainty and convergence, and the temperature.

A viewer that attaches late sees all of it: memory is bounded, not the time that is told of. It is sent in pieces, since
whoever writes a long reply would keep the reader of the port from its stamps.
"""

import numpy as np

from imutui.estimate_history import EstimateHistory
from imutui.history_rows import HistorySnapshot
from imutui.session.plan import HistoryWish

BIASES = 6
PIECE_ROWS = 100
"""Rows in a piece; about a millisecond of writing."""


class RunHistory:
    """Estimates and temperature of one run.

    `estimates`: gyro biases in deg/s, accelerometer biases in mg, instrument axes.
    `temperature`: degC.
    """

    def __init__(self) -> None:
        self.estimates = EstimateHistory(BIASES)
        self.temperature = EstimateHistory(1)

    def add_temperature(self, t: float, degc: float) -> None:
        """Take the temperature of a sample, `t` s since the first one."""
        self.temperature.add(t, np.array([degc]), np.zeros(1))

    def piece(self, run: int, wish: HistoryWish) -> HistorySnapshot:
        """What a viewer lacks, as far as one reply has room for it.

        `run`: identifies this run.
        `wish`: what the viewer has.
        """
        known = wish if wish.run == run else HistoryWish()
        estimates = self.estimates.rows(known.estimates_s, PIECE_ROWS)
        temperature = self.temperature.rows(known.temperature_s, PIECE_ROWS)
        full = PIECE_ROWS in (len(estimates["t"]), len(temperature["t"]))
        return {"run": run, "estimates": estimates, "temperature": temperature, "complete": not full}

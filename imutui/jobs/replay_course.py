"""The biases of a replay over time: in about as many rows as a plot has columns, or at instants for figures."""

import numpy as np

from filters.kalman import layout
from filters.kalman.runner import Estimator
from imutui.estimate_history import EstimateHistory, HistoryRows
from imutui.logbook.estimate_rows import BiasVerdicts, EstimateRows
from imutui.logbook.results import EstimatePoints, ResultDocument, listed
from imutui.logbook.session_info import SessionInfo

_ROWS = 200
_EARLY = 0.9
_FIRST_S, _GROWTH = 0.1, 0.015
_LONG_S = 7200.0


class ReplayCourse:
    """Takes estimates while a filter runs.

    `seconds`: how long the samples are.
    `every`: least time between two estimates that it wants, s.
    """

    def __init__(self, info: SessionInfo, seconds: float) -> None:
        self.every = max(1.0, seconds / _ROWS)
        self._info = info
        self._next = 0.0
        self._history = EstimateHistory(6, 2 * _ROWS)

    def take(self, rows: np.ndarray, estimator: Estimator) -> None:
        """Take those of some rows that are due."""
        due = []
        for k, t in enumerate(rows[:, layout.OUT_T].tolist()):
            if t >= self._next:
                due.append(k)
                self._next = t + _EARLY * self.every
        if due:
            EstimateRows(rows[due], BiasVerdicts.of(estimator, self._info), self._info).add_to(self._history)

    def rows(self, result: ResultDocument) -> HistoryRows:
        """All of it; a bias is converged from when the result says on."""
        made = self._history.rows(None, 2 * _ROWS)
        since = [*result["converged_s"]["gyro_bias"], *result["converged_s"]["accel_bias"]]
        made["converged"] = [[s is not None and t >= s for s in since] for t in made["t"]]
        return made


class ReplayPoints:
    """Takes estimates as `ReplayCourse` does, but closer together at the beginning, where biases converge."""

    def __init__(self, info: SessionInfo, seconds: float) -> None:
        self.every = _FIRST_S if seconds < _LONG_S else 1.0
        self._info = info
        self._longest = max(self.every, seconds / _ROWS)
        self._next = 0.0
        self._made: EstimatePoints = {"t": [], "bias": [], "sd": [], "nis": [], "dof": []}

    def take(self, rows: np.ndarray, estimator: Estimator) -> None:
        """Take those of some rows that are due."""
        due = []
        for k, t in enumerate(rows[:, layout.OUT_T].tolist()):
            if t >= self._next:
                due.append(k)
                self._next = t + _EARLY * min(max(self.every, _GROWTH * t), self._longest)
        if not due:
            return
        values, sd = EstimateRows(rows[due], BiasVerdicts.of(estimator, self._info), self._info).biases()
        made = self._made
        made["t"] += rows[due, layout.OUT_T].tolist()
        made["bias"] += listed(values)
        made["sd"] += listed(sd)
        made["nis"] += listed(rows[due, layout.OUT_NIS])
        made["dof"] += rows[due, layout.OUT_DOF].tolist()

    def points(self) -> EstimatePoints:
        """All of them."""
        return self._made

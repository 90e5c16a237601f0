"""Rows of the runner, many at a time, as the estimates of a log and of a history."""

from dataclasses import dataclass

import numpy as np

from filters.kalman import layout
from filters.kalman.rows import covariance_of, nav_of
from filters.kalman.runner import Estimator
from imutui.estimate_history import EstimateHistory
from imutui.logbook import results, schemas
from imutui.logbook.session_info import SessionInfo


@dataclass(frozen=True, slots=True)
class BiasVerdicts:
    """What holds for all biases of some rows, accelerometer then gyro, instrument axes."""

    seen: np.ndarray  # whether each is observable, bool, shape (6,)
    converged: np.ndarray  # whether each has converged, bool, shape (6,)
    site_sd_mg: np.ndarray  # of the accelerometers, see `results.site_sd_mg`, shape (3,)

    @classmethod
    def of(cls, estimator: Estimator, info: SessionInfo) -> "BiasVerdicts":
        """Return what the estimator says after its latest sample."""
        axes = info.axes()
        since = results.converged_since(estimator, axes, results.ALL_SEEN)
        converged = np.array([s is not None for s in (*since["accel_bias"], *since["gyro_bias"])])
        return cls(results.seen_axes(estimator, axes), converged, results.site_sd_mg(estimator, info))


class EstimateRows:
    """Estimates at K instants, in the instrument's axes and units.

    `rows`: as `filters.kalman.runner.rows` gives them, shape (K, layout.OUT).
    `verdict`: holds for all of them.
    """

    def __init__(self, rows: np.ndarray, verdict: BiasVerdicts, info: SessionInfo) -> None:
        self._rows, self._verdict = rows, verdict
        nav = nav_of(rows[:, layout.OUT_NAV : layout.OUT_NIS])
        P = covariance_of(rows[:, layout.OUT_P :])
        self._state = results.state_columns(nav, info, verdict.seen)
        self._sd = results.sd_columns(P, nav.C_nb, info, verdict.seen, verdict.site_sd_mg)

    def biases(self) -> tuple[np.ndarray, np.ndarray]:
        """Return biases and standard deviations, gyros in deg/s, then accelerometers in mg, (K, 6); NaN if not seen."""
        values, sd = (np.hstack([of["gyro_bias_dps"], of["accel_bias_mg"]]) for of in (self._state, self._sd))
        return values, sd

    def add_to(self, history: EstimateHistory) -> None:
        """Add the biases to a history of six columns."""
        values, sd = self.biases()
        history.add_all(self._rows[:, layout.OUT_T], values, 3.0 * sd, np.roll(self._verdict.converged, 3))

    def encode(self, stamps_ns: np.ndarray) -> list[bytes]:
        """Return the estimates as messages; `stamps_ns` are their sampling instants, UTC, shape (K,)."""
        nis, dof = self._rows[:, layout.OUT_NIS], self._rows[:, layout.OUT_DOF]
        values = np.column_stack([*self._state.values(), *self._sd.values(), nis])
        return schemas.encode_estimates(stamps_ns, values, dof, self._verdict.converged)

"""Estimates as messages: rows of the runner to packed imutui_msgs/Estimate, many at a time."""

from dataclasses import dataclass

import numpy as np

from filters import attitude, state
from filters.kalman import layout
from filters.kalman.runner import Estimator
from imutui.estimate_history import EstimateHistory
from imutui.logbook import results, schemas
from imutui.logbook.session_info import SessionInfo


@dataclass(frozen=True, slots=True)
class BiasVerdicts:
    """What is said of all biases at once, accelerometer then gyro, instrument axes; each six."""

    seen: tuple[bool, ...]  # whether it is observable
    converged: tuple[bool, ...]  # whether it has converged
    site_sd_mg: tuple[float, ...] = (0.0, 0.0, 0.0)  # of the accelerometers, see `results.site_sd_mg`

    @classmethod
    def of(cls, estimator: Estimator, info: SessionInfo) -> "BiasVerdicts":
        """What the estimator says after its latest sample."""
        axes = info.axes()
        since = results.converged_since(estimator, axes, np.ones(6, bool))
        converged = tuple(s is not None for name in ("accel_bias", "gyro_bias") for s in since[name])
        seen = tuple(bool(s) for s in results.seen_axes(estimator, axes))
        return cls(seen, converged, tuple(results.site_sd_mg(estimator, info).tolist()))


@dataclass(frozen=True, slots=True)
class BiasEstimates:
    """Estimated biases and their standard deviations, instrument axes, each (K, 3); NaN where none is observable."""

    accel_mg: np.ndarray
    gyro_dps: np.ndarray
    accel_sd_mg: np.ndarray
    gyro_sd_dps: np.ndarray


def biases(rows: np.ndarray, verdict: BiasVerdicts, info: SessionInfo) -> BiasEstimates:
    """Biases of rows.

    `rows`: as `filters.kalman.runner.rows` gives them, shape (K, layout.OUT).
    `verdict`: holds for all of them.
    `info`: axes and units.
    """
    axes, g_unit = info.axes(), info.g_unit
    hidden = ~np.array(verdict.seen)
    nav = rows[:, layout.OUT_NAV : layout.OUT_NIS]
    sd = np.sqrt(np.diagonal(_covariance(rows), axis1=1, axis2=2))
    accel = axes.accel_to_instrument(nav[:, layout.NAV_BA : layout.NAV_BG]) / g_unit * 1e3
    accel_sd = np.hypot(axes.sd_to_instrument(sd[:, state.ACCEL_BIAS]) / g_unit * 1e3, verdict.site_sd_mg)
    gyro = np.rad2deg(axes.gyro_to_instrument(nav[:, layout.NAV_BG :]))
    gyro_sd = np.rad2deg(axes.sd_to_instrument(sd[:, state.GYRO_BIAS]))
    accel[:, hidden[:3]] = accel_sd[:, hidden[:3]] = np.nan
    gyro[:, hidden[3:]] = gyro_sd[:, hidden[3:]] = np.nan
    return BiasEstimates(accel, gyro, accel_sd, gyro_sd)


def add_to_history(history: EstimateHistory, rows: np.ndarray, verdict: BiasVerdicts, info: SessionInfo) -> None:
    """Add rows to a history of six columns: gyro biases in deg/s, then accelerometer biases in mg.

    `history`: of the run.
    `rows`, `verdict`, `info`: as of `biases`.
    """
    found = biases(rows, verdict, info)
    values = np.hstack([found.gyro_dps, found.accel_mg])
    sd3 = 3.0 * np.hstack([found.gyro_sd_dps, found.accel_sd_mg])
    converged = np.roll(np.array(verdict.converged), 3)
    history.add_all(rows[:, layout.OUT_T], values, sd3, converged)


def _covariance(rows: np.ndarray) -> np.ndarray:
    covariance: np.ndarray = rows[:, layout.OUT_P :].reshape(-1, state.SIZE, layout.STRIDE)[:, :, : state.SIZE]
    return covariance


def encode(rows: np.ndarray, stamps_ns: np.ndarray, verdict: BiasVerdicts, info: SessionInfo) -> list[bytes]:
    """CDR bytes of estimates.

    `rows`: as `filters.kalman.runner.rows` gives them, shape (K, layout.OUT).
    `stamps_ns`: sampling instants, UTC, ns, shape (K,).
    `verdict`: holds for all of them.
    `info`: axes and units.
    """
    found = biases(rows, verdict, info)
    nav = rows[:, layout.OUT_NAV : layout.OUT_NIS]
    P = _covariance(rows)
    sd = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    C_nb = attitude.from_quaternion(nav[:, layout.NAV_Q : layout.NAV_BA])
    with np.errstate(divide="ignore", invalid="ignore"):
        J = attitude.rpy_jacobian(C_nb)
        rpy_sd = np.sqrt(np.einsum("kij,kjl,kil->ki", J, P[:, state.ATTITUDE, state.ATTITUDE], J))
    longitude = np.remainder(np.rad2deg(nav[:, 1]) + 180.0, 360.0) - 180.0
    values = np.column_stack(
        [
            np.rad2deg(nav[:, 0]),
            longitude,
            nav[:, 2],
            nav[:, layout.NAV_V : layout.NAV_Q],
            np.rad2deg(attitude.to_rpy(C_nb)),
            found.accel_mg,
            found.gyro_dps,
            sd[:, state.POSITION],
            sd[:, state.VELOCITY],
            np.rad2deg(rpy_sd),
            found.accel_sd_mg,
            found.gyro_sd_dps,
            rows[:, layout.OUT_NIS],
        ]
    )
    return schemas.encode_estimates(stamps_ns, values, rows[:, layout.OUT_DOF], verdict.converged)

"""The part of the snapshot that tells of the filter, before there are estimates (`observe_estimator` has those)."""

import numpy as np

from filters import specification
from filters.imu import CHANNELS
from filters.specification import ImuSpec
from imutui.filter_snapshot import FilterSnapshot
from imutui.logbook.session_info import SessionInfo

AXES = ("x", "y", "z")
_NO_UPDATE = "no update yet"


def before_estimates(info: SessionInfo) -> FilterSnapshot:
    """What a screen shows of a filter whose code may not even be loaded yet: what its settings say."""
    return {
        "name": info.filter,
        "reference": info.reference,
        "t": None,
        "samples": 0,
        "waiting": None,
        "converged": False,
        "temperature_k_per_min": None,
        "held_since": None,
        "departure": None,
        "own_limits": specification.is_known(info.instrument),
        "limits_of": specification.of_model(info.instrument).source,
        "biases": [
            {
                "name": f"{axis} {kind}",
                "value": None,
                "sd3": None,
                "unit": unit,
                "limit": limit,
                "change_10s": None,
                "converged_s": None,
                "observable": True,
            }
            for kind, unit, limit in bias_limits(specification.of_model(info.instrument), info.g_unit)
            for axis in AXES
        ],
        "nis": {"mean": None, "first": None, "dof": 0, "band95": [None, None], "is_test": False, "why": _NO_UPDATE},
        "remainder": [{"channel": channel, "ratio": None, "windows": 0} for channel in CHANNELS],
        "effects": [],
        "state": None,
        "state_sd": None,
        "alarms": [],
        "failure": None,
        "rejected": 0,
        "confounded": [],
    }


def bias_limits(spec: ImuSpec, g_unit: float) -> tuple[tuple[str, str, float], ...]:
    """Kind, unit and the data sheet's limit of the biases, g of so many m/s² for the accelerometers' mg."""
    return (
        ("gyro", "deg/s", float(np.rad2deg(spec.gyro_bias_limit))),
        ("accel", "mg", spec.accel_bias_limit / g_unit * 1e3),
    )

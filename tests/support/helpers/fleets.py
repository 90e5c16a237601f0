"""Rows of a campaign over fleets with known truth: biases of units, days and months."""

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np

from helpers.shapes import whole
from imutui.jobs.campaign.rows import ResultsDocument, Row

BEGIN = datetime.fromisoformat("2026-01-05T08:00:00+00:00")
SD = {"accel_bias_mg": 0.05, "gyro_bias_dps": 0.004}  # what the filter says of each estimate
UNIT_SD = {"accel_bias_mg": 2.0, "gyro_bias_dps": 0.1}
DAY_SD = {"accel_bias_mg": 0.4, "gyro_bias_dps": 0.02}
KEYS = ("gyro_bias_dps", "accel_bias_mg")


def row(log: str, **fields: Any) -> dict[str, Any]:
    """A row of a log with a result: zero biases, noise within Table 1."""
    zeros = {key: [0.0, 0.0, 0.0] for key in KEYS}
    made = {
        "log": log,
        "error": None,
        "kind": "measured",
        "instrument": "IMU400CD-200",
        "serial_number": "0001",
        "start_utc": BEGIN.isoformat(),
        "power_on": log,
        "temperature_degc": {"mean": 22.0, "min": 21.0, "max": 23.0},
        "reference": "level",
        "settings_sha256": "00",
        "final": zeros,
        "sd": {key: [sd] * 3 for key, sd in SD.items()},
        "converged_s": {"accel_bias": [30.0] * 3, "gyro_bias": [30.0] * 3},
        "noise": {"gyro_arw_deg_sqrt_h": [3.0] * 3, "accel_vrw_mps_sqrt_h": [0.5] * 3, "relative_sd": 0.1},
    }
    return dict(whole(Row, made, **fields))


def results(*rows: Any, **fields: Any) -> Any:
    """A `results.json` of rows."""
    return whole(ResultsDocument, root="/data/logs") | {"rows": list(rows)} | fields


def bad(log: str, error: str = "it is no log: the first bytes are not MCAP's") -> dict[str, Any]:
    """A row of a log that could not be used."""
    return row(log, error=error, kind="unknown", serial_number="", instrument="", final=None, sd=None)


def fleet(
    serials: Sequence[str],
    power_ons: int,
    *,
    seed: int = 1,
    drift_mg: Mapping[str, float] | None = None,
    finding: Sequence[str] = (),
    **fields: Any,
) -> list[dict[str, Any]]:
    """A power-on a month of each unit.

    `serials`: units.
    `power_ons`: of each.
    `seed`: of everything random.
    `drift_mg`: what the bias of az changes in a month, by serial number.
    `finding`: units in whose every log a trace found that the bias of gx follows temperature; with any, all were
      traced.
    `**fields`: the same in every row.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for serial in serials:
        own = {key: rng.normal(0.0, UNIT_SD[key], 3) for key in KEYS}
        kelvin = 0.02 + rng.normal(0.0, 0.004)
        for month in range(power_ons):
            final = {key: own[key] + rng.normal(0.0, np.hypot(DAY_SD[key], SD[key]), 3) for key in KEYS}
            final["accel_bias_mg"][2] += (drift_mg or {}).get(serial, 0.0) * month
            one = row(f"{serial}/{month:02d}.mcap", serial_number=serial)
            one["final"] |= {key: value.tolist() for key, value in final.items()}
            one["start_utc"] = (BEGIN + timedelta(days=30.4 * month, hours=float(rng.uniform(0, 8)))).isoformat()
            warm = 22.0 + float(rng.normal(0.0, 2.0))
            one["temperature_degc"] = {"mean": warm, "min": warm - 1.0, "max": warm + 1.0}
            if finding:
                one["findings"] = [_finding(kelvin + rng.normal(0.0, 0.001))] if serial in finding else []
            rows.append(one | fields)
    return rows


def _finding(value: float) -> dict[str, Any]:
    param = {"name": "k", "value": float(value), "sd": 0.001, "unit": "deg/s/K"}
    return {
        "effect": "thermal_lin",
        "label": "bias follows temperature",
        "channels": ["gx"],
        "params": [param],
        "confirmed": True,
    }

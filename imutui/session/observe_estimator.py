"""Fills the part of the snapshot that tells of the filter's estimates; loads statistics, as the filter does."""

import numpy as np

from filters import specification
from filters.kalman.runner import Estimator
from imutui.filter_snapshot import BiasSnapshot, EffectSnapshot, FilterSnapshot
from imutui.logbook import departures, results
from imutui.logbook.session_info import SessionInfo
from imutui.session.observe_filter import AXES, bias_limits
from imutui.verdict import sources


def snapshot(estimator: Estimator, info: SessionInfo) -> FilterSnapshot:
    """What a screen shows of the filter, in the instrument's axes and units.

    `estimator`: between two samples.
    `info`: axes and units.
    """
    latest = estimator.latest
    out: FilterSnapshot = {
        "name": info.filter,
        "reference": info.reference,
        "t": None if latest is None else latest.t,
        "samples": estimator.taken,
        "waiting": None,
        "converged": estimator.converged,
        "biases": _biases(estimator, info),
        "nis": results.nis_fields(estimator),
        "remainder": results.remainder_fields(estimator, info.axes()),
        "noise": sources.noisiest(results.noise_fields(estimator, info.axes(), info.noise), info.reference),
        "temperature_k_per_min": estimator.temperature.k_per_min(),
        "held_since": estimator.held_since,
        "own_limits": specification.is_known(info.instrument),
        "limits_of": estimator.settings.spec.source,
        "departure": departures.sentence(estimator, info.axes(), info.g_unit),
        "effects": _effects(estimator),
        "state": None,
        "state_sd": None,
        "alarms": estimator.alarms(),
        "failure": None,
        "rejected": estimator.rejected,
        "confounded": estimator.confounded(),
    }
    # after the reference has ended nothing is integrated, and what stood there last is no estimate of now
    if latest is not None and estimator.held_since is None and not estimator.awaits_reference:
        axes, g_unit = info.axes(), info.g_unit
        seen = results.seen_axes(estimator, axes)
        nav, P = latest.belief.nav, latest.belief.P
        state = results.state_fields(nav, axes, g_unit, seen)
        sd = results.sd_fields(P, nav, axes, g_unit, seen)
        out["state"] = {
            "position_deg_m": _numbers(state["position_deg_m"]),
            "velocity_mps": _numbers(state["velocity_mps"]),
            "rpy_deg": state["rpy_deg"],
        }
        out["state_sd"] = {
            "position_m": _numbers(sd["position_m"]),
            "velocity_mps": _numbers(sd["velocity_mps"]),
            "rpy_deg": sd["rpy_deg"],
        }
    return out


def _numbers(values: list[float | None]) -> list[float]:
    """Numbers of a state that is placed, which all are."""
    return [value for value in values if value is not None]


def _effects(estimator: Estimator) -> list[EffectSnapshot]:
    """States of the effects that joined the filter, each in the unit of its file."""
    if estimator.latest is None:
        return []
    out: list[EffectSnapshot] = []
    for field in results.effect_fields(estimator):
        label, _, unit = field["name"].removesuffix(")").partition(" (")
        out.append({"label": label, "value": field["value"], "sd": field["sd"], "unit": unit})
    return out


def _biases(estimator: Estimator, info: SessionInfo) -> list[BiasSnapshot]:
    axes, g_unit = info.axes(), info.g_unit
    spec = estimator.settings.spec
    latest, convergence = estimator.latest, estimator.monitor.convergence()
    values, sds = None, None
    seen = results.seen_axes(estimator, axes)
    since = results.converged_since(estimator, axes)
    change = convergence.change if convergence.change is not None else np.full(6, np.nan)
    changes = {
        "gyro": np.rad2deg(axes.gyro_to_instrument(change[3:])),
        "accel": axes.accel_to_instrument(change[:3]) / g_unit * 1e3,
    }
    if latest is not None:
        nav = latest.belief.nav
        final = results.state_fields(nav, axes, g_unit, seen)
        spread = results.sd_fields(latest.belief.P, nav, axes, g_unit, seen)
        values = {"gyro": final["gyro_bias_dps"], "accel": final["accel_bias_mg"]}
        sds = {"gyro": spread["gyro_bias_dps"], "accel": spread["accel_bias_mg"]}
    out: list[BiasSnapshot] = []
    for kind, unit, limit in bias_limits(spec, g_unit):
        for i, axis in enumerate(AXES):
            sd = sds[kind][i] if sds else None
            moved = changes[kind][i]
            out.append(
                {
                    "name": f"{axis} {kind}",
                    "value": values[kind][i] if values else None,
                    "sd3": None if sd is None else 3.0 * sd,
                    "unit": unit,
                    "limit": limit,
                    "change_10s": float(moved) if np.isfinite(moved) else None,
                    "converged_s": since[f"{kind}_bias"][i],
                    "observable": bool(seen[i + 3 * (kind == "gyro")]),
                }
            )
    return out

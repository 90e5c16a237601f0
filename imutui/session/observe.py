"""Fills the snapshot that viewers see (`snapshot` has its shape), between two packets."""

import os
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from filters.imu import CHANNELS
from filters.kalman.runner import Estimator
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from imutui.logbook import results
from imutui.logbook.session_info import SessionInfo
from imutui.session.disk_space import Growth, Room
from imutui.session.metadata import effect_labels
from imutui.session.operator_guide import Guide
from imutui.session.plan import Plan
from imutui.session.recent_packets import STATISTICS_S, LiveView
from imutui.session.recording import Take, Timebase
from imutui.session.rotation import Parts
from imutui.session.snapshot import (
    BiasSnapshot,
    EffectSnapshot,
    EventLine,
    FilterSnapshot,
    RecordingSnapshot,
    RemainderSnapshot,
    SessionState,
    Snapshot,
)

_NAMES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class Mark:
    """What the operator said.

    Attributes
    ----------
    at_ns : int or None
        Monotonic; None if an earlier take is meant.
    utc, text : str
        When, as a clock on the wall shows it, and what.
    """

    at_ns: int | None
    utc: str
    text: str


class Acquisition(Protocol):
    """What a snapshot is taken of: the engine, between two packets."""

    plan: Plan
    info: SessionInfo
    state: SessionState
    error: str | None
    take: Take
    live: LiveView
    timebase: Timebase
    started_ns: int
    motion: Profile | Trajectory | None
    guide: Guide | None
    parts: Parts | None
    room: Room
    growth: Growth

    @property
    def last_packet_ns(self) -> int:
        """When the last packet was read, monotonic."""
        ...

    @property
    def zeroing(self) -> bool:
        """Whether packets pause for the unit to zero its rate sensors."""
        ...

    @property
    def marks(self) -> Iterable[Mark]:
        """The recording's last marks."""
        ...

    @property
    def events(self) -> Iterable[EventLine]:
        """The last events."""
        ...


def snapshot(engine: Acquisition, since: int) -> Snapshot:
    """Everything a screen shows.

    Parameters
    ----------
    engine : Acquisition
        The running one.
    since : int
        Number of the first packet wanted in `series`.
    """
    now = time.monotonic_ns()
    info, take, plan = engine.info, engine.take, engine.plan
    return {
        "name": plan.name,
        "pid": os.getpid(),
        "state": engine.state,
        "error": engine.error,
        "instrument": info.instrument,
        "serial_number": info.serial_number,
        "firmware": info.firmware,
        "kind": info.kind,
        "port": info.port,
        "baud": info.baud,
        "rate_hz": info.rate_hz,
        "sampling": info.sampling,
        "measured_hz": take.rate.hz(),
        "packet_hz": engine.live.rate_hz(),
        "packets": take.tally.packets,
        "lost_packets": take.tally.lost_packets,
        "bad_checksums": take.tally.bad_checksums,
        "discarded_bytes": take.tally.discarded_bytes,
        "silent_s": 0.0 if engine.zeroing else (now - engine.last_packet_ns) / 1e9,
        "zeroing": engine.zeroing,
        "since_start_s": (now - engine.started_ns) / 1e9,
        "utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(engine.timebase.utc_ns(now) / 1e9)),
        "recording": _recording(engine, now),
        "logs": plan.logs,
        "operator": engine.info.operator,
        "place": plan.place,
        "table": plan.table,
        "note": take.info.note if take.writer is not None else plan.note,
        "rotate_minutes": plan.rotate_minutes,
        "rotate_mb": plan.rotate_mb,
        "free_bytes": _free_bytes(engine, now),
        "marks": [{"t": _seconds(mark.at_ns, take), "utc": mark.utc, "text": mark.text} for mark in engine.marks],
        "reference": {
            "name": plan.reference,
            "file": plan.reference_file[0],
            "profile": isinstance(engine.motion, Profile),
        },
        "effects": list(effect_labels(plan.effects)),
        "guide": None if engine.guide is None else engine.guide.snapshot(now, take.started_ns),
        "channels": engine.live.channels(),
        "statistics_s": STATISTICS_S,
        "filter": None if take.estimator is None else _filter(take, take.estimator),
        "events": list(engine.events),
        "series": engine.live.series(since),
    }


def _recording(engine: Acquisition, now: int) -> RecordingSnapshot | None:
    take = engine.take
    if take.writer is None:
        return None
    rate, free = engine.growth.bytes_per_s(), _free_bytes(engine, now)
    return {
        "path": str(take.writer.path),
        "bytes": take.writer.size,
        "seconds": (now - take.started_ns) / 1e9 if take.started_ns is not None else 0.0,
        "samples": take.samples,
        "flush_age_s": (now - take.flushed_ns) / 1e9 if take.flushed_ns is not None else None,
        "marks": take.marks,
        "bytes_per_s": rate,
        "to_full_s": free / rate if rate and free is not None else None,
        "part": engine.parts.number if engine.parts is not None else 1,
    }


def _free_bytes(engine: Acquisition, now: int) -> int | None:
    """Free space where the present recording goes, or the next one would."""
    writer = engine.take.writer
    return engine.room.free_bytes(writer.path.parent if writer is not None else Path(engine.plan.logs), now)


def _seconds(at_ns: int | None, take: Take) -> float | None:
    """Seconds since the take began."""
    if at_ns is None or take.started_ns is None:
        return None
    return max(0.0, (at_ns - take.started_ns) / 1e9)


def _filter(take: Take, estimator: Estimator) -> FilterSnapshot:
    latest = estimator.latest
    out: FilterSnapshot = {
        "name": take.info.filter,
        "reference": take.info.reference,
        "t": None if latest is None else latest.t,
        "samples": estimator.samples,
        "waiting": _waiting(take, estimator),
        "converged": estimator.converged,
        "biases": _biases(take, estimator),
        "nis": results.nis_fields(estimator),
        "remainder": _remainder(take, estimator),
        "effects": _effects(estimator),
        "state": None,
        "state_sd": None,
        "alarms": estimator.alarms() + ([take.failure] if take.failure is not None else []),
        "failure": take.failure,
        "rejected": estimator.rejected,
        "confounded": estimator.confounded(),
    }
    if latest is not None:
        axes, g_unit = take.info.axes(), take.info.g_unit
        seen = results.seen_axes(estimator, axes)
        nav, P = latest.belief.nav, latest.belief.P
        state = results.state_fields(nav, axes, g_unit, seen)
        sd = results.sd_fields(P, nav, axes, g_unit, seen)
        out["state"] = {
            "position_deg_m": state["position_deg_m"],
            "velocity_mps": state["velocity_mps"],
            "rpy_deg": state["rpy_deg"],
        }
        out["state_sd"] = {
            "position_m": sd["position_m"],
            "velocity_mps": sd["velocity_mps"],
            "rpy_deg": sd["rpy_deg"],
        }
    return out


def _remainder(take: Take, estimator: Estimator) -> list[RemainderSnapshot]:
    """What the model does not explain, by channel; None where a bias cannot be seen, or nothing is known yet."""
    axes, found = take.info.axes(), estimator.monitor.remainder()
    ratio = np.full(6, np.nan)
    if found.ratio is not None:
        parts = found.ratio[3:], found.ratio[:3]
        ratio = np.concatenate([results.to_instrument_order(part, axes) for part in parts])
        accel, gyro = np.split(results.seen_axes(estimator, axes), 2)
        ratio[~np.concatenate([gyro, accel])] = np.nan
    return [
        {"channel": channel, "ratio": float(r) if np.isfinite(r) else None, "windows": found.windows}
        for channel, r in zip(CHANNELS, ratio, strict=True)
    ]


def _effects(estimator: Estimator) -> list[EffectSnapshot]:
    """States of the effects that joined the filter, each in the unit of its file."""
    if estimator.latest is None:
        return []
    out: list[EffectSnapshot] = []
    for field in results.effect_fields(estimator):
        label, _, unit = field["name"].removesuffix(")").partition(" (")
        out.append({"label": label, "value": field["value"], "sd": field["sd"], "unit": unit})
    return out


def _waiting(take: Take, estimator: Estimator) -> str | None:
    if take.filter is not None and take.filter.waiting > 1:
        return f"preparing the filter, the first time on this machine; {take.filter.waiting} samples wait for it"
    if estimator.reference is None:
        return "finding level from gravity: keep the unit still for the first 10 s"
    return "waiting for the first sample" if take.samples == 0 else None


def _biases(take: Take, estimator: Estimator) -> list[BiasSnapshot]:
    axes, g_unit = take.info.axes(), take.info.g_unit
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
    for kind, unit, limit in (
        ("gyro", "deg/s", float(np.rad2deg(spec.gyro_bias_limit))),
        ("accel", "mg", spec.accel_bias_limit / g_unit * 1e3),
    ):
        for i, axis in enumerate(_NAMES):
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

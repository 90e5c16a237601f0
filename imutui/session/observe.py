"""Fills the snapshot that viewers see (`snapshot` has its shape), between two packets."""

import os
import time
from typing import TYPE_CHECKING

import numpy as np

from filters import specification
from filters.imu import CHANNELS
from filters.motion.profile import Profile
from imutui.filter_snapshot import BiasSnapshot, FilterSnapshot
from imutui.logbook import line_advice
from imutui.logbook.health import has_readings
from imutui.logbook.session_info import SessionInfo
from imutui.session import requests
from imutui.session.acquisition import Acquisition
from imutui.session.channel_statistics import STATISTICS_S
from imutui.session.live_filter import LiveFilter
from imutui.session.metadata import effect_labels
from imutui.session.plan import batch_of
from imutui.session.recording import Recording
from imutui.session.snapshot import NO_SERIES, RecordingSnapshot, Snapshot

if TYPE_CHECKING:
    from filters.health.finding import HealthEntry
    from filters.kalman.runner import Estimator

_FOUND_FROM_SAMPLES = ("gravity", "turned", "trajectory")
_LOADING_S = 5.0
_MOST_CAUSES = 20
_NO_UPDATE = "no update yet"


def snapshot(of: Acquisition, since: int) -> Snapshot:
    """Everything a screen shows; `since` is the number of the first packet wanted in `series`."""
    if since < NO_SERIES:
        of.reader.be_watched()
    now, recording, stands = time.monotonic_ns(), of.recording, of.lifecycle
    plan, info, run = recording.plan, recording.info, recording.run
    counters, away, zeroing = run.counters, of.line.snapshot(now), of.zeroing is not None
    return {
        "name": plan.name,
        "batch": batch_of(plan.name),
        "pid": os.getpid(),
        "owner": f"{requests.user_name(os.getuid())} on {info.host}",
        "state": stands.state,
        "error": stands.error,
        "findings": [finding["text"] for finding in stands.findings],
        "ended_by": stands.ended_by,
        "instrument": info.instrument,
        "serial_number": info.serial_number,
        "firmware": info.firmware,
        "kind": info.kind,
        "site_stated": info.site_stated,
        "port": info.port,
        "ends_unwatched_s": plan.ends_unwatched_s,
        "baud": info.baud,
        "rate_hz": info.rate_hz,
        "sampling": info.sampling,
        # nothing comes from a unit that is away
        "measured_hz": None if away else run.rate.hz(),
        "packet_hz": None if away else of.recent.rate_hz(),
        "packets": counters.packets,
        "lost_packets": counters.lost_packets,
        "lost_packets_max": counters.lost_packets_max,
        "bad_checksums": counters.bad_checksums,
        "discarded_bytes": counters.discarded_bytes,
        "doubled_packets": counters.doubled_packets,
        "advice": {"losses": of.line.loss_advice.brief, "silence": line_advice.of_silence(info.port, info.firmware)},
        "status": of.status.newest,
        "silent_s": 0.0 if zeroing else (now - of.reader.last_packet_ns) / 1e9,
        "zeroing": zeroing,
        "reconnecting": away,
        "since_start_s": (now - of.started_ns) / 1e9,
        "utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(of.timebase.utc_ns(now) / 1e9)),
        "recording": _recording(recording, now),
        "logs": plan.logs,
        "operator": info.operator,
        "place": plan.place,
        "table": plan.table,
        "note": plan.note if recording.writer is None else recording.file_info.note,
        "next_note": plan.note,
        "rotate_minutes": plan.rotate_minutes,
        "rotate_mb": plan.rotate_mb,
        "free_bytes": recording.free_bytes(now),
        "min_free_bytes": recording.space.min_free_bytes,
        "marks": of.events.marks(run.started_ns),
        "reference": {
            "name": plan.reference,
            "file": plan.reference_file[0],
            "profile": isinstance(recording.motion, Profile),
        },
        "effects": list(effect_labels(plan.effects)),
        "guide": of.guidance.snapshot(now, run.started_ns),
        "controller": None if of.guidance.table is None else of.guidance.table.snapshot(investigates=plan.needs_viewer),
        "channels": of.recent.channels(),
        "statistics_s": STATISTICS_S,
        "health": run.health,
        "filter": None if run.filter is None else _filter(run.filter, run.health),
        "events": of.events.events(),
        "series": of.recent.series(since),
    }


def _recording(recording: Recording, now_ns: int) -> RecordingSnapshot | None:
    writer, run, space = recording.writer, recording.run, recording.space
    if writer is None:
        return None
    started, flushed = run.started_ns, run.flushed_ns
    return {
        "path": str(writer.path),
        "bytes": writer.size,
        "seconds": (now_ns - started) / 1e9 if started is not None else 0.0,
        "samples": run.samples,
        "flush_age_s": (now_ns - flushed) / 1e9 if flushed is not None else None,
        "marks": run.marks,
        "bytes_per_s": space.bytes_per_s(),
        "to_full_s": space.seconds_left(recording.free_bytes(now_ns)),
        "part": recording.part,
    }


def _filter(live: LiveFilter, health: "list[HealthEntry]") -> FilterSnapshot:
    """The filter; until its first sample has been used, when its code may not be loaded yet, what its settings say."""
    info, estimator = live.info, live.estimator
    spec = specification.of_model(info.instrument) if estimator is None else estimator.settings.spec
    has_sheet = specification.is_known(info.instrument)
    out: FilterSnapshot = {
        "name": info.filter,
        "reference": info.reference,
        "t": None,
        "samples": 0,
        "waiting": _waiting(live),
        "converged": False,
        "temperature_k_per_min": None,
        "held_since": None,
        "departure": None,
        "limits_of": spec.source,
        "biases": [
            {
                "name": f"{axis} {kind}",
                "value": None,
                "sd3": None,
                "site_sd3": 0.0,
                "unit": unit,
                "limit": limit,
                "change_10s": None,
                "converged_s": None,
                "observable": True,
            }
            for kind, unit, limit in (
                ("gyro", "deg/s", float(np.rad2deg(spec.gyro_bias_limit)) if has_sheet else None),
                ("accel", "mg", spec.accel_bias_limit / info.g_unit * 1e3 if has_sheet else None),
            )
            for axis in "xyz"
        ],
        "nis": {"mean": None, "first": None, "dof": 0, "band95": [None, None], "is_test": False, "why": _NO_UPDATE},
        "remainder": [{"channel": channel, "ratio": None, "windows": 0} for channel in CHANNELS],
        "noise": None,
        "causes": [],
        "causes_gone": [],
        "effects": [],
        "state": None,
        "state_sd": None,
        "alarms": [],
        "failure": live.failure,
        "rejected": 0,
        "confounded": [],
    }
    if estimator is not None:
        _estimates(out, estimator, info, health)
    if live.failure is not None:
        out["alarms"].append(live.failure)
    return out


def _estimates(out: FilterSnapshot, estimator: "Estimator", info: SessionInfo, health: "list[HealthEntry]") -> None:
    """Put in what there is of estimates, in the instrument's axes and units; loads statistics, as the filter has."""
    from imutui.logbook import departures, results
    from imutui.verdict import sources

    axes, latest = info.axes(), estimator.latest
    out["samples"] = estimator.taken
    reads, observable = has_readings(health), results.seen_axes(estimator, axes)
    out["converged"] = estimator.converged and bool(reads[observable].all())
    out["nis"] = results.nis_fields(estimator)
    out["remainder"] = results.remainder_fields(estimator, axes)
    out["noise"] = sources.noisiest(results.noise_fields(estimator, axes, info.noise), info.reference)
    out["temperature_k_per_min"] = estimator.temperature.k_per_min()
    out["held_since"] = estimator.held_since
    out["departure"] = departures.sentence(estimator, axes, info.g_unit)
    out["causes"] = departures.causes(estimator, axes, info.g_unit)[:_MOST_CAUSES]
    out["causes_gone"] = departures.withdrawn(estimator, axes, info.g_unit)[:_MOST_CAUSES]
    out["alarms"] = estimator.alarms()
    out["rejected"] = estimator.rejected
    out["confounded"] = estimator.confounded()
    change, seen = estimator.monitor.convergence().change, observable & reads
    since = results.converged_since(estimator, axes, reads)
    for bias, is_seen, converged_s in zip(
        out["biases"], (*seen[3:], *seen[:3]), (*since["gyro_bias"], *since["accel_bias"]), strict=True
    ):
        bias["observable"], bias["converged_s"] = bool(is_seen), converged_s
    if change is not None:
        gyro = np.rad2deg(axes.gyro_to_instrument(change[3:]))
        accel = axes.accel_to_instrument(change[:3]) / info.g_unit * 1e3
        for bias, moved in zip(out["biases"], (*gyro, *accel), strict=True):
            bias["change_10s"] = float(moved) if np.isfinite(moved) else None
    if latest is None:
        return
    state = results.state_fields(latest.belief.nav, axes, info.g_unit, seen)
    site_mg = results.site_sd_mg(estimator, info)
    sd = results.sd_fields(latest.belief.P, latest.belief.nav, axes, info.g_unit, seen, site_mg=site_mg)
    out["t"] = latest.t
    _values(out["biases"][:3], state["gyro_bias_dps"], sd["gyro_bias_dps"])
    _values(out["biases"][3:], state["accel_bias_mg"], sd["accel_bias_mg"])
    for bias, share in zip(out["biases"][3:], site_mg.tolist(), strict=True):
        bias["site_sd3"] = 3.0 * share
    for field in results.effect_fields(estimator):
        label, _, unit = field["name"].removesuffix(")").partition(" (")
        out["effects"].append({"label": label, "value": field["value"], "sd": field["sd"], "unit": unit})
    # after the reference has ended nothing is integrated, and what stood there last is no estimate of now
    if estimator.held_since is None and not estimator.awaits_reference:
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


def _values(biases: list[BiasSnapshot], values: list[float | None], sds: list[float | None]) -> None:
    for bias, value, sd in zip(biases, values, sds, strict=True):
        bias["value"], bias["sd3"] = value, None if sd is None else 3.0 * sd


def _numbers(values: list[float | None]) -> list[float]:
    """Numbers of a state that is placed, which all are."""
    return [value for value in values if value is not None]


def _waiting(live: LiveFilter) -> str | None:
    if live.waiting > 1:
        preparing = "preparing the filter"
        if live.preparation.seconds() > _LOADING_S:
            preparing += ", the first time on this machine"
        return f"{preparing}; {live.waiting} samples wait for it"
    estimator = live.estimator
    if live.info.reference in _FOUND_FROM_SAMPLES if estimator is None else estimator.reference is None:
        return "finding level from gravity: keep the unit still for the first 10 s"
    if estimator is None:
        return "waiting for the first sample"
    return (
        "no reference yet: navigation begins in the first dwell that is marked" if estimator.awaits_reference else None
    )

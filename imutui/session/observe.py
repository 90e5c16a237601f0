"""Fills the snapshot that viewers see (`snapshot` has its shape), between two packets."""

import os
import time
from dataclasses import dataclass

from imutui.filter_snapshot import FilterSnapshot
from imutui.logbook import line_advice
from imutui.logbook.session_info import SessionInfo
from imutui.session import observe_filter
from imutui.session.disk_space import DiskGuard
from imutui.session.event_log import EventLog
from imutui.session.live_filter import LiveFilter
from imutui.session.metadata import effect_labels
from imutui.session.operator_guide import Guide
from imutui.session.plan import Plan
from imutui.session.recent_packets import STATISTICS_S, RecentPackets
from imutui.session.recording import Recording
from imutui.session.sample_pipeline import SamplePipeline
from imutui.session.snapshot import ReconnectingSnapshot, RecordingSnapshot, SessionState, Snapshot, StreamSnapshot

_FOUND_FROM_SAMPLES = ("gravity", "turned", "trajectory")
_LOADING_S = 5.0


@dataclass(frozen=True, slots=True)
class AcquisitionView:
    """What a snapshot is made of."""

    # now_ns, started_ns, last_packet_ns: monotonic: now, when the acquisition began, when its last packet was read
    now_ns: int
    started_ns: int
    last_packet_ns: int
    utc_ns: int  # now, UTC
    loss_advice: str  # where to look when packets are lost
    # plan, info: as they are in force
    plan: Plan
    info: SessionInfo
    # state, error: see `imutui.session.lifecycle.Lifecycle`
    state: SessionState
    error: str | None
    findings: tuple[str, ...]  # what must be said at the end, so far
    ended_by: str  # who or what asked for the end, in words
    zeroing: bool  # whether packets pause for the unit to zero its rate sensors
    reconnecting: ReconnectingSnapshot | None  # what is being waited for while the unit is away
    follows_profile: bool  # whether the reference comes from a table profile
    pipeline: SamplePipeline  # the present run of samples
    recording: Recording | None  # what is being recorded
    free_bytes: int | None  # free space where the present recording goes, or the next one would
    recent: RecentPackets  # for numbers and curves
    status: str  # the newest packet's status word in words; "" where no bit is set
    events: EventLog  # last events and marks
    guide: Guide | None  # where the operator is in a profile
    # for how long a virtual unit of its own turns still to where the operator sent it; None of others
    turns_s: float | None
    stream: StreamSnapshot | None  # the live stream for Foxglove


def snapshot(view: AcquisitionView, since: int) -> Snapshot:
    """Everything a screen shows.

    `view`: the acquisition, between two packets.
    `since`: number of the first packet wanted in `series`.
    """
    now, info, plan, pipeline = view.now_ns, view.info, view.plan, view.pipeline
    counters = pipeline.counters
    return {
        "name": plan.name,
        "pid": os.getpid(),
        "state": view.state,
        "error": view.error,
        "findings": list(view.findings),
        "ended_by": view.ended_by,
        "instrument": info.instrument,
        "serial_number": info.serial_number,
        "firmware": info.firmware,
        "kind": info.kind,
        "port": info.port,
        "ends_unwatched_s": plan.ends_unwatched_s,
        "baud": info.baud,
        "rate_hz": info.rate_hz,
        "sampling": info.sampling,
        # nothing comes from a unit that is away
        "measured_hz": None if view.reconnecting else pipeline.rate.hz(),
        "packet_hz": None if view.reconnecting else view.recent.rate_hz(),
        "packets": counters.packets,
        "lost_packets": counters.lost_packets,
        "lost_packets_max": counters.lost_packets_max,
        "bad_checksums": counters.bad_checksums,
        "discarded_bytes": counters.discarded_bytes,
        "advice": {"losses": view.loss_advice, "silence": line_advice.of_silence(info.port, info.firmware)},
        "status": view.status,
        "silent_s": 0.0 if view.zeroing else (now - view.last_packet_ns) / 1e9,
        "zeroing": view.zeroing,
        "reconnecting": view.reconnecting,
        "since_start_s": (now - view.started_ns) / 1e9,
        "utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(view.utc_ns / 1e9)),
        "recording": None if view.recording is None else _recording(view.recording, pipeline, view.free_bytes, now),
        "logs": plan.logs,
        "operator": info.operator,
        "place": plan.place,
        "table": plan.table,
        "note": plan.note if view.recording is None else view.recording.info.note,
        "next_note": plan.note,
        "rotate_minutes": plan.rotate_minutes,
        "rotate_mb": plan.rotate_mb,
        "free_bytes": view.free_bytes,
        "min_free_bytes": DiskGuard(plan.min_free_mb).min_free_bytes,
        "marks": view.events.marks(pipeline.started_ns),
        "reference": {"name": plan.reference, "file": plan.reference_file[0], "profile": view.follows_profile},
        "effects": list(effect_labels(plan.effects)),
        "stream": view.stream,
        "guide": None if view.guide is None else view.guide.snapshot(now, pipeline.started_ns, view.turns_s),
        "channels": view.recent.channels(),
        "statistics_s": STATISTICS_S,
        "filter": None if pipeline.filter is None else _filter(pipeline.filter),
        "events": view.events.events(),
        "series": view.recent.series(since),
    }


def _recording(
    recording: Recording, pipeline: SamplePipeline, free_bytes: int | None, now_ns: int
) -> RecordingSnapshot:
    rate = recording.growth.bytes_per_s()
    left_s = recording.guard.seconds_left(free_bytes, rate)
    started, flushed = pipeline.started_ns, pipeline.flushed_ns
    return {
        "path": str(recording.writer.path),
        "bytes": recording.writer.size,
        "seconds": (now_ns - started) / 1e9 if started is not None else 0.0,
        "samples": pipeline.samples,
        "flush_age_s": (now_ns - flushed) / 1e9 if flushed is not None else None,
        "marks": pipeline.marks,
        "bytes_per_s": rate,
        "to_full_s": left_s,
        "part": recording.parts.number,
    }


def _filter(live: LiveFilter) -> FilterSnapshot:
    """What a screen shows of the filter: nothing but what it waits for, until its first sample has been used."""
    if live.estimator is None:
        found = observe_filter.before_estimates(live.info)
    else:
        # not before there is an estimator, which has loaded what this loads
        from imutui.session import observe_estimator

        found = observe_estimator.snapshot(live.estimator, live.info)
    found["waiting"] = _waiting(live)
    if live.failure is not None:
        found["alarms"].append(live.failure)
        found["failure"] = live.failure
    return found


def _waiting(live: LiveFilter) -> str | None:
    if live.waiting > 1:
        preparing = "preparing the filter"
        if live.preparation.seconds() > _LOADING_S:
            preparing += ", the first time on this machine"
        return f"{preparing}; {live.waiting} samples wait for it"
    if _is_aligning(live):
        return "finding level from gravity: keep the unit still for the first 10 s"
    if live.estimator is not None and live.estimator.awaits_reference:
        return "no reference yet: navigation begins in the first dwell that is marked"
    return "waiting for the first sample" if live.estimator is None else None


def _is_aligning(live: LiveFilter) -> bool:
    if live.estimator is not None:
        return live.estimator.reference is None
    return live.info.reference in _FOUND_FROM_SAMPLES

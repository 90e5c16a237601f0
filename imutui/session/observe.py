"""Fill the snapshot of an acquisition (`snapshot` has its shape), between two packets."""

import os
import time
from typing import TYPE_CHECKING

from filters.motion.profile import Profile
from imutui.estimates import FilterSnapshot
from imutui.logbook import line_advice
from imutui.session.acquisition import Acquisition
from imutui.session.channel_statistics import STATISTICS_S
from imutui.session.live_filter import LiveFilter
from imutui.session.metadata import effect_labels, user_name
from imutui.session.plan import batch_of
from imutui.session.recording import Recording
from imutui.session.snapshot import NO_SERIES, RecordingSnapshot, Snapshot

if TYPE_CHECKING:
    from filters.health.finding import HealthEntry

_FOUND_FROM_SAMPLES = ("gravity", "turned", "trajectory")
_LOADING_S = 5.0
_MOST_CAUSES = 20


def snapshot(of: Acquisition, since: int) -> Snapshot:
    """Return the state for a screen; `since` is the number of the first packet wanted in `series`."""
    if since < NO_SERIES:
        of.reader.be_watched()
    now, recording, stands = time.monotonic_ns(), of.recording, of.lifecycle
    plan, info, run = recording.plan, recording.info, recording.run
    counters, away, zeroing = run.counters, of.line.snapshot(now), of.zeroing is not None
    return {
        "name": plan.name,
        "batch": batch_of(plan.name),
        "pid": os.getpid(),
        "owner": f"{user_name(os.getuid())} on {info.host}",
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
    # loads statistics, as the filter has
    from imutui.logbook import results

    found = results.estimates(live.estimator, live.info, health)
    found["causes"], found["causes_gone"] = found["causes"][:_MOST_CAUSES], found["causes_gone"][:_MOST_CAUSES]
    if live.failure is not None:
        found["alarms"].append(live.failure)
    change = results.change_10s(live.estimator, live.info)
    return {**found, "failure": live.failure, "waiting": _waiting(live), "change_10s": change}


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

"""Whether a log is whole, and whether its parts agree: the file's bytes, its messages, its numbers and times.

A finding is something that a calibration should not rest on unseen; a note is worth a word and no more.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from imutui.jobs import check_data, check_file, damage_text
from imutui.jobs.check_context import SHOWN, CheckContext, Finding
from imutui.jobs.documents import CheckDocument, FindingField
from imutui.jobs.info import lacking_channels
from imutui.jobs.quantities import plural
from imutui.logbook import checksum_file, reader, scan, summary
from imutui.logbook.message_arrays import Audit, audit
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.scan import Scan

VERSION = 1
_SCANNED = 0.5
_RULES = (*check_file.RULES, *check_data.RULES)


def check(path: Path, progress: Callable[[float, str], None] = lambda share, text: None) -> CheckDocument:
    """Look a log through.

    Parameters
    ----------
    path : Path
        Any log, finished or not.
    progress : callable
        Told the share done, 0 to 1, and what is being done.

    Returns
    -------
    CheckDocument
        `log`, `state`, `fine` (no findings), `findings` (code, what, where, next), `notes` (sentences), and what was
        looked at: `bytes`, `chunks`, `messages`, `topics`, `samples`, `packets`, `duration_s`, `log_sha256`.

    Raises
    ------
    UnreadableLogError
        If there is no such file, or it is no log at all.
    """
    found = scan.scan(path, lambda share: progress(_SCANNED * share, f"reading {path.name}"))
    content = audit(found, lambda share: progress(_SCANNED + (1.0 - _SCANNED) * share, "looking at the messages"))
    if content.imu_topic is None and not found.damages:
        raise UnreadableLogError(_no_samples(path, content))
    log = CheckContext(found, content, reader.sha256(path))
    findings = [finding for rule in _RULES for finding in rule(log)]
    progress(1.0, "done")
    seconds = float(np.max(log.t)) if log.t.size else 0.0
    return {
        "version": VERSION,
        "log": str(path.resolve()),
        "state": _state(found),
        "fine": not findings,
        "findings": [_field(finding) for finding in findings],
        "notes": list(_notes(log)),
        "bytes": found.size,
        "chunks": sum(piece.last_ns > 0 for piece in found.pieces),
        "messages": sum(heads.size for heads in content.messages.values()),
        "topics": {topic: int(heads.size) for topic, heads in content.messages.items()},
        "samples": int(content.samples.size),
        "packets": int(content.packets.size),
        "duration_s": seconds,
        "log_sha256": log.sha256,
    }


def _field(finding: Finding) -> FindingField:
    return {"code": finding.code, "what": finding.what, "where": finding.where, "next": finding.next}


def _notes(log: CheckContext) -> Iterator[str]:
    a, found = log.audit, log.found
    if found.held:
        yield "A recorder is writing to it: this is how far it had come."
    if not a.session:
        yield "Another program's file: it has no session, so only its samples were looked at."
    elif a.session.get("kind", "") not in ("measured", "simulated"):
        yield "The log does not say whether a sensor made its readings, or a simulation."
    if a.session and not a.packets.size:
        how = "imported" if a.session.get("sampling") == "imported" else "without packets"
        yield f"The log is {how}: there are no packets to compare the samples with."
    if checksum_file.read_or_none(found.path) == log.sha256:
        yield f"Its SHA-256 is the one in {checksum_file.path_of(found.path).name}."
    if scan.RECOVERED in a.metadata:
        yield f"It was rebuilt by `imutui recover`; lost then: {a.metadata[scan.RECOVERED].get('lost', 'not said')}"
    if not a.samples.size:
        yield "It holds no samples."
    elif lacking := lacking_channels(a):
        yield f"It holds no readings of {', '.join(lacking)}: these channels are left out of replay and trace."
    if a.samples.size and not a.temperature_degc.size:
        yield "It holds no temperature: effects of temperature can't be traced in it."
    if found.unknown:
        yield f"{plural(found.unknown, 'record')} of kinds that the format leaves to others were passed over."
    told = [event for event in a.events if event.name not in ("mark", "gap") and _worth_a_word(event.text)]
    for event in told[:SHOWN]:
        yield f"{log.at(event.stamp_ns)}: {event.text}"


def _worth_a_word(text: str) -> bool:
    # packets that were lost are a finding already
    return not text.startswith(("connected to", "recording to", "finished")) and not text.endswith("packets lost")


def _state(found: Scan) -> str:
    if found.held:
        return summary.WRITING
    if damage_text.lossy(found) or not (found.finished or found.cut):
        return summary.DAMAGED
    return summary.FINISHED if found.finished else summary.UNFINISHED


def _no_samples(path: Path, content: Audit) -> str:
    topics = ", ".join(content.types) or "none"
    return (
        f"{path} is an MCAP file without IMU samples: no channel of type sensor_msgs/msg/Imu (topics: {topics})."
        " Name a log, or import the recording with `imutui import`."
    )

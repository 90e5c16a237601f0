"""Whether a log is whole, and whether its parts agree: the file's bytes, its messages, its numbers and times.

A finding is something that a calibration should not rest on unseen; a note is worth a word and no more.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imutui.instrument.scaling import Scaling
from imutui.jobs import damage
from imutui.jobs.damage import plural
from imutui.logbook import effects, motions, reader, scan, schemas, summary
from imutui.logbook.audit import Audit, audit
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.scan import Scan

VERSION = 1
_SCANNED = 0.5
_LONG_GAP = 2.5
_RATE_OFF = 0.02
_STAMP_SLACK_NS = 20_000_000
_EARLIEST_NS = 946_684_800_000_000_000  # 2000: before that it is no UTC but some other clock
_LIMITS = (-32768, 32767)
_CHANNELS = ("gx", "gy", "gz", "ax", "ay", "az")
_EVERY_HZ = 133.0
_SHOWN = 10


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is not as it should be.

    Attributes
    ----------
    code : str
        Short name for programs.
    what, where, next : str
        Sentences: what it is, where in the log, what to do.
    """

    code: str
    what: str
    where: str
    next: str


def check(path: Path, progress: Callable[[float, str], None] = lambda share, text: None) -> dict[str, Any]:
    """Look a log through.

    Parameters
    ----------
    path : Path
        Any log, finished or not.
    progress : callable
        Told the share done, 0 to 1, and what is being done.

    Returns
    -------
    dict
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
    log = _Log(found, content)
    findings = [finding for rule in _RULES for finding in rule(log)]
    progress(1.0, "done")
    seconds = float(np.max(log.t)) if log.t.size else 0.0
    return {
        "version": VERSION,
        "log": str(path.resolve()),
        "state": _state(found),
        "fine": not findings,
        "findings": [asdict(finding) for finding in findings],
        "notes": list(_notes(log)),
        "bytes": found.size,
        "chunks": sum(piece.last_ns > 0 for piece in found.pieces),
        "messages": sum(heads.size for heads in content.messages.values()),
        "topics": {topic: int(heads.size) for topic, heads in content.messages.items()},
        "samples": int(content.samples.size),
        "packets": int(content.packets.size),
        "duration_s": seconds,
        "log_sha256": reader.sha256(path),
    }


class _Log:
    """What the rules look at.

    Attributes
    ----------
    found : Scan
        The file's bytes.
    audit : Audit
        Its messages.
    start_ns : int or None
        First sample, or first message where there is none.
    t : np.ndarray
        Samples' time since the first, s.
    """

    def __init__(self, found: Scan, content: Audit) -> None:
        self.found = found
        self.audit = content
        first = [heads["log_ns"][0] for heads in content.messages.values() if heads.size]
        stamps = content.samples
        self.start_ns: int | None = int(stamps[0]) if stamps.size else int(min(first)) if first else None
        self.t = reader.seconds_since(stamps, int(stamps[0])) if stamps.size else np.empty(0)
        raw = content.messages.get(schemas.RAW)
        self.raw = raw if raw is not None and raw.size == content.packets.size else None
        """Numbers and times of the packets; None where there are none, or not all of them can be read."""

    @property
    def name(self) -> str:
        """The file as commands name it."""
        return str(self.found.path)

    @property
    def polled(self) -> bool:
        """Whether every packet was asked for."""
        return self.audit.info is not None and self.audit.info.sampling == "polled"

    def at(self, ns: int, preposition: str = "at") -> str:
        """An instant in the log."""
        return "" if self.start_ns is None else f"{preposition} {(ns - self.start_ns) / 1e9:.3f} s"

    def recover(self) -> str:
        """What to do about a broken file."""
        return f"`imutui recover {self.name} -o FIXED.mcap` makes a whole file of what can be read."


# -- the file ----------------------------------------------------------------------------------------------------------


def _bytes(log: _Log) -> Iterator[Finding]:
    """Damage between the file's first byte and its last."""
    found = log.found
    costly = damage.lossy(found)
    for d in costly[:_SHOWN]:
        sentence = damage.sentence(d, log.start_ns)
        yield Finding(
            "damage", f"Part of the file cannot be read: {d.why}.", sentence.rsplit(": ", 1)[0], log.recover()
        )
    if len(costly) > _SHOWN:
        yield Finding(
            "damage", f"{len(costly) - _SHOWN} more parts cannot be read.", "all over the file", log.recover()
        )
    if found.checksum_wrong:
        yield Finding(
            "checksum",
            "The checksum over all data is wrong, though each chunk's is right: metadata was changed after recording.",
            "outside of the chunks",
            "Compare the session with your notes (`imutui info`), or go back to another copy.",
        )
    if found.repeated:
        yield Finding("repeated", f"{plural(found.repeated, 'chunk')} stand there twice.", "", log.recover())


def _ending(log: _Log) -> Iterator[Finding]:
    """How the file ends."""
    found = log.found
    if found.cut and not found.held:
        cut = next((d for d in found.damages if damage.at_end(found, d)), None)
        tail = "" if cut is None else f", and its last {plural(cut.bytes, 'byte')} are no whole record"
        yield Finding(
            "unfinished",
            f"The file ends without its index{tail}: the recorder was killed, or the file was cut.",
            f"at byte {found.size:,}",
            f"It can be used as it is; {log.recover()}",
        )
    elif not found.cut and not found.finished:
        yield Finding("end", "The file's end is damaged.", f"at byte {found.size - found.trailing:,}", log.recover())
    elif found.finished and (found.index is None or any(d.what == "summary" for d in found.damages)):
        yield Finding("index", "The index cannot be read, so viewers may refuse the file.", "at its end", log.recover())
    if found.trailing and found.finished:
        what = f"{plural(found.trailing, 'byte')} follow the end of the log."
        yield Finding("trailing", what, f"from byte {found.size - found.trailing:,} on", log.recover())


def _counts(log: _Log) -> Iterator[Finding]:
    """Whether all messages are there that the index and their numbers promise."""
    found, index = log.found, log.found.index
    if log.audit.homeless:
        what = f"{plural(log.audit.homeless, 'message')} belong to no topic: the list of topics is lost."
        yield Finding("homeless", what, "", log.recover())
    if index is not None and index.statistics is not None and not damage.lossy(found):
        told = index.statistics.message_count
        have = sum(heads.size for heads in log.audit.messages.values()) + log.audit.homeless
        if told != have:
            what = f"The index counts {plural(told, 'message')}, the file holds {have:,}."
            yield Finding("count", what, "", log.recover())
    if not log.audit.session:
        return
    yield from _numbers(log)


def _numbers(log: _Log) -> Iterator[Finding]:
    """The messages' own numbers, which imutui counts from 0 on each topic."""
    missing: dict[str, int] = {}
    first: list[int] = []
    for topic, heads in log.audit.messages.items():
        steps = np.diff(np.concatenate([[-1], heads["sequence"].astype(np.int64)]))
        if (steps < 1).any():
            what = f"{topic}: the messages' numbers go back or stand twice."
            yield Finding("sequence", what, f"first {log.at(int(heads['log_ns'][int(np.argmax(steps < 1))]))}", _TWICE)
        elif (steps > 1).any():
            missing[topic] = int(np.sum(steps - 1))
            first.append(int(heads["log_ns"][int(np.argmax(steps > 1))]))
    if missing:
        each = ", ".join(f"{n:,} of {topic}" for topic, n in missing.items())
        yield Finding(
            "sequence",
            f"Messages are missing by their numbers: {each}.",
            f"just {log.at(min(first), 'before')}",
            _LOST_IN_FILE,
        )


_LOST_IN_FILE = "They are gone; a replay predicts through the gap. Keep to the part before or after it if it matters."
_TWICE = "A replay refuses samples that stand twice. Go back to another copy of the file."


def _decoding(log: _Log) -> Iterator[Finding]:
    """Messages that are not what their topic says."""
    total = log.audit.undecodable_count
    if total:
        first = log.audit.undecodable[:1]
        where = f"{first[0][0]}, first {log.at(first[0][1])}: {first[0][2]}" if first else ""
        what = f"{plural(total, 'message')} cannot be decoded."
        yield Finding("undecodable", what, where, "A replay stops there. Write to whoever made the file.")


# -- what belongs to a log ---------------------------------------------------------------------------------------------


def _belongings(log: _Log) -> Iterator[Finding]:
    """Metadata and attachments."""
    a = log.audit
    if a.session_trouble:
        what = f"The session's metadata cannot be used: {a.session_trouble}."
        yield Finding("session", what, "metadata imutui.session", "Go back to another copy of the file.")
    if not a.session:
        if schemas.RAW in a.types:
            what = "The session's metadata is missing: signs, mounting and site are not known."
            yield Finding("session", what, "metadata imutui.session", "Go back to another copy of the file.")
        return
    if scan.CONFIGURATION not in a.attachments:
        yield Finding("attachment", "The configuration is missing.", f"attachment {scan.CONFIGURATION}", _NO_CURE)
    if log.found.finished and summary.SUMMARY not in a.attachments and scan.RECOVERED not in a.metadata:
        yield Finding("attachment", "The quality summary is missing.", f"attachment {summary.SUMMARY}", _NO_CURE)
    yield from _hashes(a)


_NO_CURE = "The samples are usable; what was set when they were recorded is only in your notes."


def _hashes(a: Audit) -> Iterator[Finding]:
    """Whether attached files are those that the session names."""
    held = a.attachments.get(effects.ATTACHMENT, effects.NONE)
    if a.session.get("effects_sha256", "") != effects.digest(held):
        what = "The effects file is not the one that the session names."
        where = f"attachment {effects.ATTACHMENT}"
        yield Finding("attachment", what, where, "Name the right one on replay: --effects FILE.")
    kind = a.session.get("reference", "")
    if kind in ("profile", "trajectory") and not any(name in a.attachments for name in motions.ATTACHMENTS):
        what = f'The reference is "{kind}", and the file that it comes from is missing.'
        yield Finding("reference", what, "attachment reference.toml or reference.csv", "Name it: --reference FILE.")


def _reference(log: _Log) -> Iterator[Finding]:
    """Whether the log says what is known of the motion."""
    # a recorder writes it once a second; a shorter log has none
    expected = bool(log.audit.session) and log.t.size and log.t[-1] > 2.0
    if expected and not len(log.audit.messages.get(schemas.REFERENCE, ())):
        what = "Nothing in the log says how the table stood."
        yield Finding("reference", what, f"topic {schemas.REFERENCE}", "Say it on replay: --reference level.")


# -- time --------------------------------------------------------------------------------------------------------------


def _times(log: _Log) -> Iterator[Finding]:
    """Rules of time that a log is written by: UTC, never backwards, no jump against the monotonic clock."""
    for topic, heads in log.audit.messages.items():
        stamps = heads["log_ns"]
        if stamps[0] < _EARLIEST_NS:
            what = f"{topic}: the log time is not UTC: it begins before the year 2000."
            yield Finding("log_time", what, "from the first message on", _CLOCK)
        back = np.flatnonzero(np.diff(stamps) < 0)
        if back.size:
            what = f"{topic}: log time goes back in {plural(int(back.size), 'place')}."
            yield Finding("log_time", what, f"first {log.at(int(stamps[back[0]]))}", _CLOCK)
    yield from _sample_times(log)
    if log.raw is not None and log.raw.size:
        offset = log.raw["log_ns"] - log.audit.packets["host_monotonic_ns"]
        steps = np.flatnonzero(np.diff(offset))
        if steps.size and log.audit.session:
            k = int(steps[0])
            what = f"Log time jumps by {(offset[k + 1] - offset[k]) / 1e9:+.6f} s against the monotonic clock."
            yield Finding("log_time", what, log.at(int(log.raw["log_ns"][k + 1])), _CLOCK)


_CLOCK = "The times are not to be trusted there; replay a part without it (--start, --end)."


def _sample_times(log: _Log) -> Iterator[Finding]:
    """Stamps of the samples: in order, finite, and those of their messages."""
    a = log.audit
    back = np.flatnonzero(np.diff(a.samples) <= 0)
    if back.size:
        what = f"Sample time does not increase in {plural(int(back.size), 'place')}; a replay refuses the log."
        yield Finding("stamps", what, f"first {log.at(int(a.samples[back[0]]))}", log.recover())
    bad = np.flatnonzero(~(np.isfinite(a.gyro).all(axis=1) & np.isfinite(a.accel).all(axis=1)))
    if bad.size:
        what = f"{plural(int(bad.size), 'sample')} are not numbers; a replay refuses the log."
        where = f"first {log.at(int(a.samples[bad[0]]))}"
        yield Finding("stamps", what, where, "Remove them in the program that wrote the file.")
    heads = a.messages.get(a.imu_topic or "")
    if heads is None or not a.session or heads.size != a.samples.size:
        return
    if (heads["publish_ns"] != a.samples).any():
        k = int(np.argmax(heads["publish_ns"] != a.samples))
        what = "A sample's stamp is not its message's publish time."
        yield Finding("stamps", what, f"first {log.at(int(a.samples[k]))}", _CLOCK)
    early = heads["publish_ns"] - heads["log_ns"] > _STAMP_SLACK_NS
    if early.any():
        what = f"{plural(int(early.sum()), 'sample')} are stamped later than they arrived."
        yield Finding("stamps", what, f"first {log.at(int(a.samples[int(np.argmax(early))]))}", _CLOCK)


def _gaps(log: _Log) -> Iterator[Finding]:
    """Gaps between samples, and the rate."""
    if log.t.size < 3:
        return
    steps = np.diff(log.t)
    info = log.audit.info
    period = 1.0 / info.rate_hz if info is not None else float(np.median(steps))
    long = np.flatnonzero(steps > _LONG_GAP * period)
    # bursts of a host's stamps are no gaps in the samples
    if (long.size and long.size <= max(1.0, 0.001 * steps.size)) or (
        long.size and info is not None and log.raw is not None
    ):
        longest = int(long[np.argmax(steps[long])])
        what = f"{plural(int(long.size), 'gap')} between samples, the longest {steps[longest]:.3f} s."
        where = f"first at {log.t[long[0]]:.3f} s, longest at {log.t[longest]:.3f} s"
        yield Finding("gaps", what, where, "The filter predicts through gaps; trace leaves them out. Check the cable.")
    if info is None or info.sampling == "imported":
        return
    measured = (log.t.size - 1) / log.t[-1]
    if not long.size and abs(measured / min(info.rate_hz, 400.0 / 3.0) - 1.0) > _RATE_OFF:
        what = f"{info.rate_hz:g} Hz were asked for, {measured:.3f} Hz came."
        yield Finding("rate", what, "over the whole log", "Ask for a rate that the unit and its line speed can give.")


# -- the unit ----------------------------------------------------------------------------------------------------------


def _line(log: _Log) -> Iterator[Finding]:
    """What was lost on the line, by the recorder's count and by the packets themselves."""
    told = {key: _integer(log.audit.diagnostics.get(key)) for key in ("lost_packets", "bad_checksums")}
    lost, where = _lost_packets(log)
    counted = told["lost_packets"]
    if lost or counted:
        much = plural(max(lost, counted), "packet")
        what = f"{much} were lost on the line."
        if log.raw is not None and lost != counted and not damage.lossy(log.found):
            what = (
                f"{counted:,} packets were lost by the recorder's count, {lost:,} by the times of those that are there."
            )
        yield Finding("lost", what, where, _CABLE)
    if told["bad_checksums"]:
        what = f"{plural(told['bad_checksums'], 'packet')} came with a wrong checksum and were dropped."
        yield Finding("checksums", what, "by the recorder's count", _CABLE)


_CABLE = "Check the cable, the ground and the line speed; replay and trace take what is there."


def _lost_packets(log: _Log) -> tuple[int, str]:
    """Packets missing between those of a stream by the times of those that are there, and where first."""
    if log.raw is None or log.raw.size < 3 or log.polled:
        return 0, "by the recorder's count"
    steps = np.diff(log.raw["publish_ns"].astype(np.float64))
    period = float(np.median(steps))
    # what the file itself lost is told by the messages' numbers
    inside = np.diff(log.raw["sequence"].astype(np.int64)) == 1
    flagged = (log.audit.packets["flags"][1:] & schemas.FLAG_LOST_BEFORE) > 0
    missing = np.where(inside & (flagged | (steps > 1.5 * period)), np.rint(steps / period) - 1.0, 0.0)
    places = np.flatnonzero(missing > 0)
    if not places.size:
        return 0, "by the recorder's count"
    first = log.at(int(log.raw["publish_ns"][places[0]]))
    return int(missing.sum()), f"in {plural(int(places.size), 'place')}, first {first}"


def _counter(log: _Log) -> Iterator[Finding]:
    """Whether the unit's time counter goes on evenly, and the packets' own numbers."""
    p = log.audit.packets
    if log.raw is None or p.size < 3 or log.polled:
        return
    steps = np.diff(log.raw["publish_ns"].astype(np.float64))
    ticks = np.mod(-np.diff(p["ticks"].astype(np.int64)), 65536)
    contiguous = (np.diff(log.raw["sequence"].astype(np.int64)) == 1) & (steps < 1.5 * np.median(steps))
    contiguous &= (p["flags"][1:] & (schemas.FLAG_LOST_BEFORE | schemas.FLAG_HOST_STAMP)) == 0
    if contiguous.sum() < 3:
        return
    usual = float(np.median(ticks[contiguous]))
    off = np.flatnonzero(contiguous & (np.abs(ticks - usual) > 0.25 * usual))
    if off.size:
        what = f"The unit's time counter jumps in {plural(int(off.size), 'place')} without a packet missing."
        where = f"first {log.at(int(log.raw['publish_ns'][off[0] + 1]))}"
        yield Finding("counter", what, where, "Check the unit's supply: it may have begun anew.")


def _samples_of_packets(log: _Log) -> Iterator[Finding]:
    """Whether each sample is what its packets say: how many, when, which values."""
    a, info = log.audit, log.audit.info
    if log.raw is None or info is None or info.sampling not in ("stream", "polled") or not log.raw.size:
        return
    if (np.diff(log.raw["sequence"].astype(np.int64)) != 1).any() or int(log.raw["sequence"][0]) != 0:
        return  # a group that lost a packet in the file can't be made again
    stamps, counts = _grouped(log, each=log.polled or info.rate_hz >= _EVERY_HZ)
    n = min(stamps.size, a.samples.size)
    if abs(stamps.size - a.samples.size) > (1 if log.found.cut else 0):
        what = f"The packets make {plural(int(stamps.size), 'sample')}, the log has {a.samples.size:,}."
        yield Finding("samples", what, "over the whole log", log.recover())
    axes, scaling = info.axes(), Scaling(info.rate_range_dps, info.accel_range_g)
    gyro = axes.gyro_to_body(np.deg2rad(scaling.rates_dps(counts[:n, :3])))
    accel = axes.accel_to_body(scaling.accels_g(counts[:n, 3:]) * info.g_unit)
    same = stamps[:n] == a.samples[:n]
    same &= np.isclose(gyro, a.gyro[:n], rtol=1e-9, atol=1e-9).all(axis=1)
    same &= np.isclose(accel, a.accel[:n], rtol=1e-9, atol=1e-9).all(axis=1)
    if not same.all():
        k = int(np.argmin(same))
        what = f"{plural(int(n - same.sum()), 'sample')} are not what their packets say."
        yield Finding("samples", what, f"first {log.at(int(a.samples[k]))}", "Trust the packets; write to us.")


def _grouped(log: _Log, *, each: bool) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (ns) and mean counts of the samples that the packets make, as the recorder groups them."""
    assert log.raw is not None
    assert log.audit.info is not None
    stamps, counts = log.raw["publish_ns"], log.audit.packets["counts"].astype(np.float64)
    if each:
        return stamps, counts
    since = stamps - stamps[0]
    number = np.maximum.accumulate((since / (1e9 / log.audit.info.rate_hz)).astype(np.int64))
    edges = np.flatnonzero(np.diff(number, prepend=-1))
    sizes = np.diff(np.append(edges, number.size))
    first = stamps[edges]
    late = np.add.reduceat(stamps - np.repeat(first, sizes), edges)
    mean = np.add.reduceat(counts, edges, axis=0) / sizes[:, None]
    # the last period's sample would have come with the first packet after it
    return (first + np.rint(late / sizes).astype(np.int64))[:-1], mean[:-1]


def _limits(log: _Log) -> Iterator[Finding]:
    """Readings that stand at the end of their range."""
    counts = log.audit.packets["counts"]
    at_limit = np.isin(counts, _LIMITS)
    if at_limit.any():
        rows = np.flatnonzero(at_limit.any(axis=1))
        channels = [name for name, hit in zip(_CHANNELS, np.any(at_limit, axis=0).tolist(), strict=True) if hit]
        what = f"{plural(int(rows.size), 'packet')} have a count at its limit ({' '.join(channels)})."
        first = log.at(int(log.raw["publish_ns"][rows[0]])) if log.raw is not None else ""
        yield Finding("limits", what, f"first {first}", "The filter leaves them out. Turn the table more slowly there.")
    elif not log.audit.valid.all():
        rows = np.flatnonzero(~log.audit.valid)
        what = f"{plural(int(rows.size), 'sample')} are flagged as no reading."
        yield Finding("limits", what, f"first at {log.t[rows[0]]:.3f} s", "The filter leaves them out.")


_RULES: tuple[Callable[[_Log], Iterator[Finding]], ...] = (
    _bytes,
    _ending,
    _counts,
    _decoding,
    _belongings,
    _reference,
    _times,
    _gaps,
    _line,
    _counter,
    _samples_of_packets,
    _limits,
)


# -- notes -------------------------------------------------------------------------------------------------------------


def _notes(log: _Log) -> Iterator[str]:
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
    if scan.RECOVERED in a.metadata:
        yield f"It was rebuilt by `imutui recover`; lost then: {a.metadata[scan.RECOVERED].get('lost', 'not said')}"
    if not a.samples.size:
        yield "It holds no samples."
    elif not a.temperature_degc.size:
        yield "It holds no temperature: effects of temperature can't be traced in it."
    if found.unknown:
        yield f"{plural(found.unknown, 'record')} of kinds that the format leaves to others were passed over."
    told = [event for event in a.events if event.name != "mark" and _worth_a_word(event.text)]
    for event in told[:_SHOWN]:
        yield f"{log.at(event.stamp_ns)}: {event.text}"


def _worth_a_word(text: str) -> bool:
    return not text.startswith(("connected to", "recording to", "finished"))


def _state(found: Scan) -> str:
    if found.held:
        return summary.WRITING
    if damage.lossy(found) or not (found.finished or found.cut):
        return summary.DAMAGED
    return summary.FINISHED if found.finished else summary.UNFINISHED


def _no_samples(path: Path, content: Audit) -> str:
    topics = ", ".join(content.types) or "none"
    return (
        f"{path} is an MCAP file without IMU samples: no channel of type sensor_msgs/msg/Imu (topics: {topics})."
        " Name a log, or import the recording with `imutui import`."
    )


def _integer(text: str | None) -> int:
    try:
        return int(text) if text else 0
    except ValueError:
        return 0

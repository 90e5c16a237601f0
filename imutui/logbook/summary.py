"""What a log says of itself in its first and last few kilobytes, read in about a millisecond.

A finished file has a summary with every count. Of an unfinished one the beginning and the last whole chunk are read:
our samples are numbered, so their number and time are exact; what lies between is taken on trust (`check` looks).
"""

import contextlib
import itertools
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Literal

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Message, Metadata, Statistics

from imutui import outside_file
from imutui.declared import problem
from imutui.logbook import file_lock, layout, mcap_format, schemas
from imutui.logbook.mcap_format import HEAD, MAGIC, MALFORMED, parse
from imutui.logbook.mcap_stream import Messages
from imutui.logbook.session_info import METADATA
from imutui.logbook.walk import CUT, ChunkHead, Damage, End, Item, within

FINISHED = "finished"
UNFINISHED = "unfinished"
DAMAGED = "damaged"
WRITING = "being written"
NO_LOG = "not a log"

CONFIGURATION, SUMMARY = "configuration.toml", "summary.json"
"""Names under which the effective configuration and the quality summary travel in a log."""
_END = 2 * 2**20  # bytes at either end that are looked at
_LARGEST = 16 * 2**20
_FIRST_ITEMS = 512
_MOST = 96 * 2**20
_ZSTD = mcap_format.prefixed("zstd")


@dataclass(slots=True)
class Summary:
    """What the ends of a file tell."""

    path: Path
    # bytes, modified: its size, and when it was last written to, Unix time, s
    bytes: int = 0
    modified: float = 0.0
    # state, why: one of this module's five words, and the reason where it is not finished
    state: str = NO_LOG
    why: str = ""
    # metadata record `imutui.session`; empty in another program's file
    session: dict[str, str] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)  # type of each topic
    counts: dict[str, int] = field(default_factory=dict)  # messages on each topic; empty if the file has no summary
    samples: int | None = None  # output samples; None if the ends don't tell
    # started_ns, seconds: when the first one was taken, UTC, ns, and the time from it to the last
    started_ns: int | None = None
    seconds: float | None = None
    # the quality summary that was attached on closing; empty if there is none
    result: dict[str, object] = field(default_factory=dict)
    attachments: dict[str, int] = field(default_factory=dict)  # name to size in bytes
    by_ends: bool = False  # whether samples and seconds come from the first and the last chunk instead of a summary


def read(path: Path) -> Summary:
    """Look at a file's ends.

    `path`: any file: what is no log is said to be none.
    Raises OSError if it cannot be opened.
    """
    with outside_file.opened(path) as stream:
        status = path.stat()
        found = Summary(path, status.st_size, status.st_mtime)
        if status.st_size == 0 or not stream.read(len(MAGIC)).startswith(MAGIC):
            found.why = "the file is empty" if status.st_size == 0 else "it does not begin as an MCAP file does"
            return found
        try:
            whole = _from_summary(stream, found)
        except MALFORMED:
            found.state, found.why, whole = DAMAGED, "its summary cannot be read", False
        if not whole:
            _from_ends(stream, found)
            stream.seek(max(len(MAGIC), found.bytes - len(MAGIC)))
            if found.state == UNFINISHED and stream.read() == MAGIC:
                found.state, found.why = FINISHED, ""
        if file_lock.is_held(stream):
            found.state, found.why = WRITING, "a recorder has it open"
    # a file of another kind is none of ours, however whole
    if found.types and imu_topic(found.types) is None:
        found.state, found.why = NO_LOG, "it has no samples of type sensor_msgs/msg/Imu"
    elif found.state == FINISHED and found.samples == 0:
        found.why = "it holds no samples"
    return found


def imu_topic(types: dict[str, str]) -> str | None:
    """Return the topic of the samples: ours, else the first of sensor_msgs/msg/Imu."""
    wanted = schemas.TYPES[schemas.IMU]
    topics = [topic for topic, name in types.items() if name in (wanted, wanted.replace("/msg/", "/"))]
    return schemas.IMU if schemas.IMU in topics else next(iter(topics), None)


# -- a finished file ---------------------------------------------------------------------------------------------------


def _from_summary(stream: IO[bytes], found: Summary) -> bool:
    """Take what the summary section says; False if the file has none."""
    index = mcap_format.read_index(stream, found.bytes, chunks=False)
    if index is None:
        return False
    for metadata in index.metadata:
        if metadata.name == METADATA and HEAD.size <= metadata.length <= _LARGEST and metadata.offset <= found.bytes:
            stream.seek(metadata.offset + HEAD.size)
            found.session = parse(Metadata, stream.read(metadata.length - HEAD.size)).metadata
    for attachment in index.attachments:
        found.attachments[attachment.name] = attachment.data_size
        at = attachment.offset + attachment.length - 4 - attachment.data_size
        if attachment.name == SUMMARY and attachment.data_size <= _LARGEST and 0 <= at <= found.bytes:
            stream.seek(at)
            found.result = quality(stream.read(attachment.data_size))
    found.types = index.types
    if index.statistics is not None:
        _take_statistics(index.statistics, index.channels, found)
    found.state = FINISHED
    return True


def _take_statistics(statistics: Statistics, channels: dict[int, Channel], found: Summary) -> None:
    counts = statistics.channel_message_counts
    found.counts = {channel.topic: counts.get(number, 0) for number, channel in channels.items()}
    topic = imu_topic(found.types)
    found.samples = found.counts.get(topic, 0) if topic is not None else None
    if statistics.message_count:
        found.started_ns = statistics.message_start_time
        found.seconds = (statistics.message_end_time - statistics.message_start_time) / 1e9
    # of the samples alone, where it was counted
    counted = found.result.get("duration_s")
    if isinstance(counted, int | float) and found.samples:
        found.seconds = float(counted)


# -- any other file ----------------------------------------------------------------------------------------------------


def _from_ends(stream: IO[bytes], found: Summary) -> None:
    """Take what the beginning and the last whole chunk say, and how the file ends."""
    messages, inflater = Messages(), mcap_format.Inflater(found.bytes, _MOST)
    for most in (_END, _LARGEST):  # before the samples may be long attachments
        stream.seek(0)
        if (first := _beginning(stream.read(most), found, messages, inflater)) or found.bytes <= most:
            break
    stream.seek(max(0, found.bytes - _END))
    last, how = _ending(stream.read(), found, messages, inflater)
    found.by_ends = True
    if found.state != DAMAGED:
        found.state = DAMAGED if how else UNFINISHED
        found.why = how or "it ends without its index: the recorder was killed, or the file was cut"
    if first is not None:
        found.started_ns = first.publish_time
    if first is not None and last is not None:
        found.seconds = (last.publish_time - first.publish_time) / 1e9
        # other programs may leave the numbers out
        found.samples = last.sequence - first.sequence + 1 if last.sequence or last == first else None


def _beginning(head: bytes, found: Summary, messages: Messages, inflater: mcap_format.Inflater) -> Message | None:
    """Take metadata, attachments and channels before the first chunk with samples; return the first sample."""
    for item in itertools.islice(within(head, inflater), _FIRST_ITEMS):
        first = next(messages.of(item, imu_topic(found.types) or ""), None)
        match item:
            case Metadata() if item.name == METADATA:
                found.session = item.metadata
            case Attachment():
                found.attachments[item.name] = len(item.data)
            case Channel():
                found.types = {channel.topic: schema.name for channel, schema in messages.channels.values()}
        if first is not None:
            return first
    return None


def _ending(
    tail: bytes, found: Summary, messages: Messages, inflater: mcap_format.Inflater
) -> tuple[Message | None, str]:
    """Return the last sample of the last whole chunk that has one, and what is wrong behind it, if anything."""
    how, described, mark = "", False, len(tail)
    while (mark := tail.rfind(_ZSTD, 0, mark)) > mcap_format.COMPRESSION_OFFSET:
        at = mark - mcap_format.COMPRESSION_OFFSET
        items = _chunk_at(tail, at, inflater) if tail[at] == Opcode.CHUNK else []
        for item in items:
            if isinstance(item, Damage) and not item.why.startswith(CUT):
                chunk = "a chunk near its end cannot be read"
                how = how or (chunk if item.what == "chunk" else "bytes that are no record follow its last chunk")
            elif isinstance(item, End) and item.trailing:
                how = how or "bytes that do not belong there follow its end"
        described = described or _take_description(items, messages, found)
        topic = imu_topic(found.types) or ""
        if samples := [message for item in items for message in messages.of(item, topic)]:
            return samples[-1], how
    return None, how


def _chunk_at(tail: bytes, at: int, inflater: mcap_format.Inflater) -> list[Item]:
    """Return the items of the chunk that may begin at an offset, and those behind it before the next chunk."""
    items = within(tail, inflater, at)
    return [next(items), *itertools.takewhile(lambda item: not isinstance(item, ChunkHead), items)]


def _take_description(items: list[Item], messages: Messages, found: Summary) -> bool:
    """Take note and operator as they are now, where they were changed since the file was begun; whether they were."""
    told: dict[str, str] = {}
    for message in (message for item in items for message in messages.of(item, schemas.DIAGNOSTICS)):
        with contextlib.suppress(layout.UndecodableError):
            told |= schemas.decode_diagnostics(message.data) or {}
    found.session |= {key: told[key] for key in schemas.DESCRIPTION if found.session and key in told}
    return bool(told)


# -- the quality summary that a recorder attaches on closing, as anybody may have written it ---------------------------


def quality(content: bytes) -> dict[str, object]:
    """Figures of a summary's JSON: those that are what their names promise, numbers that are none as None.

    `content`: of the attachment.
    Returns empty if it is no JSON object.
    """
    if len(content) > _LARGEST:
        return {}
    try:
        document = json.loads(content, parse_float=_finite, parse_int=_whole, parse_constant=lambda name: None)
    except (ValueError, RecursionError):
        return {}
    if not isinstance(document, dict):
        return {}
    told = {key: document[key] for key in _SHAPES if key in document}
    return {key: value for key, value in told.items() if not problem(value, _SHAPES[key], key)}


def _finite(text: str) -> float | None:
    value = float(text)
    return value if math.isfinite(value) else None


def _whole(text: str) -> int | None:
    # longer than any count, and than what other programs read
    return int(text) if len(text) < 20 else None


_Figure = str | bool | float | None | list[float | None]
_SHAPES: dict[str, Any] = {
    "verdict": Literal["GREEN", "AMBER", "RED", "OFF"],
    "samples": int,
    "duration_s": float,
    "lost_packets": int,
    "bad_checksums": int,
    "converged": bool,
    "converged_s": dict[str, _Figure],
    "final": dict[str, _Figure],
    "sd": dict[str, _Figure],
    "nis": dict[str, _Figure],
    "gaps": list[dict[str, _Figure]],
    "alarms": list[str],
}

"""Messages of any one topic as a table: a row a message, nested fields and short arrays as columns of their own."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from mcap.records import Channel, Message, Schema

from filters.errors import InputError
from imutui.logbook import reader, schemas
from imutui.logbook.export.formats import Block, Column, Table
from imutui.logbook.mcap_stream import CHANNEL, Batch
from imutui.logbook.reader import Log, UnreadableLogError
from imutui.plain_text import in_line

_ROWS = 2**14
_MOST_ELEMENTS = 256
_LOG_TIME, _PUBLISH_TIME = Column("log_time", "ns", dtype="u8"), Column("publish_time", "ns", dtype="u8")
Row: TypeAlias = dict[str, Any]
Decode: TypeAlias = Callable[[bytes], Any]

# the ends of our fields' names say their units; of ROS's messages the definitions do
_UNITS = {
    "deg_m": "deg, deg, m", "mps": "m/s", "dps": "deg/s", "deg": "deg", "mg": "mg", "m": "m", "ns": "ns",
    "counts": "counts", "ticks": "ticks", "angular_velocity": "rad/s", "linear_acceleration": "m/s^2",
}  # fmt: skip
_OF_TEMPERATURE = {"temperature": "degC", "variance": "degC^2"}


@dataclass(frozen=True, slots=True)
class _Topic:
    """Where a topic's messages are, how one becomes an object, and the log, whose damage is told there."""

    path: Path
    topic: str
    typename: str
    decode: Decode
    log: Log


def table(path: Path, topic: str, start: float | None = None, end: float | None = None) -> Table:
    """Messages of a topic.

    `path`: an MCAP file, ours or another program's.
    `topic`: its topic, of a ROS 2 type in CDR.
    `start`, `end`: part to take, s since the file's first message by its log_time.
    Raises UnreadableLogError if the file cannot be read, or the topic is not in it, has no message, or is not in CDR.
    """
    found = _find(path, topic)
    columns = _outline(found)
    names = {column.name: column for column in columns}
    log_begin = _first_message(path)
    window = (
        0 if start is None else log_begin + round(start * 1e9),
        np.iinfo(np.int64).max if end is None else log_begin + round(end * 1e9),
    )
    about = {"log": path.name, "topic": topic, "type": found.typename}
    return Table(
        (_LOG_TIME, _PUBLISH_TIME, *columns), partial(_blocks, found, names, window), about, lambda: found.log.damage
    )


def topics(path: Path) -> list[str]:
    """Topics that a file declares, in the order of their names."""
    return sorted({record.topic for record in _records(path) if isinstance(record, Channel)})


def _records(path: Path, log: Log | None = None) -> Iterator[Any]:
    return iter(reader.records(path, log or Log(path)))


def _find(path: Path, topic: str) -> _Topic:
    known: dict[int, Schema] = {}
    seen: set[str] = set()
    for record in _records(path):
        if isinstance(record, Schema):
            known[record.id] = record
        elif isinstance(record, Channel):
            seen.add(record.topic)
            if record.topic == topic:
                return _typed(path, record, known.get(record.schema_id))
    listed = ", ".join(sorted(seen)) or "none"
    raise InputError(f"{path} has no topic {topic}. It has: {listed}.")


def _typed(path: Path, channel: Channel, schema: Schema | None) -> _Topic:
    if schema is None or channel.message_encoding != "cdr" or schema.encoding != "ros2msg":
        told = f"{channel.message_encoding or 'nothing'} with schema {schema.encoding if schema else 'none'}"
        raise UnreadableLogError(
            f"{path}: {channel.topic} is encoded as {told}; only ROS 2 messages (cdr, ros2msg) are exported."
        )
    if schemas.is_own(channel.topic, schema.name):
        return _Topic(path, channel.topic, schema.name, partial(schemas.decode, schema.name), Log(path))
    try:
        decode = schemas.decoder_of(schema.name, schema.data.decode("utf-8", "replace"))
    except schemas.UndecodableError as error:
        raise UnreadableLogError(
            f"{path}: {in_line(str(error))}, so {channel.topic} cannot be exported. `imutui info` lists other topics."
        ) from error
    return _Topic(path, channel.topic, schema.name, decode, Log(path))


def _messages(found: _Topic) -> Iterator[Message]:
    ids: set[int] = set()
    for record in _records(found.path, found.log):
        if isinstance(record, Channel) and record.topic == found.topic:
            ids.add(record.id)
        elif isinstance(record, Batch):
            for row in np.flatnonzero(np.isin(record.table[:, CHANNEL], list(ids))).tolist():
                yield record.message(row)


def _first_message(path: Path) -> int:
    for record in _records(path):
        if isinstance(record, Batch) and len(record.table):
            return int(record.message(0).log_time)
    raise UnreadableLogError(f"{path} has no messages.")


def _outline(found: _Topic) -> list[Column]:
    """Columns of all messages; of a type whose messages all have the same fields the first one tells them."""
    columns: dict[str, Column] = {}
    for message in _messages(found):
        for name, value in _flat(_decoded(found, message)).items():
            columns.setdefault(name, _column(found, name, value))
        if not _grows(found.typename):
            break
    if not columns:
        raise UnreadableLogError(f"{found.path} has no message of {found.topic}.")
    return list(columns.values())


def _grows(typename: str) -> bool:
    """Whether messages of a type may have more fields than the first one: all but those known to be of fixed size."""
    fixed = (schemas.TYPES[topic] for topic in (schemas.RAW, schemas.IMU, schemas.ESTIMATE))
    return typename not in (*fixed, schemas.S1_PACKET)


def _column(found: _Topic, name: str, value: Any) -> Column:
    kind = {bool: "?", np.bool_: "?", str: "U"}.get(type(value)) or ("f8" if isinstance(value, float) else "i8")
    if isinstance(value, int) and value > np.iinfo(np.int64).max:
        kind = "u8"
    return Column(name, _unit(found, name), dtype=kind)


def _unit(found: _Topic, name: str) -> str:
    stem = re.sub(r"_\d+$", "", name)
    if found.typename == schemas.TYPES[schemas.TEMPERATURE]:
        return _OF_TEMPERATURE.get(stem, "ns" if stem == "stamp_ns" else "")
    if "covariance" in stem:
        return ""
    if found.topic == schemas.RAW and "temperature" in stem:
        return "counts"
    if "deg_m" in stem:
        return ("deg", "deg", "m")[int(name[-1])]
    stem = stem.removesuffix("_x").removesuffix("_y").removesuffix("_z")
    if stem in _UNITS:
        return _UNITS[stem]
    return next((unit for ending, unit in _UNITS.items() if stem.endswith(f"_{ending}")), "")


def _decoded(found: _Topic, message: Message) -> Any:
    try:
        return found.decode(message.data)
    except schemas.UndecodableError as error:
        raise UnreadableLogError(
            f"{found.path}: a message of {found.topic} at log_time {message.log_time} cannot be decoded ({error})."
            " `imutui check` looks at the file; `imutui recover` keeps what is whole."
        ) from error


def _flat(message: Any, prefix: str = "") -> Row:
    """Fields of a message by name; a header's stamp in ns, lists of key and value by their keys."""
    row: Row = {}
    for each in fields(message):
        if not each.name.startswith("__"):
            row |= _field(f"{prefix}{each.name}", getattr(message, each.name))
    return row


def _field(name: str, value: Any) -> Row:
    if is_dataclass(value):
        if hasattr(value, "sec") and hasattr(value, "nanosec"):
            return {f"{name}_ns": int(value.sec) * 1_000_000_000 + int(value.nanosec)}
        return _flat(value, "" if name == "header" else f"{name}_")
    if isinstance(value, np.ndarray):
        value = value[:_MOST_ELEMENTS].tolist()
    if isinstance(value, (list, tuple)):
        if value and all(is_dataclass(item) and hasattr(item, "key") and hasattr(item, "value") for item in value):
            return {str(item.key): str(item.value) for item in value}
        row: Row = {}
        for i, item in enumerate(value[:_MOST_ELEMENTS]):
            row |= _field(f"{name}_{i}", item)
        return row
    return {name: value}


def _blocks(found: _Topic, columns: dict[str, Column], window: tuple[int, int]) -> Iterator[Block]:
    messages: list[Message] = []
    for message in _messages(found):
        if window[0] <= message.log_time <= window[1]:
            messages.append(message)
        if len(messages) >= _ROWS:
            yield _block(found, columns, messages)
            messages = []
    if messages:
        yield _block(found, columns, messages)


def _block(found: _Topic, columns: dict[str, Column], messages: list[Message]) -> Block:
    rows = [_flat(_decoded(found, message)) for message in messages]
    block = {
        _LOG_TIME.name: np.array([message.log_time for message in messages], np.uint64),
        _PUBLISH_TIME.name: np.array([message.publish_time for message in messages], np.uint64),
    }
    for name, column in columns.items():
        block[name] = _cells([row.get(name) for row in rows], column)
    return block


def _cells(values: list[Any], column: Column) -> np.ndarray:
    """A column's cells; what a message lacks is NaN, "" or 0."""
    if column.dtype == "U":
        return np.array(["" if value is None else str(value) for value in values])
    absent = np.nan if column.dtype == "f8" else 0
    return np.array([absent if value is None else value for value in values], np.dtype(column.dtype))

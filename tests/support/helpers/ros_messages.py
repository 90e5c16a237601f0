"""Messages as rosbags decodes and encodes them: an oracle beside the layouts of the product."""

from collections import namedtuple
from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from imutui.logbook import layout, message_definitions, schemas
from imutui.logbook.reader import Log


@cache
def typestore() -> Any:
    """Return a store of the types that logs have."""
    store = get_typestore(Stores.EMPTY)
    types: dict[str, Any] = {}
    for name, text in (message_definitions.ROS | message_definitions.OWN).items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    return store


def decode(typename: str, data: bytes) -> Any:
    """Return a message as an object."""
    return typestore().deserialize_cdr(data, typename)


def encode(typename: str, message: Any) -> bytes:
    """Return the CDR bytes of an object."""
    return bytes(typestore().serialize_cdr(message, typename))


def stamp_ns(header: Any) -> int:
    """Return the time of a std_msgs/Header, ns."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


Packet = namedtuple("Packet", schemas.RAW_DTYPE.names)  # type: ignore[misc]


def packets(log: Log) -> list[Any]:
    """Return the packets of a log, as records of plain integers and tuples of them."""
    columns = [log.packets[name].tolist() for name in Packet._fields]
    return [Packet(*(tuple(x) if isinstance(x, list) else x for x in row)) for row in zip(*columns, strict=True)]


Details = tuple[tuple[int, int, int], int, int]
"""Temperatures of the rate sensors, of the board, and the status word of an S1Packet."""


def packet(
    sequence: int,
    host_ns: int,
    counts: tuple[int, ...],
    temperature: int,
    ticks: int,
    mode: int = 0,
    flags: int = 0,
    details: Details | None = None,
) -> bytes:
    """Return the CDR bytes of a packet."""
    row = (sequence, host_ns, counts, temperature, ticks, mode, flags, *(details or ((0, 0, 0), 0, 0)))
    (data,) = schemas.encode_raws(np.array([row], schemas.RAW_DTYPE), details=details is not None)
    return data


def texts(typename: str, data: bytes, *names: str) -> list[str]:
    """Return strings of a message, by their paths."""
    found = layout.decode(typename, data)
    return [layout.text(found, name) for name in names]

"""CDR messages as records of numpy: the layout follows from the ROS 2 definition, so that it is written once.

Plain CDR, as ROS 2 writes it: an encapsulation of four bytes, then the fields in order, each number aligned to its own
size counted from behind the encapsulation. Nested messages stand inline. A string is its length with its NUL, then its
bytes; a sequence is its length, then its elements. Lengths are all that a layout depends on beside the definition.
"""

import re
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np

from imutui.logbook import message_definitions

_DEFINITIONS = message_definitions.ROS | message_definitions.OWN
_PLAIN = {
    "float64": "f8", "float32": "f4", "int64": "i8", "uint64": "u8", "int32": "i4", "uint32": "u4", "int16": "i2",
    "uint16": "u2", "int8": "i1", "uint8": "u1", "byte": "u1", "bool": "?",
}  # fmt: skip
_ENCAPSULATION = 4  # bytes
_LITTLE_ENDIAN = b"\0\1\0\0"
_PADDING = 3  # most bytes that a writer may add behind the last field
SIZE = ".size"
"""Suffix of the field that has a string's or a sequence's length."""

Values = dict[str, Any]
"""Members of a message by name: numbers, texts, `Values` of a nested message, lists of them."""


class UndecodableError(Exception):
    """Bytes are not a message of the type that their topic has."""


@cache
def _members(typename: str) -> tuple[tuple[str, str, int | None], ...]:
    """Type, name and count of each member of a message type: 1, the length of an array, or None for a sequence."""
    found = []
    for line in _DEFINITIONS[typename].splitlines():
        statement = line.partition("#")[0].strip()
        if not statement or "=" in statement:  # a constant takes no place
            continue
        kind, name = statement.split()
        match = re.fullmatch(r"([\w/]+)\[(\d*)\]", kind)
        count = 1 if match is None else int(match[2]) if match[2] else None
        kind = kind if match is None else match[1]
        package, _, own = kind.rpartition("/")
        found.append((kind if kind in _PLAIN or kind == "string" else f"{package}/msg/{own}", name, count))
    return tuple(found)


class _Fields:
    """Names, types and offsets of a layout's fields, put one behind the other.

    `length`: returns the length of the string or sequence of a name, whose length stands at an offset.
    """

    def __init__(self, length: Callable[[str, int], int], order: str) -> None:
        self.at = 0
        self.names: list[str] = []
        self.formats: list[Any] = []
        self.offsets: list[int] = []
        self._length, self._order = length, order

    def message(self, typename: str, prefix: str = "") -> None:
        """Add the fields of a message."""
        for kind, member, count in _members(typename):
            name = prefix + member
            if count is None:
                self._number(name + SIZE, "uint32")
                for k in range(self._length(name, self.at - 4)):
                    self._one(kind, f"{name}[{k}]", 1)
            else:
                self._one(kind, name, count)

    def _one(self, kind: str, name: str, count: int) -> None:
        if kind in _PLAIN:
            self._number(name, kind, count)
        elif kind == "string":
            self._number(name + SIZE, "uint32")
            if size := self._length(name, self.at - 4):
                self._add(name, f"S{size}", self.at)
            self.at += size
        else:
            before = len(self.names)
            self.message(kind, name + ".")
            each = self.formats[before:]
            if len(each) > 1 and all(form == each[0] and isinstance(form, np.dtype) for form in each):
                # members that are alike, such as a vector's, have one more field that spans them
                self._add(name, (each[0], (len(each),)), self.at - each[0].itemsize * len(each))

    def _number(self, name: str, kind: str, count: int = 1) -> None:
        one = np.dtype(self._order + _PLAIN[kind])
        self.at += -self.at % one.itemsize
        self._add(name, one if count == 1 else (one, (count,)), self.at)
        self.at += one.itemsize * count

    def _add(self, name: str, form: Any, at: int) -> None:
        self.names.append(name)
        self.formats.append(form)
        self.offsets.append(at + _ENCAPSULATION)

    def dtype(self) -> np.dtype[Any]:
        """Return the layout; its records begin with the encapsulation."""
        size = self.at + _ENCAPSULATION
        return np.dtype({"names": self.names, "formats": self.formats, "offsets": self.offsets, "itemsize": size})


# -------------------------------------------------------------------------------------------------------------- writing


@cache
def _blank(typename: str, texts: tuple[tuple[str, str], ...]) -> tuple[bytes, np.dtype[Any]]:
    """Return a message whose numbers are zero, and its layout."""
    return _blank_of(typename, dict(texts))


def _blank_of(typename: str, values: Values) -> tuple[bytes, np.dtype[Any]]:
    encoded = {name: value.encode() + b"\0" for name, value in values.items() if isinstance(value, str)}
    lengths: dict[str, int] = {name: len(text) for name, text in encoded.items()}
    lengths |= {name: len(value) for name, value in values.items() if isinstance(value, list)}
    # a string that the caller does not name is empty
    fields = _Fields(lambda name, at: lengths.setdefault(name, 0 if isinstance(values.get(name), list) else 1), "<")
    fields.message(typename)
    layout = fields.dtype()
    data = bytearray(layout.itemsize)
    data[:_ENCAPSULATION] = _LITTLE_ENDIAN
    record = np.frombuffer(data, layout)
    for name, length in lengths.items():
        record[name + SIZE] = length
    for name, text in encoded.items():
        record[name] = text
    return bytes(data), layout


def blanks(typename: str, count: int, **texts: str) -> np.ndarray:
    """Return messages of a type as records to be filled; their numbers are zero, sequences empty.

    The names of the fields are paths such as `header.stamp.sec`; a nested message whose members are numbers of one kind
    has a field of its own as well, such as `angular_velocity`, shape (3,).

    `texts`: strings by path, with "__" for "."; any other string is empty.
    """
    data, layout = _blank(typename, tuple((name.replace("__", "."), text) for name, text in texts.items()))
    return np.frombuffer(bytearray(data * count), layout)


def cut(records: np.ndarray) -> list[bytes]:
    """Return the bytes of each message."""
    size, data = records.itemsize, records.tobytes()
    return [data[at : at + size] for at in range(0, len(data), size)]


def encode(typename: str, values: Values) -> bytes:
    """Return the CDR bytes of one message.

    `values`: its members by name, nested messages as dictionaries, sequences as lists; any other is zero or empty.
    """
    flat = dict(_flat(values, ""))
    data, layout = _blank_of(typename, flat)
    record = np.frombuffer(bytearray(data), layout)
    for name, value in flat.items():
        if not isinstance(value, str | list):
            record[name] = value
    return record.tobytes()


def _flat(values: Values, prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        path = prefix + name
        if isinstance(value, dict):
            yield from _flat(value, path + ".")
            continue
        yield path, value
        if isinstance(value, list):
            for k, one in enumerate(value):
                yield from _flat(one, f"{path}[{k}].")


# -------------------------------------------------------------------------------------------------------------- reading


def windows(data: np.ndarray, at: np.ndarray, size: int) -> np.ndarray:
    """Return `size` bytes from each offset on, uint8, shape (n, size); all of them must be there."""
    if not at.size:
        return np.empty((0, size), np.uint8)
    every = np.ndarray((data.size - size + 1,), f"V{size}", data, strides=(1,))
    return np.asarray(every[at].view(np.uint8).reshape(-1, size))


def layout_in(typename: str, data: bytes) -> np.dtype[Any]:
    """Return the layout that a message has.

    Raises UndecodableError if the bytes are not a message of that type.
    """
    if len(data) < _ENCAPSULATION or data[0] != 0 or data[1] > 1:
        raise UndecodableError("it is not plain CDR")
    order = "><"[data[1]]

    def length(name: str, at: int) -> int:
        at += _ENCAPSULATION
        size = int.from_bytes(data[at : at + 4], "little" if order == "<" else "big")
        if at + 4 + size > len(data):
            raise UndecodableError(f"`{name}` ends behind it")
        return size

    fields = _Fields(length, order)
    fields.message(typename)
    layout = fields.dtype()
    if not 0 <= len(data) - layout.itemsize <= _PADDING:
        raise UndecodableError(f"it has {len(data)} bytes, not {layout.itemsize}")
    for name, form, offset in zip(fields.names, fields.formats, fields.offsets, strict=True):
        if isinstance(form, str) and data[offset + int(form[1:]) - 1]:  # a string ends with a NUL
            raise UndecodableError(f"`{name}` is no string")
    return layout


def views(
    data: np.ndarray, at: np.ndarray, length: np.ndarray, typename: str
) -> Iterator[tuple[np.ndarray, np.ndarray | UndecodableError]]:
    """Yield messages of a type as records, those of one layout together.

    `data`: bytes that hold them, uint8.
    `at`, `length`: where each begins, and how long it is, shape (n,).
    Yields indices of messages, in order, with their records, or with the error of one that is no such message.
    """
    left = np.arange(at.size)
    while left.size:
        first = left[0]
        try:
            layout = layout_in(typename, data[at[first] : at[first] + length[first]].tobytes())
        except UndecodableError as error:
            yield left[:1], error
            left = left[1:]
            continue
        extra = length[left] - layout.itemsize
        alike = left[(extra >= 0) & (extra <= _PADDING)]
        found = windows(data, at[alike], layout.itemsize)
        records = found.view(layout)[:, 0]
        fits = (found[:, :2] == found[0, :2]).all(axis=1)
        for name in layout.names or ():
            if name.endswith(SIZE):
                fits &= records[name] == records[name][0]
        alike, records = (alike, records) if fits.all() else (alike[fits], records[fits])
        yield alike, records
        left = left[:0] if alike.size == left.size else np.setdiff1d(left, alike, assume_unique=True)


def decode(typename: str, data: bytes) -> np.void:
    """Return a message as a record.

    Raises UndecodableError if the bytes are not a message of that type.
    """
    layout = layout_in(typename, data)
    return np.frombuffer(data, layout, 1)[0]  # type: ignore[no-any-return]


def text(record: np.void, name: str) -> str:
    """Return a string of a record, by its path.

    Raises UndecodableError if it is not UTF-8.
    """
    if name not in (record.dtype.names or ()):
        return ""
    try:
        return str(record[name].decode())
    except UnicodeDecodeError as error:
        raise UndecodableError(f"`{name}` is no text") from error

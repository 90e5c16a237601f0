"""TOML: from outside it is refused in words whatever is in it; values that are written show nothing that acts.

Values are read one by one, and what is wrong is said by table, key and value.

Python's parser calls itself for what is nested, and takes the square of its length over a key of many parts.
"""

import math
import re
import tomllib
from collections.abc import Collection, Mapping
from typing import Any, TypeAlias, TypeVar

from filters.errors import InputError
from imutui.plain_text import quoted

Document: TypeAlias = Mapping[str, Any]  # of any shape until whoever reads it has looked at it
LIMIT = 4 * 2**20  # bytes of the longest document
DEPTH = 20  # of tables and lists in each other; ours have five
LARGEST = 1e12  # number, of either sign
_PARTS = 50
T = TypeVar("T", bound=str)
_LONG_KEY = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]+[ \t]*\.[ \t]*){{{_PARTS},}}""")


def parse(content: bytes) -> dict[str, Any]:
    """Document of a file's content, UTF-8 with or without byte order mark.

    Raises InputError if it is no TOML, or longer or deeper than the limits.
    """
    if len(content) > LIMIT:
        raise InputError(f"it is {len(content):,} bytes long; the most is {LIMIT:,}")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(str(error)) from error
    if _LONG_KEY.search(text):
        raise InputError(f"a key in it has more than {_PARTS} parts")
    try:
        document = tomllib.loads(text)
    except ValueError as error:
        raise InputError(str(error)) from error
    except RecursionError as error:
        raise InputError(_TOO_DEEP) from error
    if _is_deep(document):
        raise InputError(_TOO_DEEP)
    return document


_TOO_DEEP = f"its tables and lists are nested more than {DEPTH} deep"


def is_number(value: Any) -> bool:
    """Whether a value is a number that anything here can be: finite, and not beyond `LARGEST`."""
    # compared as it is: a whole number may have any length, more than a float takes
    return isinstance(value, int | float) and not isinstance(value, bool) and -LARGEST <= value <= LARGEST


def _is_deep(document: dict[str, Any]) -> bool:
    level: list[Any] = [document]
    for _ in range(DEPTH + 1):
        level = [
            inside
            for table in level
            for inside in (table.values() if isinstance(table, dict) else table)
            if isinstance(inside, dict | list)
        ]
        if not level:
            return False
    return True


def tables_of(document: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    """An array of tables; empty where it is absent."""
    tables = document.get(key, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InputError(f"`{key}` is {tables!r}; each is a table [[{key}]]")
    return tables


class Table:
    """Values of a table, read one by one; every method raises InputError with `of` which table, key and value.

    Keys that are unknown are refused at once.
    """

    def __init__(self, values: Mapping[str, Any], keys: Collection[str], of: str, *, where: str | None = None) -> None:
        for key in values:
            if key not in keys:
                raise InputError(f"`{key}` is unknown in {of}; known: {', '.join(keys)}")
        self._values = values
        self._where = f"{of}: " if where is None else where

    @classmethod
    def inside(cls, document: Mapping[str, Any], key: str, keys: Collection[str]) -> "Table":
        """A table of the document; empty where it is absent."""
        values = document.get(key, {})
        if not isinstance(values, dict):
            raise InputError(f"`{key}` is {values!r}, not a table [{key}]")
        return cls(values, keys, f"[{key}]")

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def __len__(self) -> int:
        return len(self._values)

    def wrong(self, key: str, what: str) -> InputError:
        """That a value is not what it should be."""
        return InputError(f"{self._where}`{key}` is {self._values.get(key)!r}, {what}")

    def number(self, key: str, default: float | None = None, *, least: float = -math.inf) -> float:
        """A finite number, not below the least."""
        value = self._values.get(key, default)
        if value is None:
            raise InputError(f"{self._where}`{key}` is missing")
        if not is_number(value) or value < least:
            raise self.wrong(key, f"not a finite number{f' from {least:g} on' * (least > -math.inf)}")
        return float(value)

    def whole(self, key: str, least: int) -> int:
        """A whole number, not below the least; there is no default."""
        value = self._values.get(key)
        if not isinstance(value, int) or isinstance(value, bool) or not least <= value < 2**63:
            raise self.wrong(key, f"not a whole number from {least} on")
        return value

    def yes(self, key: str, default: bool = False) -> bool:
        """A truth value."""
        value = self._values.get(key, default)
        if not isinstance(value, bool):
            raise self.wrong(key, "not true or false")
        return value

    def text(self, key: str, default: str | None, what: str = "not a text") -> str | None:
        """A text."""
        value = self._values.get(key, default)
        if value is not default and not isinstance(value, str):
            raise self.wrong(key, what)
        return value

    def choice(self, key: str, allowed: tuple[T, ...], default: T) -> T:
        """One of several words."""
        value = self._values.get(key, default)
        for word in allowed:
            if value == word:
                return word
        raise self.wrong(key, f"not one of: {', '.join(allowed)}")

    def triple(self, key: str, unit: float) -> tuple[float, float, float] | None:
        """Three numbers, multiplied with a unit; None where they are absent."""
        if key not in self._values:
            return None
        value = self._values[key]
        if not isinstance(value, list) or len(value) != 3 or not all(is_number(v) for v in value):
            raise self.wrong(key, "not three numbers: [x, y, z]")
        return value[0] * unit, value[1] * unit, value[2] * unit


def value(of: object) -> str:
    """A value as TOML, in one line; what is None in a table is left out of it."""
    if hasattr(of, "tolist"):  # numpy's, of which only arrays and scalars are here
        of = of.tolist()
    if isinstance(of, bool):
        return "true" if of else "false"
    if isinstance(of, str):
        return quoted(of)
    if isinstance(of, int):
        return str(of)
    if isinstance(of, float):
        return repr(of) if math.isfinite(of) else "nan" if math.isnan(of) else "inf" if of > 0 else "-inf"
    if isinstance(of, Mapping):
        return "{ " + ", ".join(f"{key(k)} = {value(v)}" for k, v in of.items() if v is not None) + " }"
    if isinstance(of, list | tuple):
        return "[" + ", ".join(map(value, of)) + "]"
    raise TypeError(f"`of` is {of!r}, which TOML cannot hold")


def key(name: str) -> str:
    """A key as TOML, quoted where it must be."""
    bare = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if bare else quoted(name)

"""Parse TOML that is not trusted, and write values as TOML without characters that act on a terminal.

`imutui.declared` reads the values. Limits protect Python's parser: it recurses into nested tables, and a key with many
parts takes time that grows with the square of their number.
"""

import math
import re
import tomllib
from collections.abc import Mapping
from typing import Any, TypeAlias

from filters.errors import InputError
from imutui.plain_text import quoted

Document: TypeAlias = Mapping[str, Any]  # not checked yet
LIMIT = 4 * 2**20  # bytes of the longest document
DEPTH = 20  # of tables and lists in each other; ours have five
_PARTS = 50
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

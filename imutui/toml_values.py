"""Values of a parsed TOML document, read one by one: what is wrong is said by table, key and value."""

import math
from collections.abc import Mapping
from typing import Any, TypeAlias, TypeVar

from filters.errors import InputError
from imutui.toml_text import is_number

Table: TypeAlias = Mapping[str, Any]
Triple: TypeAlias = tuple[float, float, float]
Word = TypeVar("Word", bound=str)


def known(table: Table, keys: tuple[str, ...], where: str) -> None:
    """Refuse keys that are unknown."""
    for key in table:
        if key not in keys:
            raise InputError(f"`{key}` is unknown {where}; known: {', '.join(keys)}")


def table_of(document: Table, key: str) -> Table:
    """A table of the document; empty where it is absent."""
    value = document.get(key, {})
    if not isinstance(value, dict):
        raise InputError(f"`{key}` is {value!r}, not a table [{key}]")
    return value


def tables_of(document: Table, key: str) -> list[Table]:
    """An array of tables; empty where it is absent."""
    value = document.get(key, [])
    if not isinstance(value, list) or not all(isinstance(table, dict) for table in value):
        raise InputError(f"`{key}` is {value!r}; each is a table [[{key}]]")
    return value


def number(table: Table, key: str, where: str, default: float | None = None, *, least: float = -math.inf) -> float:
    """A finite number, not below the least."""
    value = table.get(key, default)
    if value is None:
        raise InputError(f"{where}`{key}` is missing")
    if not is_number(value) or value < least:
        raise InputError(
            f"{where}`{key}` is {value!r}, not a finite number{f' from {least:g} on' * (least > -math.inf)}"
        )
    return float(value)


def whole(table: Table, key: str, least: int, where: str) -> int:
    """A whole number, not below the least; there is no default."""
    value = table.get(key)
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value < 2**63:
        raise InputError(f"{where}`{key}` is {value!r}, not a whole number from {least} on")
    return value


def yes(table: Table, key: str, where: str, default: bool = False) -> bool:
    """A truth value."""
    value = table.get(key, default)
    if not isinstance(value, bool):
        raise InputError(f"{where}`{key}` is {value!r}, not true or false")
    return value


def choice(table: Table, key: str, where: str, allowed: tuple[Word, ...], default: Word) -> Word:
    """One of several words."""
    value = table.get(key, default)
    for word in allowed:
        if value == word:
            return word
    raise InputError(f"{where}`{key}` is {value!r}, not one of: {', '.join(allowed)}")


def triple(table: Table, key: str, unit: float, where: str) -> Triple | None:
    """Three numbers, multiplied with a unit; None where they are absent."""
    if key not in table:
        return None
    value = table[key]
    if not isinstance(value, list) or len(value) != 3 or not all(is_number(v) for v in value):
        raise InputError(f"{where}`{key}` is {value!r}, not three numbers: [x, y, z]")
    return value[0] * unit, value[1] * unit, value[2] * unit

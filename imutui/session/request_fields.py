"""Fields of a viewer's request, read one by one: nothing in it is taken for granted, and what is wrong has a name.

What it leaves out: whether what is asked can be done now, which the acquisition says.
"""

import math
from collections.abc import Mapping
from typing import cast

from filters.errors import InputError
from imutui.plain_text import NAME_LIMIT, one_line
from imutui.session.plan import RecordingWish
from imutui.session.requests import FilterChanges, RecordingWishFields, Request

_LONGEST_WAIT_S = 86400.0


def text(request: Request, name: str) -> str:
    """A text that the request must have; raises InputError if it has none."""
    value = cast("Mapping[str, object]", request).get(name)
    if not isinstance(value, str):
        raise InputError(f"the request's `{name}` is no text")
    return value


def text_or_none(request: Request, name: str, limit: int) -> str | None:
    """A text on one line, cut to a length; None if it lacks. Raises InputError if it is something else."""
    value = cast("Mapping[str, object]", request).get(name)
    if value is not None and not isinstance(value, str):
        raise InputError(f"the request's `{name}` is no text")
    return None if value is None else one_line(value, limit)


def whole(request: Request, name: str, default: int | None = None) -> int:
    """A whole number; raises InputError if it is none, or lacks and there is no default."""
    value = cast("Mapping[str, object]", request).get(name, default)
    if isinstance(value, bool) or not isinstance(value, int) or not -(2**63) <= value < 2**63:
        raise InputError(f"the request's `{name}` is no whole number")
    return value


def seconds(request: Request, name: str) -> float | None:
    """A time to wait at most; None for ever. Raises InputError if it is neither."""
    value = cast("Mapping[str, object]", request).get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= _LONGEST_WAIT_S:
        raise InputError(f"the request's `{name}` is no time from 0 to {_LONGEST_WAIT_S:g} s")
    return float(value)


def instant(request: Request, name: str) -> float | None:
    """A time, s; None if it lacks. Raises InputError if it is none."""
    value = cast("Mapping[str, object]", request).get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"the request's `{name}` is no time in seconds")
    return float(value)


def wish(request: Request) -> RecordingWish:
    """What is wished of a recording; raises InputError with the field that is unknown or does not fit."""
    fields, known = _table(request, "wish"), RecordingWishFields.__annotations__
    unknown = sorted(set(fields) - known.keys())
    if unknown:
        raise InputError(f"`{unknown[0][:NAME_LIMIT]}` is unknown in `wish`; known: {', '.join(known)}")
    return RecordingWish(**cast("RecordingWishFields", fields))


def changes(request: Request) -> FilterChanges:
    """What the filter is to take; raises InputError with the field that does not fit."""
    # which of them there are is said by whoever takes them
    fields = _table(request, "changes")
    for name in ("reference", "effects"):
        if not isinstance(fields.get(name, ""), str):
            raise InputError(f"the request's `{name}` is no text")
    file = fields.get("reference_file", ("", ""))
    if not isinstance(file, list | tuple) or len(file) != 2 or not all(isinstance(part, str) for part in file):
        raise InputError("the request's `reference_file` is not a name and a text")
    if len(file[0]) > NAME_LIMIT:
        raise InputError(f"the reference's name is longer than {NAME_LIMIT} characters")
    return cast("FilterChanges", fields)


def _table(request: Request, name: str) -> Mapping[str, object]:
    fields = cast("Mapping[str, object]", request).get(name, {})
    if not isinstance(fields, dict):
        raise InputError(f"the request's `{name}` is no JSON object")
    return fields

"""Whether a value that came as JSON has the shape that its type says: keys and types, all the way down."""

import types
from typing import Any, Literal, NotRequired, Required, Union, get_args, get_origin, get_type_hints, is_typeddict


def mismatches(value: Any, kind: Any, where: str = "") -> list[str]:
    """What in a value is not as its type says, a sentence each; empty if all is.

    `value`: as `json.loads` gives it.
    `kind`: a TypedDict, or what its fields may be: list, dict with text keys, union, Literal, str, int, float, bool,
      None.
    `where`: path to the value, for the sentences.
    """
    if is_typeddict(kind):
        return _record(value, kind, where)
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (NotRequired, Required):
        return mismatches(value, arguments[0], where)
    if origin in (Union, types.UnionType):
        found = [mismatches(value, one, where) for one in arguments]
        return [] if [] in found else min(found, key=_depth, default=[])
    if origin is Literal:
        return [] if value in arguments else [f"{where} is {value!r}, not one of {arguments}"]
    if origin is list:
        if not isinstance(value, list):
            return [f"{where} is {value!r}, not a list"]
        return [text for k, item in enumerate(value) for text in mismatches(item, arguments[0], f"{where}[{k}]")]
    if origin is dict:
        if not isinstance(value, dict):
            return [f"{where} is {value!r}, not a dict"]
        return [text for key, item in value.items() for text in mismatches(item, arguments[1], f"{where}.{key}")]
    return [] if _is(value, kind) else [f"{where} is {value!r}, not {kind}"]


def _record(value: Any, kind: Any, where: str) -> list[str]:
    if not isinstance(value, dict):
        return [f"{where} is {value!r}, not a {kind.__name__}"]
    hints = get_type_hints(kind)
    found = [f"{where}.{key} is missing" for key in sorted(kind.__required_keys__ - value.keys())]
    found += [f"{where}.{key} is not in {kind.__name__}" for key in sorted(value.keys() - hints.keys())]
    for key in value.keys() & hints.keys():
        found += mismatches(value[key], hints[key], f"{where}.{key}")
    return found


def _is(value: Any, kind: Any) -> bool:
    if kind is None or kind is type(None):
        return value is None
    if kind is float:
        # a whole number is written without a point by whoever counts
        return isinstance(value, int | float) and not isinstance(value, bool)
    if kind is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return isinstance(value, kind)


def _depth(found: list[str]) -> int:
    """Of the kinds that a union allows, the one that the value comes nearest to has most to say below the top."""
    return -max(text.split(" ")[0].count(".") for text in found)

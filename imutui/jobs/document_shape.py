"""Whether JSON from outside has the shape that a typed dictionary names, to the last field: what is wrong, in words."""

from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, NotRequired, Union, get_args, get_origin, get_type_hints, is_typeddict

_MOST = 1e30
"""Larger numbers are those of no result."""
_WORDS = {str: "a text", int: "a whole number", float: "a number", bool: "true or false", NoneType: "null"}


def problem(value: object, shape: Any, where: str) -> str:
    """What of a value is not as its shape has it; empty if all is.

    Fields that the shape does not name are passed over: a newer program may have written them.

    `value`: as `json` reads it.
    `shape`: a typed dictionary, list, dictionary, union, literal or plain type.
    `where`: what the value is called.
    """
    if is_typeddict(shape):
        return _of_fields(value, shape, where)
    origin = get_origin(shape)
    if origin is NotRequired:
        return problem(value, get_args(shape)[0], where)
    if origin in (Union, UnionType):
        told = [problem(value, each, where) for each in get_args(shape)]
        # what comes nearest says most: null is seldom what was meant
        return "" if "" in told else told[0]
    if origin is Literal:
        return "" if value in get_args(shape) else f"`{where}` is {value!r:.40}"
    if origin is list:
        return _of_list(value, get_args(shape)[0], where)
    if origin is dict:
        return _of_dictionary(value, get_args(shape)[1], where)
    return "" if _is(value, shape) else f"`{where}` is not {_WORDS[shape]}"


def _of_fields(value: object, shape: Any, where: str) -> str:
    if not isinstance(value, dict):
        return f"`{where}` is not an object"
    for key, own in _fields(shape).items():
        if key in value:
            if told := problem(value[key], own, f"{where}.{key}"):
                return told
        elif key in shape.__required_keys__:
            return f"`{where}.{key}` is missing"
    return ""


@cache
def _fields(shape: Any) -> dict[str, Any]:
    return get_type_hints(shape)


def _of_list(value: object, of: Any, where: str) -> str:
    if not isinstance(value, list):
        return f"`{where}` is not a list"
    return next((told for n, item in enumerate(value) if (told := problem(item, of, f"{where}[{n}]"))), "")


def _of_dictionary(value: object, of: Any, where: str) -> str:
    if not isinstance(value, dict):
        return f"`{where}` is not an object"
    return next((told for key, item in value.items() if (told := problem(item, of, f"{where}.{key}"))), "")


def _is(value: object, plain: type) -> bool:
    if plain is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and -_MOST < value < _MOST
    if plain is int:
        return isinstance(value, int) and not isinstance(value, bool) and -_MOST < value < _MOST
    return isinstance(value, plain)

"""The one version of imutui's JSON documents, and whether a document that is read has it and the shape of its kind."""

from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints, is_typeddict

VERSION = 1
"""Version of every JSON document that imutui writes and reads: results, rows, diaries, replies of an acquisition."""
_MOST = 1e30  # larger numbers are those of no result
_WORDS = {str: "a text", int: "a whole number", float: "a number", bool: "true or false", NoneType: "null",
          dict: "an object", list: "a list"}  # fmt: skip


def wrong_version(document: Any) -> str:
    """Return in words that a document is of another version; empty if it is of this one."""
    version = document.get("version") if isinstance(document, dict) else None
    if version == VERSION and type(version) is int:
        return ""
    return "it states no version" if version is None else f"its version is {version!r:.20}, not {VERSION}"


def fault(document: Any, shape: Any, where: str) -> str:
    """Return what keeps a document from being one of a kind, of this version; empty if nothing does.

    `shape`: typed dictionary of the kind.
    `where`: what the document is called.
    """
    if not isinstance(document, dict):
        return f"`{where}` is not an object"
    return wrong_version(document) or problem(document, shape, where)


def problem(value: Any, shape: Any, where: str, *, exact: bool = False) -> str:
    """What of a value, which is called `where`, is not as its shape has it; empty if all is.

    Fields that the shape does not name are passed over, unless it is `exact`: a newer program may have written them. A
    list that is annotated with a number, `Annotated[list[float], 3]`, has so many items.
    """
    origin, of = get_origin(shape), get_args(shape)
    if origin is Annotated:
        told = problem(value, of[0], where, exact=exact)
        return told or ("" if len(value) == of[1] else f"`{where}` has not {of[1]} numbers")
    if origin in (Union, UnionType):
        each = [problem(value, one, where, exact=exact) for one in of]
        # what comes nearest says most: null is seldom what was meant
        return "" if "" in each else each[0]
    if origin is Literal:
        return "" if value in of else f"`{where}` is {value!r:.40}"
    plain = dict if is_typeddict(shape) else origin or shape
    if not _is(value, plain):
        return f"`{where}` is not {_WORDS[plain]}"
    if is_typeddict(shape):
        fields = _fields(shape)
        if lacking := next((key for key in fields if key in shape.__required_keys__ and key not in value), None):
            return f"`{where}.{lacking}` is missing"
        if exact and (others := value.keys() - fields.keys()):
            return f"`{where}.{min(others)}` is not known"
        items = [(f"{where}.{key}", value[key], own) for key, own in fields.items() if key in value]
    elif plain is dict:
        items = [(f"{where}.{key}", item, of[1]) for key, item in value.items()]
    else:
        items = [(f"{where}[{n}]", item, of[0]) for n, item in enumerate(value)] if plain is list else []
    return next((told for name, item, own in items if (told := problem(item, own, name, exact=exact))), "")


def _is(value: Any, plain: type) -> bool:
    if plain not in (int, float):
        return isinstance(value, plain)
    numbers = int if plain is int else int | float
    return isinstance(value, numbers) and not isinstance(value, bool) and -_MOST < value < _MOST


@cache
def _fields(shape: Any) -> dict[str, Any]:
    return get_type_hints(shape, include_extras=True)

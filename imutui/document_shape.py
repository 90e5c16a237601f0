"""The version of imutui's JSON documents, and a check that a document has this version and its declared type."""

from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints, is_typeddict

from imutui.declared import problem

VERSION = 1
"""Version of every JSON document that imutui writes and reads: results, rows, diaries, replies of an acquisition."""


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


def empty(shape: Any) -> Any:
    """Return a document of a shape in which nothing is known: None where that is allowed, else empty or zero."""
    made = {key: _empty(hint) for key, hint in hints(shape).items()}
    return made | {"version": VERSION} if "version" in made else made


@cache
def hints(shape: Any) -> dict[str, object]:
    """Return the types of a shape's fields, with their annotations."""
    return get_type_hints(shape, include_extras=True)


def _empty(hint: Any) -> Any:
    origin, of = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return [_empty(get_args(of[0])[0]) for _ in range(of[1])]
    if origin in (Union, UnionType):
        return None if NoneType in of else _empty(of[0])
    if origin is Literal:
        return of[0]
    return empty(hint) if is_typeddict(hint) else (origin or hint)()

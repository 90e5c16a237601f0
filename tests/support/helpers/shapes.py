"""Documents of imutui with all their fields, of which a test states some."""

from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints, is_typeddict

from imutui.document_shape import VERSION


def whole(shape: Any, given: Any = None, **fields: Any) -> Any:
    """A document of a shape: fields that are not given are None where they may be, else empty or zero."""
    return _filled(shape, {**(given or {}), **fields})


def _filled(hint: Any, value: Any) -> Any:
    origin, of = get_origin(hint), get_args(hint)
    if is_typeddict(hint) and isinstance(value, dict):
        hints = _hints(hint)
        lacking = {key: _empty(key, own) for key, own in hints.items() if key not in value}
        return {key: _filled(hints[key], item) if key in hints else item for key, item in value.items()} | lacking
    if origin is Annotated:
        return _filled(of[0], value)
    if origin in (Union, UnionType):
        return value if value is None else _filled(next(one for one in of if one is not NoneType), value)
    if origin is list and isinstance(value, list):
        return [_filled(of[0], item) for item in value]
    if origin is dict and isinstance(value, dict):
        return {key: _filled(of[1], item) for key, item in value.items()}
    return value


@cache
def _hints(shape: Any) -> dict[str, Any]:
    return get_type_hints(shape, include_extras=True)


def _empty(key: str, hint: Any) -> Any:
    origin, of = get_origin(hint), get_args(hint)
    if key == "version":
        return VERSION
    if origin is Annotated:
        return [_empty("", get_args(of[0])[0])] * of[1]
    if origin in (Union, UnionType):
        return None if NoneType in of else _empty(key, of[0])
    if origin is Literal:
        return of[0]
    return _filled(hint, {}) if is_typeddict(hint) else (origin or hint)()

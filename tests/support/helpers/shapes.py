"""Documents of imutui with all their fields, of which a test states some."""

from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin, is_typeddict

from imutui.document_shape import empty, hints


def whole(shape: Any, given: Any = None, **fields: Any) -> Any:
    """A document of a shape: fields that are not given are None where they may be, else empty or zero."""
    return _filled(shape, {**(given or {}), **fields})


def _filled(hint: Any, value: Any) -> Any:
    origin, of = get_origin(hint), get_args(hint)
    if is_typeddict(hint) and isinstance(value, dict):
        own = hints(hint)
        return empty(hint) | {key: _filled(own[key], item) if key in own else item for key, item in value.items()}
    if origin is Annotated:
        return _filled(of[0], value)
    if origin in (Union, UnionType):
        return value if value is None else _filled(next(one for one in of if one is not NoneType), value)
    if origin is list and isinstance(value, list):
        return [_filled(of[0], item) for item in value]
    if origin is dict and isinstance(value, dict):
        return {key: _filled(of[1], item) for key, item in value.items()}
    return value

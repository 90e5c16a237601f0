"""Read a TOML table or a JSON object into a declared record, or refuse it with table, key, value and what is allowed.

A record is a dataclass, a `NamedTuple` or a `TypedDict`. The types of its fields are float, int, bool, str, `Literal`,
None, list, tuple, `dict[str, X]`, another record, and unions of these. In a union of records the tag selects the
record: the first field that they declare as a `Literal`, such as `kind`. `Annotated` adds a `Meta`, or a number: the
length of a list.
"""

import math
import typing
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, NamedTuple, TypeVar, get_args, get_origin

from filters.errors import InputError

LARGEST = 1e12  # number of a file or a request, of either sign
_LARGEST_OF_DOCUMENTS, _LARGEST_WHOLE = 1e30, 2**63 - 1
_PLAIN = (str, bool, NoneType, object)
_SHOWN = 80  # characters of a value in a message
_WORDS = {str: "a text", bool: "true or false", dict: "a table", list: "a list", tuple: "a list", object: "a value"}
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Meta:
    """What a field may be beyond its type, and what becomes of it."""

    least: float | None = None
    most: float | None = None  # infinity: the value may be infinite
    above: float | None = None  # the value is larger than this
    length: int | None = None  # number of items of a list
    allowed: tuple[Any, ...] = ()  # the only values; a `Literal` where they are known to the type checker
    words: str = ""  # what is allowed, in place of words made from type and limits
    to: str = ""  # name of the field in what is made, if it is not the key's
    make: Callable[[Any], Any] | None = None  # converts the value; the place is added to an InputError that it raises


_Path = tuple[str | int, ...]
"""Keys of tables and numbers of items, from 1, down to a value; its first part may be a name for the whole input."""


class _Rules(NamedTuple):
    exact: bool  # keys that are not declared are refused
    largest: float


def read(value: object, shape: type[T], where: str = "") -> T:
    """Return a value as its declared type has it; raises InputError if it does not fit.

    `where`: name of the value in messages; empty if keys alone say where they are.
    """
    made: T = _value(value, shape, (where,) if where else (), _Rules(exact=True, largest=LARGEST))
    return made


def make(value: object, shape: object, into: Callable[..., T], where: str = "") -> T:
    """Return what a function makes of the fields of a record; raises InputError as `read` does."""
    made: T = into(**_value(value, shape, (where,) if where else (), _Rules(exact=True, largest=LARGEST)))
    return made


def settle(record: object) -> None:
    """Check and convert the fields of a dataclass by their declared types; for its `__post_init__`.

    Raises InputError with the name of the field, its value and what is allowed.
    """
    rules = _Rules(exact=True, largest=LARGEST)
    declared: Any = type(record)
    for key, (shape, name, _) in _fields(declared).items():
        object.__setattr__(record, name, _value(getattr(record, name), shape, (key,), rules))


def problem(value: object, shape: object, where: str, *, exact: bool = False) -> str:
    """Return what of a JSON document does not fit its declared type; empty if it fits.

    `exact`: keys that are not declared do not fit.
    """
    try:
        _value(value, shape, (where,), _Rules(exact, _LARGEST_OF_DOCUMENTS))
    except InputError as error:
        return str(error)
    return ""


def refuse_unknown(keys: Iterable[str], known: Collection[str], table: str = "") -> None:
    """Raise InputError for a key that is not known, with those that are."""
    for key in keys:
        if key not in known:
            before = f"{table}: " if table else ""
            raise InputError(
                f"{before}`{key[:_SHOWN]}` is unknown{meant(key[:_SHOWN], known)}; known: {', '.join(known)}"
            )


def meant(word: str, known: Iterable[str]) -> str:
    """Return a question for the known word that is most like an unknown one; empty if none is like it."""
    import difflib  # only a mistake needs it

    near = difflib.get_close_matches(word, list(known), 1, 0.7)
    return f"; did you mean `{near[0]}`?" if near else ""


def _value(value: Any, shape: Any, path: _Path, rules: _Rules) -> Any:
    kind, of, meta = _split(shape)
    if kind in (int, float):
        if not _is_number(value, kind, meta, rules.largest):
            raise _wrong(value, shape, path)
        made = kind(value)
    elif kind is typing.Union:
        made = _one_of(value, shape, path, rules)
    elif _is_record(kind) and isinstance(value, Mapping):
        made = _record(value, kind, path, rules)
    elif kind is dict and isinstance(value, Mapping):
        made = {key: _value(item, of[1], (*path, key), rules) for key, item in value.items()}
    elif kind in (list, tuple) and isinstance(value, list | tuple):
        each = of if kind is tuple and of[-1] is not Ellipsis else of[:1] * len(value)
        if len(value) != (len(each) if meta.length is None else meta.length):
            raise _wrong(value, shape, path)
        made = kind([_value(value[n], own, (*path, n + 1), rules) for n, own in enumerate(each)])
    elif kind is Any or (_is_word(value, of) if kind is typing.Literal else kind in _PLAIN and isinstance(value, kind)):
        made = value
    else:
        raise _wrong(value, shape, path)
    if meta.allowed and not _is_word(value, meta.allowed):
        raise _wrong(value, shape, path)
    try:
        return made if meta.make is None else meta.make(made)
    except InputError as error:
        raise InputError(f"{_before(path if isinstance(value, Mapping) else path[:-1])}{error}") from error


def _is_number(value: Any, kind: type, meta: Meta, largest: float) -> bool:
    # compared before it is converted: a whole number may be longer than a float takes
    largest = _LARGEST_WHOLE if kind is int else largest
    least, most = (-largest if meta.least is None else meta.least), (largest if meta.most is None else meta.most)
    is_number = isinstance(value, kind | int) and not isinstance(value, bool)
    return is_number and least <= value <= most and (meta.above is None or value > meta.above)


def _is_word(value: Any, words: tuple[Any, ...]) -> bool:
    return any(value == word and isinstance(value, bool) == isinstance(word, bool) for word in words)


def _one_of(value: Any, shape: Any, path: _Path, rules: _Rules) -> Any:
    members = _split(shape)[1]
    if value is None and NoneType in members:
        return None
    members = tuple(member for member in members if member is not NoneType)
    records = [member for member in members if _is_record(member)]
    if isinstance(value, Mapping) and records:
        return _record(value, records[0] if len(records) == 1 else _tagged(value, records, path), path, rules)
    if len(members) == 1:
        return _value(value, members[0], path, rules)
    for member in members:
        try:
            return _value(value, member, path, rules)
        except InputError:
            continue
    raise _wrong(value, shape, path)


def _tagged(value: Mapping[str, Any], records: list[Any], path: _Path) -> Any:
    tag = next(key for key, (shape, _, _) in _fields(records[0]).items() if get_origin(shape) is typing.Literal)
    by_word = {word: record for record in records for word in get_args(_fields(record)[tag][0])}
    if not isinstance(word := value.get(tag), str) or word not in by_word:
        raise _wrong(word, typing.Literal[tuple(by_word)], (*path, tag))
    return by_word[word]


def _record(value: Mapping[str, Any], record: Any, path: _Path, rules: _Rules) -> Any:
    declared, made = _fields(record), {}
    if rules.exact:
        refuse_unknown(value, declared, _table(path))
    for key, (shape, name, is_required) in declared.items():
        if key in value:
            made[name] = _value(value[key], shape, (*path, key), rules)
        elif is_required:
            raise InputError(f"{_before(path)}`{key}` is missing; it is {_allowed(shape, key)}")
    try:
        return made if typing.is_typeddict(record) else record(**made)
    except InputError as error:
        raise InputError(f"{_before(path)}{error}") from error


def _table(path: _Path) -> str:
    return "".join(f" {part}" if isinstance(part, int) else f", {part}" for part in path).removeprefix(", ")


def _before(path: _Path) -> str:
    return f"{_table(path)}: " if path else ""


def _wrong(value: object, shape: object, path: _Path) -> InputError:
    keys = len(path)
    while keys and isinstance(path[keys - 1], int):
        keys -= 1
    numbers, name = path[keys:], path[keys - 1] if keys else ""
    items = "".join(f"item {number} of " for number in reversed(numbers))
    shown = repr(value)
    shown = shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]}…"
    what = f"{items}`{name}`" if name else "it"
    allowed = _allowed(shape, f"[{name}]" if numbers else f"{name}")
    if isinstance(value, float) and math.isfinite(value) and allowed == "a finite number":
        allowed = "a number of plausible size"
    return InputError(f"{_before(path[: max(keys - 1, 0)])}{what} is {shown}, not {allowed}")


def in_words(values: Iterable[object]) -> str:
    """Return values as a list in a sentence; an empty text is named."""
    return ", ".join(str(value) or "(empty)" for value in values)


def _allowed(shape: Any, key: str) -> str:
    """Return in words what the value of a key may be."""
    kind, of, meta = _split(shape)
    if meta.words or _is_record(kind):
        return meta.words or f"a table [{key}]"
    if kind is typing.Union:
        return " or ".join(dict.fromkeys(_allowed(member, key) for member in of if member is not NoneType))
    if words := of if kind is typing.Literal else meta.allowed:
        return f"one of: {in_words(words)}"
    if kind not in (int, float):
        if kind is list and (_split(of[0])[0] in (dict, typing.Union) or _is_record(_split(of[0])[0])):
            return f"a list of tables [[{key}]]"
        length = len(of) if kind is tuple and of[-1] is not Ellipsis else meta.length
        return _WORDS[kind] if length is None else f"a list of {length}"
    limits = f" above {meta.above:g}" if meta.above is not None else ""
    limits = f" from {meta.least:g}" if meta.least is not None else limits
    ends = meta.most is not None and meta.most < math.inf
    limits += f" to {meta.most:g}" if ends else " on" if meta.least is not None else ""
    return f"a {'whole' if kind is int else 'finite'} number{limits}"


@cache
def _split(shape: Any) -> tuple[Any, tuple[Any, ...], Meta]:
    """Return the kind of a type, what it is of, and what its annotations state; the last one counts."""
    if get_origin(shape) in (typing.Required, typing.NotRequired):
        shape = get_args(shape)[0]
    extras: list[Any] = []
    if get_origin(shape) is typing.Annotated:
        shape, *extras = get_args(shape)
    stated: dict[str, Any] = {}
    for extra in extras:
        own = Meta(length=extra) if isinstance(extra, int) else extra
        stated |= {name: value for name in Meta.__slots__ if (value := getattr(own, name)) not in (None, "", ())}
    kind = get_origin(shape) or shape
    return typing.Union if kind is UnionType else kind, get_args(shape), Meta(**stated)


@cache
def _fields(record: Any) -> dict[str, tuple[Any, str, bool]]:
    """Return of each key its type, the name of its field in what is made, and whether it must be there."""
    hints = typing.get_type_hints(record, include_extras=True)
    if typing.is_typeddict(record):
        required = record.__required_keys__
    elif is_dataclass(record):
        own = [each for each in fields(record) if each.init]
        required = {each.name for each in own if each.default is MISSING and each.default_factory is MISSING}
        hints = {each.name: hints[each.name] for each in own}
    else:
        required = set(hints) - set(record._field_defaults)
    return {key: (shape, _split(shape)[2].to or key, key in required) for key, shape in hints.items()}


@cache
def _is_record(kind: Any) -> bool:
    is_class = isinstance(kind, type)
    return typing.is_typeddict(kind) or (is_class and (is_dataclass(kind) or hasattr(kind, "_field_defaults")))

"""The acquisition that is not there tells what a real one tells, in the same shapes."""

import types
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints, is_typeddict

from helpers.fake_client import FakeClient

from imutui.session.snapshot import Snapshot


def differences(value: Any, hint: Any, where: str = "") -> list[str]:
    """Where a JSON-ready value is not of a type: a key too many or too few, another kind of value."""
    if is_typeddict(hint):
        if not isinstance(value, dict):
            return [f"{where}: {value!r} is no object"]
        known = get_type_hints(hint)
        odd = [
            f"{where}: {key}" for key in sorted((hint.__required_keys__ - value.keys()) | (value.keys() - known.keys()))
        ]
        inside = (
            d for key in known.keys() & value.keys() for d in differences(value[key], known[key], f"{where}.{key}")
        )
        return [*odd, *inside]
    if get_origin(hint) is list:
        (of,) = get_args(hint)
        if not isinstance(value, list):
            return [f"{where}: {value!r} is no list"]
        return [d for n, one in enumerate(value) for d in differences(one, of, f"{where}[{n}]")]
    if get_origin(hint) in (Union, types.UnionType):
        found = [differences(value, one, where) for one in get_args(hint)]
        return [] if [] in found else min(found, key=len)
    if get_origin(hint) is Literal:
        return [] if value in get_args(hint) else [f"{where}: {value!r}"]
    kinds = (int, float) if hint is float else hint
    return [] if isinstance(value, kinds) else [f"{where}: {value!r} is no {hint}"]


def test_the_fake_acquisition_tells_what_a_real_one_does() -> None:
    client = FakeClient()
    assert differences(client.snapshot(), Snapshot) == []
    client.recording = True
    assert differences(client.snapshot(), Snapshot) == []


def test_a_missing_or_foreign_field_is_found() -> None:
    """Else the comparison would say nothing."""
    told = FakeClient().snapshot()
    assert told["filter"] is not None
    told["filter"].pop("rejected")  # type: ignore[misc]
    assert differences(told, Snapshot) == [".filter: rejected"]

"""Declared records are read whole or refused with the place, the key, the value and what is allowed."""

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NotRequired, TypedDict

import pytest

from filters.errors import InputError
from imutui.declared import LARGEST, Meta, meant, problem, read

Positive = Annotated[float, Meta(above=0.0)]
Radians = Annotated[float, Meta(make=math.radians)]


@dataclass(frozen=True, slots=True)
class Dwell:
    """A member of a tagged union."""

    kind: Literal["dwell"]
    angles: tuple[Radians, Radians]
    seconds: Positive = 1.0


@dataclass(frozen=True, slots=True)
class Rate:
    """Another one, which refuses by itself what no type can say."""

    kind: Literal["rate", "turn"]
    rate: float

    def __post_init__(self) -> None:
        if self.rate == 0.0:
            raise InputError("`rate` is 0: that is a dwell")


class Top(TypedDict):
    """A record of all types."""

    count: Annotated[int, Meta(least=1, most=10)]
    segment: list[Dwell | Rate]
    name: NotRequired[str]
    yes: NotRequired[bool]
    word: NotRequired[Literal["a", "b"]]
    sign: NotRequired[Literal[-1, 1]]
    tau: NotRequired[Annotated[float, Meta(above=0.0, most=math.inf)]]
    one_or_more: NotRequired[str | list[str]]
    parameters: NotRequired[dict[str, float]]
    three: NotRequired[Annotated[list[float], 3]]
    maybe: NotRequired[Positive | None]
    accel_mg: NotRequired[Annotated[float, Meta(least=0.0), Meta(to="accel", make=lambda mg: mg * 1e-3)]]


class Outer(TypedDict):
    """A record within another one."""

    inner: Top


FITS: dict[str, Any] = {"count": 3, "segment": [{"kind": "dwell", "angles": [0, 180]}, {"kind": "turn", "rate": 5}]}


def test_a_record_is_made_with_its_defaults_conversions_and_tags() -> None:
    more = {"tau": math.inf, "one_or_more": ["x"], "maybe": None, "accel_mg": 2, "three": [1, 2.0, 3], "sign": -1}
    made: Any = read(FITS | more, Top)
    assert made["segment"] == [Dwell("dwell", (0.0, math.pi), 1.0), Rate("turn", 5.0)]
    assert made["accel"] == 2e-3
    assert "accel_mg" not in made
    assert {key: made[key] for key in more if key != "accel_mg"} == {k: v for k, v in more.items() if k != "accel_mg"}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"count": None}, "`count` is None, not a whole number from 1 to 10"),
        ({"count": 11}, "`count` is 11, not a whole number from 1 to 10"),
        ({"count": True}, "`count` is True, not a whole"),
        ({"count": 2.0}, "`count` is 2.0, not a whole"),
        ({"nmae": "x"}, "`nmae` is unknown; did you mean `name`?; known: count, segment, name"),
        ({"name": 3}, "`name` is 3, not a text"),
        ({"yes": 1}, "`yes` is 1, not true or false"),
        ({"word": "c"}, "`word` is 'c', not one of: a, b"),
        ({"word": ["c"]}, "`word` is ['c'], not one of: a, b"),
        ({"sign": True}, "`sign` is True, not one of: -1, 1"),
        ({"tau": 0.0}, "`tau` is 0.0, not a finite number above 0"),
        ({"tau": math.nan}, "`tau` is nan"),
        ({"one_or_more": 3}, "`one_or_more` is 3, not a text or a list"),
        ({"one_or_more": [3]}, "`one_or_more` is [3], not a text or a list"),
        ({"parameters": {"a": "x"}}, "parameters: `a` is 'x', not a finite number"),
        ({"parameters": []}, "`parameters` is [], not a table"),
        ({"three": [1, 2]}, "`three` is [1, 2], not a list of 3"),
        ({"three": [1, 2, "x"]}, "item 3 of `three` is 'x', not a finite number"),
        ({"maybe": -1.0}, "`maybe` is -1.0, not a finite number above 0"),
        ({"accel_mg": LARGEST * 2}, "`accel_mg` is 2000000000000.0, not a finite number from 0"),
        ({"accel_mg": 10**400}, "`accel_mg` is 1000"),
        ({"segment": {}}, "`segment` is {}, not a list of tables [[segment]]"),
        ({"segment": [3]}, "item 1 of `segment` is 3, not a table [[segment]]"),
        ({"segment": [{}]}, "segment 1: `kind` is None, not one of: dwell, rate, turn"),
        ({"segment": [{"kind": []}]}, "segment 1: `kind` is [], not one of"),
        ({"segment": [{"kind": "dwell"}]}, "segment 1: `angles` is missing; it is a list of 2"),
        ({"segment": [{"kind": "rate", "rate": 0.0}]}, "segment 1: `rate` is 0: that is a dwell"),
        ({"segment": [{"kind": "rate", "rate": 1.0, "seconds": 3}]}, "segment 1: `seconds` is unknown; known: kind,"),
    ],
)
def test_what_does_not_fit_is_said_with_place_key_value_and_what_is_allowed(changes: Any, said: str) -> None:
    with pytest.raises(InputError) as wrong:
        read(FITS | changes, Top)
    assert str(wrong.value).startswith(said)
    with pytest.raises(InputError) as wrong:
        read({"inner": FITS | changes}, Outer, "file")
    assert str(wrong.value).startswith("file, inner")


def test_a_long_value_is_cut_in_its_message() -> None:
    with pytest.raises(InputError) as wrong:
        read({"count": "x" * 10_000, "segment": []}, Top)
    assert len(str(wrong.value)) < 200
    with pytest.raises(InputError) as wrong:
        read(FITS | {"x" * 10**6: 1}, Top)
    assert len(str(wrong.value)) < 300


def test_a_document_may_have_more_keys_and_larger_numbers_than_a_file() -> None:
    document = FITS | {"newer": 1, "maybe": 1e20}
    assert problem(document, Top, "document") == ""
    assert problem(document, Top, "document", exact=True).startswith("document: `newer` is unknown")
    assert problem(document | {"maybe": 1e31}, Top, "document").startswith("document: `maybe` is 1e+31")
    assert problem([], Top, "document") == "`document` is [], not a table [document]"


def test_a_known_word_is_proposed_only_where_it_is_alike() -> None:
    assert meant("rate", ["rate_hz", "baud"]) == "; did you mean `rate_hz`?"
    assert meant("rate", ["operator"]) == ""

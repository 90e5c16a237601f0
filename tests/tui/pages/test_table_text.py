"""What the table page says of a guide's state."""

from typing import Any

from imutui.tui.pages.table import text

SEGMENTS = [
    {"kind": "dwell", "text": "go to outer 0°, middle 0°, inner 0°", "seconds": 30.0},
    {"kind": "rate", "text": "turn inner at +30 deg/s", "seconds": 12.0},
    {"kind": "dwell", "text": "go to outer 90°, middle 0°, inner 0°", "seconds": 30.0},
]
PROFILE = {"name": "tumble.toml", "align": "marks", "segments": SEGMENTS}


def guide(state: str, segment: int = 1, **changes: Any) -> dict[str, Any]:
    found = {
        "state": state,
        "segment": segment,
        "count": 3,
        "left_s": None,
        "begun": [3.0, None, None],
    }
    return {**found, "begun": [3.0, None, None], **changes}


def test_each_segment_has_a_word() -> None:
    assert [text.state_word(None, n) for n in range(3)] == ["to do"] * 3
    assert [text.state_word(guide("go"), n) for n in range(3)] == ["done", "now", "next"]
    assert [text.state_word(guide("hold", 0), n) for n in range(3)] == ["now", "next", "to do"]
    assert [text.state_word(guide("cancelled"), n) for n in range(3)] == ["done", "next", "to do"]
    assert [text.state_word(guide("done", 2, begun=[3.0, None, 9.0]), n) for n in range(3)] == [
        "done",
        "left out",
        "done",
    ]


def test_it_waits_for_ever_and_says_for_what() -> None:
    what, then = text.said(guide("go"), PROFILE, True)
    assert what == "Segment 2 of 3: turn inner at +30 deg/s"
    assert then == "I wait for you. Enter when it turns at that rate."
    what, then = text.said(guide("hold", 2, left_s=3.0), PROFILE, True)
    assert what == "Segment 3 of 3: hold outer 90°, middle 0°, inner 0°"
    assert "Leave the table alone" in then


def test_the_end_and_a_cancelled_run_say_what_next() -> None:
    assert "r finishes the file, t traces it" in text.said(guide("done"), PROFILE, True)[1]
    assert "b begins again" in text.said(guide("done"), PROFILE, False)[0]
    assert "b resumes there" in text.said(guide("cancelled"), PROFILE, True)[1]
    assert "by itself" in text.said(None, {**PROFILE, "align": "gyro"}, False, by_hand=False)[0]


def test_what_can_be_asked_follows_the_state() -> None:
    assert text.can(None, False) == {"begin"}
    assert text.can(guide("go"), True) == {"there", "cancel"}
    assert text.can(guide("hold"), True) == {"cancel"}
    assert text.can(guide("cancelled"), True) == {"resume"}
    assert text.can(guide("cancelled"), False) == {"begin"}
    assert text.can(guide("done"), True) == set()


def test_what_does_not_fit_is_counted() -> None:
    items = ["bias ax ay az", "scale factor az", "g-sensitivity gx"]
    assert text.testable(items, 80) == "bias ax ay az; scale factor az; g-sensitivity gx"
    assert text.testable(items, 40) == "bias ax ay az; scale factor az; +1 more"
    assert text.testable(items, 22) == "bias ax ay az; +2 more"
    assert len(text.testable(items, 10)) == 10
    assert text.testable(None, 80) == "working out…"
    assert text.testable([], 80) == "nothing new by itself"


def test_a_bar_is_as_long_at_its_ends() -> None:
    assert [len(text.bar(share, 10)) for share in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [10] * 5

"""The quality summary that a recorder attaches on closing, as anybody may have written it: what has its shape is taken.

What it leaves out: what the figures mean, which is in `results`.
"""

import json
import math
from collections.abc import Callable

LIMIT = 16 * 2**20
"""Longest attachment that is read as a summary, bytes."""


def parse(content: bytes) -> dict[str, object]:
    """Figures of a summary's JSON: those that are what their names promise, numbers that are none as None.

    `content`: of the attachment.
    Returns empty if it is no JSON object.
    """
    if len(content) > LIMIT:
        return {}
    try:
        document = json.loads(content, parse_float=_finite, parse_int=_whole, parse_constant=lambda name: None)
    except (ValueError, RecursionError):
        return {}
    if not isinstance(document, dict):
        return {}
    return {key: document[key] for key, fits in _SHAPES.items() if key in document and fits(document[key])}


def _finite(text: str) -> float | None:
    value = float(text)
    return value if math.isfinite(value) else None


def _whole(text: str) -> int | None:
    # longer than any count, and than what other programs read
    return int(text) if len(text) < 20 else None


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_figure(value: object) -> bool:
    """Whether it is a number, one that is not known, a verdict, a text, or a list of numbers."""
    flat = value is None or isinstance(value, str | bool) or _is_number(value)
    return flat or (isinstance(value, list) and all(item is None or _is_number(item) for item in value))


def _is_figures(value: object) -> bool:
    return isinstance(value, dict) and all(map(_is_figure, value.values()))


_WORDS = ("GREEN", "AMBER", "RED", "OFF")
_SHAPES: dict[str, Callable[[object], bool]] = {
    "verdict": lambda value: value in _WORDS,
    "samples": _is_count,
    "duration_s": _is_number,
    "lost_packets": _is_count,
    "bad_checksums": _is_count,
    "converged": lambda value: isinstance(value, bool),
    "converged_s": _is_figures,
    "final": _is_figures,
    "sd": _is_figures,
    "nis": _is_figures,
    "gaps": lambda value: isinstance(value, list) and all(map(_is_figures, value)),
    "alarms": lambda value: isinstance(value, list) and all(isinstance(alarm, str) for alarm in value),
}

"""Common causes as entries of the document, the numbers by which entries of one channel name them, and in words."""

from collections.abc import Sequence

import numpy as np

from filters.channels import CHANNELS, GYROS, error_unit
from filters.effects.hypothesis import Hypothesis
from filters.effects.run_specific import Step, Telegraph
from filters.tracing.common_causes import CommonCause
from filters.tracing.trace_document import CommonEntry

_SAME_S = 5.0
"""A channel's step within this of a common event's start or end is that event."""


def entries(causes: Sequence[CommonCause], runs: Sequence[str], has_temperature: bool) -> list[CommonEntry]:
    """Entries of the document.

    `runs`: names.
    `has_temperature`: whether temperature was logged.
    """
    return [_entry(cause, runs, has_temperature) for cause in causes]


def _entry(cause: CommonCause, runs: Sequence[str], has_temperature: bool) -> CommonEntry:
    unit, si = error_unit(cause.channels[0])
    own = [runs[r] for r in cause.run.tolist()]
    names = list(dict.fromkeys(own))
    entry: CommonEntry = {
        "kind": cause.kind,
        "label": label(cause),
        "channels": [CHANNELS[c] for c in cause.channels],
        "coherence": cause.coherence,
        "t_start_s": cause.start,
        "t_end_s": cause.end,
        "curve": {"t_s": cause.t.tolist(), "y": (cause.course / si).tolist()},
        "unit": unit,
        "sizes": [
            {
                "channel": CHANNELS[c],
                "value": float(value / error_unit(c)[1]),
                "sd": float(sd / error_unit(c)[1]),
                "unit": error_unit(c)[0],
            }
            for c, value, sd in zip(cause.channels, cause.size, cause.sd, strict=True)
        ],
        "p": cause.p,
        "record": suspects(cause, has_temperature),
    }
    if len(names) == 1:
        entry["run"] = names[0]
    else:
        entry["curve"]["run"] = own
    return entry


def label(cause: CommonCause) -> str:
    """What it does, in words."""
    if cause.kind != "event":
        return f"share a {cause.kind}"
    text = "step together and stay" if cause.stays else "step together and come back"
    return text if cause.tilt is None else f"{text}, as a tilt of {np.rad2deg(cause.tilt):.2g} deg would make them"


def suspects(cause: CommonCause, has_temperature: bool) -> list[str]:
    """What to record beside the readings, so that the cause can be told."""
    kinds = {"gyro" if c in GYROS else "accel" for c in cause.channels}
    out = ["supply voltage", "pressure", "magnetic field"]
    if kinds == {"accel"}:
        out = ["tilt of the table", *out[:2]]
        if cause.tilt is None:
            out = [*out[1:], out[0]]
    if cause.kind != "event" and not has_temperature:
        out = ["temperature", *out]
    return out


def number_of_step(causes: Sequence[CommonCause], h: Hypothesis) -> int | None:
    """Number of the common event that a channel's step or two-level noise is part of; None if there is none."""
    if not isinstance(h, Step | Telegraph):
        return None
    for number, cause in enumerate(causes):
        if cause.kind != "event" or h.channel not in cause.channels:
            continue
        if isinstance(h, Telegraph):
            return number
        ends = [cause.start] if cause.stays else [cause.start, cause.end]
        if h.run in (-1, int(cause.run[0])) and any(abs(h.at - cause.begins - end) <= _SAME_S for end in ends):
            return number
    return None


def number_of_drift(causes: Sequence[CommonCause], channel: int) -> int | None:
    """Number of the common drift or remainder that a channel's own is part of; None if there is none."""
    return next((n for n, cause in enumerate(causes) if cause.kind != "event" and channel in cause.channels), None)

"""Causes outside the log that several channels share: an event, a drift, a remainder; one finding each.

A tilt of the table moves two accelerometers, a supply voltage moves six channels. Neither is in the log, so neither is
explained; but which channels move together, how nearly, and when, can be held against anything that was logged
elsewhere. Events are sought first (`common_steps`), what drifts have in common in what they leave (`common_drift`).
Then as entries of the document. Leaves out what a correction would be worth, for there is none.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from filters.channels import ACCELS, CHANNELS, GYROS, error_unit
from filters.effects.hypothesis import Hypothesis
from filters.effects.run_specific import Step, Telegraph
from filters.tracing import common_drift, common_rows, common_steps
from filters.tracing.common_drift import CommonDrift
from filters.tracing.common_rows import Rows
from filters.tracing.common_steps import CommonStep
from filters.tracing.residual import sensed
from filters.tracing.selection import Selection
from filters.tracing.trace_document import CommonEntry
from filters.types import Array

_POINTS = 500
_MOST = 6
_AROUND_S = 30.0  # of an event's course before its start and after its end, at least
_WAY_BACK = 8  # times the width of a step: how far its other end is looked for
_VERTICAL = 0.5  # of gravity: an axis that reads more of it does not show a small tilt


@dataclass(frozen=True, kw_only=True)
class CommonCause:
    """What moves several channels at once."""

    # event, drift, or remainder: what is shared though neither channel needs a drift
    kind: Literal["event", "drift", "remainder"]
    channels: tuple[int, ...]  # the leading one first
    coherence: float  # mean squared correlation of the channels with what they share, without their white noise, 0 to 1
    # start, end: s since the start of the run; of an event that stays, `end` is that of its run
    start: float
    end: float
    stays: bool  # whether an event has no way back
    run: NDArray[np.int_]  # number of the run of each point of the course, shape (n,)
    # t, course: s since the start of that run, and the course, SI of the leading channel, shape (n,)
    t: Array
    course: Array
    # size, sd: of what is shared in each channel, SI, shape (k,): an event's step, a drift's standard deviation, signed
    size: Array
    sd: Array
    p: float  # probability of as much by chance
    begins: float = 0.0  # when the run of an event began, s since that of its power-on
    tilt: float | None = None  # rad that the unit would have to be tilted by; None where a tilt can't be the cause


def common_causes(chosen: Selection, channels: Sequence[int]) -> list[CommonCause]:
    """Common causes of a selection's runs, events first, by time.

    `chosen`: what was selected; what it explains, within a run or not, is not looked at but for steps and two-level
      noise.
    """
    rows = common_rows.rows_of(chosen, channels)
    steps, cut = common_steps.common_steps(rows)
    events = [_event(chosen, rows, start, back) for start, back in common_steps.pairs(steps)]
    events = sorted(sorted(events, key=lambda e: e.p)[:_MOST], key=lambda e: (int(e.run[0]), e.start))
    return events + [_drift(chosen, rows, drift) for drift in common_drift.common_drifts(cut)]


# -------------------------------------------------------------------------------------------------------------- event


def _event(chosen: Selection, rows: Rows, start: CommonStep, back: CommonStep | None) -> CommonCause:
    members, size, sd = _sizes(start, back)
    weights = size / sd**2 / float(np.sum((size / sd) ** 2)) * size[0]
    last = _way_back(rows, start, members, weights, size[0]) if back is None else back.row
    length = len(rows.residual[start.run])
    around = max(_AROUND_S / rows.period, 4.0 * start.width, 0.5 * (last - start.row) if last else 0.0)
    first, end = max(0, round(start.row - around)), min(length, round((last or start.row) + around))
    t, course = _course(rows, start.run, first, end, members, weights, size)
    before = t < start.row * rows.period
    if before.any():
        course = course - np.median(course[before])
    return CommonCause(
        kind="event",
        channels=tuple(members),
        coherence=_coherence(rows, start.run, slice(first, end), members),
        start=start.row * rows.period,
        end=(last or length) * rows.period,
        stays=last is None,
        run=np.full(t.size, start.run),
        t=t,
        course=course,
        size=size,
        sd=sd,
        p=start.p,
        begins=chosen.design.stack.blocks[start.run].run.begins,
        tilt=_tilt(chosen, start.run, members, size),
    )


def _sizes(start: CommonStep, back: CommonStep | None) -> tuple[list[int], Array, Array]:
    """Channels of an event, the surest first, its size in each and the standard deviation of that, SI, shape (k,)."""
    members = sorted({*start.channels, *(back.channels if back else ())})
    size, sd = start.size[members], start.sd[members]
    if back is not None:
        size, sd = 0.5 * (size - back.size[members]), 0.5 * np.hypot(sd, back.sd[members])
    order = np.argsort(-np.abs(size) / sd, kind="stable")
    return [members[k] for k in order.tolist()], size[order], sd[order]


def _way_back(rows: Rows, start: CommonStep, members: list[int], weights: Array, size: float) -> int | None:
    """Row from which a step that no other undoes is gone again; None if it stays.

    A pulse that is short beside the drift has one end only that stands out: half of it gone is its other end.
    """
    x = rows.residual[start.run][:, members] @ weights
    before = x[max(0, start.row - 4 * start.width) : start.row]
    after = x[start.row : start.row + _WAY_BACK * start.width]
    before, after = before[np.isfinite(before)], after[np.isfinite(after)]
    if before.size < start.width or after.size < 2 * start.width:
        return None
    level = (np.cumsum(after)[start.width :] - np.cumsum(after)[: -start.width]) / start.width
    gone = np.flatnonzero((level - np.median(before)) / size < 0.5)
    return start.row + int(gone[0]) + start.width // 2 if gone.size else None


def _coherence(rows: Rows, run: int, part: slice, members: list[int]) -> float:
    """Mean squared correlation of channels over some rows of a run, each with each, without their white noise."""
    x = common_rows.filled(rows.residual[run][part][:, members], 0.0)
    per = max(1, len(x) // 50)
    means = x[: len(x) // per * per].reshape(-1, per, len(members)).mean(axis=1)
    covariance = np.cov(means.T)
    variance = np.maximum(np.diag(covariance) - rows.white[members] / per, 0.01 * np.diag(covariance))
    most = np.outer(variance, variance)
    squares = np.minimum(1.0, np.divide(covariance**2, most, out=np.zeros_like(most), where=most > 0.0))
    return float(np.mean(squares[np.triu_indices(len(members), 1)]))


def _tilt(chosen: Selection, run: int, members: list[int], size: Array) -> float | None:
    """Angle that gives steps of such sizes, rad, where only accelerometers that lie flat make them."""
    of = chosen.design.stack.blocks[run].run
    if not of.still or any(c not in ACCELS for c in members):
        return None
    gravity = np.abs(sensed(of, slice(0, 1)).reading[0]) / of.site.gravity
    if any(gravity[c] > _VERTICAL for c in members):
        return None
    return float(np.linalg.norm(size)) / of.site.gravity


# -------------------------------------------------------------------------------------------------------------- drift


def _drift(chosen: Selection, rows: Rows, drift: CommonDrift) -> CommonCause:
    parts = []
    for run in range(len(rows.residual)):
        own = [s for s in rows.stretches if s.run == run]
        if own:
            span = own[0].first, own[-1].end
            t, course = _course(rows, run, *span, list(drift.channels), drift.weights, drift.size * drift.correlation)
            parts.append((np.full(t.size, run), t, course - np.mean(course) if course.size else course))
    run_of, t, course = (np.concatenate(own) for own in zip(*parts, strict=True))
    drifting = any(chosen.design.drift[c].level > 0.0 for c in drift.channels)
    return CommonCause(
        kind="drift" if drifting else "remainder",
        channels=drift.channels,
        coherence=drift.coherence,
        start=float(t.min()),
        end=float(t.max()),
        stays=True,
        run=run_of,
        t=t,
        course=course,
        size=drift.size * drift.correlation,
        sd=drift.size * drift.correlation_sd,
        p=drift.p,
    )


def _course(
    rows: Rows, run: int, first: int, end: int, channels: list[int], weights: Array, size: Array
) -> tuple[Array, Array]:
    """Time and weighted sum of channels over rows `first` to `end` of a run, in at most `_POINTS` means.

    `size` is what is shared in each channel: it tells what those that a row has are worth without the others.
    """
    x = rows.residual[run][first:end, channels]
    there = np.isfinite(x)
    level = np.where(there, x, 0.0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    worth = there @ (weights * size / size[0])
    number = np.arange(len(x)) // max(1, -(-len(x) // _POINTS))
    good = worth > 0.0
    value = np.where(there, x - level, 0.0) @ weights / np.where(good, worth, 1.0)
    count = np.bincount(number, good)
    have = count > 0
    t = np.bincount(number, good * (first + np.arange(len(x)) + 0.5) * rows.period)[have] / count[have]
    return t, np.bincount(number, value)[have] / count[have]


_SAME_S = 5.0  # a channel's step within this of a common event's start or end is that event


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
    return {
        "kind": cause.kind,
        "label": label(cause),
        "channels": [CHANNELS[c] for c in cause.channels],
        "coherence": cause.coherence,
        "t_start_s": cause.start,
        "t_end_s": cause.end,
        "curve": {"t_s": cause.t.tolist(), "y": (cause.course / si).tolist(), "run": own if len(names) > 1 else None},
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
        "run": names[0] if len(names) == 1 else None,
    }


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

"""Errors that the units of a batch show together: steps, drifts, a tilt, tones. They are the table's or the room's.

All units stand on one table and one computer stamps their samples: residuals in the table's axes, on one clock, take
the place that channels of one unit have in `filters.tracing.common_steps` and `common_drift`. An error is common where
a quorum of the units shows it in the same sense.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal, TypedDict, cast

import numpy as np
from scipy import stats

from filters.channels import error_unit
from filters.tracing import common_drift, common_steps
from filters.tracing.common_rows import Rows, Stretch
from filters.types import Array
from imutui.jobs.campaign.unit_at_rest import AXES, Tone, UnitAtRest
from imutui.jobs.quantities import utc_text

FALSE = 1e-3  # probability of any step, any drift, any tilt of units that have nothing in common
_AT_ONCE = 6  # units that are compared at once, as many as a unit has channels; more are compared in groups
_LEAST = 32  # rows of a stretch
_MAD = 1.482602218505602
_SAME_ROWS = 4  # steps of axes, or of groups, within this are one
_SHOWS_SD = 2.0  # of a step that others make for certain: from here a unit makes it too
_IN_STEP = 0.7  # mean resultant of two units' phases from which their tones are one
_SMOOTH = 30  # rows
_FOLLOWS, _VARIES_K = 0.9, 0.2  # correlation with a temperature that varies so much: the drift follows it
_OWN = 3.0  # times what is usual among the units: what a unit does by itself
_WINDOW, _FEWEST = 10, 3  # rows, and windows of them
_EVEN_DOF = 4  # degrees of freedom that the sheet's limits count as

Kind = Literal["tilt", "gravity", "event", "drift", "tone", "noise"]


class SizeField(TypedDict):
    """How much of an error there is along one of the table's axes: the median over the units, of a tilt their mean.

    `sd` is that of a tilt, by the units' scatter; None of others.
    """

    axis: str
    value: float
    unit: str
    sd: float | None


class CommonField(TypedDict):
    """An error that units show together; `units` are those by serial number, `sizes` along the table's axes.

    `tilt_deg` is about north and east; of a drift `sizes` are standard deviations, of a tone root mean squares, of
    noise densities. `in_step` says whether a tone has one phase in all units, `told_apart` of a tilt whether mountings
    tell it from a bias that all units have; both None where not known or not asked. `p` is the probability by chance.
    """

    kind: Kind
    units: list[str]
    sizes: list[SizeField]
    start_utc: str | None
    end_utc: str | None
    tilt_deg: list[float] | None
    hz: float | None
    in_step: bool | None
    follows_temperature: bool | None
    told_apart: bool | None
    p: float | None


def quorum(units: int) -> int:
    """How many of so many units have to show an error for it to be common: all of two or three, else three of four."""
    return max(2, units - units // 4)


def found_in(units: Sequence[UnitAtRest], period: float) -> list[CommonField]:
    """Return what units, with rows of `period` s, show together: statics first, then by time."""
    if len(units) < 2:
        return []
    groups = [part.tolist() for part in np.array_split(np.arange(len(units)), -(-len(units) // _AT_ONCE))]
    steps, drifts = list[_Step](), list[_Drift]()
    origin = min(unit.first for unit in units)
    for axis in range(len(AXES)):
        for group in groups:
            rows = _rows([units[u] for u in group], origin, axis, period)
            made, rows = common_steps.common_steps(rows)
            steps += [_step(axis, group, *pair) for pair in common_steps.pairs(made)]
            for one in common_drift.common_drifts(rows):
                shared = (one.size * one.correlation).tolist()
                sizes = {group[c]: size for c, size in zip(one.channels, shared, strict=True)}
                drifts.append(_Drift(axis, sizes, one.p))
    tests = len(AXES) * len(groups)
    return [
        *_statics(units),
        *_events(units, steps, tests, origin, period),
        *_drifts(units, drifts, tests),
        *_tones(units),
    ]


def entry(
    kind: Kind, units: Sequence[str], sizes: dict[int, float], sd: float | None = None, **told: Any
) -> CommonField:
    """An entry with what is told of it, sizes and their standard deviation by the number of the axis, SI; else None."""
    fields: Any = dict.fromkeys(CommonField.__annotations__) | {"kind": kind, "units": list(units), "sizes": []}
    for axis, value in sizes.items():
        unit, si = error_unit(axis)
        own_sd = None if sd is None else sd / si
        fields["sizes"].append({"axis": AXES[axis], "value": value / si, "unit": unit, "sd": own_sd})
    return cast("CommonField", fields | told)


def _rows(units: Sequence[UnitAtRest], origin: int, axis: int, period: float) -> Rows:
    """One axis of up to six units as common causes are sought in; no step is sought across a motion of the table."""
    end = max(unit.first + len(unit.rows) for unit in units)
    residual = np.full((end - origin, _AT_ONCE), np.nan)
    for column, unit in enumerate(units):
        residual[unit.first - origin : unit.first - origin + len(unit.rows), column] = unit.rows[:, axis]
    white = np.full(_AT_ONCE, np.nan)
    for column in range(len(units)):
        steps = np.diff(residual[:, column])
        known = np.abs(steps[np.isfinite(steps)])
        white[column] = 0.5 * (_MAD * np.median(known)) ** 2 if known.size else np.nan
    have = np.isfinite(residual).any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], have, [False]]).astype(int))).reshape(-1, 2).tolist()
    stretches = tuple(Stretch(0, a, b) for a, b in edges if b - a >= _LEAST)
    channels = tuple(c for c in range(len(units)) if white[c] > 0.0)
    return Rows(period, channels, (residual,), white, stretches)


# -------------------------------------------------------------------------------------------------------------- events


@dataclass(frozen=True, slots=True)
class _Step:
    """A step, or two that undo each other, along one axis in a group of units."""

    axis: int
    row: int
    back: int | None
    width: int
    sizes: dict[int, float]  # by the unit's number, of those that make it, SI
    p: float


def _step(
    axis: int, group: Sequence[int], start: common_steps.CommonStep, back: common_steps.CommonStep | None
) -> _Step:
    surest = max(start.channels, key=lambda c: float(abs(start.size[c]) / start.sd[c]))
    sense = np.sign(start.size[surest])
    sizes = {
        u: float(start.size[c])
        for c, u in enumerate(group)
        if np.isfinite(start.sd[c]) and sense * start.size[c] > _SHOWS_SD * start.sd[c]
    }
    return _Step(axis, start.row, None if back is None else back.row, start.width, sizes, start.p)


def _events(
    units: Sequence[UnitAtRest], steps: Sequence[_Step], tests: int, origin: int, period: float
) -> Iterator[CommonField]:
    """Steps of all axes and groups put together by time; those that a quorum makes in one sense, along any axis."""
    left = sorted(steps, key=lambda step: step.row)
    while left:
        first = left[0]
        near = [s for s in left if s.row - first.row <= max(_SAME_ROWS, s.width, first.width)]
        left = [s for s in left if s not in near]
        sizes, members = dict[int, float](), set[int]()
        for axis in sorted({step.axis for step in near}):
            own = {u: size for step in near if step.axis == axis for u, size in step.sizes.items()}
            sense = np.sign(np.median(list(own.values()))) if own else 0.0
            own = {u: size for u, size in own.items() if size * sense > 0.0}
            if len(own) >= quorum(len(units)):
                sizes[axis], members = float(np.median(list(own.values()))), members | set(own)
        surest = min(near, key=lambda step: step.p)
        if not sizes or surest.p * tests > FALSE:
            continue
        yield entry(
            "event",
            [units[u].name for u in sorted(members)],
            sizes,
            start_utc=_utc(origin + surest.row, period),
            end_utc=None if surest.back is None else _utc(origin + surest.back, period),
            tilt_deg=_tilt(sizes.get(3, 0.0), sizes.get(4, 0.0), units[0].gravity) if set(sizes) <= {3, 4} else None,
            p=surest.p,
        )


def _tilt(north: float, east: float, gravity: float) -> list[float]:
    """Tilt about north and east, deg, as the effect `tilt` counts it, that gives such errors of specific force."""
    return [float(np.rad2deg(east / gravity)), float(np.rad2deg(-north / gravity))]


def _utc(row: int, period: float) -> str:
    return utc_text(round(row * period * 1e9))


# -------------------------------------------------------------------------------------------------------------- drifts


@dataclass(frozen=True, slots=True)
class _Drift:
    """A drift along one axis that a group of units shares."""

    axis: int
    sizes: dict[int, float]  # by the unit's number, of those that share it, signed, SI
    p: float


def _drifts(units: Sequence[UnitAtRest], drifts: Sequence[_Drift], tests: int) -> Iterator[CommonField]:
    for axis in sorted({drift.axis for drift in drifts}):
        near = [drift for drift in drifts if drift.axis == axis]
        lead = min(near, key=lambda drift: drift.p)
        sense = np.sign(np.median(list(lead.sizes.values())))
        members = {u: abs(size) for drift in near for u, size in drift.sizes.items() if size * sense > 0.0}
        if len(members) < quorum(len(units)) or lead.p * tests > FALSE:
            continue
        own = [units[u] for u in sorted(members)]
        yield entry(
            "drift",
            [unit.name for unit in own],
            {axis: float(np.median(list(members.values())))},
            follows_temperature=_follows_temperature(own, axis),
            p=lead.p,
        )


def _follows_temperature(units: Sequence[UnitAtRest], axis: int) -> bool:
    """Whether the mean course of units along an axis is that of their mean temperature."""
    course, temperature = (_mean_course(units, column) for column in (axis, None))
    known = np.isfinite(course) & np.isfinite(temperature)
    if known.sum() < 2 * _SMOOTH or np.ptp(temperature[known]) < _VARIES_K:
        return False
    return abs(float(np.corrcoef(course[known], temperature[known])[0, 1])) > _FOLLOWS


def _mean_course(units: Sequence[UnitAtRest], axis: int | None) -> Array:
    """Mean of the units' departures from their own means, smoothed; of the temperature for None."""
    origin, end = min(u.first for u in units), max(u.first + len(u.rows) for u in units)
    total, count = np.zeros(end - origin), np.zeros(end - origin)
    for unit in units:
        x = unit.temperature if axis is None else unit.rows[:, axis]
        good = np.isfinite(x)
        place = np.flatnonzero(good) + unit.first - origin
        total[place] += x[good] - x[good].mean() if good.any() else 0.0
        count[place] += 1.0
    kernel = np.ones(_SMOOTH)
    weight = np.convolve(count, kernel, "same")
    return np.where(weight > 0.5 * _SMOOTH, np.convolve(total, kernel, "same") / np.maximum(weight, 1.0), np.nan)


def by_themselves(units: Sequence[UnitAtRest]) -> dict[str, list[str]]:
    """Axes along which a unit moves by itself, by its name: beside the median of the others, which has what is common.

    A unit does if means over ten rows of the difference vary three times as much, over its white noise, as is usual.
    """
    if len(units) < 4:
        return {}
    found: dict[str, list[str]] = {}
    origin, end = min(u.first for u in units), max(u.first + len(u.rows) for u in units)
    for axis in range(len(AXES)):
        rows = np.full((end - origin, len(units)), np.nan)
        for u, unit in enumerate(units):
            known = unit.rows[:, axis]
            level = np.median(known[np.isfinite(known)]) if np.isfinite(known).any() else 0.0
            rows[unit.first - origin : unit.first - origin + len(known), u] = known - level
        ratio = np.array([_beside(rows[:, u], np.delete(rows, u, axis=1)) for u in range(len(units))])
        for u in np.flatnonzero(ratio > _OWN * max(1.0, float(np.median(ratio)))).tolist():
            found.setdefault(units[u].name, []).append(AXES[axis])
    return found


def _beside(own: Array, others: Array) -> float:
    """Standard deviation of means over ten rows beside the others' median, over that of white noise; 0 if not known."""
    good = np.isfinite(own) & (np.isfinite(others).sum(axis=1) > 1)
    windows = int(good.sum()) // _WINDOW
    if windows < _FEWEST:
        return 0.0
    x = own[good] - np.nanmedian(others[good], axis=1)
    white = _MAD * float(np.median(np.abs(np.diff(x)))) / np.sqrt(2.0 * _WINDOW)
    means = x[: windows * _WINDOW].reshape(windows, _WINDOW).mean(axis=1)
    return float(np.std(means) / max(white, 1e-300))


# ------------------------------------------------------------------------------------------------------------- statics


def _statics(units: Sequence[UnitAtRest]) -> Iterator[CommonField]:
    """A tilt of the table, and a gravity that is not that of the site: what accelerometers read wrongly in common.

    Without one, biases of units scatter about none: the mean over units is held against their scatter (F test). Few
    units tell little of a scatter: what biases that fill the limits of the sheet evenly would have counts as some units
    more. A unit farther from the median than two that are within their sheet can be from each other takes no part.
    """
    known = [unit for unit in units if np.isfinite(unit.level).all()]
    for kind, axes in (("tilt", [0, 1]), ("gravity", [2])):
        middle = np.median([unit.level for unit in known], axis=0) if known else np.zeros(3)
        own = [u for u in known if (np.abs(u.level - middle)[axes] <= 2.0 * u.bias_limit).all()]
        if len(own) < max(3, quorum(len(units))):
            continue
        p = _chance(own, axes)
        if p > FALSE or not _is_the_tables(own, axes):
            continue
        mean = np.mean([u.level for u in own], axis=0)
        yield entry(
            kind,  # type: ignore[arg-type]
            [unit.name for unit in own],
            {3 + a: float(mean[a]) for a in axes},
            (_scatter(own, axes)[0] / len(own)) ** 0.5,
            tilt_deg=_tilt(mean[0], mean[1], own[0].gravity) if kind == "tilt" else None,
            told_apart=len({str(u.to_reading) for u in own}) > 1,
            p=p,
        )


def _scatter(units: Sequence[UnitAtRest], axes: list[int]) -> tuple[float, int]:
    """Variance of the units' levels about their mean, along each of axes, m²/s⁴, and its degrees of freedom."""
    x = np.array([unit.level[axes] for unit in units])
    even, free = float(np.mean([unit.bias_limit**2 for unit in units])) / 3.0, len(axes) * (len(units) - 1)
    return (float(np.sum((x - x.mean(axis=0)) ** 2)) + _EVEN_DOF * even) / (free + _EVEN_DOF), free + _EVEN_DOF


def _chance(units: Sequence[UnitAtRest], axes: list[int]) -> float:
    """Probability that the mean of the units' levels is so large by chance, where they scatter about none."""
    mean = np.mean([unit.level[axes] for unit in units], axis=0)
    scatter, free = _scatter(units, axes)
    return float(stats.f.sf(len(units) * float(mean @ mean) / len(axes) / scatter, len(axes), free))


def _is_the_tables(units: Sequence[UnitAtRest], axes: list[int]) -> bool:
    """Whether what units have in common is nearer to one thing in the table's axes than in their own."""
    here = np.array([u.level[axes] for u in units])
    common = np.zeros(3)
    common[axes] = here.mean(axis=0)
    shared = np.array([u.to_reading @ common for u in units])
    own = np.array([u.to_reading @ u.level for u in units])
    rival = float(np.sum((own - own.mean(axis=0)) ** 2))
    return rival >= float(np.sum((own - shared - (own - shared).mean(axis=0)) ** 2)) * (1.0 - 1e-9)


# --------------------------------------------------------------------------------------------------------------- tones


def _tones(units: Sequence[UnitAtRest]) -> Iterator[CommonField]:
    """Lines at one frequency along one axis in a quorum of units."""
    left = sorted(((tone.hz, u, tone) for u, unit in enumerate(units) for tone in unit.tones), key=lambda one: one[:2])
    while left:
        hz, _, tone = left[0]
        near = [one for one in left if one[0] - hz <= max(2.0 * tone.resolution_hz, 2e-3 * hz)]
        left = [one for one in left if one not in near]
        own = {u: one for _, u, one in near}
        axes = [a for a in range(len(AXES)) if sum(a in one.axes for one in own.values()) >= quorum(len(units))]
        if axes:
            sizes = {a: float(np.median([one.rms[a] for one in own.values() if a in one.axes])) for a in axes}
            frequency = float(np.median([one.hz for one in own.values()]))
            step = _in_step(list(own.values()), frequency)
            yield entry("tone", [units[u].name for u in sorted(own)], sizes, hz=frequency, in_step=step)


def _in_step(tones: Sequence[Tone], hz: float) -> bool | None:
    """Whether tones keep their phases to each other; None where phases are not known."""
    turned = [
        dict(zip(tone.segments.tolist(), tone.at(hz).tolist(), strict=True)) for tone in tones if tone.segments.size
    ]
    alike = []
    for a, b in combinations(turned, 2):
        both = sorted(a.keys() & b.keys())
        if len(both) >= 4:
            x, y = (np.array([one[k] for k in both]) for one in (a, b))
            alike.append(abs(np.vdot(x, y)) / np.sqrt(np.vdot(x, x).real * np.vdot(y, y).real))
    return bool(np.median(alike) > _IN_STEP) if alike else None

"""Rows in order of time: repeated rows left out, swapped ones put in order, a clock that was set back made to go on.

All of it happens while rows stream through; each repair is counted, so that the import reports it, and a stamp that
cannot be right is refused with the option that drops its row.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from imutui.logbook.importing.columns import Channel, factor
from imutui.logbook.importing.table import Asked, ImportDataError, Table

LEAST_STEP_S = 1e-6
GAP_S = 1.0
_HELD = 64  # rows that wait for those behind them
_WINDOWS = ((8, 0.5), (_HELD // 2, 0.75))
"""How many rows may stand out of order, and their least step in periods: that of a clock that was set back is half."""
_GAP = 20.0  # steps of so many periods are gaps
_EXCURSION = 100
_MOST_LISTED = 200
_LONGEST_S = 3.2e8
_SHARE = 0.05
_SLOWEST, _USUAL, _FASTEST = 1.5, 100.0, 2500.0
"""Rates in Hz that are believed of a column of time whose unit is not stated."""


class Dropped:
    """The rows that `--drop` names: `1500, 1600-1602`, or `1::2` for every second one from row 1 on."""

    def __init__(self, asked: Asked) -> None:
        self._ranges: list[tuple[int, int, int]] = []  # first, last, step
        for entry in filter(None, (part.strip() for part in asked.drop.split(","))):
            found = re.fullmatch(r"(\d{1,15})(?:-(\d{1,15})|::([1-9]\d{0,8}))?", entry)
            if not found:
                raise ImportDataError(
                    f'--drop has "{entry}", which is no row: --drop 1500, or --drop "1500, 1600-1602", or --drop 1::2.'
                )
            first = int(found[1])
            self._ranges.append((first, 2**62 if found[3] else int(found[2] or first), int(found[3] or 1)))

    def keeps(self, rows: np.ndarray) -> np.ndarray:
        """Return which rows stay, bool, shape (N,)."""
        kept = np.ones(rows.size, bool)
        for first, last, step in self._ranges:
            kept &= ~((rows >= first) & (rows <= last) & ((rows - first) % step == 0))
        return kept


@dataclass(slots=True)
class Repairs:
    """What was done to the rows of one pass, and bad stamps."""

    rows: int = 0  # of the file
    repeated: list[int] = field(default_factory=list)
    swapped: list[int] = field(default_factory=list)
    set_back: list[tuple[int, float]] = field(default_factory=list)  # row, s
    gaps: list[tuple[int, float, float]] = field(default_factory=list)  # row, length and end, s
    equal: int = 0
    # units, in_turn: units whose rows take turns, with equal stamps, and with stamps of their own
    units: int = 1
    in_turn: int = 1
    bad: dict[int, str] = field(default_factory=dict)  # stamps that cannot be right, by row
    end_t: float = 0.0  # of the last row that was read, s

    def keep(self, first: int, last: int, reasons: Mapping[int, str], dropped: Dropped) -> None:
        """Keep what concerns the rows from `first` to `last`; rows that cannot be read are bad too."""
        bad = {**self.bad, **reasons}
        self.bad = {
            row: words for row, words in bad.items() if first <= row <= last and dropped.keeps(np.array([row]))[0]
        }
        self.repeated = [row for row in self.repeated if first <= row <= last]
        self.set_back = [item for item in self.set_back if first <= item[0] <= last]
        self.gaps = [item for item in self.gaps if first < item[0] <= last]

    def assumed(self) -> list[str]:
        """Return what was assumed, in words."""
        out = []
        if self.repeated:
            out.append(f"left out {_rows(self.repeated)}, repeating earlier ones")
        if self.equal:
            out.append(f"{self.equal} rows had the stamp of the row before and were left out")
        if self.swapped:
            out.append(f"{_rows(self.swapped)} put in order of time")
        if self.set_back:
            row, step = self.set_back[0]
            times = f", and {len(self.set_back) - 1} more times" if len(self.set_back) > 1 else ""
            out.append(
                f"the clock was set back by {step:.6g} s at row {row}{times}: time goes on one period after the row"
                " before"
            )
        if self.gaps:
            row, step, _ = max(self.gaps, key=lambda gap: gap[1])
            out.append(f"{len(self.gaps)} gap(s) in time, the longest of {step:.6g} s before row {row}")
        return out


def _rows(rows: list[int]) -> str:
    return f"row {rows[0]}" if len(rows) == 1 else f"{len(rows)} rows (the first is {rows[0]})"


@dataclass(frozen=True, slots=True)
class Part:
    """Rows of a recording in its own units: t in s since the file's first row, the other channels by name."""

    t: np.ndarray
    row: np.ndarray
    values: dict[str, np.ndarray]

    def at(self, rows: np.ndarray | slice) -> "Part":
        """Some of the rows."""
        return Part(self.t[rows], self.row[rows], {name: column[rows] for name, column in self.values.items()})


def joined(parts: list[Part]) -> Part:
    """Rows of parts, one after another."""
    values = {name: np.concatenate([part.values[name] for part in parts]) for name in parts[0].values}
    return Part(np.concatenate([p.t for p in parts]), np.concatenate([p.row for p in parts]), values)


class Clock:
    """Time of rows since the first one, s; whole numbers of ns lose no digit.

    `first`: what the first row's own stamp is, s.
    """

    def __init__(self, channel: Channel) -> None:
        self.first = 0.0
        self._channel = channel
        self._origin: np.generic | None = None

    def seconds(self, stamps: np.ndarray) -> np.ndarray:
        """Return stamps of the file in s since its first one."""
        if self._origin is None and stamps.size:
            known = stamps[np.isfinite(stamps)] if stamps.dtype.kind == "f" else stamps
            self._origin = known[0] if known.size else stamps[0]
            self.first = float(self._channel.converted(np.array([self._origin]))[0])
        if self._origin is None:
            return np.empty(0)
        if self._channel.unit == "s" and stamps.dtype.kind == "f":
            return np.asarray(stamps - self._origin)
        return self._channel.converted(stamps - self._origin)


def streamed(
    table: Table, channels: Mapping[str, Channel], clock: Clock, dropped: Dropped
) -> Iterator[tuple[float, Part]]:
    """Yield the rows of a table as parts, without those that are dropped."""
    names = [name for name, channel in channels.items() if channel.column >= 0]
    row = 0
    for share, arrays in table.pieces([channels[name].column for name in names]):
        count = len(arrays[0])
        values = dict(zip(names, arrays, strict=True))
        rows = np.arange(row, row + count)
        row += count
        stamps = values.pop("t", rows)
        kept = dropped.keeps(rows)
        t = clock.seconds(stamps[kept])
        yield share, Part(t, rows[kept], {name: channels[name].converted(v[kept]) for name, v in values.items()})


def in_order(
    parts: Iterator[tuple[float, Part]], repairs: Repairs, table: Table, *, arrival: bool
) -> Iterator[tuple[float, Part]]:
    """Yield rows whose time increases; with `arrival`, it may also stand still."""
    held: Part | None = None
    period = behind = 0.0
    share = 0.0
    last = -np.inf
    before: Part | None = None
    for share, part in _and_end(parts):
        if part is not None:
            repairs.rows = max(repairs.rows, int(part.row[-1]) + 1 if part.row.size else 0)
            part = Part(part.t + behind if behind else part.t, part.row, part.values)
            held = part if held is None else joined([held, part])
            if not period:
                period, repairs.in_turn = _period(held.t), _units_in_turn(held, 3)
        if held is None or (part is not None and held.t.size <= 2 * _HELD):
            continue
        wait = 0 if part is None else _HELD // 2
        held, moved = _mended(held, before, period, repairs, table, arrival=arrival, wait=wait)
        behind += moved
        cut = held.t.size if part is None else held.t.size - _HELD
        out, held = held.at(slice(None, cut)), held.at(slice(cut, None))
        if out.t.size:
            _note_gaps(out, last, period, repairs)
            last, before = float(out.t[-1]), out.at(slice(-1, None))
            yield share, out


def _and_end(parts: Iterator[tuple[float, Part]]) -> Iterator[tuple[float, Part | None]]:
    yield from parts
    yield 1.0, None


def _period(t: np.ndarray) -> float:
    steps = np.diff(t)
    steps = steps[(steps > 0.0) & np.isfinite(steps)]
    if not steps.size:
        return 0.0
    usual = steps[steps <= max(GAP_S, _GAP * float(np.median(steps)))]
    # rows of equal stamps count too
    within = np.diff(t)
    count = int(np.count_nonzero((within >= 0.0) & (within <= usual.max())))
    return float(usual.sum()) / count


def _note_gaps(part: Part, last: float, period: float, repairs: Repairs) -> None:
    steps = np.diff(part.t, prepend=last if np.isfinite(last) else part.t[0])
    for k in np.flatnonzero(steps > max(GAP_S, _GAP * period)).tolist():
        repairs.gaps.append((int(part.row[k]), float(steps[k]), float(part.t[k])))


def _mended(
    part: Part, before: Part | None, period: float, repairs: Repairs, table: Table, *, arrival: bool, wait: int
) -> tuple[Part, float]:
    """Return rows in order but for the last `wait`, and by how much later ones are to be moved, s."""
    lead = 0 if before is None else 1
    part = part if before is None else joined([before, part])
    moved = 0.0
    unstamped = ~np.isfinite(part.t)
    for k in np.flatnonzero(unstamped).tolist():
        _note_bad(repairs, int(part.row[k]), table.reasons.get(int(part.row[k]), "has no stamp"))
    if unstamped.any():
        part = part.at(~unstamped)
    k = 0
    while True:
        back = np.flatnonzero(np.diff(part.t[k:]) < 0.0 if arrival else np.diff(part.t[k:]) <= 0.0)
        if not back.size or k + int(back[0]) >= part.t.size - wait:
            break
        k += int(back[0])
        if part.t[k + 1] == part.t[k]:
            part, k = _repeated(part, k, repairs)
            continue
        if (order := _near_order(part.t, k, period, lead)) is not None:
            repairs.swapped += [int(part.row[i]) for i in np.flatnonzero(order != np.arange(order.size))]
            part = part.at(order)
            continue
        if (wrong := _outlier(part.t, k, period)) is not None and wrong >= lead:
            off = float(part.t[wrong] - (part.t[wrong - 1] + period if wrong else part.t[1] - period))
            _note_bad(
                repairs,
                int(part.row[wrong]),
                f"is {abs(off):.6g} s {'later' if off > 0 else 'earlier'} than the rows around it",
            )
            part = part.at(np.arange(part.t.size) != wrong)
            k = max(k - 1, 0)
            continue
        if (first := _excursion(part.t, k, period)) is not None and first >= lead:
            off = float(part.t[first] - part.t[first - 1])
            for row in part.row[first : k + 1].tolist():
                _note_bad(repairs, row, f"is {off:.6g} s later than the rows around it")
            part = part.at(np.r_[0:first, k + 1 : part.t.size])
            k = max(first - 2, 0)
            continue
        if count := _copied(part, k):
            repairs.repeated += part.row[k + 1 : k + 1 + count].tolist()
            part = part.at(np.r_[0 : k + 1, k + 1 + count : part.t.size])
            continue
        step = float(part.t[k] - part.t[k + 1])
        repairs.set_back.append((int(part.row[k + 1]), step + period))
        part.t[k + 1 :] += step + period
        moved += step + period
        if len(repairs.set_back) > max(20, _SHARE * repairs.rows):
            break
        k += 1
    return part.at(slice(lead, None)), moved


def _repeated(part: Part, k: int, repairs: Repairs) -> tuple[Part, int]:
    """Leave out a row that repeats the one before; another one with an equal stamp is counted, and left out too."""
    same = all(
        column[k] == column[k + 1] or (column[k] != column[k] and column[k + 1] != column[k + 1])
        for column in part.values.values()
    )
    if same:
        repairs.repeated.append(int(part.row[k + 1]))
        return part.at(np.arange(part.t.size) != k + 1), k
    # all stamps that stand still in this part at once: there may be very many
    still = np.r_[False, np.diff(part.t) == 0.0]
    repairs.units = max(repairs.units, _units_in_turn(part, 1))
    repairs.equal += int(np.count_nonzero(still))
    return part.at(~still), k


def _units_in_turn(part: Part, fewest: int) -> int:
    """Return how many units' rows take turns: rows that far apart are more alike than neighbours. 1 if none do.

    `fewest`: channels in which they are.
    """
    known = [column for column in part.values.values() if np.isfinite(column).all()]
    for count in (2, 3, 4):
        alike = [
            np.median(np.abs(np.diff(c))) > 3.0 * np.median(np.abs(c[count:] - c[:-count]))
            for c in known
            if c.size > 20 * count
        ]
        if sum(alike) >= fewest:
            return count
    return 1


def _near_order(t: np.ndarray, k: int, period: float, lead: int) -> np.ndarray | None:
    """Return the order of rows if the few around k are swapped: in order, their steps are as regular as others."""
    for near, least in _WINDOWS:
        window = slice(max(lead, k - near), k + 2 + near)
        order = np.argsort(t[window], kind="stable")
        steps = np.diff(t[window][order])
        if steps.size >= 2 and steps.min() >= least * period and steps.max() <= 2.0 * period:
            out = np.arange(t.size)
            out[window] = out[window][order]
            return out
    return None


def _outlier(t: np.ndarray, k: int, period: float) -> int | None:
    """Return the row with a stamp of its own, if time goes on behind it as if it were not there."""
    for wrong in (k, k + 1):
        if wrong == 0 and t.size > 2 and 0.0 < t[2] - t[1] <= 3.0 * period and t[0] > t[1] + 3.0 * period:
            return 0
        if 0 < wrong < t.size - 1 and 0.0 < t[wrong + 1] - t[wrong - 1] <= 3.0 * period:
            return wrong
    return None


def _excursion(t: np.ndarray, k: int, period: float) -> int | None:
    """Return the first of a few rows up to k that are later than all others, if time then goes on as without them."""
    near = np.diff(t[max(0, k - _EXCURSION) : k + 1])
    jumps = np.flatnonzero(near > max(GAP_S, _GAP * period))
    if not jumps.size:
        return None
    first = max(0, k - _EXCURSION) + int(jumps[-1]) + 1
    return first if 0.0 < t[k + 1] - t[first - 1] <= (k + 4 - first) * period else None


def _copied(part: Part, k: int) -> int:
    """Return how many rows from k + 1 on are copies of earlier ones, up to row k, with their stamps."""
    for first in np.flatnonzero(part.t[: k + 1] == part.t[k + 1]).tolist():
        count = min(k + 1 - first, part.t.size - k - 1)
        columns = (part.t, *part.values.values())
        if all(np.array_equal(c[first : first + count], c[k + 1 : k + 1 + count], equal_nan=True) for c in columns):
            return count
    return 0


def _note_bad(repairs: Repairs, row: int, words: str) -> None:
    repairs.bad.setdefault(row, words)


def check_order(table: Table, asked: Asked, repairs: Repairs, clock: Channel) -> None:
    """Refuse rows that cannot be read, and stamps that are in no order or too coarse.

    Raises ImportDataError with a command that works.
    """
    path = table.path
    rows = sorted(repairs.bad)
    if rows and len(rows) <= max(3, _SHARE * repairs.rows):
        more = f" ({len(rows)} such rows)" if len(rows) > 1 else ""
        what = f"{path}: row {rows[0]} (first is 0) {repairs.bad[rows[0]]}{more}."
        if len(rows) > _MOST_LISTED:
            raise ImportDataError(f"{what} Mend them in the program that wrote them.")
        again = asked.command(path, drop=", ".join(map(str, rows)))
        raise ImportDataError(f"{what} To leave {'it' if len(rows) == 1 else 'them'} out: `{again}`")
    for row, step, t in repairs.gaps:
        if step > _LONGEST_S:
            again = asked.command(path, end=f"{t - 0.5 * step:.3f}")
            raise ImportDataError(
                f"{path}: row {row} (first is 0) is {step:.6g} s later than the row before, more than ten years. To"
                f" take the rows before it: `{again}`"
            )
    by_row = asked.command(path, columns="t=row:100Hz")
    share = 100.0 * repairs.equal / max(1, repairs.rows)
    if share > 99.0:
        raise ImportDataError(
            f"{path}: the stamps of {repairs.equal} of {repairs.rows} rows equal the one before: they are too coarse to"
            f" be times. If rows are equally spaced, give their rate (100 Hz here): `{by_row}`"
        )
    units = max(repairs.units if repairs.equal > max(2, 0.002 * repairs.rows) else 1, repairs.in_turn)
    if units > 1:
        others = ", ".join(f"{k}::{units}" for k in range(1, units))
        raise ImportDataError(
            f"{path}: rows of {units} units take turns. To take those of the first:"
            f" `{asked.command(path, drop=others)}`"
        )
    if repairs.equal > max(2, 0.002 * repairs.rows):
        raise ImportDataError(
            f"{path}: the stamps of {share:.0f} % of rows equal the one before: they are rounded, or come in bursts."
            f" To fit sampling instants under them: `{asked.command(path, stamps='arrival')}`"
        )
    if len(repairs.set_back) + len(rows) > max(20, _SHARE * repairs.rows):
        first = repairs.set_back[0][0] if repairs.set_back else rows[0]
        if first in table.reasons:
            what = f"row {first} (first is 0) {table.reasons[first]}, and many more are like it"
        else:
            what = f"time does not increase at row {first}, and at many more: no order of its rows is known"
        name = "row" if clock.column < 0 else table.columns[clock.column].name or f"#{clock.column + 1}"
        if first in table.reasons and f"column `{name}`" not in what:
            raise ImportDataError(f"{path}: {what}. Mend them in the program that wrote them.")
        raise ImportDataError(f"{path}: {what}. If rows are equally spaced, give their rate (100 Hz here): `{by_row}`")


class TimeUnit(NamedTuple):
    """A unit of time that fits better than the one that was assumed; "" for none."""

    unit: str = ""
    why: str = ""
    ratio: float = 1.0  # of it to the one that was assumed


def fitting_unit(table: Table, asked: Asked, clock: Channel, rate: float, length: float) -> TimeUnit:
    """Return the unit of time that fits a rate (Hz) and a length (s), by the unit of `clock`.

    Raises ImportDataError with a command that works if none fits.
    """
    path = table.path
    if not clock.stated and not _SLOWEST <= rate <= _FASTEST:
        own = (factor("t", clock.unit) or (1.0, 0.0))[0]
        per_unit = rate * own  # rows per unit of time
        rates = {unit: per_unit / scale for unit, scale in SCALES.items() if _SLOWEST <= per_unit / scale <= _FASTEST}
        if rates:
            unit = min(rates, key=lambda unit: abs(np.log(rates[unit] / _USUAL)))
            why = f"`t` would give {rate:.4g} Hz if it were in {clock.unit}, and {rates[unit]:.4g} Hz in {unit}"
            if rate >= 0.9:  # as likely
                why += f" (if it is in {clock.unit}: --units t:{clock.unit})"
            return TimeUnit(unit, why, SCALES[unit] / own)
        if rate * LEAST_STEP_S < 1.0:
            raise ImportDataError(
                f"{path}: `t` would give {rate:.4g} Hz if it were in {clock.unit}, as its unit is not stated. If it is"
                f" nevertheless: `{asked.command(path, units=f't:{clock.unit}')}`"
            )
    if rate * LEAST_STEP_S > 1.0:
        raise ImportDataError(
            f"{path}: rows are {1.0 / rate:.1e} s apart, less than a microsecond: `t` has another unit. If rows are"
            f" equally spaced, give their rate (100 Hz here): `{asked.command(path, columns='t=row:100Hz')}`"
        )
    if length > _LONGEST_S:
        raise ImportDataError(
            f"{path} lasts {length:.3g} s, more than ten years: `t` is not in {clock.unit}. If it is in ns:"
            f" `{asked.command(path, units='t:ns')}`"
        )
    return TimeUnit()


SCALES = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0}

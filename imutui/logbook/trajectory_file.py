"""A known motion as text: CSV of `t, lat, lon, h, vn, ve, vd[, roll, pitch, yaw]`, empty cells where nothing is known.

The form in which a reference lies beside a recording or travels in a log; docs/formats.md.
"""

import csv
import io
from collections.abc import Sequence

import numpy as np

from filters.errors import InputError
from filters.motion.reference import Trajectory

COLUMNS = ("t", "lat", "lon", "h", "vn", "ve", "vd", "roll", "pitch", "yaw")
_REQUIRED = COLUMNS[:7]
_DEGREES = ("lat", "lon", "roll", "pitch", "yaw")
_SCALE = np.array([np.pi / 180.0 if name in _DEGREES else 1.0 for name in COLUMNS[1:]])
# 1e-10 deg is 11 um on the ground; 1e-8 deg of attitude is far below what any reference knows
_DIGITS = dict.fromkeys(("lat", "lon"), 10) | dict.fromkeys(("roll", "pitch", "yaw"), 8) | {"t": 9, "h": 5}
_NUMBERS = (-1e9, 1e9)
_LIMITS = {"lat": (-90.0, 90.0), "lon": (-180.0, 360.0), "pitch": (-90.0, 90.0)}


def parse(text: str, name: str) -> Trajectory:
    """Trajectory from CSV text.

    `text`: first row names the columns, in any order; roll, pitch, yaw may be absent.
    `name`: of the file, for messages.
    Raises InputError if a column is missing, unknown or named twice, a cell is no number or outside its range, or time
      does not increase.
    """
    columns = table(text, name, COLUMNS, _REQUIRED, empty=True)
    unknown = np.full(columns["t"].size, np.nan)
    values = np.column_stack([columns.get(column, unknown) for column in COLUMNS[1:]])
    return Trajectory(columns["t"], values * _SCALE)


def table(text: str, name: str, known: Sequence[str], required: Sequence[str], *, empty: bool) -> dict[str, np.ndarray]:
    """Columns of CSV text by name, of which `t` is time.

    `known`, `required`: columns that there may be, and must.
    `empty`: whether cells may be; they are NaN then.
    Raises InputError as `parse`.
    """
    try:
        reader = csv.reader(io.StringIO(text.lstrip("\ufeff")))
        rows = [(number, row) for number, row in enumerate(reader, 1) if (row if empty else any(map(str.strip, row)))]
    except csv.Error as error:
        raise InputError(f"{name} is not CSV text ({error}).") from error
    if not rows:
        raise InputError(f"{name} is empty. Its first row must name the columns: {', '.join(known)}.")
    names = [cell.strip() for cell in rows[0][1]]
    _check_names(names, f"{name}, line {rows[0][0]}", known, required)
    lines = [number for number, _ in rows[1:]]
    for number, row in rows[1:]:
        if len(row) != len(names):
            raise InputError(f"{name}, line {number}: {len(row)} cells where the first row names {len(names)}.")
    if not lines:
        raise InputError(f"{name} has column names and no rows.")
    cells = {column: [row[i].strip() for _, row in rows[1:]] for i, column in enumerate(names)}
    columns = {column: _numbers(cells[column], column, lines, name, empty=empty) for column in names}
    _check_time(columns["t"], lines, name)
    return columns


def format(trajectory: Trajectory) -> str:  # noqa: A001 - the pair of parse
    """CSV text of a trajectory: degrees, m, m/s; what `parse` reads."""
    table = np.column_stack([trajectory.t, trajectory.values / _SCALE])
    digits = [_DIGITS.get(column, 6) for column in COLUMNS]
    lines = [",".join(map(_cell, row, digits)) for row in table.tolist()]
    return "\n".join([",".join(COLUMNS), *lines]) + "\n"


def _cell(value: float, digits: int) -> str:
    if value != value:  # NaN
        return ""
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _check_names(names: list[str], where: str, known: Sequence[str], required: Sequence[str]) -> None:
    for column in names:
        if column not in known:
            raise InputError(f'{where}: unknown column "{column}". Columns are: {", ".join(known)}.')
        if names.count(column) > 1:
            raise InputError(f"{where}: column `{column}` is named twice.")
    if missing := [column for column in required if column not in names]:
        raise InputError(
            f"{where}: no column `{missing[0]}`. Columns are: {', '.join(known)}"
            + ("; only roll, pitch, yaw may be absent, and cells may be empty." if known is COLUMNS else ".")
        )


def _numbers(cells: list[str], column: str, lines: list[int], name: str, *, empty: bool) -> np.ndarray:
    filled = [cell or "nan" for cell in cells]
    try:
        out = np.array(filled).astype(float)
    except ValueError:
        out = np.array([_number(cell, column, line, name) for cell, line in zip(filled, lines, strict=True)])
    bad = np.isinf(out) | (np.isnan(out) if column == "t" or not empty else False)
    if bad.any():
        row = int(np.argmax(bad))
        raise InputError(f'{name}, line {lines[row]}, column `{column}`: "{cells[row]}" is not a number.')
    low, high = _LIMITS.get(column, _NUMBERS)
    outside = (out < low) | (out > high)
    if outside.any():
        row = int(np.argmax(outside))
        raise InputError(f"{name}, line {lines[row]}, column `{column}`: {out[row]:g} is outside {low:g} to {high:g}.")
    return out


def _number(cell: str, column: str, line: int, name: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise InputError(f'{name}, line {line}, column `{column}`: "{cell}" is not a number.') from None


def _check_time(t: np.ndarray, lines: list[int], name: str) -> None:
    bad = np.flatnonzero(~(np.diff(t) > 0.0))
    if bad.size:
        k = int(bad[0]) + 1
        raise InputError(
            f"{name}, line {lines[k]}, column `t`: time does not increase: {t[k - 1]:g} s, then {t[k]:g} s."
        )

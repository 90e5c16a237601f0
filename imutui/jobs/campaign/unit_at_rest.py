"""What a unit's logs show while the table rests: residuals in the table's axes by the second, level, tones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from filters import specification
from filters.errors import InputError
from filters.imu import AxisMap
from filters.tracing import line_search
from filters.tracing.residual import attitude_and_rate, residual
from filters.tracing.run import Run
from filters.types import Array
from imutui.jobs import runs
from imutui.logbook import summary
from imutui.logbook.reading import Reading

AXES = ("wx", "wy", "wz", "fx", "fy", "fz")
"""The table's axes: rates about and specific forces along north, east and down of a table at zero."""
_MOST_ROWS = 20_000
_OWN_LEVEL = ("gravity", "turned")  # references that take a tilt for the unit's own attitude
_SEGMENT_S = 2.0  # over which the phase of a tone is taken


@dataclass(frozen=True, slots=True)
class Tone:
    """A line of one unit."""

    hz: float
    resolution_hz: float
    axes: tuple[int, ...]  # of the table, that have it
    rms: Array  # along the table's axes, SI, shape (6,)
    segments: NDArray[np.int_]  # numbers since 1970, shape (k,)
    amplitude: NDArray[np.complex128]  # in each, of time since 1970, shape (k,)

    def at(self, hz: float) -> NDArray[np.complex128]:
        """Amplitude of a frequency near its own, shape (k,)."""
        return np.asarray(self.amplitude * np.exp(2j * np.pi * (self.hz - hz) * (self.segments + 0.5) * _SEGMENT_S))


@dataclass(frozen=True, slots=True)
class UnitAtRest:
    """A unit."""

    name: str
    first: int  # number of its first row since 1970
    rows: Array  # mean residual of each row, SI, shape (n, 6), NaN where there is none, or the table turns
    temperature: Array  # of each row, degC, shape (n,), NaN where it is not known
    level: Array  # mean residual of specific force over its first rest, north-east-down, m/s², NaN where not known
    still: bool  # whether the table rests throughout
    to_reading: Array  # from north-east-down at that rest to the instrument's axes and sign, shape (3, 3)
    channel_axes: tuple[int, ...]  # which of the table's axes each channel lies along, (6,)
    tones: tuple[Tone, ...]
    gravity: float  # m/s²
    bias_limit: float  # of its accelerometers, by its sheet, m/s²


def row_period(logs: Sequence[Path]) -> float:
    """Length of a row, whole seconds, of which no log has more than 20 000."""
    longest = max((summary.read(log).seconds or 0.0 for log in logs), default=0.0)
    return float(max(1, int(-(-longest // _MOST_ROWS))))


def unit_at_rest(name: str, logs: Sequence[Path], period: float) -> UnitAtRest | None:
    """Return a unit from its logs in order of time, with rows of `period` s; None if none can be used."""
    parts = [part for log in logs if (part := _of_log(name, log, period)) is not None]
    if len(parts) < 2:
        return parts[0] if parts else None
    first, end = min(p.first for p in parts), max(p.first + len(p.rows) for p in parts)
    rows, temperature = np.full((end - first, len(AXES)), np.nan), np.full(end - first, np.nan)
    for part in parts:
        place = slice(part.first - first, part.first - first + len(part.rows))
        rows[place], temperature[place] = part.rows, part.temperature
    lead = max(parts, key=lambda part: len(part.rows))
    return replace(lead, first=first, rows=rows, temperature=temperature)


def _of_log(name: str, log: Path, period: float) -> UnitAtRest | None:
    try:
        (read,) = runs.read_runs([log], [name], Reading(), 1, lambda share, what: None)
    except InputError:
        return None
    run, axes = read.run, read.info.axes()
    moves = line_search.moving(run)
    own = np.where(moves[:, None], np.nan, residual(run))
    own = np.hstack([axes.gyro_to_body(own[:, :3]), axes.accel_to_body(own[:, 3:])])
    number = ((read.log.first_ns + run.t * 1e9) // (period * 1e9)).astype(np.int64)
    number -= (first := int(number[0]))
    enough = 0.5 * period / float(np.median(np.diff(run.t)))
    temperature = np.full(run.t.size, np.nan) if run.temperature is None else run.temperature
    C = attitude_and_rate(run, slice(0, 1))[0][0]
    rest = own[: int(np.argmax(moves)) if moves.any() else None, 3:]
    level = np.full(3, np.nan)
    if read.info.reference not in _OWN_LEVEL and np.isfinite(rest).any(axis=0).all():
        level = C @ np.nanmean(rest, axis=0)
    along = tuple(int(c) for c in np.argmax(np.abs(axes.mount), axis=0))
    return UnitAtRest(
        name,
        first,
        _means(number, own, enough),
        _means(number, temperature[:, None], enough)[:, 0],
        level,
        not moves.any(),
        axes.accel_to_instrument(C).T,
        (*along, *(3 + axis for axis in along)),
        tuple(_tones(run, own, read.log.first_ns, axes)),
        run.site.gravity,
        specification.of_model(read.info.instrument).accel_bias_limit,
    )


def _means(number: NDArray[np.int_], values: Array, enough: float) -> Array:
    """Means over the rows that values belong to, by number; NaN where there are too few."""
    out = np.full((int(number.max()) + 1, values.shape[1]), np.nan)
    for c in range(values.shape[1]):
        good = np.isfinite(values[:, c])
        count = np.bincount(number[good], minlength=len(out))
        total = np.bincount(number[good], values[good, c], minlength=len(out))
        have = count > enough
        out[have, c] = total[have] / count[have]
    return out


def _tones(run: Run, own: Array, first_ns: int, axes: AxisMap) -> Iterator[Tone]:
    """Lines of a run; their phases too, where it has all samples. `own`: residual in the table's axes, shape (N, 6)."""
    t = first_ns * 1e-9 + run.t
    segment = (t // _SEGMENT_S).astype(np.int64)
    segment -= (begin := int(segment[0]))
    for line in line_search.lines_of([run], [run]):
        rms = np.abs(np.concatenate([axes.gyro_to_body(line.rms[:3]), axes.accel_to_body(line.rms[3:])]))
        segments, amplitude = np.zeros(0, np.int64), np.zeros(0, np.complex128)
        if run.full_rate is None:
            x = own[:, int(np.argmax(rms / np.maximum(np.nanstd(own, axis=0), 1e-300)))]
            good = np.isfinite(x)
            count = np.maximum(np.bincount(segment[good]), 1)
            x = x[good] - (np.bincount(segment[good], x[good]) / count)[segment[good]]
            turn = x * np.exp(-2j * np.pi * line.hz * t[good])
            amplitude = np.bincount(segment[good], turn.real) + 1j * np.bincount(segment[good], turn.imag)
            segments = np.arange(amplitude.size) + begin
        yield Tone(line.hz, 1.0 / run.seconds, tuple(np.flatnonzero(rms > 0.0).tolist()), rms, segments, amplitude)

"""A recording of another program, read once and checked, and read again in pieces for its log."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from filters.errors import InputError
from imutui import outside_file
from imutui.logbook import arrival_stamps, bag, foreign_log, sample_check
from imutui.logbook.importing import arrays, columns, rows, scale, text
from imutui.logbook.importing.columns import ACCEL, GYRO, REFERENCES, Channel
from imutui.logbook.importing.rows import Clock, Part, Repairs
from imutui.logbook.importing.table import Asked, ImportDataError, Table
from imutui.logbook.power_on import ContentId
from imutui.logbook.session_info import SessionInfo

STARTED = "started at the modification time of its file"
_STAMPS = f"the recording's own time, {STARTED}"
_LARGEST = 1e9  # largest angle or place, of either sign, in the units of the file
_UNITS = {"gyro": " deg/s", "accel": " g", "temp": " degC"}
_SIX = [*GYRO, *ACCEL]
MOVING = ("profile", "trajectory", "turned")
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Piece:
    """Consecutive samples in the instrument's axes and sign."""

    share: float  # of the file that has been read
    t: np.ndarray  # s since the first sample, shape (N,)
    # gyro_dps, accel_g: shape (N, 3)
    gyro_dps: np.ndarray
    accel_g: np.ndarray
    temperature_degc: np.ndarray  # shape (N,), NaN where there is no new one
    valid: np.ndarray  # False where a channel has no reading, bool, shape (N,)


@dataclass(frozen=True, slots=True)
class Recording:
    """What a recording holds: the instrument's axes and sign. `pieces` reads its samples."""

    path: Path
    samples: int
    clock_s: float  # what its own clock said at the first sample, s
    duration_s: float
    rate_hz: float  # usual rate, which gaps and lost rows do not change
    lacks: np.ndarray  # channels that are NaN throughout, gyros first, bool, shape (6,)
    mean_g: np.ndarray  # mean of the accelerometers without the largest and smallest hundredth, shape (3,)
    is_still: bool  # whether it hardly moves, but for a hundredth of its time
    content_id: str  # the same for the same samples
    not_imported: tuple[str, ...]  # names of columns and arrays that were left aside
    # arrays that state something of the motion (`ang`, `rate` in deg and deg/s, `ref_quat`, `gps_pos` in deg, deg, m,
    # `gps_vel_ned` in m/s), a row a sample, NaN where unknown; and the time of their rows, s since the first sample
    known: dict[str, np.ndarray]
    known_t: np.ndarray
    assumed: tuple[str, ...]  # what the import assumed, in words
    stamps: str  # what `t` means
    bursts: str  # what makes stamps look like arrival times, "" if they don't
    fitted: arrival_stamps.Instants | None  # instants under arrival times, if they were asked for
    has_temperature: bool
    zeros: int  # samples at the beginning that read zero in all channels, before the unit sends
    _taken: Callable[[], Iterator[tuple[float, Part]]] = field(repr=False)

    @property
    def unread(self) -> tuple[str, ...]:
        """Names of channels that it lacks, NaN throughout."""
        return sample_check.names(self.lacks)

    def pieces(self) -> Iterator[Piece]:
        """Yield the samples from the first one on, a bounded number at a time."""
        at, first = 0, 0.0
        for share, part in self._taken():
            first = first if at else float(part.t[0])
            taken = slice(at, at + part.t.size)
            t = part.t - first if self.fitted is None else self.fitted.t[taken] - self.fitted.t[0]
            readings = readings_of(part)
            valid = (np.isfinite(readings[:, :6]) | self.lacks).all(axis=1)
            valid[: max(0, self.zeros - at)] = False
            readings[:, :6][~valid[:, None] & ~self.lacks] = 0.0
            if not self.has_temperature:
                readings[:, 6] = np.nan
            at = taken.stop
            yield Piece(share, t, readings[:, :3], readings[:, 3:6], readings[:, 6], valid)

    def whole(self) -> Piece:
        """Return all of the samples at once."""
        found = list(self.pieces())
        names = ("t", "gyro_dps", "accel_g", "temperature_degc", "valid")
        return Piece(1.0, *(np.concatenate([getattr(piece, name) for piece in found]) for name in names))


def load(path: Path, asked: Asked | None = None, progress: Progress = lambda share: None) -> Recording:
    """Read and check a recording: NPZ, NPY, CSV of any dialect (packed with gzip or not), or Parquet.

    `asked`: what the user asked.
    `progress`: called with the share that has been read.
    Raises ImportDataError if the file cannot be read, or its content is not what the names promise.
    """
    return of_table(_table(path, asked or Asked()), asked or Asked(), progress)


def _table(path: Path, asked: Asked) -> Table:
    if bag.is_bag(path):
        try:
            if not path.is_dir():
                outside_file.opened(path).close()  # a pipe would be waited for
            return bag.opened(path, asked.topic, asked.stamps)
        except foreign_log.RefusedLogError as error:
            raise ImportDataError(f"{path}: {error}", error.cures) from error
        except OSError as error:
            raise ImportDataError(f"{path}: {error.strerror or error}. Name a bag, or a table.") from error
        except InputError as error:
            raise ImportDataError(f"{path}: {error}. Name another bag, or a table.") from error
    try:
        with outside_file.opened(path) as stream:
            magic = stream.read(16)
    except OSError as error:
        raise ImportDataError(f"{path}: {error.strerror or error}. Name an NPZ or CSV file.") from error
    if magic.startswith(b"PK"):
        return arrays.read_npz(path)
    if magic.startswith(b"\x93NUMPY"):
        return arrays.read_npy(path)
    if magic.startswith(b"PAR1"):
        return arrays.read_parquet(path)
    if path.suffix.lower() in (".npz", ".npy", ".parquet") or magic.startswith((b"\x80", b"SQLite", b"#ROSBAG")):
        raise ImportDataError(
            f"{path} is neither NPZ nor CSV: bytes as a unit sent them, or another format. Decode it first, and save it"
            " with numpy.savez(t=…, gyro=…, accel=…) in s, deg/s and g, or as a .csv file."
        )
    try:
        return text.read(path)
    except OSError as error:
        raise ImportDataError(f"{path}: {error.strerror or error}. Name an NPZ or CSV file.") from error


@np.errstate(invalid="ignore", over="ignore")
def of_table(table: Table, asked: Asked, progress: Progress = lambda share: None) -> Recording:
    """Read and check a recording that is in columns; raises as `load`."""
    channels = columns.choose(table, asked, partial(scale.guess, table))
    dropped = rows.Dropped(asked)
    clock, repairs, look, found = Clock(channels["t"]), Repairs(), scale.Look(), _Found()
    references = {name: width for name, width in REFERENCES.items() if _has(channels, name, width)}
    known: dict[str, list[np.ndarray]] = {name: [] for name in references}
    times: list[np.ndarray] = []
    for share, part in _taken(table, channels, asked, dropped, clock, repairs):
        progress(share)
        readings = readings_of(part)
        look.take(part, readings)
        found.take(part, readings)
        for name, width in references.items():
            known[name].append(_vector(part, name, width))
            found.check_large(name, known[name][-1], part.row, _LARGEST)
        if known or asked.stamps == "arrival":
            times.append(part.t)
    first = 0 if asked.start is None else found.first_row
    last = repairs.rows if asked.end is None else found.last_row
    repairs.keep(first, last, table.reasons, dropped)
    rows.check_order(table, asked, repairs, channels["t"])
    found.check_count(table, asked, repairs.end_t)
    of_time = rows.fitting_unit(table, asked, channels["t"], found.rate_hz, found.last_t - found.first_t)
    scale.check(table, asked, channels, look, found.rate_hz, of_time)
    found.check(table, asked)
    t = np.concatenate(times) if times else np.empty(0)
    fitted = arrival_stamps.from_arrivals(t) if asked.stamps == "arrival" else None
    mean_g, is_still = look.rest()
    assumed = [
        *table.remarks,
        *columns.assumed(table, channels),
        *repairs.assumed(),
        *([] if fitted else arrival_stamps.rounding(look.head()[:, 0])),
        *found.assumed(),
    ]
    return Recording(
        path=table.path,
        samples=found.count,
        clock_s=clock.first + found.first_t,
        duration_s=found.last_t - found.first_t if fitted is None else float(fitted.t[-1] - fitted.t[0]),
        rate_hz=found.rate_hz if fitted is None else 1.0 / float(np.median(np.diff(fitted.t))),
        lacks=found.lacks,
        mean_g=mean_g,
        is_still=is_still,
        content_id=found.content.text(),
        not_imported=columns.left(table, channels),
        known={name: np.concatenate(kept) for name, kept in known.items()},
        known_t=t - t[0] if t.size and fitted is None else t if fitted is None else fitted.t - fitted.t[0],
        assumed=tuple(assumed),
        stamps=_STAMPS if fitted is None else _words(fitted),
        bursts="" if fitted is not None else found.order.bursts(),
        fitted=fitted,
        has_temperature=found.is_warm,
        zeros=found.zeros,
        _taken=lambda: _taken(table, channels, asked, dropped, clock, Repairs()),
    )


def _taken(
    table: Table, channels: Mapping[str, Channel], asked: Asked, dropped: rows.Dropped, clock: Clock, repairs: Repairs
) -> Iterator[tuple[float, Part]]:
    """Yield the rows in order that `--start` and `--end` take; one pass over the file."""
    streamed = rows.streamed(table, channels, clock, dropped)
    for share, part in rows.in_order(streamed, repairs, table, arrival=asked.stamps == "arrival"):
        repairs.end_t = float(part.t[-1])
        kept = part
        if asked.start is not None:
            kept = kept.at(kept.t >= asked.start)
        if asked.end is not None:
            kept = kept.at(kept.t <= asked.end)
        if kept.t.size:
            yield share, kept
        if asked.end is not None and part.t[-1] > asked.end:
            return


def _vector(part: Part, name: str, width: int) -> np.ndarray:
    return np.stack([part.values[component] for component in columns.parts(name, width)], axis=1)


def _has(channels: Mapping[str, Channel], name: str, width: int) -> bool:
    return all(component in channels for component in columns.parts(name, width))


def readings_of(part: Part) -> np.ndarray:
    """Gyros, accelerometers and temperature, shape (N, 7); NaN where there is no reading."""
    out = np.full((part.t.size, 7), np.nan)
    for k, name in enumerate([*_SIX, "temp"]):
        if name in part.values:
            column = part.values[name]
            out[:, k] = np.where(np.isfinite(column), column, np.nan)
    return out


def _words(fitted: arrival_stamps.Instants) -> str:
    how = "one regular grid" if fitted.pieces == 1 else f"{fitted.pieces} joined regular grids"
    return (
        f"sampling instants fitted under the recording's arrival times ({how}; arrivals late by"
        f" {fitted.median_late * 1e3:.1f} ms in the median, {fitted.max_late * 1e3:.1f} ms at most), {STARTED}"
    )


class _Found:
    """What the first pass finds out about the samples."""

    def __init__(self) -> None:
        self.count = 0
        self.first_row = self.last_row = 0
        self.first_t = self.last_t = 0.0
        self.content = ContentId()
        self.order = foreign_log.Order()
        self._missing = np.zeros(64, int)  # samples by which channels have no reading
        self._at_zero = 0  # samples at the beginning that read zero throughout
        self._begun = False
        self._large: tuple[str, int, float] | None = None
        self._temperatures = 0
        self.is_warm = False

    def take(self, part: Part, readings: np.ndarray) -> None:
        """Look at samples: readings of shape (N, 7)."""
        if not self.count:
            self.first_row, self.first_t = int(part.row[0]), float(part.t[0])
        self.order.take(np.round(part.t * 1e9).astype(np.int64))
        self.count += part.t.size
        self.last_row, self.last_t = int(part.row.max()), float(part.t[-1])
        self.content.add(part.t, readings[:, :3], readings[:, 3:6])
        missing = np.isnan(readings[:, :6]) @ (1 << np.arange(6))
        self._missing += np.bincount(missing, minlength=64)
        if not self._begun:
            zero = (readings[:, :6] == 0.0).all(axis=1)
            self._begun = not zero.all()
            self._at_zero += int(zero.size if not self._begun else zero.argmin())
        degc = readings[:, 6]
        self._temperatures += int(np.count_nonzero(np.isfinite(degc)))
        self.is_warm |= bool(np.any(np.isfinite(degc) & (degc != 0.0)))
        for name, columns_ in (("gyro", slice(0, 3)), ("accel", slice(3, 6)), ("temp", slice(6, 7))):
            self.check_large(name, readings[:, columns_], part.row, sample_check.LARGEST[name])

    def check_large(self, name: str, values: np.ndarray, row: np.ndarray, largest: float) -> None:
        """Note the first row that is beyond what any unit reads."""
        with np.errstate(invalid="ignore"):
            beyond = (np.abs(values) > largest).any(axis=1)
        if self._large is None and beyond.any():
            self._large = name, int(row[beyond.argmax()]), largest

    @property
    def rate_hz(self) -> float:
        """Usual rate, which gaps and rows that are lost do not change."""
        return 1e9 / self.order.period_ns if self.order.period_ns else 0.0

    @property
    def lacks(self) -> np.ndarray:
        """Channels that are NaN throughout, bool, shape (6,)."""
        patterns = np.arange(64)[:, None] >> np.arange(6) & 1
        return np.asarray((patterns[self._missing > 0] == 1).all(axis=0))

    def check_count(self, table: Table, asked: Asked, lasts_s: float) -> None:
        """Raise ImportDataError if fewer than two samples, or no readings, are left of a recording of `lasts_s`."""
        if self.count < 2:
            raise ImportDataError(
                f"{table.path}: --start and --end leave fewer than two samples; the recording lasts {lasts_s:.3f} s."
                if asked.start is not None or asked.end is not None
                else f"{table.path} has {self.count} samples; at least two are needed."
            )
        if self.lacks.all():
            raise ImportDataError(f"{table.path} has no reading in any channel: `gyro` and `accel` are NaN throughout.")

    def check(self, table: Table, asked: Asked) -> None:
        """Raise ImportDataError if a sample is beyond what any unit reads, or most lack readings."""
        if self._large is not None:
            name, row, largest = self._large
            raise ImportDataError(
                f"{table.path}: `{name}` is beyond ±{largest:,.0f}{_UNITS.get(name, '')} in row {row} (first is 0)."
                " Nothing is that large in the units of this array. To leave the row out:"
                f" `{asked.command(table.path, drop=str(row))}`"
            )
        if 2 * self.no_reading > self.count:
            raise ImportDataError(
                f"{table.path}: {self.no_reading} of {self.count} rows lack a reading of gyros or accelerometers, which"
                " stand in rows of their own. To import the gyros alone:"
                f" `{asked.command(table.path, columns='accel=none')}`"
            )

    @property
    def no_reading(self) -> int:
        """Samples without a reading in a channel that the recording has."""
        lacks = int(self.lacks @ (1 << np.arange(6)))
        return int(self._missing[(np.arange(64) & ~lacks) > 0].sum())

    @property
    def zeros(self) -> int:
        """Samples at the beginning that read zero in all channels, of a recording that goes on otherwise."""
        return self._at_zero if self._begun else 0

    def assumed(self) -> list[str]:
        """Return what was assumed of readings, in words."""
        out = []
        if self.no_reading:
            out.append(f"{self.no_reading} rows with blank cells are samples without a reading")
        if self.zeros:
            out.append(f"the first {self.zeros} row(s) read 0 in all channels: they are samples without a reading")
        if self._temperatures and not self.is_warm:
            out.append("`temp` is 0 throughout: it was left out")
        elif 0 < self._temperatures < self.count:
            out.append(f"`temp` has {self._temperatures} readings: each holds until the next")
        return out


# ------------------------------------------------------------------------------------------------------------- gravity


def check_gravity(recording: Recording, info: SessionInfo) -> str | None:
    """Compare the mean specific force of a still recording with gravity: its sign and its size.

    Returns a warning, if the magnitude is off by more than 12 mg + 1 %.
    Raises ImportDataError if the unit is said to be level and its forces point up or sideways.
    """
    if not recording.is_still:
        if info.reference in MOVING:
            return None
        return f"the unit moves in this recording: reference `{info.reference}` (still) does not hold for all of it"
    if recording.lacks[3:].any():
        return None
    gamma_g = info.gravity_mps2 / info.g_unit
    force_g = info.axes().accel_to_body(recording.mean_g)
    if info.reference == "level":
        force = recording.mean_g * info.g_unit
        try:
            foreign_log.refuse_upside_down(recording.path, force, info.axes(), info.gravity_mps2)
        except foreign_log.RefusedLogError as error:
            raise ImportDataError(str(error), error.cures) from error
    off = float(np.linalg.norm(force_g)) - gamma_g
    if info.reference == "level":
        off = -float(force_g[2]) - gamma_g
    if abs(off) > 12e-3 + 0.01 * gamma_g:
        what = "vertical" if info.reference == "level" else "magnitude"
        return (
            f"the {what} of the mean specific force is {off * 1e3:+.1f} mg off gravity's {gamma_g:.5f} g:"
            " tilt, accelerometer bias or scale factor; --gravity sets the local value"
        )
    return None

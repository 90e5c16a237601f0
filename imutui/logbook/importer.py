"""Recordings made elsewhere (NPZ, CSV) into a log; docs/formats.md.

Checked before anything is written: names, lengths, numbers, time, and what gravity says of signs.
"""

import csv
import math
import warnings
import zipfile
from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import imutui
from filters.errors import InputError
from imutui import outside_file
from imutui.logbook import arrival_stamps, log_time, parquet, power_on, sample_check, schemas
from imutui.logbook.arrival_stamps import Instants
from imutui.logbook.log_stream import MODE
from imutui.logbook.reference_file import ReferenceFile
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import whole_log
from imutui.plain_text import in_line

T = TypeVar("T")

_REQUIRED = {"t": 1, "gyro": 3, "accel": 3}
_OPTIONAL = {"temp": 1}
# what is known of the motion; NaN is "unknown" here
_REFERENCES = {"ang": 3, "rate": 3, "ref_quat": 4, "gps_pos": 3, "gps_vel_ned": 3}
_KNOWN = (*_REQUIRED, *_OPTIONAL, *_REFERENCES)
_STEMS = {name.partition("_")[0] for name in _KNOWN}
_PARTS = {3: "xyz", 4: "wxyz"}
LIMIT = 2 * 2**30
"""Most that is read of a recording, bytes: of an NPZ's arrays, or of a CSV's text. Two days of everything at 133 Hz."""
_HEADS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
"""How the head of an array is read, by the version of its format; later ones are for names of columns."""
_LARGEST = 1e9  # largest reading, angle or place, of either sign, in the units of the file
_UNITS = {"gyro": " deg/s", "accel": " g", "temp": " degC"}
_STILL_G = 0.1
_STILL_DPS = 5.0
_LONGEST_S = 3.2e8
STARTED = "started at the modification time of its file"
STAMPS = f"the recording's own time, {STARTED}"
_WITH_ATTACHMENT = ("profile", "trajectory")
_MOVING = (*_WITH_ATTACHMENT, "turned")


class ImportDataError(InputError):
    """The recording cannot be imported as it is; the message says what, where, and what to do next."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording as its file has it: the instrument's axes and sign."""

    t: np.ndarray  # s, shape (N,), increasing
    # gyro_dps, accel_g: shape (N, 3)
    gyro_dps: np.ndarray
    accel_g: np.ndarray
    temperature_degc: np.ndarray | None  # shape (N,)
    not_imported: tuple[str, ...] = ()  # names of arrays that were left aside
    # arrays that say something of the motion, by their names in the file (`ang`, `rate` in deg and deg/s, `ref_quat`,
    # `gps_pos` in deg, deg, m, `gps_vel_ned` in m/s), a row a sample, NaN where unknown
    known: dict[str, np.ndarray] = field(default_factory=dict)
    stamps: str = STAMPS  # what `t` means

    @property
    def unread(self) -> tuple[str, ...]:
        """Names of channels that it lacks, NaN throughout."""
        return sample_check.names(sample_check.unread(self.gyro_dps, self.accel_g))

    @property
    def rate_hz(self) -> float:
        """Mean rate, (N - 1)/duration; a median of steps would be wrong for bursty stamps."""
        return float((self.t.size - 1) / (self.t[-1] - self.t[0]))


def load(path: Path, start: float | None = None, end: float | None = None) -> Recording:
    """Read and check a recording.

    `path`: NPZ with arrays `t` (s), `gyro` (deg/s), `accel` (g), optionally `temp` (degC); or CSV with columns `t`,
      `gyro_x` … `accel_z`, `temp`.
    `start`, `end`: part to take, s since its first sample.
    Raises ImportDataError if the file cannot be read, or its content is not what the names promise.
    """
    read = {".csv": _read_csv, ".parquet": _read_parquet}.get(path.suffix.lower(), _read_npz)
    arrays = read(path)
    for name, width in _REQUIRED.items():
        if name not in arrays:
            near = ", ".join(sorted(arrays)) or "nothing"
            raise ImportDataError(
                f"{path} has no `{name}`; it has: {near}. Needed: t in s, gyro in deg/s, accel in g, each sample a row."
            )
        _check_shape(path, name, arrays[name], width)
    references = [name for name in _REFERENCES if name in arrays]
    for name in references:
        _check_shape(path, name, arrays[name], _REFERENCES[name])
    used = dict.fromkeys(_REQUIRED) | {name: None for name in (*_OPTIONAL, *references) if name in arrays}
    _check_lengths(path, {name: arrays[name] for name in used})
    values = {name: np.asarray(arrays[name], dtype=float) for name in used}
    t = values["t"]
    _check_finite(path, "t", t, np.ones(t.size, bool))
    if t.size < 2:
        raise ImportDataError(f"{path} has {t.size} samples; at least two are needed.")
    part = np.ones(t.size, bool)
    if start is not None:
        part &= t - t[0] >= start
    if end is not None:
        part &= t - t[0] <= end
    for name, column in values.items():
        if name not in references:
            _check_finite(path, name, column, part)
        if name != "t":  # whose step and span are looked at
            _check_large(path, name, column)
    if part.any() and sample_check.unread(values["gyro"][part], values["accel"][part]).all():
        raise ImportDataError(f"{path} has no reading in any channel: `gyro` and `accel` are NaN throughout.")
    _check_time(path, t)
    if np.count_nonzero(part) < 2:
        raise ImportDataError(
            f"{path}: --start and --end leave fewer than two samples; the recording lasts {t[-1] - t[0]:.3f} s."
        )
    return Recording(
        t[part],
        values["gyro"][part],
        values["accel"][part],
        values["temp"][part] if "temp" in values and np.isfinite(values["temp"][part]).any() else None,
        tuple(sorted(set(arrays) - set(used))),
        {name: values[name][part] for name in references},
    )


def at_sampling_instants(recording: Recording) -> tuple[Recording, Instants]:
    """A recording whose `t` are arrivals, with the sampling instants fitted to them."""
    fitted = arrival_stamps.from_arrivals(recording.t)
    how = "one regular grid" if fitted.pieces == 1 else f"{fitted.pieces} joined regular grids"
    text = (
        f"sampling instants fitted under the recording's arrival times ({how}; arrivals late by"
        f" {fitted.median_late * 1e3:.1f} ms in the median, {fitted.max_late * 1e3:.1f} ms at most), {STARTED}"
    )
    return replace(recording, t=fitted.t, stamps=text), fitted


def check_gravity(recording: Recording, info: SessionInfo) -> str | None:
    """What gravity says of signs and scale, for a still recording.

    Returns a warning, if the magnitude is off by more than 12 mg + 1 %.
    Raises ImportDataError if the unit is said to be level and its vertical has the wrong sign by more than 0.5 g.
    """
    if np.any(np.std(recording.accel_g, axis=0) > _STILL_G) or np.any(np.std(recording.gyro_dps, axis=0) > _STILL_DPS):
        if info.reference in _MOVING:
            return None
        return f"the unit moves in this recording: reference `{info.reference}` (still) does not hold for all of it"
    mean_g = recording.accel_g.mean(axis=0)
    gamma_g = info.gravity_mps2 / info.g_unit
    force_g = info.axes().accel_to_body(mean_g)
    if info.reference == "level" and force_g[2] > 0.5:
        raise ImportDataError(_wrong_sign(mean_g, info))
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


def write(
    recording: Recording,
    info: SessionInfo,
    source: Path,
    output: Path,
    *,
    overwrite: bool,
    reference: ReferenceFile | None = None,
    first_ns: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
    mode: int = MODE,
) -> str:
    """Write a recording as a log.

    `recording`: from `load`.
    `info`: axes, site and reference; the rest is filled in here.
    `source`: where the recording came from; its modification time starts the stamps, unless `first_ns` does.
    `overwrite`: replace an existing one.
    `reference`: what is known of the motion, to travel in the log.
    `first_ns`: UTC of the first sample, ns, on the clock of the log that it continues.
    `progress`: told the number of samples written, now and then.
    `mode`: permissions of the log.

    Returns what to report of a time that stamps cannot hold, and of the stamps instead; "" if it was used as it is.
    Raises ImportDataError if the log that it continues ends too late for stamps.
    """
    info = replace(
        info,
        sampling="imported",
        rate_hz=recording.rate_hz,
        source=in_line(source.name),
        software=f"imutui {imutui.__version__}",
        stamps=recording.stamps if first_ns is None else recording.stamps.replace(STARTED, f"after {info.continues}"),
        clock_s=float(recording.t[0]),
    )
    base_ns = source.stat().st_mtime_ns if first_ns is None else first_ns
    elapsed_ns = np.round((recording.t - recording.t[0]) * 1e9).astype(np.int64)
    why = log_time.why_fitted(base_ns, int(elapsed_ns[-1]))
    if why and first_ns is not None:
        raise ImportDataError(f"the log that it continues ends too late: {why}. Import it without --continues.")
    stamp_ns = log_time.fitted_ns(base_ns, int(elapsed_ns[-1])) + elapsed_ns
    axes = info.axes()
    gyro = axes.gyro_to_body(np.deg2rad(recording.gyro_dps))
    accel = axes.accel_to_body(recording.accel_g * info.g_unit)
    own = power_on.content_id(recording.t, gyro, accel)
    info = replace(info, log_id=own, power_on=info.power_on or own)
    angles, rates, changed = _table(recording, info)
    text = f"# imported from {in_line(source.name)}\n"
    with whole_log(output, info, text, overwrite=overwrite, mode=mode) as log:
        if reference is not None:
            log.attach(reference.name, reference.media_type, reference.content, int(stamp_ns[0]))
        next_second = int(stamp_ns[0])
        for k, stamp in enumerate(stamp_ns.tolist()):
            if stamp >= next_second or changed[k]:
                (row,) = schemas.encode_table_references(stamp, info.reference, angles[k], rates[k])
                log.encoded(schemas.REFERENCE, row, stamp, stamp)
            if stamp >= next_second:
                next_second = stamp + 1_000_000_000
                progress(k)
            log.imu(stamp, stamp, gyro[k], accel[k])
            if recording.temperature_degc is not None:
                (data,) = schemas.encode_temperatures(stamp, recording.temperature_degc[k])
                log.encoded(schemas.TEMPERATURE, data, stamp, stamp)
        duration = float(stamp_ns[-1] - stamp_ns[0]) / 1e9
        summary = {"samples": int(stamp_ns.size), "duration_s": duration, "source": in_line(source.name)}
        log.finish(summary, log_time.now_ns())
    return why and f"{source} was last changed at a time that starts the log's stamps, and {why}"


def _table(recording: Recording, info: SessionInfo) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Table angles (deg) and rates (deg/s) of each sample, shape (N, 3), and where they are new, bool (N,)."""
    n = recording.t.size
    still = info.reference not in _MOVING
    unknown = np.full((n, 3), np.nan)
    known = recording.known if info.reference == "trajectory" else {}
    angles = known.get("ang", np.zeros((n, 3)) if info.reference == "level" else unknown)
    rates = known.get("rate", np.zeros((n, 3)) if still else unknown)
    both = np.nan_to_num(np.hstack([angles, rates]), nan=-1e9)
    return angles, rates, np.r_[False, (np.diff(both, axis=0) != 0.0).any(axis=1)]


def _wrong_sign(mean_g: np.ndarray, info: SessionInfo) -> str:
    axes = info.axes()
    # which instrument axis is vertical in the mounting that was named
    vertical = int(np.argmax(np.abs(axes.mount[2])))
    flipped = -info.accel_sign
    turned = {"x,y,z": "x,-y,-z", "x,-y,-z": "x,y,z"}.get(info.mount, "a mounting with two axes reversed")
    return (
        f"{'XYZ'[vertical]} reads {mean_g[vertical]:+.3f} g, so the unit would be upside down on a level table with"
        f" --accel-sign {info.accel_sign:+d} and --mount {info.mount}. Either its sign is the other one: --accel-sign"
        f" {flipped:+d}; or it is mounted the other way up: --mount {turned}. A still log can't tell which; look at"
        " the unit or its manual. (--reference gravity takes any attitude.)"
    )


def _read_npz(path: Path) -> dict[str, Any]:
    if path.is_file() and not zipfile.is_zipfile(path):
        raise ImportDataError(
            f"{path} is neither NPZ nor CSV: bytes as a unit sent them, or another format. Decode it first, and save it"
            " with numpy.savez(t=…, gyro=…, accel=…) in s, deg/s and g, or as a .csv file."
        )
    try:
        outside_file.opened(path).close()  # a pipe would be waited for
        archive = _parsed(lambda: np.load(path, allow_pickle=False))
        if not isinstance(archive, np.lib.npyio.NpzFile):
            raise InputError("a single array")
        with archive, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python 2 wrote such heads, and they are read
            _check_sizes(archive)
            return {name: _member(archive, name) for name in archive.files}
    except OSError as error:
        raise ImportDataError(f"{path}: {error.strerror or error}. Name an NPZ or CSV file.") from error
    except InputError as error:
        raise ImportDataError(
            f"{path} cannot be read as NPZ ({error}). Save it with numpy.savez(t=…, gyro=…, accel=…), or name a .csv"
            " file."
        ) from error


def _parsed(parse: Callable[[], T], where: str = "") -> T:
    """What numpy makes of foreign bytes, whose unpacking and parsing raise many kinds: InputError for all of them."""
    try:
        return parse()
    except OSError:
        raise
    except Exception as error:
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{where}{why}") from error


def _head(archive: Any, told: zipfile.ZipInfo) -> tuple[tuple[int, ...], Any]:
    """Shape and type of an array of the archive, as its head has them."""
    with archive.zip.open(told) as stream:
        version = np.lib.format.read_magic(stream)
        shape, _, dtype = _HEADS[version](stream)
    return shape, dtype


def _check_sizes(archive: Any) -> None:
    """Refuse, before anything is unpacked, arrays that would be longer than they say, or than memory should hold."""
    total = 0
    for name in (name for name in _KNOWN if name in archive.files):
        told = archive.zip.getinfo(f"{name}.npy" if f"{name}.npy" in archive.zip.namelist() else name)
        shape, dtype = _parsed(partial(_head, archive, told), f"`{name}`: ")
        size = math.prod(shape) * dtype.itemsize
        if dtype.hasobject:
            raise InputError(f"`{name}` holds Python's objects, which are not read")
        if not 0 <= size <= told.file_size:
            raise InputError(f"`{name}` says that its shape is {shape}, which is more than the file holds")
        total += size
    if total > LIMIT:
        raise InputError(f"its arrays take {total:,} bytes; the most is {LIMIT:,}: split the recording")


def _member(archive: Any, name: str) -> Any:
    """An array of the archive; what nobody needs may be anything, and is only named."""
    if name not in _KNOWN:
        return np.empty(0)
    return _parsed(lambda: np.asarray(archive[name]), f"`{name}`: ")


def _read_csv(path: Path) -> dict[str, Any]:
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise ImportDataError(f"{path} is no file: a device or a pipe may never end. Name an NPZ or CSV file.")
        if path.stat().st_size > LIMIT:
            raise ImportDataError(f"{path} is longer than {LIMIT:,} bytes, the most that is read: split the recording.")
        with path.open(newline="", encoding="utf-8-sig") as stream:
            columns = _columns(path, csv.reader(_without_remarks(stream)))
    except OSError as error:
        raise ImportDataError(f"{path}: {error.strerror or error}. Name an NPZ or CSV file.") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ImportDataError(f"{path} is not a CSV text file ({error}). Name an NPZ or CSV file.") from error
    return _vectors(columns)


def _read_parquet(path: Path) -> dict[str, Any]:
    if not parquet.available():
        raise ImportDataError(f"{path}: Parquet needs pyarrow, the extra `{parquet.EXTRA}`. Or save it as NPZ or CSV.")
    try:
        return _vectors(parquet.read(path, lambda name: name.partition("_")[0] in _STEMS, LIMIT))
    except OSError as error:
        raise ImportDataError(f"{path}: {error.strerror or error}. Name an NPZ, CSV or Parquet file.") from error
    except InputError as error:
        raise ImportDataError(f"{path} cannot be read as Parquet ({error}). Name another file.") from error


def _vectors(columns: dict[str, Any]) -> dict[str, Any]:
    """Columns of a vector's components as one array."""
    for vector, width in (_REQUIRED | _REFERENCES).items():
        parts = [f"{vector}_{part}" for part in _PARTS.get(width, "")]
        if parts and all(part in columns for part in parts):
            columns[vector] = np.stack([columns.pop(part) for part in parts], axis=1)
    return columns


def _without_remarks(lines: Iterable[str]) -> Iterator[str]:
    """All lines but those before the first row that begin with #, in which `imutui export` says units and origin."""
    lines = iter(lines)
    for line in lines:
        if not line.startswith("#"):
            yield line
            break
    yield from lines


def _columns(path: Path, rows: Iterator[list[str]]) -> dict[str, Any]:
    """Columns by name, NaN for an empty cell; of those that nobody needs the name alone."""
    names = [name.strip() for name in next(rows, [])]
    if not any(names):
        raise ImportDataError(f"{path} is empty. Its first row must name the columns: t, gyro_x, … accel_z.")
    wanted = [(i, name, array("d")) for i, name in enumerate(names) if name.partition("_")[0] in _STEMS]
    ended = 0
    for number, row in enumerate(rows, start=2):
        if not row:  # at the end of the file only
            ended = ended or number
            continue
        if ended or len(row) != len(names):
            line, cells = (ended, 0) if ended else (number, len(row))
            raise ImportDataError(f"{path}, line {line}: {cells} cells where the first row names {len(names)} columns.")
        for i, name, values in wanted:
            values.append(_cell(path, number, name, row[i]))
    return dict.fromkeys(names, np.empty(0)) | {name: np.array(values) for _, name, values in wanted}


def _cell(path: Path, line: int, name: str, cell: str) -> float:
    try:
        return float(cell) if cell.strip() else math.nan
    except ValueError:
        raise ImportDataError(f'{path}, line {line}, column `{name}`: "{cell[:40]}" is not a number.') from None


def _check_shape(path: Path, name: str, array: np.ndarray, width: int) -> None:
    wanted = "(N,)" if width == 1 else f"(N, {width})"
    if (
        array.dtype.kind not in "fiu"
        or array.ndim != (1 if width == 1 else 2)
        or (width > 1 and array.shape[1] != width)
    ):
        raise ImportDataError(
            f"{path}: `{name}` has shape {array.shape} of {array.dtype}; it must be numbers of shape {wanted}."
        )


def _check_lengths(path: Path, arrays: dict[str, Any]) -> None:
    lengths = {name: len(array) if np.ndim(array) else 0 for name, array in arrays.items()}
    if len(set(lengths.values())) > 1:
        shortest = min(lengths.values())
        listed = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise ImportDataError(
            f"{path}: lengths differ ({listed} rows), from row {shortest} on something is missing."
            " Every array needs one row a sample; cut them to the same length."
        )


def _check_finite(path: Path, name: str, array: np.ndarray, part: np.ndarray) -> None:
    columns = array[:, None] if array.ndim == 1 else array
    # a channel that is never there is one that the recording lacks
    lacks = np.isnan(columns[part]).all(axis=0) if name != "t" else np.zeros(columns.shape[1], bool)
    finite = (np.isfinite(columns) | lacks).all(axis=1)
    cure = "Remove these rows, or take a part without them with --start and --end."
    _refuse_rows(path, name, ~finite & part, "not a number", cure)


def _check_large(path: Path, name: str, column: np.ndarray) -> None:
    largest, unit = sample_check.LARGEST.get(name, _LARGEST), _UNITS.get(name, "")
    with np.errstate(invalid="ignore"):
        beyond = (np.abs(column.reshape(len(column), -1)) > largest).any(axis=1)
    cure = "Nothing is that large in the units of this array; remove these rows."
    _refuse_rows(path, name, beyond, f"beyond ±{largest:,.0f}{unit}", cure)


def _refuse_rows(path: Path, name: str, bad: np.ndarray, what: str, cure: str) -> None:
    if (rows := np.flatnonzero(bad)).size:
        raise ImportDataError(
            f"{path}: `{name}` is {what} in row {rows[0]} (first row is 0; {rows.size} such rows). {cure}"
        )


def _check_time(path: Path, t: np.ndarray) -> None:
    steps = np.diff(t)
    bad = np.flatnonzero(~(steps > 0.0))
    if bad.size:
        k = int(bad[0]) + 1
        raise ImportDataError(
            f"{path}: time does not increase at row {k}: {t[k - 1]:.6f} s, then {t[k]:.6f} s ({bad.size} such rows)."
            " Sort the rows by time and drop those that stand twice."
        )
    close = np.flatnonzero(steps < sample_check.LEAST_STEP_S)
    if close.size:
        k = int(close[0]) + 1
        raise ImportDataError(
            f"{path}: row {k} (first row is 0) is {steps[k - 1]:.1e} s after the one before it, less than a microsecond"
            f" ({close.size} such rows). `t` must be in seconds; remove rows that stand twice."
        )
    if t.size > 1 and t[-1] - t[0] > _LONGEST_S:
        raise ImportDataError(
            f"{path}: `t` spans {t[-1] - t[0]:.3g} s, more than ten years. It must be in seconds; divide milliseconds"
            " or nanoseconds first."
        )

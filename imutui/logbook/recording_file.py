"""A recording made elsewhere, looked at once: what its columns are, its times, its units, and what is assumed of them.

It is read twice in pieces, so that its length does not matter: first to see what it is, then to use it. What cannot be
taken as it was meant is refused with a command that takes it.
"""

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY
from imutui.logbook import arrival_stamps, columns, foreign_log, sample_check
from imutui.logbook.foreign_log import Topic
from imutui.logbook.recording_columns import PARTS, REFERENCES, Column, UnassignedError, assign
from imutui.logbook.recording_source import ImportDataError, cure, opened
from imutui.logbook.text_table import ROWS, Progress

_LARGEST = 1e9  # largest angle or place, of either sign, in the units of the file
_UNITS = {"gyro": " deg/s", "accel": " g", "temp": " degC"}
_STILL_G = 0.1
_STILL_DPS = 5.0
_LONGEST_S = 3.2e8
_FEWEST = 5  # rows with the time of the one before that are left out unasked, at the least
_FEW = 0.01  # largest share of rows with the time of the one before that are left out unasked
_RATES = (0.45, 20_000.0)  # usual rates of recordings, Hz; others have to be stated
_ROOM_DEGC = 150.0  # a mean temperature above it is in kelvin
_QUIET_DPS = 0.004  # noise of rates below it is that of rad/s, taken for deg/s
STARTED = "started at the modification time of its file"
STAMPS = f"the recording's own time, {STARTED}"


# ----------------------------------------------------------------------------------------------------------- recording


@dataclass(frozen=True, slots=True)
class Recording:
    """Samples of a recording in the instrument's axes and sign: all, or those of a piece."""

    t: np.ndarray  # s, shape (N,), increasing
    # gyro_dps, accel_g: shape (N, 3); NaN where there is no reading
    gyro_dps: np.ndarray
    accel_g: np.ndarray
    temperature_degc: np.ndarray | None  # shape (N,); NaN where none was taken
    not_imported: tuple[str, ...] = ()  # names of arrays that were left aside
    # arrays that state the motion, by their names in the file (`ang`, `rate` in deg and deg/s, `ref_quat`, `gps_pos` in
    # deg, deg, m, `gps_vel_ned` in m/s), a row a sample, NaN where unknown
    known: dict[str, np.ndarray] = field(default_factory=dict)
    stamps: str = STAMPS  # what `t` means
    origin_s: float = 0.0  # what `t` has to be added to for the recording's own clock

    @property
    def unread(self) -> tuple[str, ...]:
        """Names of channels that it lacks, NaN throughout."""
        return sample_check.names(sample_check.unread(self.gyro_dps, self.accel_g))

    @property
    def rate_hz(self) -> float:
        """Mean rate, (N - 1)/duration; a median of steps would be wrong for bursty stamps."""
        return float((self.t.size - 1) / (self.t[-1] - self.t[0]))


@dataclass(frozen=True, slots=True)
class Options:
    """What the caller states of a recording."""

    start: float | None = None  # s since its first sample
    end: float | None = None
    columns: str | None = None  # as of --columns
    units: str | None = None  # as of --units
    topic: str | None = None  # as of --topic
    arrival: bool = False  # whether `t` are arrivals, under which instants are fitted
    rate_hz: float | None = None  # at which rows follow each other, instead of their times
    drop: tuple[int, ...] = ()  # rows to leave out, from 0


class RecordingFile:
    """A recording in a file, looked at once.

    `assumed`: what is assumed of it, in words.
    `look`: statistics of its samples, in SI.
    `count`, `first_s`, `last_s`: samples, and times of the first and the last, s on the recording's clock.
    `mean_g`: median specific force over parts of it, g, shape (3,).
    Raises ImportDataError if it cannot be taken as it is.
    """

    def __init__(self, path: Path, options: Options = Options(), progress: Progress = lambda share: None) -> None:
        self.path, self._options = path, options
        self._source = opened(path, options.topic)
        try:
            self._assigned = assign(
                self._source.names, self._source.units, options.columns, options.units, words=self._source.states_units
            )
        except UnassignedError as error:
            cures = [cure("--columns", error.columns)] if error.columns else []
            raise ImportDataError(f"{path} {error}. {'' if cures else _NAMES}".rstrip(), cures) from error
        except InputError as error:
            raise ImportDataError(f"{path}: {error}") from error
        self._whole: Recording | None = None
        self._instants: np.ndarray | None = None
        self.stamps, self._dates, self._scale = STAMPS, False, 1.0
        self._origin: float | int | None = None
        self.look = Topic(path.name)
        with np.errstate(over="ignore", invalid="ignore"):  # of numbers that are no readings
            self._survey(progress)
            self.assumed = [*self._source.notes, *self._assigned.assumed, *self._judge()]
        if options.arrival:
            self.assumed.append(self._fit())

    @property
    def not_imported(self) -> tuple[str, ...]:
        """Names of columns that are left out."""
        return self._assigned.left

    def pieces(self, progress: Progress = lambda share: None) -> Iterator[Recording]:
        """Yield the samples, a bounded number at a time unless they have to be put into order."""
        whole, first = self._whole, 0
        for piece in self._chosen(self._read(progress)) if whole is None else _cut(whole):
            if piece.t.size:
                last = first + piece.t.size
                yield piece if self._instants is None else replace(piece, t=self._instants[first:last])
                first = last

    def whole(self) -> Recording:
        """Return all samples in memory."""
        return _joined(list(self.pieces()), self.not_imported)

    # -- reading --

    def _read(self, progress: Progress = lambda share: None) -> Iterator[Recording]:
        """Yield all rows in our units, in the order of the file."""
        targets = list(self._assigned.columns)
        places = [self._assigned.columns[target].place for target in targets]
        row = 0
        try:
            for values in self._source.pieces(places, progress):
                found = dict(zip(targets, values, strict=True))
                t = self._time(found.pop("t"), row)
                row += t.size
                yield self._piece(t, found)
        except ImportDataError:
            raise
        except InputError as error:
            raise ImportDataError(f"{self.path}: {error}. Correct it, or take a part before it: --end") from error
        except OSError as error:
            raise ImportDataError(f"{self.path}: {error.strerror or error}. Name another file.") from error

    def _time(self, raw: np.ndarray, row: int) -> np.ndarray:
        """Return times since the first, s; exact for whole numbers and dates."""
        if self._options.rate_hz is not None:
            self._origin = 0.0
            return np.asarray((row + np.arange(raw.size)) / self._options.rate_hz)
        column = self._assigned.columns["t"]
        if raw.dtype.kind == "M":
            raw = raw.astype("datetime64[ns]").astype(np.int64)
            column = replace(column, scale=1e-9)
            self._dates = True
        self._scale = column.scale
        if self._origin is None and raw.size:
            finite = raw if raw.dtype.kind in "iu" else raw[np.isfinite(raw)]
            self._origin = finite[0].item() if finite.size else 0.0
        origin = 0 if self._origin is None else self._origin
        if raw.dtype.kind in "iu":
            return np.asarray((raw.astype(np.int64) - int(origin)) * column.scale)
        # numbers in s keep their digits
        return np.asarray(raw * column.scale - float(origin) * column.scale) if self._shifts else np.asarray(raw, float)

    @property
    def _shifts(self) -> bool:
        """Whether times count from the first one: those in s that are small stay as the file has them."""
        column = self._assigned.columns["t"]
        return column.scale != 1.0 or bool(column.modulo) or abs(float(self._origin or 0.0)) > 1e7

    @property
    def origin_s(self) -> float:
        """Time of the recording's own clock at which `t` is 0, s."""
        origin = self._origin or 0
        return float(origin) * self._scale if isinstance(origin, int) or self._shifts else 0.0

    def _piece(self, t: np.ndarray, found: dict[str, np.ndarray]) -> Recording:
        def of(name: str) -> np.ndarray:
            column = self._assigned.columns.get(name, _LACKING)
            values = np.asarray(found[name], float) if name in found else np.full(t.size, np.nan)
            return values if column.scale == 1.0 and not column.offset else values * column.scale + column.offset

        gyro, accel = (np.column_stack([of(f"{vector}_{axis}") for axis in "xyz"]) for vector in ("gyro", "accel"))
        known = {
            name: np.column_stack([of(f"{name}_{part}") for part in PARTS[width]])
            for name, width in REFERENCES.items()
            if all(f"{name}_{part}" in found for part in PARTS[width])
        }
        return Recording(t, gyro, accel, of("temp") if "temp" in found else None, known=known)

    def _chosen(self, pieces: Iterator[Recording]) -> Iterator[Recording]:
        """Yield the samples of the part, without rows that are dropped or have the time of the one before."""
        options, last, row, wraps, part = self._options, -np.inf, 0, 0.0, None
        for piece in pieces:
            t, use = piece.t, np.ones(piece.t.size, bool)
            use[[k - row for k in options.drop if row <= k < row + t.size]] = False
            row += t.size
            if modulo := self._assigned.columns["t"].modulo:
                t = t + wraps + modulo * np.cumsum(np.diff(t, prepend=t[:1]) < -0.5 * modulo)
                wraps_here = t[-1] - piece.t[-1]
                if np.isfinite(last) and t[0] < last - 0.5 * modulo:
                    t, wraps_here = t + modulo, wraps_here + modulo
                wraps = wraps_here
            part = part or _Part(options, float(t[use][0]) if use.any() else 0.0)
            use[use] &= part.has(t[use])
            kept = t[use]
            if not options.arrival:
                use[use] &= np.diff(kept, prepend=last) != 0.0
            last = float(kept[-1]) if kept.size else last
            yield _rows(replace(piece, t=t), use)

    # -- looking --

    def _survey(self, progress: Progress) -> None:
        """Go through all samples once: order of times, numbers, noise, direction of gravity."""
        self.count, self._rows, self._first_bad = 0, 0, dict[str, tuple[int, int]]()
        self.first_s = self.last_s = 0.0
        self._known: list[tuple[np.ndarray, dict[str, np.ndarray]]] = []
        self._large: dict[str, list[int]] = {}
        self.lacks, self._degc = np.ones(6, bool), list[float]()
        self._means: list[np.ndarray] = []
        self._spread: list[np.ndarray] = []
        for piece in self._read(progress):
            self._check(piece)
            self._rows += piece.t.size
        for piece in self._chosen(self._read()):
            if piece.t.size:
                self._take(piece)

    def _check(self, piece: Recording) -> None:
        """Refuse rows that no command could read, in the part that is asked for."""
        if not np.isfinite(piece.t).all():
            k = int(np.argmin(np.isfinite(piece.t))) + self._rows
            raise ImportDataError(
                f"{self.path}: `t` is not a number in row {k} (first row is 0).", [cure("--drop", str(k))]
            )

    def _take(self, piece: Recording) -> None:
        for name, values in (("gyro", piece.gyro_dps), ("accel", piece.accel_g), ("temp", piece.temperature_degc)):
            if values is not None:
                self._note_large(name, values)
        for name, values in piece.known.items():
            self._note_large(name, values)
        self.lacks &= sample_check.unread(piece.gyro_dps, piece.accel_g)
        if not self.count:
            self.first_s = float(piece.t[0])
        self.last_s, self.count = float(piece.t[-1]), self.count + piece.t.size
        if piece.known:
            self._known.append((piece.t, piece.known))
        if piece.temperature_degc is not None and np.isfinite(piece.temperature_degc).any():
            self._degc.append(float(np.nanmedian(piece.temperature_degc)))
        rows = np.zeros(piece.t.size, columns.DTYPES[columns.IMU])
        rows["stamp_ns"] = np.clip(np.round((piece.t - self.first_s) * 1e9), -_FAR_NS, _FAR_NS)
        rows["gyro"], rows["accel"] = np.deg2rad(piece.gyro_dps), piece.accel_g * STANDARD_GRAVITY
        self.look.take(rows, rows["stamp_ns"])
        for first in range(0, piece.t.size, _SPAN):
            span = np.hstack([piece.gyro_dps, piece.accel_g])[first : first + _SPAN]
            if np.isfinite(span).any():
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", RuntimeWarning)  # of channels that are missing
                    median = np.nanmedian(span, axis=0)
                    self._means.append(median)
                    self._spread.append(1.4826 * np.nanmedian(np.abs(span - median), axis=0))

    def _note_large(self, name: str, values: np.ndarray) -> None:
        with np.errstate(invalid="ignore"):
            beyond = (np.abs(values.reshape(len(values), -1)) > sample_check.LARGEST.get(name, _LARGEST)).any(axis=1)
        if beyond.any():
            self._large.setdefault(name, []).extend((np.flatnonzero(beyond) + self.count)[:_SHOWN].tolist())

    def _refuse_large(self) -> None:
        """Raise ImportDataError for readings that no unit has."""
        for name, rows in self._large.items():
            largest, unit = sample_check.LARGEST.get(name, _LARGEST), _UNITS.get(name, "")
            few = len(rows) < _SHOWN
            raise ImportDataError(
                f"{self.path}: `{name}` is beyond ±{largest:,.0f}{unit} in row {rows[0]} (first row is 0;"
                f" {len(rows)}{'' if few else ' or more'} such rows). Nothing is that large.",
                [cure("--drop", ",".join(map(str, rows)))] if few else [],
            )

    @property
    def medians(self) -> np.ndarray:
        """Medians of gyros (deg/s) and accelerometers (g) over the recording, shape (6,)."""
        return np.asarray(np.median(self._means, axis=0)) if self._means else np.full(6, np.nan)

    def moves(self, *, forces_only: bool = False) -> bool:
        """Return whether the unit moves: single readings that are off do not count."""
        means, spread = np.array(self._means), np.array(self._spread)
        if not len(means):
            return False
        with np.errstate(invalid="ignore"):
            wide = np.nanmedian(spread, axis=0)
            apart = np.nanmax(means, axis=0) - np.nanmin(means, axis=0)
            # forces in another unit than g are larger
            limits = _LIMITS * np.repeat([1.0, max(1.0, float(np.linalg.norm(np.nan_to_num(self.medians[3:]))))], 3)
            moving = (wide > limits) | (apart > 3.0 * limits)
            return bool((moving[3:] if forces_only else moving).any())

    @property
    def unread(self) -> tuple[str, ...]:
        """Names of channels that it lacks, NaN throughout."""
        return sample_check.names(self.lacks)

    @property
    def has_temperature(self) -> bool:
        """Whether any temperature was taken."""
        return bool(self._degc)

    @property
    def rate_hz(self) -> float:
        """Mean rate, (N - 1)/duration."""
        return (self.count - 1) / (self.last_s - self.first_s)

    def known(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return times and arrays that state the motion; empty if there are none."""
        if not self._known:
            return np.empty(0), {}
        names = self._known[0][1]
        return np.concatenate([t for t, _ in self._known]), {
            name: np.concatenate([known[name] for _, known in self._known]) for name in names
        }

    # -- judging --

    def _judge(self) -> list[str]:
        """Return what is assumed of times and readings; raises ImportDataError for what has to be stated."""
        options, look, assumed = self._options, self.look, list[str]()
        whole = options.start is None and options.end is None
        equal = self._rows - self.count - len(options.drop) if whole else 0
        if self._rows < 2:
            raise ImportDataError(f"{self.path} has {self._rows} samples; at least two are needed.")
        if equal > max(_FEWEST, _FEW * self._rows) and not options.arrival:
            raise ImportDataError(
                f"{self.path}: {equal:,} of {self._rows:,} rows have the time of the one before: times are rounded.",
                [cure("--stamps", "arrival"), cure("--rate", "100")] if self.count > 10 else [cure("--rate", "100")],
            )
        if self.count < 2:
            raise ImportDataError(
                f"{self.path}: --start and --end leave fewer than two samples of {self._rows:,} rows."
            )
        if self.lacks.all():
            raise ImportDataError(f"{self.path} has no reading in any channel: `gyro` and `accel` are NaN throughout.")
        if self._dates:
            assumed.append("times are dates")
        if options.rate_hz is not None:
            assumed.append(f"rows follow each other at {options.rate_hz:g} Hz")
        if equal:
            assumed.append(f"{equal:,} row{'' if equal == 1 else 's'} with the time of the one before left out")
        if look.stamps.back and not options.arrival:
            assumed += self._ordered()
        self._refuse_scales()
        self._refuse_large()
        if (missing := look.missing - (self.count if self.lacks.any() else 0)) > 0:
            assumed.append(f"{missing:,} sample{'' if missing == 1 else 's'} with NaN or blank cells hold no reading")
        if look.zero:
            assumed.append(f"{look.zero:,} sample{'' if look.zero == 1 else 's'} of six zeros hold no reading")
        return assumed

    def _ordered(self) -> list[str]:
        """Put rows into order that are a little out of it; raises ImportDataError for a clock that was set back."""
        whole = _joined(list(self._chosen(self._read())), self.not_imported)
        t, order = whole.t, np.argsort(whole.t, kind="stable")
        moved, back = np.abs(order - np.arange(order.size)), np.flatnonzero(np.diff(t) < 0.0)
        usual = float(np.median(np.diff(t)))
        jumps = np.flatnonzero(np.diff(t) > 10.0 * max(usual, 1e-9))
        if back.size == 1 and any(abs(int(jump) - int(back[0])) == 1 for jump in jumps.tolist()):
            raise self._far(t, usual)
        if moved.max() <= foreign_log.NEAR and foreign_log.is_orderly(t):
            ordered = _rows(whole, order)
            self._whole = _rows(ordered, np.diff(ordered.t, prepend=-np.inf) > 0.0)
            self.count, self.first_s = self._whole.t.size, float(self._whole.t[0])
            self.last_s = float(self._whole.t[-1])
            return [f"{np.count_nonzero(moved):,} rows put into the order of their times"]
        k = int(back[0]) + 1
        by, at = float(t[k - 1] - t[k]), float(t[k - 1] - t[0])
        periods = [period for period in _PERIODS if abs(by - period) < 0.05 * period]
        cures = [cure("--units", f"t:s%{periods[0]:g}")] if periods and t[k] < 0.1 * by else []
        cures += [cure("--end", f"{at - 1e-3:.3f}")] if at > 1.0 else []
        cures += [cure("--start", f"{max(at, 0.0) + 1e-3:.3f}")] if t[-1] - t[0] > at + 1.0 else []
        cures += [cure("--rate", f"{1.0 / usual:g}")] if usual > 0.0 else []
        places = "once" if back.size == 1 else f"{back.size} times"
        raise ImportDataError(
            f"{self.path}: time does not increase at row {k}: {t[k - 1]:.6f} s, then {t[k]:.6f} s; it goes back"
            f" {places}: a clock was set, or begins anew.",
            cures,
        )

    def _far(self, t: np.ndarray, usual: float) -> ImportDataError:
        """Return the error for one time that is far off the others."""
        line = np.median(t - usual * np.arange(t.size)) + usual * np.arange(t.size)
        k = int(np.argmax(np.abs(t - line)))
        return ImportDataError(
            f"{self.path}: the time of row {k} (first row is 0) is {t[k] - line[k]:+.6g} s off its place.",
            [cure("--drop", str(k)), *([cure("--end", f"{t[k - 1] - t[0]:.3f}")] if k > 1 else [])],
        )

    def _fit(self) -> str:
        """Fit sampling instants under the times; returns how, in words."""
        t = np.concatenate([piece.t for piece in self._chosen(self._read())])
        if (np.diff(t) < 0.0).any():
            raise ImportDataError(f"{self.path}: times that go back are no arrivals.", [cure("--end", "10")])
        fitted = arrival_stamps.from_arrivals(t)
        self._instants = fitted.t
        self.first_s, self.last_s = float(fitted.t[0]), float(fitted.t[-1])
        how = "one regular grid" if fitted.pieces == 1 else f"{fitted.pieces} joined regular grids"
        late = f"late by {fitted.median_late * 1e3:.1f} ms in the median, {fitted.max_late * 1e3:.1f} ms at most"
        self.stamps = (
            f"sampling instants fitted under the recording's arrival times ({how}; arrivals {late}), {STARTED}"
        )
        return f"sampling instants fitted under the arrivals in {fitted.pieces} piece(s); they are {late}"

    def bursts(self) -> str:
        """Return what makes the times look like arrivals in bursts, in figures; "" if they do not."""
        return "" if self._options.arrival else self.look.bursts()

    def _stated(self, quantity: str) -> bool:
        """Return whether a flag or the file states the unit of a quantity, such as `gyro`."""
        stated = {column.stated for name, column in self._assigned.columns.items() if name.startswith(quantity)}
        return "flag" in stated or ("file" in stated and self._source.states_units)

    def _refuse_scales(self) -> None:
        """Raise ImportDataError where numbers do not fit the units that nobody stated."""
        units, words, medians = list[str](), list[str](), self.medians
        span, step = self.last_s - self.first_s, self.look.step_ns / 1e9
        rate = 1.0 / step if step > 0.0 else 0.0
        if self._options.rate_hz is None and not self._stated("t") and not _RATES[0] <= rate <= _RATES[1]:
            scale = _time_unit(rate)
            words.append(f"`t` in s would give {rate:.3g} Hz over {span:.3g} s")
            units += [f"t:{scale}"] if scale else []
        if not self._stated("accel") and not self.moves(forces_only=True) and np.isfinite(medians[3:]).all():
            force = float(np.linalg.norm(medians[3:]))
            unit = next((unit for unit, size in _FORCES if 0.8 < force / size < 1.2), None)
            if unit is not None:
                words.append(f"at rest `accel` reads {force:.5g}, not 1 g")
                units.append(f"accel:{unit}")
            elif force < 0.05:
                names = [name for name in self._assigned.columns if not name.startswith("accel")]
                kept = ",".join(f"{name}={self._assigned.columns[name].name}" for name in names)
                raise ImportDataError(
                    f"{self.path}: at rest `accel` reads {force:.3g} g: gravity was taken out of it. A calibration"
                    " needs it: export the raw accelerometer, or leave these columns out and have the gyros alone.",
                    [cure("--columns", kept, "--reference", "level")],
                )
            elif 50.0 < force < _MOST_COUNTS:
                bits = 2 ** round(math.log2(force))
                words.append(f"at rest `accel` reads {force:.5g}: counts of the converter")
                units.append(f"accel:g/{bits}")
                units += [] if self._stated("gyro") else ["gyro:deg/s/131"]
        noise = np.rad2deg(self.look.noise()[:3])
        quiet = bool(np.nanmedian(noise) < _QUIET_DPS) and bool(np.nanmax(np.abs(medians[:3])) < 0.05)
        if not self._stated("gyro") and not self.moves() and quiet and np.nanmedian(noise) > 0.0:
            words.append(f"at rest `gyro` scatters by {np.nanmedian(noise):.2g}, which is little for deg/s")
            units.append("gyro:rad/s")
        in_radians = self._assigned.columns.get("gyro_x", _LACKING).scale > 50.0
        if in_radians and not self._stated("gyro") and not self.moves(forces_only=True) and np.nanmedian(noise) > 1.0:
            words.append(f"at rest `gyro` scatters by {np.nanmedian(noise):.2g} deg/s, which is much for rad/s")
            units.append("gyro:deg/s")
        if self._degc and not self._stated("temp") and np.median(self._degc) > _ROOM_DEGC:
            words.append(f"`temp` is {np.median(self._degc):.4g}")
            units.append("temp:K")
        if units:
            stated = ",".join(dict.fromkeys([*(self._options.units or "").replace(" ", "").split(","), *units]))
            alone = ", if these are its units" if len(units) == 1 and units[0] == "gyro:rad/s" else ""
            raise ImportDataError(f"{self.path}: {'; '.join(words)}{alone}.", [cure("--units", stated.strip(","))])
        if words:
            raise ImportDataError(f"{self.path}: {'; '.join(words)}. State its unit: --units t:UNIT, or --rate HZ.")
        if span > _LONGEST_S and not self.look.stamps.back:
            raise ImportDataError(
                f"{self.path}: `t` spans {span:.3g} s, more than ten years. State its unit: --units t:ms"
            )


_NAMES = 'Name them: --columns "t=NAME,gyro_x=NAME,gyro_y=NAME,gyro_z=NAME,accel_x=NAME,accel_y=NAME,accel_z=NAME"'
_PERIODS = (60.0, 3600.0, 86400.0, 604800.0)  # after which clocks begin anew, s
_LACKING = Column(0, "", "", "")  # of a quantity that the recording lacks
_SPAN = 512  # samples of a median
_FAR_NS = 9e18  # a time so far away is none
_MOST_COUNTS = 1e7  # at rest, of a converter
_SHOWN = 20  # rows that are named
_LIMITS = np.repeat([_STILL_DPS, _STILL_G], 3)
_FORCES = (("g", 1.0 / STANDARD_GRAVITY), ("m/s2", STANDARD_GRAVITY), ("mg", 1000.0), ("mm/s2", 1e3 * STANDARD_GRAVITY))


def _time_unit(rate: float) -> str | None:
    """Return the unit in which a mean rate is one of a recording, the larger one first; None if none is."""
    sizes = (("ms", 1e3), ("us", 1e6), ("ns", 1e9))
    return next((unit for unit, size in sizes if 0.5 <= rate * size <= 10_000.0), None)


class _Part:
    """The samples in a row from the last one before `start` to the first one behind `end`."""

    def __init__(self, options: Options, first: float) -> None:
        self._start = -np.inf if options.start is None else first + options.start
        self._end = np.inf if options.end is None else first + options.end
        self._begun = self._over = False

    def has(self, t: np.ndarray) -> np.ndarray:
        """Return which of the next samples are in the part, bool, shape (n,)."""
        use = np.zeros(t.size, bool)
        if self._over or not t.size:
            return use
        early = np.flatnonzero(t < self._start) if not self._begun else np.empty(0, int)
        begin = int(early[-1]) + 1 if early.size else 0
        self._begun = self._begun or begin < t.size
        late = np.flatnonzero(t[begin:] > self._end)
        use[begin : begin + int(late[0]) if late.size else t.size] = True
        self._over = bool(late.size)
        return use


def _rows(recording: Recording, which: np.ndarray) -> Recording:
    degc = recording.temperature_degc
    return replace(
        recording,
        t=recording.t[which],
        gyro_dps=recording.gyro_dps[which],
        accel_g=recording.accel_g[which],
        temperature_degc=None if degc is None else degc[which],
        known={name: values[which] for name, values in recording.known.items()},
    )


def _cut(recording: Recording) -> Iterator[Recording]:
    for first in range(0, recording.t.size, ROWS):
        yield _rows(recording, np.arange(first, min(first + ROWS, recording.t.size)))


def _joined(pieces: list[Recording], left: tuple[str, ...]) -> Recording:
    def of(get: Callable[[Recording], np.ndarray]) -> np.ndarray:
        return np.concatenate([get(piece) for piece in pieces])

    first = pieces[0]
    degc = None if first.temperature_degc is None else of(lambda piece: np.asarray(piece.temperature_degc))
    if degc is not None and not np.isfinite(degc).any():
        degc = None
    known = {name: of(lambda piece, name=name: piece.known[name]) for name in first.known}  # type: ignore[misc]
    t, gyro, accel = of(lambda p: p.t), of(lambda p: p.gyro_dps), of(lambda p: p.accel_g)
    return Recording(t, gyro, accel, degc, left, known)


def load(path: Path, start: float | None = None, end: float | None = None) -> Recording:
    """Return all samples of a recording; raises ImportDataError as `RecordingFile`.

    `start`, `end`: part to take, s since its first sample.
    """
    return RecordingFile(path, Options(start, end)).whole()

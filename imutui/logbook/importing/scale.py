"""Units that the numbers contradict: gravity that reads 9.8 or 16384, rates that are too quiet for deg/s, kelvin.

Only units that neither the file nor the user states are judged; a command that states them always gets past.
"""

from collections.abc import Mapping

import numpy as np

from imutui.logbook.importing import columns, rows
from imutui.logbook.importing.columns import ACCEL, GYRO, Channel
from imutui.logbook.importing.rows import Part
from imutui.logbook.importing.table import Asked, ImportDataError, Table

_ROWS = 2**16
_MOST_SAMPLED = 2**17
_GRAVITY = {
    "m/s2": (9.0, 10.6), "cm/s2": (976.0, 986.0), "mg": (960.0, 1015.0), "ft/s2": (31.0, 33.5),
    "g/256": (240.0, 272.0), "g/1024": (1015.0, 1090.0), "g/2048": (1930.0, 2170.0), "g/4096": (3850.0, 4350.0),
    "g/8192": (7700.0, 8700.0), "g/16384": (15400.0, 17400.0),
}  # fmt: skip
"""Units by what gravity reads in them: the median magnitude of the accelerometers."""
_PLAUSIBLE = (0.3, 20.0)
_QUIET = 6e-4  # deg/s/√Hz: less noise than this is that of an optical gyro, or of another one in rad/s
_FAST = 10.0  # rad/s; few units turn faster
_ROTATED = 0.3  # ratio of rates that gravity shows to rates read as deg/s; π/180 if they are, 1 if they are rad/s
_WARMEST = 150.0
_STILL_G, _STILL_DPS = 0.1, 5.0
_NOISY = {"rad/s": 1.0, "deg/s": 3.0}  # deg/s; rates that scatter by more at rest are in another unit


class Look:
    """Statistics of a recording's readings: of its first rows, and of rows spread over all of it."""

    def __init__(self) -> None:
        self._head: list[np.ndarray] = []
        self._spread: list[np.ndarray] = []
        self._rows = self._stride = 0

    def take(self, part: Part, readings: np.ndarray) -> None:
        """Look at rows: readings of shape (N, 7), gyros, accelerometers and temperature."""
        if sum(map(len, self._head)) < _ROWS:
            self._head.append(np.column_stack([part.t, readings])[:_ROWS])
        self._stride = self._stride or 1
        first = -self._rows % self._stride
        self._spread.append(readings[first :: self._stride].copy())  # a view would keep all rows
        self._rows += len(readings)
        if sum(map(len, self._spread)) > _MOST_SAMPLED:
            self._spread = [np.concatenate(self._spread)[::2]]
            self._stride *= 2

    def sample(self) -> np.ndarray:
        """Return readings spread over the recording, shape (M, 7)."""
        return np.concatenate(self._spread)

    def rest(self) -> tuple[np.ndarray, bool]:
        """Return the mean of the accelerometers (g, shape (3,)), and whether the unit hardly moves.

        The largest and smallest hundredth of each channel count as the hundredths next to them: a glitch is no motion.
        """
        readings = np.nan_to_num(self.sample()[:, :6])
        readings = readings[readings.any(axis=1)] if readings.any() else readings
        low, high = np.percentile(readings, [1.0, 99.0], axis=0)
        sd = (high - low) / 4.65
        is_still = bool((sd[:3] <= _STILL_DPS).all() and (sd[3:] <= _STILL_G).all())
        return np.clip(readings, low, high).mean(axis=0)[3:], is_still

    def head(self) -> np.ndarray:
        """Return time (s) and readings of the first rows, shape (M, 8)."""
        return np.concatenate(self._head)


def check(
    table: Table,
    asked: Asked,
    channels: Mapping[str, Channel],
    look: Look,
    rate: float,
    of_time: rows.TimeUnit,
) -> None:
    """Refuse units that are not stated and that the readings contradict.

    `rate`: of the rows, Hz, by the time as it was read.
    `of_time`: the unit of time that fits better.
    Raises ImportDataError with the command that states all units that fit.
    """
    sample = look.sample()
    accel, gyro = ([channels[name] for name in names if name in channels] for names in (ACCEL, GYRO))
    units: dict[str, str] = {"t": of_time.unit} if of_time.unit else {}
    why: list[str] = [of_time.why] if of_time.unit else []
    rate /= of_time.ratio
    with np.errstate(invalid="ignore"):
        norms = np.linalg.norm(sample[:, 3:6], axis=1)
    known = norms[np.isfinite(norms)]
    of_file = accel[0].unit if accel else "g"
    norm = float(np.median(known)) / (columns.factor("accel", of_file) or (1.0, 0.0))[0] if known.size else 1.0
    unit = next((unit for unit, (low, high) in _GRAVITY.items() if low <= norm <= high), "")
    if unit == of_file:
        unit, norm = "", 1.0
    elif not unit and of_file != "g" and 0.9 < norm < 1.1:
        unit = "g"
    if accel and not all(c.stated for c in accel) and (unit or not _PLAUSIBLE[0] < norm < _PLAUSIBLE[1]):
        if norm < _PLAUSIBLE[0] and not _GRAVITY["m/s2"][0] <= norm * rate <= _GRAVITY["m/s2"][1]:
            alone = asked.command(table.path, columns="accel=none")
            raise ImportDataError(
                f"{table.path}: the accelerometers read {norm:.3g} g in the median: gravity was removed from them, so"
                f" they are no specific force. To import the gyros alone: `{alone}`"
            )
        if norm < _PLAUSIBLE[0]:  # increments of velocity and angle from row to row
            unit = f"m/s2/{1.0 / rate:.9g}"
            units["gyro"] = f"rad/s/{1.0 / rate:.9g}"
        unit = unit or f"g/{norm:.0f}"
        why.append(f"the accelerometers read {norm:.5g} in the median, as gravity does in {unit}")
        units["accel"] = unit
    if gyro and not all(c.stated for c in gyro) and "gyro" not in units:
        of_file = gyro[0].unit
        noise = _noise(look.head()[:, 1:4]) if not accel or _is_steady(sample[:, 3:6]) else 0.0
        if units.get("accel", "").startswith("g/"):
            units["gyro"] = "deg/s/131"
        elif noise > _NOISY[of_file]:
            units["gyro"] = "deg/s" if of_file == "rad/s" and np.deg2rad(noise) < _NOISY["deg/s"] else "mdeg/s"
            why.append(f"gyros in {of_file} would scatter by {noise:.2g} deg/s at rest, as in {units['gyro']}")
        elif of_file == "deg/s" and (said := _not_degrees(look.head(), of_time.ratio)):
            units["gyro"] = "rad/s"
            why.append(said)
        elif "accel" in units and of_file == "deg/s":
            units["gyro"] = "deg/s"
    degc = sample[:, 6][np.isfinite(sample[:, 6])]
    temp = channels.get("temp")
    if temp is not None and not temp.stated and degc.size and np.median(degc) > _WARMEST:
        warm = float(np.median(degc))
        if warm > 400.0:
            raise ImportDataError(
                f"{table.path}: `temp` is {warm:.5g} in the median, which is no temperature in degC. To leave it out:"
                f" `{asked.command(table.path, columns='temp=none')}`"
            )
        units["temp"] = "K"
        why.append(f"`temp` is {warm:.4g} in the median, as in kelvin")
    if why:
        listed = ", ".join(f"{kind}:{unit}" for kind, unit in units.items())
        counts = (
            " Counts per unit stand in the unit's data sheet: many have 131 per deg/s at ±250 deg/s, 65.5 at ±500, 32.8"
            " at ±1000, 16.4 at ±2000."
            if "deg/s/131" in listed
            else ""
        )
        raise ImportDataError(
            f"{table.path}: {'; '.join(why)}, and the file states no unit. If that is so:"
            f" `{asked.command(table.path, units=listed)}`.{counts}"
        )


def _is_steady(accel: np.ndarray) -> bool:
    """Return whether accelerometers hardly change, but for a hundredth of their readings."""
    read = accel[:, np.isfinite(accel).any(axis=0)]
    low, high = np.nanpercentile(read, [1.0, 99.0], axis=0)
    return not read.size or bool((high - low).max() < 0.25 * np.linalg.norm(0.5 * (high + low)))


def _noise(gyro: np.ndarray) -> float:
    """Return the standard deviation of gyros by the changes from row to row, in their unit."""
    changes = np.abs(np.diff(gyro[np.isfinite(gyro).all(axis=1)], axis=0))
    return float(np.median(changes)) / 0.954 if changes.size else 0.0


def _not_degrees(head: np.ndarray, second: float) -> str:
    """Return why gyros that are read as deg/s are rather in rad/s; "" if nothing contradicts deg/s.

    `second`: seconds of one unit of time.
    """
    head = head * np.r_[second, np.ones(7)]
    t, gyro, accel = head[:, 0], head[:, 1:4], head[:, 4:7]
    good = np.isfinite(head[:, :7]).all(axis=1)
    if np.count_nonzero(good) < 100:
        good = np.isfinite(head[:, :4]).all(axis=1)
    t, gyro, accel = t[good], gyro[good], accel[good]
    if t.size < 100 or t[-1] <= t[0]:
        return ""
    rate = (t.size - 1) / float(t[-1] - t[0])
    steps = np.sort(np.abs(np.diff(gyro, axis=0)), axis=0)[: int(0.98 * t.size)]
    density = float(np.median(steps.mean(axis=0))) / 1.128 / np.sqrt(rate / 2.0)
    if density > 0.0 and (ratio := _turns_of_gravity(t, gyro, accel, rate)) is not None:
        return "" if ratio < _ROTATED else "the gyros read a 57th of the rates at which gravity turns, as in rad/s"
    if 0.0 < density < _QUIET and float(np.percentile(np.abs(gyro), 99)) < _FAST:
        return f"the gyros' noise would be {density:.1e} deg/s/√Hz, quieter than others by far, as in rad/s"
    return ""


def _turns_of_gravity(t: np.ndarray, gyro: np.ndarray, accel: np.ndarray, rate: float) -> float | None:
    """Return the ratio of the rates of gravity's direction to those of the gyros; None if the unit does not turn."""
    if not np.isfinite(accel).all():
        return None
    size = max(1, round(0.1 * rate))
    count = t.size // size
    means = [values[: count * size].reshape(count, size, -1).mean(axis=1) for values in (t[:, None], gyro, accel)]
    if count < 20:
        return None
    change = np.diff(means[2], axis=0)
    between = [0.5 * (values[1:] + values[:-1]) for values in means[1:]]
    turned = np.cross(between[0], between[1]) * np.diff(means[0], axis=0)
    product, square, total = (float(np.sum(values)) for values in (change * turned, turned**2, change**2))
    if square == 0.0 or total == 0.0 or product**2 < 0.5 * square * total:
        return None
    return abs(product) / square


def guess(table: Table) -> dict[str, int]:
    """Return columns that look like channels by their first rows: time that increases, then two vectors.

    The accelerometers are the vector whose magnitude is the steadiest.
    """
    numeric = range(min(len(table.columns), 64))
    try:
        arrays = next(table.pieces(list(numeric)))[1]
    except (StopIteration, ImportDataError):
        return {}
    values = [np.asarray(array[:5000], float) for array in arrays]
    usable = [k for k, v in enumerate(values) if v.size > 2 and np.isfinite(v).mean() > 0.5 and np.nanstd(v) > 0.0]
    others = [k for k in usable if columns.kind_of(table.columns[k].name) in ("gyro", "accel", "temp")]
    clocks = [k for k in usable if k not in others and np.mean(np.diff(values[k]) > 0.0) > 0.9]
    clocks.sort(key=lambda k: bool(columns.COUNTER.search(table.columns[k].name)))
    rest = [k for k in usable if k not in clocks and (not clocks or k > min(clocks))]
    if len(rest) < 6:
        return {"t": clocks[0]} if clocks else {}
    first, second = rest[:3], rest[3:6]
    steadiness = []
    for triple in (first, second):
        norm = np.linalg.norm(np.stack([values[k] for k in triple]), axis=0)
        steadiness.append(float(np.nanstd(norm) / max(float(np.nanmean(norm)), 1e-12)))
    gyro, accel = (first, second) if steadiness[1] <= steadiness[0] else (second, first)
    found = (
        ({"t": clocks[0]} if clocks else {}) | dict(zip(GYRO, gyro, strict=True)) | dict(zip(ACCEL, accel, strict=True))
    )
    left = [k for k in usable if k not in found.values() and k > max(found.values())]
    if len(left) == 1 and -60.0 < float(np.nanmedian(values[left[0]])) < 100.0:
        found["temp"] = left[0]
    return found

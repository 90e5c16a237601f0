"""Which column of a recording is which quantity, and in which unit: by names, by units in a header, or by flags.

Quantities are `t` (s), `gyro_x` … (deg/s), `accel_x` … (g), `temp` (degC), and those of a reference by their own names.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY

REQUIRED = ("t", *(f"{vector}_{axis}" for vector in ("gyro", "accel") for axis in "xyz"))
REFERENCES = {"ang": 3, "rate": 3, "ref_quat": 4, "gps_pos": 3, "gps_vel_ned": 3}
"""Vectors that state the motion, and how many components each has."""
PARTS = {3: "xyz", 4: "wxyz"}
_OWN = {f"{name}_{part}" for name, width in REFERENCES.items() for part in PARTS[width]}
_DEG = 180.0 / 3.141592653589793

UNITS: dict[str, dict[str, float]] = {
    "t": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0},
    "gyro": {
        "deg/s": 1.0, "dps": 1.0, "degs-1": 1.0, "degree/s": 1.0, "degrees/s": 1.0, "mdps": 1e-3, "deg/h": 1.0 / 3600.0,
        "rad/s": _DEG, "rads-1": _DEG, "rads": _DEG, "radian/s": _DEG, "radians/s": _DEG, "mrad/s": 1e-3 * _DEG,
    },
    "accel": {
        "g": 1.0, "gs": 1.0, "mg": 1e-3, "ug": 1e-6, "µg": 1e-6, "m/s2": 1.0 / STANDARD_GRAVITY,
        "ms-2": 1.0 / STANDARD_GRAVITY, "m/s/s": 1.0 / STANDARD_GRAVITY, "mps2": 1.0 / STANDARD_GRAVITY,
        "mm/s2": 1e-3 / STANDARD_GRAVITY, "cm/s2": 1e-2 / STANDARD_GRAVITY,
    },
    "temp": {"degc": 1.0, "c": 1.0, "celsius": 1.0, "k": 1.0, "kelvin": 1.0, "degf": 5.0 / 9.0, "f": 5.0 / 9.0,
             "mdegc": 1e-3},
}  # fmt: skip
"""Size of each unit in ours: s, deg/s, g, degC."""
_OFFSETS = {"k": -273.15, "kelvin": -273.15, "degf": -160.0 / 9.0, "f": -160.0 / 9.0}
_USUAL = {"t": "s", "gyro": "deg/s", "accel": "g", "temp": "degC"}

_STEMS = {
    "gyro": ("gyro", "gyr", "gyroscope", "g", "w", "omega", "angular_velocity", "angularvelocity", "angular_rate",
             "angrate", "rotation_rate", "rotationrate", "rot", "w_rs_s", "uncompgyro", "imu_gyro",
             "field_angular_velocity"),
    "accel": ("accel", "acc", "accelerometer", "acceleration", "a", "linear_acceleration", "specific_force", "f",
              "a_rs_s", "uncompaccel", "uncompacc", "imu_accel", "field_linear_acceleration"),
}  # fmt: skip
_TIMES = {
    "t": "", "time": "", "timestamp": "", "stamp": "", "seconds": "s", "secs": "s", "sec": "s", "elapsed": "",
    "seconds_elapsed": "s", "time_elapsed": "", "millis": "ms", "micros": "us", "timeus": "us", "timems": "ms",
    "timestampus": "us", "timestampms": "ms", "time_boot": "", "timestamp_sample": "us", "sampletimefine": "s/10000",
    "timestartup": "ns", "unixtime": "", "epoch": "", "systemtime": "", "rosbagtimestamp": "ns", "packet_time": "",
}  # fmt: skip
_TEMPERATURES = ("temp", "temperature", "temperatur", "t_imu", "imu_temp", "imu_temperature", "temp_c", "tempc", "tmp")
_SUFFIXES = (
    ("_mps2", "m/s2"), ("_m_s2", "m/s2"), ("_ms2", "m/s2"), ("_rad_s", "rad/s"), ("_rads", "rad/s"), ("_rps", "rad/s"),
    ("_radps", "rad/s"), ("_deg_s", "deg/s"), ("_degs", "deg/s"), ("_dps", "deg/s"), ("_mg", "mg"), ("_ns", "ns"),
    ("_us", "us"), ("_ms", "ms"), ("_rad", "rad/s"), ("_degc", "degc"), ("_g", "g"), ("_s", "s"), ("_c", "c"),
    ("_k", "k"),
)  # fmt: skip
_NAMED_UNIT = re.compile(r"^(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*$")
_AXES = {"x": "x", "y": "y", "z": "z", "0": "x", "1": "y", "2": "z"}


@dataclass(frozen=True, slots=True)
class Column:
    """Where a quantity comes from."""

    place: int  # of the column
    name: str
    unit: str  # as stated, or "" for the usual one
    stated: str  # "flag", "file" or "": whether a flag or the file states the unit
    scale: float = 1.0
    offset: float = 0.0
    modulo: float = 0.0  # at which a time begins anew, s; 0 if it does not


@dataclass(frozen=True, slots=True)
class Assignment:
    """The columns of a recording by quantity."""

    columns: Mapping[str, Column]
    left: tuple[str, ...]  # names of columns that nothing takes
    assumed: tuple[str, ...]  # in words


class UnassignedError(InputError):
    """Columns of a recording are missing or ambiguous; `columns` proposes a value of --columns, "" if there is none."""

    def __init__(self, message: str, columns: str) -> None:
        super().__init__(message)
        self.columns = columns


def assign(
    names: Sequence[str], units: Mapping[str, str], columns: str | None, stated: str | None, *, words: bool = True
) -> Assignment:
    """Return which column is which quantity.

    `names`: of the columns, in order.
    `units`: of columns, by name, as a row of units has them.
    `columns`: of --columns, such as "t=timestamp:ms, gyro_x=gx".
    `stated`: of --units, such as "t:us, gyro:rad/s".
    `words`: whether the assignment says what it assumes.
    Raises UnassignedError if a required quantity has no column, or several.
    Raises InputError if a flag does not read so.
    """
    of_flags = _of_units(stated)
    found = _by_names(names, units) if columns is None else _of_flag(names, columns)
    done = {name: _scaled(name, column, of_flags) for name, column in found.items()}
    missing = [name for name in REQUIRED if name not in done]
    # a recording may lack one kind of sensor, if the caller says so
    whole = [kind for kind in ("gyro", "accel") if all(f"{kind}_{axis}" in done for axis in "xyz")]
    if missing and (columns is None or "t" not in done or not whole):
        listed = ", ".join(names) or "nothing"
        raise UnassignedError(f"has no column for {', '.join(missing)}; it has: {listed}", _proposed(names, found))
    places = {column.place for column in done.values()}
    left = tuple(name for k, name in enumerate(names) if k not in places)
    return Assignment(done, left, tuple(_words(done)) if words else ())


def _words(done: Mapping[str, Column]) -> list[str]:
    other = [f"{name}={column.name}" for name, column in done.items() if not _is_named(name, column)]
    words = [f"columns {', '.join(other)}"] if other else []
    stated = {name.partition("_")[0]: column for name, column in done.items() if column.stated == "file"}
    unusual = [f"{name} in {column.unit}" for name, column in stated.items() if column.scale != 1.0 or column.offset]
    return words + ([f"{', '.join(unusual)} as the file states"] if unusual else [])


def _is_named(target: str, column: Column) -> bool:
    """Return whether a column has the name of its quantity, with or without a unit, or a flag names it."""
    match = _NAMED_UNIT.match(column.name)
    return column.stated == "flag" or (column.name if match is None else match[1]).strip().lower() == target


# --------------------------------------------------------------------------------------------------------------- flags


def _of_units(text: str | None) -> dict[str, str]:
    found = {}
    for part in _split(text or ""):
        name, colon, unit = part.partition(":")
        if not colon or name.strip() not in UNITS:
            raise InputError(f'--units has "{part}"; it takes such as "t:us, gyro:rad/s, accel:m/s2, temp:K"')
        found[name.strip()] = unit.strip()
    return found


def _of_flag(names: Sequence[str], text: str) -> dict[str, Column]:
    found = {}
    for part in _split(text):
        target, equals, source = (word.strip() for word in part.partition("="))
        name, _, unit = source.partition(":") if source not in names else (source, "", "")
        if not equals or (target not in (*REQUIRED, "temp") and target not in _OWN):
            raise InputError(f'--columns has "{part}"; it takes such as "t=time:ms, gyro_x=gx:rad/s, …, accel_z=az:g"')
        found[target] = Column(_place(names, name.strip()), name.strip(), unit.strip(), "flag" if unit.strip() else "")
    return found


def _place(names: Sequence[str], name: str) -> int:
    if re.fullmatch(r"#\d+", name) and 1 <= int(name[1:]) <= len(names):
        return int(name[1:]) - 1
    if list(names).count(name) == 1:
        return list(names).index(name)
    why = "stands twice: name its place, such as #9" if name in names else f"is not there; there are {', '.join(names)}"
    raise InputError(f'--columns names the column "{name}", which {why}')


def _split(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


# --------------------------------------------------------------------------------------------------------------- names


def _by_names(names: Sequence[str], units: Mapping[str, str]) -> dict[str, Column]:
    """Return the columns whose names say what they are; our own names come first.

    Raises UnassignedError if several columns are the same quantity.
    """
    found: dict[str, list[Column]] = {}
    for k, name in enumerate(names):
        target, unit = _meaning(name)
        if target is not None:
            unit = unit or units.get(name, "")
            found.setdefault(target, []).append(Column(k, name, unit, "file" if unit else ""))
    chosen = {}
    for target, columns in found.items():
        own = [column for column in columns if column.name == target]
        if len(own or columns) > 1:
            several = ", ".join(f"#{column.place + 1} {column.name}" for column in columns)
            proposed = _proposed(names, {name: each[0] for name, each in found.items()}, places=True)
            raise UnassignedError(f"has several columns for {target} ({several})", proposed)
        chosen[target] = (own or columns)[0]
    return chosen


def _meaning(name: str) -> tuple[str | None, str]:
    """Return the quantity that a column's name stands for, None if none, and the unit in the name."""
    base, unit = name.strip(), ""
    if (match := _NAMED_UNIT.match(base)) and not match[2].strip().isdigit():
        base, unit = match[1], match[2]
    base = re.sub(r"[\s.\-/]+", "_", base.strip().lower())
    base = re.sub(r"\[(\d)\]$", r"_\1", base).strip("_#")
    if base in REQUIRED or base == "temp" or base in _OWN:
        return base, unit
    for suffix, of_suffix in ("", ""), *_SUFFIXES:
        if suffix and not (base.endswith(suffix) or re.search(rf"{suffix}_[xyz012]$", base)):
            continue
        bare = base if not suffix else re.sub(rf"{suffix}(_[xyz012])?$", r"\1", base)
        target, implied = _plain_meaning(bare)
        if target is not None:
            return target, unit or of_suffix or implied
    return None, ""


def _plain_meaning(bare: str) -> tuple[str | None, str]:
    if bare in _TIMES:
        return "t", _TIMES[bare]
    if bare in _TEMPERATURES:
        return "temp", ""
    for vector, stems in _STEMS.items():
        for stem in stems:
            rest = bare.removeprefix(stem).removeprefix("_") if bare.startswith(stem) else ""
            if rest in _AXES:
                return f"{vector}_{_AXES[rest]}", ""
    return None, ""


def _proposed(names: Sequence[str], found: Mapping[str, Column], *, places: bool = False) -> str:
    """Return what --columns may state: the columns that were found, or those of a table in our order; "" if neither."""
    ours = (*REQUIRED, "temp")
    if all(name in found for name in REQUIRED):
        chosen = {name: found[name] for name in ours if name in found}
        known = {
            name: (f"#{column.place + 1}" if places else column.name) + (f":{column.unit}" if column.unit else "")
            for name, column in chosen.items()
        }
    elif not found and len(names) >= len(REQUIRED) and all(name.startswith("#") for name in names):
        known = {name: f"#{k + 1}" for k, name in enumerate(ours[: len(names)])}
    else:
        return ""
    return ",".join(f"{name}={source}" for name, source in known.items())


# --------------------------------------------------------------------------------------------------------------- units


def _key(unit: str) -> str:
    """Return a unit without the ways of writing it that do not matter."""
    plain = {"μ": "µ", "°": "deg", "²": "2", "⁻¹": "-1", "⁻²": "-2"}
    text = unit.lower()
    for sign, letters in plain.items():
        text = text.replace(sign, letters)
    return re.sub(r"[\s^·*]", "", text)


def _scaled(target: str, column: Column, of_flags: Mapping[str, str]) -> Column:
    """Return a column with the size of its unit."""
    quantity = target.partition("_")[0]
    if quantity not in UNITS:
        return column
    if quantity in of_flags and column.stated != "flag":
        column = replace(column, unit=of_flags[quantity], stated="flag")
    unit, _, period = column.unit.partition("%")
    scale, key = _size(quantity, unit or _USUAL[quantity])
    if scale is None:
        known = ", ".join(UNITS[quantity])
        where = "--units or --columns state" if column.stated == "flag" else "the file states"
        raise InputError(f'{where} the unit "{unit}" for {target}, which is not known. Known for {quantity}: {known}')
    modulo = float(period) * scale if period else 0.0
    return replace(column, scale=scale, offset=_OFFSETS.get(key, 0.0), modulo=modulo)


def _size(quantity: str, unit: str) -> tuple[float | None, str]:
    """Return the size of a unit, such as "rad/s" or "g/16384", None if it is not known, and the unit's own name."""
    key = _key(unit)
    if key in UNITS[quantity]:
        return UNITS[quantity][key], key
    match = re.fullmatch(r"(.+)/(\d+\.?\d*)", key)
    if match and match[1] in UNITS[quantity] and float(match[2]) > 0.0:
        return UNITS[quantity][match[1]] / float(match[2]), match[1]
    return None, key

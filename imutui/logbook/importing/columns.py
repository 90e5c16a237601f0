"""Which column is which channel, and in which unit: by names as loggers write them, or `--columns` and `--units`."""

import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from imutui.logbook.importing.table import Asked, ImportDataError, Table

PARTS = {3: "xyz", 4: "wxyz"}
REFERENCES = {"ang": 3, "rate": 3, "ref_quat": 4, "gps_pos": 3, "gps_vel_ned": 3}
"""What a recording may state of the motion, and how many components; NaN is "unknown" there."""
GYRO, ACCEL = ([f"{name}_{axis}" for axis in "xyz"] for name in ("gyro", "accel"))
CHANNELS = ("t", *GYRO, *ACCEL, "temp")
OWN_UNITS = {"t": "s", "gyro": "deg/s", "accel": "g", "temp": "degC"}

_G = 9.80665
# value in our unit = scale × value + offset
_UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "t": {
        "s": (1, 0), "ms": (1e-3, 0), "us": (1e-6, 0), "ns": (1e-9, 0), "min": (60, 0), "h": (3600, 0), "d": (86400, 0),
    },
    "gyro": {
        "deg/s": (1, 0), "rad/s": (180 / np.pi, 0), "mdeg/s": (1e-3, 0), "deg/h": (1 / 3600, 0),
        "mrad/s": (0.18 / np.pi, 0), "rpm": (6, 0),
    },
    "accel": {
        "g": (1, 0), "mg": (1e-3, 0), "ug": (1e-6, 0), "m/s2": (1 / _G, 0), "ft/s2": (0.3048 / _G, 0),
        "cm/s2": (1e-2 / _G, 0), "mm/s2": (1e-3 / _G, 0),
    },
    "temp": {"degC": (1, 0), "K": (1, -273.15), "degF": (1 / 1.8, -32 / 1.8)},
}  # fmt: skip
_SPELT = {
    "s": "s sec secs second seconds", "ms": "ms msec millis milliseconds", "us": "us usec micros microseconds",
    "ns": "ns nsec nanos nanoseconds", "min": "min minutes", "h": "h hr hours", "d": "d days",
    "deg/s": "deg/s dps degs degps deg/sec degs-1 degsec degrees/s degrees/sec degrees/second degree/second deg/second",
    "rad/s": "rad/s rads rads-1 rad/sec radps rad radsec radians/s radians/sec radians/second radian/second rad/second",
    "mdeg/s": "mdeg/s mdps", "mrad/s": "mrad/s mrads mrads-1 mradps", "rpm": "rpm rev/min",
    "deg/h": "deg/h deg/hr dph", "g": "g gs g0 gn", "mg": "mg", "ug": "ug",
    "m/s2": "m/s2 ms2 ms-2 mps2 m/s/s m/sec2 mss m/second2 meters/second2 metres/second2 meters/s2 metres/s2",
    "ft/s2": "ft/s2", "cm/s2": "cm/s2 cms2 cms-2 gal", "mm/s2": "mm/s2 mms2 mms-2",
    "degC": "degc c celsius", "K": "k kelvin",
    "degF": "degf f fahrenheit",
}  # fmt: skip
_ALIASES = {word: unit for unit, words in _SPELT.items() for word in words.split()}
TICKS = {"SampleTimeFine": "10000Hz"}
"""Units of times by the name of their column, which the numbers may contradict: other models of Xsens count us."""
COUNTER = re.compile("(?i)count|index|packet|sample|seq|frame")
_COUNTS = re.compile(r"(.+)/(\d+\.?\d*)")
_RATE = re.compile(r"(\d+\.?\d*)\s*Hz", re.IGNORECASE)

_TIME = re.compile(
    r"(system|device|sensor|sample|unix|epoch|elapsed|relative|log|gps)?(ts?|times?|timestamps?|stamp|tow|datetime)"
    r"(sample|startup|fine|since\w+)?|seconds?(elapsed)?|elapsed|millis|micros|uptime|epoch|utc|ticks?|ms|us|msec|usec"
    r"|zeit|date"
)
_AXES = "(imu|raw|motion|sensor|uncomp)?{}(rss|raw|data|rad|uncalibrated)?([xyz])"
_NAMED = {
    "gyro": "(gyroscope|gyro|gyr|gyrorotation|rotationrate|angularvelocity|angularrate|angvel|omega|w|g)",
    "accel": "(accelerometeracceleration|accelerometer|acceleration|accel|acc|lin(?:ear)?acc(?:eleration)?"
    "|specificforce|a)",
}
_PATTERNS = {kind: re.compile(_AXES.format(names)) for kind, names in _NAMED.items()}
_AXIS_FIRST = {"gyro": re.compile(f"([xyz])(axis)?({_NAMED['gyro']}|rate)")}
_AXIS_FIRST["accel"] = re.compile(f"([xyz])(axis)?{_NAMED['accel']}")
_TEMPERATURE = re.compile(r"(imu|sensor|gyro|accel|chip|die)?(temp|temperature|temperatur|tempc)")


@dataclass(frozen=True, slots=True)
class Channel:
    """A channel of the recording."""

    name: str  # one of `CHANNELS`, or of a reference's component
    column: int  # its position in the table; -1 counts the rows
    unit: str
    stated: str  # who states the unit: "user", "file", or "" for nobody
    by_name: bool = False  # whether its column was found by its name alone
    negated: bool = False  # whether the column holds minus the channel, as `-accY` does

    @property
    def kind(self) -> str:
        """The key of `--units` that it belongs to."""
        return self.name.partition("_")[0]

    def converted(self, values: np.ndarray) -> np.ndarray:
        """Return values in our unit, float64; those that are in it already stay as they are, to the last bit."""
        scale, offset = factor(self.kind, self.unit) or (1.0, 0.0)
        values = np.asarray(values, dtype=float)
        values = -values if self.negated else values
        return values if (scale, offset) == (1.0, 0.0) else values * scale + offset


def factor(kind: str, unit: str) -> tuple[float, float] | None:
    """Return scale and offset of a unit, such as `rad/s`, `g/16384` or `100Hz`; None if it is none of this kind."""
    if kind not in _UNITS:
        return (1.0, 0.0)
    if kind == "t" and (rate := _RATE.fullmatch(unit)) and float(rate[1]) > 0.0:
        return 1.0 / float(rate[1]), 0.0
    if (counts := _COUNTS.fullmatch(unit)) and float(counts[2]) > 0.0 and counts[1] in _UNITS[kind]:
        scale, offset = _UNITS[kind][counts[1]]
        return scale / float(counts[2]), offset
    return _UNITS[kind].get(unit)


def unit_of(text: str) -> str:
    """Return the unit that a text spells, "" if none: `[m s^-2]`, `°/s`, `dps`, `µs`."""
    word = text.strip(" ()[]{}<>").lower()
    for old, new in (("°", "deg"), ("µ", "u"), ("μ", "u"), ("²", "2"), ("⁻", "-"), ("¹", "1"), ("per", "/")):
        word = word.replace(old, new)
    return _ALIASES.get(re.sub(r"[\s_*^·.()]", "", word), "")


def stated_unit(text: str) -> str:
    """Return the unit that a text spells, the text if it looks like a unit that is not known, else ""."""
    return unit_of(text) or (text.strip(" ()[]{}<>") if re.search(r"[/^]|s-[12]\b", text) else "")


def split_unit(name: str) -> tuple[str, str]:
    """Return a column's name and the unit in it: `gyro_x (rad/s)`, `Timestamp [ns]`, `gx_dps`, `TimeUS`."""
    name = name.strip()
    if (bracketed := re.fullmatch(r"(.*?)[\s_]*[(\[{<]([^\d)\]][^)\]}>]*)[)\]}>]", name)) and bracketed[1]:
        return bracketed[1], stated_unit(bracketed[2])
    index = re.search(r"\[([0-2])\]$", name)
    axis = f"_{'xyz'[int(index[1])]}" if index else ""
    words = re.split(r"[ _-]", name[: index.start()] if index else name)
    for count in (2, 3, 1):
        base = "_".join(words[:-count]) + axis
        kind = kind_of(base) if len(words) > count else ""
        if kind and (unit := unit_of("".join(words[-count:]))) in _UNITS[kind]:
            return base, unit
    if together := re.fullmatch(r"(?i)(time|timestamp|t)(us|ms|ns)", name):
        return together[1], together[2].lower()
    if name in TICKS:
        return name, TICKS[name]
    if name.lower() in ("millis", "micros", "ms", "us", "msec", "usec"):
        return name, unit_of(name)
    return "_".join(words) + axis if index else name, ""


def kind_of(name: str) -> str:
    """Return the kind of channel that a column is by its name: t, gyro, accel, temp, or ""."""
    return meant(name).partition("_")[0]


def meant(name: str) -> str:
    """Return the channel that a column's name means, "" if none; of a path, its last two parts may mean it."""
    if found := _meant(name):
        return found
    path = [part for part in re.split(r"[./]", name) if part]
    return _meant("_".join(path[-2:])) if len(path) > 2 else ""


def _meant(name: str) -> str:
    word = re.sub(r"[^a-z0-9]", "", name.lower())
    for kind in ("gyro", "accel"):
        if found := _PATTERNS[kind].fullmatch(word):
            return f"{kind}_{found[4]}"
        if found := _AXIS_FIRST[kind].fullmatch(word):
            return f"{kind}_{found[1]}"
    if _TIME.fullmatch(word):
        return "t"
    return "temp" if _TEMPERATURE.fullmatch(word) else ""


# --------------------------------------------------------------------------------------------------------------- choice


Guess: TypeAlias = Callable[[], Mapping[str, int]]


def choose(table: Table, asked: Asked, guess: Guess) -> dict[str, Channel]:
    """Return the channels by name: as `--columns` has them, else by the names of the columns.

    `guess`: columns that look like channels by their numbers, for a proposal.
    Raises ImportDataError if a required channel has no column, or several; the message has a command that works.
    """
    asked_columns = _entries(asked.columns, "=", "--columns", "t=#1, gyro_x=#2:rad/s")
    asked_units = _entries(asked.units, ":", "--units", "t:us, gyro:rad/s, accel:m/s2, temp:K")
    known = {*CHANNELS, *(part for name, width in REFERENCES.items() for part in parts(name, width))}
    _check_keys(asked_columns, {*known, "gyro", "accel"}, "--columns", table, asked)
    _check_keys(asked_units, {*_UNITS, *CHANNELS}, "--units", table, asked)
    found: dict[str, tuple[int, str]] = {}
    for key, text in _components(table, asked_columns).items():
        found[key] = _column(table, key, text)
    candidates = {name: _candidates(table, name) for name in known if name not in found}
    doubtful = {name: at for name, at in candidates.items() if len(at) > 1}
    found |= {name: (at[0], "") for name, at in candidates.items() if len(at) == 1}
    missing = [name for name in CHANNELS[:-1] if name not in found and name not in doubtful]
    if missing or doubtful:
        _refuse(table, asked, missing, doubtful, found, guess() if missing or "t" in doubtful else {})
    channels = {}
    for name, (column, stated) in sorted(found.items(), key=lambda item: item[1][0]):
        kind = name.partition("_")[0]
        if column == _NONE:
            continue
        of_file = table.columns[column].unit if column >= 0 else ""
        asked_unit = stated or asked_units.get(name) or asked_units.get(kind)
        if of_file and kind in _UNITS and not asked_unit and not factor(kind, of_file):
            raise ImportDataError(
                f'{table.path}: the unit of `{table.columns[column].name}` is "{of_file}", which is not known; known'
                f" are {', '.join(_UNITS[kind])}. If it is {OWN_UNITS[kind]}:"
                f" `{asked.command(table.path, units=f'{kind}:{OWN_UNITS[kind]}')}`"
            )
        unit = asked_unit or (of_file if kind in _UNITS else "")
        unit = unit if factor(kind, unit or "s") and unit else _spelt(kind, unit, table, asked)
        is_sure = column < 0 or table.columns[column].is_sure
        who = "user" if asked_unit else "file" if unit and is_sure else ""
        by_name = name in candidates
        negated = by_name and kind in ("gyro", "accel") and table.columns[column].name.startswith("-")
        channels[name] = Channel(name, column, unit or OWN_UNITS.get(kind, ""), who, by_name, negated)
    return channels


_ROW, _NONE = -1, -2


def parts(name: str, width: int) -> list[str]:
    """Names of a vector's components."""
    return [name] if width == 1 else [f"{name}_{part}" for part in PARTS.get(width, [str(k) for k in range(width)])]


def _entries(text: str, mark: str, option: str, example: str) -> dict[str, str]:
    """Entries of an option by their keys."""
    entries = {}
    for entry in filter(None, (part.strip() for part in text.split(","))):
        key, found, value = entry.partition(mark)
        if not found or not value.strip() or not key.strip():
            raise ImportDataError(f'{option} has "{entry}", which is not KEY{mark}VALUE: {option} "{example}".')
        entries[key.strip()] = value.strip()
    return entries


def _check_keys(entries: Mapping[str, str], known: set[str], option: str, table: Table, asked: Asked) -> None:
    if wrong := [key for key in entries if key not in known]:
        listed = ", ".join(sorted(known & {*CHANNELS, *_UNITS}))
        raise ImportDataError(f'{option} names "{wrong[0]}" of {table.path}, which is not one of: {listed}.')


def _components(table: Table, entries: Mapping[str, str]) -> dict[str, str]:
    """Entries with a vector's replaced by those of its components: `gyro=gyr` of columns gyr_x, gyr_y, gyr_z."""
    out = {}
    for key, text in entries.items():
        if key not in ("gyro", "accel"):
            out[key] = text
            continue
        name, _, unit = text.partition(":")
        for axis in "xyz":
            out[f"{key}_{axis}"] = text if name == "none" else f"{name}_{axis}" + (f":{unit}" if unit else "")
    return out


def _column(table: Table, key: str, text: str) -> tuple[int, str]:
    """Return the position of the column that an entry of --columns names, and its unit."""
    name, unit = text, ""
    head, found, tail = text.rpartition(":")
    if found and factor(key.partition("_")[0], unit_of(tail) or tail):
        name, unit = head.strip(), unit_of(tail) or tail
    if name == "none":
        return _NONE, ""
    if name == "row" and key == "t":
        return _ROW, unit
    if (position := re.fullmatch(r"#(\d+)", name)) and 1 <= int(position[1]) <= len(table.columns):
        return int(position[1]) - 1, unit
    at = [k for k, column in enumerate(table.columns) if column.name == name]
    at = at or [k for k, column in enumerate(table.columns) if column.name.lower() == name.lower()]
    at = at or [k for k, column in enumerate(table.columns) if column.name == split_unit(name)[0]]
    if len(at) == 1:
        return at[0], unit
    if at:
        raise ImportDataError(
            f"{table.path}: `{name}` stands in {_listed(at)}: name {key} by position, {key}=#{at[0] + 1}."
        )
    raise ImportDataError(f"{table.path} has no column `{name}`; it has: {listed(table)}.")


def _listed(positions: list[int]) -> str:
    return " and ".join(f"#{k + 1}" for k in positions)


def listed(table: Table) -> str:
    """Names of a table's columns, by position where they have none."""
    return ", ".join(column.name or f"#{k + 1}" for k, column in enumerate(table.columns))[:1000] or "nothing"


def _candidates(table: Table, channel: str) -> list[int]:
    """Positions of columns that may be a channel: those of its exact name, else those that mean it."""
    exact = [k for k, column in enumerate(table.columns) if column.name == channel]
    return exact or [k for k, column in enumerate(table.columns) if column.name and meant(column.name) == channel]


def _spelt(kind: str, unit: str | None, table: Table, asked: Asked) -> str:
    """Return a unit that the user spelt in another way; raises ImportDataError if there is none."""
    if not unit or factor(kind, unit_of(unit) or unit):
        return unit_of(unit or "") or unit or ""
    known = ", ".join(_UNITS[kind])
    raise ImportDataError(
        f'{table.path}: "{unit}" is no unit of {kind}. Units are {known}, or one over counts: g/16384.'
    )


def _refuse(
    table: Table, asked: Asked, missing: list[str], doubtful: Mapping[str, list[int]],
    found: Mapping[str, tuple[int, str]], guess: Mapping[str, int],
) -> None:  # fmt: skip
    """Raise for channels without a column, or with several, proposing one for each."""
    chosen = {name: at[0] for name, at in doubtful.items()} | {
        name: guess[name] for name in (*missing, "temp") if name in guess and name not in found
    }
    if guess.get("t") in doubtful.get("t", []):  # of several times the one that goes on from row to row
        chosen["t"] = guess["t"]
    names = [column.name for column in table.columns]
    if "t" in missing and "t" not in chosen:
        chosen["t"] = _ROW
    texts = {
        name: "row:100Hz"
        if at == _ROW
        else names[at]
        if names.count(names[at]) == 1 and _is_plain(names[at])
        else f"#{at + 1}"
        for name, at in chosen.items()
    }
    ordered = ", ".join(f"{name}={texts[name]}" for name in CHANNELS if name in texts)
    if doubtful:
        name, at = min(doubtful.items(), key=lambda item: CHANNELS.index(item[0]))
        what = f"{table.path}: columns {_listed(at)} may each be {name} (it has: {listed(table)})"
    else:
        vector = missing[0].partition("_")[0]
        what = f"{table.path} has no `{vector}`; it has: {listed(table)}"
    if "t" in missing and (chosen["t"] == _ROW or COUNTER.search(texts["t"])):
        texts["t"] += "" if chosen["t"] == _ROW else ":100Hz"
        what += ". If rows are equally spaced, give their rate (100 Hz here)"
        ordered = ", ".join(f"{name}={texts[name]}" for name in CHANNELS if name in texts)
    if len(chosen) < len(missing) + len(doubtful):
        raise ImportDataError(
            f"{what}. Needed: t in s, gyro in deg/s, accel in g, each sample a row; --columns names them:"
            f' --columns "t=#1:ms, gyro_x=#2:rad/s, …".'
        )
    guessed = " The numbers suggest" if missing else " To take the first of them"
    raise ImportDataError(f"{what}.{guessed}: `{asked.command(table.path, columns=ordered)}`")


def _is_plain(name: str) -> bool:
    return bool(re.fullmatch(r"[\w .\[\]/-]+", name)) and name not in ("row", "none")


def assumed(table: Table, channels: Mapping[str, Channel]) -> list[str]:
    """Return which columns were taken as channels by another name, and in which units, in words."""
    others = {
        name: table.columns[c.column].name + (", whose sign is turned" if c.negated else "")
        for name, c in channels.items()
        if c.column >= 0 and c.by_name and table.columns[c.column].name != name
    }
    out = [", ".join(f"`{name}` is {column}" for name, column in others.items())] if others else []
    of_kind = {c.kind: c for c in channels.values() if c.kind in OWN_UNITS and c.stated != "user"}
    units = [
        f"{kind} in {c.unit}" for kind, c in of_kind.items() if c.unit != OWN_UNITS[kind] or others or not c.stated
    ]
    return [*out, ", ".join(units)] if units else out


def left(table: Table, channels: Mapping[str, Channel]) -> tuple[str, ...]:
    """Return the names of columns that were left aside; a vector's components as one name."""
    used = {channel.column for channel in channels.values()}
    unused = {c.name or f"#{k + 1}" for k, c in enumerate(table.columns) if k not in used}
    taken = {_vector(table.columns[k].name) for k in used if k >= 0}
    counts = Counter(map(_vector, unused))
    return tuple(sorted({v if counts[v := _vector(n)] > 1 and v not in taken else n for n in unused}))


def _vector(name: str) -> str:
    return re.sub(r"_(\d+|[wxyz])$", "", name)

"""Configuration: flags > environment `IMUTUI_*` > ./imutui.toml > the user's file > defaults, with the source of each.

A key such as `paths.logs` is `[paths] logs = …` in a file and `IMUTUI_PATHS_LOGS` in the environment.
"""

import difflib
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import platformdirs

from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY
from filters.state import PAPER_PLACE
from imutui import outside_file, toml_text

Value = str | int | float

DEFAULTS: dict[str, Value] = {
    "paths.logs": "./logs",
    "paths.file_mode": "0640",
    "paths.min_free_mb": 200.0,  # 0: no limit
    "instrument.rate_range_dps": 200.0,
    "instrument.accel_range_g": 4.0,
    "instrument.g_unit": STANDARD_GRAVITY,
    "instrument.accel_sign": -1,
    "instrument.mount": "x,y,z",
    "instrument.gyro_sign": "1,1,1",
    "acquisition.rate_hz": 133.0,
    "acquisition.sampling": "stream",
    "acquisition.baud": 38400,
    "acquisition.operator": "",
    "acquisition.place": "",
    "acquisition.table": "",
    "acquisition.rotate_minutes": 0.0,  # 0: never
    "acquisition.rotate_mb": 0.0,  # 0: never
    "foxglove.port": 0,  # 0: what is recorded is not served
    "foxglove.host": "127.0.0.1",  # of this computer only
    "foxglove.origins": "",  # of further pages that may read the stream, such as https://viewer.example.org
    "site.latitude_deg": PAPER_PLACE[0],
    "site.longitude_deg": PAPER_PLACE[1],
    "site.height_m": PAPER_PLACE[2],
    "site.gravity_mps2": 0.0,  # 0: WGS-84 normal gravity at the site
    "filter.name": "spkf",
    "filter.reference": "level",
    "filter.measurements": "exact",
    "filter.seed": 0,
    "filter.kappa": 0.0,
    "filter.noise": "table1",
    "screen.fps": 0.0,  # 0: 10, and 5 over SSH
    "screen.plot": "auto",  # scroll, sweep, numbers; auto: scroll, and less where the terminal falls behind
    "screen.glyphs": "auto",  # braille, block, ascii
    "screen.theme": "",
}

# settings that are one of a few values
ALLOWED: dict[str, tuple[Value, ...]] = {
    "paths.file_mode": ("0600", "0640", "0644", "0660", "0664", "0666"),
    "instrument.accel_sign": (-1, 1),
    "acquisition.sampling": ("stream", "polled"),
    "filter.name": ("spkf", "spkf-paper", "ekf", "none"),
    "filter.measurements": ("exact", "drawn"),
    "filter.noise": ("table1", "log"),
    "screen.plot": ("auto", "scroll", "sweep", "numbers"),
    "screen.glyphs": ("auto", "braille", "block", "ascii"),
}
# numbers that have a smallest value; what else they may be is known where they are used
LEAST: dict[str, float] = {
    "paths.min_free_mb": 0.0,
    "acquisition.rotate_minutes": 0.0,
    "acquisition.rotate_mb": 0.0,
    "site.gravity_mps2": 0.0,
    "foxglove.port": 0,
    "filter.seed": 0,
    "screen.fps": 0.0,
}

FILE = "imutui.toml"
_PREFIX = "IMUTUI_"
_VARIABLES = {_PREFIX + key.upper().replace(".", "_"): key for key in DEFAULTS}
_SECTIONS = tuple({_PREFIX + key.split(".")[0].upper() + "_" for key in DEFAULTS})


@dataclass(frozen=True, slots=True)
class Setting:
    """An effective value and where it comes from."""

    value: Value
    source: str


@dataclass(frozen=True, slots=True)
class File:
    """A place where settings are looked for, and whether there was a file."""

    path: Path
    read: bool


@dataclass(frozen=True, slots=True)
class Config:
    """Effective settings."""

    settings: dict[str, Setting]
    warnings: list[str]  # unknown keys in files: said, not refused, since the file may serve another version
    files: tuple[File, ...] = ()  # where settings were looked for, the one that wins last

    def text(self, key: str) -> str:
        """Value of a text setting."""
        return str(self.settings[key].value)

    def number(self, key: str) -> float:
        """Value of a number."""
        return float(self.settings[key].value)

    def integer(self, key: str) -> int:
        """Value of a whole number."""
        return int(self.settings[key].value)

    @property
    def file_mode(self) -> int:
        """Permissions of logs, as the system takes them."""
        return int(self.text("paths.file_mode"), 8)

    def with_flags(self, flags: Mapping[str, Value | None]) -> "Config":
        """Copy in which flags that were given win.

        Raises InputError if a key is unknown or a value does not fit.
        """
        settings = dict(self.settings)
        for key, value in flags.items():
            if value is not None:
                settings[key] = Setting(_fit(key, value, "command line"), "command line")
        return Config(settings, self.warnings, self.files)


def load(environment: Mapping[str, str] = os.environ, folder: Path | None = None) -> Config:
    """Read all sources; ./imutui.toml is looked for in `folder`, the working folder unless given.

    Raises InputError if a file is no TOML, or a value does not fit its key.
    """
    settings = {key: Setting(value, "default") for key, value in DEFAULTS.items()}
    warnings: list[str] = []
    files: list[File] = []
    for path in (Path(platformdirs.user_config_dir("imutui")) / FILE, (folder or Path.cwd()) / FILE):
        values = _file(path)
        files.append(File(path, values is not None))
        for key, value in (values or {}).items():
            if key in DEFAULTS:
                settings[key] = Setting(_fit(key, value, str(path)), str(path))
            else:
                warnings.append(f"{path}: unknown setting `{key}`{_meant(key, DEFAULTS)}")
    for name in environment:
        if name.startswith(_SECTIONS) and name not in _VARIABLES:
            warnings.append(f"environment: unknown setting {name}{_meant(name, _VARIABLES)}")
    for name, key in _VARIABLES.items():
        if name in environment:
            settings[key] = Setting(_fit(key, environment[name], name), name)
    return Config(settings, warnings, tuple(files))


def parse_pairs(pairs: list[str]) -> dict[str, Value]:
    """Settings written as `key=value`; raises InputError if one is not written so, is unknown, or does not fit."""
    out: dict[str, Value] = {}
    for pair in pairs:
        key, separator, value = pair.partition("=")
        if not separator:
            raise InputError(f'--set "{pair}" is not key=value, such as filter.kappa=-12')
        out[key.strip()] = _fit(key.strip(), value.strip(), "--set")
    return out


def _file(path: Path) -> dict[str, Any] | None:
    """Keys and values of a file; None if there is none."""
    try:
        tree = toml_text.parse(outside_file.read(path, toml_text.LIMIT))
    except FileNotFoundError:
        return None
    except InputError as error:
        raise InputError(f"{path} is not valid TOML: {error}") from error
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    out: dict[str, Any] = {}
    for section, values in tree.items():
        out |= {f"{section}.{key}": v for key, v in values.items()} if isinstance(values, dict) else {section: values}
    return out


def _fit(key: str, value: Any, source: str) -> Value:
    if key not in DEFAULTS:
        raise InputError(f"{source}: unknown setting `{key}`{_meant(key, DEFAULTS)}; known: {', '.join(DEFAULTS)}")
    kind = type(DEFAULTS[key])
    if (fitted := _as(kind, value)) is None:
        raise InputError(f'{source}: `{key}` is "{value}", not {_KINDS[kind]}')
    if key in ALLOWED and fitted not in ALLOWED[key]:
        raise InputError(f'{source}: `{key}` is "{value}", not one of: {", ".join(map(str, ALLOWED[key]))}')
    if key in LEAST and float(fitted) < LEAST[key]:
        raise InputError(f'{source}: `{key}` is "{value}"; it must be {LEAST[key]:g} or more')
    return fitted


_KINDS = {str: "a text", int: "a whole number", float: "a number"}


def _as(kind: type, value: Any) -> Value | None:
    """A value as a text, a whole number or a number; None if it is none."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        return None
    if kind is str:
        return str(value)  # a table's number is a name too
    try:
        if kind is int and isinstance(value, str | int):
            return int(value)
        number = float(value)
    except (ValueError, OverflowError):
        return None
    if not math.isfinite(number) or (kind is int and not number.is_integer()):
        return None
    return int(number) if kind is int else number


def _meant(word: str, known: Iterable[str]) -> str:
    """What an unknown key or variable may have been meant for."""
    near = difflib.get_close_matches(word, list(known), 1, 0.8)
    return f"; did you mean `{near[0]}`?" if near else ""

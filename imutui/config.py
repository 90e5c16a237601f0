"""Configuration: flags > environment `IMUTUI_*` > ./imutui.toml > the user's file > defaults, with the source of each.

A key such as `paths.logs` is `[paths] logs = …` in a file and `IMUTUI_PATHS_LOGS` in the environment.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import platformdirs

from filters.errors import InputError
from imutui import declared, outside_file, toml_text
from imutui.declared import meant
from imutui.settings import SETTINGS, settings_of

Value = str | int | float
"""Value of a setting; None instead where it is the unit's own."""
Values: TypeAlias = dict[str, Any]
"""Values of settings by the names of their fields."""

FILE = "imutui.toml"
_PREFIX = "IMUTUI_"
_VARIABLES = {_PREFIX + key.upper().replace(".", "_"): key for key in SETTINGS}
_SECTIONS = tuple({_PREFIX + key.split(".")[0].upper() + "_" for key in SETTINGS})


@dataclass(frozen=True, slots=True)
class Effective:
    """The effective value of a setting, and where it comes from."""

    value: Value | None
    source: str


@dataclass(frozen=True, slots=True)
class File:
    """A place where settings are looked for, and whether there was a file."""

    path: Path
    read: bool


@dataclass(frozen=True, slots=True)
class Config:
    """Effective settings."""

    settings: dict[str, Effective]
    warnings: list[str]  # unknown keys in files are no errors, since the file may serve another version
    files: tuple[File, ...] = ()  # places of files, in order; the last one wins

    def text(self, key: str) -> str:
        """Value of a text setting."""
        return str(self.settings[key].value)

    def number(self, key: str) -> float:
        """Value of a number."""
        return float(self.settings[key].value or 0.0)

    def values(self, record: type) -> Values:
        """Values of the settings that a record has, by the names of its fields."""
        return {each.name: self.settings[key].value for key, each in settings_of(record).items()}

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
                settings[key] = Effective(_fit(key, value, "command line"), "command line")
        return Config(settings, self.warnings, self.files)


def load(environment: Mapping[str, str] = os.environ, folder: Path | None = None) -> Config:
    """Read all sources; ./imutui.toml is looked for in `folder`, the working folder unless given.

    Raises InputError if a file is no TOML, or a value does not fit its key.
    """
    settings = {key: Effective(each.default, "default") for key, each in SETTINGS.items()}
    warnings: list[str] = []
    files: list[File] = []
    for path in (Path(platformdirs.user_config_dir("imutui")) / FILE, (folder or Path.cwd()) / FILE):
        values = _file(path)
        files.append(File(path, values is not None))
        for key, value in (values or {}).items():
            if key in SETTINGS:
                settings[key] = Effective(_fit(key, value, str(path)), str(path))
            else:
                warnings.append(f"{path}: unknown setting `{key}`{meant(key, SETTINGS)}")
    for name in environment:
        if name.startswith(_SECTIONS) and name not in _VARIABLES:
            warnings.append(f"environment: unknown setting {name}{meant(name, _VARIABLES)}")
    for name, key in _VARIABLES.items():
        if name in environment:
            settings[key] = Effective(_fit(key, environment[name], name), name)
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
    if key not in SETTINGS:
        raise InputError(f"{source}: unknown setting `{key}`{meant(key, SETTINGS)}; known: {', '.join(SETTINGS)}")
    setting = SETTINGS[key]
    try:
        fitted: Value = declared.read(_typed(value, setting.kind), setting.shape, key)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    return fitted


def _typed(value: Any, kind: type) -> Any:
    """Return a number of a text, or the text of a number, if that is what the setting is; else the value as it is."""
    if isinstance(value, bool) or not isinstance(value, str | int | float) or kind is str:
        return value if isinstance(value, bool) or not isinstance(value, int | float) else str(value)
    try:
        return kind(value) if isinstance(value, str) or kind(value) == value else value
    except (ValueError, OverflowError):
        return value

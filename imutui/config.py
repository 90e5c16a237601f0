"""Configuration: flags > environment `IMUTUI_*` > ./imutui.toml > the user's file > defaults, with the source of each.

A key such as `paths.logs` is `[paths] logs = …` in a file and `IMUTUI_PATHS_LOGS` in the environment.
"""

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import platformdirs

from filters.imu import STANDARD_GRAVITY
from filters.state import PAPER_SITE

Value = str | int | float

DEFAULTS: dict[str, Value] = {
    "paths.logs": "./logs",
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
    "site.latitude_deg": -23.21132308,
    "site.longitude_deg": -45.85917610,
    "site.height_m": PAPER_SITE.height,
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


class ConfigError(Exception):
    """A setting is not what it should be; the message says which, where, and what it may be."""


@dataclass(frozen=True, slots=True)
class Setting:
    """An effective value and where it comes from."""

    value: Value
    source: str


class Config:
    """Effective settings.

    Attributes
    ----------
    settings : dict
        Key to `Setting`.
    warnings : list of str
        Unknown keys in files: said, not refused, since the file may serve another version.
    """

    def __init__(self, settings: dict[str, Setting], warnings: list[str]) -> None:
        self.settings = settings
        self.warnings = warnings

    def text(self, key: str) -> str:
        """Value of a text setting."""
        return str(self.settings[key].value)

    def number(self, key: str) -> float:
        """Value of a number."""
        return float(self.settings[key].value)

    def integer(self, key: str) -> int:
        """Value of a whole number."""
        return int(self.settings[key].value)

    def with_flags(self, flags: Mapping[str, Value | None]) -> "Config":
        """Copy in which flags that were given win.

        Raises
        ------
        ConfigError
            If a key is unknown or a value does not fit.
        """
        settings = dict(self.settings)
        for key, value in flags.items():
            if value is not None:
                settings[key] = Setting(_fit(key, value, "command line"), "command line")
        return Config(settings, self.warnings)


def load(environment: Mapping[str, str] = os.environ, folder: Path | None = None) -> Config:
    """Read all sources.

    Parameters
    ----------
    environment : mapping
        Environment variables.
    folder : Path or None
        Where ./imutui.toml is looked for; the working folder unless given.

    Raises
    ------
    ConfigError
        If a file is no TOML, or a value does not fit its key.
    """
    settings = {key: Setting(value, "default") for key, value in DEFAULTS.items()}
    warnings: list[str] = []
    for path in (Path(platformdirs.user_config_dir("imutui")) / "imutui.toml", (folder or Path()) / "imutui.toml"):
        for key, value in _file(path).items():
            if key in DEFAULTS:
                settings[key] = Setting(_fit(key, value, str(path)), str(path))
            else:
                warnings.append(f"{path}: unknown setting `{key}`")
    for key in DEFAULTS:
        name = "IMUTUI_" + key.upper().replace(".", "_")
        if name in environment:
            settings[key] = Setting(_fit(key, environment[name], name), name)
    return Config(settings, warnings)


def parse_pairs(pairs: list[str]) -> dict[str, Value]:
    """Settings written as `key=value`.

    Raises
    ------
    ConfigError
        If one is not written so, is unknown, or does not fit.
    """
    out: dict[str, Value] = {}
    for pair in pairs:
        key, separator, value = pair.partition("=")
        if not separator:
            raise ConfigError(f'--set "{pair}" is not key=value, such as filter.kappa=-12')
        out[key.strip()] = _fit(key.strip(), value.strip(), "--set")
    return out


def _file(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as stream:
            tree = tomllib.load(stream)
    except FileNotFoundError:
        return {}
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not valid TOML: {error}") from error
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    return {
        f"{section}.{key}": value
        for section, values in tree.items()
        for key, value in (values.items() if isinstance(values, dict) else [("", values)])
    }


def _fit(key: str, value: Any, source: str) -> Value:
    if key not in DEFAULTS:
        raise ConfigError(f"{source}: unknown setting `{key}`; known: {', '.join(DEFAULTS)}")
    kind = type(DEFAULTS[key])
    try:
        return kind(value)
    except (TypeError, ValueError) as error:
        raise ConfigError(f'{source}: `{key}` is "{value}", not a {kind.__name__}') from error

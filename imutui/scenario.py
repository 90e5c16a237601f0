"""Read files that state what a table does and what is simulated: profiles (TOML or CSV) and scenarios (TOML).

docs/formats.md has both formats. Effects and their parameters are those of `filters.simulation`.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import radians
from pathlib import Path
from typing import Annotated, Any, Literal, Required, TypedDict

from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY, AxisMap, parse_mount
from filters.motion.profile import Profile
from filters.simulation import (
    FAULT_KINDS,
    TABLE_FAULT_KINDS,
    Effect,
    Fault,
    Personality,
    PowerOn,
    Scenario,
    TableFault,
    TableModel,
    Temperature,
)
from filters.state import PAPER_SITE, Site
from imutui import declared, outside_file, toml_text
from imutui.declared import Meta, refuse_unknown
from imutui.logbook import reference_file

_MG = 1e-3 * STANDARD_GRAVITY
_SQRT_HOUR = 60.0
_SIMULATED = "VIRTUAL SIM"


class ScenarioError(InputError):
    """A profile or scenario is not what it should be; the message says which file, which key, and what it may be."""


def load_profile(path: Path) -> Profile:
    """Motion of a table from a TOML file, or, by its suffix, a CSV with a heading `t, outer, middle, inner` (s, deg).

    A TOML file may name a CSV, as `samples = "angles.csv"` relative to it, in place of segments, and so give it `sign`,
    `align`, `offset_sd_s`.
    Raises ScenarioError if it can't be read, or something in it does not fit.
    """
    if path.suffix.lower() == ".csv":
        return _csv_profile(path)
    document = _parsed(path)
    try:
        return _profile(document, path.parent)
    except ScenarioError:
        raise
    except InputError as error:
        raise ScenarioError(f"{path}: {error}") from error


def load_scenario(path: Path, plain: Scenario | None = None) -> Scenario:
    """Scenario from a TOML file; a profile that it names is looked for beside it.

    A profile stands for a plain unit on that table, and so does the name of a ready-made one. Of `plain`, a unit
    without any of it, axes and specification count where the file does not say; None: an IMU400CD.
    Raises ScenarioError if it can't be read, or something in it does not fit.
    """
    usual = Scenario() if plain is None else plain
    named = None if path.exists() else reference_file.find(str(path))
    if named is not None:
        return replace(usual, profile=named.profile)
    if not path.suffix and not path.exists():
        raise ScenarioError(f"{path} is no file, nor a ready-made profile: {reference_file.listed()}.")
    document = _parsed(path)
    try:
        if "segment" in document or "samples" in document:
            return replace(usual, profile=_profile(document, path.parent))
        return declared.make(document, _Scenario, partial(_scenario, usual, path.parent))
    except ScenarioError:
        raise
    except InputError as error:
        raise ScenarioError(f"{path}: {error}") from error


def _parsed(path: Path) -> dict[str, Any]:
    try:
        return toml_text.parse(outside_file.read(path, toml_text.LIMIT))
    except InputError as error:
        raise ScenarioError(f"{path} is not valid TOML: {error}") from error
    except OSError as error:
        raise ScenarioError(f"{path} can't be read: {error.strerror}. Check the path.") from error


# ------------------------------------------------------------------------------------------------------------ profiles


class _Sampled(reference_file.Joint):
    samples: Required[str]


def _profile(document: Mapping[str, Any], folder: Path, where: str = "") -> Profile:
    """Return the profile of a table; a CSV that it names is looked for in a folder."""
    if "samples" not in document:
        return reference_file.from_document(document, where)

    def joined(samples: str, **joint: Any) -> Profile:
        return replace(_csv_profile(folder / samples), **joint)

    return declared.make(document, _Sampled, joined, where)


def _csv_profile(path: Path) -> Profile:
    try:
        content = outside_file.read(path, outside_file.TEXT_LIMIT)
    except OSError as error:
        raise ScenarioError(f"{path} can't be read: {error.strerror}. Check the path.") from error
    except InputError as error:
        raise ScenarioError(f"{path}: {error}") from error
    try:
        return reference_file.parse_angles(reference_file.text_of(content, str(path)), str(path))
    except InputError as error:
        raise ScenarioError(str(error)) from error


# ----------------------------------------------------------------------------------------------------------- scenarios


def _simulated(version: str) -> str:
    if _SIMULATED not in version:
        raise InputError(f"`version` is {version!r}: without {_SIMULATED} in it, its readings pass for measured ones")
    return version


def _temperature(points: tuple[tuple[float, float], ...] | None = None, constant: float | None = None) -> Temperature:
    if (constant is None) == (not points):
        raise InputError("it has either `constant_degc = 25.0` or `history = [[0.0, 20.0], [600.0, 35.0]]` (s, degC)")
    try:
        return Temperature(points or ((0.0, float(constant or 0.0)),))
    except InputError as error:
        raise InputError(f"`history` is {points}: times do not increase") from error


def _site(gravity: float | None = None, **place: float) -> Site:
    if not place:
        return PAPER_SITE if gravity is None else replace(PAPER_SITE, gravity=gravity)
    for key in ("latitude_deg", "longitude_deg", "height_m"):
        if key not in place:
            raise InputError(f"`{key}` is missing: a site has latitude, longitude and height")
    return Site.at(place["latitude_deg"], place["longitude_deg"], place["height_m"], gravity)


def _effect(table: dict[str, Any]) -> Effect:
    stated: Any = declared.read({key: table[key] for key in ("name", "channel") if key in table}, _Effect)
    channel = stated.get("channel", [])
    parameters = {key: value for key, value in table.items() if key not in stated}
    return Effect(stated["name"], (channel,) if isinstance(channel, str) else tuple(channel), parameters)


def _fault(at_s: float, kind: str, **more: Any) -> Fault:
    refuse_unknown(more, ("at_s", "kind", FAULT_KINDS[kind]), kind)
    return Fault(at_s, kind, **more)


def _table_fault(at_s: float, kind: str, **more: Any) -> TableFault:
    named = {"delay_s" if name == "delay" else name: name for name in TABLE_FAULT_KINDS[kind]}
    refuse_unknown(more, ("at_s", "kind", *named), kind)
    return TableFault(at_s, kind, **{named[key]: value for key, value in more.items()})


def _table(stops: tuple[float | None, float | None] = (None, None), **fields: Any) -> TableModel:
    return TableModel(low=stops[0], high=stops[1], **fields)


def _scaled(factor: float) -> Meta:
    return Meta(make=lambda value: value * factor)


def _into(make: Any, to: str = "") -> Meta:
    return Meta(to=to, make=lambda fields: make(**fields))


_Seed = Annotated[int, Meta(least=0)]
_Positive = Annotated[float, Meta(above=0.0)]
_NotNegative = Annotated[float, Meta(least=0.0)]
_Mg = Annotated[float, _scaled(_MG)]
_Radians = Annotated[float, Meta(make=radians)]
_Triple = Meta(words="three numbers: [x, y, z]")
_Accel = Annotated[tuple[_Mg, _Mg, _Mg], _Triple, Meta(to="accel_bias")]
_Gyro = Annotated[tuple[_Radians, _Radians, _Radians], _Triple, Meta(to="gyro_bias")]
_Size = Annotated[float, Meta(least=0.0, make=radians)]
_ArcMinutes = Annotated[float, Meta(least=0.0, make=lambda minutes: radians(minutes / 60.0))]


class _Biases(TypedDict, total=False):
    accel_mg: _Accel
    gyro_dps: _Gyro
    accel_run_mg: Annotated[_NotNegative, _scaled(_MG), Meta(to="accel_bias_run_sd")]
    gyro_run_dps: Annotated[_Size, Meta(to="gyro_bias_run_sd")]


class _Noise(TypedDict, total=False):
    gyro_arw_deg_sqrt_h: Annotated[_NotNegative, Meta(to="gyro_arw", make=lambda arw: radians(arw) / _SQRT_HOUR)]
    accel_vrw_mps_sqrt_h: Annotated[_NotNegative, Meta(to="accel_vrw", make=lambda vrw: vrw / _SQRT_HOUR)]
    gyro_bandwidth_hz: Annotated[_NotNegative, Meta(to="gyro_bandwidth")]
    accel_bandwidth_hz: Annotated[_NotNegative, Meta(to="accel_bandwidth")]


class _TemperatureTable(TypedDict, total=False):
    constant_degc: Annotated[float, Meta(to="constant")]
    history: Annotated[
        list[Annotated[tuple[float, float], Meta(words="a pair [s, degC]")]], Meta(to="points", make=tuple)
    ]


_Temperature = Annotated[
    _TemperatureTable,
    _into(_temperature),
    Meta(words="a table with `constant_degc` or with `history`"),
]


class _SiteTable(TypedDict, total=False):
    latitude_deg: Annotated[float, Meta(least=-90.0, most=90.0)]
    longitude_deg: float
    height_m: float
    gravity_mps2: Annotated[float, Meta(to="gravity")]


class _Instrument(TypedDict, total=False):
    accel_sign: Annotated[Literal[-1, 1], Meta(make=int)]
    mount: Annotated[str, Meta(make=parse_mount, words='a text such as "x,-y,-z"')]


class _Effect(TypedDict, total=False):
    name: Required[str]
    channel: Annotated[str | list[str], Meta(words='one such as "gx", or a list of them')]


class _PowerOn(TypedDict, total=False):
    seed: _Seed
    accel_mg: _Accel
    gyro_dps: _Gyro
    temperature: _Temperature


class _Fault(TypedDict, total=False):
    at_s: Required[_NotNegative]
    kind: Required[Annotated[str, Meta(allowed=tuple(FAULT_KINDS))]]
    count: Annotated[int, Meta(least=1)]
    seconds: _Positive


class _Unit(TypedDict, total=False):
    version: Annotated[str, Meta(make=_simulated)]
    version_plain_text: bool
    ping: Literal["keeps", "stops", "resets"]
    clock_skew_ppm: float


class _Table(TypedDict, total=False):
    axes: Annotated[list[str], Meta(make=tuple, words='a list of names such as ["middle", "inner"]')]
    seed: _Seed
    stops_deg: Annotated[tuple[_Radians, _Radians], Meta(to="stops", words="two angles, such as [-110.0, 110.0]")]
    rate_dps: Annotated[_Size, Meta(to="rate")]
    accel_dps2: Annotated[_Size, Meta(to="accel")]
    jerk_dps3: Annotated[_Size, Meta(to="jerk")]
    lag_s: Annotated[_NotNegative, Meta(to="lag")]
    encoder_noise_deg: Annotated[_Size, Meta(to="encoder_noise")]
    rate_noise_dps: Annotated[_Size, Meta(to="rate_noise")]
    encoder_offset_sd_deg: Annotated[_Size, Meta(to="encoder_offset_sd")]
    orthogonality_sd_arcmin: Annotated[_ArcMinutes, Meta(to="orthogonality_sd")]
    wobble_sd_arcmin: Annotated[_ArcMinutes, Meta(to="wobble_sd")]


class _TableFault(TypedDict, total=False):
    at_s: Required[_NotNegative]
    kind: Required[Annotated[str, Meta(allowed=tuple(TABLE_FAULT_KINDS))]]
    axis: str
    seconds: _NotNegative
    delay_s: _NotNegative
    count: Annotated[int, Meta(least=1)]


class _Scenario(TypedDict, total=False):
    seed: _Seed
    profile: Annotated[str | dict[str, Any], Meta(words="the name of a file, or [[profile.segment]] tables")]
    power_ons: Annotated[int, Meta(least=1, most=1000)]
    biases: _Biases
    noise: _Noise
    temperature: _Temperature
    site: Annotated[_SiteTable, _into(_site)]
    instrument: _Instrument
    effect: Annotated[list[Annotated[dict[str, Any], Meta(make=_effect)]], Meta(to="effects", make=tuple)]
    power_on: list[Annotated[_PowerOn, _into(PowerOn)]]
    fault: Annotated[list[Annotated[_Fault, _into(_fault)]], Meta(to="faults", make=tuple)]
    unit: _Unit
    table: Annotated[_Table, _into(_table)]
    table_fault: Annotated[list[Annotated[_TableFault, _into(_table_fault)]], Meta(to="table_faults", make=tuple)]


def _scenario(
    usual: Scenario,
    folder: Path,
    *,
    profile: str | dict[str, Any] | None = None,
    power_ons: int | None = None,
    power_on: list[PowerOn] | None = None,
    biases: dict[str, Any] | None = None,
    noise: dict[str, Any] | None = None,
    instrument: dict[str, Any] | None = None,
    unit: dict[str, Any] | None = None,
    **fields: Any,
) -> Scenario:
    """Return a scenario of the values in its file; what they leave open is as usual."""
    given = tuple(power_on or ())
    count = max(len(given), 1) if power_ons is None else power_ons
    if count < len(given):
        raise InputError(f"`power_ons` is {count}, but there are {len(given)} [[power_on]] tables")
    axes = usual.axes
    if instrument:
        axes = AxisMap(instrument.get("mount", parse_mount("x,y,z")), instrument.get("accel_sign", axes.accel_sign))
    return Scenario(
        spec=replace(usual.spec, **(noise or {})),
        axes=axes,
        profile=_profile_named(profile, folder)
        if isinstance(profile, str)
        else None
        if profile is None
        else _profile(profile, folder, "profile"),
        power_ons=given + (PowerOn(),) * (count - len(given)),
        personality=Personality(**(unit or {})),
        **(biases or {}),
        **fields,
    )


def _profile_named(name: str, folder: Path) -> Profile:
    """Return the profile of a file in a folder, or of a ready-made one's name."""
    file, named = folder / name, reference_file.find(name)
    if named is not None and not file.exists():
        return named.profile
    if not file.exists() and file.suffix.lower() not in (".toml", ".csv"):
        raise InputError(f'`profile` is "{name}": no such file, nor a ready-made profile: {reference_file.listed()}')
    return load_profile(file)

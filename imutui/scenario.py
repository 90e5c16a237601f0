"""Files that say what a table does and what is simulated: profiles (TOML or CSV) and scenarios (TOML).

The format of a profile is in `imutui.logbook.reference_file`, effects and their parameters in `filters.simulation`. A
scenario::

    seed = 7
    profile = "tumble.toml"            # beside this file, or a ready-made one's name; or [[profile.segment]]
    power_ons = 3                      # how often the unit is switched on, default 1

    [biases]                           # instrument axes and sign; what is absent is drawn from the seed
    accel_mg = [5.0, -3.0, 8.0]
    gyro_dps = [0.5, -0.2, 0.1]
    accel_run_mg = 0.5                 # standard deviations of what comes to them at each power-on, default 0
    gyro_run_dps = 0.02

    [noise]                            # default: the paper's Table 1
    gyro_arw_deg_sqrt_h = 4.5
    accel_vrw_mps_sqrt_h = 1.0
    gyro_bandwidth_hz = 25.0           # 0: no band limit
    accel_bandwidth_hz = 75.0

    [temperature]                      # default: 24 degC, warming up by 6 K in ten minutes
    history = [[0.0, 20.0], [600.0, 35.0]]   # s, degC, straight lines between; or: constant_degc = 25.0

    [site]                             # default: the paper's
    latitude_deg = -23.2
    longitude_deg = -45.9
    height_m = 641.0
    gravity_mps2 = 9.78637             # default: WGS-84 normal gravity there

    [instrument]                       # how it reads and sits
    accel_sign = -1
    mount = "x,y,z"

    [[effect]]
    name = "thermal_lin"
    channel = "gy"                     # or several: ["gx", "gy"]
    dps_per_k = 0.02

    [[power_on]]                       # of the first, second … what differs; all optional
    seed = 11
    accel_mg = [5.2, -3.0, 8.1]
    gyro_dps = [0.5, -0.2, 0.1]
    temperature = { constant_degc = 40.0 }

    [[fault]]                          # on the wire, seconds after the first request for data
    at_s = 5.0
    kind = "drop_bytes"                # or another of FAULT_KINDS, with `count` or `seconds` as they are measured
    count = 7

    [[fault]]
    at_s = 8.0
    kind = "hang_up"
    seconds = 2.0
    power = true                       # the unit comes back as after power-up; default: it runs on
    serial_number = 7                  # another unit comes back

    [unit]                             # what the unit is like all the time
    version = "VIRTUAL SIM SLOW"         # with VIRTUAL SIM in it: its readings are not measured
    version_plain_text = true          # without header and checksum
    ping = "resets"                    # "keeps", "stops" (the default) a stream, or "resets" the unit
    power_up_mode = "scaled"           # default "voltage"
    auto_baud = false                  # silent on a change of speed
    reply_delay_s = 0.7
    clock_skew_ppm = 200.0             # its clock runs fast against the host's

    [line]
    usb_bursts_s = 0.016               # an adapter that hands on what has come by a timer
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY, AxisMap, ImuSpec, parse_mount
from filters.motion.profile import Profile
from filters.simulation import Effect, PowerOn, Scenario, Temperature
from filters.state import PAPER_SITE, Site
from imutui import outside_file, toml_text
from imutui.logbook import named_profiles, reference_file
from imutui.scenario_wire import fault_of, personality_of
from imutui.toml_text import is_number
from imutui.toml_values import known, number, table_of, tables_of, triple, whole

_DPS = math.pi / 180.0
_MG = 1e-3 * STANDARD_GRAVITY
_SQRT_HOUR = 60.0
_MOST_POWER_ONS = 1000

# a number in the file and what it is multiplied with, by the field of ImuSpec
_NOISE = {
    "gyro_arw_deg_sqrt_h": ("gyro_arw", _DPS / _SQRT_HOUR),
    "accel_vrw_mps_sqrt_h": ("accel_vrw", 1.0 / _SQRT_HOUR),
    "gyro_bandwidth_hz": ("gyro_bandwidth", 1.0),
    "accel_bandwidth_hz": ("accel_bandwidth", 1.0),
}


class ScenarioError(InputError):
    """A profile or scenario is not what it should be; the message says which file, which key, and what it may be."""


def load_profile(path: Path) -> Profile:
    """Motion of a table from a file.

    `path`: TOML, or CSV with a heading `t, outer, middle, inner` (s, deg) by its suffix. A TOML file may name a CSV, as
      `samples = "angles.csv"` relative to it, in place of segments, and so give it `sign`, `align`, `offset_sd_s`.
    Raises ScenarioError if it can't be read, or something in it does not fit.
    """
    if path.suffix.lower() == ".csv":
        return _csv_profile(path)
    return _profile(_parsed(path), path)


def load_scenario(path: Path, plain: Scenario | None = None) -> Scenario:
    """Scenario from a TOML file.

    `path`: the file; a profile it names is looked for beside it. A profile stands for a plain unit on that table, and
      so does the name of a ready-made one.
    `plain`: a unit without any of it: its axes and specification count where the file does not say; None: an IMU400CD.
    Raises ScenarioError if it can't be read, or something in it does not fit.
    """
    usual = Scenario() if plain is None else plain
    named = None if path.exists() else named_profiles.find(str(path))
    if named is not None:
        return replace(usual, profile=named.profile)
    if not path.suffix and not path.exists():
        raise ScenarioError(f"{path} is no file, nor a ready-made profile: {named_profiles.listed()}.")
    document = _parsed(path)
    try:
        if "segment" in document or "samples" in document:
            return replace(usual, profile=_profile(document, path))
        return _scenario(document, path, usual)
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


def _profile(document: Mapping[str, Any], path: Path) -> Profile:
    try:
        if "samples" not in document:
            return reference_file.from_document(cast("reference_file.ProfileDocument", document))
        known(document, ("samples", "sign", "align", "offset_sd_s"), "with `samples`")
        if not isinstance(document["samples"], str):
            raise InputError(f"`samples` is {document['samples']!r}, not the name of a CSV file")
        # what comes beside the samples is what comes beside segments: checked by the one who knows
        beside = dict(document) | {"segment": [{"kind": "dwell", "angles_deg": [0.0, 0.0, 0.0], "seconds": 1.0}]}
        del beside["samples"]
        model = reference_file.from_document(cast("reference_file.ProfileDocument", beside))
        sampled = _csv_profile(path.parent / document["samples"])
    except ScenarioError:
        raise
    except InputError as error:
        raise ScenarioError(f"{path}: {error}") from error
    return replace(sampled, sign=model.sign, align=model.align, offset_sd=model.offset_sd)


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

_TOP = (
    "seed",
    "profile",
    "power_ons",
    "biases",
    "noise",
    "temperature",
    "site",
    "instrument",
    "effect",
    "power_on",
    "fault",
    "unit",
    "line",
)


def _scenario(document: Mapping[str, Any], path: Path, usual: Scenario) -> Scenario:
    known(document, _TOP, "in a scenario")
    biases = table_of(document, "biases")
    known(biases, ("accel_mg", "gyro_dps", "accel_run_mg", "gyro_run_dps"), "in [biases]")
    return Scenario(
        seed=whole(document, "seed", 0, "") if "seed" in document else 0,
        spec=_spec(table_of(document, "noise"), usual.spec),
        accel_bias=triple(biases, "accel_mg", _MG, "[biases]: "),
        gyro_bias=triple(biases, "gyro_dps", _DPS, "[biases]: "),
        accel_bias_run_sd=number(biases, "accel_run_mg", "[biases]: ", 0.0, least=0.0) * _MG,
        gyro_bias_run_sd=number(biases, "gyro_run_dps", "[biases]: ", 0.0, least=0.0) * _DPS,
        temperature=_temperature(document["temperature"], "") if "temperature" in document else Temperature(),
        profile=_profile_of(document, path),
        effects=tuple(_effect(table, f"effect {n}: ") for n, table in enumerate(tables_of(document, "effect"), 1)),
        power_ons=_power_ons(document),
        faults=tuple(fault_of(table, f"fault {n}: ") for n, table in enumerate(tables_of(document, "fault"), 1)),
        personality=personality_of(table_of(document, "unit"), table_of(document, "line")),
        site=_site(table_of(document, "site")),
        axes=_axes(table_of(document, "instrument"), usual.axes),
    )


def _profile_of(document: Mapping[str, Any], path: Path) -> Profile | None:
    profile = document.get("profile")
    if profile is None:
        return None
    if isinstance(profile, str):
        return _profile_named(profile, path.parent)
    if isinstance(profile, dict):
        try:
            return _profile(profile, path)
        except ScenarioError as error:
            if str(error).startswith(f"{path}: "):
                raise ScenarioError(f"{path}: profile, {str(error).removeprefix(f'{path}: ')}") from error
            raise
    raise InputError(f"`profile` is {profile!r}; it is the name of a file, or [[profile.segment]] tables")


def _profile_named(name: str, folder: Path) -> Profile:
    """Profile of a file in a folder, or of a name."""
    file, named = folder / name, named_profiles.find(name)
    if named is not None and not file.exists():
        return named.profile
    if not file.exists() and file.suffix.lower() not in (".toml", ".csv"):
        raise InputError(f'`profile` is "{name}": no such file, nor a ready-made profile: {named_profiles.listed()}')
    return load_profile(file)


def _spec(table: Mapping[str, Any], usual: ImuSpec) -> ImuSpec:
    known(table, tuple(_NOISE), "in [noise]")
    fields = {
        field: number(table, key, "[noise]: ", least=0.0) * unit
        for key, (field, unit) in _NOISE.items()
        if key in table
    }
    return replace(usual, **fields)  # type: ignore[arg-type] # all of these are numbers


def _temperature(value: Any, where: str) -> Temperature:
    if not isinstance(value, dict) or set(value) not in ({"constant_degc"}, {"history"}):
        raise InputError(
            f"{where}`temperature` is {value!r}; it has either `constant_degc = 25.0`"
            " or `history = [[0.0, 20.0], [600.0, 35.0]]` (s, degC)"
        )
    if "constant_degc" in value:
        return Temperature(((0.0, number(value, "constant_degc", f"{where}[temperature]: ")),))
    history = value["history"]
    pairs = (
        isinstance(history, list)
        and history
        and all(isinstance(pair, list) and len(pair) == 2 and all(is_number(v) for v in pair) for pair in history)
    )
    if not pairs:
        raise InputError(f"{where}`temperature.history` is {history!r}, not pairs [s, degC]")
    try:
        return Temperature(tuple((float(t), float(degc)) for t, degc in history))
    except InputError as error:
        raise InputError(f"{where}`temperature.history` is {history}: times do not increase") from error


def _effect(table: Mapping[str, Any], where: str) -> Effect:
    name = table.get("name")
    if not isinstance(name, str):
        raise InputError(f"{where}`name` is {name!r}, not the name of an effect")
    channel = table.get("channel", [])
    channels = [channel] if isinstance(channel, str) else channel
    if not isinstance(channels, list) or not all(isinstance(c, str) for c in channels):
        raise InputError(f'{where}`channel` is {channel!r}; it is one such as "gx", or a list of them')
    parameters = {key: value for key, value in table.items() if key not in ("name", "channel")}
    try:
        return Effect(name, tuple(channels), parameters)
    except InputError as error:
        raise InputError(f"{where}{error}") from error


def _power_ons(document: Mapping[str, Any]) -> tuple[PowerOn, ...]:
    given = tuple(_power_on(table, f"power_on {n}: ") for n, table in enumerate(tables_of(document, "power_on"), 1))
    count = whole(document, "power_ons", 1, "") if "power_ons" in document else max(len(given), 1)
    if count > _MOST_POWER_ONS:
        raise InputError(f"`power_ons` is {count}; the most is {_MOST_POWER_ONS}")
    if count < len(given):
        raise InputError(f"`power_ons` is {count}, but there are {len(given)} [[power_on]] tables")
    return given + (PowerOn(),) * (count - len(given))


def _power_on(table: Mapping[str, Any], where: str) -> PowerOn:
    known(table, ("seed", "accel_mg", "gyro_dps", "temperature"), f"in {where.removesuffix(': ')}")
    return PowerOn(
        seed=whole(table, "seed", 0, where) if "seed" in table else None,
        temperature=_temperature(table["temperature"], where) if "temperature" in table else None,
        accel_bias=triple(table, "accel_mg", _MG, where),
        gyro_bias=triple(table, "gyro_dps", _DPS, where),
    )


def _site(table: Mapping[str, Any]) -> Site:
    known(table, ("latitude_deg", "longitude_deg", "height_m", "gravity_mps2"), "in [site]")
    if not table:
        return PAPER_SITE
    where = "[site]: "
    gravity = number(table, "gravity_mps2", where) if "gravity_mps2" in table else None
    if set(table) == {"gravity_mps2"}:
        assert gravity is not None
        return replace(PAPER_SITE, gravity=gravity)
    latitude, longitude, height = (number(table, key, where) for key in ("latitude_deg", "longitude_deg", "height_m"))
    if not -90.0 <= latitude <= 90.0:
        raise InputError(f"{where}`latitude_deg` is {latitude:g}, not within ±90")
    return Site.at(latitude, longitude, height, gravity)


def _axes(table: Mapping[str, Any], usual: AxisMap) -> AxisMap:
    known(table, ("accel_sign", "mount"), "in [instrument]")
    sign, mount = table.get("accel_sign", usual.accel_sign), table.get("mount", "x,y,z")
    if sign not in (-1, 1):
        raise InputError(f"[instrument]: `accel_sign` is {sign!r}, not -1 or 1")
    if not isinstance(mount, str):
        raise InputError(f'[instrument]: `mount` is {mount!r}, not a text such as "x,-y,-z"')
    return AxisMap(parse_mount(mount), int(sign))

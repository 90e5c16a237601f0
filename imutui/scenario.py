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

    [table]                            # the one under command, with `imutui virtual --controller`
    axes = ["outer", "middle", "inner"]   # in the order of the controller's numbers
    seed = 3                           # default: the scenario's
    rate_dps = 400.0                   # the most, of each axis
    stops_deg = [-110.0, 110.0]        # of outer and middle axis; default: they turn without end
    orthogonality_sd_arcmin = 1.0      # drawn from the seed; docs/formats.md has the other keys

    [[table_fault]]                    # seconds after the table is there
    at_s = 20.0
    kind = "stuck"                     # or another of TABLE_FAULT_KINDS
    axis = "inner"
    seconds = 5.0                      # default: for ever
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY, AxisMap, ImuSpec, parse_mount
from filters.motion.profile import Profile
from filters.simulation import (
    FAULT_KINDS,
    Effect,
    Fault,
    Personality,
    PowerOn,
    Scenario,
    Temperature,
)
from filters.state import PAPER_SITE, Site
from imutui import outside_file, scenario_table, toml_text
from imutui.logbook import reference_file
from imutui.toml_text import Table, is_number, tables_of

_DPS = math.pi / 180.0
_MG = 1e-3 * STANDARD_GRAVITY
_SQRT_HOUR = 60.0
_MOST_POWER_ONS = 1000
_SIMULATED = "VIRTUAL SIM"

# a number in the file and what it is multiplied with, by the field of ImuSpec
_NOISE = {
    "gyro_arw_deg_sqrt_h": ("gyro_arw", _DPS / _SQRT_HOUR),
    "accel_vrw_mps_sqrt_h": ("accel_vrw", 1.0 / _SQRT_HOUR),
    "gyro_bandwidth_hz": ("gyro_bandwidth", 1.0),
    "accel_bandwidth_hz": ("accel_bandwidth", 1.0),
}
_TOP = (
    *("seed", "profile", "power_ons", "biases", "noise", "temperature", "site", "instrument"),
    *("effect", "power_on", "fault", "unit", "line", "table", "table_fault"),
)
_SITE = ("latitude_deg", "longitude_deg", "height_m", "gravity_mps2")
_UNIT = (
    *("version", "version_plain_text", "ping", "power_up_mode", "auto_baud"),
    *("reply_delay_s", "clock_skew_ppm"),
)
_PINGS, _MODES = ("keeps", "stops", "resets"), ("voltage", "scaled")


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
    return _profile(_parsed(path), path)


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
            return reference_file.from_document(document)
        Table(document, ("samples", "sign", "align", "offset_sd_s"), "a profile with `samples`")
        if not isinstance(document["samples"], str):
            raise InputError(f"`samples` is {document['samples']!r}, not the name of a CSV file")
        # what comes beside the samples is what comes beside segments: checked by the one who knows
        beside = dict(document) | {"segment": [{"kind": "dwell", "angles_deg": [0.0, 0.0, 0.0], "seconds": 1.0}]}
        del beside["samples"]
        model = reference_file.from_document(beside)
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


def _scenario(document: Mapping[str, Any], path: Path, usual: Scenario) -> Scenario:
    top = Table(document, _TOP, "a scenario", where="")
    biases = Table.inside(document, "biases", ("accel_mg", "gyro_dps", "accel_run_mg", "gyro_run_dps"))
    return Scenario(
        seed=top.whole("seed", 0) if "seed" in top else 0,
        spec=_spec(Table.inside(document, "noise", _NOISE), usual.spec),
        accel_bias=biases.triple("accel_mg", _MG),
        gyro_bias=biases.triple("gyro_dps", _DPS),
        accel_bias_run_sd=biases.number("accel_run_mg", 0.0, least=0.0) * _MG,
        gyro_bias_run_sd=biases.number("gyro_run_dps", 0.0, least=0.0) * _DPS,
        temperature=_temperature(document["temperature"], "") if "temperature" in top else Temperature(),
        profile=_profile_of(document, path),
        effects=tuple(_effect(table, f"effect {n}: ") for n, table in enumerate(tables_of(document, "effect"), 1)),
        power_ons=_power_ons(top, document),
        faults=tuple(_fault(table, f"fault {n}") for n, table in enumerate(tables_of(document, "fault"), 1)),
        personality=_personality(
            Table.inside(document, "unit", _UNIT), Table.inside(document, "line", ("usb_bursts_s",))
        ),
        table=scenario_table.model_of(document),
        table_faults=scenario_table.faults_of(document),
        site=_site(Table.inside(document, "site", _SITE)),
        axes=_axes(Table.inside(document, "instrument", ("accel_sign", "mount")), usual.axes),
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
    file, named = folder / name, reference_file.find(name)
    if named is not None and not file.exists():
        return named.profile
    if not file.exists() and file.suffix.lower() not in (".toml", ".csv"):
        raise InputError(f'`profile` is "{name}": no such file, nor a ready-made profile: {reference_file.listed()}')
    return load_profile(file)


def _spec(table: Table, usual: ImuSpec) -> ImuSpec:
    fields = {field: table.number(key, least=0.0) * unit for key, (field, unit) in _NOISE.items() if key in table}
    return replace(usual, **fields)  # type: ignore[arg-type] # all of these are numbers


def _temperature(value: Any, where: str) -> Temperature:
    if not isinstance(value, dict) or set(value) not in ({"constant_degc"}, {"history"}):
        raise InputError(
            f"{where}`temperature` is {value!r}; it has either `constant_degc = 25.0`"
            " or `history = [[0.0, 20.0], [600.0, 35.0]]` (s, degC)"
        )
    if "constant_degc" in value:
        constant = Table(value, value, "", where=f"{where}[temperature]: ").number("constant_degc")
        return Temperature(((0.0, constant),))
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


def _power_ons(top: Table, document: Mapping[str, Any]) -> tuple[PowerOn, ...]:
    given = tuple(_power_on(table, f"power_on {n}") for n, table in enumerate(tables_of(document, "power_on"), 1))
    count = top.whole("power_ons", 1) if "power_ons" in top else max(len(given), 1)
    if count > _MOST_POWER_ONS:
        raise InputError(f"`power_ons` is {count}; the most is {_MOST_POWER_ONS}")
    if count < len(given):
        raise InputError(f"`power_ons` is {count}, but there are {len(given)} [[power_on]] tables")
    return given + (PowerOn(),) * (count - len(given))


def _power_on(values: Mapping[str, Any], which: str) -> PowerOn:
    table = Table(values, ("seed", "accel_mg", "gyro_dps", "temperature"), which)
    return PowerOn(
        seed=table.whole("seed", 0) if "seed" in table else None,
        temperature=_temperature(values["temperature"], f"{which}: ") if "temperature" in table else None,
        accel_bias=table.triple("accel_mg", _MG),
        gyro_bias=table.triple("gyro_dps", _DPS),
    )


def _site(table: Table) -> Site:
    if not len(table):
        return PAPER_SITE
    gravity = table.number("gravity_mps2") if "gravity_mps2" in table else None
    if gravity is not None and len(table) == 1:
        return replace(PAPER_SITE, gravity=gravity)
    latitude, longitude, height = (table.number(key) for key in _SITE[:3])
    if not -90.0 <= latitude <= 90.0:
        raise table.wrong("latitude_deg", "not within ±90")
    return Site.at(latitude, longitude, height, gravity)


def _axes(table: Table, usual: AxisMap) -> AxisMap:
    sign = table.number("accel_sign", usual.accel_sign)
    if sign not in (-1, 1):
        raise table.wrong("accel_sign", "not -1 or 1")
    mount = table.text("mount", "x,y,z", 'not a text such as "x,-y,-z"')
    return AxisMap(parse_mount(str(mount)), int(sign))


# ------------------------------------------------------------------------------------------------------------ the wire


def _personality(unit: Table, line: Table) -> Personality:
    usual, version = Personality(), unit.text("version", None)
    if version is not None and _SIMULATED not in version:
        raise unit.wrong("version", f"with {_SIMULATED} in it nobody takes its readings for measured")
    fields: dict[str, Any] = {
        "version": version,
        "version_plain_text": unit.yes("version_plain_text", usual.version_plain_text),
        "ping": unit.choice("ping", _PINGS, usual.ping),
        "power_up_mode": unit.choice("power_up_mode", _MODES, usual.power_up_mode),
        "auto_baud": unit.yes("auto_baud", usual.auto_baud),
        "reply_delay": unit.number("reply_delay_s", usual.reply_delay),
        "clock_skew_ppm": unit.number("clock_skew_ppm", usual.clock_skew_ppm),
        "usb_bursts": line.number("usb_bursts_s", usual.usb_bursts),
    }
    try:
        return Personality(**fields)
    except InputError as error:
        raise InputError(f"[unit] or [line]: {error}") from error


def _fault(values: Mapping[str, Any], which: str) -> Fault:
    kind = values.get("kind")
    if not isinstance(kind, str) or kind not in FAULT_KINDS:
        raise InputError(f"{which}: `kind` is {kind!r}, not one of: {', '.join(FAULT_KINDS)}")
    measure = FAULT_KINDS[kind]
    more = ("power", "serial_number") if kind == "hang_up" else ()
    keys = [key for key in ("at_s", "kind", measure, *more) if key]
    table = Table(values, keys, f"{which}: {kind}", where=f"{which}: ")
    at = table.number("at_s", least=0.0)
    if not measure:
        return Fault(at, kind)
    if measure == "count":
        return Fault(at, kind, count=table.whole("count", 1))
    seconds = table.number("seconds", least=0.0)
    if seconds == 0.0:
        raise table.wrong("seconds", "not a positive number")
    serial_number = table.whole("serial_number", 0) if "serial_number" in table else None
    try:
        return Fault(at, kind, seconds=seconds, power=table.yes("power"), serial_number=serial_number)
    except InputError as error:
        raise InputError(f"{which}: {error}") from error

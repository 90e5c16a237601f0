"""Sets of undeclared effects (tests/undeclared/README.md): loaded, checked, and how large their errors are.

Also the conditions under which they are recorded. What it leaves out: recording and tracing (`undeclared`), judging
what is found (`undeclared_score`).
"""

import runpy
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from bench import DATA
from numpy.typing import NDArray
from tracing_wire import TUMBLE

from filters.channels import CHANNELS
from filters.imu import IMU400CD_200, LOOP_HZ, STANDARD_GRAVITY
from filters.simulation import Unit
from imutui.cli.spoil import Spoiled, load
from imutui.cli.virtual_readings import Asked, SimulatedReadings, on_the_line, scenario_of
from imutui.instrument.virtual_instrument import Reading

RECORDING = DATA / "adis16405_static_a.npz"  # `undeclared --recording` says another, as long

SCENARIO = "unit.toml"
SEED = 20
FITTED_S, HELDOUT_S = 330.0, 360.0
# parts of the measured recording begin so far apart
_PART_S = 400.0
# readings that make a sample where there is no wire
_AVERAGED = 6

# heating and cooling at different times and speeds: what follows temperature does not follow the clock
HISTORIES = (
    "[[0.0, 20.0], [120.0, 42.0], [180.0, 42.0], [260.0, 24.0], [360.0, 24.0]]",
    "[[0.0, 40.0], [60.0, 40.0], [150.0, 20.0], [300.0, 36.0], [360.0, 36.0]]",
    "[[0.0, 30.0], [40.0, 18.0], [90.0, 18.0], [190.0, 44.0], [290.0, 26.0], [360.0, 30.0]]",
    "[[0.0, 28.0], [90.0, 20.0], [130.0, 20.0], [250.0, 40.0], [360.0, 25.0]]",
)

WEAK = "too weak to see"
VISIBLE_D, FAINT_D = 15.0, 5.0
_AXES = "xyz"
DRIVERS = (
    *("time", "temperature", "temperature_rate", "temperature_history"),
    *(f"rate_{axis}" for axis in _AXES),
    *(f"force_{axis}" for axis in _AXES),
    *("rate_change", "angle_outer", "angle_middle", "angle_inner", "motion_history", "hidden"),
)
_FIELDS: dict[str, Callable[[Any], bool]] = {
    "title": lambda v: isinstance(v, str) and bool(v),
    "channels": lambda v: _words(v, CHANNELS) and bool(v),
    "driver": lambda v: _words(v, DRIVERS) and bool(v),
    "in_log": lambda v: isinstance(v, bool),
    "memory": lambda v: isinstance(v, bool),
    "noise": lambda v: v in ("measured", "simulated"),
    "d": lambda v: v == WEAK or (isinstance(v, int | float) and not isinstance(v, bool) and v > 0.0),
    "motion": lambda v: v in ("still", "table"),
}


def _words(value: object, known: tuple[str, ...]) -> bool:
    return isinstance(value, list | tuple) and all(word in known for word in value)


@dataclass(frozen=True, slots=True)
class Undeclared:
    """An effect of a set."""

    name: str  # its function
    file: Path  # of the set
    number: int  # place in the table, which decides seeds
    part: int  # place among those on measured noise, which decides the parts of the recording
    title: str
    # channels, driver, same_as: on which channels it is not zero, what drives it, what would describe it as rightly
    channels: tuple[str, ...]
    driver: tuple[str, ...]
    same_as: tuple[str, ...]
    # in_log, memory, measured, table: whether a recording holds its driver, whether it remembers, whether noise is
    # measured, whether the table moves
    in_log: bool
    memory: bool
    measured: bool
    table: bool
    wanted_d: float | None  # none: too weak to see

    @property
    def spec(self) -> str:
        """As --spoil takes it."""
        return f"{self.file}:{self.name}"

    @property
    def seed(self) -> int:
        """Of its unit."""
        return SEED + self.number

    def truth(self) -> dict[str, Any]:
        """Its entry in the table, for a result."""
        return {
            "title": self.title, "channels": list(self.channels), "driver": list(self.driver),
            "same_as": list(self.same_as), "in_log": self.in_log, "memory": self.memory,
            "noise": "measured" if self.measured else "simulated", "d_wanted": self.wanted_d or WEAK,
            "motion": "table" if self.table else "still",
        }  # fmt: skip


def load_set(path: Path) -> list[Undeclared]:
    """Effects of a set, in the order of its table; raises SystemExit with what is wrong with it."""
    content = runpy.run_path(str(path))
    table = content.get("EFFECTS")
    if not isinstance(table, dict) or not table:
        raise SystemExit(f"{path} has no dictionary EFFECTS (tests/undeclared/README.md)")
    effects: list[Undeclared] = []
    for number, (name, entry) in enumerate(table.items()):
        _check(path, name, entry, content.get(name))
        effects.append(_entry(path, number, sum(e.measured for e in effects), name, entry))
    return effects


def _check(path: Path, name: str, entry: dict[str, Any], function: object) -> None:
    """Refuse an entry that is not as the README has it."""
    if not callable(function):
        raise SystemExit(f"{path}: EFFECTS has {name}, but there is no function of this name")
    for field, fits in _FIELDS.items():
        if field not in entry or not fits(entry[field]):
            raise SystemExit(f"{path}: {name}: `{field}` is {entry.get(field)!r}; the README says what it may be")
    unknown = set(entry) - {*_FIELDS, "same_as"}
    if unknown or not _words(entry.get("same_as", []), DRIVERS):
        raise SystemExit(f"{path}: {name}: unknown fields {sorted(unknown)} or drivers in same_as")
    if entry["in_log"] == ("hidden" in entry["driver"]):
        raise SystemExit(f"{path}: {name}: `in_log` is {entry['in_log']}, the drivers are {entry['driver']}")


def _entry(path: Path, number: int, part: int, name: str, entry: dict[str, Any]) -> Undeclared:
    return Undeclared(
        name, path, number, part, entry["title"], tuple(entry["channels"]), tuple(entry["driver"]),
        tuple(entry.get("same_as", ())), entry["in_log"], entry["memory"], entry["noise"] == "measured",
        entry["motion"] == "table", None if entry["d"] == WEAK else float(entry["d"]),
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------- what is recorded


def scenario(folder: Path, effect: Undeclared) -> Path:
    """File of the unit's scenario: power-ons with temperature histories, a table's motion, small biases."""
    text = f"seed = {effect.seed}\n"
    if effect.table:
        (folder / "table.toml").write_text(TUMBLE)
        text += 'profile = "table.toml"\n'
    text += "[biases]\naccel_run_mg = 0.3\ngyro_run_dps = 0.02\n"
    text += "[instrument]\naccel_sign = 1\n" if effect.measured else ""
    text += "".join(f"[[power_on]]\ntemperature = {{ history = {history} }}\n" for history in HISTORIES)
    path = folder / SCENARIO
    path.write_text(text)
    return path


def unit_options(effect: Undeclared, folder: Path, power_on: int) -> list[str]:
    """Options of `imutui virtual` for a power-on; of the measured recording each takes a part of its own."""
    options = ["--scenario", str(folder / SCENARIO), "--power-on", str(power_on), "--spoil", effect.spec]
    if effect.measured:
        options += ["--from", str(RECORDING), "--from-start", f"{part_start(effect.part, power_on):g}"]
    return options


def record_options(folder: Path, *, measured: bool, table: bool) -> list[str]:
    """Options of `imutui record` that say how the unit sits and what is known of its motion."""
    reference = str(folder / "table.toml") if table else "gravity" if measured else "level"
    return ["--reference", reference, *(["--accel-sign", "+1"] if measured else [])]


def part_start(part: int, power_on: int) -> float:
    """Where in the measured recording a power-on begins, s; after the last part comes the first again."""
    parts = int((9999.0 - HELDOUT_S - 20.0) // _PART_S)
    return _PART_S * ((part * len(HISTORIES) + power_on) % parts)


def seconds_of(power_on: int) -> float:
    """How long a power-on is recorded; the last one is held out."""
    return FITTED_S if power_on < len(HISTORIES) - 1 else HELDOUT_S


# ------------------------------------------------------------------------------------------------- how large it is


class _Nothing:
    """Readings of zero: with an error on top, the error itself."""

    def reading(self, k: int) -> Reading:
        del k
        return Reading((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)


def errors(effect: Undeclared, folder: Path, power_on: int, seconds: float) -> NDArray[np.float64]:
    """The error of a power-on at every sample of the unit's loop, deg/s and g, shape (N, 6)."""
    alone = Spoiled(_Nothing(), unit_of(effect, folder, power_on), load(effect.spec))
    rows = [alone.reading(k) for k in range(int(seconds * LOOP_HZ))]
    return np.array([[*row.rates_dps, *row.accels_g] for row in rows if row is not None])


def unit_of(effect: Undeclared, folder: Path, power_on: int) -> Unit:
    """The unit of an effect at a power-on, without the error."""
    file = folder / SCENARIO
    if not effect.measured:
        return SimulatedReadings(scenario_of(file, None), power_on).unit
    readings = on_the_line(Asked(file, power_on, recording=RECORDING, start=part_start(effect.part, power_on))).readings
    assert isinstance(readings, SimulatedReadings)
    return readings.unit


def without(effect: Undeclared, folder: Path, power_on: int) -> dict[str, NDArray[np.float64]]:
    """The power-on without the error, means over a few readings, as the arrays of a recording to import.

    Without the unit's band limit on its motion: of an imported recording a trace does not know it, and would find it.
    """
    limited = unit_of(effect, folder, power_on)
    spec = replace(limited.scenario.spec, gyro_bandwidth=0.0, accel_bandwidth=0.0)
    unit = Unit(replace(limited.scenario, spec=spec), power_on, LOOP_HZ, limited.background)
    axes = unit.scenario.axes
    made = unit.record(int(seconds_of(power_on) * LOOP_HZ) // _AVERAGED * _AVERAGED)
    gyro = np.rad2deg(axes.gyro_to_instrument(made.samples.gyro))
    accel = axes.accel_to_instrument(made.samples.accel) / STANDARD_GRAVITY
    columns = np.column_stack([made.number / LOOP_HZ, gyro, accel, made.temperature_degc])
    means = columns.reshape(-1, _AVERAGED, 8).mean(axis=1)
    return {"t": means[:, 0], "gyro": means[:, 1:4], "accel": means[:, 4:7], "temp": means[:, 7]}


def with_error(effect: Undeclared, folder: Path, power_on: int) -> dict[str, NDArray[np.float64]]:
    """The power-on with its error, likewise: what a log over the wire has, but for its packets and counts."""
    arrays = without(effect, folder, power_on)
    error = errors(effect, folder, power_on, seconds_of(power_on) + 1.0)[: arrays["t"].size * _AVERAGED]
    means = error.reshape(-1, _AVERAGED, 6).mean(axis=1)
    return arrays | {"gyro": arrays["gyro"] + means[:, :3], "accel": arrays["accel"] + means[:, 3:]}


def noise_density(*, measured: bool) -> NDArray[np.float64]:
    """White noise of the six channels, deg/s/√Hz and g/√Hz, of which a drift makes no part."""
    if not measured:
        gyro, accel = np.rad2deg(IMU400CD_200.gyro_arw), IMU400CD_200.accel_vrw / STANDARD_GRAVITY
        return np.repeat([gyro, accel], 3)
    with np.load(RECORDING) as recording:
        values = np.hstack([recording["gyro"], recording["accel"]])
        period = float(np.mean(np.diff(recording["t"])))
    block = round(0.25 / period)
    means = values[: len(values) // block * block].reshape(-1, block, 6).mean(axis=1)
    return np.asarray(1.4826 * np.median(np.abs(np.diff(means, axis=0)), axis=0) / np.sqrt(2.0) * np.sqrt(0.25))


def detectability(runs: list[NDArray[np.float64]], density: NDArray[np.float64]) -> NDArray[np.float64]:
    """d of the six channels over runs of errors, shape (N, 6) each."""
    squares = sum(((run - run.mean(axis=0)) ** 2).sum(axis=0) / LOOP_HZ for run in runs)
    return np.asarray(np.sqrt(squares) / density)


def achieved(effect: Undeclared, folder: Path) -> dict[str, float]:
    """d of each channel over the power-ons that are fitted; writes its scenario into the folder."""
    scenario(folder, effect)
    runs = [errors(effect, folder, power_on, FITTED_S) for power_on in range(len(HISTORIES) - 1)]
    d = detectability(runs, noise_density(measured=effect.measured))
    return dict(zip(CHANNELS, np.round(d, 2).tolist(), strict=True))


def check(path: Path, folder: Path) -> Iterator[str]:
    """Lines about a set: d of every channel beside what the table says, and what does not fit."""
    effects = load_set(path)
    hidden = sum(not e.in_log for e in effects)
    yield (
        f"{len(effects)} effects: {hidden} with a hidden driver, {sum(e.memory for e in effects)} with memory,"
        f" {sum(len(e.channels) > 1 for e in effects)} on several channels,"
        f" {sum(e.wanted_d is None for e in effects)} too weak, {sum(e.measured for e in effects)} on measured noise"
    )
    for effect in effects:
        if effect.measured and not RECORDING.exists():
            yield f"{effect.name}: not checked, {RECORDING} is not here"
            continue
        d = achieved(effect, folder)
        # longer than any power-on is
        errors(effect, folder, 0, 400.0)
        again = achieved(effect, folder) == d
        told = " ".join(f"{channel} {value:.1f}" for channel, value in d.items() if value > 0.0)
        wanted = WEAK if effect.wanted_d is None else f"{effect.wanted_d:g}"
        yield f"{effect.name}: d {told or 'nothing'}; wanted {wanted}"
        if not again:
            yield "    not the same twice with one seed"
        if {channel for channel, value in d.items() if value > 0.0} != set(effect.channels):
            yield f"    the table says {' '.join(effect.channels)}"
        strongest = max(d.values())
        if effect.wanted_d is None and strongest >= FAINT_D:
            yield f"    too strong for what cannot be seen: d below {FAINT_D:g} is"
        if effect.wanted_d is not None and not 0.7 <= strongest / effect.wanted_d <= 1.4:
            yield "    d is another than wanted"


def power_ons() -> int:
    """How many power-ons an effect has, the last of them held out."""
    return len(HISTORIES)

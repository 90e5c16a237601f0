"""Tracing over the wire: scenarios on the virtual unit, acquired over pseudo terminals, logged, traced from the logs.

    python benchmarks/tracing_wire.py [--case NAME ...] [--real-time] [--keep DIR]

One case for each family of the catalogue, one with several effects at once, and one whose effect is too weak for its
logs. Each power-on is a unit, an acquisition process and a log of its own; two at once. All simulated. By default the
processes run on the unit's time (`tests/support/unit_time`); with --real-time on the wall's, all power-ons of a case at
once.
"""

import json
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bench
from unit_time import acquire, acquire_in_real_time

FITTED_S, HELDOUT_S = 300.0, 360.0

# heating and cooling at different times and speeds: what follows temperature does not follow the clock
HISTORIES = (
    "[[0.0, 20.0], [120.0, 42.0], [240.0, 24.0], [360.0, 24.0]]",
    "[[0.0, 40.0], [60.0, 40.0], [150.0, 20.0], [300.0, 36.0]]",
    "[[0.0, 28.0], [90.0, 22.0], [250.0, 40.0], [360.0, 25.0]]",
)

TUMBLE = """align = "gyro"
offset_sd_s = 0.001
slew_dps = 60.0
"""
for outer, middle, inner in (
    (0, 0, 0), (0, 90, 0), (0, 180, 0), (0, -90, 0), (90, 0, 0), (-90, 0, 0), (45, 30, 0), (-30, 45, 90),
):  # fmt: skip
    TUMBLE += f'[[segment]]\nkind = "dwell"\nangles_deg = [{outer}.0, {middle}.0, {inner}.0]\nseconds = 12.0\n'
for axis in ("inner", "middle", "outer"):
    TUMBLE += '[[segment]]\nkind = "dwell"\nangles_deg = [0.0, 0.0, 0.0]\nseconds = 6.0\n'
    for n, rate in enumerate((100, -100, 40, -40)):
        if n == 2:  # at another attitude, or a rate is a product of rate and force
            TUMBLE += '[[segment]]\nkind = "dwell"\nangles_deg = [30.0, 50.0, 0.0]\nseconds = 6.0\n'
        TUMBLE += f'[[segment]]\nkind = "rate"\naxis = "{axis}"\nrate_dps = {rate}.0\nseconds = 7.2\n'
    TUMBLE += f'[[segment]]\nkind = "sine"\naxis = "{axis}"\namplitude_deg = 12.0\nhz = 0.5\nseconds = 10.0\n'


@dataclass(frozen=True)
class Case:
    family: str
    truth: tuple[tuple[str, str], ...]
    effects: str
    moving: bool = False


THERMAL = '[[effect]]\nname = "thermal_lin"\nchannel = "gy"\ndps_per_k = 0.04\n'
SCALE = '[[effect]]\nname = "scale"\nchannel = "gz"\nrelative = 0.02\n'
LEVER = '[[effect]]\nname = "lever_arm"\nx_m = 0.1\ny_m = -0.05\n'
STEP = '[[effect]]\nname = "step"\nchannel = "ax"\nmg = 15.0\nat_s = 140.0\n'
DRIFT = '[[effect]]\nname = "gauss_markov"\nchannel = "gx"\ndps = 0.15\ntau_s = 20.0\n'
NOISE = '[[effect]]\nname = "noise_level"\nchannel = "gz"\nlog_variance_per_unit = 0.15\ndriver = "temperature"\n'
SPIKES = '[[effect]]\nname = "spikes"\nchannel = "ay"\nmg = 2000.0\nper_hour = 300.0\n'
WARMUP = '[[effect]]\nname = "warmup"\nchannel = "ax"\nmg = 25.0\ntau_s = 60.0\n'
WEAK = '[[effect]]\nname = "thermal_lin"\nchannel = "gy"\ndps_per_k = 0.0002\n'

CASES = {
    "thermal": Case("additive, thermal", (("thermal_lin", "gy"),), THERMAL),
    "scale": Case("additive, input", (("scale", "gz"),), SCALE, True),
    "lever_arm": Case("motion", (("lever_arm", "ax"),), LEVER, True),
    "step": Case("event", (("step", "ax"),), STEP),
    "drift": Case("drift", (("gauss_markov", "gx"),), DRIFT),
    "noise": Case("noise", (("noise_level", "gz"),), NOISE),
    "fault": Case("fault", (("spikes", "ay"),), SPIKES),
    "several": Case(
        "several at once",
        (("thermal_lin", "gy"), ("scale", "gz"), ("warmup", "ax"), ("spikes", "ay"), ("gauss_markov", "gx")),
        THERMAL + SCALE + WARMUP + SPIKES + DRIFT,
        True,
    ),
    "still": Case(
        "event, drift, noise",
        (("step", "ax"), ("gauss_markov", "gx"), ("noise_level", "gz")),
        STEP + DRIFT + NOISE,
    ),
    "weak": Case("too weak", (("thermal_lin", "gy"),), WEAK),
}


def scenario(folder: Path, case: Case, histories: tuple[str, ...] = HISTORIES, seed: int = 41) -> Path:
    """Scenario of a case as a file."""
    text = f"seed = {seed}\n"
    if case.moving:
        (folder / "table.toml").write_text(TUMBLE)
        text += 'profile = "table.toml"\n'
    text += "[biases]\naccel_run_mg = 0.3\ngyro_run_dps = 0.02\n" + case.effects + "\n"
    for number, history in enumerate(histories):
        text += f"[[power_on]]\nseed = {seed + number}\ntemperature = {{ history = {history} }}\n"
    path = folder / "unit.toml"
    path.write_text(text)
    return path


def acquired(folder: Path, case: Case, real_time: bool) -> list[Path]:
    file = scenario(folder, case)
    options = ("--reference", str(folder / "table.toml")) if case.moving else ()
    take = acquire_in_real_time if real_time else acquire

    def one(number: int) -> Path:
        log = folder / f"{folder.name}-{number}.mcap"
        take(file, number, log, FITTED_S if number < len(HISTORIES) - 1 else HELDOUT_S, *options)
        return log

    with ThreadPoolExecutor(len(HISTORIES) if real_time else 2) as pool:
        return list(pool.map(one, range(len(HISTORIES))))


def traced(logs: list[Path], *options: str) -> dict[str, Any]:
    """What `imutui trace` finds in the logs, to which nothing else is told."""
    command = [*bench.IMUTUI, "trace", *map(str, logs), "--json", *options]
    return dict(json.loads(bench.cost(command, logs[0].parent, (0,)).printed))


def found(document: dict[str, Any]) -> set[tuple[str, str]]:
    """Pairs of effect and channel, of whatever list they are in."""
    pairs = {(f["effect"], channel) for f in document["findings"] for channel in f["channels"]}
    pairs |= {(f["effect"], channel) for f in document["integrity"] for channel in f["channels"]}
    pairs |= {(f["kind"], channel) for f in document["drift"] for channel in f["channels"]}
    return pairs | {("noise_level", channel) for f in document["noise_level"] for channel in f["channels"]}


def row(name: str, document: dict[str, Any]) -> str:
    case = CASES[name]
    channels = sorted({channel for _, channel in case.truth})
    errors = [
        f"{e['channel']} {e['before_x_floor']:.2f} -> {e['after_x_floor']:.2f}"
        for e in document["error"]
        if e["metric"] == "e10" and e["channel"] in channels
    ]
    status = " ".join(f"{channel} {document['status'][channel]}" for channel in channels)
    pairs = " ".join(f"{effect}/{channel}" for effect, channel in sorted(found(document))) or "nothing"
    wanted = " ".join(f"{effect}/{channel}" for effect, channel in case.truth)
    return f"{name:10} {case.family:18} truth {wanted} | found {pairs} | {status} | {', '.join(errors)}"


def main() -> None:
    chosen = bench.options(__doc__, case=CASES, real_time=False, keep=Path)
    with bench.folder_for(chosen.keep) as folder:
        for name in chosen.case:
            place = folder / name
            place.mkdir(parents=True, exist_ok=True)
            began = time.monotonic()
            logs = acquired(place, CASES[name], chosen.real_time)
            acquired_at = time.monotonic()
            document = traced(logs, *(("--about", CASES[name].truth[0][0]) if name == "weak" else ()))
            (place / "trace.json").write_text(json.dumps(document))
            spent = f"{acquired_at - began:.0f} + {time.monotonic() - acquired_at:.0f} s"
            print(f"{row(name, document)} | {spent}", flush=True)
            print(f"           {document['sentence']}", flush=True)


if __name__ == "__main__":
    main()

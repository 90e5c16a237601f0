"""What a trace says of every measured recording beside the repository: accepted or refused, error before and after.

    python benchmarks/recordings.py [--only NAME ...] [--keep DIR]

Each row is made by the two commands that are printed above it, which anyone with the file can run; flags of the import
are those of the JSON beside the recording. Error is E10 over its white-noise floor (for units turned by hand the norm
of gravity, mg), on what the row names as held out. For the thermal chamber two columns stand beside: the bias held,
which is "before", and a plain cubic in temperature, fitted by least squares to the same training legs. At the end comes
all of it as rows of Markdown.
"""

import itertools
import json
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bench
import numpy as np
from bench import DATA

from imutui.logbook.reading import Reading

CHANNELS = ("gx", "gy", "gz", "ax", "ay", "az")


@dataclass(frozen=True)
class Part:
    """A log to import: its name, and the flags beyond those of the JSON."""

    log: str
    flags: tuple[str, ...] = ()


@dataclass(frozen=True)
class Row:
    """A trace: what it is called, the recordings and their parts, the arguments, and whether a cubic stands beside."""

    name: str
    parts: tuple[tuple[str, Part], ...]
    arguments: tuple[str, ...]
    cubic: bool = False


def whole(name: str, log: str) -> tuple[tuple[str, Part], ...]:
    """A recording as one log."""
    return ((name, Part(log)),)


def cut(name: str, log: str, edges: Sequence[float | None], *, continued: bool = False) -> tuple[tuple[str, Part], ...]:
    """A recording cut at times since its start, s; `continued` says that it is one power-on."""
    out = []
    for k, (a, b) in enumerate(itertools.pairwise(edges)):
        flags = (*(("--start", f"{a:g}") if a else ()), *(("--end", f"{b:g}") if b else ()))
        if continued and k:
            flags += ("--continues", f"{log}{k - 1}.mcap")
        out.append((name, Part(f"{log}{k}", flags)))
    return tuple(out)


ADIS, CHAMBER = "adis16405_static_a", "thermal_chamber_part1"
FAST, SLOW = "broad_fast_rotation", "broad_slow_rotation_breaks"
LEGS = (None, 1360.0, None)
FIFTHS = (None, 680.0, 1360.0, 1930.0, 2500.0, None)

ROWS = (
    Row("chamber, trained on cooling, judged on heating", cut(CHAMBER, "leg", LEGS), ("leg0.mcap", "leg1.mcap"), True),
    Row("chamber, trained on heating, judged on cooling", cut(CHAMBER, "leg", LEGS), ("leg1.mcap", "leg0.mcap"), True),
    *(
        Row(
            f"chamber, both legs as one power-on, part {k + 1} of 5 held out",
            cut(CHAMBER, "part", FIFTHS, continued=True),
            (*(f"part{j}.mcap" for j in range(5) if j != k), "--holdout", f"part{k}.mcap"),
            True,
        )
        for k in (4, 3, 2, 1)
    ),
    Row(
        "ADIS16405 at rest, last 42 min held out",
        cut(ADIS, "a", (None, 2500.0, 5000.0, 7500.0, None)),
        ("a0.mcap", "a1.mcap", "a2.mcap", "a3.mcap"),
    ),
    Row("MPU-6050 at rest", whole("mpu6050_static_host_stamps", "mpu6050"), ("mpu6050.mcap",)),
    Row("Aceinna IMU381 at rest", whole("aceinna_imu381_s1_static", "aceinna"), ("aceinna.mcap",)),
    Row("BROAD, fast rotation", whole(FAST, "fast"), ("fast.mcap",)),
    Row("BROAD, slow rotation", whole(SLOW, "slow"), ("slow.mcap",)),
    Row(
        "BROAD, slow to learn from, fast held out",
        (*whole(SLOW, "slow"), *whole(FAST, "fast")),
        ("slow.mcap", "fast.mcap"),
    ),
    Row(
        "BROAD, fast to learn from, slow held out",
        (*whole(FAST, "fast"), *whole(SLOW, "slow")),
        ("fast.mcap", "slow.mcap"),
    ),
    Row("Xsens MTi, turned by hand", whole("xsens_mti_multiposition", "xsens"), ("xsens.mcap",)),
    Row("MPU-9150 unit 0, turned by hand", whole("mpu9150_multiposition_unit0", "unit0"), ("unit0.mcap",)),
    Row("MPU-9150 unit 1, turned by hand", whole("mpu9150_multiposition_unit1", "unit1"), ("unit1.mcap",)),
    Row("Thor, flight", whole("thor_flight75", "thor"), ("thor.mcap",)),
    Row("Aceinna IMU381, bytes of the wire", (("aceinna_imu381_scale1", Part("scale1")),), ("scale1.mcap",)),
)


def imported(recording: str, part: Part, folder: Path) -> str:
    """Import a part, unless it is there; what the command said if it failed."""
    log = folder / f"{part.log}.mcap"
    if log.exists():
        return ""
    about = json.loads((DATA / f"{recording}.json").read_text())
    arguments = ["import", about["file"], "-o", log.name, *about.get("import", ()), "--kind", "measured", *part.flags]
    print(f"    imutui {shlex.join(arguments)}", flush=True)
    arguments[1] = str(DATA / about["file"])
    done = run(arguments, folder)
    return "" if done.returncode == 0 else f"exit {done.returncode}: {done.stderr.strip()}"


def run(arguments: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "imutui", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, stdin=subprocess.DEVNULL)


def errors(document: dict[str, Any], metric: str) -> dict[str | None, dict[str, Any]]:
    """Error figures of a metric by channel."""
    return {e["channel"]: e for e in document["error"] if e["metric"] == metric}


def traced(document: dict[str, Any], channel: str) -> str:
    """What was found on a channel, in the words of the document."""
    found = [f["effect"] + ("?" if f["rivals"] else "") for f in document["findings"] if channel in f["channels"]]
    found += [f"{r['effect']} refuted" for r in document.get("refuted", []) if channel in r["channels"]]
    found += [d["kind"] for d in document["drift"] if channel in d["channels"]]
    found += [f"line {x['hz']:.4g} Hz" for x in document["lines"] if channel in x["channels"]]
    found += [f"weak: {w['effect']}" for w in document["weak"] if channel in w["channels"]][:2]
    return ", ".join(found) or "nothing"


def cubic(folder: Path, training: Sequence[str], heldout: str) -> dict[str, float]:
    """E10 over its floor of a plain cubic in temperature, by channel: one bias a log, least squares on block means."""
    from filters.tracing import validation
    from filters.tracing.blocks import average
    from filters.tracing.stack import Stack
    from imutui.jobs import runs

    def blocks(log: str) -> Any:
        return average(runs.read_run(folder / log, log, Reading()).run)

    fitted, judged = Stack.of([blocks(log) for log in training]), Stack.of([blocks(heldout)])

    def powers(stack: Stack) -> Any:
        T = np.concatenate([b.slow_inputs.temperature.level for b in stack.blocks])
        return ((T - 25.0) / 30.0)[:, None] ** np.arange(1, 4)

    constant = (fitted.run[:, None] == np.unique(fitted.run)).astype(float)
    X = np.hstack([constant, powers(fitted)])
    out = {}
    for c, name in enumerate(CHANNELS):
        theta = np.linalg.lstsq(X, fitted.y[:, c], rcond=1e-10)[0][-3:]
        after = judged.y[:, c] - powers(judged) @ theta
        white = float(judged.white_sd()[c] * np.sqrt(judged.period))
        figure = validation.e10(judged, judged.y[:, c], after, c, white, 0)
        if figure is not None:
            out[name] = figure.after / figure.floor
    return out


def geometric_mean(values: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(values)))) if len(values) else float("nan")


def markdown(row: Row, document: dict[str, Any], beside: dict[str, float]) -> list[str]:
    """A row of the table of errors, two where a cubic stands beside; of units turned by hand none."""
    e10 = errors(document, "e10")
    if not e10:
        return []
    heldout = next(iter(e10.values()))["heldout"]
    cells = []
    for c in CHANNELS:
        e = e10.get(c)
        if e is None:
            cells.append("–")
            continue
        low, high = (x / e["floor"] for x in e["ci95"])
        cells.append(f"{e['before_x_floor']:.3g} → {e['after_x_floor']:.3g} ({low:.3g}–{high:.3g})")
    lines = [f"| {row.name} | {heldout} | {' | '.join(cells)} |"]
    if beside:
        lines.append(f"| – a plain cubic | | {' | '.join(f'{beside[c]:.3g}' for c in CHANNELS)} |")
    lines.append("| – status | | " + " | ".join(document["status"].get(c, "–") for c in CHANNELS) + " |")
    floors = (f"{e10[c]['floor']:.2g} {e10[c]['unit']}" if c in e10 else "–" for c in CHANNELS)
    lines.append("| – floor | | " + " | ".join(floors) + " |")
    return lines


def told(row: Row, document: dict[str, Any], folder: Path) -> list[str]:
    """Print a row; the same for the table."""
    print(f"    {document['sentence']}")
    norm = errors(document, "gravity_norm").get(None)
    for metric, e in (("gravity_norm", norm), ("gravity_direction", errors(document, "gravity_direction").get(None))):
        if e is not None:
            print(
                f"    {metric}: {e['before']:.3g} -> {e['after']:.3g} {e['unit']} ({e['ci95'][0]:.3g} to"
                f" {e['ci95'][1]:.3g}), floor {e['floor']:.2g}, n {e['n']}, {e['heldout']}"
            )
    e10, nis = errors(document, "e10"), errors(document, "nis")
    beside: dict[str, float] = {}
    if row.cubic:
        logs = [a for a in row.arguments if a.endswith(".mcap")]
        beside = cubic(folder, logs[:-1], logs[-1])
    ratios = []
    for c in CHANNELS:
        status = document["status"].get(c, "-")
        line = f"    {c} {status:12s}"
        if c in e10:
            e = e10[c]
            ratios.append(e["after"] / e["before"])
            low, high = (x / e["floor"] for x in e["ci95"])
            line += (
                f" {e['before_x_floor']:6.3g} -> {e['after_x_floor']:6.3g} ({low:.3g} to {high:.3g}), {e['heldout']}"
            )
        if c in beside:
            line += f", cubic {beside[c]:.3g}"
        if c in nis:
            line += f", sqrt NIS {nis[c]['before']:.3g} -> {nis[c]['after']:.2f}"
        print(f"{line} | {traced(document, c)}")
    if ratios:
        print(f"    after / before, geometric mean over channels: {geometric_mean(ratios):.3f}")
    for x in document["common"]:
        print(f"    common {x['kind']} on {', '.join(x['channels'])}, coherence {x['coherence']:.2f}")
    return markdown(row, document, beside)


def main() -> None:
    chosen = bench.options(__doc__, only=list[str], keep=Path)
    if not DATA.is_dir():
        raise SystemExit("the measured recordings are not beside the repository: ../shared/data is absent")
    table = ["| recording | held out | gx | gy | gz | ax | ay | az |", "|---|---|---|---|---|---|---|---|"]
    with bench.folder_for(chosen.keep) as folder:
        for number, row in enumerate(ROWS):
            if chosen.only and not any(word in row.name for word in chosen.only):
                continue
            print(f"\n{row.name}", flush=True)
            said = [words for recording, part in row.parts if (words := imported(recording, part, folder))]
            if said:
                print(f"    refused: {said[0]}")
                continue
            arguments = ["trace", *row.arguments]
            print(f"    imutui {shlex.join(arguments)}", flush=True)
            done = run([*arguments, "--json"], folder)
            if not done.stdout.strip():
                print(f"    refused: exit {done.returncode}: {done.stderr.strip()}")
                continue
            document = json.loads(done.stdout)
            (folder / f"trace{number}.json").write_text(json.dumps(document))
            table += told(row, document, folder)
    print("", *table, sep="\n")


if __name__ == "__main__":
    main()

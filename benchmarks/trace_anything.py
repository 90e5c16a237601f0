"""Does every trace end with a result? Random parts and channels of the measured recordings, imported and traced.

    python benchmarks/trace_anything.py [--first N] [--count N] [--seeds N ...]

A case is drawn from its seed: a recording of ../shared/data, cut into halves, thirds or anywhere, some of the pieces as
runs or as parts of one power-on, with all channels, some, or gyros or accelerometers alone (the others NaN throughout),
now and then one that stands still or a hole in time. The motion is known as the JSON beside the recording says: at rest
(level, where too few accelerometers are left for the attitude), by optics, turned by hand. Samples are left out so that
a trace takes seconds. Every warning is an error.

A case ends with a result, with words about the input (each kind is listed), or it is a defect: then the exit code is 1.
"""

import collections
import json
import os
import re
import sys
import tempfile
import time
import traceback
import warnings
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import bench
import numpy as np
from helpers.commands import imutui
from helpers.paths import DATA

from filters.errors import InputError
from imutui.jobs.trace import trace
from imutui.logbook.json_text import dumps
from imutui.report import trace_tables

# adis16405_static_d is kept for another count, and the IMU381's 50 s are less than a trace takes
RECORDINGS = (
    *("adis16405_static_a", "mpu6050_static_host_stamps", "thermal_chamber_part1"),
    *("broad_fast_rotation", "broad_slow_rotation_breaks", "thor_flight75"),
    *("xsens_mti_multiposition", "mpu9150_multiposition_unit0", "mpu9150_multiposition_unit1"),
)
_WEIGHTS = np.array([6, 4, 6, 3, 3, 1, 3, 2, 2])
_BY_HAND = RECORDINGS[5:]  # traced as of a unit turned by hand: of a flight nothing else is known
_SHORTEST_S = 65.0
_SAMPLES = (5_000, 20_000, 60_000)
HOW = ("result", "input", "defect")
_ARRAYS = ("t", "gyro", "accel", "temp", "ref_quat")


@dataclass(frozen=True)
class Piece:
    """A log of a case: part of the recording, s, hole in it, which channels are missing, and which stands still."""

    start: float
    end: float
    hole: tuple[float, float] | None
    lacks: tuple[int, ...]
    stuck: int | None


@dataclass(frozen=True)
class Case:
    recording: str
    every: int
    pieces: tuple[Piece, ...]
    continued: bool
    holdout: int | None
    seed: int

    def told(self) -> str:
        """The case in a line."""
        pieces = ", ".join(
            f"{p.start:.0f}-{p.end:.0f} s"
            + (f" without channels {p.lacks}" if p.lacks else "")
            + (f" channel {p.stuck} still" if p.stuck is not None else "")
            + (f" hole {p.hole[0]:.0f}-{p.hole[1]:.0f} s" if p.hole else "")
            for p in self.pieces
        )
        how = f"every {self.every}.{', one power-on' * self.continued}, held out {self.holdout}"
        return f"{self.recording}, {how}: {pieces}"


def stamps_of_all() -> dict[str, np.ndarray]:
    """Stamps of each recording, s."""
    stamps = {}
    for name in RECORDINGS:
        with np.load(DATA / f"{name}.npz") as stored:
            stamps[name] = stored["t"]
    return stamps


def case(seed: int, t: dict[str, np.ndarray]) -> Case:
    """Draw a case; `t` are the stamps of each recording."""
    rng = np.random.default_rng([25, seed])
    name = RECORDINGS[rng.choice(len(RECORDINGS), p=_WEIGHTS / _WEIGHTS.sum())]
    length = float(t[name][-1] - t[name][0])
    most = max(1, int(length / _SHORTEST_S))
    cuts = min(most, int(rng.choice([1, 2, 3, 6])))
    edges = np.linspace(0.0, length, cuts + 1)
    if rng.uniform() < 0.4:
        free = np.sort(rng.uniform(0.0, length - cuts * _SHORTEST_S, cuts + 1))
        edges = free + _SHORTEST_S * np.arange(cuts + 1)
    chosen = rng.permutation(cuts)[: int(rng.integers(1, 4))]
    continued = bool(len(chosen) > 1 and rng.uniform() < 0.25)
    chosen = np.sort(chosen) if continued else chosen
    # of a unit turned by hand the accelerometers are what it is judged by
    most_lacking = 3 if name in _BY_HAND and rng.uniform() < 0.9 else 6
    lacks = _lacking(rng, most_lacking)
    pieces = []
    for k in chosen.tolist():
        a, b = float(edges[k]), float(edges[k + 1])
        hole = None
        if rng.uniform() < 0.15:
            begin = a + rng.uniform(0.1, 0.7) * (b - a)
            hole = (begin, begin + rng.uniform(0.0, 0.2) * (b - a))
        own = lacks if rng.uniform() < 0.85 else _lacking(rng, most_lacking)
        stuck = int(rng.integers(6)) if rng.uniform() < 0.1 else None
        pieces.append(Piece(a, b, hole, own, stuck))
    rate = (t[name].size - 1) / length
    count = rate * sum(p.end - p.start for p in pieces)
    every = int(np.clip(np.ceil(count / rng.choice(_SAMPLES)), 1, max(1, rate)))
    holdout = int(rng.integers(len(pieces))) if len(pieces) > 1 and rng.uniform() < 0.5 else None
    return Case(name, every, tuple(pieces), continued, holdout, int(rng.integers(3)))


def _lacking(rng: np.random.Generator, most: int) -> tuple[int, ...]:
    """Channels that are not there, of the first `most`, seldom all of those."""
    how = rng.uniform()
    if how < 0.4:
        return ()
    if how < 0.55:
        return (3, 4, 5) if most == 6 and rng.uniform() < 0.5 else (0, 1, 2)
    return tuple(sorted(rng.permutation(most)[: int(rng.integers(1, most))].tolist()))


def logs_of(case: Case, folder: Path) -> tuple[list[Path], str]:
    """Import the pieces of a case; what the command said if it refused one."""
    about = json.loads((DATA / f"{case.recording}.json").read_text())
    flags = list(about.get("import", ()))
    if case.recording in _BY_HAND:
        flags += ["--reference", "turned"]
    elif "gravity" in flags and any({3, 4} & {*piece.lacks} for piece in case.pieces):
        flags += ["--reference", "level"]
    with np.load(DATA / about["file"]) as stored:
        whole = {key: stored[key] for key in _ARRAYS if key in stored}
    logs: list[Path] = []
    for number, piece in enumerate(case.pieces):
        source, log = folder / f"piece{number}.npz", folder / f"piece{number}.mcap"
        np.savez(source, **_cut(whole, piece, case.every))  # type: ignore[arg-type] # no array is `allow_pickle`
        more = ["--continues", str(logs[-1])] if case.continued and logs else []
        done = imutui("import", str(source), "-o", str(log), *flags, *more, "--kind", "measured", check=None)
        if done.returncode or "RuntimeWarning" in done.stderr:
            return [], done.stderr
        logs.append(log)
    return logs, ""


def _cut(whole: dict[str, np.ndarray], piece: Piece, every: int) -> dict[str, np.ndarray]:
    t = whole["t"] - whole["t"][0]
    rows = (t >= piece.start) & (t < piece.end)
    if piece.hole is not None:
        rows &= (t < piece.hole[0]) | (t > piece.hole[1])
    part = {key: values[rows][::every] for key, values in whole.items()}
    readings = np.hstack([part["gyro"], part["accel"]]).astype(float)
    readings[:, piece.lacks] = np.nan
    if piece.stuck is not None:
        readings[:, piece.stuck] = readings[0, piece.stuck]
    return part | {"gyro": readings[:, :3], "accel": readings[:, 3:]}


def ends(case: Case, folder: Path) -> tuple[str, str]:
    """How a case ends: `result`, `input` or `defect`, and the words."""
    try:
        logs, refused = logs_of(case, folder)
        if refused:
            return (
                "defect" if "RuntimeWarning" in refused or "a defect of imutui" in refused else "input"
            ), refused.strip()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            holdout = None if case.holdout is None else logs[case.holdout]
            document = trace(logs, holdout=holdout, seed=case.seed)
            dumps(document)
            trace_tables.text(document, document["source"], 80)
            return "result", document["sentence"]
    except Exception as error:  # noqa: BLE001 - whatever it is, is counted
        if isinstance(error, InputError):
            return "input", str(error)
        return "defect", "".join(traceback.format_exception(error))


def kind_of(words: str) -> str:
    """Words about an input without the names and figures of the one case."""
    return re.sub(r"[-+]?\d+(\.\d+)?(e[-+]\d+)?", "#", re.sub(r"\S*/", "", words))[:160]


def main() -> None:
    chosen = bench.options(__doc__, first=0, count=400, seeds=list[int])
    if not DATA.is_dir():
        sys.exit("the measured recordings are not beside the repository: ../shared/data is absent")
    stamps = stamps_of_all()
    count: dict[str, collections.Counter[str]] = collections.defaultdict(collections.Counter)
    kinds: dict[str, list[int]] = collections.defaultdict(list)
    seconds = []
    for seed in chosen.seeds or range(chosen.first, chosen.first + chosen.count):
        made = case(seed, stamps)
        with tempfile.TemporaryDirectory() as folder:
            began = time.process_time()
            how, words = ends(made, Path(folder))
            seconds.append(time.process_time() - began)
        count[made.recording][how] += 1
        if how == "input":
            kinds[kind_of(words)].append(seed)
        print(f"{seed} {how} {seconds[-1]:.1f} s: {made.told()}\n    {words}", flush=True)
    print(f"\n{bench.describe('numpy', 'scipy', 'numba')}\n\n{'':44}" + "".join(f"{how:>8}" for how in HOW))
    total = sum(count.values(), collections.Counter[str]())
    for name, own in [*sorted(count.items()), ("all", total)]:
        print(f"{name:44}" + "".join(f"{own[how]:8}" for how in HOW))
    for kind, seeds in sorted(kinds.items(), key=lambda item: -len(item[1])):
        print(f"{len(seeds):4} times: {kind} (seeds {', '.join(map(str, seeds))})")
    print(f"processor time of a case, import included: {bench.told(seconds)} s")
    sys.exit(1 if total["defect"] else 0)


if __name__ == "__main__":
    main()

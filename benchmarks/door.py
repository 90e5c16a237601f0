"""Recordings of other programs: which are taken as they were meant, and whether the commands of refusals work.

    python benchmarks/door.py [--kinds mcap table logger variant bag] [--verbose]

mcap, table: the cases of `../shared/cases`, where that folder is present. logger: recordings as nine loggers leave
them, three seeds each; variant: as others do; bag: bags and MCAP files as drivers of ROS leave them. A recording is
imported (tables, bags) or replayed (MCAP). It is taken rightly if the result has the rates, forces, rate and number of
samples that it was made with; `assumed` lists each assumption. If it is refused, each command of the message is
run and its result is judged alike. All readings are simulated.
Exit code 1 if anything is wrong.
"""

import json
import re
import shlex
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import bench
import numpy as np
from bench import IMUTUI, ROOT
from helpers import bags_of_others, recordings_of_others

from imutui.logbook import reader

CASES = ROOT.parent / "shared" / "cases"
BIAS_DPS = np.array([0.10, -0.20, 0.30])
NOTHING = ("empty.mcap", "no_channels.mcap")  # hold no sample: a refusal is all that there is
RATES = {"rate_1hz.mcap": 1.0, "rate_1600hz.mcap": 1600.0}
"""Rates, Hz, where they are not 100. Gaps and samples that are lost (gap_3h, high_rate_gap) do not change a rate."""
FEWER = {"json.mcap": 300, "ros1.mcap": 300, "ros1.bag": 300, "bag_db3": 300, "short_2s.mcap": 200, "cut.mcap": 1000,
         "zero_tail.mcap": 1000, "zero_first100.mcap": 2900, "high_rate_gap.mcap": 2700, "level_cut.bag": 1000,
         "clock_step_back.mcap": 2930}  # fmt: skip
"""Samples that are taken at the least, where they are not nearly 3000: of files that are cut, more than a third. One of
a clock that steps back by 0.7 s may be taken without the samples that lie there twice."""
SIGNS = {"flu_level.mcap": (1, -1, -1), "livox_g.mcap": (1, -1, -1)}
"""Rates as a recording has them, where its axes are others."""
SPOILED = ("frozen.mcap", "all_frozen.mcap", "hold4.mcap", "frozen_1s.csv", "one_spike.csv", "two_imus.mcap",
           "dup_columns_two_imus.csv")  # fmt: skip
"""Taken as they are: their faults are of the sensor, or a choice has another unit's biases."""
_COMMAND = re.compile(r"`(imutui [^`]*)`")


def judged(path: Path, words: list[str], output: Path) -> tuple[str, str, list[str]]:
    """Run a command: "taken", "refused" or "wrong", with details, and the commands of a refusal."""
    done = subprocess.run([*IMUTUI, *words], capture_output=True, text=True, check=False, cwd=path.parent)
    if "Traceback" in done.stderr or "a defect" in done.stderr:
        return "wrong", done.stderr[-300:], []
    if not done.stdout.strip():
        return "refused", " ".join(done.stderr.split())[:300], _COMMAND.findall(done.stderr)
    document = json.loads(done.stdout)
    if is_right(path, document, output, is_part="--start" in words or "--end" in words):
        return "taken", "; ".join(document["assumed"]), []
    return "wrong", done.stdout[:300] + done.stderr[-200:], []


def is_right(path: Path, document: dict, output: Path, *, is_part: bool) -> bool:  # type: ignore[type-arg]
    """Return whether a result has the numbers that the recording was made with.

    `is_part`: the command took a part of it.
    """
    if path.name in SPOILED:
        return bool(document["samples"] > 100)
    expected = BIAS_DPS * SIGNS.get(path.name, (1, 1, 1))
    rate, least = RATES.get(path.name, 100.0), FEWER.get(path.name, 2985)
    if path.parent.name == "bag" and path.stem in bags_of_others.RECORDINGS:
        _, rate, share = bags_of_others.RECORDINGS[path.stem]
        least = round(3000 * share) - 15
    if abs(document["rate_hz"] / rate - 1.0) > 0.02 or document["samples"] < (900 if is_part else least):
        return False
    if "final" in document:
        found = np.array(document["final"]["gyro_bias_dps"], float)
        return bool(np.allclose(found, expected, atol=0.03))
    log = reader.read(output)
    axes, valid = log.info.axes(), log.samples.valid
    gyro = np.median(np.rad2deg(axes.gyro_to_instrument(log.samples.gyro[valid])), axis=0)
    force = np.median(axes.accel_to_instrument(log.samples.accel[valid]) / log.info.g_unit, axis=0)
    sizes = np.isnan(force).all() or abs(np.linalg.norm(force) - 1.0) < 0.005
    return bool(np.allclose(gyro, expected, atol=0.02) and sizes)


def looked_at(path: Path, folder: Path) -> tuple[str, str]:
    """Return how a recording fares, and details."""
    output = folder / f"{path.name}.log.mcap"
    replayed = path.suffix == ".mcap"  # of another program: a bag has to be imported
    words = (
        ["replay", str(path), "--json"] if replayed else ["import", str(path), "-o", str(output), "--json", "--force"]
    )
    outcome, details, commands = judged(path, words, output)
    if outcome != "refused":
        return outcome, details
    if path.name in NOTHING:
        return "refused, holds nothing", details
    if not commands:
        return "wrong", f"refused without a command: {details}"
    for command in commands:
        again = shlex.split(command)[1:]
        made = Path(again[again.index("-o") + 1]) if "-o" in again else output
        made = made if made.is_absolute() else path.parent / made
        again += [] if "--json" in again else ["--json"]
        again += ["--force"] if again[0] == "import" and "--force" not in again else []
        outcome, why, more = judged(path, again, made)
        for _ in range(2):  # steps more: the columns first, then the units, then the directions
            if outcome == "refused" and more:
                outcome, why, more = judged(path, [*shlex.split(more[0])[1:]], made)
        if outcome != "taken":
            return "wrong", f"`{command}`: {why}"
    return "refused with commands that work", f"{len(commands)}: {commands[0]}"


def main() -> None:
    """Look at all cases."""
    asked = bench.options(__doc__, kinds={"mcap": 0, "table": 0, "logger": 0, "variant": 0, "bag": 0}, verbose=False)
    print(bench.describe("numpy", "pandas", "rosbags", "mcap"))
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files: list[Path] = []
        for kind, script in (("mcap", "make_mcap.py"), ("table", "make_csv.py")):
            if kind in asked.kinds and CASES.is_dir():
                (folder / kind).mkdir()
                subprocess.run([sys.executable, CASES / script, folder / kind], check=True)
                files += sorted(folder.joinpath(kind).iterdir())
            elif kind in asked.kinds:
                print(f"{kind}: skipped, {CASES} is not there")
        if "logger" in asked.kinds:
            for seed in range(3):
                (folder / f"logger{seed}").mkdir()
                files += recordings_of_others.write(folder / f"logger{seed}", seed)
        for kind in ("variant", "bag"):
            if kind in asked.kinds:
                (folder / kind).mkdir()
        if "variant" in asked.kinds:
            files += recordings_of_others.write(folder / "variant", loggers=recordings_of_others.VARIANTS)
        if "bag" in asked.kinds:
            files += bags_of_others.write(folder / "bag")
        for path in files:
            outcome, details = looked_at(path, folder)
            total[outcome] += 1
            if asked.verbose or outcome == "wrong":
                print(f"{path.name}: {outcome} ({details})", flush=True)
    for outcome, count in total.most_common():
        print(f"{outcome}: {count}")
    raise SystemExit(bool(total["wrong"]))


if __name__ == "__main__":
    main()

"""Effects that nobody declared, over the wire: recorded power-on by power-on, traced from the logs, judged.

    python benchmarks/undeclared.py --check tests/undeclared/NAME.py
    python benchmarks/undeclared.py --set tests/undeclared/NAME.py -o RESULT.json [--recording NAME] [--case NAME ...]

A set is a Python file of functions with a table (tests/undeclared/README.md). Each effect is added to a virtual unit by
`imutui virtual --spoil`: three power-ons to fit and one held out, each with another temperature history, on made noise
or on parts of a measured recording (../shared/data, played with --from), acquired over pseudo terminals at 20 Hz on the
unit's time (tests/support/unit_time), two at once; --real-time takes one case on the wall's. `imutui trace` is told the
logs and nothing else. Measured noise is also traced without its effect, from the same parts, motion and temperature,
not over the wire: what is found there is the recording's own. Temperature and motion are simulated throughout. Seeds
decide the readings; on which of them a 20 Hz sample begins depends on when the first packet was asked for.
"""

import argparse
import hashlib
import json
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

import bench
import numpy as np
import undeclared_score as score
import undeclared_sets as sets
from numpy.typing import NDArray
from undeclared_sets import Undeclared
from unit_time import record, virtual, virtual_in_real_time

Unit = Callable[..., AbstractContextManager[tuple[str, dict[str, str]]]]

# what a result keeps of a trace: all that is told of causes, status and error
KEPT = (
    *("runs", "findings", "weak", "drift", "common", "refuted", "remainder", "lines", "noise_level", "integrity"),
    *("status", "error", "sentence", "notes"),
)
_AT_ONCE = 2


def acquire(effect: Undeclared, folder: Path, power_on: int, unit: Unit = virtual) -> Path:
    """Log of a power-on of an effect, over the wire; the folder has the scenario."""
    log = folder / f"{folder.name}-{power_on}.mcap"
    asked = sets.record_options(folder, measured=effect.measured, table=effect.table)
    with unit(*sets.unit_options(effect, folder, power_on)) as (port, environment):
        record(port, environment, log, sets.seconds_of(power_on), *asked)
    return log


def without(effect: Undeclared, folder: Path, power_on: int) -> Path:
    """Log of the same power-on without the effect, imported."""
    return imported(effect, folder / f"{folder.name}-{power_on}-without.mcap", sets.without(effect, folder, power_on))


def imported(effect: Undeclared, log: Path, arrays: dict[str, NDArray[np.float64]]) -> Path:
    """Log of arrays of a power-on, beside its scenario."""
    folder, plain = log.parent, log.with_suffix(".npz")
    np.savez(plain, **arrays)  # type: ignore[arg-type] # no array is `allow_pickle`
    asked = sets.record_options(folder, measured=effect.measured, table=effect.table)
    bench.cost([*bench.IMUTUI, "import", str(plain), "-o", str(log), "--kind", "simulated", *asked], folder, (0,))
    return log


def traced(logs: list[Path]) -> dict[str, Any]:
    """What `imutui trace` makes of the logs, the last of them held out."""
    command = [*bench.IMUTUI, "trace", *map(str, logs), "--json"]
    document = json.loads(bench.cost(command, logs[0].parent, (0,)).printed)
    return {key: document[key] for key in KEPT if key in document}


def run(
    effects: list[Undeclared], place: Path, real_time: str | None, say: Callable[[str], None]
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """Traces of all effects, and of measured noise without them: all logs first, two at once, then the traces."""
    folders = {effect.name: place / effect.name for effect in effects}
    for effect in effects:
        folders[effect.name].mkdir(parents=True, exist_ok=True)
        # once: two power-ons at a time read it
        sets.scenario(folders[effect.name], effect)
    everything = [(effect, k) for effect in effects for k in range(sets.power_ons())]
    began = time.monotonic()
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        wire = [(effect, k) for effect, k in everything if effect.name != real_time]
        logs = list(pool.map(lambda task: acquire(task[0], folders[task[0].name], task[1]), wire))
        say(f"{len(logs)} power-ons acquired in {time.monotonic() - began:.0f} s")
        noise = [(effect, k) for effect, k in everything if effect.measured]
        plain = list(pool.map(lambda task: without(task[0], folders[task[0].name], task[1]), noise))
    for effect in effects:
        if effect.name == real_time:
            logs += _in_real_time(effect, folders[effect.name])
            say(f"{effect.name} acquired in real time")
    began = time.monotonic()
    groups = [
        {name: sorted(log for log in of if log.parent == folders[name]) for name in folders} for of in (logs, plain)
    ]
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        jobs = [{name: pool.submit(traced, some) for name, some in group.items() if some} for group in groups]
        found, controls = ({name: job.result() for name, job in group.items()} for group in jobs)
    say(f"{len(found) + len(controls)} traces in {time.monotonic() - began:.0f} s")
    return found, controls


def _in_real_time(effect: Undeclared, folder: Path) -> list[Path]:
    """Logs of all power-ons of an effect on the wall's clock, all at once."""
    with ThreadPoolExecutor(sets.power_ons()) as pool:
        take = partial(acquire, effect, folder, unit=virtual_in_real_time)
        return list(pool.map(take, range(sets.power_ons())))


def results(
    effects: list[Undeclared], place: Path, real_time: str | None, say: Callable[[str], None]
) -> dict[str, Any]:
    """Everything about a set that a result file has, but where it came from."""
    documents, controls = run(effects, place, real_time, say)
    with tempfile.TemporaryDirectory() as scratch:
        sizes = {effect.name: sets.achieved(effect, Path(scratch)) for effect in effects}
    entries: dict[str, Any] = {}
    for effect in effects:
        control = controls.get(effect.name)
        entries[effect.name] = {
            "truth": effect.truth(),
            "d": sizes[effect.name],
            "real_time": effect.name == real_time,
            "judged": score.judged(effect, sizes[effect.name], documents[effect.name], control),
            "trace": _portable(documents[effect.name]),
            "without": None if control is None else _portable(control),
        }
    pairs = [(effect, entries[effect.name]) for effect in effects]
    return {"effects": entries, "summary": score.summary(pairs)}


def _portable(document: dict[str, Any]) -> dict[str, Any]:
    """A trace without the paths and hashes of this machine's logs, which another run of the same set has not."""
    runs = [{k: v for k, v in entry.items() if k not in ("log", "log_sha256")} for entry in document["runs"]]
    return document | {"runs": runs}


def conditions() -> dict[str, Any]:
    """How all cases were recorded."""
    return {
        "fitted_s": sets.FITTED_S, "heldout_s": sets.HELDOUT_S, "rate_hz": 20.0, "seed": sets.SEED,
        "temperature_histories": list(sets.HISTORIES), "recording": sets.RECORDING.name,
        "visible_d": sets.VISIBLE_D, "faint_d": sets.FAINT_D,
        "simulated": "temperature, motion; noise too where the truth says so",
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--check", type=Path, metavar="FILE.py")
    what.add_argument("--set", type=Path, metavar="FILE.py")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--case", nargs="*")
    parser.add_argument("--real-time", metavar="NAME")
    parser.add_argument("--recording", default=sets.RECORDING.stem, help="measured noise, of ../shared/data")
    parser.add_argument("--keep", type=Path, help="folder that keeps the logs")
    chosen = parser.parse_args()
    sets.RECORDING = bench.DATA / f"{chosen.recording}.npz"
    with tempfile.TemporaryDirectory() as scratch:
        if chosen.check is not None:
            for line in sets.check(chosen.check, Path(scratch)):
                print(line, flush=True)
            return
        effects = [e for e in sets.load_set(chosen.set) if chosen.case is None or e.name in chosen.case]
        began = time.monotonic()
        found = results(
            effects, chosen.keep or Path(scratch), chosen.real_time, lambda text: print(text, file=sys.stderr)
        )
    content = chosen.set.read_bytes()
    document = {
        "version": 1, "set": chosen.set.name, "set_sha256": hashlib.sha256(content).hexdigest(),
        "conditions": conditions(), **found,
    }  # fmt: skip
    if chosen.output is not None:
        chosen.output.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    pairs = [(effect, found["effects"][effect.name]) for effect in effects]
    print("\n".join([*score.table(pairs), "", *score.words(found["summary"])]))
    print(f"{time.monotonic() - began:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()

"""Readers and validators of logs by others, over files that came about in every way: what each of them finds.

    python benchmarks/foreign_readers.py [--logs LOG ...]

Without arguments files are made on a virtual unit: finished, rotated, reconnected, recovered after kill -9. Nothing is
installed: of rosbags, mcap, @mcap/core (node, and NPM_READERS naming a folder where `npm install` was run on
tests/foreign/package.json), `pymcap-cli doctor` and `rerun mcap check` those that are there are used, and what lacks is
said. With logs as arguments those are looked at.
"""

import os
from collections.abc import Callable
from pathlib import Path

import bench
from helpers import readers
from reliability import endings, lines
from reliability.setting import acquiring


def finished(folder: Path) -> list[Path]:
    """With filter, reference and diagnostics."""
    with acquiring(folder, filter="spkf", rate_hz=20.0) as it:
        it.goes_on(5.0)
        path = it.path
    return [path]


def rotated(folder: Path) -> list[Path]:
    with acquiring(folder, rotate_minutes=0.03) as it:
        it.goes_on(4.5)
    return sorted(folder.rglob("*.mcap"))


def reconnected(folder: Path) -> list[Path]:
    """With a gap, and an event of it."""
    lines.unplugged(folder)
    return sorted(folder.rglob("*.mcap"))


def recovered(folder: Path) -> list[Path]:
    """After kill -9."""
    endings.kill_nine(folder)
    return sorted(folder.rglob("*_recovered.mcap"))


MADE: tuple[Callable[[Path], list[Path]], ...] = (finished, rotated, reconnected, recovered)


def cells(kind: str, path: Path) -> list[str]:
    """What all of them say of one file."""
    counts = {name: read(path) for name, read in readers.READERS.items()}
    said = [f"{sum(found.values())} messages" if found is not None else "–" for found in counts.values()]
    there = [found for found in counts.values() if found is not None]
    said += ["yes" if all(found == there[0] for found in there) else "NO"]
    for validate in readers.VALIDATORS.values():
        verdict = validate(path)
        said.append("–" if verdict is None else f"{verdict.errors} errors, {verdict.warnings} warnings")
    return [kind, *said]


def main() -> None:
    asked = bench.options(__doc__, logs=list[Path])
    print(bench.describe("mcap", "rosbags"))
    bench.head("file", *readers.READERS, "all alike", *readers.VALIDATORS)
    for log in asked.logs or ():
        bench.row(*cells(log.name, log))
    if asked.logs:
        return
    for make in MADE:
        with bench.folder_for() as folder:
            (folder / "run").mkdir(mode=0o700)
            os.environ |= {"XDG_RUNTIME_DIR": str(folder / "run"), "XDG_CONFIG_HOME": str(folder / "config")}
            for path in make(folder):
                bench.row(*cells(make.__name__, path))
    print("\n– : not there. `pip install pymcap-cli rerun-sdk`; node with the packages of tests/foreign/package.json.")


if __name__ == "__main__":
    main()

"""How long a table under command turns on after something has gone wrong: kills at 20 moments, and each fault.

A virtual table is served by this process, so that its own record says when its axes stood; the acquisition and the
keeper are processes of their own, as always. Moments are spread over a profile's moves, rates and swings by a seed.

    python benchmarks/table_safety.py                        # all
    python benchmarks/table_safety.py --kills 5 --only kills

Prints a line a case: what went wrong, how fast the table turned, ms until the first stopping command was carried out,
and until all axes stood; and whether the file is whole.
"""

import argparse
import contextlib
import math
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from helpers.documents import dwell, profile_toml, rate, sine
from helpers.processes import end_owner, family
from helpers.tables import Served, served, strike
from helpers.units import virtual

from filters.simulation import TableFault
from imutui.logbook import reader
from imutui.session import client
from imutui.session.client import Client, SessionError
from imutui.session.plan import Plan

STANDS = math.radians(0.01)
LIMIT_S = 60.0
ROUNDS = [
    [dwell(1.0, outer=20.0 * (-1) ** k, inner=170.0 * (k % 2)), rate("inner", 60.0, 3.0), sine("middle", 5.0, 0.5, 4.0)]
    for k in range(40)
]
PROFILE = profile_toml(*(segment for each in ROUNDS for segment in each), align="marks", slew_dps=40.0)
WAYS = ("acquisition killed", "keeper killed", "Esc", "SIGTERM", "unit unplugged", "interlock", "limit", "stuck", "cut")


def fastest(it: Served) -> float:
    """Rate of the axis that turns fastest, deg/s."""
    return math.degrees(max(abs(axis.rate) for axis in it.table.axes.values()))


def strike_by(way: str, it: Served, connection: Client, unit: ExitStack) -> None:
    """Have something go wrong."""
    match way:
        case "acquisition killed":
            os.kill(connection.pid, signal.SIGKILL)
        case "keeper killed":
            lines = {pid: Path(f"/proc/{pid}/cmdline").read_bytes() for pid in family(connection.pid)}
            os.kill(next(pid for pid, line in lines.items() if b"imutui.table" in line), signal.SIGKILL)
        case "Esc":
            connection.guide("cancel")
        case "SIGTERM":
            os.kill(connection.pid, signal.SIGTERM)
        case "unit unplugged":
            unit.close()
        case "limit":
            strike(it, TableFault(0.0, "limit", axis=max(it.table.axes, key=lambda a: abs(it.table.axes[a].rate))))
        case "stuck":
            strike(it, TableFault(0.0, "stuck", axis=max(it.table.axes, key=lambda a: abs(it.table.axes[a].rate))))
        case "cut":
            strike(it, TableFault(0.0, "cut", seconds=0.5))
        case other:
            strike(it, TableFault(0.0, other))


def case(way: str, after_s: float, from_dps: float, folder: Path) -> str:
    """Run until a moment when an axis is so fast, have something go wrong, and say how it went."""
    name = f"case-{time.monotonic_ns()}"
    with served() as it, ExitStack() as unit:
        plan = Plan(
            unit.enter_context(virtual()), logs=str(folder / name), record=True, filter="none", reference="profile",
            reference_file=("run.toml", PROFILE), controller=it.url, yes_move=True, name=name,
        )  # fmt: skip
        connection = client.start(plan)
        began = time.monotonic()
        wait(lambda: time.monotonic() - began > after_s and fastest(it) > from_dps)
        speed, told = fastest(it), len(it.told)
        strike_by(way, it, connection, unit)
        struck = time.monotonic()
        seen: list[float] = []

        def stands() -> bool:
            is_off = way in ("interlock", "limit") and all(axis.is_idle for axis in it.table.axes.values())
            if not seen and (len(it.told) > told or is_off):
                seen.append(time.monotonic())
            return bool(seen) and all(abs(axis.rate) < STANDS and axis.is_idle for axis in it.table.axes.values())

        stood = wait(stands)
        # whatever ends it by itself has; what the operator stopped is ended here
        with contextlib.suppress(SessionError):
            connection.stop()
        still = wait(lambda: all(axis.is_idle for axis in it.table.axes.values()))
        log = reader.read(next((folder / name).glob("*.mcap")))
    whole = "whole" if log.finished else "to its last second" if way == "acquisition killed" else "NOT WHOLE"
    first = f"{(seen[0] - struck) * 1e3:6.0f}" if seen else "     –"
    stands_ms = f"{(stood - struck) * 1e3:6.0f}" if stood and still else "   NOT"
    return f"{way:<20} {speed:6.1f} deg/s  {first} ms  {stands_ms} ms  file {whole}"


def wait(true: Callable[[], bool]) -> float:
    """When a state of affairs was there, monotonic; 0 if it did not come."""
    deadline = time.monotonic() + LIMIT_S
    while time.monotonic() < deadline:
        if true():
            return time.monotonic()
        time.sleep(0.001)
    return 0.0


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--kills", type=int, default=20, help="moments at which the acquisition is killed")
    asked.add_argument("--each", type=int, default=3, help="moments of each other way")
    asked.add_argument("--only", choices=("kills", "faults"))
    asked.add_argument("--seed", type=int, default=1)
    said = asked.parse_args()
    rng = np.random.default_rng(said.seed)
    ways = [WAYS[0]] * (0 if said.only == "faults" else said.kills)
    ways += [way for way in WAYS[1:] for _ in range(said.each)] if said.only != "kills" else []
    print(f"{'what went wrong':<20} {'it turned at':>12}  stopped after  stood after")
    with tempfile.TemporaryDirectory() as folder:
        runtime = Path(folder, "run")
        runtime.mkdir(mode=0o700)
        os.environ["XDG_RUNTIME_DIR"] = str(runtime)
        try:
            for way in ways:
                print(case(way, float(rng.uniform(2.0, 14.0)), float(rng.uniform(2.0, 35.0)), Path(folder)), flush=True)
        finally:
            for lock in (runtime / "imutui").glob("*.lock"):
                end_owner(lock)


if __name__ == "__main__":
    main()

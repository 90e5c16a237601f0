"""How long a table under command turns on after something has gone wrong: kills at 20 moments, and each fault.

A virtual table is served by this process, so that its own record says when its axes stood; the acquisition and the
keeper are processes of their own, as always. Moments are spread over a profile's moves, rates and swings by a seed.

    python benchmarks/table_safety.py                        # all
    python benchmarks/table_safety.py --kills 5 --only kills
    python benchmarks/table_safety.py --only stops           # paths, braking, and stops amid commands

Prints a line a case: what went wrong, how fast the table turned, ms until the first stopping command was carried out,
and until all axes stood; and whether the file is whole.

`stops` commands tables through keepers of their own. Its line for each way has the number of moments, the largest angle
beyond the operator's limits, the commands that moved an axis after the stop, the longest times until the first stopping
command and until all axes stood, and the tracebacks of keepers.
"""

import argparse
import contextlib
import math
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
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
from imutui.table.links import TableError
from imutui.table.messages import Command
from imutui.table.motion import Motion, Move, Turn
from imutui.table.owner import KeptTable

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


@dataclass
class Outcome:
    """What one moment has come to; ms and deg."""

    beyond: float = 0.0
    moved: int = 0  # commands that moved an axis after the stop
    stopped: float = 0.0
    stood: float = 0.0


class Watched:
    """A table whose true angles are compared with limits of its inner axis until it is looked at no more."""

    def __init__(self, it: Served, low: float, high: float) -> None:
        self._it, self._low, self._high, self.beyond, self._ends = it, low, high, 0.0, False
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        while not self._ends:
            angle = math.degrees(self._it.table.axes["inner"].angle)
            self.beyond = max(self.beyond, self._low - angle, angle - self._high)
            time.sleep(0.01)

    def end(self) -> float:
        self._ends = True
        self._thread.join()
        return self.beyond


def moves(told: str) -> bool:
    """Whether a line sets an axis going."""
    to = [each for each in told.split("; ") if "demand:rate" in each and not each.endswith(",0")]
    return bool(to) or "mode:position" in told or "mode:synt" in told or "demand:position" in told


def all_idle(it: Served) -> bool:
    return all(axis.is_idle for axis in it.table.axes.values())


def after(it: Served, strike: Callable[[], None], until: Callable[[], bool], known: float = LIMIT_S) -> Outcome:
    """Have something happen that must stop the table, and say what came of it."""
    before, struck = len(it.told), time.monotonic()
    strike()
    stopped = wait(lambda: any("demand:rate" in told and told.endswith(",0") for told in it.told[before:]))
    # a controller that can't be reached is none that can be stopped: then the axis turns until it can
    stood = wait(lambda: all_idle(it)) or struck + known
    wait(until)
    moved = sum(map(moves, it.told[before:]))
    return Outcome(0.0, moved, 1e3 * ((stopped or struck + LIMIT_S) - struck), 1e3 * (stood - struck))


def at_rest(it: Served, angle: float) -> bool:
    """Whether the inner axis rests at an angle."""
    axis = it.table.axes["inner"]
    return abs(math.degrees(axis.angle) - angle) < 0.1 and abs(axis.rate) < STANDS


def go(motions: Iterable[Motion]) -> Command:
    return Command("go", tuple(motions))


def to_angles(table: KeptTable, *angles: float, rate_dps: float, accel_dps2: float) -> list[Motion]:
    return [Move(axis, angle, rate_dps, accel_dps2) for axis, angle in zip(table.axes, angles, strict=True)]


def path(rng: np.random.Generator, it: Served) -> Outcome:
    """2.1: from near one stop to near the other, where the short way leads through both."""
    table = KeptTable(it.url, "inner=200/400/-170/170")
    side = float(rng.choice((-1.0, 1.0)))
    watched = Watched(it, -170.0, 170.0)
    with contextlib.closing(table):
        table.ask(Command("enable"))
        for to in (side * float(rng.uniform(100.0, 169.0)), -side * float(rng.uniform(100.0, 169.0))):
            with contextlib.suppress(TableError):
                table.ask(go(to_angles(table, 0.0, 0.0, to, rate_dps=180.0, accel_dps2=400.0)))
            wait(lambda to=to: table.has_ended or at_rest(it, to))  # type: ignore[misc]
    wait(lambda: all_idle(it))
    return Outcome(watched.end())


def braking(rng: np.random.Generator, it: Served) -> Outcome:
    """2.2: a rate towards a stop, with an acceleration of its own."""
    high = float(rng.uniform(40.0, 110.0))
    table = KeptTable(it.url, f"inner=200/500/-{high}/{high}")
    watched = Watched(it, -high, high)
    with contextlib.closing(table):
        table.ask(Command("enable"))
        with contextlib.suppress(TableError):
            accel = float(10.0 ** rng.uniform(0.7, 2.0))
            table.ask(go([Turn("inner", float(rng.uniform(10.0, 100.0)), accel)]))
            wait(lambda: table.has_ended)
    wait(lambda: all_idle(it))
    return Outcome(watched.end())


def turning(rng: np.random.Generator, it: Served) -> KeptTable:
    """A table whose inner axis turns."""
    table, dps = KeptTable(it.url), float(rng.uniform(20.0, 100.0))
    table.ask(Command("enable"))
    table.ask(go([Turn("inner", dps, float(rng.uniform(50.0, 200.0)))]))
    wait(lambda: fastest(it) > 0.9 * dps)
    time.sleep(float(rng.uniform(0.0, 0.5)))
    return table


def silent(rng: np.random.Generator, it: Served) -> Outcome:
    """2.3: answers are lost for 8 s, and commands are heard."""
    with contextlib.closing(turning(rng, it)) as table:
        return after(it, lambda: strike(it, TableFault(0.0, "silent", seconds=8.0)), lambda: table.has_ended)


def gone(rng: np.random.Generator, it: Served) -> Outcome:
    """2.4: answers are lost for good, so that no rest is ever confirmed."""
    with contextlib.closing(turning(rng, it)) as table:
        made = after(it, lambda: strike(it, TableFault(0.0, "silent")), lambda: table.has_ended)
        wait(lambda: table.has_ended)  # longer than it is waited for once
        made.moved += not table.error.endswith("ress its emergency stop.")
    return made


def amid(rng: np.random.Generator, it: Served) -> Outcome:
    """2.5: a signal amid a move of three axes over a link that answers 0.25 s late."""
    table = KeptTable(it.url)
    with contextlib.closing(table):
        table.ask(Command("enable"))
        it.server._of_link.append(TableFault(0.0, "slow", delay=0.25))
        table.send(go(to_angles(table, 90.0, -90.0, 90.0, rate_dps=30.0, accel_dps2=100.0)))
        wait(lambda: bool(it.told and "position" in it.told[-1]))
        time.sleep(float(rng.uniform(0.0, 2.0)))
        return after(it, lambda: os.kill(table._process.pid, signal.SIGINT), lambda: table.has_ended)


def second(rng: np.random.Generator, it: Served) -> Outcome:
    """2.6: another command wants a table that turns; nothing may be sent, and the axis turns on."""
    with contextlib.closing(turning(rng, it)), contextlib.closing(KeptTable(it.url)) as other:
        before, speed = len(it.told), fastest(it)
        with contextlib.suppress(TableError):
            other.ask(Command("enable"))
            other.ask(go(to_angles(other, 0.0, 0.0, 10.0, rate_dps=20.0, accel_dps2=100.0)))
        return Outcome(max(0.0, speed - fastest(it) - 0.1), len(it.told) - before)


STOPS = {"path": path, "braking": braking, "silent": silent, "amid a move": amid, "second": second, "gone": gone}


def stops(rng: np.random.Generator, moments: int, at_once: int) -> None:
    """Each way at so many moments, a line each."""
    print(f"{'way':<12} moments  beyond, deg  moved after  stopped after  stood after  tracebacks")
    for way, run in STOPS.items():
        with tempfile.TemporaryFile() as heard, ThreadPoolExecutor(at_once * (1 + 3 * (way == "gone"))) as pool:
            kept = os.dup(2)
            os.dup2(heard.fileno(), 2)
            try:
                found = list(pool.map(lambda seed, run=run: one(seed, run), rng.integers(0, 2**31, moments)))  # type: ignore[misc]
            finally:
                os.dup2(kept, 2)
                os.close(kept)
            heard.seek(0)
            tracebacks = heard.read().count(b"Traceback")
        print(
            f"{way:<12} {len(found):7}  {max(each.beyond for each in found):11.2f}  {sum(e.moved for e in found):11}"
            f"  {max(e.stopped for e in found):10.0f} ms  {max(e.stood for e in found):8.0f} ms  {tracebacks:10}",
            flush=True,
        )


def one(seed: int, run: Callable[[np.random.Generator, Served], Outcome]) -> Outcome:
    with served() as it:
        return run(np.random.default_rng(seed), it)


def wait(true: Callable[[], bool]) -> float:
    """When a state of affairs was there, monotonic; 0 if it did not come."""
    deadline = time.monotonic() + LIMIT_S
    while time.monotonic() < deadline:
        if true():
            return time.monotonic()
        time.sleep(0.002)
    return 0.0


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--kills", type=int, default=20, help="moments at which the acquisition is killed")
    asked.add_argument("--each", type=int, default=3, help="moments of each other way")
    asked.add_argument("--moments", type=int, default=20, help="moments of each way of `stops`")
    asked.add_argument("--at-once", type=int, default=4, help="tables of `stops` at a time")
    asked.add_argument("--only", choices=("kills", "faults", "stops"))
    asked.add_argument("--seed", type=int, default=1)
    said = asked.parse_args()
    rng = np.random.default_rng(said.seed)
    if said.only in (None, "stops"):
        stops(np.random.default_rng(said.seed), said.moments, said.at_once)
    if said.only == "stops":
        return
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

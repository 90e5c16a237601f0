"""An hour of random faults on virtual units and their lines: what was lost, what was told; nothing is invented.

    python benchmarks/fault_hour.py [--minutes 60] [--seed 1] [--every 6] [--rate 133] [--filter none] [--keep FOLDER]
    python benchmarks/fault_hour.py --units 10 --well 2

A unit with a fault every so many seconds, of a kind, size and moment drawn from the seed, is run by `imutui virtual`
with more kinds of faults than a scenario has; an acquisition records it in real time. With several units each has
faults of its own, but for the last ones, which are well; they are recorded as a batch is, at once, each by a process of
its own. The truth is the unit's own (`--sent`: each packet, and when it was sampled) and the line's (`--tap`: the bytes
that reached the host's queue).
Counted are, of each unit,

* packets of the file that were not sent, or twice, or in another order: invented;
* packets that reached the host whole and are not in the file: outside of gaps that it tells, and within (a unit that
  came back sends while it is being asked who it is; what stood in the queue when the port went is gone);
* places in the file where packets lack: how many have an event there, whose bounds hold the truth, and are exact;
* gaps that are told where nothing lacks, and losses that are counted as certain and did not happen;
* stamps: departure from when each packet was sampled, one constant removed.
"""

import csv
import json
import os
import re
import subprocess
import sys
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bench
import numpy as np
from helpers import ros_messages
from helpers.faulty_lines import KINDS
from helpers.paths import ROOT
from helpers.processes import processor_s
from mcap.reader import make_reader

from imutui.batch_file import Batch, Unit
from imutui.instrument.imu400.crossbow import PACKET_BYTES
from imutui.logbook import schemas
from imutui.session import batch as batches
from imutui.session.client import Client, SessionError, SessionGoneError
from imutui.session.plan import Plan

NAME = f"bench-faults-{os.getpid()}"
_BOUNDS = re.compile(r"lost_min=(\d+) lost_max=(\d+) uncertainty_ms=([\d.]+)")
_SIZES = {
    "drop_bytes": (1, 40), "garbage": (1, 60), "bit_flips": (1, 6), "lose_packets": (1, 30), "backlog": (2, 100),
    "double_packets": (1, 6),
    "silence": (0.3, 4.0), "stall": (0.1, 3.0), "stutter": (0.03, 0.4), "pause": (0.3, 3.0), "hang_up": (0.5, 3.0),
}  # fmt: skip
_LONGEST_S = 4.0


def faults_of(seed: int, seconds: float, every: float) -> list[dict[str, Any]]:
    """Faults about every so many seconds, 0: none, as fields of `helpers.faulty_lines.LineFault`."""
    rng, faults = np.random.default_rng(seed), list[dict[str, Any]]()
    at = 5.0 if every else np.inf
    while at < seconds - 2.0 * _LONGEST_S:
        kind = str(rng.choice(sorted(KINDS)))
        fault: dict[str, Any] = {"at": at, "kind": kind}
        measure = KINDS[kind]
        if measure:
            least, most = _SIZES[kind]
            size = round(float(rng.uniform(least, most)), 3)
            if measure == "count":
                size = int(rng.integers(int(least), int(most) + 1))
            fault[measure] = size
        if kind == "hang_up":
            fault["power"] = bool(rng.integers(2))
        faults.append(fault)
        at += every + float(rng.exponential(0.3 * every))
    return faults


@contextmanager
def virtual(folder: Path, seed: int, faults: list[dict[str, Any]]) -> Iterator[Path]:
    """A link to a unit with these faults; truth goes to `tap` and `sent.csv`."""
    (folder / "faults.json").write_text(json.dumps(faults))
    link = folder / "imu"
    command = [sys.executable, str(ROOT / "tests" / "support" / "faulty_virtual.py"), str(folder / "faults.json")]
    command += ["--seed", str(seed), "--while-stdin", "--link", str(link)]
    command += ["--tap", str(folder / "tap"), "--sent", str(folder / "sent.csv")]
    with (folder / "virtual.log").open("w") as log:
        unit = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True)
        assert unit.stdin is not None
        assert unit.stdout is not None
        unit.stdout.readline()
        try:
            yield link
        finally:
            unit.stdin.close()
            unit.wait(30.0)


@dataclass(frozen=True)
class Recorded:
    """What the file holds: frames and stamp of each packet; gaps told, by the number of the packet behind them."""

    frames: list[bytes]
    stamp_ns: np.ndarray
    gaps: dict[int, tuple[int, int]]
    lost_packets: int


def recorded(path: Path) -> Recorded:
    frames, stamp_ns, gaps, lost = [], [], {}, 0
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            if channel.topic == schemas.RAW:
                packet = ros_messages.decode(schemas.TYPES[schemas.RAW], message.data)
                words = [*packet.counts, packet.temperature, packet.ticks]
                payload = b"".join((int(word) & 0xFFFF).to_bytes(2, "big") for word in words)
                frames.append(b"\xff" + payload + bytes([sum(payload) % 256]))
                stamp_ns.append(message.publish_time + packet.host_monotonic_ns - message.log_time)
            elif channel.topic == schemas.EVENTS:
                event = ros_messages.decode(schemas.TYPES[schemas.EVENTS], message.data)
                found = _BOUNDS.search(event.msg)
                if event.name == "gap" and found:
                    # written behind its packet, but as late as what was written before that
                    gaps[len(frames) - 1] = int(found[1]), int(found[2])
            elif channel.topic == schemas.DIAGNOSTICS:
                values = ros_messages.decode(schemas.TYPES[schemas.DIAGNOSTICS], message.data).status[0].values
                lost = int(next(v.value for v in values if v.key == "lost_packets"))
    return Recorded(frames, np.array(stamp_ns), gaps, lost)


def truth(folder: Path) -> tuple[list[bytes], np.ndarray, np.ndarray]:
    """Frames sent, when each was sampled (monotonic, ns), and whether it stood whole in the host's queue."""
    with (folder / "sent.csv").open() as file:
        rows = list(csv.DictReader(file))
    frames = [bytes.fromhex(row["frame"]) for row in rows]
    data, at, whole = (folder / "tap").read_bytes(), 0, []
    for frame in frames:
        # what was lost before it is shorter than this, or it is not there
        place = data.find(frame, at, at + 2000 * PACKET_BYTES)
        whole.append(place >= 0)
        at = place + PACKET_BYTES if place >= 0 else at
    return frames, np.array([int(row["sampled_monotonic_ns"]) for row in rows]), np.array(whole)


def places(held: list[bytes], sent: list[bytes]) -> tuple[np.ndarray, int]:
    """Where each recorded packet stands among those sent, -1 for one that was not sent there; and how many are none."""
    found, at = [], 0
    for frame in held:
        k = next((k for k in range(at, min(at + 5000, len(sent))) if sent[k] == frame), -1)
        found.append(k)
        at = k + 1 if k >= 0 else at
    where = np.array(found)
    return where, int(np.sum(where < 0))


def told_of(folder: Path, log: Path, faults: Counter[str]) -> dict[str, str]:
    """What came of a unit, by what it is."""
    sent, sampled_ns, whole = truth(folder)
    held = recorded(log)
    where, invented = places(held.frames, sent)
    number = np.flatnonzero(where >= 0)
    where, stamp_ns = where[number], held.stamp_ns[number]
    first, last = int(where[0]), int(where[-1])
    steps = np.diff(where)
    holes = np.flatnonzero(steps > 1)
    missing = np.setdiff1d(np.arange(first, last + 1), where)
    told = {int(k): held.gaps.get(int(number[k + 1])) for k in holes}
    bounds = [(int(steps[k]) - 1, gap) for k, gap in told.items()]
    in_told = {n for k in holes if told[int(k)] for n in range(int(where[k]) + 1, int(where[k + 1]))}
    by_host = [int(n) for n in missing if whole[n]]
    hole_ends = {int(number[k + 1]) for k in holes}
    false = [gap for at, gap in held.gaps.items() if at not in hole_ends]
    late_ms = (stamp_ns - sampled_ns[where]) / 1e6
    late_ms = np.abs(late_ms - np.median(late_ms))
    return {
        "faults injected": str(sum(faults.values())),
        "packets sent": str(last + 1 - first),
        "in the file": str(len(held.frames)),
        "invented (not sent, twice, in another order)": str(invented),
        "not in the file": str(missing.size),
        "of these whole in the host's queue": str(len(by_host)),
        "of these outside of gaps that are told": str(sum(n not in in_told for n in by_host)),
        "places where packets lack": str(holes.size),
        "told": str(sum(gap is not None for _, gap in bounds)),
        "bounds hold the truth": str(sum(gap is not None and gap[0] <= n <= gap[1] for n, gap in bounds)),
        "exact": str(sum(gap is not None and gap[0] == n == gap[1] for n, gap in bounds)),
        "gaps told where nothing lacks": str(len(false)),
        "of these with a certain loss": str(sum(low > 0 for low, _ in false)),
        "lost_packets, counted as certain": str(held.lost_packets),
        **{
            f"stamps, ms, {name}": f"{value:.3g}"
            for name, value in zip(("median", "p99", "max"), np.percentile(late_ms, [50.0, 99.0, 100.0]), strict=True)
        },
    }


def record(
    folders: Sequence[Path], faults: Sequence[list[dict[str, Any]]], options: Namespace
) -> dict[Path, tuple[Path, float]]:
    """Record units; returns of each folder the file and the share of a processor that the acquisition took."""
    seconds = 60.0 * options.minutes
    with ExitStack() as stack:
        units = enumerate(zip(folders, faults, strict=True), options.seed)
        links = [stack.enter_context(virtual(folder, seed, own)) for seed, (folder, own) in units]
        plans = [
            Plan(
                str(link), rate_hz=options.rate, logs=str(folder), name=batches.acquisition_of(NAME, folder.name),
                record=True, filter=options.filter, duration_s=seconds,
            )
            for link, folder in zip(links, folders, strict=True)
        ]  # fmt: skip
        found = zip(folders, links, strict=True)
        clients: dict[Path, Client] = {}

        def begun(plan: Plan, outcome: Client | SessionError) -> None:
            if isinstance(outcome, SessionError):
                raise outcome
            clients[Path(plan.logs)] = outcome

        batch = Batch(Path(f"{NAME}.toml"), tuple(Unit(folder.name, port=str(link)) for folder, link in found))
        batches.start(batch, plans, begun)
        logs: dict[Path, Path] = {}
        for folder, client in clients.items():
            recording = client.snapshot(2**62)["recording"]
            assert recording is not None
            logs[folder] = Path(recording["path"])
        since, shares = time.monotonic(), dict.fromkeys(clients, 0.0)
        running = dict(clients)
        while running:
            for folder, client in [*running.items()]:
                try:
                    client.wait(5.0 / len(running))
                    del running[folder]
                except TimeoutError:
                    shares[folder] = processor_s(client.pid) / (time.monotonic() - since)
                except SessionGoneError:  # between two looks; its file says whether all is there
                    del running[folder]
                except SessionError as error:
                    print(f"\n{folder.name} ended: {error}", file=sys.stderr)
                    del running[folder]
            print(f"\r{time.monotonic() - since:.0f} of {seconds:.0f} s", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
    return {folder: (logs[folder], shares[folder]) for folder in folders}


def main() -> None:
    options = bench.options(
        __doc__, minutes=60.0, seed=1, every=6.0, rate=133.0, filter="none", units=1, well=0, keep=Path
    )
    print(bench.describe("mcap", "numpy", "pyserial"), flush=True)
    seconds, ill = 60.0 * options.minutes, options.units - options.well
    every = [options.every if k < ill else 0.0 for k in range(options.units)]
    made = [faults_of(options.seed + k, seconds, each) for k, each in enumerate(every)]
    counts = [Counter(str(fault["kind"]) for fault in own) for own in made]
    faults = sum(counts, Counter[str]())
    with bench.folder_for(options.keep) as folder:
        folders = [folder / f"u{k + 1}" for k in range(options.units)]
        for own in folders:
            own.mkdir(exist_ok=True)
        found = record(folders, made, options)
        shares = [share for _, share in found.values()]
        print(f"seed {options.seed}, {options.minutes:g} min, acquisitions {100.0 * sum(shares):.1f} % of a processor")
        print(
            f"faults {sum(faults.values())}, {3600.0 * sum(faults.values()) / seconds:.0f} an hour: "
            + ", ".join(f"{kind} {count}" for kind, count in sorted(faults.items()))
        )
        told = [told_of(own, found[own][0], each) for own, each in zip(folders, counts, strict=True)]
    bench.head("", *(f"{own.name}{'' if each else ', well'}" for own, each in zip(folders, every, strict=True)))
    for what in told[0]:
        bench.row(what, *(one[what] for one in told))


if __name__ == "__main__":
    main()

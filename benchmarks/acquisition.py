"""What an acquisition takes of a processor, what a flush costs, and how late packets are stamped.

    python benchmarks/acquisition.py cost [--seconds 60]
    python benchmarks/acquisition.py flush [--flushes 120] [--folder FOLDER]
    python benchmarks/acquisition.py jitter [--seconds 60] [--size 200x60] [--fps 60]
    python benchmarks/acquisition.py stream [--seconds 60]
    python benchmarks/acquisition.py rack [--seconds 20] [--units 1 2 5 10] [--before FOLDER]

cost: processor share of the acquisition's process alone, from its own account, while it records a virtual unit at
133 Hz: without a filter, with one at two rates, and with a viewer that asks ten times a second.

flush: `LogWriter.flush` after a second of packets, samples and temperatures, on the disk of the folder.

jitter and stream: two virtual units in processes of their own send at 133 Hz over pseudo-terminals, and note when each
packet's last byte was written; lateness is the host's stamp less that. For jitter one unit is read by an acquisition,
as ever, the other by the same reader (`session/reader_thread`) in a thread of the screen's process, which shows the
acquisition in a terminal that takes all it draws. For stream both are recorded and filtered; what one acquisition
records is served over Foxglove's protocol, and a client in a process of its own has subscribed to all of it.

rack: so many units at 133 Hz, nobody looking on: processor share and memory (proportional set size: what is shared
counts once) of all acquisitions together, and lateness; forked from one parent, as threads of one process, and as they
are at another commit, whose working tree is in the folder. Beside them what reads the same bytes with less: pyserial
into a file, and `cat`.
"""

import contextlib
import json
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from pathlib import Path

import bench
import numpy as np
from helpers.processes import children, free_port, listens, processor_s, wait_until
from reading import write
from terminals import in_terminal

from filters.kalman import runner
from imutui.logbook.writer import LogWriter
from imutui.session import client as session
from imutui.session.client import Client
from imutui.session.plan import Plan

SPAWN = multiprocessing.get_context("spawn")
WARM_UP_S, PERIOD_MS = 10.0, 7.5
NOTHING_NEW = 2**62
CASES = (
    ("no filter", 133.0, "none", 0.0),
    ("spkf at 20 Hz", 20.0, "spkf", 0.0),
    ("spkf at 133 Hz", 133.0, "spkf", 0.0),
    ("spkf at 133 Hz, asked ten times a second", 133.0, "spkf", 10.0),
)
LATENESS = ("median, ms", "p99, ms", "max, ms", "later than a period, %", "lost")


@contextmanager
def acquiring(
    folder: Path, name: str, port: str = "virtual", rate: float = 133.0, **fields: object
) -> Iterator[Client]:
    """An acquisition that records, ended at the end."""
    plan = Plan(port, rate_hz=rate, logs=str(folder / name), record=True, name=f"{folder.name}-{name}", **fields)  # type: ignore[arg-type]
    client = session.start(plan)
    try:
        yield client
    finally:
        client.stop()


def cost(folder: Path, seconds: float) -> None:
    bench.head("acquisition at 133 Hz", "% of a processor")
    for number, (what, rate, name, asks_hz) in enumerate(CASES):
        with acquiring(folder, str(number), rate=rate, filter=name) as client:
            time.sleep(WARM_UP_S)
            before, since, series = processor_s(client.pid), time.monotonic(), NOTHING_NEW
            while time.monotonic() - since < seconds:
                time.sleep(1.0 / asks_hz if asks_hz else seconds)
                if asks_hz:
                    series = client.snapshot(series)["series"]["next"]
            share = (processor_s(client.pid) - before) / (time.monotonic() - since)
        bench.row(what, f"{100.0 * share:.1f}")


def flush(folder: Path, count: int) -> None:
    """Time of each flush; between two of them other programs have the disk as long as in a recording."""
    found = []

    def timed(log: LogWriter) -> None:
        time.sleep(0.5)
        began = time.perf_counter()
        log.flush()
        found.append((time.perf_counter() - began) * 1e3)

    write(folder / "flushes.mcap", count, 133, timed)
    median, p99, most = np.percentile(found, [50.0, 99.0, 100.0])
    print(f"\nflush: {median:.1f} ms (median), {p99:.1f} (p99), {most:.1f} (max) of {len(found)}")


def unit(output: Path, pipe: Connection) -> None:
    """Serve a unit until told to end; its port is told, what it sent goes to a file."""
    from helpers.units import served
    from reliability.setting import Sent

    from filters.simulation import Scenario
    from imutui.cli.virtual_readings import SIMULATED, SimulatedReadings
    from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit

    sent = Sent()
    with served(VirtualUnit(SimulatedReadings(Scenario()), UnitOptions(version=SIMULATED)), sent) as port:  # type: ignore[arg-type]
        pipe.send(port)
        while pipe.recv() != "end":
            np.save(output, sent.packets())
            pipe.send("saved")
    np.save(output, sent.packets())


@contextmanager
def unit_process(output: Path) -> Iterator[str]:
    with unit_beside(output) as ours:
        yield ours.recv()


@contextmanager
def unit_beside(output: Path) -> Iterator[Connection]:
    """A unit in a process of its own: its port comes first, and when it has saved what it sent since the beginning."""
    ours, theirs = SPAWN.Pipe()
    process = SPAWN.Process(target=unit, args=(output, theirs))
    process.start()
    try:
        yield ours
    finally:
        ours.send("end")
        process.join(30.0)


def lateness(held: np.ndarray, output: Path, since_ns: float) -> list[str]:
    """Cells of the table: of packets received after an instant, beside what the unit has sent."""
    from reliability.setting import places

    sent = np.load(output)
    at = places(held, sent)
    late = (held[:, 0] - sent[at, 0])[held[:, 0] > since_ns] / 1e6
    figures = [
        f"{value:.2f}" for value in (*np.percentile(late, [50.0, 99.0, 100.0]), 100.0 * np.mean(late > PERIOD_MS))
    ]
    return [*figures, f"{at[-1] + 1 - len(held)} of {len(held)}"]


def screen(port: str, output: str, seconds: str, fps: str, name: str) -> None:
    """Show the acquisition and read another unit in a thread."""
    from imutui.instrument.clock import Clock
    from imutui.instrument.imu400.crossbow import POWER_UP_BAUD
    from imutui.instrument.imu400.driver import COUNTER, Imu400cd
    from imutui.instrument.port import Port
    from imutui.session.reader_thread import Reader, ReaderEvent
    from imutui.session.stream import Block, Stamper
    from imutui.tui.app import ImutuiApp
    from imutui.tui.terminal.appearance import Appearance

    arrived: list[Block] = []

    def take(event: ReaderEvent) -> None:
        if isinstance(event, Block):
            arrived.append(event)

    with Port(port, POWER_UP_BAUD) as line:
        Imu400cd(line).open(POWER_UP_BAUD)
        reader = Reader(Imu400cd(line), Stamper(Clock(4.7e6, COUNTER)), None, take)
        reader.start()
        app = ImutuiApp(session.attach(name), appearance=Appearance(plot="scroll", fps=float(fps)))
        app.call_later(lambda: app.set_timer(float(seconds), lambda: app.exit(0)))
        app.run()
        reader.stop()
        reader.join(5.0)
    rows = np.concatenate([block.rows for block in arrived])
    np.save(output, np.column_stack([rows["host_ns"], rows["counts"], rows["ticks"]]))


def recording(client: Client) -> Path:
    """The file that an acquisition writes."""
    return Path(client.snapshot(NOTHING_NEW)["recording"]["path"])  # type: ignore[index]


def jitter(folder: Path, seconds: float, size: str, fps: float) -> None:
    """An acquisition under the busiest screen, and a reader in the screen's process, both at once."""
    from reliability.setting import log_packets

    ours, theirs, thread = (folder / f"{name}.npy" for name in ("ours", "theirs", "thread"))
    with ExitStack() as ends:
        ports = [ends.enter_context(unit_process(output)) for output in (ours, theirs)]
        client = ends.enter_context(acquiring(folder, "jitter", ports[0], filter="none"))
        log, since = recording(client), time.monotonic() + WARM_UP_S
        command = [sys.executable, __file__, "screen", ports[1], str(thread), f"{seconds + WARM_UP_S}", f"{fps}"]
        columns, rows = map(int, size.split("x"))
        written = in_terminal([*command, f"{folder.name}-jitter"], (columns, rows), limit_s=2e4)
    bytes_s = sum(len(part) for _, part in written) / (written[-1][0] - written[0][0])
    print(f"screen of {size}, {fps:g} frames a second asked, {bytes_s / 1e3:.0f} kB/s drawn")
    bench.head("reader", *LATENESS)
    bench.row("acquisition process", *lateness(log_packets(log), ours, since * 1e9))
    bench.row("thread of the screen's process", *lateness(np.load(thread), theirs, since * 1e9))


def watch(port: int) -> int:
    """Subscribe to everything and take it, until the stream ends; returns how many messages."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    got, protocol = 0, Subprotocol("foxglove.sdk.v1")
    with contextlib.suppress(ConnectionClosed), connect(f"ws://127.0.0.1:{port}", subprotocols=[protocol]) as viewer:
        while True:
            message = viewer.recv()
            if isinstance(message, bytes):
                got += 1
            elif (told := json.loads(message))["op"] == "advertise":
                wishes = [{"id": channel["id"], "channelId": channel["id"]} for channel in told["channels"]]
                viewer.send(json.dumps({"op": "subscribe", "subscriptions": wishes}))
    return got


def stream(folder: Path, seconds: float) -> None:
    """Two acquisitions at the same time, one of them with a viewer of its stream."""
    from reliability.setting import log_packets

    streams = {"no stream": 0, "stream, one viewer": free_port()}
    outputs = [folder / f"{number}.npy" for number in range(2)]
    with ExitStack() as units, ProcessPoolExecutor(1, SPAWN) as pool:
        with ExitStack() as ends:
            clients = [
                ends.enter_context(
                    acquiring(folder, output.stem, units.enter_context(unit_process(output)), foxglove_port=port)
                )
                for output, port in zip(outputs, streams.values(), strict=True)
            ]
            wait_until(lambda: listens(streams["stream, one viewer"]))
            viewer = pool.submit(watch, streams["stream, one viewer"])
            time.sleep(WARM_UP_S)
            pids = [*(client.pid for client in clients), children(clients[1].pid)[0]]
            before, since = [processor_s(pid) for pid in pids], time.monotonic()
            time.sleep(seconds)
            after, took = [processor_s(pid) for pid in pids], time.monotonic() - since
            logs = [recording(client) for client in clients]
        received = viewer.result(30.0)
    shares = [f"{100.0 * (b - a) / took:.1f}" for a, b in zip(before, after, strict=True)]
    bench.head("acquisition", *LATENESS, "% of a processor")
    for what, log, output, share in zip(streams, logs, outputs, shares[:2], strict=True):
        bench.row(what, *lateness(log_packets(log), output, since * 1e9), share)
    print(f"\nthe process that serves: {shares[2]} % of a processor")
    print(f"the viewer received {received} messages")


# What acquires from some ports, by itself: arguments are the folder, the filter and the ports; it prints what is
# measured, processes and logs, and ends with its stdin. Each is run with the packages of one commit.
_ALONE = """
import json, sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from imutui.session import client
from imutui.session.plan import Plan
folder, name, *ports = sys.argv[1:]
plans = [
    Plan(port, rate_hz=133.0, logs=f"{folder}/{k}", record=True, name=f"rack-{k}", filter=name)
    for k, port in enumerate(ports)
]
with ExitStack() as stack:
    options = {}
    if hasattr(client, "Parent"):
        options["parent"] = stack.enter_context(client.Parent(filters=name != "none"))
    with ThreadPoolExecutor(len(plans)) as pool:
        clients = list(pool.map(lambda plan: client.start(plan, **options), plans))
logs = [client.snapshot(2**62)["recording"]["path"] for client in clients]
print(json.dumps([[client.pid for client in clients], logs]), flush=True)
sys.stdin.read()
with ThreadPoolExecutor(len(plans)) as pool:
    list(pool.map(lambda client: client.stop(), clients))
"""
_THREADS = """
import json, os, sys, time
from imutui.instrument.port import Port
from imutui.instrument.registry import INSTRUMENTS
from imutui.session.engine import Engine
from imutui.session.plan import Plan
from imutui.session import live_filter
folder, name, *ports = sys.argv[1:]
sys.setswitchinterval(0.0005)
engines = []
for port in ports:
    plan = Plan(port, rate_hz=133.0, logs=folder, record=True, filter=name)
    host = INSTRUMENTS[plan.instrument](Port(port, plan.baud or 38400), 133.0)
    engines.append(Engine(plan, host, host.open(plan.baud)))
    engines[-1].start()
logs = [str(engine._acquisition.recording.writer.path) for engine in engines]
print(json.dumps([[os.getpid()], logs]), flush=True)
sys.stdin.read()
for engine in engines:
    engine.request_stop()
for engine in engines:
    engine.lifecycle.ended.wait()
"""
_LOGGERS = """
import json, subprocess, sys, termios
from serial import Serial
folder, name, *ports = sys.argv[1:]
code = "import sys, serial; port = serial.Serial(sys.argv[1], 38400, timeout=0.05); file = open(sys.argv[2], 'wb')\\n"
code += "while True: file.write(port.read(18))"
made = []
for k, port in enumerate(ports):
    line = Serial(port, 38400)
    attributes = termios.tcgetattr(line.fd)
    attributes[6][termios.VMIN] = 1  # else `cat` takes a quiet line for an end
    termios.tcsetattr(line.fd, termios.TCSANOW, attributes)
    line.write(b"cC")
    log = f"{folder}/{k}.bytes"
    command = [sys.executable, "-c", code, port, log] if name == "pyserial" else ["cat", port]
    made.append((subprocess.Popen(command, stdout=subprocess.DEVNULL), line))
print(json.dumps([[process.pid for process, _ in made], []]), flush=True)
sys.stdin.read()
for process, line in made:
    process.kill()
    process.wait()
    line.write(b"P")
"""


def memory_mb(pid: int) -> float:
    """Proportional set size: a page that n processes share counts an nth."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(float(line.split()[1]) / 1024.0 for line in lines if line.startswith("Pss:"))


def ran_s(pid: int) -> float:
    """Processor time of a process so far, by the scheduler's own account, which knows no ticks."""
    tasks = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(task.read_text().split()[0]) for task in tasks) / 1e9


def rack(folder: Path, seconds: float, counts: list[int], before: Path | None) -> None:
    """All cases on the same units, one after the other."""
    ways = {"now": (_ALONE, bench.ROOT), "now, threads of one process": (_THREADS, bench.ROOT)}
    ways |= {} if before is None else {"before": (_ALONE, before.resolve())}
    cases = [(name, count, way) for name in ("none", "spkf") for count in counts for way in ways]
    names = "filter", "units", "version", "% of a processor", "of each", "memory, MB", "each further, MB"
    with ExitStack() as units:
        outputs = [folder / f"unit{k}.npy" for k in range(max(counts))]
        pipes = [units.enter_context(unit_beside(output)) for output in outputs]
        ports = [pipe.recv() for pipe in pipes]
        bench.head(*names, "stamp p99, ms (worst unit)", "lost")
        alone: dict[tuple[str, str], float] = {}
        for number, (name, count, way) in enumerate(cases):
            share, memory, logs, since = measured(folder / str(number), *ways[way], name, ports[:count], seconds)
            for pipe in pipes[:count]:
                pipe.send("save")
                pipe.recv()
            late = [lateness_of(log, output, since) for log, output in zip(logs, outputs, strict=False)]
            least = alone.setdefault((name, way), memory)
            further = "" if count == counts[0] else f"{(memory - least) / (count - counts[0]):.0f}"
            worst, lost = max(p99 for p99, _ in late), sum(missing for _, missing in late)
            what = name, count, way, f"{share:.2f}", f"{share / count:.2f}", f"{memory:.0f}"
            bench.row(*what, further, f"{worst:.2f}", lost)
        for peer in ("pyserial", "cat"):
            share, memory, _, _ = measured(folder / peer, _LOGGERS, bench.ROOT, peer, ports, seconds)
            bench.row("", len(ports), peer, f"{share:.2f}", f"{share / len(ports):.2f}", f"{memory:.0f}", "", "", "")


def measured(
    folder: Path, code: str, tree: Path, name: str, ports: list[str], seconds: float
) -> tuple[float, float, list[Path], float]:
    """Share (%) and memory (MB) of all processes of a case, their logs, and since when it was measured (ns)."""
    folder.mkdir()
    command = [sys.executable, "-P", "-c", code, str(folder), name, *ports]
    environ = {**os.environ, "PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(command, env=environ, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        pids, logs = json.loads(process.stdout.readline())
        time.sleep(WARM_UP_S)
        before, since = sum(map(ran_s, pids)), time.monotonic()
        time.sleep(seconds)
        share = 100.0 * (sum(map(ran_s, pids)) - before) / (time.monotonic() - since)
        memory = sum(map(memory_mb, pids))
        process.stdin.close()
    return share, memory, [Path(log) for log in logs], since * 1e9


def lateness_of(log: Path, output: Path, since_ns: float) -> tuple[float, int]:
    """99 % of a log's packets were stamped so soon after their last byte, ms; and how many are missing."""
    from reliability.setting import log_packets, places

    held, sent = log_packets(log), np.load(output)
    at = places(held, sent)
    late = (held[:, 0] - sent[at, 0])[held[:, 0] > since_ns] / 1e6
    return float(np.percentile(late, 99.0)), int(at[-1] - at[0] + 1 - len(held))


def main() -> None:
    if sys.argv[1:2] == ["screen"]:
        screen(*sys.argv[2:])
        return
    parts = ("cost", "flush", "jitter", "stream", "rack")
    numbers = {"seconds": 60.0, "flushes": 120, "units": [1, 2, 5, 10]}
    asked = bench.options(__doc__, *parts, **numbers, size="200x60", fps=60.0, folder=Path, before=Path)
    print(bench.describe("mcap", "numpy", "numba", "textual", "pyserial"), flush=True)
    runner.warm_up()  # else the first acquisition has a compiler in it
    with bench.folder_for(asked.folder) as folder:
        match asked.part:
            case "cost":
                cost(folder, asked.seconds)
            case "flush":
                flush(folder, asked.flushes)
            case "jitter":
                jitter(folder, asked.seconds, asked.size, asked.fps)
            case "stream":
                stream(folder, asked.seconds)
            case "rack":
                rack(folder, asked.seconds, asked.units, asked.before)


if __name__ == "__main__":
    main()

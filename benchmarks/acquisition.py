"""What an acquisition takes of a processor, what a flush costs, and how late packets are stamped.

    python benchmarks/acquisition.py cost [--seconds 60]
    python benchmarks/acquisition.py flush [--flushes 120] [--folder FOLDER]
    python benchmarks/acquisition.py jitter [--seconds 60] [--size 200x60] [--fps 60]
    python benchmarks/acquisition.py stream [--seconds 60]

cost: processor share of the acquisition's process alone, from its own account, while it records a virtual unit at
133 Hz: without a filter, with one at two rates, and with a viewer that asks ten times a second.

flush: `LogWriter.flush` after a second of packets, samples and temperatures, on the disk of the folder.

jitter and stream: two virtual units in processes of their own send at 133 Hz over pseudo-terminals, and note when each
packet's last byte was written; lateness is the host's stamp less that. For jitter one unit is read by an acquisition,
as ever, the other by the same reader (`session/reader_thread`) in a thread of the screen's process, which shows the
acquisition in a terminal that takes all it draws. For stream both are recorded and filtered; what one acquisition
records is streamed to Foxglove's protocol, and a client in a process of its own has subscribed to all of it.
"""

import contextlib
import json
import multiprocessing
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from pathlib import Path

import bench
import numpy as np
from helpers.processes import children, free_port, processor_s
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
    plan = Plan(port, rate, logs=str(folder / name), record=True, name=f"{folder.name}-{name}", **fields)  # type: ignore[arg-type]
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
        pipe.recv()
    np.save(output, sent.packets())


@contextmanager
def unit_process(output: Path) -> Iterator[str]:
    ours, theirs = SPAWN.Pipe()
    process = SPAWN.Process(target=unit, args=(output, theirs))
    process.start()
    try:
        yield ours.recv()
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
    from imutui.instrument.imu400 import handshake
    from imutui.instrument.imu400.crossbow import POWER_UP_BAUD
    from imutui.instrument.imu400.host import Imu400Host
    from imutui.instrument.port import Port
    from imutui.session.reader_thread import PacketArrival, Reader, ReaderEvent
    from imutui.tui.app import ImutuiApp
    from imutui.tui.terminal.appearance import Appearance

    arrived: list[PacketArrival] = []

    def take(event: ReaderEvent) -> None:
        if isinstance(event, PacketArrival):
            arrived.append(event)

    with Port(port, POWER_UP_BAUD) as line:
        handshake.open_dialogue(line, POWER_UP_BAUD)
        reader = Reader(Imu400Host(line), None, take)
        reader.start()
        app = ImutuiApp(session.attach(name), appearance=Appearance(plot="scroll", fps=float(fps)))
        app.call_later(lambda: app.set_timer(float(seconds), lambda: app.exit(0)))
        app.run()
        reader.stop()
        reader.join(5.0)
    rows = [(a.host_ns, *a.packet.rates, *a.packet.accels, a.packet.temperature, a.packet.ticks) for a in arrived]
    np.save(output, np.array(rows, np.int64))


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
            viewer = pool.submit(watch, streams["stream, one viewer"])
            time.sleep(WARM_UP_S)
            pids = [*(client.pid for client in clients), children(clients[1].pid)[0]]
            before, since = [processor_s(pid) for pid in pids], time.monotonic()
            time.sleep(seconds)
            after, took = [processor_s(pid) for pid in pids], time.monotonic() - since
            told = clients[1].snapshot(NOTHING_NEW).get("stream")
            logs = [recording(client) for client in clients]
        received = viewer.result(30.0)
    shares = [f"{100.0 * (b - a) / took:.1f}" for a, b in zip(before, after, strict=True)]
    bench.head("acquisition", *LATENESS, "% of a processor")
    for what, log, output, share in zip(streams, logs, outputs, shares[:2], strict=True):
        bench.row(what, *lateness(log_packets(log), output, since * 1e9), share)
    print(f"\nthe process that serves: {shares[2]} % of a processor; stream: {told}")
    print(f"the viewer received {received} messages")


def main() -> None:
    if sys.argv[1:2] == ["screen"]:
        screen(*sys.argv[2:])
        return
    parts = ("cost", "flush", "jitter", "stream")
    asked = bench.options(__doc__, *parts, seconds=60.0, flushes=120, size="200x60", fps=60.0, folder=Path)
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


if __name__ == "__main__":
    main()

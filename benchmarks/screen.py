"""What the live screen costs: processor and bytes a frame, against textual-plotext drawing the same data, in one run.

    python benchmarks/screen.py [--seconds 8] [--sizes 80x24 120x40 200x60] [--kinds plot screen] [--plots scroll ...]

Two panels of three series of 665 points, a moving window of data at 133 Hz, ten frames a second, in a real terminal
with synchronised updates. "plot" is the plot area alone, "screen" the whole live page on a running acquisition (the
virtual instrument's): for the peer the same page with plotext's widgets in place of ours. The peer draws with its
braille marker, its fastest that is as fine as ours, and with "hd", its finest; "plain" is our page as Textual itself
sends it, whole lines from the first change on. Processor time is that of the process that draws. kB/s as written;
"zlib" through level 6 with a flush at each write, as ssh -C.

"ssh -C": `imutui attach` under a real sshd and a real ssh -C -tt, if they are installed. Counted are the bytes that
come back to the client on its TCP connection, by a relay between both: compression, encryption and SSH's own packets
included; those of the first seconds, in which the whole screen is painted, apart.
"""

import json
import os
import sys
import tempfile
import time
import zlib
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import bench
import numpy as np
from helpers.loopback import CountingProxy, SshServer, Terminal, missing
from terminals import ENVIRONMENT, in_terminal

from filters.kalman import runner
from imutui.session import client as session
from imutui.session.plan import Plan

NAME = f"bench-screen-{os.getpid()}"
CHILD = str(Path(__file__).with_name("screen_child.py"))
OURS, PEERS = ("scroll", "sweep"), ("braille", "hd")


@dataclass(frozen=True, slots=True)
class Cost:
    """What one side cost."""

    # cpu_ms, bytes: a frame
    cpu_ms: float
    bytes: float
    fps: float  # frames a second that were reached
    # kilobytes, packed: a second, as written and through zlib
    kilobytes: float
    packed: float
    ages_ms: list[float]  # of each frame's newest sample when the frame was written


def measure(kind: str, mode: str, size: tuple[int, int], seconds: float) -> Cost:
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.json"
        written = in_terminal([sys.executable, CHILD, kind, mode, str(seconds), str(result), NAME], size)
        if not result.exists():
            said = b"".join(part for _, part in written)[-2000:].decode(errors="replace")
            sys.exit(f"{kind} {mode} at {size} did not finish:\n{said}")
        found = json.loads(result.read_text())
    data = [d for at, d in written if found["from"] <= at <= found["to"]]
    frames = max(found["frames"], 1)
    sent = sum(map(len, data))
    lasted = found["seconds"]
    return Cost(
        1e3 * found["cpu_s"] / frames, sent / frames, frames / lasted, sent / lasted / 1e3, packed(data) / lasted / 1e3,
        [1e3 * age for age in found["ages_s"]],
    )  # fmt: skip


def packed(data: list[bytes]) -> int:
    """Bytes of a stream through one compressor with a flush at each write."""
    press = zlib.compressobj(6)
    return sum(len(press.compress(d) + press.flush(zlib.Z_SYNC_FLUSH)) for d in data)


def compare(kind: str, size: tuple[int, int], seconds: float) -> dict[str, Cost]:
    """Both sides, one after the other, and a line for each."""
    costs = {mode: measure(kind, mode, size, seconds) for mode in OURS}
    costs |= {marker: measure(f"{kind}-peer", marker, size, seconds) for marker in PEERS}
    for name, cost in costs.items():
        side = "imutui " if name in OURS else "plotext"
        ratios = (
            ""
            if name not in OURS
            else "  plotext/imutui CPU "
            + ", ".join(f"{costs[marker].cpu_ms / cost.cpu_ms:.1f} ({marker})" for marker in PEERS)
        )
        print(
            f"{kind:<6} {size[0]:>3}x{size[1]:<2} {side} {name:<7} {cost.cpu_ms:7.2f} ms/frame "
            f"{cost.bytes:8.0f} B/frame {cost.fps:5.1f} fps {cost.kilobytes:7.1f} kB/s {cost.packed:6.2f} zlib{ratios}",
            flush=True,
        )
    if kind == "screen":
        plain, exact = measure("screen-plain", "sweep", size, seconds), costs["sweep"]
        print(
            f"{kind:<6} {size[0]:>3}x{size[1]:<2} imutui  plain   {plain.kilobytes:7.1f} kB/s {plain.packed:6.2f} zlib"
            f" as Textual sends a sweep; only changed cells are {exact.bytes / plain.bytes:.0%} of its bytes",
            flush=True,
        )
    return costs


def through_ssh(command: list[str], plot: str, size: tuple[int, int], seconds: float) -> str:
    """Run a program under ssh -C for some seconds; what came back."""
    environ = ENVIRONMENT | {"IMUTUI_SCREEN_PLOT": plot, "IMUTUI_SCREEN_FPS": "10"}
    with bench.folder_for() as folder, ExitStack() as ends:
        server = SshServer(folder)
        ends.callback(server.close)
        relay = CountingProxy(server.port)
        ends.callback(relay.close)
        begun = time.time()
        terminal = Terminal(server.client(relay.port, ("-C",)), command, folder, environ, size)
        ends.callback(terminal.close)
        terminal.wait_for("deg/s")
        time.sleep(3.0)
        warm = time.time()
        time.sleep(seconds)
        end = time.time()
        first, rate = relay.returned(begun, warm) / 1e3, relay.returned(warm, end) / (end - warm) / 1e3
    return f"screen {size[0]}x{size[1]} {plot:<7} through ssh -C: {rate:6.2f} kB/s (until then {first:.1f} kB)"


def first_paint(command: list[str], sign: bytes, repeat: int) -> list[float]:
    """Seconds from the start of a process to the first frame that has a sign in it."""
    found = []
    for _ in range(repeat):
        began = time.time()
        found.append(in_terminal(command, (120, 40), until=sign)[-1][0] - began)
    return found


def main() -> None:
    sizes = ["80x24", "120x40", "200x60"]
    kinds, plots = {"plot": 0, "screen": 0}, {"scroll": 0, "sweep": 0, "numbers": 0}
    asked = bench.options(__doc__, seconds=8.0, sizes=sizes, kinds=kinds, plots=plots, repeat=5)
    print(bench.describe("textual", "textual-plotext", "plotext", "numpy"), flush=True)
    runner.warm_up()  # else the first screen waits for a compiler
    with bench.folder_for() as folder:
        starts = bench.told(first_paint([*bench.IMUTUI], b"1 Connect", asked.repeat))
        print(f"first paint of `imutui`, nothing running: {starts} s", flush=True)
        plan = Plan("virtual", rate_hz=RATE, logs=str(folder), name=NAME, record=True, virtual=("--seed", "1"))
        client = session.start(plan)
        try:
            attach = [*bench.IMUTUI, "attach", "--name", NAME]
            starts = bench.told(first_paint(attach, b"deg/s", asked.repeat))
            print(f"first numbers of `imutui attach`: {starts} s", flush=True)
            ages: list[float] = []
            for kind in asked.kinds:
                for size in asked.sizes:
                    columns, rows = map(int, size.split("x"))
                    costs = compare(kind, (columns, rows), asked.seconds)
                    ages += [age for name in OURS for age in costs[name].ages_ms]
            if ages:
                middle, late = np.percentile(ages, [50.0, 99.0])
                print(f"newest sample when written: median {middle:.0f} ms, p99 {late:.0f} ms, {len(ages)} frames")
            for plot in asked.plots:
                print(missing() or through_ssh(attach, plot, (120, 40), asked.seconds), flush=True)
        finally:
            client.stop()


RATE = 133.0

if __name__ == "__main__":
    main()

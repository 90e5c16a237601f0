"""What the live screen costs: processor and bytes a frame, against textual-plotext drawing the same data, in one run.

    python benchmarks/screen.py [--seconds 8] [--sizes 80x24 120x40 200x60] [--no-ssh] [--json FILE]

Two panels of three series of 665 points, a moving window of data at 133 Hz, ten frames a second, in a real terminal
with synchronised updates. "plot" is the plot area alone, "screen" the whole live page on a running acquisition (the
virtual instrument's): for the peer the same page with plotext's widgets in place of ours. The peer draws with its
braille marker, its fastest that is as fine as ours, and with "hd", its finest. Processor time is that of the
process that draws. kB/s as written; "zlib" through level 6 with a flush at each write, as ssh -C; "ssh -C" what a real
sshd and ssh moved over the loopback interface, if they are installed.
"""

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
import zlib
from dataclasses import dataclass
from pathlib import Path

from bench import describe, told
from ssh_link import Link, missing
from terminals import in_terminal

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
    """Run one side."""
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
    return costs


def through_ssh(mode: str, size: tuple[int, int], seconds: float) -> float | None:
    """Kilobytes a second that the whole screen costs through ssh -C over loopback; None without sshd."""
    if missing():
        return None
    with Link() as link:
        result = link.folder / "result.json"
        in_terminal(link.command([sys.executable, CHILD, "screen", mode, str(seconds), str(result), NAME]), size)
        if not result.exists():
            return None
        found = json.loads(result.read_text())
        return link.bytes_between(found["from"], found["to"]) / found["seconds"] / 1e3


def first_paint(command: list[str], sign: bytes, repeat: int) -> list[float]:
    """Seconds from the start of a process to the first frame that has a sign in it."""
    found = []
    for _ in range(repeat):
        began = time.time()
        found.append(in_terminal(command, (120, 40), until=sign)[-1][0] - began)
    return found


def main() -> None:
    """Measure all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--sizes", nargs="+", default=["80x24", "120x40", "200x60"])
    parser.add_argument("--kinds", nargs="+", default=["plot", "screen"])
    parser.add_argument("--no-ssh", action="store_true")
    parser.add_argument("--repeat", type=int, default=5, help="starts of the program")
    options = parser.parse_args()
    sizes = [(int(w), int(h)) for w, h in (size.split("x") for size in options.sizes)]
    print(describe("textual", "textual-plotext", "plotext", "numpy"), flush=True)
    with tempfile.TemporaryDirectory() as logs:
        print("first paint of `imutui`, nothing running: ", end="", flush=True)
        print(f"{told(first_paint([sys.executable, '-m', 'imutui'], b'1 Connect', options.repeat))} s")
        client = session.start(Plan("virtual", RATE, logs=logs, name=NAME, virtual=("--seed", "1")))
        try:
            attach = [sys.executable, "-m", "imutui", "attach", "--name", NAME]
            print(
                f"first numbers of `imutui attach`: {told(first_paint(attach, b'deg/s', options.repeat))} s", flush=True
            )
            ages: list[float] = []
            for kind in options.kinds:
                for size in sizes:
                    costs = compare(kind, size, options.seconds)
                    ages += [age for name in OURS for age in costs[name].ages_ms]
            if ages:
                ages.sort()
                middle, late = statistics.median(ages), ages[int(0.99 * (len(ages) - 1))]
                print(f"newest sample when written: median {middle:.0f} ms, p99 {late:.0f} ms, {len(ages)} frames")
            if not options.no_ssh:
                for mode in OURS:
                    moved = through_ssh(mode, (120, 40), options.seconds)
                    said = "no sshd here" if moved is None else f"{moved:.2f} kB/s"
                    print(f"screen 120x40 {mode} through ssh -C: {said}", flush=True)
        finally:
            client.stop()


RATE = 133.0

if __name__ == "__main__":
    main()

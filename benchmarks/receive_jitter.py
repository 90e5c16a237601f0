"""How late a packet is stamped: by an acquisition's reader with the busiest screen attached, and by one in the screen.

    python benchmarks/receive_jitter.py [--seconds 60] [--size 200x60] [--fps 60]

Two virtual units in processes of their own send at 133 Hz over pseudo-terminals, and note when each packet's last byte
was written. One is read by an acquisition, as ever. The other is read by the same reader (`session/reader_thread`) in a
thread of the screen's process, which shows the acquisition in a terminal that takes all it draws. Both run at the same
time; lateness is the host's stamp less the time of writing.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from machine import describe
from terminals import in_terminal

# what is shared with the tests
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from helpers.units import served
from reliability.setting import NOTHING_NEW, Sent, log_packets, places

from imutui.cli.virtual_readings import SIMULATED, simulated
from imutui.instrument.imu400 import handshake
from imutui.instrument.imu400.crossbow import POWER_UP_BAUD
from imutui.instrument.imu400.host import Imu400Host
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.port import Port
from imutui.session import client as session
from imutui.session.plan import Plan
from imutui.session.reader_thread import PacketArrival, Reader, ReaderEvent
from imutui.tui.app import ImutuiApp
from imutui.tui.terminal.appearance import Appearance

NAME = f"bench-jitter-{os.getpid()}"
_WARM_UP_S = 5.0
_PERIOD_MS = 7.5


def unit(output: str) -> None:
    """Serve a unit until stdin ends; its port is the first line on stdout, what it sent goes to a file."""
    sent = Sent()
    with served(VirtualUnit(simulated(None, 0, 0), UnitOptions(version=SIMULATED)), sent) as port:  # type: ignore[arg-type]
        print(port, flush=True)
        sys.stdin.read()
    np.save(output, sent.packets())


def screen(port: str, output: str, seconds: str, fps: str, name: str) -> None:
    """Show the acquisition and read another unit in a thread."""
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


@contextmanager
def unit_process(output: Path) -> Iterator[str]:
    """Port of a unit in a process of its own."""
    command = [sys.executable, __file__, "--role", "unit", str(output)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdin is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.stdin.close()
        process.wait(30.0)


def lateness_ms(held: np.ndarray, sent: np.ndarray) -> np.ndarray:
    """Of each packet after the warm-up, in the order of arrival."""
    at = places(held, sent)
    late = (held[:, 0] - sent[at, 0]) / 1e6
    return late[held[:, 0] > held[0, 0] + _WARM_UP_S * 1e9]


def told(name: str, held: np.ndarray, sent: np.ndarray) -> str:
    """A row of the table."""
    late = lateness_ms(held, sent)
    lost = int(places(held, sent)[-1]) + 1 - len(held)
    median, p99, most = np.percentile(late, [50.0, 99.0, 100.0])
    over = 100.0 * float(np.mean(late > _PERIOD_MS))
    return f"| {name} | {median:.2f} | {p99:.2f} | {most:.1f} | {over:.2f} | {lost} of {len(held)} |"


def main() -> None:
    """Measure both at once."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--size", default="200x60")
    parser.add_argument("--fps", type=float, default=60.0)
    parser.add_argument("--role", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role:
        task, *given = options.role
        if task == "unit":
            unit(*given)
        else:
            screen(*given)
        return
    columns, rows = map(int, options.size.split("x"))
    print(describe("textual", "numpy", "pyserial"), flush=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with ExitStack() as ends:
            ours = ends.enter_context(unit_process(folder / "ours.npy"))
            theirs = ends.enter_context(unit_process(folder / "theirs.npy"))
            client = session.start(Plan(ours, 133.0, logs=name, name=NAME, record=True, filter="none"))
            recording = client.snapshot(NOTHING_NEW)["recording"]
            assert recording is not None
            log = Path(recording["path"])
            role = (
                "screen",
                theirs,
                str(folder / "thread.npy"),
                str(options.seconds + _WARM_UP_S),
                str(options.fps),
                NAME,
            )
            written = in_terminal([sys.executable, __file__, "--role", *role], (columns, rows), limit_s=2e4)
            client.stop()
        bytes_s = sum(len(part) for _, part in written) / (written[-1][0] - written[0][0])
        print(f"screen of {options.size}, {options.fps:g} frames a second asked, {bytes_s / 1e3:.0f} kB/s drawn")
        print(
            "\n| reader | median, ms | p99, ms | max, ms | later than a period, % | lost |\n|---|---|---|---|---|---|"
        )
        print(told("acquisition process", log_packets(log), np.load(folder / "ours.npy")))
        print(told("thread of the screen's process", np.load(folder / "thread.npy"), np.load(folder / "theirs.npy")))


if __name__ == "__main__":
    main()

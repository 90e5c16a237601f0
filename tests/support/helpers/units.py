"""Virtual units that are served in this process."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from filters.simulation import Scenario
from imutui.cli.virtual_readings import SIMULATED, SimulatedReadings
from imutui.instrument.faults import FaultyLine
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.uut.fields import Field
from imutui.instrument.virtual import serve
from imutui.instrument.virtual_instrument import CommandT, PacketT, Reading, VirtualInstrument

# "38400 baud, S1, 100 Hz, 10 Hz Butterworth, orientation 0x006B"; the value of the filter is one of those for 10 Hz.
IMU380ZA_200 = (
    (Field.RATE_DIVIDER, 1),
    (Field.BAUD, 2),
    (Field.PACKET_TYPE, int.from_bytes(b"S1", "big")),
    (Field.LOW_PASS_5, 5000),
    (Field.LOW_PASS_6, 5000),
    (Field.ORIENTATION, 0x006B),
)


class Still:
    def reading(self, k: int) -> Reading:
        return Reading((0.1, -0.2, 0.3), (0.0, 0.0, 0.998), 25.0)


@contextmanager
def served(
    made: VirtualInstrument[PacketT, CommandT],
    tap: BinaryIO | None = None,
    line: FaultyLine | None = None,
    *,
    link: Path | None = None,
    speed: float = 1.0,
    log: Callable[[str], None] = lambda _: None,
    on_packet: Callable[[PacketT, int], None] | None = None,
) -> Iterator[str]:
    """Port of a virtual unit on a pseudo-terminal, or the link to it; what it sends goes into the file `tap` as well.

    What it hears goes to `log`; its packets, with the host's monotonic time when each was sampled (ns), to `on_packet`.
    """
    ready: list[str] = []
    up, stop = threading.Event(), threading.Event()

    def on_ready(path: str) -> None:
        ready.append(path)
        up.set()

    options: dict[str, Any] = {"link": link, "tap": tap, "on_ready": on_ready, "log": log, "stop": stop}
    options |= {"line": line, "on_packet": on_packet, "speed": speed}
    thread = threading.Thread(target=serve, args=(made,), kwargs=options, daemon=True)
    thread.start()
    try:
        assert up.wait(10.0)
        yield ready[0] if link is None else str(link)
    finally:
        stop.set()
        thread.join(10.0)


@contextmanager
def virtual(tap: Path | None = None) -> Iterator[str]:
    """Port of the unit that `imutui virtual` runs, without a process for it; what it sends goes into the file `tap`."""
    unit = VirtualUnit(SimulatedReadings(Scenario()), UnitOptions(version=SIMULATED))
    with open(tap or os.devnull, "wb", buffering=0) as sink, served(unit, sink) as port:
        yield port

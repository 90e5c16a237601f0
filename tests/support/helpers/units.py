"""Virtual units that are served in this process."""

import io
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np

from filters.simulation import Scenario
from helpers.faulty_lines import FaultyLine, FaultyWire, serve_faulty
from helpers.processes import LIMIT_S
from imutui.cli.virtual_readings import SIMULATED, SimulatedReadings
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.pseudo_terminal import PseudoTerminal
from imutui.instrument.uut.fields import Field
from imutui.instrument.virtual import Wire, serve
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
    """A unit at rest. It repeats one reading, as no healthy unit does, or adds `noise` (1 sd, deg/s and g)."""

    def __init__(self, noise: tuple[float, float] = (0.0, 0.0)) -> None:
        self._noise = noise

    def reading(self, k: int) -> Reading:
        rates, forces = (0.1, -0.2, 0.3), (0.0, 0.0, 0.998)
        if any(self._noise):
            drawn = np.random.default_rng(k).normal(size=6) * np.repeat(self._noise, 3)
            rates, forces = tuple(rates + drawn[:3]), tuple(forces + drawn[3:])
        return Reading(rates, forces, 25.0)


def healthy() -> Still:
    """Return a unit at rest in which channel health finds no fault."""
    return Still((0.15, 0.002))


class Serving:
    """A virtual unit on a pseudo-terminal in a thread of this process, within a `with`.

    `tap`, `log`, `sent`: what it sends, what it hears, and its packets with the host's monotonic time when each was
      sampled (ns); options of `serve` may take them elsewhere.
    `port`: name of its port.
    """

    def __init__(
        self,
        unit: VirtualInstrument[Any, Any],
        line: FaultyLine | None = None,
        link: Path | None = None,
        on_packet: Callable[[Any, int], None] | None = None,
        speed: float = 1.0,
        **options: Any,
    ) -> None:
        self.tap, self.log, self.sent = io.BytesIO(), list[str](), list[tuple[Any, int]]()
        self.stop, self._ready, self.port = threading.Event(), threading.Event(), ""
        kept = {"tap": self.tap, "log": self.log.append, "stop": self.stop} | options

        def told(packet: Any, sampled_s: float) -> None:
            sampled_ns = round(sampled_s * 1e9)
            self.sent.append((packet, sampled_ns)) if on_packet is None else on_packet(packet, sampled_ns)

        def run() -> None:
            with PseudoTerminal(link) as pty:
                self.port = pty.name
                self._ready.set()
                if line is None:
                    serve(Wire(unit, None, speed, told), pty, **kept)
                else:
                    serve_faulty(FaultyWire(unit, line, speed, told), pty, **kept)

        self.thread = threading.Thread(target=run, daemon=True)

    def __enter__(self) -> Self:
        self.thread.start()
        assert self._ready.wait(LIMIT_S)
        return self

    def __exit__(self, *_: object) -> None:
        self.stop.set()
        self.thread.join(LIMIT_S)
        assert not self.thread.is_alive()


@contextmanager
def served(
    unit: VirtualInstrument[PacketT, CommandT],
    tap: BinaryIO | None = None,
    line: FaultyLine | None = None,
    *,
    link: Path | None = None,
    log: Callable[[str], None] = lambda _: None,
    **options: Any,
) -> Iterator[str]:
    """Port of a virtual unit, or the link to it, with options as `Serving` takes them; nothing is kept."""
    kept = {"tap": tap, "line": line, "link": link, "log": log, "on_packet": lambda *packet: None} | options
    with Serving(unit, **kept) as it:
        yield it.port if link is None else str(link)


@contextmanager
def virtual(tap: Path | None = None) -> Iterator[str]:
    """Port of the unit that `imutui virtual` runs, without a process for it; what it sends goes into the file `tap`."""
    unit = VirtualUnit(SimulatedReadings(Scenario()), UnitOptions(version=SIMULATED))
    with open(tap or os.devnull, "wb", buffering=0) as sink, served(unit, sink) as port:
        yield port

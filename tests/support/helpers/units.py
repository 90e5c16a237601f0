"""Virtual units that are served in this process."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from imutui.cli.virtual_readings import SIMULATED, simulated
from imutui.instrument.virtual import FaultyLine, Reading, UnitOptions, VirtualUnit, serve


class Still:
    """Readings of a unit at rest."""

    def reading(self, k: int) -> Reading:
        return Reading((0.1, -0.2, 0.3), (0.0, 0.0, 0.998), 25.0)


@contextmanager
def served(made: VirtualUnit, tap: BinaryIO | None = None, line: FaultyLine | None = None) -> Iterator[str]:
    """Port of a virtual unit on a pseudo-terminal, over a faulty line if one is given; `tap` gets what arrives too."""
    ready: list[str] = []
    up, stop = threading.Event(), threading.Event()

    def on_ready(path: str) -> None:
        ready.append(path)
        up.set()

    def log(text: str) -> None:
        del text

    options: dict[str, Any] = {"link": None, "tap": tap, "on_ready": on_ready, "log": log, "stop": stop, "line": line}
    thread = threading.Thread(target=serve, args=(made,), kwargs=options, daemon=True)
    thread.start()
    try:
        assert up.wait(10.0)
        yield ready[0]
    finally:
        stop.set()
        thread.join(10.0)


@contextmanager
def virtual(tap: Path | None = None) -> Iterator[str]:
    """Port of the unit that `imutui virtual` runs, without a process for it; what it sends goes into the file `tap`."""
    unit = VirtualUnit(simulated(None, 0, 0), UnitOptions(version=SIMULATED))
    with open(tap or os.devnull, "wb", buffering=0) as sink, served(unit, sink) as port:
        yield port

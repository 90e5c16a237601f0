"""An acquisition of a unit that this process serves, with the truth of what was sent; how processes fare."""

import struct
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from helpers.faulty_lines import FaultyLine
from helpers.processes import has_ended, wait_until
from helpers.units import served

from filters.simulation import Scenario
from imutui.cli.virtual_readings import SIMULATED, SimulatedReadings
from imutui.instrument.imu400.crossbow import PACKET_BYTES
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.logbook import reader
from imutui.session import client
from imutui.session.client import Client, SessionGoneError
from imutui.session.plan import Plan

PERIOD_S = 0.0075
NOTHING_NEW = 2**62  # for a snapshot without packets


class Sent:
    """What reached the host's queue, and when it was written; to be given to a unit as its tap."""

    def __init__(self) -> None:
        self._parts: list[tuple[int, bytes]] = []

    def write(self, data: bytes) -> int:
        """Take what has just been written."""
        self._parts.append((time.monotonic_ns(), data))
        return len(data)

    def flush(self) -> None:
        """Nothing is held back."""

    def packets(self) -> np.ndarray:
        """When each packet was complete, monotonic, ns, and its eight words; shape (n, 9)."""
        ends, data = [], b""
        for at_ns, part in list(self._parts):
            data += part
            ends += [at_ns] * len(part)
        at, rows = _first_packet(data), []
        while at + PACKET_BYTES <= len(data):
            # between packets stands the answer to whether a unit that is late streams still
            if not _is_packet(data, at):
                at += 1
                continue
            rows.append((ends[at + PACKET_BYTES - 1], *struct.unpack(">6h2H", data[at + 1 : at + 17])))
            at += PACKET_BYTES
        return np.array(rows, np.int64).reshape(-1, 9)


def _is_packet(data: bytes, at: int) -> bool:
    return data[at] == 0xFF and sum(data[at + 1 : at + 17]) % 256 == data[at + 17]


def _first_packet(data: bytes) -> int:
    """Where the stream begins: after the last reply, `C` to the command for scaled mode."""
    start = data.find(b"C", 7) + 1
    while start:
        if start + PACKET_BYTES > len(data):
            return len(data)
        if _is_packet(data, start):
            return start
        start = data.find(b"C", start) + 1
    return len(data)


@dataclass(frozen=True)
class Acquired:
    """An acquisition that records, and its unit's side of the wire."""

    client: Client
    sent: Sent

    @property
    def path(self) -> Path:
        return Path(self.state()["recording"]["path"])

    def state(self) -> Any:
        """Snapshot without packets."""
        return self.client.snapshot(NOTHING_NEW)

    def goes_on(self, seconds: float = 0.5) -> None:
        begun = self.state()
        enough = begun["series"]["next"] + seconds / PERIOD_S
        try:
            wait_until(lambda: self.state()["series"]["next"] > enough)
        except AssertionError as error:
            now = self.state()
            said = {key: now[key] for key in ("state", "error", "silent_s", "reconnecting", "zeroing", "events")}
            took = f"from packet {begun['series']['next']} to {now['series']['next']}"
            raise AssertionError(f"{took}; {len(self.sent.packets())} sent; {said}; {_stacks()}") from error


def _stacks() -> str:
    """Where each thread of this process is: the unit that is served here is one of them."""
    frames = sys._current_frames()
    stacks = {
        thread.name: traceback.format_stack(frames[thread.ident]) for thread in threading.enumerate() if thread.ident
    }
    return "\n".join(f"{name}: {''.join(stack[-4:])}" for name, stack in stacks.items())


@contextmanager
def acquiring(folder: Path, line: FaultyLine | None = None, **fields: Any) -> Iterator[Acquired]:
    """An acquisition at 133 Hz without a filter unless fields of the plan say otherwise; ended at the end."""
    sent = Sent()
    unit = VirtualUnit(SimulatedReadings(Scenario()), UnitOptions(version=SIMULATED))
    with ExitStack() as ends:
        port = ends.enter_context(served(unit, sent, line))  # type: ignore[arg-type]
        plan = {"logs": str(folder / "logs"), "record": True, "filter": "none"} | fields
        connection = client.start(Plan(port, **plan))
        ends.callback(_end, connection)
        yield Acquired(connection, sent)


def _end(connection: Client) -> None:
    with suppress(SessionGoneError):  # as it may be meant to
        connection.stop()


def places(held: np.ndarray, sent: np.ndarray) -> np.ndarray:
    """Where each packet that was received stands among those sent; fails if one was not sent, or in another order."""
    found, at = [], 0
    words = [tuple(row) for row in sent[:, 1:].tolist()]
    for row in held[:, 1:].tolist():
        one = tuple(row)
        while at < len(words) and words[at] != one:
            at += 1
        assert at < len(words), "a packet that was never sent"
        found.append(at)
        at += 1
    return np.array(found, int)


def log_packets(path: Path) -> np.ndarray:
    """When each packet of a log was received, monotonic, ns, and its eight words; shape (n, 9)."""
    packets = reader.read(path, raw=True).packets
    fields = [packets["host_monotonic_ns"][:, None], packets["counts"]]
    fields += [packets["temperature"][:, None], packets["ticks"][:, None]]
    return np.hstack([np.asarray(field, np.int64) for field in fields])


def seconds_until_ended(pid: int, since: float) -> float:
    """Wait for the end of a process; how long it took since then, monotonic, s."""
    wait_until(lambda: has_ended(pid))
    return time.monotonic() - since

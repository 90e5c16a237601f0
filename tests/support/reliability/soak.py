"""Hours of packets through an acquisition's recorder and filter, as fast as they go: what of memory and disk it takes.

The reader is left out, and time is that of the packets: every clock that the program asks goes on with them.
"""

import gc
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np

from filters.kalman import runner
from imutui.instrument.clock import Clock
from imutui.instrument.counter_spec import SPAN
from imutui.instrument.imu400.crossbow import PACKET_BYTES, TICK_S, Mode, Packet
from imutui.instrument.imu400.driver import COUNTER
from imutui.instrument.transmitter import BITS_PER_BYTE
from imutui.logbook.session_info import SessionInfo
from imutui.session import live_filter, observe
from imutui.session.acquisition import Acquisition
from imutui.session.lifecycle import Lifecycle
from imutui.session.plan import Plan
from imutui.session.reader_thread import BLOCK_NS
from imutui.session.stream import PacketArrival, Stamper
from reliability.setting import PERIOD_S

_KINDS = 4096
_TRANSFER_NS = PACKET_BYTES * BITS_PER_BYTE * 1_000_000_000 // 38400


@dataclass(frozen=True)
class Taken:
    """What a recording has taken so far."""

    seconds: float  # of packets
    resident_mb: float  # memory of the process
    descriptors: int  # open in the process
    objects: int  # that Python keeps track of
    file_mb: float  # on the disk, in all files
    processor_s: float  # of the process since the beginning


class PacketTime:
    """The time of packets, for every clock."""

    def __init__(self) -> None:
        self.now_ns = time.monotonic_ns()
        self._utc_ns = time.time_ns() - self.now_ns

    @contextmanager
    def kept(self) -> Iterator[None]:
        clocks = {
            "monotonic_ns": lambda: self.now_ns,
            "monotonic": lambda: self.now_ns / 1e9,
            "time_ns": lambda: self.now_ns + self._utc_ns,
            "time": lambda: (self.now_ns + self._utc_ns) / 1e9,
        }
        with patch.multiple(time, **clocks):
            yield


class Silent:
    """A reader that nothing is asked of."""

    def __init__(self) -> None:
        self.last_packet_ns = 0

    def ask_again(self) -> None:
        """It never has to."""


def soak(folder: Path, plan: Plan, seconds: float, every_s: float) -> Iterator[Taken]:
    """Record so many seconds of packets; yields what was taken, every so often."""
    live_filter.PLAIN.begin()
    assert live_filter.PLAIN.ready.wait(300.0)
    runner.warm_up()
    clock, packets, reader = PacketTime(), _packets(), Silent()
    with clock.kept():
        acquisition = Acquisition(
            plan,
            SessionInfo(rate_hz=plan.rate_hz, sampling=plan.sampling, filter=plan.filter, kind="simulated"),
            reader,  # type: ignore[arg-type]
            Lifecycle(),
        )
        stamper = Stamper(Clock(float(_TRANSFER_NS), COUNTER))
        began_ns, began_s = clock.now_ns, time.process_time()
        next_block = next_second = next_report = 0.0
        for k in range(round(seconds / PERIOD_S)):
            at = k * PERIOD_S
            clock.now_ns = began_ns + round(at * 1e9) + _TRANSFER_NS
            reader.last_packet_ns = clock.now_ns
            stamper.take(_arrival(packets[k % _KINDS], k, clock.now_ns))
            if at >= next_block:  # as the reader hands them on while no viewer is there
                next_block += BLOCK_NS / 1e9
                for block in stamper.blocks():
                    acquisition.take(block)
            if at >= next_second:
                acquisition.every_second()
                observe.snapshot(acquisition, 2**62)
                next_second += 1.0
            if at >= next_report + every_s:
                next_report += every_s
                yield _taken(next_report, folder, time.process_time() - began_s)
        acquisition.recording.finish()


def _packets() -> list[tuple[tuple[int, int, int], tuple[int, int, int], int]]:
    rng = np.random.default_rng(1)
    words = np.round(rng.normal(size=(_KINDS, 6)) * 30.0 + [0, 0, 0, 0, 0, 5450]).astype(int).tolist()
    return [((a, b, c), (d, e, f), 1587 + k % 3) for k, (a, b, c, d, e, f) in enumerate(words)]


def _arrival(words: tuple[tuple[int, int, int], tuple[int, int, int], int], k: int, host_ns: int) -> PacketArrival:
    rates, accels, temperature = words
    ticks = -round(k * PERIOD_S / TICK_S) % SPAN
    return PacketArrival(Packet(Mode.SCALED, rates, accels, temperature, ticks), host_ns, k > 0, True, False, 0, 0)


def _taken(seconds: float, folder: Path, processor_s: float) -> Taken:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    size = sum(path.stat().st_size for path in folder.rglob("*.mcap"))
    resident = pages * os.sysconf("SC_PAGE_SIZE") / 1e6
    descriptors = len(list(Path("/proc/self/fd").iterdir()))
    return Taken(seconds, resident, descriptors, len(gc.get_objects()), size / 1e6, processor_s)

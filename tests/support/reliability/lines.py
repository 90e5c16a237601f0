"""The line is damaged, silent or gone, or another unit hangs on it."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from helpers import ros_messages
from helpers.faulty_lines import FaultyLine, LineFault
from helpers.processes import wait_until
from helpers.units import Still, served

from imutui.instrument.counter_spec import SPAN
from imutui.instrument.frame_search import Discarded
from imutui.instrument.imu400.crossbow import PACKET_BYTES, TICK_S, Mode, Packet, encode
from imutui.instrument.imu400.decoder import packet_decoder
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.logbook import reader
from imutui.session import client
from imutui.session.client import Client
from imutui.session.plan import Plan
from imutui.tui import messages
from reliability.setting import NOTHING_NEW, PERIOD_S, acquiring

SERIAL = 9911750
_HEADER = 0xFF
_SPACING = 40


@dataclass(frozen=True)
class Noise:
    """What a decoder made of a damaged stream."""

    faults: int  # places where the stream was damaged
    invented: int  # packets found that were not sent, or in another order
    lost: int  # most good packets that one place cost
    uncounted: int  # bytes that were neither packets nor counted as discarded


def noise(seed: int, faults: int) -> Noise:
    """Flip, insert and delete bytes of a stream, and put headers into packets, far from each other."""
    rng = np.random.default_rng(seed)
    sent = [_packet(k, rng) for k in range((faults + 1) * _SPACING)]
    pieces = [encode(packet) for packet in sent]
    hurt = [(k + 1) * _SPACING + int(rng.integers(_SPACING // 2)) for k in range(faults)]
    for k in hurt:
        pieces[k] = _SPOILT[int(rng.integers(len(_SPOILT)))](pieces[k], rng)
    decoder = packet_decoder(Mode.SCALED, streaming=True)
    stream = b"".join(pieces)
    events = [event for i in range(0, len(stream), 64) for event in decoder.feed(stream[i : i + 64])] + decoder.quiet()
    found = [event for event in events if isinstance(event, Packet)]
    number = {packet: k for k, packet in enumerate(sent)}
    places = [number[packet] for packet in found if packet in number]
    missing = np.setdiff1d(np.setdiff1d(np.arange(len(sent)), places), hurt)
    each = [int(np.sum(np.abs(missing - k) < _SPACING // 2)) for k in hurt]
    discarded = sum(len(event.data) for event in events if isinstance(event, Discarded))
    assert discarded == decoder.discarded_bytes
    invented = len(found) - len(places) + int(np.sum(np.diff(places) <= 0))
    return Noise(faults, invented, max(each), len(stream) - len(found) * PACKET_BYTES - discarded)


def _packet(k: int, rng: np.random.Generator) -> Packet:
    # half of the words hold bytes that look like a header
    words = rng.integers(-300, 300, 6).tolist() if k % 2 else rng.choice([-1, 255, -256, 0], 6).tolist()
    ticks = -round(k * PERIOD_S / TICK_S) % SPAN
    return Packet(Mode.SCALED, tuple(words[:3]), tuple(words[3:]), 1500 + k % 200, ticks)


def _flipped(data: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(len(data)))
    return data[:at] + bytes([data[at] ^ (1 << int(rng.integers(8)))]) + data[at + 1 :]


def _inserted(data: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(1, len(data)))
    return data[:at] + rng.bytes(int(rng.integers(1, 40))) + data[at:]


def _deleted(data: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(len(data)))
    return data[:at] + data[at + int(rng.integers(1, len(data))) :]


def _headed(data: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(1, len(data)))
    return data[:at] + bytes([_HEADER]) + data[at + 1 :] if data[at] != _HEADER else _flipped(data, rng)


_SPOILT: list[Callable[[bytes, np.random.Generator], bytes]] = [_flipped, _inserted, _deleted, _headed]


@dataclass(frozen=True)
class Silence:
    """How a silence was told: until the warning, and from the first packet after it until the warning was gone, s."""

    told_s: float
    over_s: float


def silent(folder: Path, seconds: float) -> Silence:
    """Cut the line without a hang-up for so long."""
    line = FaultyLine([LineFault(1.0, "silence", seconds=seconds)])
    with acquiring(folder, line, rate_hz=20.0) as it:
        wait_until(lambda: messages.silence(it.state()) is not None)
        told = time.monotonic_ns()
        wait_until(lambda: messages.silence(it.state()) is None)
        over = time.monotonic_ns()
        log = it.client.stop()["result"]
    assert log is not None
    # as the acquisition read them: whoever writes to the wire may be held up before it looks at a clock
    arrived = np.array(
        [packet.host_monotonic_ns for packet in ros_messages.packets(reader.read(Path(log["log"]), raw=True))]
    )
    last, back = arrived[arrived < told][-1], arrived[arrived > told][0]
    return Silence((told - last) / 1e9, (over - back) / 1e9)


@dataclass(frozen=True)
class Unplugged:
    """How a unit was found again: until its loss was noticed, and from its return until packets came, s."""

    noticed_s: float
    back_s: float


@contextmanager
def plugged_in(link: Path, **options: Any) -> Iterator[str]:
    """A unit that has just been given power, on a pseudo-terminal that the link leads to; unplugged at the end."""
    with served(VirtualUnit(Still(), UnitOptions(**({"serial_number": SERIAL} | options)))) as device:
        link.symlink_to(device)
        try:
            yield device
        finally:
            link.unlink()


def unplugged(folder: Path) -> Unplugged:
    """Unplug the unit, plug another one in its place, and then the same again under another name."""
    link, other = folder / "imu", folder / "other"  # there already, so that it has a name of its own
    with plugged_in(other) as name:
        with plugged_in(link) as first:
            plan = Plan(str(link), logs=str(folder / "logs"), record=True, filter="none")
            connection = client.start(plan)
            _more_packets(connection)
            since = time.monotonic()
        wait_until(lambda: _seen(connection)["reconnecting"] is not None)
        noticed = time.monotonic() - since
        count = _seen(connection)["packets"]
        with plugged_in(link, serial_number=17):
            wait_until(lambda: "17" in _seen(connection)["reconnecting"]["waits_for"])
        assert _seen(connection)["packets"] == count
        link.symlink_to(name)
        since = time.monotonic()
        wait_until(lambda: _seen(connection)["packets"] > count)
        back = time.monotonic() - since
        assert name != first
        log = Path((connection.stop()["result"] or {})["log"])
        link.unlink()
    events = reader.read(log).events
    assert [event.name for event in events].count("gap") == 1, events
    assert len([event for event in events if event.text.startswith("refused")]) == 1, events
    return Unplugged(noticed, back)


def _seen(connection: Client) -> Any:
    return connection.snapshot(NOTHING_NEW)


def _more_packets(connection: Client, count: int = 50) -> None:
    before = _seen(connection)["packets"]
    wait_until(lambda: _seen(connection)["packets"] > before + count)

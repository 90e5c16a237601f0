"""Units whose replies are slow, plain, damaged or do not come: identified rightly, and no late reply is another's."""

import os
import threading
import time
import tty
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from select import select

import pytest
from helpers.commands import imutui
from helpers.fake_devices import IMU400CD, Device, Habits, answers
from helpers.units import Still, served

from imutui.instrument.host import Identity, InstrumentError
from imutui.instrument.imu400 import handshake
from imutui.instrument.imu400.crossbow import POWER_UP_BAUD, Mode
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.port import Port
from imutui.logbook import reader

KNOWN = Identity("9911750", IMU400CD)


def dialogue(port: Port, baud: int = POWER_UP_BAUD, patience_s: float = 2.0) -> Identity:
    return handshake.open_dialogue(port, baud, patience_s=patience_s)


@contextmanager
def slow(replies: Mapping[bytes, bytes], delay_s: float, others: Mapping[bytes, float] | None = None) -> Iterator[str]:
    """Port of a device that answers each letter so late, one after the other, at whatever speed the host has set."""
    master, slave = os.openpty()
    tty.setraw(slave)
    ended = threading.Event()

    def serve() -> None:
        due: deque[tuple[float, bytes]] = deque()
        while not ended.is_set():
            if select([master], [], [], 0.01)[0]:
                for byte in os.read(master, 64):
                    letter = bytes([byte])
                    due.append((time.monotonic() + (others or {}).get(letter, delay_s), replies.get(letter, b"")))
            while due and due[0][0] <= time.monotonic():
                os.write(master, due.popleft()[1])

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield os.ttyname(slave)
    finally:
        ended.set()
        thread.join(10.0)
        os.close(master)
        os.close(slave)


def identified(delay_s: float) -> tuple[Identity, int]:
    """What is found out of a good unit that is so slow, and at which speed."""
    with slow(answers(), delay_s) as path, Port(path, POWER_UP_BAUD) as port:
        return dialogue(port), port.baud


def test_a_slow_unit_is_identified_rightly_at_its_own_speed() -> None:
    delays = (0.05, 0.23, 0.3, 0.45, 0.55, 0.9, 1.3, 1.8)
    with ThreadPoolExecutor(len(delays)) as pool:
        for delay, found in zip(delays, pool.map(identified, delays), strict=True):
            assert found == (KNOWN, POWER_UP_BAUD), delay
            assert found[0].slowest_reply_s >= delay


def test_a_slow_unit_on_a_line_of_one_speed_is_found_and_measures_in_scaled_mode() -> None:
    """The virtual unit, 0.9 s late: what it says while the host listens at another speed is noise."""
    made = VirtualUnit(Still(), UnitOptions(version="IMU400CD-200 1.07", reply_delay_s=0.9))
    with served(made) as path, Port(path, POWER_UP_BAUD) as port:
        assert dialogue(port) == Identity("9911750", "IMU400CD-200 1.07")
        assert port.baud == POWER_UP_BAUD
    assert made.mode is Mode.SCALED


def test_a_quick_unit_is_asked_nothing_twice() -> None:
    with Device(Habits(answers())) as device, Port(device.port, POWER_UP_BAUD) as port:
        assert dialogue(port) == KNOWN
        assert bytes(device.heard) == b"PRSvc"


@pytest.mark.parametrize(
    "text", [b"IMU400CD-200 1.07", b"IMU400CD-200 1.07\r\n", b"Crossbow IMU400CD-200 Version 1.07 of C"]
)
def test_a_version_in_plain_text_is_read(text: bytes) -> None:
    """Without header and sum, as the manuals have it; of one that is too long the beginning, its rest is no reply."""
    with Device(Habits(answers(v=text, c=b""))) as device, Port(device.port, POWER_UP_BAUD) as port:
        handshake.find_speed(port, POWER_UP_BAUD)
        assert handshake.identify(port) == Identity("9911750", text.decode().strip()[:32])
        assert not handshake.set_scaled(port, 0.1)


@pytest.mark.parametrize("text", [b"IMU400CD-200 1.07", b"C-MIGITS"])
def test_late_text_is_not_taken_for_the_answer_to_the_mode(text: bytes) -> None:
    with (
        slow(answers(v=text, c=b""), 0.0, {b"v": 0.8}) as path,
        Port(path, POWER_UP_BAUD) as port,
        pytest.raises(InstrumentError, match="not the command for scaled mode"),
    ):
        dialogue(port, patience_s=0.4)


def test_a_reply_that_came_damaged_is_asked_for_once_more() -> None:
    broken = answers()[b"S"][:-1] + b"\x00"
    with Device(Habits(answers(S=broken))) as device, Port(device.port, POWER_UP_BAUD) as port:
        assert dialogue(port) == Identity("", IMU400CD)
        assert device.heard.count(b"S") > 1


def test_a_unit_without_auto_baud_is_named_with_the_next_step() -> None:
    with (
        served(VirtualUnit(Still(), UnitOptions(auto_baud=False))) as path,
        Port(path, POWER_UP_BAUD) as port,
        pytest.raises(InstrumentError, match=r"will not go to 57600.*--baud 38400"),
    ):
        dialogue(port, 57600)


def test_what_a_unit_does_not_say_of_itself_is_said(home: Path) -> None:
    """Neither serial number nor version: on stderr and as an event; the metadata is empty, the recording goes on."""
    with Device(Habits(answers(S=b"", v=b""), streams=None)) as device:
        record = ("record", "--port", device.port, "--filter", "none", "--duration", "0.3", "--json", "-o", "a.mcap")
        done = imutui(*record)
    words = "did not say its serial number and its version"
    assert words in done.stderr
    assert "#" not in done.stderr
    log = reader.read(home / "a.mcap")
    assert any(words in event.text for event in log.events)
    assert (log.info.serial_number, log.info.firmware) == ("", "")

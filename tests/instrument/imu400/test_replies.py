"""Units whose replies are late, plain, damaged or absent: identified rightly, and no late reply is another's."""

import os
import threading
import time
import tty
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from select import select

import pytest
from helpers.commands import imutui
from helpers.fake_devices import IMU400CD, Device, Habits, answers

from imutui.instrument.driver import Identity, InstrumentError
from imutui.instrument.imu400.crossbow import POWER_UP_BAUD
from imutui.instrument.imu400.driver import Imu400cd
from imutui.instrument.port import Port
from imutui.logbook import reader

KNOWN = Identity("9911750", IMU400CD)


@contextmanager
def slow(replies: Mapping[bytes, bytes], delays_s: Mapping[bytes, float]) -> Iterator[str]:
    """Port of a device that answers letters so late, one after the other, at whatever speed the host has set."""
    master, slave = os.openpty()
    tty.setraw(slave)
    ended = threading.Event()

    def serve() -> None:
        due: deque[tuple[float, bytes]] = deque()
        while not ended.is_set():
            if select([master], [], [], 0.01)[0]:
                for byte in os.read(master, 64):
                    letter = bytes([byte])
                    due.append((time.monotonic() + delays_s.get(letter, 0.0), replies.get(letter, b"")))
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


@pytest.mark.parametrize("delay_s", [0.05, 0.15, 0.3])
def test_a_unit_behind_a_slow_network_is_identified_at_its_own_speed(delay_s: float) -> None:
    with slow(answers(), dict.fromkeys(map(str.encode, "RSvc"), delay_s)) as path, Port(path, POWER_UP_BAUD) as port:
        assert Imu400cd(port).open(None) == KNOWN
        assert port.baud == POWER_UP_BAUD


def test_a_quick_unit_is_asked_nothing_twice() -> None:
    with Device(Habits(answers())) as device, Port(device.port, POWER_UP_BAUD) as port:
        assert Imu400cd(port).open(None) == KNOWN
        assert bytes(device.heard) == b"PRSvc"


@pytest.mark.parametrize(
    "text", [b"IMU400CD-200 1.07", b"IMU400CD-200 1.07\r\n", b"Crossbow IMU400CD-200 Version 1.07 of C"]
)
def test_a_version_in_plain_text_is_read(text: bytes) -> None:
    """Without header and sum, as the manuals have it."""
    with Device(Habits(answers(v=text, c=b""))) as device, Port(device.port, POWER_UP_BAUD) as port:
        driver = Imu400cd(port)
        driver.find_speed(POWER_UP_BAUD)
        assert driver.identify() == Identity("9911750", text.decode().strip())
        assert not driver.set_up()


@pytest.mark.parametrize("text", [b"IMU400CD-200 1.07", b"C-MIGITS"])
def test_late_text_is_not_taken_for_the_answer_to_the_mode(text: bytes) -> None:
    with (
        slow(answers(v=text, c=b""), {b"v": 1.2}) as path,
        Port(path, POWER_UP_BAUD) as port,
        pytest.raises(InstrumentError, match="not the command for scaled mode"),
    ):
        Imu400cd(port).open(None)


def test_a_reply_that_came_damaged_is_asked_for_once_more() -> None:
    broken = answers()[b"S"][:-1] + b"\x00"
    with Device(Habits(answers(S=broken))) as device, Port(device.port, POWER_UP_BAUD) as port:
        assert Imu400cd(port).open(None) == Identity("", IMU400CD)
        assert device.heard.count(b"S") > 1


def test_a_unit_without_auto_baud_is_named_with_the_next_step() -> None:
    with (
        Device(Habits(answers())) as device,
        Port(device.port, POWER_UP_BAUD) as port,
        pytest.raises(InstrumentError, match=r"will not go to 57600.*--baud 38400"),
    ):
        Imu400cd(port).open(57600)


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

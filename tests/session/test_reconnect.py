"""The line is lost, or the unit falls silent, while an acquisition runs: it goes on with the same unit, in one file.

Real pseudo-terminals and TCP connections; the unit, and what leads to it, are served by the test's own process.
"""

import os
import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from helpers import ros_messages
from helpers.acquisitions import acquiring, replayed, untimed
from helpers.commands import imutui, imutui_json
from helpers.faulty_lines import FaultyLine, LineFault
from helpers.processes import wait_until
from helpers.terminal_server import TerminalServer
from helpers.units import Still, served

from imutui.instrument.driver import Identity
from imutui.instrument.imu400.crossbow import POWER_UP_BAUD
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.registry import INSTRUMENTS
from imutui.instrument.uut import unit as uut
from imutui.instrument.uut.fields import Field
from imutui.instrument.uut.unit_options import UnitOptions as UutOptions
from imutui.logbook import reader
from imutui.session import client, reconnection
from imutui.session.plan import Plan

SERIAL = 9911750


def unit(**options: Any) -> VirtualUnit:
    """One that has just been given power."""
    return VirtualUnit(Still(), UnitOptions(**({"serial_number": SERIAL} | options)))


def imu381(serial_number: int = SERIAL) -> uut.VirtualUnit:
    """One that has just been given power, and streams by itself."""
    options = UutOptions(serial_number=serial_number)
    return uut.VirtualUnit(Still(), options, seed=serial_number)


UNITS: dict[str, Callable[..., Any]] = {"imu400cd": unit, "imu381": imu381}
of_both = pytest.mark.parametrize("name", list(UNITS))


def only(texts: list[str], piece: str) -> str:
    (one,) = [text for text in texts if piece in text]
    return one


def asked_of(name: str) -> dict[str, Any]:
    """What a plan has for an instrument."""
    it = INSTRUMENTS[name]
    return {"instrument": name, "rate_hz": it.most_rate_hz, "accel_sign": it.accel_sign}


@of_both
def test_the_same_unit_returns_under_another_name_and_one_file_goes_on(home: Path, name: str) -> None:
    link = home / "imu"
    with ExitStack() as stack:
        other = stack.enter_context(served(UNITS[name]()))  # there already, so that it has a name of its own
        with served(UNITS[name](), link=link):
            run = stack.enter_context(acquiring(home, str(link), filter="spkf", **asked_of(name)))
            run.more_packets(100)
        run.wait_until_lost()
        link.symlink_to(other)
        wait_until(lambda: run.seen()["reconnecting"] is None)
        run.more_packets(100)
        assert run.seen()["lost_packets"] == 0
        live = run.end()
    log = Path(live["log"])
    texts = [event.text for event in reader.read(log).events]
    assert str(link) in only(texts, "went away")  # so it was the port that told, and no silence
    assert f"serial number {SERIAL}" in only(texts, "the unit is back")
    # one that streams from power-up on says nothing of its power by it
    assert ("sending" in only(texts, "the unit is back")) == (name == "imu400cd")
    # a busy machine may hold up the unit as well, by less
    away = {"imu400cd": 0.5, "imu381": 0.25}[name]  # one that streams by itself is back sooner
    assert len([gap for gap in live["gaps"] if gap["seconds"] > away]) == 1
    assert untimed(live) == replayed(log, code=1)
    assert "finished" in imutui("check", log, check=1).stdout
    assert imutui_json("info", log)["finished"]


@of_both
def test_another_unit_on_the_old_port_is_refused_and_the_right_one_waited_for(home: Path, name: str) -> None:
    link = home / "imu"
    with ExitStack() as stack:
        with served(UNITS[name](), link=link):
            run = stack.enter_context(acquiring(home, str(link), **asked_of(name)))
            run.more_packets()
            wait_until(lambda: run.seen()["measured_hz"] is not None)
        run.wait_until_lost()
        # nothing comes, so that there is no rate
        assert (run.seen()["measured_hz"], run.seen()["packet_hz"]) == (None, None)
        count = run.seen()["packets"]
        with served(UNITS[name](serial_number=17), link=link):
            wait_until(lambda: "serial number 17" in run.seen()["reconnecting"]["waits_for"])
        assert run.seen()["packets"] == count
        with served(UNITS[name](), link=link):
            run.more_packets()
            wait_until(lambda: run.seen()["measured_hz"] is not None)
            texts, _ = run.content()
    refused = only(texts, "refused")
    assert "serial number 17" in refused
    assert str(SERIAL) in refused


def test_terminated_without_the_unit_it_finishes_the_file_at_once_and_says_so(home: Path) -> None:
    link = home / "imu"
    with served(unit(), link=link):
        connection = client.start(Plan(str(link), logs=str(home / "logs"), record=True, filter="none"))
        wait_until(lambda: connection.snapshot(2**62)["packets"] > 20)
    wait_until(lambda: connection.snapshot(2**62)["reconnecting"] is not None)
    assert "RECONNECTING" in imutui("status").stdout
    os.kill(connection.pid, signal.SIGTERM)
    wait_until(lambda: connection.end() is not None)
    assert connection.end()["ended_by"].startswith("the signal SIGTERM")
    end = connection.wait(30.0)
    (finding,) = end["findings"]
    assert finding["exit_code"] == 4
    assert "gone at the end" in finding["text"]
    log = reader.read(Path((end["result"] or {})["log"]))
    assert log.finished
    assert finding["text"] in [event.text for event in log.events]


@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning:serial")
@pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
def test_a_terminal_server_that_hangs_up_is_connected_to_again(home: Path, scheme: str) -> None:
    with ExitStack() as stack:
        device = stack.enter_context(served(unit()))
        with TerminalServer(device, scheme) as server:
            run = stack.enter_context(acquiring(home, server.url))
            run.more_packets()
        run.wait_until_lost()
        with TerminalServer(device, scheme, server.number):
            run.more_packets()
            texts, _ = run.content()
    assert "sending still" in only(texts, "the unit is back")


@pytest.mark.parametrize(
    ("known", "found", "refused"),
    [
        (Identity("7", "A 1"), Identity("7", "A 1"), None),
        (Identity("7", "A 1"), Identity("7", "A 2"), None),
        (Identity("7", "A 1"), Identity("8", "A 1"), "serial number 8"),
        (Identity("7", "A 1"), Identity("", "A 1"), "does not say its serial number"),
        (Identity("", "A 1"), Identity("", "A 1"), None),
        (Identity("", "A 1"), Identity("8", "A 1"), None),
        (Identity("", "A 1"), Identity("8", "A 2"), 'version "A 2"'),
        (Identity("", "A 1"), Identity("", ""), "does not say its version"),
        (Identity("", ""), Identity("8", "A 2"), None),
    ],
)
def test_a_unit_is_the_same_by_its_serial_number_or_else_by_its_port_and_version(
    known: Identity, found: Identity, refused: str | None
) -> None:
    """One that never said its number is taken for the same at the same port, unless its version is another."""
    why = reconnection.refusal(known, found)
    assert (why is None) == (refused is None)
    assert refused is None or refused in str(why)


def reset(one: VirtualUnit) -> None:
    """As it is after power was gone for a moment: polled, in voltage mode, at the speed of power-up."""
    vars(one).update(vars(unit()))


@pytest.mark.parametrize(
    ("sampling", "baud"), [("stream", POWER_UP_BAUD), ("stream", 57600), ("polled", 57600), ("polled", POWER_UP_BAUD)]
)
def test_a_unit_that_was_reset_in_mid_stream_is_set_up_again(
    home: Path, monkeypatch: pytest.MonkeyPatch, sampling: str, baud: int
) -> None:
    monkeypatch.setattr(reconnection, "_LEAST_SILENCE_S", 0.5)
    one = unit()
    with served(one) as device, acquiring(home, device, sampling=sampling, baud=baud, rate_hz=20.0) as run:
        run.more_packets()
        reset(one)
        wait_until(lambda: "the unit is back" in str(run.seen()["events"]))
        run.more_packets()
        texts, log = run.content()
    if (sampling, baud) == ("polled", POWER_UP_BAUD):
        # it answers, in volts: that is seen before one such packet is used
        assert "measures in volts" in "".join(texts)
    else:
        assert "no packets for" in "".join(texts)
    assert f"serial number {SERIAL}" in only(texts, "the unit is back")
    assert {packet.counts[5] for packet in ros_messages.packets(log)} == {ros_messages.packets(log)[0].counts[5]}


@pytest.mark.parametrize(
    ("name", "rate_hz"), [("imu400cd", 133.0), ("imu400cd", 0.1), ("imu381", 100.0), ("imu381", 4.0)]
)
@pytest.mark.parametrize("after_s", [0.5, 0.503, 0.506])
def test_a_unit_that_has_stopped_is_known_before_long_silence_tells(
    home: Path, monkeypatch: pytest.MonkeyPatch, name: str, rate_hz: float, after_s: float
) -> None:
    """By its answers, amid a packet or between two: half a second for the IMU400CD, more for one that sends slowly."""
    monkeypatch.setattr(reconnection, "_LEAST_SILENCE_S", 1e9)
    quiet = UutOptions(serial_number=SERIAL, fields=tuple({**dict(UutOptions().fields), Field.RATE_DIVIDER: 0}.items()))
    one = unit() if name == "imu400cd" else uut.VirtualUnit(Still(), quiet, seed=1)
    line = FaultyLine((LineFault(after_s, "reset"),))
    # at 0.1 Hz a sample takes ten seconds, and packets come all the same
    with served(one, line=line) as device, acquiring(home, device, **(asked_of(name) | {"rate_hz": rate_hz})) as run:
        wait_until(lambda: "the unit is back" in str(run.seen()["events"]))
        run.more_packets(3)
        assert "the unit is asked again" in str(run.seen()["events"])


def test_a_line_that_is_held_up_is_not_taken_for_a_unit_that_has_stopped(home: Path) -> None:
    """It is asked meanwhile, which costs nothing: every packet comes, none is said to be lost."""
    tap, heard = home / "tap", list[str]()
    with (
        tap.open("wb", buffering=0) as sink,
        served(unit(), sink, log=heard.append) as device,
        TerminalServer(device, "socket") as server,
        acquiring(home, server.url, rate_hz=133.0) as run,
    ):
        run.more_packets()
        asked = len(heard)
        server.stall(2.0)
        run.more_packets(400)
        assert (run.seen()["lost_packets"], run.seen()["discarded_bytes"]) == (0, 0)
        texts, log = run.content()
    assert any("serial number" in command for command in heard[asked:])
    assert not any("asked again" in text for text in texts)
    sent, got = ticks_in(tap.read_bytes()), [packet.ticks for packet in ros_messages.packets(log)]
    assert got == sent[: len(got)]


def test_another_unit_that_streams_by_itself_is_not_taken_for_the_one_that_was_there(home: Path) -> None:
    """An IMU381's plug was put onto another one in mid-stream: no packet of that one is used once it is known.

    Its counter begins where chance has it, and a few exchanges of a hundred do not show: here there are three.
    """
    line = FaultyLine(tuple(LineFault(at, "reset", serial_number=17) for at in (1.0, 2.5, 4.0)))
    with served(imu381(), line=line) as device, acquiring(home, device, **asked_of("imu381")) as run:
        wait_until(lambda: "serial number 17" in str((run.seen()["reconnecting"] or {}).get("waits_for")))
        texts, log = run.content()
    assert "refused" in "".join(texts)
    # mostly at once, else after 3 s of packets that are late
    assert len(ros_messages.packets(log)) < 900


def ticks_in(sent: bytes) -> list[int]:
    """Time counters of the packets among what a unit sent."""
    found, at = [], 0
    while at + 18 <= len(sent):
        packet = sent[at : at + 18]
        whole = packet[0] == 0xFF and sum(packet[1:17]) % 256 == packet[17]
        found += [int.from_bytes(packet[15:17], "big")] if whole else []
        at += 18 if whole else 1
    return found


def test_packets_that_a_stalled_line_kept_are_used(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though the unit was asked again meanwhile: what it sent before it heard that comes late, and all of it."""
    monkeypatch.setattr(reconnection, "_LEAST_SILENCE_S", 0.3)
    tap = home / "tap"
    with (
        tap.open("wb", buffering=0) as sink,
        served(unit(), sink) as device,
        TerminalServer(device, "socket") as server,
        acquiring(home, server.url, rate_hz=133.0) as run,
    ):
        run.more_packets()
        server.stall(1.5)
        run.more_packets()
        _, log = run.content()
    sent, got = ticks_in(tap.read_bytes()), [packet.ticks for packet in ros_messages.packets(log)]
    assert got == sent[: len(got)]
    assert len(sent) - len(got) < 10, "but what was on its way at the end"

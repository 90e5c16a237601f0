"""The virtual IMU400CD as a state machine, on a time of the test's own."""

import re

import numpy as np
import pytest
from helpers.ramp import Ramp, numbers, steps
from hypothesis import given, settings
from hypothesis import strategies as st

from filters.imu import LOOP_HZ
from imutui.instrument.counter_spec import SPAN
from imutui.instrument.frame_search import Discarded
from imutui.instrument.imu400.crossbow import (
    LETTER_REPLIES,
    PACKET_BYTES,
    TICK_S,
    Command,
    Mode,
    Packet,
    framed,
    in_words,
    serial_number_frame,
    zero_rates,
)
from imutui.instrument.imu400.decoder import packet_decoder, reply_decoder
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.transmitter import BITS_PER_BYTE, transfer_s

Event = Packet | str | Discarded

PERIOD_S = 1 / LOOP_HZ
PACKET_S = transfer_s(PACKET_BYTES, 38400)


class Bench:
    """A unit and a host on a common time: the host sends, time passes, and what arrived is read."""

    def __init__(self, unit: VirtualUnit, now: float = 100.0) -> None:
        self.unit = unit
        self.now = now
        self.baud = 38400

    def send(self, *commands: bytes) -> None:
        self.unit.receive(b"".join(commands), self.now, self.baud)

    def wait(self, seconds: float) -> bytes:
        """Let time pass, and return what arrived."""
        self.now += seconds
        return self.unit.transmit(self.now, self.baud)

    def ask(self, command: bytes, seconds: float = 0.05) -> list[Event]:
        """Send a command and return what it brought, read as its reply."""
        decoder = reply_decoder(command)
        self.send(command)
        return decoder.feed(self.wait(seconds)) + decoder.quiet()

    def packets(self, seconds: float, mode: Mode = Mode.SCALED) -> list[Packet]:
        """Let time pass, and return the packets, which are all that arrived."""
        decoder = packet_decoder(mode, streaming=True)
        events = decoder.feed(self.wait(seconds)) + decoder.quiet()
        packets = [event for event in events if isinstance(event, Packet)]
        rest = events[len(packets) :]  # at most a packet whose end has not left yet
        assert all(isinstance(event, Discarded) and len(event.data) < PACKET_BYTES for event in rest)
        return packets

    def poll(self, mode: Mode = Mode.SCALED) -> Packet:
        """Ask for a packet, and return it: nothing else arrives."""
        self.send(Command.GET_PACKET)
        (packet,) = self.packets(0.05, mode)
        return packet


def bench(source: Ramp | None = None, options: UnitOptions | None = None, mode: Mode = Mode.SCALED) -> Bench:
    """Return a bench whose unit is in `mode` and polled."""
    made = Bench(VirtualUnit(source or Ramp(), options))
    command = Command.SCALED_MODE if mode is Mode.SCALED else Command.VOLTAGE_MODE
    assert made.ask(command) == [LETTER_REPLIES[command]]
    return made


def streaming(source: Ramp | None = None, options: UnitOptions | None = None, mode: Mode = Mode.SCALED) -> Bench:
    """The same, told to stream a moment ago."""
    made = bench(source, options, mode)
    made.send(Command.START_STREAM)
    return made


# -------------------------------------------------------------------------------------------------------------- replies

REPLIES: list[tuple[bytes, str]] = [
    (Command.PING, "H"),
    (Command.SCALED_MODE, "C"),
    (Command.VOLTAGE_MODE, "R"),
    (Command.SERIAL_NUMBER, "9911750"),
    (Command.VERSION, "IMU400CD-200 VIRTUAL 1.0"),
    (zero_rates(0), "Z"),
    (Command.REQUEST_BAUD, "B"),
]


def sent(command: bytes, reply: str) -> bytes:
    """Bytes of a reply on the line."""
    if command == Command.SERIAL_NUMBER:
        return serial_number_frame(int(reply))
    return framed(reply.encode()) if command == Command.VERSION else reply.encode()


SILENT: list[bytes] = [Command.STOP_STREAM, Command.MEASURE_BAUD, b"?", b"\r"]


@pytest.mark.parametrize(("command", "reply"), REPLIES)
def test_a_command_is_answered(command: bytes, reply: str) -> None:
    """Each command that has a reply gets it, and nothing else."""
    assert Bench(VirtualUnit(Ramp())).ask(command) == [reply]


@pytest.mark.parametrize(("command", "reply"), REPLIES)
def test_a_reply_takes_its_line_time_and_no_more(command: bytes, reply: str) -> None:
    host = Bench(VirtualUnit(Ramp()))
    host.send(command)
    data = sent(command, reply)
    for n in range(len(data)):
        host.now = 100.0 + transfer_s(n + 1, 38400)
        assert host.unit.transmit(host.now - 1e-6, 38400) == b""
        assert host.unit.transmit(host.now, 38400) == data[n : n + 1]


@pytest.mark.parametrize("command", SILENT)
def test_some_commands_are_met_with_silence(command: bytes) -> None:
    host = Bench(VirtualUnit(Ramp()))
    host.send(command)
    assert host.wait(1.0) == b""
    assert host.unit.next_event(host.now) is None


def test_replies_queue_behind_each_other() -> None:
    host = Bench(VirtualUnit(Ramp()))
    host.send(*(command for command, _ in REPLIES))
    replies = b"".join(sent(*each) for each in REPLIES)
    assert host.unit.transmit(host.now + transfer_s(len(replies), 38400) - 1e-6, 38400) == replies[:-1]
    assert host.wait(transfer_s(len(replies), 38400)) == replies[-1:]


def test_what_was_understood_is_told() -> None:
    unit = VirtualUnit(Ramp())
    assert unit.receive(b"Rz", 0.0, 38400) == [Command.PING]
    assert unit.receive(b"\x00?", 0.0, 38400) == [zero_rates(0), b"?"]


@pytest.mark.parametrize("command", [*Command, zero_rates(0), b"\r"])
def test_every_command_has_words(command: bytes) -> None:
    assert re.fullmatch(r"(.|\\.+): [ -~]+", in_words(command))


# -------------------------------------------------------------------------------------------------- packets and streams


def test_the_unit_wakes_up_polled_in_voltage_mode() -> None:
    host = Bench(VirtualUnit(Ramp()))
    assert host.wait(1.0) == b""
    packet = host.poll(Mode.VOLTAGE)
    assert packet.rates[0] == 2048
    assert packet.accels[0] == 2048
    assert all(word < 4096 for word in (*packet.rates, *packet.accels, packet.temperature))


def test_a_stream_shows_every_reading_once() -> None:
    """At full rate a packet comes each 7.5 ms, with the next reading and a counter that stepped by one period."""
    host = streaming()
    packets = host.packets(2.0)
    assert numbers(packets) == list(range(267))
    assert set(steps(packets)) == {9493, 9494}


def test_packets_leave_on_the_units_own_grid() -> None:
    host = bench()
    host.now = began = 1e6
    host.send(Command.START_STREAM)
    for seconds in (0.0, 1.0, 60.0):
        host.wait(seconds)
        due = host.unit.next_event(host.now)
        assert due is not None
        instant = (due - PACKET_S - began) / PERIOD_S
        assert instant == pytest.approx(round(instant), abs=1e-6)


def test_waking_late_loses_nothing() -> None:
    """Bytes asked for late are those that would have been asked for in time."""
    prompt, late = streaming(), streaming()
    assert b"".join(prompt.wait(0.001) for _ in range(3000)) == late.wait(3.0)


def test_the_next_event_is_a_packets_end() -> None:
    host = streaming()
    for n in range(50):
        due = host.unit.next_event(host.now)
        assert due is not None
        assert due > host.now
        host.now = due
        data = host.unit.transmit(due, 38400)
        assert len(data) == PACKET_BYTES
        assert int.from_bytes(data[1:3], "big") == n


def test_the_packet_begun_before_a_stop_still_arrives() -> None:
    host = streaming()
    first = host.wait(0.002)
    assert 0 < len(first) < PACKET_BYTES
    host.send(Command.STOP_STREAM)
    assert len(first + host.wait(1.0)) == PACKET_BYTES
    assert not host.unit.streaming


def test_a_packet_asked_for_in_a_stream_is_its_last() -> None:
    host = streaming()
    head = host.wait(0.002)
    host.send(Command.GET_PACKET)
    assert len(head + host.wait(1.0)) == 2 * PACKET_BYTES
    assert not host.unit.streaming


def test_a_reply_in_a_stream_comes_between_packets() -> None:
    host = streaming()
    head = host.wait(0.002)
    host.send(Command.SERIAL_NUMBER)
    line = head + host.wait(0.1)
    assert line[PACKET_BYTES : PACKET_BYTES + 6] == serial_number_frame(9911750)
    assert line[PACKET_BYTES + 6] == 0xFF
    assert host.unit.streaming


def test_a_polled_packet_shows_the_newest_instant_of_the_loop() -> None:
    host = bench()
    host.send(Command.GET_PACKET)
    began = host.now
    (first,) = host.packets(0.05)
    for seconds in (0.0101, 0.3333, 0.02, 1.7):
        host.now += seconds
        elapsed = host.now - began
        packet = host.poll()
        assert numbers([packet]) == [int(elapsed * LOOP_HZ)]
        expected = round(packet.rates[0] * PERIOD_S / TICK_S) % SPAN
        assert (first.ticks - packet.ticks - expected + 2) % SPAN <= 4


def test_the_loop_goes_on_between_streams() -> None:
    host = streaming()
    before = host.packets(0.5)
    host.send(Command.STOP_STREAM)
    host.wait(0.0333)
    host.now += 0.9667
    host.send(Command.START_STREAM)
    after = host.packets(0.5)
    assert numbers(after)[0] == pytest.approx(1.5 * LOOP_HZ, abs=1.01)
    gap = (after[0].rates[0] - before[0].rates[0]) * PERIOD_S / TICK_S
    assert (before[0].ticks - after[0].ticks - round(gap) + 2) % SPAN <= 4


@pytest.mark.parametrize("baud", [9600, 19200, 57600])
def test_a_slow_line_skips_readings(baud: int) -> None:
    host = bench()
    host.ask(Command.REQUEST_BAUD)
    host.baud = baud
    assert host.ask(Command.MEASURE_BAUD) == ["A"]
    host.send(Command.START_STREAM)
    packets = host.packets(10.0)
    rate = min(LOOP_HZ, baud / BITS_PER_BYTE / PACKET_BYTES)
    assert len(packets) == pytest.approx(10.0 * rate, abs=1.5)
    at_most = 1 + (baud < 20000) + (baud < 10000)
    skipped = np.diff(numbers(packets))
    assert set(skipped.tolist()) <= set(range(1, at_most + 1))
    np.testing.assert_allclose(steps(packets), skipped * PERIOD_S / TICK_S % SPAN, atol=1.01)


def test_a_mode_change_in_a_stream_changes_the_packets_after_the_reply() -> None:
    source = Ramp()
    host = streaming(source)
    host.wait(1.0)
    host.send(Command.VOLTAGE_MODE)
    host.wait(1.0)
    host.send(Command.SCALED_MODE)
    host.wait(1.0)
    assert source.asked == sorted(source.asked)
    assert source.asked[-1] == pytest.approx(3 * LOOP_HZ, abs=2)


def test_words_saturate_at_sixteen_bits() -> None:
    """Rates beyond 1.5 times the range stay at the word's end."""
    host = bench(Ramp(rates_dps=(1e4, -1e4)))
    packet = host.poll()
    assert packet.rates[1:] == (32767, -32768)


def test_packets_end_with_the_recording() -> None:
    host = streaming(Ramp(length=10))
    assert numbers(host.packets(1.0)) == list(range(10))
    assert host.unit.ended
    assert host.unit.next_event(host.now) is None
    host.send(Command.GET_PACKET)
    assert host.wait(1.0) == b""
    assert host.ask(Command.PING) == ["H"]


def test_the_counter_starts_where_the_seed_says() -> None:
    """Two units of one seed agree, and a unit without a seed counts down from 0 at time 0."""

    def first_ticks(seed: int | None) -> int:
        host = Bench(VirtualUnit(Ramp(), seed=seed), now=0.0)
        return host.poll().ticks

    assert first_ticks(7) == first_ticks(7)
    assert first_ticks(None) == 0
    assert len({first_ticks(seed) for seed in range(5)}) == 5


# ----------------------------------------------------------------------------------------------------------------- ping


@pytest.mark.parametrize(
    ("ping", "mode", "streaming"),
    [("keeps", Mode.SCALED, True), ("stops", Mode.SCALED, False), ("resets", Mode.VOLTAGE, False)],
)
def test_a_ping_does_what_the_option_says(ping: str, mode: Mode, streaming: bool) -> None:
    """Three documents disagree on what `R` does besides answering, and a host must live with all three."""
    host = bench(options=UnitOptions(ping=ping))  # type: ignore[arg-type]
    host.send(Command.START_STREAM)
    host.wait(0.1)
    host.send(Command.PING)
    assert b"H" in host.wait(0.05)
    assert (host.unit.mode, host.unit.streaming) == (mode, streaming)


# ----------------------------------------------------------------------------------------------------------- zero rates


def test_zeroing_takes_its_time_and_then_removes_the_mean() -> None:
    """`z` x averages 10·x readings, answers when done, and subtracts their mean from the rates alone."""
    host = bench(Ramp(rates_dps=(1.0, -2.0)))
    before = host.poll()
    assert host.ask(zero_rates(30), seconds=299 * PERIOD_S - 0.01) == []
    assert host.wait(0.03) == b"Z"
    after = host.poll()
    assert after.rates[1:] == (0, 0)
    assert after.accels == before.accels


def test_zero_is_the_mean_of_the_readings_while_it_ran() -> None:
    source = Ramp()
    host = bench(source)
    host.send(zero_rates(2))
    host.wait(1.0)
    assert source.asked == list(range(20))
    packet = host.poll()
    assert packet.rates[0] == pytest.approx(source.asked[-1] - 9.5, abs=0.51)


def test_zeroing_again_replaces_the_zero_and_nought_erases_it() -> None:
    """The stored zero is never averaged into itself, and `z` 0 brings the raw rates back."""
    host = bench(Ramp(rates_dps=(1.0, -2.0)))
    raw = host.poll()
    for _ in range(2):
        host.send(zero_rates(1))
        assert host.wait(0.2) == b"Z"
        assert host.poll().rates[1:] == (0, 0)
    assert host.ask(zero_rates(0)) == ["Z"]
    assert host.poll().rates[1:] == raw.rates[1:]


def test_no_packets_come_while_the_rates_are_zeroed() -> None:
    source = Ramp()
    host = streaming(source)
    head = host.wait(0.1)
    host.send(zero_rates(10))
    assert len(head + host.wait(PACKET_S)) % PACKET_BYTES == 0
    assert host.wait(98 * PERIOD_S - PACKET_S) == b""
    line = host.wait(0.5)
    assert line[:2] == b"Z\xff"
    assert source.asked == list(range(len(source.asked)))


# ----------------------------------------------------------------------------------------------------------------- baud


def test_the_speed_changes_in_three_steps() -> None:
    host = bench()
    assert host.ask(Command.REQUEST_BAUD) == ["B"]
    host.baud = 9600
    assert host.ask(Command.MEASURE_BAUD) == ["A"]
    assert host.unit.baud == 9600
    assert host.ask(Command.PING) == ["H"]
    host.baud = 38400
    assert host.ask(Command.PING) == []


def test_a_wrong_speed_is_noise_both_ways() -> None:
    host = streaming()
    host.baud = 57600
    right = streaming()
    garbled, sent = host.wait(1.0), right.wait(1.0)
    assert len(garbled) == len(sent)
    assert not any(a == b for a, b in zip(garbled, sent, strict=True))
    host.send(Command.STOP_STREAM)
    assert host.unit.streaming


def test_a_slightly_wrong_speed_is_understood() -> None:
    host = Bench(VirtualUnit(Ramp()))
    for ratio, heard in ((1.02, ["H"]), (0.98, ["H"]), (1.04, []), (0.96, [])):
        host.baud = round(38400 * ratio)
        assert [event for event in host.ask(Command.PING) if not isinstance(event, Discarded)] == heard


@pytest.mark.parametrize("baud", [300, 12345, 230400])
def test_a_speed_that_is_none_is_not_taken(baud: int) -> None:
    host = bench()
    host.ask(Command.REQUEST_BAUD)
    host.baud = baud
    host.send(Command.MEASURE_BAUD)
    host.baud = 38400
    assert host.ask(Command.PING) == ["H"]


def test_the_unit_does_not_wait_for_the_new_speed_for_ever() -> None:
    host = bench()
    host.ask(Command.REQUEST_BAUD)
    host.wait(11.0)
    host.baud = 9600
    assert host.ask(Command.MEASURE_BAUD) == []
    assert host.unit.baud == 38400


# ------------------------------------------------------------------------------------------------- whatever may be sent


@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 0.2),
            st.lists(st.sampled_from([bytes(c) for c, _ in REPLIES] + [b"C", b"G", b"P", b"a", b"z\x01"])).map(b"".join)
            | st.binary(max_size=5),
            st.sampled_from([38400, 38400, 38400, 9600]),
        ),
        max_size=12,
    )
)
@settings(max_examples=150, deadline=None)
def test_looking_often_changes_nothing(script: list[tuple[float, bytes, int]]) -> None:
    often, seldom = VirtualUnit(Ramp()), VirtualUnit(Ramp())
    fetched, now = b"", 0.0
    for pause, data, baud in script:
        for part in range(1, 6):
            fetched += often.transmit(now + pause * part / 6, 38400)
            often.next_event(now + pause * part / 6)
        now += pause
        often.receive(data, now, baud)
        seldom.receive(data, now, baud)
    assert fetched + often.transmit(now + 1.0, 38400) == seldom.transmit(now + 1.0, 38400)

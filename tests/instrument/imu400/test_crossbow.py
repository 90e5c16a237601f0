"""The codec: one table of messages, both directions, in every cut and amid noise; then streams with faults."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imutui.instrument.counter_spec import SPAN
from imutui.instrument.counts import Scaling
from imutui.instrument.frame_search import Discarded, FrameDecoder
from imutui.instrument.imu400.crossbow import (
    PACKET_BYTES,
    TICK_S,
    Command,
    CommandDecoder,
    Mode,
    Packet,
    checksum,
    encode,
    framed,
    serial_number_frame,
    zero_rates,
)
from imutui.instrument.imu400.decoder import NOMINAL_PERIOD_S, Crossbow, packet_decoder, reply_decoder
from imutui.instrument.imu400.scaling import scaling as imu400cd_scaling

Event = Packet | str | Discarded

COMMANDS: list[tuple[bytes, bytes]] = [
    (Command.PING, b"R"),
    (Command.SCALED_MODE, b"c"),
    (Command.VOLTAGE_MODE, b"r"),
    (Command.STOP_STREAM, b"P"),
    (Command.START_STREAM, b"C"),
    (Command.GET_PACKET, b"G"),
    (Command.SERIAL_NUMBER, b"S"),
    (Command.VERSION, b"v"),
    (zero_rates(0x1E), b"z\x1e"),
    (zero_rates(ord("z")), b"zz"),
    (Command.REQUEST_BAUD, b"b"),
    (Command.MEASURE_BAUD, b"a"),
    (b"?", b"?"),
]

REPLIES: list[tuple[bytes, str, bytes]] = [
    (Command.PING, "H", b"H"),
    (Command.SCALED_MODE, "C", b"C"),
    (Command.VOLTAGE_MODE, "R", b"R"),
    (Command.SERIAL_NUMBER, "9911750", bytes.fromhex("FF 00 97 3D C6 9A")),
    (Command.VERSION, "IMU400CD-200 Rev 1.23 $$", b"\xffIMU400CD-200 Rev 1.23 $$\x5e"),
    (zero_rates(30), "Z", b"Z"),
    (Command.REQUEST_BAUD, "B", b"B"),
    (Command.MEASURE_BAUD, "A", b"A"),
]

SCALED, VOLTAGE = Mode.SCALED, Mode.VOLTAGE
PACKETS: list[tuple[Packet, bytes]] = [
    (
        Packet(SCALED, (384, -368, 5520), (144, -112, 5552), 1500, 0x1234),
        bytes.fromhex("FF 01 80 FE 90 15 90 00 90 FF 90 15 B0 05 DC 12 34 BF"),
    ),
    (
        Packet(SCALED, (0, 0, 0), (0, 0, 5461), 1587, 65535),
        bytes.fromhex("FF 00 00 00 00 00 00 00 00 00 00 15 55 06 33 FF FF A1"),
    ),
    (
        Packet(SCALED, (-1, -1, -1), (-1, -1, -1), 1587, 0),
        bytes.fromhex("FF FF FF FF FF FF FF FF FF FF FF FF FF 06 33 00 00 2D"),
    ),
    (
        Packet(SCALED, (21845, -21845, 32767), (21845, -21845, -32768), 1126, 0xFF00),
        bytes.fromhex("FF 55 55 AA AB 7F FF 55 55 AA AB 80 00 04 66 FF 00 65"),
    ),
    (
        Packet(VOLTAGE, (2048, 2048, 2048), (2048, 2048, 2867), 1587, 0xABCD),
        bytes.fromhex("FF 08 00 08 00 08 00 08 00 08 00 0B 33 06 33 AB CD 17"),
    ),
]

Expect = Callable[[], FrameDecoder[Packet | str]]


def _expect_reply(command: bytes) -> Expect:
    return lambda: reply_decoder(command)


def _expect_packets(mode: Mode, streaming: bool) -> Expect:
    return lambda: packet_decoder(mode, streaming=streaming)


FROM_UNIT = [
    pytest.param(_expect_reply(command), event, data, id=command.decode("latin-1")) for command, event, data in REPLIES
] + [
    pytest.param(_expect_packets(packet.mode, streaming), packet, data, id=f"vector {n} {kind}")
    for kind, streaming in (("polled", False), ("stream", True))
    for n, (packet, data) in enumerate(PACKETS, 1)
]

KNOWS_ITS_END = [case for case in FROM_UNIT if case.id != "v" and not str(case.id).endswith("stream")]

PERIOD_TICKS = NOMINAL_PERIOD_S / TICK_S
QUIET_NOISE = b"\x01\x02\x80"  # neither a header nor a letter


def decode(chunks: Iterable[bytes], expect: Expect) -> list[Event]:
    """Return the events of a fresh decoder after all chunks and a quiet line, adjacent discards joined."""
    decoder = expect()
    events = [event for chunk in chunks for event in decoder.feed(chunk)] + decoder.quiet()
    return joined(events)


def joined(events: Iterable[Event]) -> list[Event]:
    """Join discards that follow each other."""
    out: list[Event] = []
    for event in events:
        before = out[-1] if out else None
        if isinstance(event, Discarded) and isinstance(before, Discarded):
            out[-1] = Discarded(before.data + event.data, before.bad_checksum or event.bad_checksum)
        else:
            out.append(event)
    return out


def one_by_one(data: bytes) -> list[bytes]:
    """Cut `data` into single bytes."""
    return [bytes([byte]) for byte in data]


def packets_of(events: Iterable[Event]) -> list[Packet]:
    return [event for event in events if isinstance(event, Packet)]


def streaming_decoder(mode: Mode = SCALED) -> FrameDecoder[Packet]:
    """Return a decoder that has seen nothing and expects a stream."""
    return packet_decoder(mode, streaming=True)


def stream(length: int, seed: int = 0, period_ticks: float = PERIOD_TICKS, mode: Mode = SCALED) -> list[Packet]:
    """Make packets of a still unit near zero, whose words are full of 0xFF: the hardest to find one's place in."""
    rng = np.random.default_rng(seed)
    words = rng.normal(0.0, 20.0, (length, 6)).round().astype(int) + (0 if mode is SCALED else 2048)
    return [
        Packet(mode, (gx, gy, gz), (ax, ay, az), 1587, int(40000 - n * period_ticks) % SPAN)
        for n, (gx, gy, gz, ax, ay, az) in enumerate(words.tolist())
    ]


def on_the_line(packets: Sequence[Packet]) -> bytes:
    return b"".join(map(encode, packets))


# ------------------------------------------------------------------------------------------- the table, both directions


@pytest.mark.parametrize(("command", "data"), COMMANDS)
def test_a_command_is_its_bytes_in_both_directions(command: bytes, data: bytes) -> None:
    assert command == data
    assert CommandDecoder().feed(data) == [data]
    decoder = CommandDecoder()
    assert [seen for byte in one_by_one(data) for seen in decoder.feed(byte)] == [data]


def test_commands_follow_each_other_without_separators() -> None:
    line = b"".join(data for _, data in COMMANDS)
    for cut in range(len(line) + 1):
        decoder = CommandDecoder()
        assert decoder.feed(line[:cut]) + decoder.feed(line[cut:]) == [command for command, _ in COMMANDS]


@pytest.mark.parametrize(("expect", "event", "data"), FROM_UNIT)
def test_a_message_is_its_bytes_in_both_directions(expect: Expect, event: Event, data: bytes) -> None:
    assert not isinstance(event, Packet) or encode(event) == data
    assert decode(one_by_one(data), expect) == [event]
    for cut in range(len(data) + 1):
        assert decode([data[:cut], data[cut:]], expect) == [event]


@pytest.mark.parametrize(("expect", "event", "data"), FROM_UNIT)
def test_a_message_is_found_behind_noise(expect: Expect, event: Event, data: bytes) -> None:
    is_version = event == REPLIES[4][1]
    for noise in (QUIET_NOISE, b"\xff\x03" + QUIET_NOISE) if data[0] == 0xFF and not is_version else (QUIET_NOISE,):
        for chunks in ([noise, data], [noise + data], one_by_one(noise + data)):
            discarded, found = decode(chunks, expect)
            assert isinstance(discarded, Discarded)
            assert (discarded.data, found) == (noise, event)


@pytest.mark.parametrize(("expect", "event", "data"), KNOWS_ITS_END)
def test_noise_behind_a_message_is_noise(expect: Expect, event: Event, data: bytes) -> None:
    for chunks in ([data, QUIET_NOISE], [data + QUIET_NOISE], one_by_one(data + QUIET_NOISE)):
        assert decode(chunks, expect) == [event, Discarded(QUIET_NOISE, False)]


@pytest.mark.parametrize("packet", [packet for packet, _ in PACKETS])
def test_a_lone_packet_amid_noise_is_not_believed(packet: Packet) -> None:
    """In a stream, one frame in 256 is right by chance, and without a witness there is no telling."""
    line = QUIET_NOISE + encode(packet) + QUIET_NOISE
    assert decode([line], _expect_packets(packet.mode, True)) == [Discarded(line, False)]


@pytest.mark.parametrize("command", [Command.STOP_STREAM, Command.START_STREAM, Command.GET_PACKET])
def test_a_command_without_reply_is_not_waited_for(command: Command) -> None:
    with pytest.raises(KeyError):
        reply_decoder(command)


@pytest.mark.parametrize(
    "packet", [Packet(SCALED, (32768, 0, 0), (0, 0, 0), 0, 0), Packet(VOLTAGE, (-1, 0, 0), (0, 0, 0), 0, 0)]
)
def test_a_word_that_does_not_fit_the_line_is_refused(packet: Packet) -> None:
    """It raises instead of going out cut off."""
    with pytest.raises(ValueError, match="`packet`"):
        encode(packet)


# -------------------------------------------------------------------------------------------------------------- replies


SERIAL, TEXT = Command.SERIAL_NUMBER, "A" + chr(checksum(b"A")) + "CD"
DAMAGED = bytes.fromhex("FF 00 97 3D C7 9A")
HEARD: dict[str, tuple[bytes, bytes, list[Event], list[Event]]] = {
    # what it is, the command, what comes; events at once, and when the line is quiet
    "two replies": (Command.PING, b"HH", ["H", "H"], []),
    "a damaged serial number": (SERIAL, DAMAGED, [Discarded(DAMAGED, True)], []),
    # the manual promises a string and drivers saw a frame; both are read
    "text": (Command.VERSION, b"IMU400CD-200 1.2$", [], ["IMU400CD-200 1.2$"]),
    "text behind a header": (Command.VERSION, b"\xffIMU400CD-200 1.2$", [], ["IMU400CD-200 1.2$"]),
    "text and an end of line": (Command.VERSION, b"IMU400CD-200 1.2$\r\n", [], ["IMU400CD-200 1.2$"]),
    "a good sum in the middle, which does not end it": (Command.VERSION, framed(TEXT.encode()), [], [TEXT]),
    "the 255th byte ends it": (Command.VERSION, framed(b"V" * 253), ["V" * 253], []),
    "a damaged version": (Command.VERSION, b"\xffIMU\x0740\x01", [], [Discarded(b"\xffIMU\x0740\x01", True)]),
}


@pytest.mark.parametrize("name", HEARD)
def test_a_reply_is_believed_only_as_far_as_it_can_be(name: str) -> None:
    command, data, at_once, in_the_end = HEARD[name]
    decoder = reply_decoder(command)
    assert joined(decoder.feed(data)) == at_once
    assert joined(decoder.quiet()) == in_the_end
    bad = [event for event in (*at_once, *in_the_end) if isinstance(event, Discarded) and event.bad_checksum]
    assert decoder.bad_checksums == len(bad)
    if bad:
        assert decoder.feed(serial_number_frame(9911750))[:1] == ["9911750"] * (command is SERIAL)


@given(st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=1, max_size=30))
@settings(deadline=None)
def test_any_version_text_comes_through(text: str) -> None:
    assert decode([framed(text.encode())], _expect_reply(Command.VERSION)) == [text]


# -------------------------------------------------------------------------------------------------------------- streams


def test_a_stream_is_delivered_whole_and_in_order() -> None:
    sent = stream(200)
    for chunks in ([on_the_line(sent)], one_by_one(on_the_line(sent))):
        assert decode(chunks, _expect_packets(SCALED, True)) == sent


@pytest.mark.parametrize("cut_off", [0, 1, 7, PACKET_BYTES - 1])
def test_a_reply_that_was_asked_for_may_stand_between_packets(cut_off: int) -> None:
    reply, packets = serial_number_frame(9911750), stream(20)
    line = on_the_line(packets[:10]) + on_the_line(packets[10:11])[:cut_off] + reply + reply
    for cut in (lambda data: [data], one_by_one):
        search = Crossbow(SCALED, streaming=True)
        search.reply = reply
        decoder = FrameDecoder(search)
        events = [event for data in cut(line) for event in decoder.feed(data)]
        assert [event for event in events if not isinstance(event, Discarded)] == packets[:10]
        assert (decoder.answers, decoder.discarded_bytes) == (2, cut_off)
        assert decoder.feed(on_the_line(packets[11:])) == packets[11:]
        assert decoder.answers == 0


def test_a_packet_is_not_lost_to_the_reply_behind_it() -> None:
    """The first one after a silence has no witness but that reply: its counter says nothing of the packets before."""
    reply, packets = serial_number_frame(9911750), stream(60)
    line = on_the_line(packets[:10]) + on_the_line(packets[50:51]) + reply + on_the_line(packets[51:])

    def expect() -> FrameDecoder[Packet]:
        search = Crossbow(SCALED, streaming=True)
        search.reply = reply
        return FrameDecoder(search)

    for chunks in ([line], one_by_one(line)):
        assert decode(chunks, expect) == packets[:10] + packets[50:]


def test_a_locked_stream_has_no_latency() -> None:
    """The first packet waits for the second as its witness; from then on each comes with its last byte."""
    decoder = streaming_decoder()
    first, second, *others = stream(20)
    assert decoder.feed(encode(first)) == []
    assert decoder.feed(encode(second)) == [first, second]
    for packet in others:
        assert decoder.feed(encode(packet)[:-1]) == []
        assert decoder.feed(encode(packet)[-1:]) == [packet]


def test_reading_what_is_missing_ends_each_read_with_a_packet() -> None:
    """A reader that joins in mid-packet and asks for `missing` bytes soon gets one packet with every read."""
    sent = stream(40)
    line = on_the_line(sent)[7:]
    decoder = streaming_decoder()
    at, per_read = 0, []
    while at < len(line):
        assert 1 <= decoder.missing <= PACKET_BYTES
        chunk = line[at : at + decoder.missing]
        at += len(chunk)
        per_read.append(packets_of(decoder.feed(chunk)))
    assert per_read[-30:] == [[packet] for packet in sent[-30:]]


@pytest.mark.parametrize(("expect", "event", "data"), FROM_UNIT)
def test_missing_is_never_more_than_a_message_still_has(expect: Expect, event: Event, data: bytes) -> None:
    decoder = expect()
    for at, byte in enumerate(one_by_one(data)):
        assert 1 <= decoder.missing <= 18
        if event != REPLIES[4][1]:
            assert decoder.missing <= len(data) - at
        decoder.feed(byte)


def test_a_bad_checksum_costs_one_packet() -> None:
    sent = stream(10)
    for at in range(1, PACKET_BYTES):
        line = [bytearray(encode(packet)) for packet in sent]
        line[5][at] ^= 0x40
        decoder = streaming_decoder()
        events = [event for data in line for event in decoder.feed(bytes(data))]
        assert joined(events) == [*sent[:5], Discarded(bytes(line[5]), True), *sent[6:]]
        assert decoder.bad_checksums == 1
        assert decoder.discarded_bytes == PACKET_BYTES


def test_each_damaged_packet_is_counted() -> None:
    sent = stream(12)
    line = [bytearray(encode(packet)) for packet in sent]
    line[5][3] ^= 1
    line[6][9] ^= 1
    decoder = streaming_decoder()
    events = decoder.feed(b"".join(line))
    assert packets_of(events) == sent[:5] + sent[7:]
    assert decoder.bad_checksums == 2


def test_noise_before_the_first_packet_is_no_bad_checksum() -> None:
    sent = stream(10, seed=3)
    decoder = streaming_decoder()
    assert packets_of(decoder.feed(on_the_line(sent)[5:])) == sent[1:]
    assert decoder.bad_checksums == 0
    assert decoder.discarded_bytes == PACKET_BYTES - 5


def test_good_packets_between_noise_are_found() -> None:
    """Once two came back to back, packets follow by their counters."""
    sent = stream(30)
    noise = b"\x00\xff\x17" * 3
    line = encode(sent[0]) + b"".join(encode(packet) + noise for packet in sent[1:])
    events = decode([line], _expect_packets(SCALED, True))
    assert packets_of(events) == sent
    assert {event for event in events if isinstance(event, Discarded)} == {Discarded(noise, False)}


def _losses() -> Iterator[Any]:
    """Bytes of a stream of which some are lost, and the packets that are left."""
    sent = stream(40, seed=8)
    for at in range(PACKET_BYTES):
        data = encode(sent[5])
        line = on_the_line(sent[:5]) + data[:at] + data[at + 1 :] + on_the_line(sent[6:])
        yield pytest.param(line, sent[:5] + sent[6:], id=f"byte {at}")
    for lost in range(1, 6):  # as an overrun leaves it
        yield pytest.param(
            on_the_line(sent[:10] + sent[10 + lost :]), sent[:10] + sent[10 + lost :], id=f"{lost} whole"
        )
    every_other = b"".join(encode(packet)[: 18 if n % 2 else 11] for n, packet in enumerate(sent[2:]))
    yield pytest.param(on_the_line(sent[:2]) + every_other, sent[:2] + sent[3::2], id="of every other")


@pytest.mark.parametrize(("line", "left"), list(_losses()))
def test_a_loss_costs_no_packet_but_its_own(line: bytes, left: list[Packet]) -> None:
    assert packets_of(decode([line], _expect_packets(SCALED, True))) == left


@pytest.mark.parametrize(
    "ticks_of",
    [lambda n: 777, lambda n: n, lambda n: n * n * 7919 % SPAN, lambda n: n * 9494 % SPAN],
    ids=["stuck", "by one", "irregular", "upwards"],
)
def test_a_strange_counter_loses_nothing(ticks_of: Callable[[int], int]) -> None:
    """A unit whose counter means nothing is read all the same: then packets back to back are the witness."""
    sent = [Packet(p.mode, p.rates, p.accels, p.temperature, ticks_of(n)) for n, p in enumerate(stream(51))]
    for chunks in ([on_the_line(sent)], [encode(packet) for packet in sent]):
        assert decode(chunks, _expect_packets(SCALED, True)) == sent


@pytest.mark.parametrize("period_s", [4.6875e-3, 9.375e-3, 18.75e-3, 37.5e-3, 0.15])
def test_the_period_is_learned_again_after_a_change_of_speed(period_s: float) -> None:
    decoder = streaming_decoder()
    fast, slow = stream(20), stream(20, period_ticks=period_s / TICK_S)
    assert packets_of(decoder.feed(on_the_line(fast))) == fast
    events = [decoder.feed(encode(packet)) for packet in slow]
    assert [packet for received in events for packet in received] == slow
    assert events[2:] == [[packet] for packet in slow[2:]]


def test_a_line_slower_than_the_loop_has_no_latency() -> None:
    """At 9600 baud a packet shows the newest sample, two or three periods after the last: neither is a surprise."""
    decoder = streaming_decoder()
    every_sample = stream(60)
    sent = [every_sample[n * 5 // 2] for n in range(20)]
    events = [decoder.feed(encode(packet)) for packet in sent]
    assert events[2:] == [[packet] for packet in sent[2:]]


@pytest.mark.parametrize("release", [FrameDecoder.quiet, FrameDecoder.pause])
def test_a_line_that_falls_quiet_releases_a_packet_that_waits_for_its_witness(release: Callable[..., Event]) -> None:
    decoder = streaming_decoder()
    packet = PACKETS[2][0]
    assert decoder.feed(encode(packet)) == []
    assert release(decoder) == [packet]
    assert release(decoder) == []


def test_quiet_discards_a_packet_that_was_cut_off() -> None:
    decoder = streaming_decoder()
    first, second, third, fourth = stream(4)
    decoder.feed(on_the_line([first, second]))
    assert decoder.feed(encode(third)[:9]) == []
    assert decoder.quiet() == [Discarded(encode(third)[:9], False)]
    assert decoder.feed(encode(fourth)) == [fourth]


def test_a_packet_may_pause_in_its_middle() -> None:
    for cut in range(1, PACKET_BYTES):
        decoder = streaming_decoder()
        first, second, third, fourth = stream(4)
        decoder.feed(on_the_line([first, second]))
        assert decoder.feed(encode(third)[:cut]) == []
        assert decoder.pause() == decoder.pause() == []
        assert decoder.feed(encode(third)[cut:]) == [third]
        assert decoder.feed(encode(fourth)) == [fourth]
        assert decoder.discarded_bytes == decoder.bad_checksums == 0


def test_a_packet_that_pauses_for_ever_costs_none_of_those_behind_it() -> None:
    """If something else comes than its rest, its sum is wrong, and the next packet is found all the same."""
    decoder = streaming_decoder()
    sent = stream(8)
    decoder.feed(on_the_line(sent[:2]))
    decoder.feed(encode(sent[2])[:9])
    decoder.pause()
    assert packets_of(decoder.feed(on_the_line(sent[4:]))) == sent[4:]
    assert decoder.discarded_bytes == 9
    assert decoder.bad_checksums == 1


def test_a_polled_packet_needs_no_witness() -> None:
    decoder = packet_decoder(SCALED, streaming=False)
    for packet in stream(5, period_ticks=31234.5):
        assert decoder.feed(encode(packet)) == [packet]


def test_a_damaged_polled_packet_is_counted_each_time() -> None:
    """On a quiet line the packet is due with the first byte, so that even the first damaged one counts."""
    decoder = packet_decoder(SCALED, streaming=False)
    damaged = b"\xff" + bytes(16) + b"\x01"
    for n in range(1, 4):
        assert joined(decoder.feed(damaged) + decoder.quiet()) == [Discarded(damaged, True)]
        assert decoder.bad_checksums == n
        assert decoder.feed(PACKETS[0][1]) == [PACKETS[0][0]]


# --------------------------------------------------------------------------------------------------- whatever may come


@st.composite
def troubled_lines(draw: st.DrawFn) -> bytes:
    """Draw a stream of packets in which some are cut, damaged, missing or among noise."""
    line = b""
    noise = st.lists(st.sampled_from([0xFF, 0xFF, 0x00, 0x48, 0x5A]) | st.integers(0, 255), max_size=40).map(bytes)
    for packet in stream(draw(st.integers(0, 12)), seed=draw(st.integers(0, 99))):
        data = bytearray(encode(packet))
        match draw(st.sampled_from(["good", "good", "good", "flip", "cut", "missing", "noise"])):
            case "flip":
                data[draw(st.integers(0, 17))] ^= 1 << draw(st.integers(0, 7))
            case "cut":
                del data[draw(st.integers(0, 17))]
            case "missing":
                data.clear()
            case "noise":
                data += draw(noise)
        line += bytes(data)
    return line


EXPECTATIONS = [_expect_packets(mode, streaming) for mode in Mode for streaming in (False, True)]
EXPECTATIONS += [_expect_reply(command) for command, _, _ in REPLIES]


@given(data=st.data(), line=troubled_lines() | st.binary(max_size=300), expect=st.sampled_from(EXPECTATIONS))
@settings(max_examples=400, deadline=None)
def test_events_do_not_depend_on_how_bytes_are_cut(data: st.DataObject, line: bytes, expect: Expect) -> None:
    cuts = [0, *sorted(data.draw(st.lists(st.integers(0, len(line)), max_size=20))), len(line)]
    pieces = [line[a:b] for a, b in pairwise(cuts)]
    whole = decode([line], expect)
    assert decode(pieces, expect) == whole
    assert decode(one_by_one(line), expect) == whole
    if packets_of(whole) or all(isinstance(event, Discarded) for event in whole):
        found = [e for e in whole if not isinstance(e, str)]
        assert line == b"".join(e.data if isinstance(e, Discarded) else encode(e) for e in found)


@given(st.lists(st.binary(max_size=40), max_size=10))
@settings(deadline=None)
def test_no_bytes_upset_the_unit(pieces: list[bytes]) -> None:
    decoder = CommandDecoder()
    line = b"".join(pieces)
    written = b"".join(command for piece in pieces for command in decoder.feed(piece))
    assert line.removesuffix(b"z") == written.removesuffix(b"z")


@pytest.mark.parametrize("unit", [b"\xff", b"\xff" + bytes(18), b"\x00\xff\x13", b"noise"])
def test_little_is_held_however_much_comes(unit: bytes) -> None:
    decoder = streaming_decoder()
    line = unit * (200_000 // len(unit))
    events = decoder.feed(line)
    accounted = decoder.discarded_bytes + PACKET_BYTES * len(packets_of(events))
    assert len(line) - 200 <= accounted <= len(line)


def _lose_a_byte(rng: np.random.Generator, data: bytearray) -> None:
    del data[rng.integers(PACKET_BYTES)]


def _flip_a_bit(rng: np.random.Generator, data: bytearray) -> None:
    data[rng.integers(PACKET_BYTES)] ^= 1 << int(rng.integers(8))


@pytest.mark.parametrize("spoil", [_lose_a_byte, _flip_a_bit])
def test_thousands_of_faults_cost_a_handful_of_packets(spoil: Callable[[np.random.Generator, bytearray], None]) -> None:
    """Of 4000 faults in a still unit's stream at most 8 cost a good packet or let in a wrong one (measured: 1 to 5)."""
    rng = np.random.default_rng(2007)
    spacing, faults = 8, 4000
    sent = stream(spacing * faults, seed=1)
    line = [bytearray(encode(packet)) for packet in sent]
    for n in range(faults):
        spoil(rng, line[spacing * n + 4])
    received = Counter(packets_of(decode([b"".join(line)], _expect_packets(SCALED, True))))
    good = Counter(packet for n, packet in enumerate(sent) if n % spacing != 4)
    assert (good - received).total() <= 8
    assert (received - good).total() <= 8


# ---------------------------------------------------------------------------------------------------------------- units

LSB_DPS, LSB_G = 300 / 2**15, 6 / 2**15


@pytest.mark.parametrize(
    ("packet", "rates_dps", "accels_g", "degc"),
    [
        (PACKETS[0][0], (3.515625, -3.369141, 50.537109), (0.026367, -0.020508, 1.016602), 20.249),
        (PACKETS[1][0], (0, 0, 0), (0, 0, 0.999939), 24.964),
        (PACKETS[2][0], (-LSB_DPS,) * 3, (-LSB_G,) * 3, 24.964),
        (PACKETS[3][0], (199.996948, -199.996948, 299.990845), (3.999939, -3.999939, -6.0), -0.022),
    ],
)
def test_scaled_vectors_have_their_engineering_values(
    packet: Packet, rates_dps: tuple[float, ...], accels_g: tuple[float, ...], degc: float
) -> None:
    """Counts become deg/s, g and degC by the maker's factors for ±200 deg/s and ±4 g."""
    scaling = imu400cd_scaling()
    np.testing.assert_allclose(scaling.rates_dps(packet.rates), rates_dps, atol=1e-6)
    np.testing.assert_allclose(scaling.accels_g(packet.accels), accels_g, atol=1e-6)
    assert float(scaling.temperature_degc(packet.temperature)) == pytest.approx(degc, abs=1e-3)


def test_scaling_keeps_the_shape_it_is_given() -> None:
    scaling = imu400cd_scaling(rate_range_dps=100.0, accel_range_g=2.0)
    assert float(scaling.rates_dps(32767)) == pytest.approx(150.0, rel=1e-4)
    rows = scaling.accels_g(np.array([[1, 2, 3], [4, 5, 6]], np.int16))
    assert rows.shape == (2, 3)
    assert rows.dtype == np.float64


@given(
    st.integers(-32768, 32767),
    st.integers(0, 4095),
    st.sampled_from([imu400cd_scaling(), imu400cd_scaling(100.0, 2.0)]),
)
@settings(deadline=None)
def test_units_lead_back_to_the_same_counts(word: int, temperature: int, scaling: Scaling) -> None:
    assert scaling.rate_counts(scaling.rates_dps(word)) == word
    assert scaling.accel_counts(scaling.accels_g(word)) == word
    assert scaling.temperature_counts(scaling.temperature_degc(temperature)) == temperature


def test_values_beyond_the_word_are_clipped() -> None:
    """A sensor driven past its word stays at the word's end instead of wrapping round."""
    scaling = imu400cd_scaling()
    assert scaling.rate_counts((1e6, -1e6, 0.4 * LSB_DPS)).tolist() == [32767, -32768, 0]
    assert scaling.accel_counts((7.0, -7.0, 0.6 * LSB_G)).tolist() == [32767, -32768, 1]
    assert scaling.temperature_counts((1000.0, -1000.0)).tolist() == [4095, 0]

"""The codec of the 440, 380 and 381: printed vectors, a recorded stream, every cut, and frames amid noise.

Frames of a real unit are from Scale1.raw, Copyright Aceinna, Inc., of the python-openimu project, Apache License 2.0.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imutui.instrument.frame_search import Discarded
from imutui.instrument.uut.decoder import Decoder, RequestDecoder, frame_decoder
from imutui.instrument.uut.frames import Frame, crc16, framed
from imutui.instrument.uut.messages import (
    PING,
    REFUSED,
    RESET,
    SCALING,
    PacketS0,
    PacketS1,
    encode,
    identification,
    names_of_bits,
    numbers,
    numbers_in,
    pairs,
    pairs_in,
)

Event = PacketS1 | Frame | Discarded

REQUESTS: list[tuple[Frame, str]] = [
    (PING, "5555504b009ef4"),
    (Frame(b"GP", b"ID"), "55554750024944233d"),
    (Frame(b"GP", b"VR"), "555547500256524287"),
    (Frame(b"GP", b"S1"), "55554750025331e1b7"),
    (Frame(b"CH", b"A"), "5555434801412488"),
    (RESET, "55555352007e4f"),
    (Frame(b"SF", pairs(((1, 0),))), "555553460501000100004081"),
    (Frame(b"SF", pairs(((1, 1),))), "5555534605010001000150a0"),
    (Frame(b"SF", pairs(((1, 5),))), "555553460501000100051024"),
    (Frame(b"GF", numbers((1, 2, 3))), "5555474607030001000200030480"),
    (Frame(b"RF", numbers((1,))), "5555524603010001aaca"),
    (Frame(b"WF", pairs(((1, 2),))), "555557460501000100026fae"),
]
REPLIES: list[tuple[Frame, str]] = [
    (Frame(b"VR", bytes((10, 0, 1, 0, 0))), "55555652050a00010000127d"),
    (Frame(b"SF", numbers((1,))), "5555534603010001ef6a"),
    (Frame(b"GF", pairs(((1, 0), (2, 3), (3, 0x5331)))), "555547460d030001000000020003000353318dc2"),
    (Frame(b"RF", pairs(((1, 1),))), "555552460501000100011773"),
    (Frame(b"WF", numbers((1,))), "5555574603010001e9cb"),
    (Frame(REFUSED, b"SF"), "555515150253466caf"),
    (Frame(REFUSED, b"GP"), "55551515024750d1ef"),
]

# frame, accel g, rate deg/s, temperatures of rate sensors and board degC, counter
REAL = [
    ("5555533118ffe000160cc0fffefff9ffff27eb27eb27eb27f728f5000223bc", (-0.009766, 0.006714, 0.996094),
     (-0.03845, -0.13458, -0.01923), (31.1859, 31.2225), 10485),
    ("5555533118ffe000150ccb0001fffb000027f827f827f827f8f5c20002066c", (-0.009766, 0.006409, 0.999451),
     (0.01923, -0.09613, 0.0), (31.2256, 31.2256), 62914),
    ("5555533118ffe500140cc5fffdfffa000327f827f827f827f8028f0002c2ea", (-0.008240, 0.006104, 0.997620),
     (-0.05768, -0.11536, 0.05768), (31.2256, 31.2256), 655),
    ("5555533118ffde00120c9efffefffafffe27fd27fd27fd27f968f50002fb39", (-0.010376, 0.005493, 0.985718),
     (-0.03845, -0.11536, -0.03845), (31.2408, 31.2286), 26869),
    ("5555533118ffe400120cc8fffafff9fffe27fa27fa27fa27fd35c20002c8d6", (-0.008545, 0.005493, 0.998535),
     (-0.11536, -0.13458, -0.03845), (31.2317, 31.2408), 13762),
]  # fmt: skip
REAL_BYTES = [bytes.fromhex(each[0]) for each in REAL]
MAGNETIC = PacketS0((1, 2, 3), (-1, -2, -3), (4, 5, 6), -7, 65535, 0xFFFF, (32767, -32768, 0))
OTHERS: list[PacketS1 | Frame] = [
    PING,
    RESET,
    Frame(b"CH", bytes(range(255))),
    Frame(b"ID", (2008705635).to_bytes(4) + b"IMU381ZA-400 5020-1383-01 10.00.01"),
    MAGNETIC,
    Frame(b"S2", bytes(28)),
    Frame(b"A1", bytes(32)),
    Frame(b"z1", b"\x55\x55\x55"),
]
MESSAGES: list[PacketS1 | Frame] = [message for message, _ in REPLIES] + OTHERS
STREAM = b"".join([*map(encode, MESSAGES), *REAL_BYTES])


def decoded(pieces: Sequence[bytes]) -> tuple[list[Event], Decoder]:
    """All events of bytes cut so, the line quiet at their end."""
    decoder = Decoder()
    events = [event for piece in pieces for event in decoder.feed(piece)]
    return events + decoder.quiet(), decoder


def kept(events: Sequence[Event]) -> list[Event]:
    """Events but discarded bytes."""
    return [event for event in events if not isinstance(event, Discarded)]


def discarded(events: Sequence[Event]) -> bytes:
    """All bytes that were discarded."""
    return b"".join(event.data for event in events if isinstance(event, Discarded))


@pytest.mark.parametrize(("request_", "text"), REQUESTS)
def test_requests_are_written_and_read_as_printed(request_: Frame, text: str) -> None:
    data = bytes.fromhex(text)
    assert encode(request_) == data
    assert kept(RequestDecoder().feed(data)) == [request_]
    decoder = RequestDecoder()
    assert kept([each for byte in data for each in decoder.feed(bytes([byte]))]) == [request_]


@pytest.mark.parametrize(("reply", "text"), REPLIES)
def test_replies_are_written_and_read_as_printed(reply: Frame, text: str) -> None:
    assert encode(reply) == bytes.fromhex(text)
    assert decoded([bytes.fromhex(text)])[0] == [reply]


@pytest.mark.parametrize("message", OTHERS, ids=lambda message: type(message).__name__)
def test_a_message_comes_back_from_its_bytes(message: PacketS1 | Frame) -> None:
    assert decoded([encode(message)])[0] == [message]


@pytest.mark.parametrize(("text", "accel", "rate", "temperatures", "counter"), REAL)
def test_frames_of_a_real_unit_have_their_values(
    text: str, accel: tuple[float, ...], rate: tuple[float, ...], temperatures: tuple[float, float], counter: int
) -> None:
    (packet,) = decoded([bytes.fromhex(text)])[0]
    assert isinstance(packet, PacketS1)
    assert SCALING.accels_g(packet.accels) == pytest.approx(accel, abs=1e-6)
    assert SCALING.rates_dps(packet.rates) == pytest.approx(rate, abs=1e-5)
    assert SCALING.temperature_degc(packet.rate_temperatures) == pytest.approx([temperatures[0]] * 3, abs=1e-4)
    assert SCALING.temperature_degc(packet.board_temperature) == pytest.approx(temperatures[1], abs=1e-4)
    assert (packet.counter, packet.bit) == (counter, 0x0002)
    assert encode(packet) == bytes.fromhex(text)


def test_a_recorded_stream_is_decoded_whole(recording: Callable[[str], Path]) -> None:
    """1002 frames, no byte left over, and the numbers that others made of them."""
    raw = recording("aceinna_imu381_scale1.raw").read_bytes()
    with np.load(recording("aceinna_imu381_s1_static.npz")) as known:
        accel, rate, temperatures = known["accel"], known["gyro"], known["temps"]
    events, decoder = decoded([raw[start : start + 50] for start in range(0, len(raw), 50)])
    packets = [event for event in events if isinstance(event, PacketS1)]
    assert (len(packets), len(events), decoder.discarded_bytes, decoder.bad_checksums) == (1002, 1002, 0, 0)
    assert np.array_equal(SCALING.accels_g([p.accels for p in packets]).astype(np.float32), accel)
    assert np.array_equal(SCALING.rates_dps([p.rates for p in packets]).astype(np.float32), rate)
    counts = [[*p.rate_temperatures, p.board_temperature] for p in packets]
    assert np.array_equal(SCALING.temperature_degc(counts).astype(np.float32), temperatures)


def test_a_damaged_recording_keeps_every_whole_frame(recording: Callable[[str], Path]) -> None:
    """Bits turned, bytes cut out and put in, anywhere: what is not touched is found, in order, and nothing else."""
    raw = recording("aceinna_imu381_scale1.raw").read_bytes()
    frames = [raw[start : start + 31] for start in range(0, len(raw), 31)]
    rng = np.random.default_rng(7)
    damaged = set(rng.choice(1002, 300, replace=False).tolist())
    line = b"".join(_spoilt(frame, rng) if k in damaged else frame for k, frame in enumerate(frames))
    events, _ = decoded([line])
    got = [encode(event) for event in kept(events) if isinstance(event, PacketS1)]
    assert got == [frame for k, frame in enumerate(frames) if k not in damaged]


def _spoilt(frame: bytes, rng: np.random.Generator) -> bytes:
    place, what = int(rng.integers(31)), int(rng.integers(3))
    if what == 0:
        return frame[:place] + bytes([frame[place] ^ 1 << int(rng.integers(8))]) + frame[place + 1 :]
    return frame[:place] + rng.bytes(1) * (what == 1) + frame[place + 1 - (what == 1) * (place > 0) :]


def test_the_crc_is_that_of_the_documents() -> None:
    """The initial value that fits the form without two zero bytes behind the message; the other one gives 4364."""
    assert crc16(b"PK\0") == 0x9EF4


def test_events_do_not_depend_on_a_cut() -> None:
    whole = decoded([STREAM])[0]
    assert not [cut for cut in range(len(STREAM)) if decoded([STREAM[:cut], STREAM[cut:]])[0] != whole]


def test_events_come_byte_by_byte_at_their_last_byte() -> None:
    decoder, ends = Decoder(), []
    for place, byte in enumerate(STREAM):
        ends += [place + 1 for _ in decoder.feed(bytes([byte]))]
        assert 1 <= decoder.missing <= 262
        assert len(decoder._held) < 262
    lengths = [len(encode(m)) for m in MESSAGES] + [31] * len(REAL_BYTES)
    assert ends == np.cumsum(lengths).tolist()


def test_a_reader_is_told_how_many_bytes_to_wait_for() -> None:
    decoder = Decoder()
    assert decoder.missing == 7
    decoder.feed(REAL_BYTES[0])
    assert decoder.missing == 31
    decoder.feed(REAL_BYTES[1][:20])
    assert decoder.missing == 11


def test_a_preamble_behind_an_0x55_is_found() -> None:
    decoder = Decoder()
    events = decoder.feed(b"\x55" + REAL_BYTES[0]) + decoder.pause()
    assert events == [Discarded(b"\x55", bad_checksum=False), *decoded([REAL_BYTES[0]])[0]]


@pytest.mark.parametrize(
    "noise", [b"\x55\x55", b"\x55\x55S1\xff", b"\x55\x55z1\xff\x55", b"\x55\x55\x01\x02\x03\x55\x55"]
)
def test_a_false_beginning_costs_no_frame(noise: bytes) -> None:
    """The frames behind it come when what it seems to be would be whole, or when the line pauses."""
    decoder, behind = Decoder(), REAL_BYTES * 2
    events = decoder.feed(noise + b"".join(behind))
    assert kept(events) == decoded(behind)[0]
    assert discarded(events) == noise
    decoder = Decoder()
    assert kept(decoder.feed(noise + REAL_BYTES[0]) + decoder.pause()) == decoded(behind[:1])[0]


def test_a_pause_releases_what_noise_seems_to_cover() -> None:
    decoder = Decoder()
    assert decoder.feed(b"\x55\x55ID\xf0" + REAL_BYTES[0] + REAL_BYTES[1][:9]) == []
    assert kept(decoder.pause()) == decoded([REAL_BYTES[0]])[0]
    assert kept(decoder.feed(REAL_BYTES[1][9:])) == decoded([REAL_BYTES[1]])[0]


def test_a_wrong_crc_is_counted_where_a_frame_was_due() -> None:
    spoilt = REAL_BYTES[1][:-1] + b"\0"
    events, decoder = decoded([b"noise" + spoilt + REAL_BYTES[0] + spoilt + spoilt + REAL_BYTES[2]])
    assert decoder.bad_checksums == 2
    assert decoder.discarded_bytes == 5 + 3 * 31
    noise = [event for event in events if isinstance(event, Discarded)]
    assert [event.bad_checksum for event in noise] == [False, True]


@pytest.mark.parametrize("after", [b"", b"\x01", REAL_BYTES[0], encode(PING)])
def test_a_ping_may_be_bare(after: bytes) -> None:
    """Four bytes for a host too, whatever follows them; a unit need not wait for that."""
    assert RequestDecoder().feed(b"UUPK") == [PING]
    events = kept(decoded([b"UUPK" + after])[0])
    assert events == [PING, *kept(decoded([after])[0])]


def test_a_payload_that_is_not_its_types_lists_nothing() -> None:
    for payload in (b"", b"\0", b"\1", b"\x02\0\1\0", b"\1\0\1\0\0\0"):
        assert numbers_in(payload) == pairs_in(payload) == ()
        assert decoded([framed(Frame(b"SF", payload))])[0] == [Frame(b"SF", payload)]
    assert pairs_in(numbers((1, 2))) == numbers_in(pairs(((1, 2),))) == ()


def test_a_text_ends_with_a_zero_or_not_and_need_not_be_ascii() -> None:
    for end in (b"", b"\0"):
        assert identification(b"\0\0\1\0IMU381ZA 1\xff" + end) == ("256", "IMU381ZA 1\\xff")


def test_what_no_frame_has_is_refused() -> None:
    for frame in (Frame(b"CH", bytes(256)), Frame(b"CHA")):
        with pytest.raises(ValueError, match=r"type|payload"):
            framed(frame)


def test_status_bits_have_names() -> None:
    assert names_of_bits(0x0002) == ("hardware error",)
    assert names_of_bits(0x9021) == ("master fail", "reserved 5", "sensor status", "reserved 15")


BITS = st.lists(st.sampled_from([b"\x55", b"\x55\x55", b"S1\x18", b"UUPK", b"UUS1", b"UUCH", b"\0"]), max_size=4)
NOISE = st.one_of(st.binary(max_size=40), BITS.map(b"".join))


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(NOISE, st.sampled_from(REAL_BYTES)), max_size=6), NOISE, st.lists(st.integers(0, 400)))
def test_good_frames_between_noise_are_all_found(line: list[tuple[bytes, bytes]], rest: bytes, cuts: list[int]) -> None:
    """However it is cut: the frames in order, every other byte told as discarded or part of something else."""
    data = b"".join(noise + frame for noise, frame in line) + rest
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    events, decoder = decoded([data[a:b] for a, b in pairwise(edges)])
    assert [encode(e) for e in events if isinstance(e, PacketS1)] == [frame for _, frame in line]
    assert len(discarded(events)) == decoder.discarded_bytes
    assert kept(events) == kept(decoded([data])[0])


@settings(max_examples=100, deadline=None)
@given(st.lists(st.binary(max_size=60), max_size=8))
def test_no_bytes_raise(pieces: list[bytes]) -> None:
    search, told = frame_decoder(lambda frame: frame), b""
    for piece in pieces:
        for found in [*search.feed(piece), *search.pause()]:
            told += found.data if isinstance(found, Discarded) else b"UUPK" if found.type == b"PK" else framed(found)
        assert len(search._held) < 262
    decoder, requests = Decoder(), RequestDecoder()
    for piece in pieces:
        decoder.feed(piece)
        requests.feed(piece)
    decoder.quiet()
    requests.quiet()
    assert b"".join(pieces).startswith(told)

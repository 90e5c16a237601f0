"""A faulty line: which bytes arrive, which don't, and when."""

import itertools
import math

import pytest
from helpers.faulty_lines import FaultyLine, LineFault

from filters.imu import LOOP_HZ
from imutui.instrument.frame_search import Discarded
from imutui.instrument.imu400.crossbow import PACKET_BYTES, Mode, Packet, encode
from imutui.instrument.imu400.decoder import packet_decoder
from imutui.instrument.transmitter import transfer_s

Event = Packet | str | Discarded

PACKET_S = transfer_s(PACKET_BYTES, 38400)
COUNT = 400


def packets() -> list[bytes]:
    return [encode(Packet(Mode.SCALED, (n, -n, 3), (1, 2, 3), 100, n)) for n in range(COUNT)]


def sent_through(line: FaultyLine, first_request: float = 50.0) -> bytes:
    """All that arrives of packets that leave at the loop's rate after the first request."""
    line.start(first_request)
    out = b""
    for n, message in enumerate(packets()):
        sent = first_request + n / LOOP_HZ
        line.put(message, sent, sent + PACKET_S, packet_bytes=PACKET_BYTES)
        out += line.take(sent + PACKET_S)
    return out + line.take(first_request + COUNT)


def events(data: bytes) -> list[Event]:
    decoder = packet_decoder(Mode.SCALED, streaming=True)
    return [*decoder.feed(data), *decoder.quiet()]


def arrived(data: bytes) -> list[int]:
    """Numbers of the packets that a decoder finds."""
    return [event.ticks for event in events(data) if isinstance(event, Packet)]


def test_a_line_without_faults_changes_nothing() -> None:
    assert sent_through(FaultyLine(())) == b"".join(packets())


def test_dropped_bytes_are_the_next_ones() -> None:
    data = sent_through(FaultyLine((LineFault(1.0, "drop_bytes", count=7),)))
    first = next(n for n in range(COUNT) if n / LOOP_HZ + PACKET_S >= 1.0)
    whole = b"".join(packets())
    assert data == whole[: 18 * first] + whole[18 * first + 7 :]
    assert arrived(data) == [n for n in range(COUNT) if n != first]


def test_dropped_bytes_reach_over_packets() -> None:
    data = sent_through(FaultyLine((LineFault(1.0, "drop_bytes", count=40),)))
    assert len(data) == 18 * COUNT - 40
    assert COUNT - len(arrived(data)) == 3


def test_garbage_comes_in_between() -> None:
    faults = (LineFault(1.0, "garbage", count=100),)
    data = sent_through(FaultyLine(faults, seed=1))
    assert len(data) == 18 * COUNT + 100
    assert len(arrived(data)) >= COUNT - 1
    assert any(isinstance(event, Discarded) for event in events(data))
    assert data == sent_through(FaultyLine(faults, seed=1))
    assert data != sent_through(FaultyLine(faults, seed=2))


def test_turned_bits_cost_a_packet_each() -> None:
    data, whole = sent_through(FaultyLine((LineFault(2.0, "bit_flips", count=3),))), b"".join(packets())
    wrong = [(a ^ b).bit_count() for a, b in zip(data, whole, strict=True)]
    assert sum(wrong) == 3
    assert len({n // 18 for n, bits in enumerate(wrong) if bits}) == 3


def test_silence_lasts_its_seconds() -> None:
    """Packets that end within half a second from 1 s on never arrive."""
    numbers = arrived(sent_through(FaultyLine((LineFault(1.0, "silence", seconds=0.5),))))
    assert numbers == [n for n in range(COUNT) if not 1.0 <= n / LOOP_HZ + PACKET_S < 1.5]


def test_what_was_measured_at_a_time_can_be_lost_or_late() -> None:
    line = FaultyLine((), lambda t: (round(t * LOOP_HZ) % 10 == 3, 0.02 if round(t * LOOP_HZ) == 5 else 0.0))
    line.start(0.0)
    line.put(b"C", 0.0, 0.001, packet_bytes=PACKET_BYTES)
    assert line.take(0.001) == b"C"
    times = {}
    for n, message in enumerate(packets()[:20]):
        line.put(message, n / LOOP_HZ, n / LOOP_HZ + PACKET_S, packet_bytes=PACKET_BYTES)
        due = n / LOOP_HZ + PACKET_S
        while (event := line.next_event()) <= due:
            data = line.take(event)
            times |= {packets().index(data[at : at + 18]): event for at in range(0, len(data), 18)}
    assert sorted(times) == [n for n in range(20) if n % 10 != 3]
    assert times[5] == pytest.approx(5 / LOOP_HZ + PACKET_S + 0.02)
    assert all(a <= b for a, b in itertools.pairwise(times[n] for n in sorted(times)))
    assert times[4] == pytest.approx(4 / LOOP_HZ + PACKET_S)


def test_nothing_happens_before_data_is_asked_for() -> None:
    line = FaultyLine((LineFault(0.0, "silence", seconds=10.0),))
    line.put(b"H", 5.0, 5.001, packet_bytes=PACKET_BYTES)
    assert line.take(6.0) == b"H"
    line.start(100.0)
    line.start(200.0)
    line.put(b"H", 105.0, 105.001, packet_bytes=PACKET_BYTES)
    assert line.take(106.0) == b""
    line.put(b"H", 111.0, 111.001, packet_bytes=PACKET_BYTES)
    assert line.take(112.0) == b"H"


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ValueError, match=r"`kind`.*silence"):
        LineFault(0.0, "fire")


def arrivals(line: FaultyLine, messages: list[bytes], first_request: float = 50.0) -> list[tuple[float, bytes]]:
    """When what arrives of messages that leave at the loop's rate, since the first request."""
    line.start(first_request)
    out = []
    for n, message in enumerate(messages):
        sent = first_request + n / LOOP_HZ
        line.put(message, sent, sent + PACKET_S, packet_bytes=PACKET_BYTES)
    while (at := line.next_event()) < math.inf:
        out.append((at - first_request, line.take(at)))
    return out


def test_lost_packets_leave_no_byte() -> None:
    messages = packets()[:200]
    messages.insert(134, b"H")
    data = b"".join(piece for _, piece in arrivals(FaultyLine((LineFault(1.0, "lose_packets", count=2),)), messages))
    gone = next(n for n in range(COUNT) if n / LOOP_HZ + PACKET_S >= 1.0)
    assert gone == 133
    assert data == b"".join(messages[n] for n in range(201) if n not in (133, 135))


def test_a_stall_delivers_all_at_its_end() -> None:
    """Half a second arrives at once at 1.5 s, nothing is lost, and what follows is on time again."""
    got = arrivals(FaultyLine((LineFault(1.0, "stall", seconds=0.5),)), packets()[:300])
    assert b"".join(data for _, data in got) == b"".join(packets()[:300])
    (burst,) = (data for at, data in got if at == pytest.approx(1.5) and len(data) > 18)
    assert len(burst) / 18 == pytest.approx(0.5 * LOOP_HZ, abs=1)
    assert not any(1.0 <= at < 1.5 - 1e-6 for at, _ in got)
    assert got[-1][0] == pytest.approx(299 / LOOP_HZ + PACKET_S)


def test_a_backlog_comes_with_its_last_packet() -> None:
    """Forty packets at once when the fortieth has left; a reply would have let go what was held."""
    got = arrivals(FaultyLine((LineFault(0.5, "backlog", count=40),)), packets()[:200])
    assert b"".join(data for _, data in got) == b"".join(packets()[:200])
    assert [len(data) // 18 for _, data in got if len(data) > 18] == [40]
    messages = [*packets()[:70], b"H", *packets()[70:200]]
    got = arrivals(FaultyLine((LineFault(0.5, "backlog", count=40),)), messages)
    assert b"".join(data for _, data in got) == b"".join(messages)
    assert [data[-1:] for _, data in got if len(data) > 18] == [b"H"]


def test_a_stutter_cuts_a_packet_in_two() -> None:
    """Nine bytes in time, the other nine and all behind them 0.2 s later; none is lost."""
    got = arrivals(FaultyLine((LineFault(1.0, "stutter", seconds=0.2),)), packets()[:200])
    assert b"".join(data for _, data in got) == b"".join(packets()[:200])
    half = next(n for n, (_, data) in enumerate(got) if len(data) == 9)
    assert got[half + 1][0] - got[half][0] == pytest.approx(0.2)
    assert len(got[half + 1][1]) % 18 == 9
    assert got[half + 2][0] - got[half + 1][0] < 2 / LOOP_HZ


@pytest.mark.parametrize("bursts_s", [0.016, 0.002])
def test_bursts_come_by_the_timer_of_an_adapter(bursts_s: float) -> None:
    got = arrivals(FaultyLine((), seed=4, bursts_s=bursts_s), packets()[:100])
    assert b"".join(data for _, data in got) == b"".join(packets()[:100])
    ticks = [at / bursts_s for at, _ in got]
    assert all((tick - ticks[0]) == pytest.approx(round(tick - ticks[0]), abs=1e-6) for tick in ticks)
    byte_s, left = PACKET_S / 18, [n / LOOP_HZ + PACKET_S * (k + 1) / 18 for n in range(100) for k in range(18)]
    came = [at for at, data in got for _ in data]
    late = [b - a for a, b in zip(left, came, strict=True)]
    assert min(late) >= -1e-9
    assert max(late) < bursts_s + byte_s
    other = arrivals(FaultyLine((), seed=5, bursts_s=bursts_s), packets()[:3])
    assert other[0][0] != pytest.approx(got[0][0], abs=1e-6)


def test_a_hang_up_loses_what_is_under_way() -> None:
    line = FaultyLine((LineFault(0.998, "hang_up", seconds=0.501),))
    line.start(50.0)
    assert [line.is_away(50.0 + t) for t in (0.997, 0.998, 1.498, 1.499)] == [False, True, True, False]
    assert line.next_port_change(50.0) == pytest.approx(50.998)
    assert line.next_port_change(51.0) == pytest.approx(51.499)
    got = b"".join(data for _, data in arrivals(line, packets()[:300]))
    whole = b"".join(packets()[:300])
    head = next(n for n in range(len(whole)) if got[n] != whole[n])
    tail = next(n for n in range(1, len(whole)) if got[-n] != whole[-n]) - 1
    assert head + tail == len(got)
    assert head % 18 != 0
    assert (len(whole) - len(got)) / 18 == pytest.approx(0.501 * LOOP_HZ, abs=1)


def test_a_hang_up_loses_what_a_stall_holds() -> None:
    line = FaultyLine((LineFault(0.5, "stall", seconds=1.0), LineFault(1.0, "hang_up", seconds=0.2)))
    got = arrivals(line, packets()[:300])
    assert not any(0.5 <= at < 1.5 - 1e-6 for at, _ in got)
    numbers = arrived(b"".join(data for _, data in got))
    assert 60 < next(n for n in range(300) if n not in numbers) < 70
    assert numbers[-1] == 299

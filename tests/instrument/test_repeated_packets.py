"""Which packets came twice over the line, and which are two that read the same."""

import pytest

from imutui.instrument.counts import RepeatedPackets
from imutui.instrument.imu400.crossbow import Mode, Packet

WRAP_NS, PERIOD_NS = 51_770_000, 7_500_000


def packet(ticks: int, reading: int = 0) -> Packet:
    return Packet(Mode.SCALED, (reading, 0, 0), (0, 0, 5000), 1500, ticks % 65536)


def taken(packets: list[Packet], period_ns: int = PERIOD_NS, stream_ns: float = 0.0, **how: bool) -> list[bool]:
    """Which packets that came one after the other were found to have come before."""
    repeated = RepeatedPackets(WRAP_NS, stream_ns)
    return [repeated.take(one, k * period_ns, **how) for k, one in enumerate(packets)]


def test_a_still_unit_whose_counter_goes_on_sends_no_packet_twice() -> None:
    assert not any(taken([packet(-9494 * k) for k in range(1000)], contiguous=True))


def test_each_packet_that_comes_again_is_found_the_first_and_one_behind_the_next_too() -> None:
    sent = [packet(-9494 * k, k % 3) for k in range(100)]
    came = [sent[0], sent[0], *sent[1:50], sent[49], sent[50], sent[49], *sent[51:]]
    assert [k for k, again in enumerate(taken(came, 5_000_000)) if again] == [1, 51, 53]


def test_a_counter_that_stands_still_tells_nothing_and_hides_nothing() -> None:
    """Of a unit that is frozen, counter and all, packets go on; of one that reads on, all of them count."""
    frozen = taken([packet(7)] * 100, contiguous=True)
    assert sum(frozen) <= 3
    assert not any(frozen[-90:])
    assert not any(taken([packet(7, k // 2) for k in range(2, 100)][1:], contiguous=True)[1:])


def test_a_counter_that_wraps_from_packet_to_packet_is_no_repetition() -> None:
    """At 1 Hz the counter of an IMU381 is the same in each packet."""
    still = [packet(7 if k % 2 else 8) for k in range(40)]
    assert not any(taken(still, WRAP_NS, stream_ns=WRAP_NS, contiguous=True))


@pytest.mark.parametrize("asked", [True, False])
def test_a_late_repetition_is_known_by_its_place_or_by_readings_that_vary(asked: bool) -> None:
    sent = [packet(-9494 * k, k) for k in range(20)]
    came = [*sent[:10], sent[9], *sent[10:]]
    how = {"asked": True} if asked else {"contiguous": True}
    again = taken(came, 10 * WRAP_NS, **how)
    assert [k for k, one in enumerate(again) if one] == [10]

"""Stamps and losses against the truth, over streams that the host, the line or the unit holds up.

No packet that is there may be told as lost, none that is certainly missing may be left out, and no stamp may be further
from the truth than it says.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from helpers.packet_stream import LOOP_S, Heard, Stream, hear, stream

from imutui.instrument.clock import Clock, Gap, arrival_before
from imutui.instrument.counter_spec import SPAN, CounterSpec
from imutui.instrument.imu400.driver import COUNTER

HOLDS_S = [0.1, 0.3, 0.7, 1.0, 3.0, 8.0]


def heard(made: Stream, baud: int = 38400) -> Heard:
    """What a fresh clock makes of a stream; stamps in order, none later than its packet, none off by more than said."""
    found = hear(made, Clock(180 / baud * 1e9, COUNTER))
    assert len(found.stamps) == found.error_s.size
    assert all(b.monotonic_ns > a.monotonic_ns for a, b in pairwise(found.stamps))
    assert all(s.monotonic_ns <= at * 1e9 for s, at in zip(found.stamps, found.arrival_s, strict=True))
    assert np.all(np.abs(found.error_s) <= found.uncertainty_s)
    return found


def at(made: Stream, seconds: float) -> int:
    """Number of the packet that is due so many seconds after the first."""
    return int(np.searchsorted(made.due, made.due[0] + seconds))


def stall(made: Stream, after_s: float, seconds: float) -> None:
    start = float(made.due[0]) + after_s
    made.stalls.append((start, start + seconds))


@pytest.mark.parametrize("baud", [57600, 38400, 19200, 9600])
def test_a_stream_is_stamped_within_a_tenth_of_a_millisecond(baud: int) -> None:
    """From the first packet on, whoever sets the pace, the loop or the line; nothing is lost."""
    found = heard(stream(20.0, baud=baud, skew_ppm=-150.0), baud)
    assert not found.gaps
    # a slow line's sample has waited for it, by a time that repeats only after a few packets
    assert np.max(np.abs(found.error_s)) < (0.1e-3 if baud > 20000 else 0.5e-3)


@pytest.mark.parametrize("seconds", HOLDS_S)
@pytest.mark.parametrize("where", ["host", "line"])
def test_a_stall_loses_nothing_and_moves_no_stamp(seconds: float, where: str) -> None:
    made = stream(25.0)
    if where == "host":
        stall(made, 12.0, seconds)
    else:
        made.hold_line(float(made.due[0]) + 12.0, seconds)
    found = heard(made)
    assert not found.gaps
    assert np.max(np.abs(found.error_s)) < 0.1e-3


@pytest.mark.parametrize("seconds", HOLDS_S)
def test_one_packet_lost_while_the_host_is_late_is_one(seconds: float) -> None:
    for offset in (0.0, 0.3, 0.9):
        for cut in (False, True):
            made = stream(25.0)
            stall(made, 12.0, seconds)
            made.lose(at(made, 12.0 + offset * seconds) + 1, cut=cut)
            found = heard(made)
            assert [(gap.lost_min, gap.lost_max) for gap in found.gaps] == [(1, 1)], (offset, cut)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("baud", [38400, 57600])
def test_packets_lost_within_a_wrap_are_counted(count: int, baud: int) -> None:
    for cut in (False, True):
        made = stream(8.0, baud=baud)
        made.lose(at(made, 5.0), count, cut=cut)
        found = heard(made, baud)
        assert [(gap.lost_min, gap.lost_max) for gap in found.gaps] == [(count, count)]
        assert found.gaps[0].seconds == pytest.approx((count + 1) * 7.5e-3, abs=1e-4)


OF_TIME = CounterSpec(1e9 / SPAN, 1e-3, +1)  # of an IMU381, which wraps each second


@pytest.mark.parametrize("again_s", [0.02, 0.13, 0.153, 0.2, 0.24])
@pytest.mark.parametrize("counter", [COUNTER, OF_TIME], ids=["52 ms", "a second"])
def test_a_line_that_is_held_up_again_before_it_has_caught_up_loses_nothing(
    again_s: float, counter: CounterSpec
) -> None:
    """What was sent within the first half second comes after 2.47 s, the rest so much later: no gap, no stamp off."""
    made = stream(20.0, 3)
    if counter is OF_TIME:
        made.ticks = np.floor((made.sampled - made.sampled[0]) * SPAN).astype(np.int64) % SPAN
    sent = made.due - made.due[0] - 5.0
    for since_s, until_s, back_s in ((0.0, 0.5, 2.47), (0.5, 2.47 + again_s, 2.47 + again_s)):
        held = (sent >= since_s) & (sent < until_s)
        made.arrives[held] = made.due[0] + 5.0 + back_s
    made.arrives = np.maximum.accumulate(made.arrives)
    found = hear(made, Clock(180 / 38400 * 1e9, counter))
    assert found.gaps == []
    assert np.abs(found.error_s).max() < 1e-3


@pytest.mark.parametrize("again_s", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("counter", [COUNTER, OF_TIME], ids=["52 ms", "a second"])
def test_a_unit_that_pauses_again_soon_puts_no_stamp_off(again_s: float, counter: CounterSpec) -> None:
    """Unseen wraps are before the first packet behind the first pause, whatever comes soon after it."""
    made = stream(20.0, 3)
    if counter is OF_TIME:
        made.ticks = np.floor((made.sampled - made.sampled[0]) * SPAN).astype(np.int64) % SPAN
    for after_s, pause_s in ((10.0, 1.23), (11.33, again_s)):
        first = at(made, after_s)
        for times in (made.sampled, made.due, made.arrives):
            times[first:] += pause_s
        ran = counter.direction * round(pause_s * 1e9 / counter.tick_ns)
        made.ticks[first:] = (made.ticks[first:] + ran) % SPAN
    found = hear(made, Clock(180 / 38400 * 1e9, counter))
    assert np.all(np.abs(found.error_s) <= found.uncertainty_s)
    assert np.abs(found.error_s).max() < 1e-3


@pytest.mark.parametrize("every_s", [0.11, 0.15, 0.21])
def test_a_silence_before_a_busy_host_puts_no_stamp_off(every_s: float) -> None:
    """A host that is held up again and again for 60 ms: the packets behind the silence are never steady."""
    made = stream(20.0, 3)
    made.lose(at(made, 10.0), 273)
    for again_s in np.arange(12.1, 15.0, every_s).tolist():
        stall(made, again_s, 0.06)
    found = heard(made)
    (gap,) = found.gaps
    assert gap.lost_min <= 273 <= gap.lost_max


@pytest.mark.parametrize("late_s", [0.03, 0.3])
def test_packets_that_stay_late_are_in_doubt_after_a_block_of_them(late_s: float) -> None:
    """As of a unit that began anew where its counter would go on: whether line or instant is late is open at first."""
    made = stream(20.0, 5)
    made.ticks = np.floor((made.sampled - made.sampled[0]) * SPAN).astype(np.int64) % SPAN
    first = at(made, 10.0)
    for times in (made.sampled, made.due, made.arrives):
        times[first:] += late_s
    found = hear(made, Clock(180 / 38400 * 1e9, OF_TIME))
    off = np.abs(found.error_s) > found.uncertainty_s
    assert not off[:first].any()
    assert not off[first + 64 + 64 :].any()
    assert np.abs(found.error_s[-400:]).max() < 2e-3


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("counter", [COUNTER, OF_TIME], ids=["52 ms", "a second"])
def test_holds_that_overlap_with_losses_between_put_no_stamp_off(counter: CounterSpec, seed: int) -> None:
    """Twelve of up to 2.5 s within a minute, and eight losses: each stamp within what it says, none lost invented."""
    rng = np.random.default_rng(seed)
    made = stream(60.0, seed)
    if counter is OF_TIME:
        made.ticks = np.floor((made.sampled - made.sampled[0]) * SPAN).astype(np.int64) % SPAN
    sent = made.due - made.due[0]
    for start in rng.uniform(3.0, 55.0, 12):
        end = start + rng.uniform(0.05, 2.5)
        held = (sent >= start) & (sent < end)
        made.arrives[held] = np.maximum(made.arrives[held], made.due[0] + end)
    made.arrives = np.maximum.accumulate(made.arrives)
    for first in rng.integers(400, 7000, 8):
        made.lose(int(first), int(rng.integers(1, 4)), cut=bool(rng.integers(2)))
    found = hear(made, Clock(180 / 38400 * 1e9, counter))
    assert np.all(np.abs(found.error_s) <= found.uncertainty_s)
    assert found.lost <= found.lost_between.sum() <= sum(gap.lost_max for gap in found.gaps)


@pytest.mark.parametrize("seconds", [0.06, 0.3, 1.0, 3.0, 8.0])
def test_a_silence_beyond_the_wrap_has_bounds_that_hold_the_truth(seconds: float) -> None:
    """Whether the unit paused or the cable was out can't be told: nothing is certain, and all of it possible."""
    paused = stream(30.0)
    paused.pause(at(paused, 12.0), seconds)
    cable = stream(30.0)
    cable.lose(at(cable, 12.0), round(seconds / 7.5e-3))
    for made in (paused, cable):
        found = heard(made)
        (gap,) = found.gaps
        assert gap.lost_min == 0
        assert round(seconds / 7.5e-3) <= gap.lost_max <= round(seconds / 7.5e-3) + 1
        assert gap.seconds == pytest.approx(seconds + 7.5e-3, abs=8e-3)
        assert np.max(np.abs(found.error_s)) < 0.1e-3


@pytest.mark.parametrize("seconds", [0.5, 2.5, 5.0])
@pytest.mark.parametrize("after_s", [3.0, 4.003, 12.007])
def test_a_silence_is_one_gap_where_an_adapter_hands_bytes_over_in_bursts(seconds: float, after_s: float) -> None:
    made = stream(after_s + seconds + 6.0)
    gone = round(seconds / LOOP_S)
    made.lose(at(made, after_s), gone)
    made.bursts(0.016)
    (gap,) = heard(made).gaps
    assert gap.lost_min <= gone <= gap.lost_max
    assert gap.seconds == pytest.approx(seconds, abs=0.06)


@pytest.mark.parametrize("seconds", [2.5, 3.0, 4.0])
def test_a_buffer_that_overflowed_is_counted(seconds: float) -> None:
    """What a stalled host's queue of 4095 bytes could not take is known exactly once it reads in time again."""
    made = stream(25.0)
    stall(made, 12.0, seconds)
    first = at(made, 12.0) + 227
    missing = at(made, 12.0 + seconds) - first
    made.lose(first, missing, cut=True)
    found = heard(made)
    assert [(gap.lost_min, gap.lost_max) for gap in found.gaps] == [(missing, missing)]


def test_bursts_skew_and_losses_leave_a_tenth_of_a_millisecond() -> None:
    """With 16 ms bursts of an adapter, 200 ppm and 1 % lost: 0.1 ms rms after 10 s, one constant removed."""
    for seed in range(4):
        for skew in (-200.0, 200.0):
            made = stream(30.0, seed, skew_ppm=skew)
            made.bursts(0.016)
            made.got[50:] = np.random.default_rng(seed).random(made.got.size - 50) > 0.01
            found = heard(made)
            assert found.lost == found.lost_between.sum()
            settled = found.arrival_s > found.arrival_s[0] + 10.0
            assert np.std(found.error_s[settled]) < 0.1e-3


@pytest.mark.parametrize("baud", [38400, 19200, 9600])
def test_chaos_invents_nothing_and_hides_nothing(baud: int) -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        late = float(rng.choice([0.1e-3, 1e-3, 5e-3]))
        made = stream(30.0, seed, baud=baud, skew_ppm=float(rng.uniform(-300, 300)), late_s=late)
        if rng.random() < 0.3:
            made.bursts(0.016)
        t = 2.0
        while t < 26.0:
            seconds = float(rng.choice([0.03, 0.06, 0.1, 0.3, 0.7, 1.0, 1.5]))
            kind = int(rng.integers(4))
            if kind in (0, 3):
                stall(made, t, seconds)
            if kind == 1:
                made.hold_line(float(made.due[0]) + t, seconds)
            if kind in (2, 3):
                made.lose(at(made, t) + int(rng.integers(20)), cut=bool(rng.random() < 0.5))
            t += seconds + float(rng.uniform(0.3, 3.0))
        found = heard(made, baud)
        assert found.lost == found.lost_between[1:].sum(), seed


@pytest.mark.parametrize("stall_s", [0.1, 0.4, 0.9, 1.6, 3.0])
def test_a_reader_held_up_at_the_very_start_spoils_nothing(stall_s: float) -> None:
    made = stream(12.0)
    made.stalls.append((float(made.due[0]) - 0.01, float(made.due[0]) + stall_s))
    found = heard(made)
    assert not found.gaps
    assert np.max(np.abs(found.error_s[-1000:])) < 0.2e-3


def test_held_up_again_and_again_in_the_first_seconds_it_recovers() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        made = stream(40.0, seed)
        for first in np.cumsum(rng.integers(1, 200, size=8)):
            stall(made, float(first) * 7.5e-3, float(rng.integers(20, 200)) * 7.5e-3)
        found = heard(made)
        assert not found.gaps, seed
        assert np.max(np.abs(found.error_s[-3000:])) < 1.0e-3, seed


def test_whole_packets_dropped_without_a_trace_are_found_by_time() -> None:
    """A buffer that lost 200 whole packets leaves no odd byte: the gap is told, within bounds."""
    made = stream(20.0)
    made.lose(1000, 200)
    (gap,) = heard(made).gaps
    assert gap.lost_min == 0
    assert 200 <= gap.lost_max <= 201


@pytest.mark.parametrize("step", [0, 1])
def test_a_counter_that_stands_still_or_counts_packets_leaves_the_arrival(step: int) -> None:
    clock = Clock(4.6875e6, COUNTER)
    stamps = [s for k in range(200) for s in clock.take(777 - step * k, 10**12 + k * 7_500_000, contiguous=k > 0)]
    stamps += clock.release()
    assert len(stamps) == 200
    assert all(s.by_host and s.gap is None for s in stamps)
    assert [s.monotonic_ns for s in stamps] == [10**12 + k * 7_500_000 - 4_687_500 for k in range(200)]


def test_polled_packets_are_stamped_by_arrival() -> None:
    """Above 52 ms the counter is ambiguous: arrival less the time on the line, at worst when it was asked for."""
    (stamp,) = Clock(4.6875e6, COUNTER, polled=True).take(
        100, 10**12, contiguous=False, requested_ns=10**12 - 500_000_000
    )
    assert stamp.monotonic_ns == 10**12 - 4_687_500
    assert stamp.by_host
    assert stamp.monotonic_ns - stamp.uncertainty_ns <= 10**12 - 500_000_000 - 7_500_000 + 1


def test_a_packet_that_waited_for_the_next_gets_its_own_arrival() -> None:
    assert arrival_before(10**9, 9494, 0, COUNTER) == 10**9 - 7500260
    assert arrival_before(10**9, 5, 65531 + 0, COUNTER) == 10**9 - 10 * 790
    assert arrival_before(10**9, 77, 77, COUNTER) == 10**9


@pytest.mark.parametrize("lossy", [False, True])
def test_a_stretch_after_an_interruption_keeps_the_tick(lossy: bool) -> None:
    for seconds in (2.0, 180.0):
        made = stream(20.0, skew_ppm=100.0)
        half = at(made, 10.0)
        made.pause(half, seconds)
        clock = Clock(4.6875e6, COUNTER)
        stamps = []
        for k in range(made.sampled.size):
            if k == half:
                tick = clock.tick_ns
                stamps += clock.interrupt(lossy=lossy)
            stamps += clock.take(int(made.ticks[k]), round(made.arrives[k] * 1e9), contiguous=k not in (0, half))
        stamps += clock.release()
        assert clock.tick_ns == pytest.approx(tick, rel=1e-5)
        error = np.array([s.monotonic_ns for s in stamps]) - made.sampled * 1e9
        assert np.max(np.abs(error)) < 0.2e6
        gaps = [s.gap for s in stamps if s.gap is not None]
        assert gaps == ([] if not lossy else [Gap(pytest.approx(seconds, abs=0.02), 0, gaps[0].lost_max)])
        if lossy:
            assert gaps[0].lost_max >= math.floor(0.999 * seconds / 7.5e-3)

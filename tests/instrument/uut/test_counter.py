"""Units that began anew or send at another rate, by the counter of their packets."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from imutui.instrument.counter_spec import SPAN
from imutui.instrument.uut.counter import CounterWatch
from imutui.instrument.uut.decoder import Decoder
from imutui.instrument.uut.messages import PacketS1

RATES = [2, 4, 5, 10, 20, 25, 50, 100, 200]


def time_at(n: float, rate_hz: float) -> int:
    return int(1000 + n * SPAN / rate_hz) % SPAN


def watching(rate_hz: float) -> CounterWatch:
    """One that has seen ten packets of a unit that is well, the last of which is number 9."""
    watch = CounterWatch(rate_hz)
    assert not any(watch.began_anew(time_at(n, rate_hz), 1.0 / rate_hz) for n in range(10))
    return watch


@pytest.mark.parametrize("rate_hz", RATES)
def test_a_unit_that_goes_on_never_begins_anew(rate_hz: float) -> None:
    watch = CounterWatch(rate_hz)
    assert not any(watch.began_anew(time_at(n, rate_hz), 1.0 / rate_hz) for n in range(1000))


@pytest.mark.parametrize("rate_hz", RATES)
def test_a_counter_of_packets_is_not_used(rate_hz: float) -> None:
    """As the documents of the 440 and the 380 have it: it shows no time, hence no reset either."""
    watch = CounterWatch(rate_hz)
    assert not any(watch.began_anew((SPAN - 3 + n) % SPAN, 1.0 / rate_hz) for n in range(100))
    assert not watch.began_anew(0, 3.0)


@pytest.mark.parametrize("rate_hz", RATES)
@pytest.mark.parametrize("late_s", [-0.05, 0.0, 0.015])
def test_packets_that_are_lost_are_no_new_beginning(rate_hz: float, late_s: float) -> None:
    for lost in (1, 2, 9):
        elapsed_s = (1 + lost) / rate_hz + late_s
        if elapsed_s < max(1.0, 3.5 / rate_hz):
            assert not watching(rate_hz).began_anew(time_at(10 + lost, rate_hz), elapsed_s)
        assert not watching(rate_hz).began_anew(time_at(10 + lost, rate_hz), None)
    assert not watching(rate_hz).began_anew(time_at(10, rate_hz), 0.0)


@pytest.mark.parametrize("rate_hz", RATES)
def test_a_unit_that_was_reset_is_known(rate_hz: float) -> None:
    """By nearly every value that its counter may begin with; a host that was held up for as long is no reset."""
    pause_s = 0.1 + 1.0 / rate_hz
    starts = [(97 + 641 * k) % SPAN for k in range(100)]
    known = [watching(rate_hz).began_anew((time_at(9, rate_hz) + start) % SPAN, pause_s) for start in starts]
    assert sum(known) >= 80
    assert not watching(rate_hz).began_anew(time_at(10, rate_hz), pause_s)


def read_late(rate_hz: float, behind: int, start: int, late_s: float) -> bool:
    """Whether one is told, by the first packet in time after some that a host read late; `start` is added to each."""
    watch = watching(rate_hz)
    told = [watch.began_anew((time_at(10 + n, rate_hz) + start) % SPAN, None) for n in range(behind)]
    told.append(watch.began_anew((time_at(10 + behind, rate_hz) + start) % SPAN, (1 + behind) / rate_hz + late_s))
    return any(told)


@pytest.mark.parametrize("rate_hz", [5, 20, 50, 100])
@pytest.mark.parametrize("behind", [1, 10, 300])
def test_a_host_that_reads_late_knows_a_reset_by_the_first_packet_in_time(behind: int, rate_hz: float) -> None:
    resets = [read_late(rate_hz, behind, 97 + 641 * k, 0.4) for k in range(100)]
    assert sum(resets) >= 80
    for late_s in (-1.0 / rate_hz, 0.0, 0.015, 1.0 / rate_hz):
        assert not read_late(rate_hz, behind, 0, late_s)


@pytest.mark.parametrize("rate_hz", [10, 20, 50, 100])
@pytest.mark.parametrize("seed", range(6))
def test_a_line_that_is_held_up_again_and_again_is_no_reset(rate_hz: float, seed: int) -> None:
    """Holds of up to 2.5 s that overlap, packets lost between them: what arrives last of a burst may be late still."""
    rng = np.random.default_rng(seed)
    number = np.arange(int(120 * rate_hz))
    sent, arrives = number / rate_hz, number / rate_hz + 0.003
    for start in rng.uniform(1.0, 118.0, 60):
        end = start + rng.uniform(0.02, 2.5)
        held = (sent >= start) & (sent < end)
        arrives[held] = np.maximum(arrives[held], end)
    arrives = np.maximum.accumulate(arrives)
    got = rng.random(number.size) > 0.02
    number, arrives = number[got], arrives[got]
    watch, in_time = CounterWatch(rate_hz), 0.0
    for n, at, following in zip(number, arrives, [*arrives[1:], np.inf], strict=True):
        behind = following <= at
        assert not watch.began_anew(time_at(int(n), rate_hz), None if behind else at - in_time), (n, at)
        in_time = in_time if behind else at


@pytest.mark.parametrize("rate_hz", [5, 20, 100])
@pytest.mark.parametrize("away_s", [0.15, 0.3, 0.6, 0.85])
def test_a_unit_that_began_anew_where_its_counter_would_go_on_is_known_soon(rate_hz: float, away_s: float) -> None:
    watch = watching(rate_hz)
    told = [watch.began_anew(time_at(10, rate_hz), away_s + 1.0 / rate_hz)]
    told += [watch.began_anew(time_at(11 + n, rate_hz), 1.0 / rate_hz) for n in range(int(5.0 * rate_hz))]
    assert any(told)
    assert not told[0] or away_s + 1.0 / rate_hz > 1.0
    held = watching(rate_hz)
    assert not held.began_anew(time_at(10, rate_hz), away_s + 1.0 / rate_hz)
    late = [held.began_anew(time_at(11 + n, rate_hz), 1.0 / rate_hz) for n in range(int(2.0 * rate_hz))]
    back = round(away_s * rate_hz)
    late += [held.began_anew(time_at(11 + len(late) + n, rate_hz), None) for n in range(back)]
    late.append(held.began_anew(time_at(11 + len(late), rate_hz), (1.0 + back) / rate_hz - away_s))
    late += [held.began_anew(time_at(11 + len(late) + n, rate_hz), 1.0 / rate_hz) for n in range(int(9.0 * rate_hz))]
    assert not any(late)


@pytest.mark.parametrize("rate_hz", [5, 20, 100])
def test_nearly_all_resets_are_known_most_of_them_at_once(rate_hz: float) -> None:
    """By where the counter begins, after sixty packets: nine of ten at once, all but a few of a hundred in 5 s."""
    rng = np.random.default_rng(3)
    at_once, later, runs = 0, 0, 400
    before = np.arange(max(60, int(2 * rate_hz))) / rate_hz
    after = before[-1] + 0.11 + rng.uniform(0.0, 1.0 / rate_hz) + np.arange(int(5 * rate_hz)) / rate_hz
    for first, anew in rng.integers(SPAN, size=(runs, 2)):
        watch, in_time, told = CounterWatch(rate_hz), 0.0, -1.0
        times = np.concatenate([before, after])
        since = np.concatenate([before, after - after[0]])
        counters = np.where(times < after[0], first, anew) + (since * SPAN).astype(int)
        # a host that is a little late now and then
        behind = (rng.random(times.size) < 0.1) & (times != after[0])
        for at, counter, late in zip(times, counters % SPAN, behind, strict=True):
            if watch.began_anew(int(counter), None if late else at - in_time):
                told = at - after[0]
                break
            in_time = in_time if late else at
        at_once += 0.0 <= told < 0.5 / rate_hz
        later += told >= 0.5 / rate_hz
    assert at_once > 0.9 * runs
    assert at_once + later > 0.95 * runs
    assert later > 0


def test_a_packet_lost_after_whole_seconds_read_late_is_no_reset() -> None:
    watch = watching(100.0)
    assert not any(watch.began_anew(time_at(10 + n, 100.0), None) for n in range(100))
    assert not watch.began_anew(time_at(111, 100.0), 1.02)


def test_a_unit_that_was_away_for_long_may_be_another() -> None:
    assert watching(20.0).began_anew(time_at(9 + 60, 20.0), 3.0)
    assert not watching(20.0).began_anew(time_at(10, 20.0), 3.0)


@pytest.mark.parametrize(("asked_hz", "sent_hz"), [(20, 100), (100, 20), (50, 25), (4, 50)])
def test_a_unit_at_another_rate_than_asked_is_known(asked_hz: float, sent_hz: float) -> None:
    """Faster at once, slower by some packets: so many would not be lost alike."""
    watch = watching(asked_hz)
    first = time_at(9, asked_hz)
    counters = [(first + round(n * SPAN / sent_hz)) % SPAN for n in range(1, 12)]
    told = [watch.began_anew(counter, 1.0 / sent_hz) for counter in counters]
    assert told.index(True) == (0 if sent_hz > asked_hz else 8)


def test_a_counter_that_says_nothing_invents_nothing() -> None:
    """At 1 Hz a counter of time stands still; a rate is positive."""
    watch = CounterWatch(1.0)
    assert not any(watch.began_anew(17 + n % 2, 1.0) for n in range(20))
    with pytest.raises(ValueError, match="`rate_hz` must be positive"):
        CounterWatch(0.0)


def test_what_a_real_unit_sent_never_begins_anew(recording: Callable[[str], Path]) -> None:
    """1002 frames at 20 Hz, whose counter counts time."""
    watch = CounterWatch(20.0)
    events = Decoder().feed(recording("aceinna_imu381_scale1.raw").read_bytes())
    counters = [event.counter for event in events if isinstance(event, PacketS1)]
    assert len(counters) == 1002
    assert not any(watch.began_anew(counter, 0.05) for counter in counters)

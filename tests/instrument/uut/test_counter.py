"""The two meanings of the counter, told apart by its step, and packets that are missing, with bounds."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from imutui.instrument.uut.counter import SPAN, Meaning, Missing, StepCounter
from imutui.instrument.uut.decoder import Decoder
from imutui.instrument.uut.messages import PacketS1

RATES = [1, 2, 4, 5, 10, 20, 25, 50, 100, 200]


def time_at(n: int, rate_hz: float) -> int:
    """Time counter of packet n."""
    return int(1000 + n * SPAN / rate_hz) % SPAN


def packets_at(n: int, _: float) -> int:
    """Packet counter of packet n, that wraps soon."""
    return (SPAN - 3 + n) % SPAN


def taken(
    numbers: Sequence[int], counter: Callable[[int, float], int], rate_hz: float, late_s: float = 0.0
) -> tuple[StepCounter, list[Missing]]:
    """What is missing before each of the packets of these numbers, the last one late."""
    steps = StepCounter(rate_hz)
    last = numbers[-1]
    return steps, [steps.take(counter(n, rate_hz), n / rate_hz + late_s * (n == last)) for n in numbers]


@pytest.mark.parametrize("rate_hz", RATES)
@pytest.mark.parametrize(("counter", "meaning"), [(time_at, Meaning.TIME), (packets_at, Meaning.PACKETS)])
def test_the_meaning_is_known_by_the_third_packet(
    counter: Callable[[int, float], int], meaning: Meaning, rate_hz: float
) -> None:
    """At every rate, over a wrap; and nothing is missing."""
    steps, missing = taken(range(3), counter, rate_hz)
    assert steps.meaning is meaning
    steps, missing = taken(range(300), counter, rate_hz)
    assert set(missing) == {Missing(0, 0)}


@pytest.mark.parametrize("rate_hz", RATES[2:])
@pytest.mark.parametrize("counter", [time_at, packets_at])
def test_packets_that_are_missing_are_counted(counter: Callable[[int, float], int], rate_hz: int) -> None:
    """One, and as many as fit below a second: the counter decides, however late the packet is."""
    for lost in (1, rate_hz // 2, rate_hz - 2):
        _, missing = taken([0, 1, 2, 3 + lost], counter, rate_hz, late_s=0.3)
        assert missing[-1] == Missing(lost, lost)


def test_whole_seconds_are_a_bound_where_time_is_counted() -> None:
    """Arrival says how many there may be: the line may have been held up as well."""
    _, missing = taken([0, 1, 2, 3 + 2 * 20], time_at, 20)
    assert missing[-1] == Missing(0, 40)
    _, missing = taken([0, 1, 2, 3 + 2 * 20], packets_at, 20)
    assert missing[-1] == Missing(40, 40)


def test_at_one_hertz_a_time_counter_says_nothing() -> None:
    """Only arrival is left."""
    steps, missing = taken([0, 1, 2, 6], time_at, 1)
    assert steps.meaning is Meaning.TIME
    assert missing[-1] == Missing(0, 3)


@pytest.mark.parametrize(("counter", "anew"), [(time_at, 1234), (packets_at, 40000)])
def test_a_counter_that_begins_anew_invents_no_loss(counter: Callable[[int, float], int], anew: int) -> None:
    """A unit that restarted: nothing for sure, at most what the time would hold."""
    steps, _ = taken([0, 1, 2], counter, 20)
    assert steps.take(anew, 3.1) == Missing(0, 59)
    steps.restart()
    assert steps.take(7, 9.0) == Missing()


def test_a_recorded_counter_counts_time_and_misses_nothing(recording: Callable[[str], Path]) -> None:
    """Of a real unit at 20 Hz."""
    raw = recording("aceinna_imu381_scale1.raw").read_bytes()
    counters = [event.counter for event in Decoder().feed(raw) if isinstance(event, PacketS1)]
    steps = StepCounter(20.0)
    assert {steps.take(counter, n / 20) for n, counter in enumerate(counters)} == {Missing()}
    assert steps.meaning is Meaning.TIME


def test_a_rate_must_be_positive() -> None:
    """A quiet unit has no step."""
    with pytest.raises(ValueError, match="rate_hz"):
        StepCounter(0.0)

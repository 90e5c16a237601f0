from collections.abc import Collection

import numpy as np
import pytest

from imutui.session.sample_pipeline import Averager, Sample

PERIOD_NS = 7_500_000


def feed(averager: Averager, n: int, drop: Collection[int] = ()) -> list[Sample]:
    """Packets at 133.3 Hz whose counts are their number."""
    out = []
    for k in range(n):
        if k not in drop:
            sample = averager.add(k * PERIOD_NS, (k, k, k, k, k, k), 1000 + k)
            if sample is not None:
                out.append(sample)
    return out


@pytest.mark.parametrize("rate", [0.1, 1.0, 20.0, 50.0, 100.0, 120.0])
def test_the_rate_is_the_one_asked_and_every_packet_counts_once(rate: float) -> None:
    n = int(40e9 / PERIOD_NS)
    samples = feed(Averager(rate), n)
    assert abs(len(samples) - 40 * rate) <= 2
    assert n - sum(s.packets for s in samples) <= 134 / rate


def test_a_sample_is_the_mean_of_its_packets_at_their_mean_instant() -> None:
    for sample in feed(Averager(20.0), 500):
        assert np.allclose(sample.counts, sample.stamp_ns / PERIOD_NS)
        assert sample.temperature == pytest.approx(1000 + sample.stamp_ns / PERIOD_NS)


def test_a_period_without_packets_gives_no_sample() -> None:
    whole, holed = feed(Averager(20.0), 200), feed(Averager(20.0), 200, drop=set(range(40, 80)))
    assert len(whole) - len(holed) == 6
    assert whole[-1].stamp_ns == holed[-1].stamp_ns

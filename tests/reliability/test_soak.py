"""A long run in unit time.

In a module of its own: it sets the clock of the whole process forward, which a unit that is served in this process for
other tests must not see.
"""

from pathlib import Path

import pytest
from reliability.soak import soak

from imutui.session.plan import Plan


def test_hours_of_packets_take_no_more_memory_and_no_more_descriptors(home: Path) -> None:
    """Through clock, recorder and filter, a flush and a snapshot a second; `benchmarks/soak.py` does so for a day."""
    plan = Plan("none", rate_hz=20.0, logs=str(home / "logs"), record=True)
    found = list(soak(home, plan, 101.0, 25.0))
    first, *_, before, last = found
    assert last.seconds == 100.0
    # less may come of what tests before have left behind
    assert last.descriptors <= first.descriptors, found
    assert last.objects - first.objects < 60, f"one a second and more: {found}"
    assert last.resident_mb - before.resident_mb < 3.0, found
    assert last.file_mb == pytest.approx(4.0 * first.file_mb, rel=0.1)

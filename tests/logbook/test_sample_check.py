"""What is wrong with samples is told alike, whether they come at once or one by one."""

from pathlib import Path

import numpy as np
import pytest

from imutui.logbook.sample_check import SampleCheck
from imutui.logbook.samples import Samples

FAULTS = {
    "no number": "is not a number",
    "infinite": "is not a number",
    "too large": "beyond anything",
    "too fast": "less than a microsecond",
    "too hot": "temperature ",
    "back": "time does not increase",
    "twice": "time does not increase",
    "no time": "are no times",
    "nothing read": "no reading in any channel",
    "": "",
}


def spoil(fault: str, rng: np.random.Generator, stamps: np.ndarray, readings: np.ndarray, degc: np.ndarray) -> None:
    row, channel = rng.integers(1, stamps.size), rng.choice([0, 1, 2, 3, 5])
    match fault:
        case "no number" | "infinite" | "too large":
            readings[row, channel] = {"no number": np.nan, "infinite": np.inf, "too large": -2e6}[fault]
        case "too fast":
            stamps[row:] -= stamps[row] - stamps[row - 1] - 900
        case "too hot":
            degc[row] = rng.choice([-1e6, 3e3])
        case "back" | "twice":
            stamps[row] = stamps[row - 1] - (fault == "back")
        case "no time":
            stamps[row] = rng.choice([-1, 2**62])
        case "nothing read":
            readings[:] = np.nan


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_told_with_its_sample_however_the_samples_come(fault: str) -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        stamps, readings = 10**18 + 10**7 * np.arange(60), rng.normal(size=(60, 6))
        degc = rng.normal(25.0, 1.0, 60)
        readings[:, 4] = np.nan if seed % 3 else 0.0
        spoil(fault, rng, stamps, readings, degc)
        alone = seed % 2 == 0
        if not alone:
            spoil(rng.choice(list(FAULTS)), rng, stamps, readings, degc)
        said = []
        for size in (60, 7, 1):
            check = SampleCheck()
            for first in range(0, 60, size):
                rows = slice(first, first + size)
                check.take(Samples(stamps, readings[:, :3], readings[:, 3:], np.ones(60, bool), degc).rows(rows))
            said.append((check.trouble(Path("a.mcap")), check.lacks.tolist()))
        assert said[1] == said[2] == said[0]
        if alone:
            assert FAULTS[fault] in said[0][0]
            assert bool(said[0][0]) == bool(fault)

"""Inputs that nobody thought of, to everything that takes bytes from outside: words, never a traceback, within bounds.

`benchmarks/fuzzing.py` does the same for as long as is wanted. What it finds is mended, and kept in `cases`.
"""

from pathlib import Path

import pytest
from helpers import fuzzing
from helpers.fuzzing import TARGETS

CASES = sorted((Path(__file__).parent / "cases").glob("*.bin"))
FIRST = 1_000_000
"""Seeds from here on are the tests'; those below, a campaign's."""


@pytest.mark.parametrize("name", TARGETS)
def test_spoilt_input_ends_in_words(name: str, home: Path) -> None:
    """A fixed number of seeds each, so that the inputs are the same on every machine."""
    count = fuzzing.TARGETS[name].in_tests
    found = list(fuzzing.campaign(name, iter(range(FIRST, FIRST + count)), home))
    assert not found, [(failure.seed, failure.error) for failure in found]


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.stem)
def test_what_failed_once_ends_in_words(case: Path, home: Path) -> None:
    fuzzing.take(case.stem.partition("-")[0], case.read_bytes(), home)


@pytest.mark.parametrize("name", TARGETS)
def test_what_is_not_spoilt_is_taken(name: str, home: Path) -> None:
    """Else a target would refuse everything, and nothing behind its door would be tested."""
    for seed in TARGETS[name].seeds(home):
        TARGETS[name].give(seed, home)

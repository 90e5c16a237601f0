"""Traces of random parts and channels of measured recordings: a few of what benchmarks/trace_anything.py makes."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from helpers.paths import DATA, ROOT

SEEDS = (5, 8, 40, 58, 62)
"""The last three ended with a warning of numpy and without a result."""


@pytest.fixture(scope="module")
def anything() -> Iterator[ModuleType]:
    """The benchmark, as a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        import trace_anything

        yield trace_anything
    for name in ("trace_anything", "bench"):
        sys.modules.pop(name, None)


@pytest.mark.skipif(not DATA.is_dir(), reason="the measured recordings are not here: ../shared/data")
@pytest.mark.parametrize("seed", SEEDS)
def test_a_trace_of_a_part_of_a_recording_ends_with_a_result(anything: ModuleType, seed: int, tmp_path: Path) -> None:
    """A message is none, and neither is a warning of numpy."""
    how, words = anything.ends(anything.case(seed, anything.stamps_of_all()), tmp_path)
    assert how == "result", words

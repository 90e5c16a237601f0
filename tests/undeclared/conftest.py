"""What the tests of undeclared effects share."""

import sys
from collections.abc import Iterator

import pytest
from helpers.paths import ROOT


@pytest.fixture(scope="module", autouse=True)
def _benchmarks() -> Iterator[None]:
    """Modules of benchmarks/ can be imported."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        yield
    for name in ("undeclared", "undeclared_sets", "undeclared_score", "tracing_wire"):
        sys.modules.pop(name, None)

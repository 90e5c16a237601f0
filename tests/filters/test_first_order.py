"""The first-order recursion against scipy's filter, and what effects in the filter need of scipy."""

import subprocess
import sys

import numpy as np
import pytest
from scipy import signal

from filters.first_order import first_order


@pytest.mark.parametrize("pole", [0.0, 0.3, 0.5, 0.9, 0.9987, 1.0 - 1e-6])
@pytest.mark.parametrize("loaded", [True, False])
def test_a_lag_is_that_of_lfilter_to_the_last_bit(pole: float, loaded: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one piece and in many, with scipy.signal loaded and without: what was filtered before keeps its numbers."""
    if not loaded:
        monkeypatch.delitem(sys.modules, "scipy.signal")
    u = np.random.default_rng(int(1e6 * pole)).normal(25.0, 3.0, 1000)
    expected, memory = signal.lfilter([1.0 - pole], [1.0, -pole], u, zi=np.array([pole * u[0]]))
    whole, last = first_order(u, 1.0 - pole, pole, pole * float(u[0]))
    assert np.array_equal(whole, expected)
    assert last == memory[0]
    nothing, kept = first_order(u[:0], 1.0 - pole, pole, 7.0)
    assert (nothing.shape, kept) == ((0,), 7.0)
    parts, last = [], pole * float(u[0])
    for piece in np.array_split(u, 7):
        out, last = first_order(piece, 1.0 - pole, pole, last)
        parts.append(out)
    assert np.array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("filters.effects.runtime", ("numba", "scipy.signal", "scipy.stats", "scipy.optimize")),
        ("filters.tracing.trace_document", ("numpy",)),
        ("filters.channels", ("numpy",)),
    ],
)
def test_what_others_import_of_effects_and_tracing_is_light(module: str, heavy: tuple[str, ...]) -> None:
    """Replay and acquisition take effects along without scipy's large rooms; texts name channels without arrays."""
    program = f"import sys, {module}; print(*[name for name in {heavy!r} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout.split() == []

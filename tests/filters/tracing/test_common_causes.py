"""Causes that channels share: found where they are, not where they are not, with their size and course in time."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from helpers.paths import DATA

from filters.channels import CHANNELS, DPS, MG
from filters.imu import STANDARD_GRAVITY, AxisMap
from filters.state import PAPER_SITE
from filters.tracing.common_drift import CommonDrift, common_drifts
from filters.tracing.common_rows import Rows, Stretch
from filters.tracing.common_steps import common_steps, pairs
from filters.tracing.run import Run
from filters.tracing.trace import trace
from filters.tracing.trace_document import TraceFindings

LOADING = np.array([1.0, -0.6, 0.4, 0.8, -0.5, 0.3])


def walk(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.cumsum(rng.standard_normal(n))


def flicker(rng: np.random.Generator, n: int) -> np.ndarray:
    hz = np.fft.rfftfreq(2 * n)
    hz[0] = hz[1]
    return np.fft.irfft(np.fft.rfft(rng.standard_normal(2 * n)) / np.sqrt(hz))[:n]


def smooth(rng: np.random.Generator, n: int) -> np.ndarray:
    """A warm-up and a slow walk: what is the same in shape, though nothing is shared."""
    return 0.02 * walk(rng, n) + 10.0 * np.exp(-np.arange(n) / rng.uniform(n / 20, n))


def rows(x: np.ndarray) -> Rows:
    """A still run with white noise of variance 1, rows of 1 s."""
    return Rows(1.0, tuple(range(6)), (x,), np.ones(6), (Stretch(0, 0, len(x)),))


@pytest.mark.parametrize(
    ("made", "level"), [(walk, 0.1), (flicker, 1.0), (smooth, 1.0)], ids=["walk", "flicker", "warm-up"]
)
def test_independent_drifts_share_nothing(made: Callable[[np.random.Generator, int], np.ndarray], level: float) -> None:
    false = 0
    for seed in range(200):
        rng = np.random.default_rng(10_000 + seed)
        x = rng.standard_normal((900, 6))
        for c in range(6):
            x[:, c] += level * 10.0 ** rng.uniform(-1.5, 0.5) * made(rng, 900)
        steps, cut = common_steps(rows(x))
        false += bool(steps) or bool(common_drifts(cut))
    assert false <= 2


def test_steps_of_one_channel_are_not_common() -> None:
    false = 0
    for seed in range(40):
        rng = np.random.default_rng(20_000 + seed)
        x = rng.standard_normal((1500, 6))
        for c in (1, 4):
            x[:, c] += 4.0 * (np.cumsum(rng.uniform(size=1500) < 0.01) % 2)
        false += bool(common_steps(rows(x))[0])
    assert false <= 2


@cache
def supplied(own: float) -> list[tuple[CommonDrift, np.ndarray, np.ndarray]]:
    """Six channels that follow one random walk, with `own` times half as large a walk of their own; data, truth."""
    out = []
    for seed in range(10):
        rng = np.random.default_rng(30_000 + seed)
        shared = 0.1 * walk(rng, 6000)
        x = rng.standard_normal((6000, 6)) + shared[:, None] * LOADING
        x += np.stack([0.05 * own * walk(rng, 6000) for _ in range(6)], axis=1)
        (drift,) = common_drifts(rows(x))
        out.append((drift, x, shared))
    return out


def test_a_supply_that_moves_six_channels_is_one_drift() -> None:
    for drift, x, shared in supplied(0.0):
        assert len(drift.channels) >= 5
        assert drift.coherence > 0.7
        lead = LOADING[drift.channels[0]]
        ratio = drift.size * drift.correlation / (drift.size * drift.correlation)[0]
        assert ratio == pytest.approx(LOADING[list(drift.channels)] / lead, rel=0.3)
        course = (x[:, list(drift.channels)] @ drift.weights).reshape(-1, 60).mean(axis=1)
        truth = (lead * shared).reshape(-1, 60).mean(axis=1)
        assert np.std(course - truth) < 0.15 * np.std(truth)


def test_coherence_is_the_share_that_is_shared() -> None:
    true = float(np.mean(LOADING**2 / (LOADING**2 + 0.25)))
    assert np.mean([drift.coherence for drift, *_ in supplied(1.0)]) == pytest.approx(true, abs=0.12)


def test_white_noise_in_common_is_no_common_drift() -> None:
    """Crosstalk of the noise has an effect of its own: drifts beside it that have nothing in common stay apart."""
    found = 0
    for seed in range(20):
        rng = np.random.default_rng(40_000 + seed)
        mixed = rng.standard_normal((3000, 6)) + 0.8 * rng.standard_normal((3000, 1))
        x = mixed + 0.1 * np.stack([walk(rng, 3000) for _ in range(6)], axis=1)
        made = rows(x)
        found += bool(common_drifts(Rows(1.0, made.channels, made.residual, 1.64 * np.ones(6), made.stretches)))
    assert found <= 1


def test_a_tilt_is_found_with_its_start_end_and_size() -> None:
    deviations = []
    for seed in range(20):
        rng = np.random.default_rng(50_000 + seed)
        x = rng.standard_normal((3000, 6)) + 0.02 * np.stack([walk(rng, 3000) for _ in range(6)], axis=1)
        x[1000:1240, 3] += 4.0
        x[1000:1240, 4] -= 3.0
        (start, end), *more = pairs(common_steps(rows(x))[0])
        assert not more
        assert end is not None
        assert (start.channels, end.channels) == ((3, 4), (3, 4))
        assert abs(start.row - 1000) <= 5
        assert abs(end.row - 1240) <= 5
        deviations += [(start.size[3] - 4.0) / start.sd[3], (end.size[4] - 3.0) / end.sd[4]]
    assert np.max(np.abs(deviations)) < 4.0
    assert np.sqrt(np.mean(np.square(deviations))) < 1.5


@cache
def tilted() -> TraceFindings:
    """The document of a still run of half an hour whose table tilts by 0.2° for five minutes."""
    rng = np.random.default_rng(3)
    t = np.arange(36_000) / 20.0
    reading = rng.standard_normal((t.size, 6)) * np.repeat([0.1 * DPS, 2.0 * MG], 3)
    reading[:, 5] += PAPER_SITE.gravity
    on = (t > 700.0) & (t < 1000.0)
    reading[on, 3] += 0.16 * DPS * STANDARD_GRAVITY
    reading[on, 4] -= 0.12 * DPS * STANDARD_GRAVITY
    still = np.zeros((1, 3))
    return trace([Run("still", t, reading, None, still, still, AxisMap(), PAPER_SITE)], None).document


def test_a_trace_tells_of_a_tilt_once() -> None:
    (entry,) = tilted()["common"]
    assert (entry["kind"], set(entry["channels"])) == ("event", {"ax", "ay"})
    assert entry["t_start_s"] == pytest.approx(700.0, abs=3.0)
    assert entry["t_end_s"] == pytest.approx(1000.0, abs=3.0)
    assert entry["label"].endswith("as a tilt of 0.2 deg would make them")
    assert entry["record"][0] == "tilt of the table"
    sizes = {s["channel"]: s["value"] for s in entry["sizes"]}
    assert sizes == pytest.approx({"ax": 2.79, "ay": -2.09}, abs=0.3)
    assert len(entry["curve"]["t_s"]) == len(entry["curve"]["y"]) > 50
    assert "not in this log: record tilt of the table" in tilted()["sentence"]
    named = [f for f in tilted()["findings"] if f["effect"] in ("step", "telegraph")]
    assert all(f["common"] == 0 for f in named)


def test_a_common_cause_explains_no_channel() -> None:
    assert {tilted()["status"][c] for c in ("ax", "ay")} & {"explained", "clean"} == set()
    assert {tilted()["status"][c] for c in CHANNELS if c not in ("ax", "ay")} <= {"clean", "explained"}


@pytest.mark.skipif(not (DATA / "adis16405_static_a.npz").exists(), reason="the measured recordings are not here")
def test_a_measured_event_is_found() -> None:
    with np.load(DATA / "adis16405_static_a.npz") as recording:
        x = np.hstack([recording["gyro"], recording["accel"]])[:999_900].reshape(-1, 100, 6)
    means = x.mean(axis=1)
    white = 0.5 * np.median(np.diff(means, axis=0) ** 2, axis=0) / 0.4549
    made = Rows(1.0, tuple(range(6)), (means,), white, (Stretch(0, 0, len(means)),))
    steps, cut = common_steps(made)
    events = [(start.row, back.row if back else None, set(start.channels)) for start, back in pairs(steps)]
    (event,) = [e for e in events if abs(e[0] - 2154) <= 3]
    assert event[1] == pytest.approx(2179, abs=3)
    assert event[2] >= {3, 4, 5}
    (drift,) = common_drifts(cut)
    assert set(drift.channels) >= {3, 4, 5}


def test_a_supply_over_two_runs_is_one_entry_with_a_course_in_each() -> None:
    runs = []
    for seed in (1, 2):
        rng = np.random.default_rng(60_000 + seed)
        t = np.arange(18_000) / 20.0
        shared = np.interp(t, np.arange(901.0), 0.15 * walk(rng, 901))
        reading = rng.standard_normal((t.size, 6)) * np.repeat([0.1 * DPS, 2.0 * MG], 3)
        reading += shared[:, None] * np.repeat([0.02 * DPS, 0.4 * MG], 3) * LOADING
        reading[:, 5] += PAPER_SITE.gravity
        still = np.zeros((1, 3))
        T = 25.0 + rng.standard_normal(t.size) * 0.01
        runs.append(Run(f"run {seed}", t, reading, T, still, still, AxisMap(), PAPER_SITE))
    document = trace(runs, None).document
    (entry,) = document["common"]
    assert (entry["kind"], entry["run"]) == ("drift", None)
    assert set(entry["curve"]["run"]) == {"run 1", "run 2"}
    assert len(entry["curve"]["run"]) == len(entry["curve"]["t_s"]) == len(entry["curve"]["y"])
    assert entry["record"] == ["supply voltage", "pressure", "magnetic field"]
    named = {d["channels"][0] for d in document["drift"] if d["common"] == 0}
    assert named == {d["channels"][0] for d in document["drift"]} & set(entry["channels"])
    assert len(named) >= 2

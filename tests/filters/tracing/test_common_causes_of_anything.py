"""Common causes of readings of every kind: whatever is constant, equal, missing or huge, what is told is a number."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from filters.channels import MG
from filters.imu import AxisMap
from filters.state import PAPER_SITE
from filters.tracing.blocks import average
from filters.tracing.common_causes import CommonCause, common_causes
from filters.tracing.common_drift import common_drifts
from filters.tracing.common_rows import Rows, Stretch
from filters.tracing.common_steps import common_steps
from filters.tracing.design_matrix import Design
from filters.tracing.run import Run
from filters.tracing.selection import Selection
from filters.tracing.stack import Stack

_HZ = 4.0
_KINDS = ("white", "constant", "counts", "shared", "shared", "equal", "lacking", "drift", "event", "event")


@st.composite
def units(draw: st.DrawFn) -> list[Run]:
    """One or two still runs whose channels are each of some kind, over many orders of magnitude, with gaps."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    kinds = [draw(st.sampled_from(_KINDS)) for _ in range(6)]
    scale = [10.0 ** draw(st.integers(-9, 6)) for _ in range(6)]
    gap = draw(st.sampled_from([0.0, 0.02, 0.3]))
    runs = []
    for number in range(draw(st.integers(1, 2))):
        n = draw(st.sampled_from([250, 700, 2400]))
        made = readings(rng, n, kinds) * scale
        flagged = np.isnan(made)
        for c in range(6):
            if rng.uniform() < 0.3:
                flagged[:, c] |= np.repeat(rng.uniform(size=n // 10) < gap, 10)
        if draw(st.booleans()):
            flagged[:, draw(st.integers(0, 5))] = True
        made = np.where(np.isnan(made), 0.0, made)
        made[:, 5] += PAPER_SITE.gravity
        still, unread = np.zeros((1, 3)), tuple(np.flatnonzero(flagged.all(axis=0)).tolist())
        run = Run(f"run {number}", np.arange(n) / _HZ, made, None, still, still, AxisMap(), PAPER_SITE)
        runs.append(replace(run, flagged=flagged, unread=unread))
    return runs


def readings(rng: np.random.Generator, n: int, kinds: list[str]) -> np.ndarray:
    """Channels of white noise of 1 and what their kinds say, NaN where one is lacking; shape (n, 6)."""
    x = rng.standard_normal((n, 6))
    shared = rng.uniform(0.0, 0.3) * np.cumsum(rng.standard_normal(n))
    event = rng.uniform(1.0, 30.0) * ((np.arange(n) > 0.4 * n) & (np.arange(n) < rng.uniform(0.5, 1.2) * n))
    for c, kind in enumerate(kinds):
        if kind == "constant":
            x[:, c] = 1.0
        elif kind == "counts":
            x[:, c] = np.rint(0.3 * x[:, c] + event)
        elif kind == "shared":
            x[:, c] += shared * rng.choice([-1.0, 0.3, 1.0])
        elif kind == "equal":
            x[:, c] = x[:, 0]
        elif kind == "drift":
            x[:, c] += 0.1 * np.cumsum(rng.standard_normal(n))
        elif kind == "event":
            x[:, c] += event * rng.choice([-1.0, 1.0])
        elif kind == "lacking":
            x[:, c] = np.nan
    return x


def causes_of(runs: list[Run]) -> list[CommonCause]:
    """Common causes of runs of which nothing else was found."""
    design = Design(Stack.of([average(run) for run in runs]))
    channels = [c for c in range(6) if design.sd[c] > 0.0 and design.stack.seconds(c) > 30.0]
    return common_causes(Selection(design), channels)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(units())
def test_whatever_the_readings_a_common_cause_is_told_in_numbers(runs: list[Run]) -> None:
    for cause in causes_of(runs):
        assert len(set(cause.channels)) == len(cause.channels) >= 2
        assert not set(cause.channels) & set.intersection(*(set(run.unread) for run in runs))
        assert 0.0 <= cause.coherence <= 1.0
        assert 0.0 <= cause.p <= 1.0
        assert cause.t.size == cause.course.size == cause.run.size > 0
        for values in (cause.t, cause.course, cause.size, cause.sd):
            assert np.isfinite(values).all()
        assert (cause.size != 0.0).all()
        assert cause.start <= cause.end


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32),
    st.lists(st.sampled_from(_KINDS), min_size=6, max_size=6),
    st.lists(st.integers(-60, 60), min_size=6, max_size=6),
)
def test_units_of_a_channel_change_nothing_but_its_sizes(seed: int, kinds: list[str], powers: list[int]) -> None:
    x = readings(np.random.default_rng(seed), 900, kinds)
    there = tuple(np.flatnonzero(np.isfinite(x).all(axis=0)).tolist())
    white = 0.5 * np.median(np.diff(x, axis=0) ** 2, axis=0) / 0.4549
    found = []
    for factor in (np.ones(6), 2.0 ** np.array(powers)):
        rows = Rows(1.0, there, (x * factor,), white * factor**2, (Stretch(0, 0, len(x)),))
        steps, cut = common_steps(rows)
        told = [(s.row, s.channels, s.p, (s.size / factor)[list(s.channels)].tolist()) for s in steps]
        drifts = [(d.channels, d.p, (d.size / factor[list(d.channels)]).tolist()) for d in common_drifts(cut)]
        found.append((told, drifts))
    assert found[0] == found[1]


def walks(n: int, white: np.ndarray, level: np.ndarray, seed: int = 1) -> np.ndarray:
    """One walk in all channels, `level` of it, with white noise of such variance; shape (n, 6)."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((n, 6)) * np.sqrt(white)
    return noise + 0.1 * np.cumsum(rng.standard_normal(n))[:, None] * level


def rows_of(x: np.ndarray, white: np.ndarray, *more: np.ndarray) -> Rows:
    """Still runs of rows of 1 s, with white noise of such variance."""
    runs = (x, *more)
    return Rows(1.0, tuple(range(6)), runs, white, tuple(Stretch(k, 0, len(own)) for k, own in enumerate(runs)))


@pytest.mark.parametrize("believed", [1.0, 1.4])
def test_a_drift_is_as_large_whatever_is_believed_of_the_white_noise(believed: float) -> None:
    """With noise that is taken for 40 % more than it is, all rows together vary less than it: 0/0 in the weights."""
    for seed in range(5):
        x = walks(12_000, np.ones(6), np.array([1.0, 0.3, 0.0, 0.0, 0.0, 0.0]), seed)
        (drift,) = common_drifts(rows_of(x, np.array([1.0, *[believed] * 5])))
        assert set(drift.channels) == {0, 1}
        by_channel = dict(zip(drift.channels, drift.size.tolist(), strict=True))
        assert by_channel[1] / by_channel[0] == pytest.approx(0.3, rel=0.1)
        assert np.isfinite(drift.weights).all()


def test_a_noisy_channel_adds_little_to_the_course() -> None:
    white = np.array([1.0, 25.0, 1.0, 1.0, 1.0, 1.0])
    for seed in range(5):
        level = np.array([3.0, 3.0, 0.0, 0.0, 0.0, 0.0])
        x, truth = walks(6000, white, level, seed), walks(6000, np.zeros(6), level, seed)[:, 0]
        (drift,) = common_drifts(rows_of(x, white))
        lead = 1.0 if drift.channels[0] == 0 else drift.size[0] / drift.size[1]
        apart = x[:, list(drift.channels)] @ drift.weights / lead - truth
        # the quiet channel's own noise is 1
        assert np.std(apart) < 1.1


def test_a_course_goes_on_where_one_of_its_channels_is_missing() -> None:
    """One run lacks the third channel, the other the first: the second is in both, and no row has all three."""
    rng = np.random.default_rng(5)
    runs = []
    for number, lacks in enumerate((2, 0)):
        t = np.arange(8000) / _HZ
        shared = 0.15 * np.repeat(np.cumsum(rng.standard_normal(2000)), 4)
        reading = (rng.standard_normal((t.size, 6)) + shared[:, None] * [1.0, 0.8, 0.9, 0.0, 0.0, 0.0]) * MG
        reading[:, 5] += PAPER_SITE.gravity
        flagged = np.zeros(reading.shape, bool)
        flagged[:, lacks] = True
        still = np.zeros((1, 3))
        run = Run(f"run {number}", t, reading, None, still, still, AxisMap(), PAPER_SITE)
        runs.append(replace(run, flagged=flagged, unread=(lacks,)))
    (cause,) = causes_of(runs)
    assert set(cause.channels) == {0, 1, 2}
    assert set(cause.run.tolist()) == {0, 1}
    assert np.isfinite(cause.course).all()


def test_steps_of_readings_that_are_missing_in_turn_have_a_coherence() -> None:
    """Three channels step at once, and each lacks every third second: no second has all three."""
    rng = np.random.default_rng(6)
    t = np.arange(2400) / _HZ
    reading = rng.standard_normal((t.size, 6)) * MG
    reading[t > 300.0, 3:] += 8.0 * MG
    reading[:, 5] += PAPER_SITE.gravity
    flagged = np.zeros(reading.shape, bool)
    flagged[:, 3:] = t[:, None].astype(int) % 3 == np.arange(3)
    still = np.zeros((1, 3))
    run = Run("run", t, reading, None, still, still, AxisMap(), PAPER_SITE, flagged=flagged)
    (cause,) = causes_of([run])
    assert set(cause.channels) == {3, 4, 5}
    assert 0.5 < cause.coherence <= 1.0
    assert np.ptp(cause.course) == pytest.approx(8.0 * MG, rel=0.5)


def test_an_event_is_placed_where_all_its_channels_have_readings() -> None:
    """Two channels step at once; a while later one of them steps further, and the other has just gone missing."""
    rng = np.random.default_rng(6)
    t = np.arange(2400) / _HZ
    reading = rng.standard_normal((t.size, 6)) * MG
    reading[t >= 300.0, 3:5] += 12.0 * MG
    reading[t >= 303.0, 3] += 60.0 * MG
    reading[:, 5] += PAPER_SITE.gravity
    flagged = np.zeros(reading.shape, bool)
    flagged[(t >= 302.0) & (t < 320.0), 4] = True
    still = np.zeros((1, 3))
    (cause,) = causes_of([Run("run", t, reading, None, still, still, AxisMap(), PAPER_SITE, flagged=flagged)])
    assert set(cause.channels) == {3, 4}
    assert (cause.size != 0.0).all()

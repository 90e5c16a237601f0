"""Raw residuals in blocks: zero for a perfect unit, exact means, what is flagged, drivers with a memory."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.runs import QUIET, run_of

from filters.effects.inputs import BANKS, PLAY_WIDTHS
from filters.effects.temperature import lag, plays, smoothed
from filters.imu import AxisMap, parse_mount
from filters.motion.kinematics import attitudes
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sine
from filters.simulation import Scenario, Temperature
from filters.tracing import blocks
from filters.tracing.blocks import average, even_time
from filters.tracing.design_matrix import Design
from filters.tracing.residual import perfect, residual, residual_of
from filters.tracing.run import Run
from filters.tracing.stack import Stack

DEG = np.pi / 180.0
NONE = (0.0, 0.0, 0.0)
TURNED = Profile(
    (
        Dwell((0.0, 0.0, 0.0), 10.0),
        Rate("inner", 60 * DEG, 10.0),
        Dwell((0.5, 0.0, 0.0), 10.0),
        Sine("outer", 20 * DEG, 0.2, 10.0),
        Rate("inner", -60 * DEG, 5.0),
        Dwell((0.0, 0.5, 0.0), 10.0),
    )
)


def scene(axes: AxisMap | None = None, moving: bool = True, **more: object) -> Scenario:
    profile = TURNED if moving else None
    return Scenario(spec=QUIET, accel_bias=NONE, gyro_bias=NONE, profile=profile, axes=axes or AxisMap(), **more)  # type: ignore[arg-type]


def noisy(n: int = 4000, hz: float = 20.0, seed: int = 0) -> Run:
    """A unit at rest with white noise of 1."""
    own = run_of(scene(moving=False), 0, hz, n / hz)
    return replace(own, reading=own.reading + np.random.default_rng(seed).standard_normal((n, 6)))


@pytest.mark.parametrize(
    "axes", [AxisMap(), AxisMap(accel_sign=1), AxisMap(parse_mount("y,z,x")), AxisMap(parse_mount("-x,y,-z"))]
)
@pytest.mark.parametrize("moving", [False, True])
def test_a_perfect_unit_leaves_nothing(axes: AxisMap, moving: bool) -> None:
    y = average(run_of(scene(axes, moving), 0, 40.0, 70.0)).y
    assert np.abs(y[:, :3]).max() < 1e-12
    assert np.abs(y[:, 3:]).max() < 1e-9


def test_an_error_of_a_reading_is_its_residual() -> None:
    own = run_of(scene(AxisMap(parse_mount("y,z,x")), True), 0, 40.0, 70.0)
    for c in range(6):
        added = np.zeros(6)
        added[c] = 0.25
        y = average(replace(own, reading=own.reading + added)).y
        assert np.allclose(y, added, atol=1e-9)


def test_means_over_blocks_are_those_of_their_samples() -> None:
    own = run_of(scene(), 0, 30.0, 70.0)
    own = replace(own, reading=own.reading + np.random.default_rng(0).standard_normal(own.reading.shape))
    made = average(own, 0.25)
    assert made.period == pytest.approx(8 / 30.0)
    counts = np.diff(made.edges)
    assert counts.sum() == own.t.size
    r = own.reading - perfect(own)
    assert np.allclose(made.y, np.add.reduceat(r, made.edges[:-1], axis=0) / counts[:, None])
    x = np.empty((made.t.size, 6))
    made.mean([(lambda inputs: inputs.x, slice(None))], x)
    assert np.allclose(x, np.add.reduceat(perfect(own), made.edges[:-1], axis=0) / counts[:, None], atol=1e-12)


def test_how_much_is_averaged_at_once_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    own = run_of(scene(), 0, 40.0, 70.0)
    own = replace(own, reading=own.reading + np.random.default_rng(0).standard_normal(own.reading.shape))

    def all_of_it() -> list[np.ndarray]:
        made = average(own)
        out = np.empty((made.t.size, 16))
        columns = lambda i: np.column_stack([i.x, i.x_dot, i.centripetal[:, 0], i.table_accel])  # noqa: E731
        made.mean([(columns, slice(None))], out)
        return [made.y, made.weight, made.rough, made.pairs, out]

    whole = all_of_it()
    monkeypatch.setattr(blocks, "_CHUNK", 130)
    for a, b in zip(whole, all_of_it(), strict=True):
        assert np.allclose(a, b, rtol=1e-9, atol=1e-9)


def test_flagged_readings_do_not_count() -> None:
    own = noisy()
    flagged = np.zeros(own.reading.shape, bool)
    flagged[0:400:20, 2] = True  # one in twenty of the block's five: 20 % of every fourth block
    reading = own.reading.copy()
    reading[flagged] = 1e6
    made = average(replace(own, reading=reading, flagged=flagged), 1.0)
    assert np.all(made.weight[:20, 2] == pytest.approx(0.95))
    assert np.abs(made.y[:, 2]).max() < 3.0
    fine = average(replace(own, reading=reading, flagged=flagged), 0.25)
    assert np.array_equal(np.flatnonzero(fine.weight[:, 2] == 0.0), np.arange(0, 80, 4))
    assert np.all(np.delete(fine.weight, 2, axis=1) == 1.0)
    assert np.all(fine.y[fine.weight[:, 2] == 0.0, 2] == 0.0)


def test_roughness_is_of_neighbours_within_a_block() -> None:
    own = noisy()
    flagged = np.zeros(own.reading.shape, bool)
    flagged[7::50] = True
    made = average(replace(own, flagged=flagged))
    assert np.all(made.pairs <= 4)
    ratio = made.rough.sum(axis=0) / made.pairs.sum(axis=0)
    assert np.allclose(ratio, 2.0, rtol=0.1)


def test_rate_goes_by_count_and_bursts_by_the_mean() -> None:
    own = noisy()
    n = own.t.size
    bursts = own.t - (np.arange(n) % 5) * 0.049
    bursts = np.maximum.accumulate(bursts) + 1e-6 * np.arange(n)
    run = replace(own, t=bursts)
    assert run.rate_hz == pytest.approx(20.0, rel=0.01)
    assert np.allclose(np.diff(even_time(run)), 1.0 / run.rate_hz)
    gap = own.t + np.where(np.arange(n) > 500, 7.0, 0.0)
    assert even_time(replace(own, t=gap)) is not None
    assert np.array_equal(even_time(replace(own, t=gap)), gap)
    made = average(replace(own, t=gap))
    assert np.diff(made.t).max() == pytest.approx(7.25, abs=0.2)


def test_an_attitude_that_is_known_stands_for_the_angles() -> None:
    tilted = Profile((Dwell((0.2, -0.3, 0.7), 70.0),))
    own = run_of(replace(scene(), profile=tilted), 0, 20.0, 60.0)
    level = replace(own, angles=np.zeros((1, 3)), rates=np.zeros((1, 3)))
    assert np.abs(average(level).y[:, 3:]).max() > 0.5
    known = replace(level, C_nb=attitudes(np.array([[0.2, -0.3, 0.7]]))[0])
    assert np.abs(average(known).y).max() < 1e-9


def test_time_since_motion_and_its_last_direction() -> None:
    inputs = average(run_of(scene(), 0, 40.0, TURNED.duration)).slow()
    before, turning = inputs.t < 9.5, (inputs.t > 12.0) & (inputs.t < 19.0)
    assert np.all(inputs.since_motion[turning] == 0.0)
    assert np.allclose(np.diff(inputs.since_motion[before]), 0.25)
    assert np.all(inputs.direction[before] == 0.0)
    assert np.all(inputs.direction[turning] == np.array([0.0, 0.0, 1.0]))
    assert inputs.direction[-1, 2] != 0.0


def test_a_lag_follows_a_step_exponentially() -> None:
    u = np.concatenate([np.full(10, 5.0), np.full(200, 6.0)])
    out = lag(u, 40.0)
    assert np.all(out[:10] == 5.0)
    assert np.allclose(out[10:], 6.0 - np.exp(-np.arange(1, 201) / 40.0))


def test_plays_have_a_free_stretch_and_a_memory() -> None:
    up, down = np.linspace(0.0, 12.0, 121), np.linspace(12.0, -12.0, 241)
    loop = np.concatenate([up, down[1:], down[::-1][1:]])
    out, _ = plays(loop)
    k = PLAY_WIDTHS.index(3.0)
    half = 3.0 * np.arange(1, 7) / 6
    assert out[120, k] == pytest.approx(np.mean(12.0 - half) / 3.0)
    assert out[120, k] == pytest.approx(out[-1, k])
    assert out[240, k] > 0.3  # on the way back, at the temperature it started from
    assert out[130, k] == pytest.approx(out[120, k])


def test_smoothing_leaves_straight_lines_and_takes_noise_off() -> None:
    t = 0.25 * np.arange(2000)
    level, rate = smoothed(20.0 + 0.01 * t, 0.25)
    assert np.allclose(level, 20.0 + 0.01 * t)
    assert np.allclose(rate, 0.01)
    level, rate = smoothed(np.rint((20.0 + 0.01 * t) / 0.05) * 0.05, 0.25)
    assert np.abs(level - 20.0 - 0.01 * t).max() < 0.02
    assert np.std(rate) < 1e-3
    assert smoothed(np.array([20.0, 21.0]), 0.25)[0].tolist() == [20.0, 21.0]


def test_a_run_without_temperature_has_none_in_its_drivers() -> None:
    inputs = average(replace(noisy(), temperature=None)).slow()
    assert np.isnan(inputs.temperature).all()
    assert np.isnan(inputs.lagged).all()


def test_temperature_of_single_samples_is_filled_in() -> None:
    history = Temperature(((0.0, 20.0), (200.0, 30.0)))
    own = run_of(scene(moving=False, temperature=history), 0, 20.0, 200.0, lsb_k=0.0)
    rare = np.where(np.arange(own.t.size) % 10 == 0, own.temperature, np.nan)
    a, b = average(own).slow(), average(replace(own, temperature=rare)).slow()
    assert np.abs(a.temperature - b.temperature).max() < 0.02


def test_plays_begin_where_they_are_told() -> None:
    T = 30.0 - 0.05 * np.arange(400)
    played, _ = plays(T - T[0])
    for start, free in ((1.0, 0.0), (0.0, 1.0), (-1.0, 2.0)):
        own = played[:, BANKS.index((3.0, start))] * 3.0
        # of the six operators the narrowest, with half a kelvin on either side, is the first to move
        moved = np.flatnonzero(np.abs(own - own[0]) > 1e-9)[0]
        assert T[0] - T[moved] == pytest.approx(0.5 * free, abs=0.06)
        assert own[0] == pytest.approx(start * 3.0 * 7.0 / 12.0)


def test_long_lags_and_wide_plays_are_tried_where_temperature_goes_far() -> None:

    def wide(kelvins: float) -> set[str]:
        drop = Temperature(((0.0, 40.0), (900.0, 40.0 - kelvins)))
        design = Design(Stack.of([average(run_of(scene(moving=False, temperature=drop), 0, 4.0, 900.0))]))
        kept = [a.hypothesis for a in design.terms if a.hypothesis.effect in ("hysteresis", "thermal_lag")]
        return {str(dict(h.shape)) for h in kept if h.is_wide}

    assert wide(15.0) == set()
    assert "{'tau_s': 640.0}" in wide(30.0)
    assert "{'tau_s': 1280.0}" not in wide(30.0)
    assert "{'width_k': 60.0, 'start': -1.0}" in wide(30.0)


def test_a_residual_that_is_looked_at_in_parts_is_the_residual() -> None:
    run = noisy(500)
    flagged = np.zeros((500, 6), bool)
    flagged[[3, 400], [2, 5]] = True
    run = replace(run, flagged=flagged)
    whole, part = residual(run), residual_of(run)
    assert part.shape == whole.shape
    for key in (slice(10, 450), (slice(None), 2), (slice(100, 450), 5)):
        np.testing.assert_array_equal(part[key], whole[key])


def test_blocks_of_many_samples_begin_where_those_of_few_do(monkeypatch: pytest.MonkeyPatch) -> None:
    run = noisy(4000)
    edges = average(run).edges
    monkeypatch.setattr(blocks, "_AT_ONCE", 333)
    np.testing.assert_array_equal(average(run).edges, edges)

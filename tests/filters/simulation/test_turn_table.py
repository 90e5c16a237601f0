"""The table under command: limits, settling, what its encoders do not say, and units that stand on it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from filters import attitude
from filters.channels import DPS
from filters.errors import InputError
from filters.imu import AxisMap
from filters.motion.kinematics import attitudes, body_rate
from filters.simulation import Effect, OnTable, Scenario, TableModel, TurnTable, Unit
from filters.simulation.turn_table import STEP_S

PERFECT = TableModel(encoder_noise=0.0, rate_noise=0.0, encoder_offset_sd=0.0, orthogonality_sd=0.0, wobble_sd=0.0)
RATE_HZ = 100.0


def tell(table: TurnTable, axis: str, mode: str, demand: float, rate: float = 60.0, accel: float = 200.0) -> None:
    """Degrees."""
    it = table.axes[axis]
    it.rate_limit, it.accel_limit, it.demand = rate * DPS, accel * DPS, demand * DPS
    it.enter(mode)


def swing(table: TurnTable, axis: str, amplitude: float, hz: float) -> None:
    it = table.axes[axis]
    it.amplitude, it.omega = amplitude * DPS, 2.0 * math.pi * hz
    it.enter("oscillation")


def moved(seed: int = 0, model: TableModel | None = None) -> TurnTable:
    """A table that has gone to a position, turned, swung and stopped, all axes in 12 s."""
    table = TurnTable(model or TableModel(seed=seed))
    tell(table, "outer", "position", 40.0)
    tell(table, "inner", "rate", 90.0, 90.0)
    table.advance(4.0)
    tell(table, "middle", "position", -25.0, 30.0, 50.0)
    tell(table, "inner", "rate", 0.0)
    table.advance(8.0)
    swing(table, "outer", 3.0, 1.0)
    table.advance(12.0)
    return table


@settings(max_examples=30, deadline=None)
@given(
    st.floats(-300.0, 300.0), st.floats(5.0, 200.0), st.floats(20.0, 400.0), st.floats(0.01, 1.5), st.floats(-90, 90)
)
def test_no_motion_is_faster_than_its_limits_and_each_settles(
    to: float, rate: float, accel: float, turned_s: float, before: float
) -> None:
    """Also where the command comes in the middle of another motion."""
    table = TurnTable(PERFECT)
    tell(table, "inner", "rate", before, 100.0, accel)
    table.advance(turned_s)
    start = np.rad2deg(abs(table.axes["inner"].rate))
    tell(table, "inner", "position", to, rate, accel)
    table.advance(turned_s + 300.0 / rate + 2.0 * (rate + start) / accel + 700.0 / rate + 3.0)
    axis = table.axes["inner"]
    assert axis.angle == pytest.approx(to * DPS, abs=1e-9)
    assert axis.rate == 0.0
    t = np.arange(max(0.0, table.now - 60.0), table.now, STEP_S)
    rates = np.rad2deg(table.rates(t)[:, 2])
    assert np.abs(rates).max() <= max(rate, abs(before), start) * 1.001 + 1e-6
    assert np.abs(np.diff(rates)).max() <= accel * STEP_S * 1.01 + 1e-6


def test_jerk_stays_below_its_limit() -> None:
    model = TableModel(jerk=5000.0 * DPS, accel=500.0 * DPS)
    table = TurnTable(model)
    tell(table, "inner", "position", 120.0, 200.0, 500.0)
    table.advance(5.0)
    t = np.arange(0.0, 5.0, 0.01)
    jerk = np.diff(np.rad2deg(table.rates(t)[:, 2]), 2) / 0.01**2
    assert 1000.0 < np.abs(jerk).max() <= 5000.0


def test_stops_are_not_passed() -> None:
    table = TurnTable(TableModel(low=-50.0 * DPS, high=50.0 * DPS))
    tell(table, "outer", "rate", 60.0)
    tell(table, "inner", "rate", 60.0)
    table.advance(4.0)
    assert table.axes["outer"].angle == pytest.approx(50.0 * DPS)
    assert table.axes["outer"].rate == 0.0
    assert table.axes["inner"].angle > 200.0 * DPS


def test_a_swing_is_of_the_asked_size_and_ends_where_it_began() -> None:
    table = TurnTable(PERFECT)
    tell(table, "inner", "position", 10.0)
    table.advance(3.0)
    swing(table, "inner", 5.0, 0.5)
    table.advance(15.0)
    angles = np.rad2deg(table.angles(np.arange(7.0, 15.0, 0.01))[:, 2])
    # the two lags let a swing through a little smaller
    through = 1.0 / (1.0 + (2.0 * math.pi * 0.5 * PERFECT.lag) ** 2)
    assert angles.max() == pytest.approx(10.0 + 5.0 * through, abs=0.01)
    assert angles.min() == pytest.approx(10.0 - 5.0 * through, abs=0.01)
    swing(table, "inner", 0.0, 0.5)
    table.advance(22.0)
    assert table.axes["inner"].is_idle
    assert np.rad2deg(table.axes["inner"].angle) == pytest.approx(10.0)


def test_an_axis_that_is_off_brakes_and_one_that_is_stuck_stays() -> None:
    table = TurnTable(PERFECT)
    for axis in ("outer", "inner"):
        tell(table, axis, "rate", 50.0)
    table.advance(3.0)
    table.axes["inner"].enter("off")
    table.axes["outer"].is_stuck = True
    angle = table.axes["outer"].angle
    table.advance(6.0)
    assert all(axis.is_idle for axis in table.axes.values())
    assert table.axes["outer"].angle == angle


def test_equal_seeds_move_alike_and_however_time_is_cut() -> None:
    """What a table does depends on commands and their times alone."""
    t = np.linspace(0.0, 12.0, 500)
    one, other, third = moved(1), moved(1), moved(2)
    for a, b in zip(one.pose(t), other.pose(t), strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(one.pose(t)[0], third.pose(t)[0])
    assert one.encoder("inner", 12.0) == other.encoder("inner", 12.0)
    table = TurnTable(TableModel(seed=1))
    tell(table, "outer", "position", 40.0)
    tell(table, "inner", "rate", 90.0, 90.0)
    for now in np.arange(0.0, 4.0, 0.0137):
        table.advance(float(now))
    table.advance(4.0)
    before = t[t < 4.0]
    np.testing.assert_array_equal(table.angles(before), one.angles(before))


def test_rates_are_the_derivatives_of_angles_and_body_rates_those_of_the_attitude() -> None:
    table = moved()
    t, h = np.linspace(0.1, 11.9, 2000), 1e-6
    difference = (table.angles(t + h) - table.angles(t - h)) / (2.0 * h)
    np.testing.assert_allclose(table.rates(t), difference, atol=2e-5)
    C, w = table.pose(t)
    before, after = table.pose(t - h)[0], table.pose(t + h)[0]
    np.testing.assert_allclose(w, attitude.log(np.swapaxes(before, 1, 2) @ after) / (2.0 * h), atol=2e-5)
    np.testing.assert_allclose(C @ np.swapaxes(C, 1, 2), np.broadcast_to(np.eye(3), C.shape), atol=1e-12)


def test_a_table_without_flaws_stands_as_its_angles_say() -> None:
    table = moved(model=PERFECT)
    t = np.linspace(0.0, 12.0, 200)
    C, w = table.pose(t)
    np.testing.assert_allclose(C, attitudes(table.angles(t)), atol=1e-12)
    np.testing.assert_allclose(w, body_rate(table.angles(t), table.rates(t)), atol=1e-5)
    assert table.encoder("outer", 12.0) == pytest.approx((table.axes["outer"].angle, table.axes["outer"].rate))


@pytest.mark.parametrize(
    ("flaw", "least", "most"),
    [("orthogonality_sd", 1.0, 20.0), ("wobble_sd", 0.5, 20.0)],
)
def test_a_table_with_flaws_does_not_by_arc_minutes(flaw: str, least: float, most: float) -> None:
    model = TableModel(seed=4, **{"orthogonality_sd": 0.0, "wobble_sd": 0.0, flaw: 3.0 / 60.0 * DPS})
    table = moved(model=model)
    t = np.linspace(0.0, 12.0, 300)
    off = attitude.log(np.swapaxes(attitudes(table.angles(t)), 1, 2) @ table.pose(t)[0])
    assert least < np.rad2deg(np.abs(off).max()) * 60.0 < most


def test_an_encoder_is_read_at_its_instant() -> None:
    """Not at a point of the grid: a rate would make an error of it."""
    table = moved(model=PERFECT)
    for t in np.linspace(0.0, 12.0, 777):
        both = [float(each[0, 2]) for each in (table.angles(np.array([t])), table.rates(np.array([t])))]
        assert table.encoder("inner", float(t)) == pytest.approx(both, abs=1e-12)


def test_encoders_are_off_by_a_constant_and_noise() -> None:
    table = TurnTable(TableModel(seed=1, encoder_offset_sd=0.1 * DPS, encoder_noise=0.01 * DPS))
    angles = np.rad2deg([table.encoder("inner", 0.0)[0] for _ in range(400)])
    offset = np.rad2deg(table.encoder_offset("inner"))
    assert abs(offset) > 0.01
    assert angles.mean() == pytest.approx(offset, abs=0.002)
    assert angles.std() == pytest.approx(0.01, rel=0.2)


def test_the_past_is_kept_for_a_minute_and_rests_cost_nothing() -> None:
    table = moved()
    swing(table, "outer", 0.0, 1.0)
    table.advance(20.0)
    table.advance(1e6)
    assert table.now == pytest.approx(1e6)
    before, after = table.angles(np.array([1e6 - 50.0, 1e6]))
    np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize(
    "fields", [{"axes": ()}, {"axes": ("inner", "inner")}, {"axes": ("up",)}, {"rate": 0.0}, {"low": -1.0}]
)
def test_a_table_that_makes_no_sense_is_refused(fields: dict[str, object]) -> None:
    with pytest.raises(InputError):
        TableModel(**fields)  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------------ units on it


def standing(table: TurnTable, *effects: Effect, axes: AxisMap | None = None) -> Unit:
    """A unit on a table whose time is its own."""
    scenario = Scenario(seed=5, accel_bias=(0.0,) * 3, gyro_bias=(0.0,) * 3, effects=effects, axes=axes or AxisMap())
    return Unit(scenario, rate_hz=RATE_HZ, table=OnTable(table, lambda t: t, lambda: table.now))


def test_a_unit_reads_what_the_table_truly_does_within_noise() -> None:
    table = moved(model=TableModel(seed=4, orthogonality_sd=10.0 / 60.0 * DPS, encoder_offset_sd=0.5 * DPS))
    readings = standing(table).record(1200)
    t = readings.samples.t
    C, w = table.pose(t)
    spec = Scenario().spec
    gyro_sd, accel_sd = spec.gyro_arw * math.sqrt(RATE_HZ), spec.accel_vrw * math.sqrt(RATE_HZ)
    rests = (t > 6.5) & (t < 7.9)
    force = np.einsum("nji,j->ni", C, [0.0, 0.0, -Scenario().site.gravity])
    assert np.abs((readings.samples.accel - force)[rests].mean(0)).max() < 4.0 * accel_sd / math.sqrt(rests.sum())
    turning = (t > 1.5) & (t < 3.9)
    mean = (readings.samples.gyro - w)[turning].mean(0)
    assert np.abs(mean).max() < 4.0 * gyro_sd / math.sqrt(turning.sum()) + 7.3e-5 + 1e-4
    np.testing.assert_array_equal(readings.angles, table.angles(t))


def test_a_lever_arm_and_a_delay_act_as_on_a_known_motion() -> None:
    """On a table under command they are what they are on a profile: functions of the true motion."""
    table = moved(model=PERFECT)
    plain = standing(table).record(1200)
    t = plain.samples.t
    arm = standing(table, Effect("lever_arm", (), {"x_m": 0.2})).record(1200).samples.accel - plain.samples.accel
    spin = table.pose(t)[1]
    steady = (t > 1.5) & (t < 3.9)
    across = np.cross(spin, np.cross(spin, np.array([0.2, 0.0, 0.0])))
    np.testing.assert_allclose(np.abs(arm[steady]), np.abs(across[steady]), atol=0.02)
    assert np.abs(arm[steady, 0]).mean() == pytest.approx((90.0 * DPS) ** 2 * 0.2, rel=0.02)
    late = standing(table, Effect("delay", (), {"tau_s": 0.05})).record(1200).samples.gyro
    ramp = (t > 0.15) & (t < 0.4)
    expected = (table.pose(t - 0.05)[1] - spin)[ramp]
    np.testing.assert_allclose((late - plain.samples.gyro)[ramp], expected, atol=0.02)


def test_readings_are_made_up_to_what_the_table_has_done() -> None:
    table = TurnTable(PERFECT)
    unit = standing(table)
    table.advance(0.5)
    assert unit.block(0) == 51
    unit.reading(0)
    tell(table, "inner", "rate", 90.0, 90.0, 400.0)
    table.advance(3.0)
    still = np.array([unit.reading(k)[0][2] for k in range(51)])
    turning = np.array([unit.reading(k)[0][2] for k in range(200, 300)])
    assert abs(still.mean()) < 0.02
    assert turning.mean() == pytest.approx(90.0 * DPS, abs=0.02)


def test_an_effect_of_motion_reads_the_true_angles() -> None:
    """A harmonic of the table's inner axis turns with it."""
    table = moved(model=PERFECT)
    effect = Effect("harmonic", ("gz",), {"axis": "inner", "order": 1, "sin_dps": 5.0, "cos_dps": 0.0})
    added = standing(table, effect).record(1200).samples.gyro - standing(table).record(1200).samples.gyro
    t = np.arange(1200) / RATE_HZ
    expected = 5.0 * DPS * np.sin(table.angles(t)[:, 2])
    rests = (t > 6.5) & (t < 7.9)
    np.testing.assert_allclose(added[rests, 2], expected[rests], atol=1e-3)

"""Every deterministic effect: what the simulator's physics leaves is what the tracer's regressor says."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from helpers.runs import QUIET, run_of

from filters import simulation
from filters.effects import catalogue, deterministic, drivers
from filters.effects.hypothesis import Hypothesis
from filters.imu import CHANNELS, AxisMap, parse_mount
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sine
from filters.simulation import Effect, Scenario, Temperature
from filters.tracing.blocks import Blocks, average

DEG = np.pi / 180.0
NONE = (0.0, 0.0, 0.0)
TURNED = Profile(
    (
        Dwell((0.0, 0.0, 0.0), 4.0),
        Rate("inner", 80 * DEG, 8.0),
        Rate("outer", -50 * DEG, 6.0),
        Sine("middle", 20 * DEG, 0.3, 12.0),
        Dwell((30 * DEG, 60 * DEG, 45 * DEG), 5.0),
        Rate("middle", 70 * DEG, 6.0),
        Rate("inner", -70 * DEG, 6.0),
        Dwell((180 * DEG, 0.0, 30 * DEG), 5.0),
    )
)
SWING = Temperature(
    tuple((float(t), 25.0 + 9.0 * np.sin(t / 50.0) + 3.0 * np.sin(t / 130.0)) for t in range(0, 601, 2))
)
RISING = Temperature(((-10.0, 20.0), (90.0, 40.0)))
MOVING = Scenario(spec=QUIET, accel_bias=NONE, gyro_bias=NONE, temperature=RISING, profile=TURNED)
STILL = Scenario(spec=QUIET, accel_bias=NONE, gyro_bias=NONE, temperature=SWING)
SEATS = {
    "reads +1 g at rest": AxisMap(),
    "reads specific force": AxisMap(accel_sign=1),
    "upside down": AxisMap(parse_mount("x,-y,-z")),
    "on its side": AxisMap(parse_mount("y,z,x"), 1),
    "with a gyro of its own sign": AxisMap(gyro_sign=np.array([1.0, 1.0, -1.0]), mount=parse_mount("x,y,-z")),
}


@dataclass(frozen=True)
class Case:
    """An effect as the simulator is asked for it, and as the tracer reports it."""

    channels: tuple[str, ...]
    asked: Mapping[str, float | str]
    shape: Mapping[str, float | str]
    values: tuple[float, ...]
    units: tuple[str, ...]
    tolerance: float = 0.003  # of the effect's norm
    still: bool = False


def on(channel: str, asked: dict[str, float | str], values: list[float], units: str, **more: object) -> Case:
    return Case(
        (channel,) if channel else (), asked, more.pop("shape", {}), tuple(values), tuple(units.split()), **more
    )  # type: ignore[arg-type]


CASES: dict[str, list[Case]] = {
    "thermal_lin": [
        on("gy", {"dps_per_k": 0.02}, [0.02], "deg/s/K", still=True),
        on("ax", {"mg_per_k": -0.3}, [-0.3], "mg/K", still=True),
    ],
    "thermal_poly": [
        on(
            "gx",
            {"dps_per_k": 0.01, "dps_per_k2": 1e-3, "dps_per_k3": 2e-5},
            [0.01, 1e-3, 2e-5],
            "deg/s/K deg/s/K2 deg/s/K3",
            shape={"order": 3.0},
            still=True,
        ),
        on("az", {"mg_per_k2": 0.02}, [0.0, 0.02], "mg/K mg/K2", shape={"order": 2.0}, still=True, tolerance=0.005),
    ],
    # its slope is that of straight lines over 30 s, at the ends of the run the last one's
    "thermal_rate": [
        on("gz", {"dps_s_per_k": 1.0}, [1.0], "deg/s/(K/s)", still=True, tolerance=0.04),
        on("ay", {"mg_s_per_k": 15.0}, [15.0], "mg/(K/s)", still=True, tolerance=0.04),
    ],
    "thermal_lag": [
        on("gx", {"dps_per_k": 0.03, "tau_s": 80.0}, [0.03], "deg/s/K", shape={"tau_s": 80.0}, still=True),
        on("az", {"mg_per_k": 0.3, "tau_s": 20.0}, [0.3], "mg/K", shape={"tau_s": 20.0}, still=True, tolerance=0.01),
    ],
    "hysteresis": [
        on("ay", {"mg": 3.0, "width_k": 10.0}, [3.0], "mg", shape={"width_k": 10.0}, still=True, tolerance=0.01),
        on("gz", {"dps": 0.3, "width_k": 3.0}, [0.3], "deg/s", shape={"width_k": 3.0}, still=True, tolerance=0.01),
    ],
    "warmup": [
        on("gx", {"dps": 0.2, "tau_s": 120.0}, [0.2], "deg/s", shape={"tau_s": 120.0}, still=True),
        on("ay", {"mg": 3.0, "tau_s": 40.0}, [3.0], "mg", shape={"tau_s": 40.0}, still=True),
    ],
    "ramp": [
        on("ax", {"mg_per_s": 1e-3}, [1e-3], "mg/s", still=True),
        on("gz", {"dps_per_s": -1e-4}, [-1e-4], "deg/s/s", still=True),
    ],
    "scale": [on("gz", {"relative": 0.01}, [0.01], "1"), on("ay", {"relative": -0.02}, [-0.02], "1")],
    "asymmetry": [on("gz", {"relative": 3e-3}, [3e-3], "1"), on("ax", {"relative": 3e-3}, [3e-3], "1")],
    "nonlinearity_cubic": [
        on("gz", {"dps_per_dps3": 3e-7}, [3e-7], "deg/s/(deg/s)3"),
        on("az", {"mg_per_g3": 4.0}, [4.0], "mg/g3"),
    ],
    "nonlinearity_quadratic": [on("gy", {"dps_per_dps2": 1e-5}, [1e-5], "deg/s/(deg/s)2")],
    "thermal_scale": [
        on("gz", {"relative_per_k": 2e-4}, [2e-4], "1/K"),
        on("ax", {"relative_per_k": 2e-4}, [2e-4], "1/K"),
    ],
    "cross_axis": [
        on("gx", {"y_rad": 0.01, "z_rad": -0.02}, [0.01, -0.02], "rad rad", shape={"axes": "yz"}),
        on("ay", {"z_rad": 0.01}, [0.01], "rad", shape={"axes": "z"}),
    ],
    # the exact rotation against its first order
    "mounting": [
        on("", {"x_rad": 1e-3, "y_rad": 5e-4, "z_rad": -2e-3}, [1e-3, 5e-4, -2e-3], "rad rad rad", tolerance=0.005)
    ],
    "g_sensitivity": [
        on(
            "gx",
            {"z_dps_per_g": 0.05, "x_dps_per_g": 0.02},
            [0.02, 0.0, 0.05],
            "deg/s/g deg/s/g deg/s/g",
            shape={"axes": "xyz"},
        ),
        on("gz", {"y_dps_per_g": 0.05}, [0.05], "deg/s/g", shape={"axes": "y"}),
    ],
    "g_squared": [
        on("gx", {"dps_per_g2": 0.02, "axis": "z"}, [0.02], "deg/s/g2", shape={"axis": "z"}),
        on("ax", {"mg_per_g2": 3.0}, [3.0], "mg/g2", shape={"axis": "x"}),
    ],
    "earth_rate": [on("", {}, [-1.0], "1")],
    "harmonic": [
        on(
            "gx",
            {"sin_dps": 0.05, "cos_dps": 0.02, "order": 2},
            [0.05, 0.02],
            "deg/s deg/s",
            shape={"axis": "inner", "order": 2.0},
        ),
        on("ay", {"cos_mg": 2.0, "axis": "outer"}, [0.0, 2.0], "mg mg", shape={"axis": "outer", "order": 1.0}),
    ],
    # the shift itself against its first order; the rate has corners where ramps begin
    "delay": [on("", {"tau_s": 1e-3}, [1e-3], "s", tolerance=0.03)],
    "lever_arm": [on("", {"x_m": 0.05, "y_m": 0.03, "z_m": -0.02}, [0.05, 0.03, -0.02], "m m m", tolerance=0.01)],
    "tilt": [on("", {"north_deg": 0.05, "east_deg": -0.03}, [0.05, -0.03], "deg deg", tolerance=0.005)],
    "gravity": [on("", {"relative": 1e-4}, [1e-4], "1")],
}
ALL = [pytest.param(name, k, id=f"{name}-{k}") for name, cases in CASES.items() for k in range(len(cases))]


def averaged(scenario: Scenario) -> Blocks:
    moving = scenario.profile is not None
    seconds = scenario.profile.duration if scenario.profile else 600.0
    return average(run_of(scenario, 0, 40.0 if moving else 10.0, seconds, lsb_k=0.0))


@cache
def without_effects(seat: str, still: bool) -> Blocks:
    return averaged(replace(STILL if still else MOVING, axes=SEATS[seat]))


def regressor(h: Hypothesis, seen: Blocks, channel: int) -> np.ndarray:
    if h.is_slow:
        return h.columns(seen.slow(), channel)
    out = np.empty((seen.t.size, len(h.parameters)))
    seen.mean([(lambda inputs: h.columns(inputs, channel), slice(None))], out)
    return out


def left_and_said(name: str, case: Case, seat: str = "reads +1 g at rest") -> tuple[np.ndarray, np.ndarray]:
    """What an effect leaves in the residual, and what its regressor times its parameters says, SI, (n, 6)."""
    clean = without_effects(seat, case.still)
    scene = replace(STILL if case.still else MOVING, axes=SEATS[seat])
    left = averaged(replace(scene, effects=(Effect(name, case.channels, case.asked),))).y - clean.y
    h = catalogue.hypothesis(name, case.channels, case.shape)
    theta = np.array([value * p.si for value, p in zip(case.values, h.parameters, strict=True)])
    said = np.zeros_like(left)
    for c in h.channels:
        said[:, c] = regressor(h, clean, c) @ theta
    return left, said


def test_every_deterministic_effect_of_the_catalogue_is_simulated_here() -> None:
    # a bias is no effect of a scenario but its own: `filters.simulation.Truth`
    names = [name for name in catalogue.EFFECTS if name != "bias"]
    assert set(CASES) == {name for name in names if catalogue.EFFECTS[name].include_as == "A"}
    assert names == list(simulation.EFFECTS)


@pytest.mark.parametrize(("name", "number"), ALL)
def test_an_effect_leaves_what_its_regressor_times_its_parameter_says(name: str, number: int) -> None:
    case = CASES[name][number]
    left, said = left_and_said(name, case)
    size = np.linalg.norm(left)
    assert size > 0.0
    units = np.repeat([DEG, 1e-3 * 9.80665], 3)
    worst = np.linalg.norm((left - said) / units) / np.linalg.norm(left / units)
    assert worst < case.tolerance


@pytest.mark.parametrize("name", ["mounting", "lever_arm", "tilt", "gravity", "delay", "earth_rate", "g_sensitivity"])
@pytest.mark.parametrize("seat", list(SEATS))
def test_signs_and_mountings_are_one_physics(name: str, seat: str) -> None:
    case = CASES[name][0]
    left, said = left_and_said(name, case, seat)
    for part in (slice(0, 3), slice(3, 6)):
        # a base that is not level turns Earth rate too: second order, and far below anything
        assert np.linalg.norm(left[:, part] - said[:, part]) <= case.tolerance * np.linalg.norm(left[:, part]) + 1e-6


@pytest.mark.parametrize("name", ["tilt", "gravity", "earth_rate", "delay"])
def test_the_world_does_not_depend_on_how_the_unit_sits(name: str) -> None:

    def in_body(seat: str) -> np.ndarray:
        seen, axes = without_effects(seat, still=False), SEATS[seat]
        h = catalogue.hypothesis(name, (), {})
        columns = np.zeros((seen.t.size, 6, len(h.parameters)))
        for c in h.channels:
            columns[:, c] = regressor(h, seen, c)
        turned = np.moveaxis(columns, 1, 2)
        return np.concatenate([axes.gyro_to_body(turned[..., :3]), axes.accel_to_body(turned[..., 3:])], axis=2)

    straight = in_body("reads +1 g at rest")
    assert np.abs(straight).max() > 0.0
    for seat in SEATS:
        assert np.allclose(in_body(seat), straight, rtol=0.0, atol=1e-9 * np.abs(straight).max())


@pytest.mark.parametrize(("name", "number"), ALL)
def test_parameters_are_in_the_units_that_the_simulator_takes(name: str, number: int) -> None:
    """The units of a report say what the numbers are; that the numbers are the simulator's is shown above."""
    case = CASES[name][number]
    parameters = catalogue.hypothesis(name, case.channels, case.shape).parameters
    assert tuple(p.unit for p in parameters) == case.units
    assert all(p.prior > 0.0 for p in parameters)


def everything() -> list[Hypothesis]:
    found: list[Hypothesis] = list(deterministic.shared())
    for c in range(6):
        found += [*deterministic.of_sensor(c), *deterministic.harmonics(c)]
    return found


def test_an_effect_comes_back_from_its_name_channels_and_shape() -> None:
    for h in everything():
        names = tuple(CHANNELS[c] for c in h.channels)
        shape = json.loads(json.dumps(dict(h.shape)))
        again = catalogue.hypothesis(h.effect, names, shape)
        assert again == h
        assert again.parameters == h.parameters


def test_a_driver_comes_back_with_the_same_columns() -> None:
    """Knots, thresholds and centres of products are kept; only turns, which no filter follows, can't be had again."""
    seen = without_effects("reads +1 g at rest", still=False)
    ranges = dict.fromkeys(drivers.SCALARS, (0.0, 1.0))
    ranges |= {"temperature": (20.0, 33.0), "time": (0.0, 90.0), "wx": (-80.0, 75.0), "fz": (-1.0, 1.0)}
    ranges |= dict.fromkeys(("outer", "middle", "inner"), (-1.0, 9.0))
    for basis in drivers.bases(ranges):
        if basis.name.startswith("turns"):
            continue
        h = basis.on(1)
        kept = dict(h.shape) | ({"knots": list(h.knots)} if h.knots else {})
        again = catalogue.hypothesis(h.effect, ("gy",), json.loads(json.dumps(kept)))
        assert again.effect == h.effect
        assert len(again.parameters) == len(h.parameters) == regressor(h, seen, 1).shape[1]
        assert np.allclose(regressor(again, seen, 1), regressor(h, seen, 1), atol=1e-9)


@pytest.mark.parametrize(
    ("effect", "channels", "shape", "words"),
    [
        ("warm_up", ("gx",), {}, "warm_up"),
        ("warmup", ("gx",), {"tau_s": 41.0}, "tau_s"),
        ("g_sensitivity", ("ax",), {"axes": "x"}, "ax"),
        ("scale", ("gx", "gy"), {}, "one channel"),
        ("driver:moon", ("gx",), {"basis": "hat"}, "moon"),
        ("cause:relay(moon)", ("gx",), {}, "no chain that is known"),
        ("cause:lag(wx)", ("gx",), {}, "tau_s"),
        ("cause:lag(wx)", ("gx",), {"tau_s": 0.0}, "not above zero"),
        ("cause:hold(temperature)", ("gx",), {"period_s": -3.0}, "not above zero"),
        ("cause:relay(temperature)", ("gx",), {"up_degc": 20.0, "down_degc": 30.0}, "that rise"),
        ("cause:curve(lag(temperature))", ("gx",), {"tau_s": 10.0, "knots": [20.0]}, "that rise"),
    ],
)
def test_what_no_effect_is_called_or_shaped_like_is_refused(
    effect: str, channels: tuple[str, ...], shape: dict[str, float], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        catalogue.hypothesis(effect, channels, shape)


def test_hats_are_a_partition_of_unity() -> None:
    """With the first one, which the bias stands for, they sum to one, within the knots and beyond."""
    knots = np.array([0.0, 1.0, 3.0, 7.0])
    at = np.linspace(-2.0, 9.0, 45)
    inner = drivers.hats(at, knots)
    first = np.clip(1.0 - at, 0.0, 1.0)
    assert np.allclose(inner.sum(axis=1) + first, 1.0)
    assert np.allclose(inner @ knots[1:], np.clip(at, 0.0, 7.0))


def test_the_delay_that_is_known_is_no_error() -> None:
    late = replace(MOVING, effects=(Effect("delay", (), {"tau_s": 2e-3}),))
    run = run_of(late, 0, 40.0, TURNED.duration, lsb_k=0.0)
    unknown, known = average(run).y, average(replace(run, latency=np.full(6, 2e-3))).y
    assert np.linalg.norm(known[:, :3]) < 0.1 * np.linalg.norm(unknown[:, :3])
    assert np.linalg.norm(known[:, 3:]) < 0.1 * np.linalg.norm(unknown[:, 3:])

"""Effects as the filter takes them: from the past alone, the same one by one, in the tracer's units and signs."""

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers.runs import QUIET, run_of

from filters import attitude
from filters.channels import DPS
from filters.effects import catalogue
from filters.effects.records import Included, State
from filters.effects.runtime import CausalEffects
from filters.errors import InputError
from filters.imu import CHANNELS, AxisMap, parse_mount
from filters.kalman import augmentation
from filters.motion.kinematics import attitudes
from filters.motion.profile import Profile
from filters.motion.reference import COLUMNS, FORCE, QUATERNION, RATE
from filters.motion.segments import Dwell, Rate, Sine
from filters.simulation import Scenario, Temperature
from filters.state import PAPER_SITE
from filters.tracing.blocks import average
from filters.tracing.residual import perfect
from filters.tracing.run import Run

DEG = np.pi / 180.0
HZ = 10.0
TURNED = Profile(
    (
        Dwell((0.0, 0.0, 0.0), 10.0),
        Rate("inner", 60 * DEG, 10.0),
        Sine("outer", 20 * DEG, 0.2, 20.0),
        Dwell((30 * DEG, 40 * DEG, 45 * DEG), 20.0),
        Rate("middle", -30 * DEG, 2.0),
        Dwell((0.0, 0.0, 0.0), 20.0),
    )
)
AXES = AxisMap(parse_mount("y,z,x"))
HEATED = Temperature(tuple((float(t), 25.0 + 6.0 * np.sin(t / 100.0 - 0.5)) for t in range(101)))


@cache
def run(moving: bool = True) -> Run:
    scene = Scenario(spec=QUIET, axes=AXES, temperature=HEATED, profile=TURNED if moving else None)
    return run_of(scene, 0, HZ, 90.0, lsb_k=0.0)


@cache
def known(moving: bool = True) -> np.ndarray:
    """What the reference says of each sample of the run."""
    own = run(moving)
    rows = np.full((own.t.size, COLUMNS), np.nan)
    x = np.broadcast_to(perfect(own), (own.t.size, 6))
    rows[:, RATE], rows[:, FORCE] = AXES.gyro_to_body(x[:, :3]), AXES.accel_to_body(x[:, 3:])
    rows[:, QUATERNION] = attitude.to_quaternion(attitudes(np.broadcast_to(own.angles, (own.t.size, 3))))
    return rows


def included(effect: str, channels: tuple[str, ...], shape: Mapping[str, Any] | None = None) -> Included:
    h = catalogue.hypothesis(effect, channels, shape or {})
    states = tuple(State(p.name, p.unit, 1.0, p.prior) for p in h.parameters)
    return Included(effect, tuple(CHANNELS[c] for c in h.channels), "A", dict(shape or {}), states)


DRIFT = State("drift", "deg/s", 0.0, 0.01, 80.0, 1e-3)
AVERAGE = {
    "form": "average",
    "low_degc": 22.0,
    "high_degc": 29.0,
    "tau_s": [40.0, 320.0],
    "width_k": [3.0, 3.0],
    "start": [-1.0, 1.0],
    "spreads": 1.0,
    "curve": [0.3, -0.1, 0.05],
    "lag": [0.2, 0.1],
    "play": [0.1, -0.2],
    "curve_1": [0.02, 0.0, 0.01],
    "lag_1": [0.05, -0.05],
    "play_1": [0.0, 0.03],
}
LEVEL = {"driver": "temperature", "knots": [20.0, 25.0, 30.0], "ratio": [1.0, 1.5, 3.0]}
MEMBERS: dict[str, Included] = {
    "thermal_lin": included("thermal_lin", ("gy",)),
    "thermal_poly": included("thermal_poly", ("ax",), {"order": 3.0}),
    "thermal_rate": included("thermal_rate", ("gz",)),
    "thermal_lag": included("thermal_lag", ("gx",), {"tau_s": 40.0}),
    "hysteresis": included("hysteresis", ("ay",), {"width_k": 3.0}),
    "an average": included("hysteresis", ("gz",), AVERAGE),
    "warmup": included("warmup", ("az",), {"tau_s": 70.0}),
    "ramp": included("ramp", ("az",)),
    "scale": included("scale", ("gz",)),
    "asymmetry": included("asymmetry", ("gy",)),
    "nonlinearity_cubic": included("nonlinearity_cubic", ("ax",)),
    "nonlinearity_quadratic": included("nonlinearity_quadratic", ("gx",)),
    "cross_axis": included("cross_axis", ("ax",), {"axes": "yz"}),
    "g_sensitivity": included("g_sensitivity", ("gx",), {"axes": "xyz"}),
    "g_squared": included("g_squared", ("az",), {"axis": "x"}),
    "thermal_scale": included("thermal_scale", ("gx",)),
    "mounting": included("mounting", ()),
    "delay": included("delay", ()),
    "lever_arm": included("lever_arm", ()),
    "tilt": included("tilt", ()),
    "gravity": included("gravity", ()),
    "earth_rate": included("earth_rate", ()),
    "harmonic": included("harmonic", ("gx",), {"axis": "inner", "order": 2.0}),
    "driver:temperature": included("driver:temperature", ("gx",), {"basis": "hat", "knots": [22.1, 27.4]}),
    "driver:angle_inner": included("driver:angle_inner", ("gx",), {"basis": "fourier", "order": 3.0}),
    "cause:relay(temperature)": included("cause:relay(temperature)", ("gz",), {"down_degc": 24.1, "up_degc": 26.2}),
    "cause:curve(lag(temperature))": included(
        "cause:curve(lag(temperature))", ("ay",), {"tau_s": 10.0, "knots": [22.1, 24.0, 27.4]}
    ),
    "cause:hold(temperature)": included("cause:hold(temperature)", ("gx",), {"period_s": 17.0}),
    "cause:lag(wz)": included("cause:lag(wz)", ("ax",), {"tau_s": 10.0}),
    "cause:play(fx)": included("cause:play(fx)", ("ax",), {"width_g": 0.1}),
    "cause:rate(wx)": included("cause:rate(wx)", ("gx",), {"basis": "line"}),
    "gauss_markov": Included("gauss_markov", ("gx",), "S", {}, (DRIFT,)),
    "random_walk": Included("random_walk", ("ay",), "S", {}, (State("drift", "mg", 0.0, 1e-9, np.inf, 0.1),)),
    "tone": Included(
        "tone", ("ax",), "S", {"hz": 0.3}, tuple(State(x, "mg", 0.0, 1.0, 600.0, 0.1) for x in ("sin", "cos"))
    ),
    "noise_level": Included("noise_level", ("gy",), "N", LEVEL),
    "spikes": Included("spikes", ("az",), "P", {"limit": 1.0}),
    "saturation": Included("saturation", ("gz",), "P", {"limit": 50.0}),
}


def causal(*effects: Included, axes: AxisMap = AXES) -> CausalEffects:
    p = sum(len(e.states) for e in effects)
    return CausalEffects(effects, np.eye(p), axes, PAPER_SITE, 1.0 / HZ)


def rows(
    effects: CausalEffects, moving: bool, parts: list[slice], known_rows: np.ndarray | None = None
) -> list[np.ndarray]:
    own = run(moving)
    gyro, accel = AXES.gyro_to_body(own.reading[:, :3]), AXES.accel_to_body(own.reading[:, 3:])
    rng = np.random.default_rng(0)
    accel = accel + np.where(rng.random(accel.shape) < 0.003, 3.0, 0.0) + 1e-3 * rng.standard_normal(accel.shape)
    told = known(moving) if known_rows is None else known_rows
    made = [effects.rows(own.t[s], gyro[s], accel[s], own.temperature[s], told[s]) for s in parts]  # type: ignore[index]
    return [np.concatenate([part[k] for part in made]) for k in range(3)]


def whole(moving: bool = True) -> list[slice]:
    return [slice(0, run(moving).t.size)]


def test_one_by_one_is_all_at_once_to_the_last_bit() -> None:
    told = known().copy()
    told[300:380] = np.nan
    n = 500
    members = list(MEMBERS.values())
    together = rows(causal(*members), True, [slice(0, n)], told)
    singly = rows(causal(*members), True, [slice(k, k + 1) for k in range(n)], told)
    chunks = rows(causal(*members), True, [slice(k, min(k + 37, n)) for k in range(0, n, 37)], told)
    names = causal(*members).names
    for other in (singly, chunks):
        different = [names[k] for k in range(len(names)) if together[0][..., k].tobytes() != other[0][..., k].tobytes()]
        assert not different
        assert together[1].tobytes() == other[1].tobytes()
        assert together[2].tobytes() == other[2].tobytes()


def test_memory_goes_on_in_other_effects_to_the_last_bit() -> None:
    members = [
        MEMBERS[name]
        for name in ("thermal_lin", "thermal_rate", "thermal_lag", "hysteresis", "cause:relay(temperature)")
    ]
    n, cut = 600, 251
    together = rows(causal(*members), False, [slice(0, n)])[0][cut:]
    first, second, forgetful = (causal(*members) for _ in range(3))
    assert first.memory() == ""
    rows(first, False, [slice(0, cut)])
    second.restore(first.memory())
    assert rows(second, False, [slice(cut, n)])[0].tobytes() == together.tobytes()
    assert rows(forgetful, False, [slice(cut, n)])[0].tobytes() != together.tobytes()


def test_all_members_together_are_what_the_filter_asks_for() -> None:
    effects = causal(*MEMBERS.values())
    augmentation.check(effects)
    phi, scale, use = rows(effects, True, whole())
    augmentation.check_rows(effects.names, run().t, phi, scale, use)
    assert phi.any(axis=0).any(axis=0).all()
    assert len(effects.names) == len(set(effects.names))


LOOSE = {"thermal_rate": 0.1, "thermal_lag": 0.1, "lever_arm": 0.4, "delay": 0.15, "cause:rate(wx)": 0.4}
# a block is as long as it takes a lag of 10 s to go a fortieth of its way
LOOSE |= {"cause:lag(wz)": 0.06}
PLAIN = [name for name, e in MEMBERS.items() if e.include_as == "A"]


def test_every_constant_effect_is_compared() -> None:
    constant = {name for name, entry in catalogue.EFFECTS.items() if entry.include_as == "A"}
    # no filter has a bias beside its own: it is what is found of units turned by hand
    assert constant - {MEMBERS[name].effect for name in PLAIN} == {"bias"}


@pytest.mark.parametrize("name", PLAIN)
def test_the_filter_takes_what_the_tracer_fitted(name: str) -> None:
    e = MEMBERS[name]
    h = catalogue.hypothesis(e.effect, e.channels, e.parameters)
    own = average(run())
    theirs = np.zeros((own.t.size, 6, len(e.states)))
    for c in h.channels:
        if h.is_slow:
            theirs[:, c] = h.columns(own.slow(), c)
        else:
            out = np.empty((own.t.size, len(e.states)))
            own.mean([(lambda inputs, c=c: h.columns(inputs, c), slice(None))], out)  # type: ignore[misc]
            theirs[:, c] = out
    theirs = theirs * np.array([p.si for p in h.parameters])
    turned = np.moveaxis(theirs, 1, 2)
    body = np.concatenate([AXES.accel_to_body(turned[..., 3:]), AXES.gyro_to_body(turned[..., :3])], axis=2)
    phi = rows(causal(e), True, whole())[0]
    edges = np.append(own.edges, [])[:-1].astype(int)
    ours = np.add.reduceat(phi, edges, axis=0) / np.diff(own.edges)[:, None, None]
    ours = np.moveaxis(ours, 1, 2)
    limit = LOOSE.get(name, 0.03)
    late = own.t > 20.0  # the first rate is not known
    ours, body = ours[late], body[late]
    assert np.linalg.norm(ours - body) < limit * np.linalg.norm(body)
    assert np.sum(ours * body) > 0.6 * np.sum(body**2)


def test_with_all_temperatures_at_hand_a_rate_does_not_lag() -> None:
    """As the tracer has it, and the same whether samples come one by one or many at once."""
    e, n = MEMBERS["thermal_rate"], run(False).t.size
    theirs = average(run(False)).slow().temperature_rate * DPS
    made = []
    for parts in (whole(False), [slice(k, min(k + 37, n)) for k in range(0, n, 37)]):
        effects = causal(e)
        effects.look_ahead(run(False).temperature)  # type: ignore[arg-type]
        phi = rows(effects, False, parts)[0]
        made.append(AXES.gyro_to_instrument(np.moveaxis(phi[:, 3:], 1, 2))[:, 0, 2])
    edges = average(run(False)).edges
    ours = np.add.reduceat(made[0], edges[:-1]) / np.diff(edges)
    assert made[0].tobytes() == made[1].tobytes()
    assert np.linalg.norm(ours - theirs) < 0.02 * np.linalg.norm(theirs)


def test_temperatures_at_hand_go_on_from_what_the_file_before_remembered() -> None:
    members = [MEMBERS[name] for name in ("thermal_lag", "hysteresis")]
    T, n = run(False).temperature, run(False).t.size
    assert T is not None
    cut = n // 2
    whole_log, first, second, forgetful = (causal(*members) for _ in range(4))
    whole_log.look_ahead(T)
    together = rows(whole_log, False, whole(False))[0][cut:]
    rows(first, False, [slice(0, cut)])
    second.restore(first.memory())
    for effects in (second, forgetful):
        effects.look_ahead(T[cut:])
    of_second, of_forgetful = (rows(effects, False, [slice(cut, n)])[0] for effects in (second, forgetful))
    assert np.linalg.norm(of_second - together) < 0.1 * np.linalg.norm(of_forgetful - together)


def test_a_memory_that_none_gave_is_refused() -> None:
    effects = causal(MEMBERS["thermal_lin"])
    rows(effects, False, [slice(0, 10)])
    found = json.loads(effects.memory())
    found["smooth"][4] = -1.0
    with pytest.raises(InputError, match="variance below zero"):
        causal(MEMBERS["thermal_lin"]).restore(json.dumps(found))


def test_temperature_does_not_lag_on_a_ramp() -> None:
    own = run(False)
    ramp = 20.0 + 0.1 * own.t
    effects = causal(MEMBERS["thermal_lin"], MEMBERS["thermal_rate"])
    zeros = np.zeros((own.t.size, 3))
    phi, _, _ = effects.rows(own.t, zeros, zeros, ramp, known(False))
    gyro = AXES.gyro_to_instrument(np.moveaxis(phi[:, 3:], 1, 2))
    late = own.t > 60.0
    assert np.allclose(gyro[late, 0, 1] / DPS + 25.0, ramp[late], atol=0.002)
    assert np.allclose(gyro[own.t > 85.0, 1, 2] / DPS, 0.1, atol=0.003)


def test_a_temperature_that_is_missing_is_the_last_one() -> None:
    own = run(False)
    T = np.full(own.t.size, 30.0)
    T[200:600] = np.nan
    zeros = np.zeros((own.t.size, 3))
    phi, _, _ = causal(MEMBERS["thermal_lin"]).rows(own.t, zeros, zeros, T, known(False))
    assert np.allclose(np.abs(phi).sum(axis=1)[:, 0] / DPS, 5.0)


def test_a_noise_level_multiplies_its_own_channel() -> None:
    scale = rows(causal(MEMBERS["noise_level"]), False, whole(False))[1]
    ours = np.flatnonzero(np.ptp(scale, axis=0) > 0.1)
    assert ours.size == 1
    axis = np.flatnonzero(np.abs(AXES.mount)[:, 1])[0]
    assert ours[0] == 3 + axis
    assert scale[:, ours[0]] == pytest.approx(
        np.interp(run(False).temperature, LEVEL["knots"], LEVEL["ratio"]), abs=0.03
    )
    assert np.all(np.delete(scale, ours[0], axis=1) == 1.0)


def test_readings_at_a_limit_and_spikes_are_predicted_through() -> None:
    own = run(False)
    n = own.t.size
    gyro, accel = np.zeros((n, 3)), np.tile([0.0, 0.0, -9.8], (n, 1))
    at_limit = AXES.gyro_to_body(np.array([0.0, 0.0, 50.0 * DEG]))
    gyro[300:310] = at_limit
    spike = AXES.accel_to_body(np.array([0.0, 0.0, 0.5]))
    accel[700] += spike
    effects = causal(MEMBERS["saturation"], MEMBERS["spikes"])
    use = effects.rows(own.t, gyro, accel, np.full(n, 25.0), np.full((n, COLUMNS), np.nan))[2]
    # without a reference what is sensed is the reading, and no spike is told from it
    assert np.flatnonzero(~use).tolist() == list(range(300, 310))
    effects = causal(MEMBERS["saturation"], MEMBERS["spikes"])
    use = effects.rows(own.t, gyro, accel, np.full(n, 25.0), known(False))[2]
    assert np.flatnonzero(~use).tolist() == [*range(300, 310), 700]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (replace(MEMBERS["thermal_lin"], states=(State("k", "mg/K", 0.1, 0.1),)), "unit"),
        (replace(MEMBERS["tilt"], states=MEMBERS["tilt"].states[:1]), "2 states"),
        (Included("driver:turns_inner", ("gx",), "A", {"basis": "line"}, (DRIFT,)), "past motion"),
        (Included("moonlight", ("gx",), "A", {}, (DRIFT,)), "moonlight"),
    ],
)
def test_what_the_filter_cannot_have_is_refused(wrong: Included, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        causal(wrong)


def test_nothing_is_known_of_the_future() -> None:
    effects = [e for e in MEMBERS.values() if e.include_as in ("A", "S")]
    n = run().t.size
    full = rows(causal(*effects), True, whole())[0]
    half = rows(causal(*effects), True, [slice(0, n // 2)])[0]
    assert full[: n // 2].tobytes() == half.tobytes()

"""How to apply a result: the lines on a page do what the filter does, files have the units of whom they are for."""

import ctypes
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import traces

from filters.channels import DPS, G
from filters.effects.records import Included, State
from filters.effects.runtime import CausalEffects
from filters.tracing.result import Trace
from imutui.jobs import linear_correction, residuals
from imutui.jobs.linear_correction import LinearCorrection, Term
from imutui.jobs.page_data import LogData
from imutui.jobs.residuals import NoiseLevel
from imutui.logbook import effects_file
from imutui.logbook.session_info import SessionInfo
from imutui.report import how_to_apply
from imutui.report.blocks import Code, Items

INCLUDED = (
    Included("thermal_lin", ("gy",), "A", {}, (State("k", "deg/s/K", 0.02, 0.001),)),
    Included("thermal_poly", ("ax",), "A", {"order": 3.0},
             tuple(State(f"k{n}", f"mg/K{n if n > 1 else ''}", 0.3 / 10**n, 0.01) for n in (1, 2, 3))),
    Included("scale", ("gz",), "A", {}, (State("k", "1", 0.004, 1e-4),)),
    Included("cross_axis", ("ay",), "A", {"axes": "xz"},
             (State("x", "rad", 2e-3, 1e-4), State("z", "rad", -3e-3, 1e-4))),
    Included("g_sensitivity", ("gx",), "A", {"axes": "z"}, (State("z", "deg/s/g", 0.05, 1e-3),)),
)  # fmt: skip
DRIFT = Included("gauss_markov", ("gx",), "S", {}, (State("b", "deg/s", 0.01, 0.004, 80.0, 6e-4),))
LAG = Included("thermal_lag", ("gz",), "A", {"tau_s": 80.0}, (State("k", "deg/s/K", 0.01, 1e-3),))
BIAS = (0.5, -0.25, 0.125, 2.0, -3.0, 12.0)
INFO = SessionInfo(mount="x,-y,-z", rate_hz=20.0)
READING = np.array([12.0, -3.0, 80.0, 0.1, -0.2, 0.97])
TEMPERATURE = 41.5


def text(*included: Included) -> str:
    """An effects file."""
    made = traces.trace()
    states = sum(len(effect.states) for effect in included)
    return effects_file.dumps(Trace(made.document, included, np.eye(states), made.series), "trace of a.mcap")


def filtered() -> np.ndarray:
    """What a filter that knows only the reading takes it for, gx … az in deg/s and g."""
    effects = effects_file.build(effects_file.parse(text(*INCLUDED).encode()), INFO)
    axes = INFO.axes()
    gyro, accel = axes.gyro_to_body(READING[None, :3] * DPS), axes.accel_to_body(READING[None, 3:] * G)
    phi, _, _ = effects.rows(np.zeros(1), gyro, accel, np.array([TEMPERATURE]), np.full((1, 25), np.nan))
    error = phi[0] @ effects.mean
    bias = np.array(BIAS) * np.repeat([DPS, 1e-3 * G], 3)
    gyro_ = axes.gyro_to_instrument(gyro[0] - error[3:] - axes.gyro_to_body(bias[:3])) / DPS
    accel_ = axes.accel_to_instrument(accel[0] - error[:3] - axes.accel_to_body(bias[3:])) / G
    return np.concatenate([gyro_, accel_])


def sensed() -> np.ndarray:
    """What the reading is of: bias, temperature, and effects of what is sensed, in the units of the reading."""
    dT, A = TEMPERATURE - 25.0, np.zeros((6, 6))
    A[2, 2], A[4, 3], A[4, 5], A[0, 5] = 0.004, 2e-3, -3e-3, 0.05
    thermal = np.array([0.0, 0.02 * dT, 0.0, 3e-4 * (dT / 10 + dT**2 / 100 + dT**3 / 1000), 0.0, 0.0])
    bias = np.array(BIAS) * np.repeat([1.0, 1e-3], 3)
    return np.linalg.solve(np.eye(6) + A, READING - bias - thermal)


@pytest.fixture(scope="module", params=["sensed", "read"])
def made(request: pytest.FixtureRequest) -> LinearCorrection:
    terms = linear_correction.of_effects_file(text(*INCLUDED, DRIFT, LAG))
    return linear_correction.of_terms(BIAS, terms, of_reading=request.param == "read")


def wanted(made: LinearCorrection) -> np.ndarray:
    return filtered() if made.of_reading else sensed()


def test_lines_of_python_correct_a_reading_as_the_model_and_the_filter_do(made: LinearCorrection) -> None:
    lines = how_to_apply.python(made)
    assert len(lines.splitlines()) == 3
    scope: dict[str, Any] = {"reading": READING, "temperature": TEMPERATURE}
    exec(lines, scope)
    np.testing.assert_allclose(scope["corrected"], wanted(made), rtol=1e-7, atol=1e-9)


def test_lines_of_c_correct_a_reading_as_the_model_and_the_filter_do(made: LinearCorrection, tmp_path: Path) -> None:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler here: apt-get install gcc")
    lines = how_to_apply.c_lines(made)
    assert len(lines.splitlines()) == 3
    source = tmp_path / "lines.c"
    source.write_text(
        "void correct(const double *reading, double temperature, double *out);\n"
        f"void correct(const double *reading, double temperature, double *out)\n{{\n{lines}\n"
        "for (int i = 0; i < 6; i++) out[i] = corrected[i];\n}\n"
    )
    library = tmp_path / "lines.so"
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O0", "-shared", "-fPIC", "-nostdlib"]
    subprocess.run([compiler, *flags, "-o", library, source], check=True, timeout=60)
    six = ctypes.c_double * 6
    out = six()
    ctypes.CDLL(str(library)).correct(six(*READING), ctypes.c_double(TEMPERATURE), out)
    np.testing.assert_allclose(out, wanted(made), rtol=1e-7, atol=1e-9)


def test_what_takes_more_than_a_reading_is_left_out_and_said(made: LinearCorrection) -> None:
    assert made.left_out == ("gx: bias drifts", "gz: bias lags behind temperature")


def test_a_results_states_are_the_terms_of_its_effects_file() -> None:
    effects = CausalEffects(INCLUDED, np.eye(8), INFO.axes(), INFO.site(), 0.05)
    states: Any = [
        {"name": name, "value": value, "sd": 0.1} for name, value in zip(effects.names, effects.mean, strict=True)
    ]
    assert linear_correction.of_states(states) == linear_correction.of_effects_file(text(*INCLUDED))
    (odd,) = linear_correction.of_states([{"name": "nonsense", "value": 1.0, "sd": 0.1}])
    assert linear_correction.of_terms(BIAS, [odd]).left_out == ("nonsense",)


def test_constant_biases_alone_take_no_more_than_they_need() -> None:
    plain = linear_correction.of_terms((*BIAS[:5], None), ())
    assert how_to_apply.python(plain).splitlines()[2] == "corrected = reading - bias"
    assert "temperature" not in how_to_apply.c_lines(plain)
    assert plain.bias.tolist() == [0.5, -0.25, 0.125, 2e-3, -3e-3, 0.0]


def test_kalibr_gets_its_units_and_what_the_log_cannot_give_is_left_out() -> None:
    levels = {
        "gx": NoiseLevel(1e-3, 1e-5, 0.0),
        "gz": NoiseLevel(2e-3, 1e-5, 0.0),
        "ay": NoiseLevel(1.5e-2, 1e-4, 3e-4),
    }
    found = how_to_apply.imu_yaml(levels, 133.25, 600.0, "a.mcap")
    rows = dict(line.split("#")[0].split(": ") for line in found.text.splitlines()[1:])
    assert {key: value.strip() for key, value in rows.items()} == {
        "accelerometer_noise_density": "1.500e-02",
        "accelerometer_random_walk": "3.000e-04",
        "gyroscope_noise_density": "2.000e-03",
        "rostopic": "/imu/data_raw",
        "update_rate": "133.25",
    }
    assert [lack.partition(":")[0] for lack in found.lacks] == ["gyroscope_random_walk"]
    levels["gz"] = NoiseLevel(2e-3, 1e-5, 5e-5)
    terms = [Term((c,), name, "k", "", 1.0) for c, name in (("ay", "thermal_lin"), ("gz", "random_walk"))]
    moved = how_to_apply.imu_yaml(levels, 133.25, 600.0, "a.mcap", terms)
    assert "accelerometer_random_walk" not in moved.text
    assert "gyroscope_random_walk: 5.000e-05" in moved.text  # a walk that was found is the walk
    assert "look like a walk (ay: bias follows temperature)" in moved.lacks[0]
    levels["gz"] = replace(levels["gz"], follows_temperature=True)
    warm = how_to_apply.imu_yaml(levels, 133.25, 600.0, "a.mcap")
    assert "accelerometer_random_walk: 3" in warm.text
    assert warm.lacks[0].startswith("gyroscope_random_walk: the readings follow the temperature")
    assert "update_rate" in how_to_apply.imu_yaml({}, None, None, "a.mcap").lacks[-1]


def test_a_residual_that_follows_the_temperature_is_told_from_noise() -> None:
    T = np.linspace(20.0, 40.0, 2000)
    noise = np.random.default_rng(3).standard_normal((2000, 6))
    warm = noise + np.outer((T - 30.0) ** 2, [0.0, 0.1, 0.0, 0.0, 0.0, 0.0])
    warm[500:600] = np.nan
    assert residuals.follow_temperature(warm, T).tolist() == [False, True, False, False, False, False]
    assert not residuals.follow_temperature(warm, T / 40.0).any()


def test_files_of_the_section_lie_beside_the_page() -> None:
    content = text(*INCLUDED)
    log = LogData(levels={"gx": NoiseLevel(1e-3, 1e-5, 0.0)}, effects=content)
    d: Any = {**traces.whole_document(), "effects_file": content}
    section = how_to_apply.of_trace(d, log)
    files = how_to_apply.files(section.blocks)
    assert set(files) == {"imu.yaml", "effects.toml"}
    assert effects_file.parse(files["effects.toml"].encode()).effects == INCLUDED
    assert any(isinstance(block, Code) and block.folded for block in section.blocks)
    assert any(isinstance(block, Items) for block in section.blocks)

"""From logs to runs: what stands in a run is what the log holds, and what contradicts itself is refused with a cure."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import logs
from helpers.documents import dwell, profile_file, rate
from helpers.traces import arrays, imported, readings, tumble

from filters.attitude import to_quaternion
from filters.imu import AxisMap, Samples, parse_mount
from filters.motion.kinematics import angles_of, attitudes
from filters.tracing import residual
from filters.tracing.run import Run
from imutui.jobs import run_consistency, runs
from imutui.jobs.runs import LoggedRun
from imutui.logbook import trajectory_file
from imutui.logbook.reading import Reading
from imutui.logbook.reference_file import ReferenceFile
from imutui.logbook.session_info import SessionInfo

DWELLS = dwell(30.0), dwell(30.0, 90.0), rate("inner", 20.0, 10.0)


def read(path: Path, file: ReferenceFile | None = None, **overrides: Any) -> LoggedRun:
    return runs.read_run(path, path.stem, Reading(overrides=overrides, reference=file))


def recorded(path: Path, reference: ReferenceFile, hz: float = 20.0, late: float = 0.0, marks: tuple[float, ...] = (),
             gyro_late: float = 0.0, **info: Any) -> Path:  # fmt: skip
    """A perfect unit's log on a profile that starts `late` s after the log; its gyros may read later still."""
    motion = reference.motion()
    t = np.arange(int((motion.duration + late) * hz)) / hz
    angles, rates = motion.angles(t - late), motion.rates(t - late - gyro_late)
    axes = AxisMap()
    gyro, accel = readings(t, np.rad2deg(angles), np.rad2deg(rates), axes)
    session = SessionInfo(rate_hz=hz, kind="simulated", reference="profile", **info)
    samples = Samples(t, axes.gyro_to_body(np.deg2rad(gyro)), axes.accel_to_body(accel * session.g_unit))
    return logs.of_samples(path, samples, session, reference, [(mark, "next") for mark in marks], {7})


def worst(run: Run) -> tuple[float, float]:
    r = residual.residual(run)
    return float(np.nanmax(np.abs(r[:, :3]))), float(np.nanmax(np.abs(r[:, 3:])))


# -- what a run holds -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("hz", "sign", "moving"), [(20.0, -1, True), (100.0, 1, True), (20.0, 1, False)])
def test_an_imported_recording_with_angles_traces_exactly(tmp_path: Path, hz: float, sign: int, moving: bool) -> None:
    given = arrays(90.0, hz, sign, moving=moving)
    got = read(imported(tmp_path / "a.mcap", given, accel_sign=sign))
    run_consistency.check_reference(got)
    gyro, accel = worst(got.run)
    assert gyro < 1e-12
    assert accel < 1e-12
    assert got.run.still is not moving
    assert got.run.flagged is None
    assert got.run.temperature is not None
    assert np.allclose(got.run.temperature, given["temp"], atol=1e-12)
    assert np.allclose(got.run.reading[:, 3:] / 9.80665, given["accel"], atol=1e-12)
    assert (got.run.lsb, got.run.bandwidth) == (None, None)


def test_angles_that_change_now_and_then_hold_in_between(tmp_path: Path) -> None:
    """A log has a row where an angle changes, and one a second at rest: no line is drawn into the rest."""
    given = arrays(90.0)
    got = read(imported(tmp_path / "a.mcap", given))
    assert np.allclose(np.rad2deg(got.run.angles), given["ang"], atol=1e-9)
    assert np.allclose(np.rad2deg(got.run.rates), given["rate"], atol=1e-9)


def test_rates_come_from_the_angles_where_the_recording_has_none(tmp_path: Path) -> None:
    given = arrays(90.0, 100.0)
    del given["rate"]
    rate = tumble(given["t"])[1]
    given["ang"] = given["ang"] % 360.0
    got = read(imported(tmp_path / "a.mcap", given))
    inner = slice(2200, -2)
    assert np.allclose(np.rad2deg(got.run.rates[inner]), rate[inner], atol=2e-3)


def by_quaternions(given: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same recording with its attitude in east, north, up instead of a table's angles."""
    enu = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    quaternions = np.array([to_quaternion(enu.T @ C) for C in attitudes(np.deg2rad(given["ang"]))])
    return {key: values for key, values in given.items() if key not in ("ang", "rate")} | {"ref_quat": quaternions}


def test_quaternions_serve_as_angles_do(tmp_path: Path) -> None:
    given = by_quaternions(arrays(90.0, 100.0))
    given["ref_quat"][100:300] = np.nan
    got = read(imported(tmp_path / "a.mcap", given))
    run_consistency.check_reference(got)
    gyro, accel = worst(got.run)
    assert gyro < np.deg2rad(0.02)
    assert accel < 1e-6
    assert got.run.flagged is not None
    # the rows beside the gap have an attitude, and a rate from one side only
    assert 200 <= got.run.flagged[:, 0].sum() <= 202
    assert "not known" in got.how


def test_angles_of_an_attitude_are_those_it_was_made_of() -> None:
    angles = np.random.default_rng(1).uniform(-1.0, 1.0, (200, 3)) * [3.1, 1.5, 3.1]
    assert np.allclose(angles_of(attitudes(angles)), angles, atol=1e-9)


def test_a_mounted_unit_reads_in_its_own_axes(tmp_path: Path) -> None:
    given = arrays(90.0)
    axes = AxisMap(parse_mount("x,-y,-z"), 1)
    given["gyro"], given["accel"] = readings(given["t"], given["ang"], given["rate"], axes)
    got = read(imported(tmp_path / "a.mcap", given, accel_sign=1, mount="x,-y,-z"))
    assert max(worst(got.run)) < 1e-12
    assert np.allclose(np.rad2deg(got.run.reading[:, :3]), given["gyro"], atol=1e-12)


def test_gravity_gives_a_still_unit_its_attitude(tmp_path: Path) -> None:
    given = arrays(90.0, moving=False)
    given["ang"] = given["ang"] + [3.0, -4.0, 0.0]
    given["gyro"], given["accel"] = readings(given["t"], given["ang"], given["rate"], AxisMap())
    del given["ang"], given["rate"]
    got = read(imported(tmp_path / "a.mcap", given), reference="gravity")
    assert got.run.C_nb is not None
    assert worst(got.run)[1] < 1e-9
    assert worst(read(tmp_path / "a.mcap", reference="level").run)[1] > 0.3


@pytest.mark.parametrize(("align", "late"), [("none", 0.0), ("gyro", 12.3)])
def test_a_profile_gives_angles_at_every_sample(tmp_path: Path, align: str, late: float) -> None:
    reference = profile_file(*DWELLS, align=align)
    got = read(recorded(tmp_path / "a.mcap", reference, late=late))
    run_consistency.check_reference(got)
    run = got.run
    plain = Run(**{**vars(run), "latency": np.zeros(6)})
    assert worst(plain)[0] < np.deg2rad(0.5 if late else 1e-9)
    assert run.flagged is not None
    assert np.flatnonzero(run.flagged[:, 0]).tolist() == [7]


def test_gyros_that_read_late_do_not_make_the_profile_late(tmp_path: Path) -> None:
    """What they are late by is known, and taken off the instant found from them; it is not taken for a delay twice."""
    latency = 0.00334
    reference = profile_file(*DWELLS, *DWELLS[:2], rate("middle", 20.0, 10.0), align="gyro")
    got = read(recorded(tmp_path / "a.mcap", reference, hz=100.0, late=12.3, gyro_late=latency))
    assert got.run.latency[:3] == pytest.approx(latency, abs=1e-4)
    start = float(got.how.split("starts at ")[1].split(" ")[0])
    assert start == pytest.approx(12.3, abs=1e-3)


def test_by_marks_only_dwells_are_known(tmp_path: Path) -> None:
    got = read(recorded(tmp_path / "a.mcap", profile_file(*DWELLS, align="marks"), marks=(0.0, 36.0)))
    run = got.run
    assert run.flagged is not None
    used = ~run.flagged[:, 0]
    assert used[50]
    assert not used[20 * 31 : 20 * 38].any()
    assert used[20 * 40]
    assert not used[20 * 70 :].any()
    assert worst(run)[1] < 1e-9
    assert "only dwells" in got.how


def test_the_crossbow_brings_its_own_figures(tmp_path: Path) -> None:
    run = read(recorded(tmp_path / "a.mcap", profile_file(*DWELLS))).run
    assert run.lsb is not None
    assert np.rad2deg(run.lsb[0]) == pytest.approx(200.0 * 1.5 / 2**15)
    assert run.lsb[5] / 9.80665 == pytest.approx(4.0 * 1.5 / 2**15)
    assert run.bandwidth is not None
    assert run.bandwidth.tolist() == [25.0] * 3 + [75.0] * 3
    pole = np.exp(-2.0 * np.pi * 25.0 * 3.0 / 400.0)
    assert run.latency[0] == pytest.approx(pole / (1.0 - pole) * 3.0 / 400.0)
    assert np.all(run.latency > 0.0)


def test_an_imu381_brings_the_size_of_its_counts(tmp_path: Path) -> None:
    """Its low-pass filters are set in the unit: what they do is found, and not assumed."""
    path = recorded(tmp_path / "a.mcap", profile_file(*DWELLS), instrument="IMU381ZA-400")
    run = read(path).run
    assert run.lsb is not None
    assert np.rad2deg(run.lsb[0]) == pytest.approx(1260.0 / 2**16)
    assert run.lsb[5] / 9.80665 == pytest.approx(20.0 / 2**16)
    assert run.bandwidth is None
    assert not run.latency.any()


# -- what is refused --------------------------------------------------------------------------------------------------


def test_a_log_read_in_parts_is_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A day is gone through in parts: where they end changes no reading and no temperature."""
    path = imported(tmp_path / "log.mcap", arrays(seed=1))
    whole = read(path).run
    monkeypatch.setattr(runs, "_AT_ONCE", 137)
    parts = read(path).run
    assert np.array_equal(parts.reading, whole.reading)
    assert whole.temperature is not None
    assert np.ptp(whole.temperature) > 0.0
    assert np.array_equal(np.asarray(parts.temperature), whole.temperature)


def late(given: dict[str, np.ndarray]) -> None:
    """Readings of a motion that is 1.5 s later than the angles say, with noise."""
    gyro, given["accel"] = readings(given["t"], *tumble(given["t"] - 1.5), AxisMap())
    given["gyro"] = gyro + np.random.default_rng(1).normal(size=gyro.shape) * 0.05


def changed(key: str, of: Callable[[np.ndarray], np.ndarray]) -> Callable[[dict[str, np.ndarray]], None]:
    """Puts other values in place of an array."""
    return lambda given: given.update({key: of(given[key])})


def at_rest(given: dict[str, np.ndarray]) -> None:
    del given["ang"], given["rate"]


CONTRADICTIONS: dict[str, tuple[Callable[[dict[str, np.ndarray]], None], dict[str, Any], str]] = {
    "sign": (lambda given: None, {"sign": 1}, r"opposite.*2\.\d\d g.*--accel-sign \+1.*other way up"),
    "angles": (changed("ang", lambda x: np.add(x, [0.0, 20.0, 0.0])), {"moving": False},
               r"gravity is felt 20°.*--reference gravity"),
    "time": (late, {}, r'1\.[45]\d s late.*\+1\.[45]\d s.*align = "gyro"'),
    "axis": (changed("gyro", lambda x: x * [1.0, -1.0, -1.0]), {}, r"gyro y(, z)? reads the opposite.*--gyro-sign"),
    "motion": (changed("gyro", lambda x: x[:, [1, 2, 0]]), {}, r"do not follow the reference.*--mount"),
    "units": (changed("accel", lambda x: x * 9.80665), {"moving": False}, r"magnitude 96 m/s².*accel in g"),
    "radians": (changed("gyro", np.deg2rad), {}, r"sees 2 % of its rate.*rates in deg/s"),
    "rest": (at_rest, {}, r"the unit moves.*--reference FILE"),
}  # fmt: skip


@pytest.mark.parametrize("case", CONTRADICTIONS)
def test_a_reference_that_contradicts_the_readings_is_refused(tmp_path: Path, case: str) -> None:
    change, how, said = CONTRADICTIONS[case]
    given = arrays(90.0, seed=1, **how)
    change(given)
    log = imported(tmp_path / "a.mcap", given, accel_sign=-1)
    got = read(log, **({"reference": "level"} if case == "rest" else {}))
    with pytest.raises(ValueError, match=said):
        run_consistency.check_reference(got)


@pytest.mark.parametrize("channel", range(6))
@pytest.mark.parametrize("value", [0.0, 0.3, 1.0])
def test_a_dead_channel_is_no_contradiction(tmp_path: Path, channel: int, value: float) -> None:
    """It is a data fault: the tracer names it and traces the rest."""
    given = arrays(90.0, seed=1)
    (given["gyro"] if channel < 3 else given["accel"])[:, channel % 3] = value
    run_consistency.check_reference(read(imported(tmp_path / "a.mcap", given)))


@pytest.mark.parametrize("axis", range(3))
def test_an_accelerometer_that_is_dead_is_no_contradiction_of_an_attitude(tmp_path: Path, axis: int) -> None:
    """Where only the attitude is known accelerometers are used at rest alone: there it never changes."""
    given = by_quaternions(arrays(90.0, 100.0, seed=1))
    given["accel"][:, axis] = 0.3
    run_consistency.check_reference(read(imported(tmp_path / "a.mcap", given)))


def test_errors_of_a_bad_unit_are_no_contradiction(tmp_path: Path) -> None:
    """Ten times what the catalogue calls plausible is still the unit's."""
    given = arrays(90.0, seed=1)
    given["gyro"] = given["gyro"] * 1.05 + [5.0, -5.0, 3.0]
    given["accel"] = given["accel"] * 0.97 + [0.05, -0.05, 0.04]
    run_consistency.check_reference(read(imported(tmp_path / "a.mcap", given)))


def test_a_trajectory_without_attitude_is_refused(tmp_path: Path) -> None:
    """Position and velocity alone do not say what a gyro should read."""
    log = imported(tmp_path / "a.mcap", {k: v for k, v in arrays(90.0).items() if k not in ("ang", "rate")})
    columns = ",".join(trajectory_file.COLUMNS[:7])
    text = f"{columns}\n" + "\n".join(f"{t},-23.2,-45.8,641,0,0,0" for t in range(90))
    reference = ReferenceFile("trajectory", "reference.csv", "text/csv", text.encode())
    with pytest.raises(ValueError, match=r"no attitude.*--reference gravity"):
        read(log, reference)


OTHERS = {
    "serial number 11 and 12": {"serial_number": "12"},
    "instrument AHRS and VG": {"instrument": "VG"},
    "different signs": {"accel_sign": 1},
    "different mountings": {"mount": "y,-x,z"},
    "different sites": {"gravity_mps2": 9.81},
    "measured and simulated": {"kind": "simulated"},
}


@pytest.mark.parametrize("words", OTHERS)
def test_logs_that_do_not_belong_together_are_refused(tmp_path: Path, words: str) -> None:
    given = arrays(61.0, moving=False)
    del given["ang"], given["rate"]
    first = {"serial_number": "11", "instrument": "AHRS", "kind": "measured"}
    one = read(imported(tmp_path / "a.mcap", given, **first), reference="gravity")
    given["gyro"] = given["gyro"] + 0.1
    two = read(imported(tmp_path / "b.mcap", given, **first | OTHERS[words]), reference="gravity")
    with pytest.raises(ValueError, match=words):
        run_consistency.check_together([one, two])


def test_a_run_counts_once(tmp_path: Path) -> None:
    one = read(imported(tmp_path / "a.mcap", arrays(61.0)))
    with pytest.raises(ValueError, match="given twice"):
        run_consistency.check_together([one, one])
    (tmp_path / "b.mcap").write_bytes((tmp_path / "a.mcap").read_bytes())
    with pytest.raises(ValueError, match="the same samples"):
        run_consistency.check_together([one, read(tmp_path / "b.mcap")])


def test_what_logs_cannot_give_is_said_first(tmp_path: Path) -> None:
    given = arrays(61.0, moving=False)
    given["temp"] = np.full_like(given["t"], 25.0)
    still = read(imported(tmp_path / "a.mcap", given))
    said = " ".join(run_consistency.expectations([still], still))
    assert "temperature is constant" in said
    assert "never moves" in said
    assert "under 300 s" in said
    del given["temp"]
    bare = read(imported(tmp_path / "b.mcap", given))
    assert "no temperature" in " ".join(run_consistency.expectations([bare], None))

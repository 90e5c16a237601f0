import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import logs, ros_messages
from helpers.acquisitions import untimed
from helpers.documents import dwell, profile_file, rate
from mcap.reader import make_reader

from filters import attitude, simulation, state
from filters.imu import IMU400CD_200, STANDARD_GRAVITY, Samples
from filters.kalman import runner
from filters.kalman.rows import Estimate
from filters.kalman.runner import Estimator
from filters.motion import kinematics, reference
from filters.motion.profile import Profile
from filters.simulation import Truth
from filters.state import PAPER_SITE
from imutui.jobs import replay as job
from imutui.jobs import replay_input
from imutui.jobs.replay import EstimatesFile, replay
from imutui.logbook import SessionInfo, reader, schemas, trajectory_file
from imutui.logbook.reading import Reading
from imutui.logbook.reference_file import ReferenceFile
from imutui.logbook.trajectory_file import Trajectory

SPEC = IMU400CD_200
BIAS = Truth(np.array([0.06, -0.04, 0.08]), np.deg2rad([0.5, -0.7, 0.3]))

SEGMENTS = dwell(6.0), dwell(8.0, middle=90.0), dwell(8.0, 90.0), rate("inner", 20.0, 5.0)
TUMBLE = profile_file(*SEGMENTS, offset_sd_s=0.0)
MARKED = profile_file(*SEGMENTS, align="marks")
GYRO = profile_file(*SEGMENTS, align="gyro")


def simulated(file: ReferenceFile | None, hz: float = 20.0, seconds: float | None = None, seed: int = 1) -> Samples:
    profile = None if file is None else file.motion()
    assert profile is None or isinstance(profile, Profile)
    length = seconds if seconds is not None else profile.duration if profile is not None else 30.0
    return simulation.simulate(profile, rate_hz=hz, seconds=length, seed=seed, truth=BIAS)[0]


def record(
    path: Path,
    samples: Samples,
    hz: float = 20.0,
    attachment: ReferenceFile | None = None,
    marks: Iterable[tuple[float, str]] = (),
    **info: Any,
) -> Path:
    """A log of these samples, as an acquisition leaves it; its reference is that of the file attached, else level."""
    kind = "level" if attachment is None else attachment.kind
    session = SessionInfo(**{"rate_hz": hz, "kind": "simulated", "reference": kind, "site_stated": True} | info)
    return logs.of_samples(path, samples, session, attachment, marks)


def tumbled(path: Path, file: ReferenceFile = TUMBLE, **info: Any) -> Path:
    """A log that carries its profile."""
    return record(path, simulated(file), attachment=file, **info)


def shift(result: dict[str, Any]) -> np.ndarray:
    """Errors of the six biases over their sd; the truth is in body axes, the result in the instrument's."""
    axes = SessionInfo().axes()
    truth = np.concatenate(
        [
            axes.accel_to_instrument(BIAS.accel_bias) / STANDARD_GRAVITY * 1e3,
            np.rad2deg(axes.gyro_to_instrument(BIAS.gyro_bias)),
        ]
    )
    final = np.array(result["final"]["accel_bias_mg"] + result["final"]["gyro_bias_dps"], float)
    return (final - truth) / np.array(result["sd"]["accel_bias_mg"] + result["sd"]["gyro_bias_dps"], float)


# ---------------------------------------------------------------------------------------------------------- references


def test_the_reference_is_the_logs_own(tmp_path: Path) -> None:
    path = tumbled(tmp_path / "a.mcap")
    result = replay(path, Reading())
    assert result["reference"] == "profile"
    assert result["samples"] == simulated(TUMBLE).t.size
    assert result["nis"]["dof"] == 9
    assert result["unobservable"] == []
    assert result["alarms"] == []
    assert result["rejected"] == 0
    assert np.all(np.abs(shift(result)) < 4.0)


def test_a_reference_named_by_the_user_goes_before_the_logs_own(tmp_path: Path) -> None:
    wrong = profile_file(SEGMENTS[0], dwell(8.0, middle=-90.0), *SEGMENTS[2:], offset_sd_s=0.0)
    path = record(tmp_path / "a.mcap", simulated(TUMBLE), attachment=wrong)
    own, named = replay(path, Reading()), replay(path, Reading(reference=TUMBLE))
    assert own["rejected"] > 0
    assert any("left out" in text or "off the reference" in text for text in own["alarms"])
    assert named["rejected"] == 0
    assert np.all(np.abs(shift(named)) < 4.0)
    assert own["config_sha256"] != named["config_sha256"]
    # the kind goes with the file: a log made level takes a named profile as well
    level = record(tmp_path / "b.mcap", simulated(TUMBLE))
    assert untimed(replay(level, Reading(reference=TUMBLE)))["final"] == named["final"]


def test_a_profile_without_a_file_is_an_error_that_names_the_option(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", simulated(None), reference="profile")
    with pytest.raises(ValueError, match=r"none of its own.*--reference FILE"):
        replay(path, Reading())


def test_the_logs_marks_join_the_profile_to_it(tmp_path: Path) -> None:
    profile = MARKED.motion()
    assert isinstance(profile, Profile)
    samples = simulated(MARKED)
    for name, texts in (("a", ("segment 1", "segment 2", "segment 3")), ("b", ("on", "turned", "segment 3"))):
        marks = [(float(t) + 0.3, text) for t, text in zip(profile.rest_starts[:3], texts, strict=True)]
        path = record(tmp_path / f"{name}.mcap", samples, attachment=MARKED, marks=marks)
        result = replay(path, Reading())
        assert np.all(np.abs(shift(result)) < 4.0)
        assert result["rejected"] == 0
        assert result["alarms"] == []
    unmarked = replay(tumbled(tmp_path / "c.mcap", MARKED), Reading())
    assert unmarked["nis"]["mean"] is None


def test_a_profile_is_joined_to_the_log_by_its_gyros(tmp_path: Path) -> None:
    profile = GYRO.motion()
    assert isinstance(profile, Profile)
    early = simulated(GYRO, seconds=profile.duration + 3.0)
    still = simulation.simulate(rate_hz=20.0, seconds=6.0, seed=8, truth=BIAS)[0]
    late = Samples(
        np.arange(early.t.size + still.t.size) / 20.0,
        np.concatenate([still.gyro, early.gyro]),
        np.concatenate([still.accel, early.accel]),
    )
    path = record(tmp_path / "a.mcap", late, attachment=GYRO)
    _, settings = job.prepare(replay_input.at_once(reader.read(path)), Reading())
    assert settings.offset_sd is not None
    assert abs(settings.offset - 6.0) < 4.0 * settings.offset_sd
    result = replay(path, Reading())
    assert np.all(np.abs(shift(result)) < 4.0)
    assert result["rejected"] == 0
    with pytest.raises(ValueError, match="another `sign`"):
        replay(path, Reading(reference=profile_file(*SEGMENTS, align="gyro", sign=[1, -1, 1])))


def test_rotation_at_a_tenth_of_a_hertz_is_refused_with_the_reason(tmp_path: Path) -> None:
    """A profile that turns between two samples, and readings that do: nothing is known of the rate in between."""
    slow = record(tmp_path / "a.mcap", simulated(TUMBLE, hz=0.1, seconds=100.0), 0.1, TUMBLE)
    with pytest.raises(ValueError, match=r"deg between two samples at 0\.1 Hz.*nothing is known of the rate"):
        replay(slow, Reading())
    still = simulated(None, hz=0.1, seconds=100.0)
    turning = record(tmp_path / "b.mcap", replace(still, gyro=still.gyro + np.deg2rad([0.0, 0.0, 10.0])), 0.1)
    with pytest.raises(ValueError, match=r"10[0-9] deg between two samples at .*nothing is known of the rate"):
        replay(turning, Reading())
    # at rest a tenth of a hertz is fine
    assert np.all(np.abs(shift(replay(record(tmp_path / "c.mcap", still, 0.1), Reading()))) < 4.0)


# ---------------------------------------------------------------------------------------------------------------- parts


def rows(path: Path, reading: Reading) -> tuple[np.ndarray, np.ndarray]:
    """Times since the log's first sample, and what is known then."""
    log = reader.read(path)
    feed = replay_input.at_once(log, reading.start, reading.end)
    _, settings = job.prepare(feed, reading)
    estimator, t = Estimator(settings), feed.t(feed.first)
    if estimator.aligning is not None:
        found = estimator.aligning.found(t, feed.first.gyro, feed.first.accel)
    else:
        assert estimator.reference is not None
        found = estimator.reference
    for event in log.events:
        if event.name == "mark":
            assert isinstance(found, reference.TableMotion)
            found.mark(float(reader.seconds_since(event.stamp_ns, feed.first_ns)), event.text)
    return t + feed.start, found.known(t, -np.inf, feed.first.gyro)


def table_trajectory(samples: Samples) -> ReferenceFile:
    profile = TUMBLE.motion()
    assert isinstance(profile, Profile)
    t = np.arange(0.0, samples.t[-1], 0.25)
    values = np.tile([PAPER_SITE.latitude, PAPER_SITE.longitude, PAPER_SITE.height, 0, 0, 0, 0, 0, 0], (t.size, 1))
    values[:, 6:9] = attitude.to_rpy(kinematics.attitudes(profile.angles(t)))
    text = trajectory_file.format(Trajectory(t, values))
    return ReferenceFile("trajectory", "reference.csv", "text/csv", text.encode())


@pytest.mark.parametrize("kind", ["none", "marks", "trajectory"])
def test_a_part_knows_what_the_whole_knows_and_is_filtered_like_any_other(tmp_path: Path, kind: str) -> None:
    """--start and --end shift profile, marks and trajectory; a part may begin in the second dwell, at 90°."""
    samples = simulated(TUMBLE)
    file = table_trajectory(samples) if kind == "trajectory" else (MARKED if kind == "marks" else TUMBLE)
    marks = [(0.4, "segment 1"), (10.9, "segment 2"), (23.6, "segment 3")] if kind == "marks" else []
    path = record(tmp_path / "a.mcap", samples, attachment=file, marks=marks)
    t, whole = rows(path, Reading())
    part_t, part = rows(path, Reading(start=9.99, end=27.01))
    here = (t >= 9.99) & (t <= 27.01)
    assert np.allclose(part_t, t[here], atol=1e-9)
    # at its first sample a part may take a trajectory's row that is a little older than it
    begin = 1 if kind == "trajectory" else 0
    assert np.allclose(part[begin:], whole[here][begin:], rtol=1e-9, atol=1e-11, equal_nan=True)
    assert (part[:, reference.VARIANCES] > 0.0).any()
    result = replay(path, Reading(start=13.0))
    assert result["rejected"] == 0
    assert np.all(np.abs(shift(result)) < 4.0)


def test_a_part_is_the_samples_between_its_ends(tmp_path: Path) -> None:
    samples = simulated(None)
    whole = record(tmp_path / "a.mcap", samples)
    here = (samples.t >= 5.0) & (samples.t <= 20.0)
    alone = Samples(samples.t[here] - 5.0, samples.gyro[here], samples.accel[here])
    part, cut = (
        replay(whole, Reading(start=5.0, end=20.0)),
        replay(record(tmp_path / "b.mcap", alone), Reading()),
    )
    own = ("log", "log_sha256", "asked")
    assert (part["asked"]["start"], part["asked"]["end"]) == (5.0, 20.0)
    assert {k: v for k, v in untimed(part).items() if k not in own} == {
        k: v for k, v in untimed(cut).items() if k not in own
    }


# ------------------------------------------------------------------------------------------------ noise measured on it


def test_noise_measured_on_a_still_log_is_the_logs_and_is_used(tmp_path: Path) -> None:
    quiet = replace(SPEC, gyro_arw=SPEC.gyro_arw / 4, accel_vrw=SPEC.accel_vrw / 4)
    samples = simulation.simulate(rate_hz=50.0, seconds=300.0, seed=3, spec=quiet, truth=BIAS)[0]
    path = record(tmp_path / "a.mcap", samples, 50.0)
    table, measured = replay(path, Reading()), replay(path, Reading(overrides={"noise": "log"}))
    used = measured["noise"]["used"]
    assert used["source"] == "log"
    assert np.allclose(used["gyro_arw_deg_sqrt_h"], 4.5 / 4, rtol=0.1)
    assert np.allclose(used["accel_vrw_mps_sqrt_h"], 1.0 / 4, rtol=0.1)
    assert table["noise"]["used"]["source"] == "table1"
    assert np.allclose(table["noise"]["used"]["gyro_arw_deg_sqrt_h"], 4.5)
    assert np.all(np.abs(shift(measured)) < 4.0)
    ratio = np.array(measured["sd"]["gyro_bias_dps"]) / np.array(table["sd"]["gyro_bias_dps"])
    # four times less white noise, and whatever drift the log shows
    assert np.all((ratio > 0.2) & (ratio < 1.0))
    assert measured["config_sha256"] != table["config_sha256"]


def test_noise_of_a_moving_log_is_not_measured(tmp_path: Path) -> None:
    samples = simulated(TUMBLE)
    for name, file in (("a", TUMBLE), ("b", table_trajectory(samples))):
        path = record(tmp_path / f"{name}.mcap", samples, attachment=file)
        with pytest.raises(ValueError, match=r"`noise` is \"log\".*at rest"):
            replay(path, Reading(overrides={"noise": "log"}))


# ------------------------------------------------------------------------------------------------------------ estimates


def written(path: Path) -> tuple[list[int], list[Any]]:
    """Stamps and messages of the estimates in a file, decoded by rosbags from the file's own bytes."""
    stamps, messages = [], []
    with path.open("rb") as stream:
        for schema, _, message in make_reader(stream, validate_crcs=True).iter_messages(schemas.ESTIMATE):
            assert schema is not None
            assert schema.encoding == "ros2msg"
            stamps.append(message.publish_time)
            messages.append(ros_messages.decode(schema.name, message.data))
    return stamps, messages


def check_estimate(message: Any, estimate: Estimate) -> None:
    """A message says in degrees, mg and the instrument's axes (accelerometers' sign turned) what an estimate holds."""
    nav, P = estimate.belief.nav, estimate.belief.P
    sd = np.sqrt(np.diag(P))
    expected = {
        "position_deg_m": [*np.rad2deg([nav.latitude, nav.longitude]), nav.height],
        "velocity_mps": nav.velocity_n,
        "rpy_deg": np.rad2deg(attitude.to_rpy(nav.C_nb)),
        "accel_bias_mg": -nav.accel_bias / STANDARD_GRAVITY * 1e3,
        "gyro_bias_dps": np.rad2deg(nav.gyro_bias),
        "position_sd_m": sd[state.POSITION],
        "velocity_sd_mps": sd[state.VELOCITY],
        "accel_bias_sd_mg": sd[state.ACCEL_BIAS] / STANDARD_GRAVITY * 1e3,
        "gyro_bias_sd_dps": np.rad2deg(sd[state.GYRO_BIAS]),
    }
    for name, value in expected.items():
        assert np.allclose(getattr(message, name), value, rtol=1e-12, atol=1e-12), name
    # level: the three angles' errors are those about north, east, down to first order in the angles
    assert np.allclose(message.rpy_sd_deg, np.rad2deg(sd[state.ATTITUDE]), rtol=1e-2)
    assert message.nis_dof == estimate.dof
    assert np.array_equal(message.nis, estimate.nis, equal_nan=True)


@pytest.mark.parametrize(("name", "seconds"), [("spkf", 45.0), ("ekf", 8.0), ("spkf-paper", 8.0)])
def test_all_estimates_in_the_file_are_the_runners(tmp_path: Path, name: str, seconds: float) -> None:
    samples = simulated(None, seconds=seconds)
    path = record(tmp_path / "a.mcap", samples, filter=name)
    result = replay(path, Reading(), output=EstimatesFile(tmp_path / "e.mcap", 0.0))
    assert result["filter"] == name
    stamps, messages = written(tmp_path / "e.mcap")
    log = reader.read(path)
    estimator = Estimator(log.info.settings())
    estimates = list(runner.run(estimator, log.seconds(), log.samples.gyro, log.samples.accel))
    assert stamps == log.samples.stamp_ns.tolist()
    assert len(messages) == len(estimates)
    for message, estimate in zip(messages, estimates, strict=True):
        check_estimate(message, estimate)
    assert [bool(c) for c in messages[-1].converged] == [s is not None for s in estimator.monitor.convergence().since]
    # a row and the record of the end are converted by one function
    for name_of_sd, values in result["sd"].items():
        quantity, _, unit = name_of_sd.rpartition("_")
        assert getattr(messages[-1], f"{quantity}_sd_{unit}") == pytest.approx(np.array(values), rel=1e-9)
    for key, values in result["final"].items():
        assert getattr(messages[-1], key) == pytest.approx(np.array(values), rel=1e-9, abs=1e-9)
    if name == "spkf":
        assert all(messages[-1].converged)
    assert not any(messages[0].converged)
    assert np.all(np.abs(shift(result)) < 4.0)


def test_one_estimate_a_second_is_written_unless_asked(tmp_path: Path) -> None:
    samples = simulated(None, hz=133.0, seconds=6.0)
    path = record(tmp_path / "a.mcap", samples, 133.0)
    replay(path, Reading(), output=EstimatesFile(tmp_path / "e.mcap"))
    stamps, messages = written(tmp_path / "e.mcap")
    assert len(messages) == 6
    steps = np.diff(stamps) / 1e9
    assert np.all(np.abs(steps - 1.0) < 1.01 / 133.0)
    log = reader.read(path)
    estimates = {
        int(log.samples.stamp_ns[e.index]): e
        for e in runner.run(Estimator(log.info.settings()), log.seconds(), log.samples.gyro, log.samples.accel)
    }
    for stamp, message in zip(stamps, messages, strict=True):
        check_estimate(message, estimates[stamp])


@pytest.mark.parametrize("file", [None, TUMBLE])
def test_the_result_does_not_depend_on_what_is_written(tmp_path: Path, file: ReferenceFile | None) -> None:
    path = record(tmp_path / "a.mcap", simulated(file), attachment=file)
    plain = replay(path, Reading())
    for hz in (10.0, 0.0, 3.0):
        output = tmp_path / f"{hz}.mcap"
        result = replay(path, Reading(), output=EstimatesFile(output, hz))
        assert untimed(result) == untimed(plain)
        with output.open("rb") as stream:
            attached = {a.name: a.data for a in make_reader(stream).iter_attachments()}
        assert json.loads(attached["summary.json"]) == result


@pytest.mark.parametrize("name", ["ekf", "spkf-paper"])
def test_the_other_filters_agree_with_the_sigma_points(tmp_path: Path, name: str) -> None:
    path = record(tmp_path / "a.mcap", simulated(None, seconds=10.0))
    own, other = replay(path, Reading()), replay(path, Reading(overrides={"filter": name}))
    assert (own["filter"], other["filter"]) == ("spkf", name)
    assert np.allclose(shift(own), shift(other), atol=0.1)
    assert own["nis"]["mean"] == pytest.approx(other["nis"]["mean"], rel=0.01)


def test_nothing_is_overwritten_unless_asked_and_the_log_itself_never(tmp_path: Path) -> None:
    path, output = record(tmp_path / "a.mcap", simulated(None, seconds=5.0)), tmp_path / "e.mcap"
    output.write_bytes(b"dear")
    content = path.read_bytes()
    for wanted, overwrite in ((output, False), (path, False), (path, True)):
        with pytest.raises((FileExistsError, ValueError)):
            replay(path, Reading(), output=EstimatesFile(wanted, overwrite=overwrite))
    assert (output.read_bytes(), path.read_bytes()) == (b"dear", content)
    replay(path, Reading(), output=EstimatesFile(output, overwrite=True))
    assert len(written(output)[1]) == 5

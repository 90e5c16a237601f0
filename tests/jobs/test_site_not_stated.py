"""A site that nobody stated: gravity is not known, so the accelerometer along the vertical is uncertain by it."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import logs, ros_messages
from helpers.commands import imutui, imutui_json
from helpers.documents import dwell, profile_file
from mcap.reader import make_reader

from filters import earth, simulation
from filters.imu import STANDARD_GRAVITY, Samples
from filters.motion.profile import Profile
from filters.simulation import Truth
from filters.state import Site
from imutui.jobs.campaign import one_log
from imutui.jobs.campaign.one_log import Settings, Task
from imutui.jobs.replay import EstimatesFile, replay
from imutui.logbook import SessionInfo, reader, schemas
from imutui.logbook.export.samples import import_flags
from imutui.logbook.reading import Reading
from imutui.logbook.reference_file import ReferenceFile
from imutui.logbook.session_info import FOREIGN
from imutui.report import replay_report, replay_text
from imutui.verdict import sources

OSLO = Site.at(59.91, 10.75, 20.0)
BIAS = Truth(np.array([0.06, -0.04, 0.08]), np.deg2rad([0.5, -0.7, 0.3]))
SPREAD_MG = 2.6
TURNED_OVER = profile_file(dwell(12.0), dwell(24.0, 180.0), dwell(12.0), offset_sd_s=0.0)


def samples(file: ReferenceFile | None = None) -> Samples:
    profile = None if file is None else file.motion()
    assert profile is None or isinstance(profile, Profile)
    seconds = 60.0 if profile is None else profile.duration
    return simulation.simulate(profile, rate_hz=20.0, seconds=seconds, seed=2, truth=BIAS, site=OSLO)[0]


def logged(path: Path, of: Samples, file: ReferenceFile | None = None, **info: Any) -> Path:
    """A log of a unit in Oslo; unless `info` states it, whoever recorded it did not say so."""
    kind = {"reference": "level" if file is None else file.kind, "instrument": "IMU400CD-200", "rate_hz": 20.0}
    return logs.of_samples(path, of, SessionInfo(**{**kind, **info}), file)


def stated() -> dict[str, Any]:
    return {"latitude_deg": 59.91, "longitude_deg": 10.75, "height_m": 20.0, "gravity_mps2": OSLO.gravity,
            "site_stated": True}  # fmt: skip


STILL = samples()


@pytest.fixture(scope="module")
def level(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return logged(tmp_path_factory.mktemp("level") / "a.mcap", STILL)


@pytest.fixture(scope="module")
def replays(level: Path) -> tuple[Any, Any]:
    """Results where the site is not stated, and where it is."""
    known = logged(level.with_name("b.mcap"), STILL, **stated())
    return replay(level, Reading()), replay(known, Reading())


def test_the_spread_is_that_of_gravity_where_people_live() -> None:
    """Towns by latitude, height and millions of inhabitants, Delhi, São Paulo and Lagos first."""
    towns = [(28.6, 216, 33), (-23.6, 760, 22), (6.5, 40, 15), (35.7, 40, 37), (51.5, 11, 9), (55.8, 156, 12),
             (4.7, 2640, 11), (19.4, 2240, 22), (31.2, 4, 28), (-6.2, 8, 11), (40.7, 10, 19), (59.9, 20, 1),
             (52.5, 34, 4), (30.0, 23, 21), (-34.6, 25, 15), (1.3, 15, 6), (19.1, 14, 21), (39.9, 44, 21)]  # fmt: skip
    latitude, height, weight = np.array(towns, float).T
    gravity = earth.normal_gravity(np.deg2rad(latitude), height)
    mean = np.average(gravity, weights=weight)
    around_the_default = np.sqrt(np.average((gravity - mean) ** 2, weights=weight))
    assert pytest.approx(SPREAD_MG * 1e-3 * STANDARD_GRAVITY) == earth.GRAVITY_SPREAD
    assert 0.3 < around_the_default / earth.GRAVITY_SPREAD < 1.2


def test_the_error_lies_within_what_is_said_and_nothing_else_changes(replays: tuple[Any, Any]) -> None:
    unstated, known = replays
    own = known["sd"]["accel_bias_mg"][2]
    z, sd = unstated["final"]["accel_bias_mg"][2], unstated["sd"]["accel_bias_mg"]
    truth = -float(BIAS.accel_bias[2]) / STANDARD_GRAVITY * 1e3
    assert abs(z - truth) > 6.0 * own  # 3.3 mg: gravity of another place
    assert abs(z - truth) < 3.0 * SPREAD_MG
    assert sd[2] == pytest.approx(np.hypot(own, SPREAD_MG), rel=1e-3)
    assert sd[:2] == pytest.approx(known["sd"]["accel_bias_mg"][:2], rel=1e-3)
    assert unstated["sd"]["gyro_bias_dps"] == pytest.approx(known["sd"]["gyro_bias_dps"], rel=1e-3)
    assert unstated["converged_s"] == known["converged_s"]
    assert (unstated["site_stated"], known["site_stated"]) == (False, True)
    assert known["site_sd_mg"] == [0.0, 0.0, 0.0]


def test_it_stays_green_and_says_which_is_wide_and_what_states_it(replays: tuple[Any, Any]) -> None:
    document, known = replays
    found = sources.of_document(document)
    assert (found.word, found.passes) == ("GREEN", True)
    assert "z accel is wide, as the site is not stated: --site LAT,LON,H" in found.reason
    for text in (replay_text.text(document, 80), str(replay_report.article(document))):
        assert "the site is not stated" in " ".join(text.split()).lower()
    for text in (replay_text.text(known, 80), str(replay_report.article(known)), sources.reasons(known)):
        assert "the site" not in text


def test_a_limit_is_judged_by_the_widened_uncertainty(replays: tuple[Any, Any]) -> None:
    """A bias of 13 mg is beyond 12 mg of the data sheet only where gravity is known."""
    words = []
    for document in map(copy.deepcopy, replays):
        document["final"]["accel_bias_mg"][2] = 13.0
        words.append(sources.of_document(document).word)
    assert words == ["AMBER", "RED"]


def test_what_has_not_converged_is_measured_by_the_filter_alone(replays: tuple[Any, Any]) -> None:
    """A filter that has 0.5 mg waits for its readings to agree, and not for 2.6 mg to become 0.6."""
    document = copy.deepcopy(replays[0])
    document["converged_s"]["accel_bias"][2] = None
    assert "z accel: 3 sd" not in sources.of_document(document).reason


@pytest.mark.parametrize(("mount", "wide"), [("x,y,z", 2), ("x,-y,-z", 2), ("z,y,-x", 0), ("x,-z,y", 1)])
def test_the_axis_along_the_vertical_is_that_of_the_mounted_unit(tmp_path: Path, mount: str, wide: int) -> None:
    document = replay(logged(tmp_path / "a.mcap", STILL, mount=mount), Reading())
    shares = [SPREAD_MG if axis == wide else 0.0 for axis in range(3)]
    assert document["site_sd_mg"] == pytest.approx(shares, abs=1e-9)
    own = max(sd for axis, sd in enumerate(document["sd"]["accel_bias_mg"]) if axis != wide and sd is not None)
    assert own < 0.7
    assert (document["sd"]["accel_bias_mg"][wide] or 0.0) > SPREAD_MG


def test_a_tilted_unit_shares_it_among_its_axes(tmp_path: Path) -> None:
    tilt = np.deg2rad(30.0)
    C = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(tilt), -np.sin(tilt)], [0.0, np.sin(tilt), np.cos(tilt)]])
    tilted = Samples(STILL.t, STILL.gyro, STILL.accel @ C)
    document = replay(logged(tmp_path / "a.mcap", tilted, reference="gravity"), Reading())
    assert document["site_sd_mg"] == pytest.approx([0.0, SPREAD_MG * 0.5, SPREAD_MG * np.sqrt(0.75)], abs=0.03)


def test_a_unit_that_a_profile_turns_over_shows_gravity_and_is_not_wide(tmp_path: Path) -> None:
    """Upright as long as upside down: what gravity adds to the one it takes from the other."""
    document = replay(logged(tmp_path / "a.mcap", samples(TURNED_OVER), TURNED_OVER), Reading())
    assert document["site_sd_mg"][2] < 0.05 * SPREAD_MG
    assert max(document["site_sd_mg"]) < 0.25 * SPREAD_MG  # on its side it is only on the way


def test_estimates_that_are_written_have_it_too(level: Path, tmp_path: Path) -> None:
    output = tmp_path / "est.mcap"
    replay(level, Reading(), output=EstimatesFile(output))
    with output.open("rb") as stream:
        messages = [m.data for _, c, m in make_reader(stream).iter_messages() if c.topic == schemas.ESTIMATE]
    made = ros_messages.decode(schemas.TYPES[schemas.ESTIMATE], messages[-1])
    assert made.accel_bias_sd_mg[2] == pytest.approx(SPREAD_MG, rel=0.02)


def test_a_campaign_row_has_it_apart(level: Path) -> None:
    row = one_log.row_of(Task("a.mcap", str(level), Settings(), ""))
    assert row is not None
    assert row["sd"] is not None
    assert row["site_sd_mg"] == [0.0, 0.0, pytest.approx(SPREAD_MG)]
    assert row["sd"]["accel_bias_mg"][2] == pytest.approx(SPREAD_MG, rel=0.02)


def test_gravity_that_a_replay_is_told_states_it(level: Path) -> None:
    document = imutui_json("replay", level, "--set", f"site.gravity_mps2={OSLO.gravity}")
    assert document["site_stated"]
    assert document["sd"]["accel_bias_mg"][2] < 0.7


@pytest.mark.parametrize(
    ("flags", "environment", "is_stated"),
    [
        ((), {}, False),
        (("--site", "59.91,10.75,20"), {}, True),
        (("--gravity", "9.819"), {}, True),
        ((), {"IMUTUI_SITE_LATITUDE_DEG": "59.91"}, True),
        ((), {"IMUTUI_SITE_GRAVITY_MPS2": "9.819"}, True),
        ((), {"IMUTUI_SITE_GRAVITY_MPS2": "0"}, False),
        ((), {"IMUTUI_SITE_HEIGHT_M": "20"}, False),
    ],
)
def test_an_import_states_the_site_that_it_was_told(
    tmp_path: Path,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    flags: tuple[str, ...],
    environment: dict[str, str],
    is_stated: bool,
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    n = 40
    np.savez(home / "a.npz", t=np.arange(n) / 20.0, gyro=np.zeros((n, 3)), accel=np.tile([0.0, 0.0, 1.0], (n, 1)))
    done = imutui("import", home / "a.npz", "-o", home / "a.mcap", *flags)
    assert ("the site is not stated" in done.stderr) != is_stated
    document = imutui_json("info", home / "a.mcap")
    assert document["site_stated"] is is_stated
    assert reader.read(home / "a.mcap").info.site_stated is is_stated
    assert document["instrument"] == ""
    assert ("not stated; the default is assumed" in imutui("info", home / "a.mcap").stdout) != is_stated


def test_a_file_in_the_working_folder_states_it(home: Path) -> None:
    (home / "imutui.toml").write_text("[site]\nlatitude_deg = 59.91\nlongitude_deg = 10.75\nheight_m = 20.0\n")
    np.savez(home / "a.npz", t=np.arange(40) / 20.0, gyro=np.zeros((40, 3)), accel=np.tile([0.0, 0.0, 1.0], (40, 1)))
    imutui("import", home / "a.npz", "-o", home / "a.mcap")
    info = reader.read(home / "a.mcap").info
    assert (info.site_stated, info.gravity_mps2) == (True, pytest.approx(OSLO.gravity, abs=1e-9))


def test_an_export_does_not_state_what_its_log_did_not() -> None:
    """It names the flags that make the same log again."""
    own = import_flags(FOREIGN)
    assert not {"--site", "--gravity", "--instrument"} & set(own)
    assert {"--site", "--gravity"} < set(import_flags(SessionInfo(**stated())))

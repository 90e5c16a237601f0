"""`imutui apply`: the corrected log is what a filter with the effects sees, to rounding, and any program reads it."""

from pathlib import Path

import numpy as np
import pytest
from helpers.commands import imutui, imutui_json
from helpers.documents import Entry, effect, effects_toml, state
from helpers.paths import SAMPLE
from rosbags.highlevel import AnyReader

from filters.channels import DPS, G
from imutui.jobs import apply as job
from imutui.logbook import checksum_file, effects_file, reader


def known(name: str, channel: str, unit: str, mean: float, of: str = "k", **parameters: str) -> Entry:
    """One effect of a file, known exactly."""
    return effect(name, channel, state(of, unit, mean, 0.0), **parameters)


SCALE = known("scale", "az", "1", 0.01)
THERMAL = known("thermal_lin", "gy", "deg/s/K", 0.02)
RAMP = known("ramp", "ax", "mg/s", 0.1)
DRIFT = effect("gauss_markov", "gx", state("level", "deg/s", 0.0, 0.0, tau_s=30.0, q=0.01), include_as="S")
SPIKES = effect("spikes", "ay", include_as="P", limit=15.0)


def written(tmp_path: Path, *effects: Entry) -> Path:
    path = tmp_path / "effects.toml"
    path.write_text(effects_toml(*effects, source="by hand"))
    effects_file.from_file(path)
    return path


def mounted(tmp_path: Path) -> Path:
    """A still unit on its side with the other sign, that warms up."""
    n = 800
    t, rng = np.arange(n) / 20.0, np.random.default_rng(3)
    gyro, accel = rng.standard_normal((n, 3)) * 0.1, rng.standard_normal((n, 3)) * 0.002 + [0.0, 0.998, 0.0]
    np.savez(tmp_path / "in.npz", t=t, gyro=gyro, accel=accel, temp=20.0 + t / 4.0)
    flags = ("--accel-sign", "+1", "--mount", "x,z,-y", "--reference", "gravity", "--kind", "measured")
    imutui("import", tmp_path / "in.npz", "-o", tmp_path / "mounted.mcap", *flags)
    return tmp_path / "mounted.mcap"


@pytest.mark.parametrize("source", ["sample", "mounted"])
def test_a_corrected_log_gives_what_a_filter_with_the_effects_gives(tmp_path: Path, source: str) -> None:
    log = SAMPLE if source == "sample" else mounted(tmp_path)
    effects = written(tmp_path, SCALE, RAMP)
    corrected = tmp_path / "corrected.mcap"
    imutui("apply", log, "--effects", effects, "-o", corrected)
    with_effects, after, before = (
        imutui_json("replay", *each, check=None)
        for each in ((log, "--effects", effects), (corrected,), (log, "--effects", "none"))
    )
    # a unit whose attitude is unknown is levelled by its readings, with the effects still in them
    rounding, moved = (1e-9 if source == "sample" else 1e-5), 0.0
    for name, limit in (("accel_bias_mg", rounding * 1e3), ("gyro_bias_dps", rounding)):
        for key in ("final", "sd"):
            wanted, found, old = (
                np.array(d[key][name], float) for d in (with_effects, after, before)
            )  # NaN where the reference does not show a bias
            assert found == pytest.approx(wanted, abs=limit, nan_ok=True)
            moved = max(moved, float(np.nanmax(np.abs(found - old))))
    assert moved > 1e-3
    assert reader.read(corrected).info.kind == reader.read(log).info.kind


def test_a_corrected_reading_is_what_the_unit_sensed(tmp_path: Path) -> None:
    A = np.zeros((6, 6))
    A[2, 2], A[4, 3], A[0, 5] = 0.02, 0.03, 0.4
    bias = np.array([0.0, 0.0, 1.5, 0.08, 0.0, 0.0])
    effects = written(
        tmp_path,
        known("scale", "gz", "1", 0.02),
        known("cross_axis", "ay", "rad", 0.03, "x", axes="x"),
        known("g_sensitivity", "gx", "deg/s/g", 0.4, "z", axes="z"),
        known("bias", "gz", "deg/s", 1.5),
        known("bias", "ax", "mg", 80.0),
    )
    rng, n = np.random.default_rng(5), 400
    true = rng.standard_normal((n, 6)) * 1e-3 + [0.0, 0.0, 0.0, 0.6, 0.0, 0.8]
    true[200:, :3] += [5.0, 0.0, 20.0]  # a rest, and a turn that no reference tells
    read = true + bias + true @ A.T
    np.savez(tmp_path / "in.npz", t=np.arange(n) / 20.0, gyro=read[:, :3], accel=read[:, 3:])
    flags = ("--accel-sign", "-1", "--reference", "turned", "--kind", "measured")
    imutui("import", tmp_path / "in.npz", "-o", tmp_path / "in.mcap", *flags)
    imutui("apply", tmp_path / "in.mcap", "--effects", effects, "-o", tmp_path / "out.mcap")
    made = reader.read(tmp_path / "out.mcap")
    axes = made.info.axes()
    found = np.hstack(
        [axes.gyro_to_instrument(made.samples.gyro) / DPS, axes.accel_to_instrument(made.samples.accel) / G]
    )
    np.testing.assert_allclose(found, true, rtol=0.0, atol=1e-9)


def test_an_effect_of_the_rate_of_temperature_is_taken_out_without_lag(tmp_path: Path) -> None:
    n = 12000
    t, rng = np.arange(n) / 20.0, np.random.default_rng(4)
    T = 25.0 + 4.0 * np.sin(2.0 * np.pi * t / 200.0)
    gyro = np.zeros((n, 3))
    gyro[:, 2] = 5.0 * np.gradient(T, t)
    accel = np.tile([0.0, 0.0, 1.0], (n, 1)) + rng.standard_normal((n, 3)) * 1e-3
    np.savez(tmp_path / "in.npz", t=t, gyro=gyro, accel=accel, temp=T + 0.02 * rng.standard_normal(n))
    flags = ("--accel-sign", "+1", "--reference", "gravity", "--kind", "measured")
    imutui("import", tmp_path / "in.npz", "-o", tmp_path / "in.mcap", *flags)
    effects = written(tmp_path, known("thermal_rate", "gz", "deg/s/(K/s)", 5.0))
    imutui("apply", tmp_path / "in.mcap", "--effects", effects, "-o", tmp_path / "out.mcap")
    before, after = (reader.read(tmp_path / name) for name in ("in.mcap", "out.mcap"))
    of_rate = before.info.axes().gyro_to_instrument(before.samples.gyro)[:, 2]
    left = after.info.axes().gyro_to_instrument(after.samples.gyro)[:, 2]
    assert np.std(left) < 0.06 * np.std(of_rate)


def test_only_what_has_a_value_is_taken_out(tmp_path: Path) -> None:
    effects = written(tmp_path, SCALE, DRIFT, SPIKES)
    document = imutui_json("apply", SAMPLE, "--effects", effects, "-o", tmp_path / "c.mcap")
    assert document["corrected"][0] == "az: scale factor is off"
    assert len(document["corrected"]) == 2
    assert len(document["left"]) == 1
    assert "only a filter follows" in document["left"][0]
    assert document["largest"]["az"] == pytest.approx(9.98, abs=0.3)
    assert {name for name, value in document["largest"].items() if value} == {"az"}
    before, after = reader.read(SAMPLE).samples, reader.read(tmp_path / "c.mcap").samples
    assert document["set_aside"] == np.count_nonzero(~after.valid) > 0
    assert document["samples"] == after.stamp_ns.size
    assert np.array_equal(before.gyro, after.gyro)
    assert np.array_equal(before.stamp_ns, after.stamp_ns)


def test_the_log_says_what_was_done_and_others_read_it(tmp_path: Path) -> None:
    effects, corrected = written(tmp_path, THERMAL), tmp_path / "c.mcap"
    source_hash = reader.sha256(SAMPLE)
    told = imutui("apply", SAMPLE, "--effects", effects, "-o", corrected).stdout
    assert "taken out: gy: bias follows temperature" in " ".join(told.split())
    log, first = reader.read(corrected), reader.read(SAMPLE)
    assert log.info.source == "sample.mcap corrected by effects of by hand"
    assert log.info.corrected_from_sha256 == source_hash
    assert log.info.applied_effects_sha256 == reader.sha256(effects)
    # what is out already is not taken out once more
    for command in (("apply", "-o", str(tmp_path / "twice.mcap")), ("replay",)):
        refused = imutui(command[0], corrected, "--effects", effects, *command[1:], check=2).stderr
        assert "taken out of it already" in " ".join(refused.split())
    # the same again over it: the sum beside it is the new file's
    imutui("apply", SAMPLE, "--effects", effects, "-o", corrected, "--force")
    assert checksum_file.read(corrected) == reader.sha256(corrected)
    assert log.attachments[job.APPLIED] == effects.read_bytes()
    assert effects_file.ATTACHMENT not in log.attachments
    assert (log.info.serial_number, log.info.operator) == (first.info.serial_number, first.info.operator)
    assert log.info.log_id != first.info.log_id
    assert np.array_equal(log.samples.degc, first.samples.degc)
    assert [event.text for event in log.events] == [event.text for event in first.events]
    assert reader.sha256(SAMPLE) == source_hash
    imutui("check", corrected)
    with AnyReader([corrected]) as bag:
        (connection,) = [c for c in bag.connections if c.topic == "/imu/data_raw"]
        _, _, raw = next(bag.messages([connection]))
        message = bag.deserialize(raw, connection.msgtype)
        assert message.angular_velocity.y == log.samples.gyro[0, 1] != first.samples.gyro[0, 1]


def test_effects_of_another_unit_are_applied_with_a_warning(tmp_path: Path) -> None:
    unit = effects_file.unit_of(reader.read(SAMPLE).info)
    effects = written(tmp_path, SCALE)
    text = effects.read_text()
    for units, told in (('["IMU400CD-200 1"]', True), (f'["IMU400CD-200 1", "{unit}"]', False), ("[]", False)):
        effects.write_text(text.replace("version = 1\n", f"version = 1\nunits = {units}\n"))
        for command in (("apply", "-o", str(tmp_path / "c.mcap"), "--force"), ("replay",)):
            done = imutui(command[0], SAMPLE, "--effects", effects, *command[1:], check=None)
            assert (f"another unit (IMU400CD-200 1) than the log ({unit})" in " ".join(done.stderr.split())) is told


def test_what_cannot_be_applied_is_refused_in_words(tmp_path: Path) -> None:
    good = written(tmp_path, SCALE)
    (tmp_path / "bad.toml").write_text("version = 7")
    unknown = tmp_path / "unknown.toml"
    unknown.write_text(effects_toml(known("gremlins", "gx", "1", 1.0)))
    (tmp_path / "there.mcap").write_text("mine")
    np.savez(tmp_path / "cold.npz", t=np.arange(50) / 20.0, gyro=np.zeros((50, 3)), accel=np.ones((50, 3)) * [0, 0, 1])
    imutui("import", tmp_path / "cold.npz", "-o", tmp_path / "cold.mcap")
    (tmp_path / "thermal").mkdir()
    thermal = written(tmp_path / "thermal", THERMAL)
    for log, effects, output, code, words in (
        (SAMPLE, tmp_path / "no.toml", "c.mcap", 2, "No such file"),
        (SAMPLE, tmp_path / "bad.toml", "c.mcap", 2, "version"),
        (SAMPLE, unknown, "c.mcap", 2, "gremlins"),
        (tmp_path / "cold.mcap", thermal, "c.mcap", 2, "such as a temperature that the readings come without"),
        (SAMPLE, good, "there.mcap", 2, "--force replaces it"),
        (SAMPLE, good, "no/c.mcap", 2, "mkdir -p"),
        (tmp_path / "no.mcap", good, "c.mcap", 3, "no such file"),
        (good, good, "c.mcap", 3, "not an MCAP"),
    ):
        done = imutui("apply", log, "--effects", effects, "-o", tmp_path / output, check=code)
        assert words in " ".join(done.stderr.split())
    assert (tmp_path / "there.mcap").read_text() == "mine"
    assert not (tmp_path / "c.mcap").exists()

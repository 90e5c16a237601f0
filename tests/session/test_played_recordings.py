"""Recordings of real units played over a pseudo-terminal and recorded live: what their logs have of them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import unit_time
from helpers import ros_messages
from helpers.acquisitions import replayed, untimed
from helpers.commands import imutui, imutui_json
from helpers.turned import GYRO_BIAS, turned_run
from rosbags.highlevel import AnyReader

from filters.imu import STANDARD_GRAVITY
from imutui.instrument.uut.decoder import Decoder
from imutui.instrument.uut.messages import PacketS1
from imutui.logbook import reader, schemas
from imutui.session import client
from imutui.session.plan import Plan

PACKETS = 1002
SECONDS = PACKETS / 20.0
"""Just before the packet that would follow the last."""


@pytest.fixture
def recorded(home: Path, recording: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log of what a real IMU381 sent, played to the wire and recorded live."""
    source = recording("aceinna_imu381_scale1.raw")
    with unit_time.virtual("--from", str(source)) as (port, environment):
        for name in ("PYTHONPATH", "IMUTUI_TEST_UNIT_TIME"):
            monkeypatch.setenv(name, environment[name])
        asked = Plan(
            port, rate_hz=20.0, instrument="imu381", logs=str(home / "logs"), record=True, filter="none",
            duration_s=SECONDS,
            accel_sign=1, mount="x,-y,-z", reference="gravity",
        )  # fmt: skip
        live = client.start(asked).wait(240.0)["result"]
    assert live is not None
    assert (live["lost_packets"], live["bad_checksums"]) == (0, 0)
    return Path(live["log"])


def test_a_real_units_stream_is_recorded_whole(recorded: Path, recording: Callable[[str], Path]) -> None:
    sent = Decoder().feed(recording("aceinna_imu381_scale1.raw").read_bytes())
    log = reader.read(recorded, raw=True)
    assert len(ros_messages.packets(log)) == len(sent) == log.samples.stamp_ns.size == PACKETS
    assert log.events[-1].text == f"ended by its duration of {SECONDS:g} s"
    assert not [event for event in log.events if event.name == "gap"]
    told = [event.text for event in log.events if "status word" in event.text]
    assert told == ["the unit's status word (BIT) is 0x0002 (hardware error); readings count whatever it says"]
    with AnyReader([recorded]) as bag:
        by_rosbags = [bag.deserialize(data, c.msgtype) for c, _, data in bag.messages() if c.topic == schemas.RAW]
    for packet, decoded, event in zip(ros_messages.packets(log), by_rosbags, sent, strict=True):
        assert isinstance(event, PacketS1)
        assert packet.counts == (*event.rates, *event.accels) == tuple(decoded.counts)
        assert packet.ticks == event.counter == decoded.ticks
        details = tuple(decoded.rate_temperatures), decoded.board_temperature, decoded.status
        of_packet = tuple(packet.rate_temperatures), packet.board_temperature, packet.status
        assert of_packet == details == (event.rate_temperatures, event.board_temperature, event.bit)
    assert [p.sequence for p in ros_messages.packets(log)] == list(range(len(ros_messages.packets(log))))
    said = " ".join(imutui("check", recorded).stdout.split())
    assert f"(BIT) was 0x0002 (hardware error) in {PACKETS:,} of {PACKETS:,} packets" in said
    info = imutui("info", recorded).stdout
    assert "imutui_msgs/msg/S1Packet" in info
    assert f"status (BIT)  0x0002 (hardware error) in {PACKETS:,} of {PACKETS:,} packets" in info
    # biases, noise and temperature are those of the stream that somebody else decoded
    source = recording("aceinna_imu381_s1_static.npz")
    flags = ("--accel-sign", "+1", "--mount", "x,-y,-z", "--reference", "gravity")
    imutui("import", source, "-o", "decoded.mcap", *flags)
    of_stream, of_arrays = (imutui_json("replay", path) for path in (str(recorded), "decoded.mcap"))
    for kind in ("gyro_bias_dps", "accel_bias_mg"):
        for ours, theirs, sd in zip(
            *(of[kind] for of in (of_stream["final"], of_arrays["final"], of_arrays["sd"])), strict=True
        ):
            assert (ours is None) is (theirs is None)
            assert ours is None or abs(ours - theirs) < 0.01 * sd
    with np.load(source) as decoded:
        # the mounting leaves each axis where it is
        for ours, theirs, unit in (
            (log.samples.gyro, "gyro", np.pi / 180.0),
            (log.samples.accel, "accel", STANDARD_GRAVITY),
        ):
            noise = np.diff(decoded[theirs] * unit, axis=0).std(axis=0)
            assert np.allclose(np.diff(ours, axis=0).std(axis=0), noise, rtol=1e-3)
        assert np.allclose(log.samples.degc, decoded["temp"], atol=1e-4)


# A unit turned by hand over the wire: the filter runs on its first rest, live as in a replay


def test_live_equals_replay_of_a_unit_that_is_turned(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = turned_run(seed=71, rests=8, seconds=12.0, biased=True)
    source = home / "turned.npz"
    np.savez(source, t=run.t, gyro=np.rad2deg(run.reading[:, :3]), accel=run.reading[:, 3:] / 9.80665)
    with unit_time.virtual("--from", str(source)) as (port, environment):
        for name in ("PYTHONPATH", "IMUTUI_TEST_UNIT_TIME"):
            monkeypatch.setenv(name, environment[name])
        asked = Plan(
            port, logs=str(home / "logs"), record=True, rate_hz=50.0, duration_s=40.0, accel_sign=1, reference="turned"
        )
        live = client.start(asked).wait(120.0)["result"]
    assert live is not None
    assert untimed(live) == replayed(live["log"], code=None)
    assert live["reference"] == "turned"
    assert 10 * 50 <= live["samples"] <= 13 * 50
    assert live["duration_s"] > 39.0
    assert np.allclose(live["final"]["gyro_bias_dps"], np.rad2deg(GYRO_BIAS), atol=0.05)

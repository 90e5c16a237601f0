"""Packets with details in a log: temperatures of each sensor and the status word of an IMU381, as it sent them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import unit_time
from helpers.commands import imutui
from rosbags.highlevel import AnyReader

from imutui.instrument.uut.decoder import Decoder
from imutui.instrument.uut.messages import PacketS1
from imutui.logbook import reader, schemas
from imutui.session import client
from imutui.session.plan import Plan

SECONDS = 12.0


@pytest.fixture
def recorded(home: Path, recording: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log of what a real IMU381 sent, played to the wire and recorded live."""
    source = recording("aceinna_imu381_scale1.raw")
    with unit_time.virtual("--from", str(source)) as (port, environment):
        for name in ("PYTHONPATH", "IMUTUI_TEST_UNIT_TIME"):
            monkeypatch.setenv(name, environment[name])
        asked = Plan(
            port, 20.0, instrument="imu381", logs=str(home / "logs"), record=True, filter="none", duration_s=SECONDS,
            accel_sign=1,
        )  # fmt: skip
        live = client.start(asked).wait(240.0)
    assert live is not None
    assert (live["lost_packets"], live["bad_checksums"]) == (0, 0)
    return Path(live["log"])


def test_every_field_that_a_real_unit_sent_is_in_the_log(recorded: Path, recording: Callable[[str], Path]) -> None:
    """Frame for frame, by our reader and by rosbags; check, info, export and replay take the log."""
    sent = Decoder().feed(recording("aceinna_imu381_scale1.raw").read_bytes())
    log = reader.read(recorded, raw=True)
    assert len(log.raw) >= SECONDS * 20
    with AnyReader([recorded]) as bag:
        by_rosbags = [bag.deserialize(data, c.msgtype) for c, _, data in bag.messages() if c.topic == schemas.RAW]
    for packet, told, event in zip(log.raw, by_rosbags, sent[: len(log.raw)], strict=True):
        assert isinstance(event, PacketS1)
        assert packet.counts == (*event.rates, *event.accels) == tuple(told.counts)
        assert packet.ticks == event.counter == told.ticks
        details = tuple(told.rate_temperatures), told.board_temperature, told.status
        assert packet.details == details == (event.rate_temperatures, event.board_temperature, event.bit)
    assert [p.sequence for p in log.raw] == list(range(len(log.raw)))
    said = " ".join(imutui("check", str(recorded)).stdout.split())
    assert f"(BIT) was 0x0002 (hardware error) in {len(log.raw)} of {len(log.raw)} packets" in said
    assert "imutui_msgs/msg/S1Packet" in imutui("info", str(recorded)).stdout
    imutui("export", str(recorded), "--topic", schemas.RAW, "-o", "raw.npz")
    with np.load("raw.npz") as columns:
        assert columns["status"].tolist() == [2] * len(log.raw)
        assert columns["board_temperature"].tolist() == [p.details[1] for p in log.raw if p.details]
    replayed = imutui("replay", str(recorded), "--reference", "gravity", "--json", check=None)
    assert '"samples": ' + str(log.stamp_ns.size) in replayed.stdout

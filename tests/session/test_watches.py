"""What is said of gravity where a unit may turn its own axes, and of status words."""

import re
from pathlib import Path

import numpy as np
import pytest
from helpers.blocks import block_of
from helpers.commands import imutui, imutui_json
from helpers.units import Still, served

from filters.imu import AxisMap, format_mount, parse_mount
from filters.motion.profile import Profile
from filters.motion.segments import Dwell
from imutui.instrument.clock import Stamp
from imutui.instrument.imu400.crossbow import Mode, Packet
from imutui.instrument.registry import INSTRUMENTS
from imutui.instrument.uut.fields import ORIENTATIONS, Field, Orientation
from imutui.instrument.uut.messages import PacketS1
from imutui.instrument.uut.unit import VirtualUnit
from imutui.instrument.uut.unit_options import IMU381ZA, UnitOptions
from imutui.logbook import reader
from imutui.logbook.session_info import SessionInfo
from imutui.session.stream import Block, Second
from imutui.session.watches import GravityCheck, StatusWords, unexpected_gravity

OVER = next(each for each in ORIENTATIONS.values() if (each.axes, each.signs) == ((0, 1, 2), (1, -1, -1)))


@pytest.mark.parametrize("orientation", ORIENTATIONS.values(), ids=lambda o: o.text.replace(" ", ""))
def test_a_level_case_with_turned_axes_is_told_how_to_name_them(orientation: Orientation) -> None:
    """What packets read when the case is level: the mounting that is named reads -1 g on the body's Z."""
    packets = np.zeros((3, 3))
    packets[range(3), list(orientation.axes)] = orientation.signs
    assert np.array_equal(parse_mount(orientation.mount) @ packets, np.eye(3))
    accels_g = packets @ np.array([0.0, 0.0, -1.0])
    said = unexpected_gravity(accels_g, AxisMap(accel_sign=1), orientation.mount)
    if packets[2, 2] == 1.0:
        assert said is None
        return
    assert said is not None
    assert f"--mount {orientation.mount}" in said
    named = AxisMap(parse_mount(orientation.mount), accel_sign=1)
    assert named.accel_to_body(accels_g)[2] == -1.0
    assert unexpected_gravity(accels_g, named, orientation.mount) is None


@pytest.mark.parametrize("mount", ["x,y,z", "-y,x,z", "x,z,-y"])
def test_a_unit_that_lies_upside_down_is_told_whatever_its_mounting(mount: str) -> None:
    axes = AxisMap(parse_mount(mount), accel_sign=1)
    accels_g = axes.mount.T @ np.array([-0.01, 0.006, 0.9986])
    for own_mount, said in (
        ("", "or its own configuration turns"),
        ("x,y,z", "its own configuration does not explain"),
    ):
        told = str(unexpected_gravity(accels_g, axes, own_mount))
        assert said in told
        turned_over = told.rpartition("--mount ")[2]
        assert AxisMap(parse_mount(turned_over), accel_sign=1).accel_to_body(accels_g)[2] == pytest.approx(-0.9986)
    assert unexpected_gravity(axes.mount.T @ np.array([0.8, 0.0, -0.6]), axes, "x,y,z") is None


def dwelling(outer: float, align: str = "none") -> Profile:
    return Profile((Dwell((outer, 0.0, 0.0), 60.0),), align=align)


@pytest.mark.parametrize(
    ("motion", "is_told"),
    [(None, True), (dwelling(0.0), True), (dwelling(1.57), False), (dwelling(0.0, "marks"), False)],
    ids=["level", "begins level", "begins elsewhere", "begins when it is said"],
)
def test_gravity_is_looked_at_once_where_the_table_begins_level(motion: Profile | None, is_told: bool) -> None:
    info = SessionInfo(accel_sign=1, reference="level" if motion is None else "profile", own_mount=OVER.mount)
    upside_down = np.array([0.0, 0.0, 1.0])
    before, then = (Second(0, 0, 0.0, False, accels_g, info, motion) for accels_g in (None, upside_down))
    watch = GravityCheck(INSTRUMENTS["imu381"])
    assert list(watch.take(before)) == []
    assert bool(list(watch.take(then))) is is_told
    assert list(watch.take(then)) == []
    assert list(GravityCheck(INSTRUMENTS["imu400cd"]).take(then)) == []


def test_what_a_unit_is_configured_as_is_in_its_log(home: Path) -> None:
    fields = tuple((f, OVER.field if f == Field.ORIENTATION else 4 if f == 1 else v) for f, v in IMU381ZA)
    options = UnitOptions(text="IMU381ZA-200 VIRTUAL SIM", fields=fields)
    log = home / "over.mcap"
    with served(VirtualUnit(Still(), options)) as port:
        # the filter, which takes the mounting for what was said, finds the same
        imutui("record", "--port", port, "--baud", "57600", "--duration", "4", "-o", log, check=1)
    told = imutui_json("info", log)
    assert told["own_mount"] == format_mount(np.diag([1.0, -1.0, -1.0])) == "x,-y,-z"
    assert told["configuration"] == (
        "rate divider 4 (25 Hz), 115200 baud, packets S1, field 5 2142, field 6 2142, orientation 0x0048 (+Ux -Uy -Uz)"
    )
    assert re.search(r"found with +rate divider 4 \(25 Hz\), 115200 baud", imutui("info", log).stdout)
    texts = [event.text for event in reader.read(log).events]
    assert "the unit keeps its own speed, 115200 baud: 57600 baud is only where it was looked for" in texts
    (said,) = [text for text in texts if "the unit lies upside down" in text]
    assert "+1.00 g: the unit lies upside down, or its own configuration turns its axes" in said
    assert said.endswith("--mount x,-y,-z")


# Status words of packets: each told once, the newest shown, and nothing of units whose packets have none

NOW = Second(0, 0, 0.0, False, None, SessionInfo(), None)


def packet(word: int) -> Block:
    """A packet of an IMU381 with a status word."""
    return block_of(PacketS1((0, 0, 0), (0, 0, 0), (0, 0, 0), 0, 0, word), Stamp(0, False), 0)


def test_a_word_is_told_when_it_is_new_and_shown_while_it_is_the_newest() -> None:
    words = StatusWords(INSTRUMENTS["imu381"])
    for word in (0, 0x1000, 0, 0x1000, 0x0021):
        assert list(words.take(packet(word))) == []
    assert [said.text.partition(";")[0] for said in words.take(NOW)] == [
        "the unit's status word (BIT) is 0x1000 (sensor status)",
        "the unit's status word (BIT) is 0x0021 (master fail, reserved 5)",
    ]
    assert words.newest == "0x0021 (master fail, reserved 5)"
    assert list(words.take(NOW)) == []
    list(words.take(packet(0)))
    assert words.newest == ""
    for word in range(1000):
        list(words.take(packet(word)))
    assert len(list(words.take(NOW))) < 20


def test_packets_without_a_status_word_say_nothing() -> None:
    words = StatusWords(INSTRUMENTS["imu400cd"])
    list(words.take(block_of(Packet(Mode.SCALED, (0, 0, 0), (0, 0, 5461), 1550, 0), Stamp(0, False), 0)))
    assert (words.newest, list(words.take(NOW))) == ("", [])

"""Profiles and scenarios from files, their errors, and a scenario over the wire."""

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from helpers import ros_messages
from helpers.commands import imutui_json
from helpers.documents import dwell, profile_toml, rate, toml
from helpers.processes import virtual_process

from filters.imu import IMU400CD_200
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sampled
from filters.simulation import Fault, Personality, PowerOn, Scenario, TableFault, Temperature, Unit
from filters.state import PAPER_SITE, Site
from imutui.cli import virtual as virtual_command
from imutui.cli.exit_codes import handled
from imutui.cli.virtual_readings import SIMULATED, Asked, SimulatedReadings, on_the_line, scenario_of
from imutui.instrument.imu400.unit import UnitOptions
from imutui.logbook import reader, reference_file
from imutui.scenario import ScenarioError, load_profile, load_scenario

DEG = math.pi / 180.0
MG = 9.80665e-3
PROFILE = profile_toml(dwell(30.0, middle=90.0), rate("inner", 30.0, 12.0), align="gyro")
SEGMENTS = (Dwell((0.0, 90 * DEG, 0.0), 30.0), Rate("inner", 30 * DEG, 12.0))
FULL = """
seed = 7
profile = "motion/tumble.toml"
power_ons = 3

[biases]
accel_mg = [5.0, -3.0, 8.0]
accel_run_mg = 0.5
gyro_run_dps = 0.02

[noise]
gyro_arw_deg_sqrt_h = 3.0
accel_bandwidth_hz = 0.0

[temperature]
history = [[0.0, 20.0], [600.0, 35.0]]

[site]
latitude_deg = 48.0
longitude_deg = 11.0
height_m = 500.0

[instrument]
accel_sign = 1
mount = "x,-y,-z"

[[effect]]
name = "thermal_lin"
channel = ["gx", "gy"]
dps_per_k = 0.02

[[effect]]
name = "delay"
tau_s = 0.005

[[power_on]]
seed = 11
gyro_dps = [0.5, -0.2, 0.1]
temperature = { constant_degc = 40.0 }

[[fault]]
at_s = 5.0
kind = "drop_bytes"
count = 7

[[fault]]
at_s = 9
kind = "silence"
seconds = 0.25

[unit]
version = "VIRTUAL SIM SLOW"
version_plain_text = true
ping = "resets"
clock_skew_ppm = -200
"""


def written(folder: Path, text: str, name: str = "scenario.toml") -> Path:
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    return path


def test_a_profile_in_a_file_is_the_profile(tmp_path: Path) -> None:
    assert load_profile(written(tmp_path, PROFILE)) == Profile(SEGMENTS, align="gyro")


def test_a_csv_is_a_profile_of_samples(tmp_path: Path) -> None:
    csv = written(tmp_path, "t, outer, middle, inner\n10, 0, 90, 0\n11, 0, 90, 5\n\n12.5, 0, 90, 10\n", "a.csv")
    samples = ((0.0, 90 * DEG, 0.0), (0.0, 90 * DEG, 5 * DEG), (0.0, 90 * DEG, 10 * DEG))
    assert load_profile(csv) == Profile((Sampled((10.0, 11.0, 12.5), samples),))
    toml = written(tmp_path, 'samples = "a.csv"\nsign = [1, 1, -1]\nalign = "marks"\noffset_sd_s = 0.1\n')
    assert load_profile(toml) == Profile((Sampled((10.0, 11.0, 12.5), samples),), (1, 1, -1), "marks", 0.1)


def test_a_scenario_in_a_file_is_the_scenario(tmp_path: Path) -> None:
    written(tmp_path, PROFILE, "motion/tumble.toml")
    s = load_scenario(written(tmp_path, FULL))
    assert (s.seed, s.profile) == (7, Profile(SEGMENTS, align="gyro"))
    assert s.accel_bias == pytest.approx((5 * MG, -3 * MG, 8 * MG))
    assert s.gyro_bias is None
    assert (s.accel_bias_run_sd, s.gyro_bias_run_sd) == pytest.approx((0.5 * MG, 0.02 * DEG))
    assert s.spec.gyro_arw == pytest.approx(3.0 * DEG / 60.0)
    assert (s.spec.accel_vrw, s.spec.accel_bandwidth) == (IMU400CD_200.accel_vrw, 0.0)
    assert s.temperature == Temperature(((0.0, 20.0), (600.0, 35.0)))
    assert s.site == Site.at(48.0, 11.0, 500.0)
    assert s.axes.accel_sign == 1
    assert s.axes.mount.tolist() == [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
    assert [(e.name, e.channels, dict(e.parameters)) for e in s.effects] == [
        ("thermal_lin", ("gx", "gy"), {"dps_per_k": 0.02}),
        ("delay", (), {"tau_s": 0.005}),
    ]
    first = PowerOn(11, Temperature(((0.0, 40.0),)), None, s.power_ons[0].gyro_bias)
    assert s.power_ons == (first, PowerOn(), PowerOn())
    assert first.gyro_bias == pytest.approx((0.5 * DEG, -0.2 * DEG, 0.1 * DEG))
    assert s.faults == (
        Fault(5.0, "drop_bytes", count=7),
        Fault(9.0, "silence", seconds=0.25),
    )
    assert s.personality == Personality("VIRTUAL SIM SLOW", True, "resets", -200.0)


def test_an_empty_scenario_is_a_plain_unit(tmp_path: Path) -> None:
    s = load_scenario(written(tmp_path, ""))
    assert (s.seed, s.profile, s.effects, s.site, s.spec) == (0, None, (), PAPER_SITE, IMU400CD_200)
    plain, from_file = (SimulatedReadings(scenario) for scenario in (Scenario(), s))
    assert plain.reading(5) == from_file.reading(5)
    assert from_file.line() is None


def test_what_a_scenario_says_of_the_unit_is_what_the_unit_is(tmp_path: Path) -> None:
    made = on_the_line(Asked(written(tmp_path, '[unit]\nping = "resets"\nclock_skew_ppm = 5\n')))
    assert made.options(7) == UnitOptions(serial_number=7, version=SIMULATED, ping="resets", clock_skew_ppm=5.0)
    assert made.line is None


def test_gravity_alone_changes_the_papers_site(tmp_path: Path) -> None:
    """Whoever measured it need not look up where the table stands."""
    s = load_scenario(written(tmp_path, "[site]\ngravity_mps2 = 9.79\n"))
    assert (s.site.latitude, s.site.gravity) == (PAPER_SITE.latitude, 9.79)


def test_a_profile_may_stand_in_the_scenario(tmp_path: Path) -> None:
    text = '[profile]\nalign = "marks"\n[[profile.segment]]\nkind = "dwell"\nangles_deg = [0, 0, 45]\nseconds = 5\n'
    assert load_scenario(written(tmp_path, text)).profile == Profile((Dwell((0.0, 0.0, 45 * DEG), 5.0),), align="marks")


WRONG = [
    ("seed = -1", ["`seed` is -1"]),
    ("seed = true", ["`seed` is True"]),
    ("speed = 3", ["`speed` is unknown", "power_ons"]),
    ("seed = ", ["not valid TOML"]),
    ('biases = "big"', ["`biases`", "[biases]"]),
    ("[biases]\naccel = [1, 2, 3]", ["`accel` is unknown", "accel_mg"]),
    ("[biases]\naccel_mg = [1, 2]", ["`accel_mg` is [1, 2]", "x, y, z"]),
    ("[biases]\ngyro_run_dps = -1", ["`gyro_run_dps` is -1"]),
    ("[noise]\ngyro_arw_deg_sqrt_h = -4.5", ["`gyro_arw_deg_sqrt_h` is -4.5"]),
    ("temperature = 25", ["`temperature` is 25", "constant_degc"]),
    ("[temperature]\nhistory = [[0, 20], [0, 30]]", ["history", "do not increase"]),
    ("[temperature]\nhistory = [20, 30]", ["history", "[s, degC]"]),
    ("[temperature]\nconstant_degc = nan", ["`constant_degc` is nan"]),
    ("profile = 3", ["`profile` is 3"]),
    ('profile = "absent.toml"', ["absent.toml can't be read", "No such file"]),
    ('[[profile.segment]]\nkind = "spin"', ["profile, segment 1", "`kind` is 'spin'"]),
    ("[[effect]]\nchannel = 'gx'", ["effect 1", "`name` is missing"]),
    ('[[effect]]\nname = "warmth"\nchannel = "gx"', ["effect 1", '"warmth"', "warmup"]),
    ('[[effect]]\nname = "ramp"\nchannel = 3', ["effect 1", "`channel` is 3"]),
    ('[[effect]]\nname = "ramp"\nchannel = "gx"', ["effect 1", "`dps_per_s` is missing"]),
    ('[[effect]]\nname = "ramp"\nchannel = "gx"\nmg_per_s = 1', ["`mg_per_s` is no parameter", "dps_per_s"]),
    ('[[effect]]\nname = "ramp"\nchannel = "gx"\ndps_per_s = [1]', ["`dps_per_s` is [1]"]),
    ("effect = 3", ["`effect` is 3", "[[effect]]"]),
    ("power_ons = 0", ["`power_ons` is 0"]),
    ("power_ons = 1\n[[power_on]]\n[[power_on]]", ["`power_ons` is 1", "2 [[power_on]]"]),
    ("[[power_on]]\nbias = 3", ["power_on 1: `bias` is unknown"]),
    ('[[fault]]\nat_s = 1\nkind = "fire"', ["fault 1", "'fire'", "garbage"]),
    ('[[fault]]\nat_s = 1\nkind = "silence"\ncount = 3', ["fault 1: silence: `count` is unknown", "seconds"]),
    ('[[fault]]\nat_s = -1\nkind = "silence"\nseconds = 3', ["`at_s` is -1"]),
    ('[[fault]]\nat_s = 1\nkind = "garbage"\ncount = 0', ["`count` is 0"]),
    ('[unit]\nversion = "IMU400CD-200"', ["'IMU400CD-200'", "VIRTUAL SIM"]),
    (f'[unit]\nversion = "VIRTUAL SIM {"x" * 30}"', ["at most 30 ASCII characters"]),
    ('[unit]\nping = "explodes"', ["`ping` is 'explodes'", "keeps, stops, resets"]),
    ("[unit]\nversion_plain_text = 1", ["`version_plain_text` is 1", "true or false"]),
    ("[unit]\nclock_skew_ppm = 1e6", ["`clock_skew_ppm` is 1000000"]),
    ("[unit]\nbaud = 9600", ["unit: `baud` is unknown", "clock_skew_ppm"]),
    ("[site]\nlatitude_deg = 3", ["`longitude_deg` is missing"]),
    ("[site]\nlatitude_deg = 91\nlongitude_deg = 0\nheight_m = 0", ["`latitude_deg` is 91"]),
    ("[instrument]\naccel_sign = 2", ["`accel_sign` is 2"]),
    ('[instrument]\nmount = "x,y"', ['`mount` is "x,y"']),
    ('[instrument]\nmount = "x,y,-z"', ["left-handed"]),
]


@pytest.mark.parametrize(("text", "words"), WRONG)
def test_a_wrong_scenario_is_refused_by_file_key_and_value(tmp_path: Path, text: str, words: list[str]) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    message = str(caught.value)
    assert "absent.toml" in message or str(path) in message
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "", ["is empty", "t, outer, middle, inner"]),
        ("a.csv", "time,o,m,i\n1,2,3,4\n", ['"time"', "t, outer, middle, inner"]),
        ("a.csv", "t,outer,middle,inner\n0,0,0,0\n1,0,0\n", ["line 3", "3 cells"]),
        ("a.csv", "t,outer,middle,inner\n0,0,0,0\n1,0,x,0\n", ["line 3", "`middle`", '"x"']),
        ("a.csv", "t,outer,middle,inner\n0,0,0,0\n0,0,0,0\n", ["does not increase"]),
        ("a.csv", "t,outer,middle,inner\n0,0,0,0\n", ["at least 2"]),
        ("a.toml", "segment = 3", ["`segment` is 3", "[[segment]]"]),
        ("a.toml", 'samples = "b.csv"', ["b.csv", "can't be read"]),
        ("a.toml", 'samples = "b.csv"\nslew_dps = 3', ["`slew_dps` is unknown", "offset_sd_s, samples"]),
        ("a.toml", 'samples = "b.csv"\nalign = "gps"', ["`align`", "gps"]),
    ],
)
def test_a_wrong_profile_is_refused_by_file_and_place(tmp_path: Path, name: str, text: str, words: list[str]) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_profile(written(tmp_path, text, name))
    assert all(word in str(caught.value) for word in words), str(caught.value)


WIRE = toml(
    seed=3,
    biases={"accel_mg": [40.0, -30.0, 20.0], "gyro_dps": [9.0, -2.0, 1.0]},
    noise={"gyro_arw_deg_sqrt_h": 0.1, "accel_vrw_mps_sqrt_h": 0.01},
    temperature={"history": [[0.0, 20.0], [8.0, 60.0]]},
    effect=[{"name": "thermal_lin", "channel": "gy", "dps_per_k": 0.5, "reference_degc": 20.0}],
    power_on=[{}, {"gyro_dps": [5.0, -2.0, 1.0]}],
    fault=[{"at_s": 1.5, "kind": "silence", "seconds": 0.3}, {"at_s": 2.2, "kind": "drop_bytes", "count": 5}],
)


def test_a_scenario_over_the_wire_is_in_the_counts(home: Path) -> None:
    written(home, WIRE, "s.toml")
    wish = ("--duration", "4", "--rate", "133", "--filter", "none", "-o", "a.mcap")
    with virtual_process("--scenario", "s.toml", "--power-on", "1", "--sent", "sent.csv") as (port, _):
        assert imutui_json("record", "--port", port, *wish)
    log = reader.read(home / "a.mcap", raw=True)
    axes = log.info.axes()
    dps = np.rad2deg(axes.gyro_to_instrument(log.samples.gyro))
    mg = axes.accel_to_instrument(log.samples.accel) / 9.80665e-3
    assert log.info.kind == "simulated"
    assert dps[:, [0, 2]].mean(axis=0) == pytest.approx([5.0, 1.0], abs=0.02)
    assert mg.mean(axis=0) == pytest.approx([40.0, -30.0, 1000 * PAPER_SITE.gravity / 9.80665 + 20.0], abs=0.5)
    seconds = log.seconds()
    slope = np.polyfit(seconds, dps[:, 1], 1)[0]
    assert slope == pytest.approx(0.5 * 5.0, rel=0.02), "half a deg/s for each kelvin, five kelvin a second"
    gaps = np.diff(seconds)
    missing = (gaps - 0.0075)[gaps > 0.01].sum() / 0.0075
    assert missing == pytest.approx(41, abs=8), "forty in the silence, and one packet that lost some bytes"
    heading, *rows = (home / "sent.csv").read_text().split()
    assert heading == "sampled_monotonic_ns,mode,ticks,frame"
    sent = [bytes.fromhex(row.split(",")[3]) for row in rows]
    received = [
        struct.pack(">6h2H", *packet.counts, packet.temperature, packet.ticks) for packet in ros_messages.packets(log)
    ]
    rest = iter(sent)
    assert all(any(frame[1:17] == words for frame in rest) for words in received), "each was sent, in this order"
    assert sent[-1][0] == 0xFF
    assert rows[0].split(",")[1:3] == ["scaled", str(int.from_bytes(sent[0][15:17], "big"))]


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ({"scenario": Path("absent.toml")}, 3, "can't be read"),
        ({"scenario": Path("bad.toml")}, 3, "`speed` is unknown"),
        ({"scenario": Path("good.toml"), "power_on": 2}, 2, "`power_on` is 2"),
        ({"power_on": 0}, 2, "needs --scenario"),
        ({"scenario": Path("good.toml"), "from_": Path("x.mcap")}, 3, "x.mcap: no such file"),
    ],
)
def test_a_wrong_call_ends_in_words(
    home: Path, capsys: pytest.CaptureFixture[str], arguments: dict[str, Any], code: int, words: str
) -> None:
    written(home, "speed = 3", "bad.toml")
    written(home, "power_ons = 2", "good.toml")
    with pytest.raises(typer.Exit) as caught:
        handled(virtual_command.command)(**arguments)
    assert caught.value.exit_code == code
    assert words in capsys.readouterr().err


def test_dropouts_and_jitter_of_a_scenario_reach_the_line(tmp_path: Path) -> None:
    text = toml(effect=[{"name": "dropout", "probability": 0.3}, {"name": "jitter", "sd_s": 0.001}])
    readings = SimulatedReadings(load_scenario(written(tmp_path, text)))
    line = readings.line()
    assert line is not None
    line.start(0.0)
    twin, hz = Unit(readings.unit.scenario), readings.unit.rate_hz
    for k in range(300):
        readings.reading(k)
        line.put(bytes([k % 251]) * 18, k / hz, k / hz + 0.0047, packet_bytes=18)
        event = line.next_event()
        assert (event == math.inf) == twin.lost(k)
        if event < math.inf:
            assert event == pytest.approx(k / hz + 0.0047 + max(twin.late(k), 0.0))
            assert line.take(event) == bytes([k % 251]) * 18


def test_a_seed_on_the_command_line_wins_over_the_files(home: Path) -> None:
    """So that one file serves many runs."""
    path = written(home, "seed = 3")
    assert scenario_of(path, None).seed == 3
    assert scenario_of(path, 9).seed == 9
    assert scenario_of(None, None).seed == 0


def test_a_file_is_itself_though_it_has_the_name_of_a_ready_made_profile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    name = Path(reference_file.ready_made()[0].name)
    ready_made = load_scenario(name).profile
    name.write_text(profile_toml(dwell(7.0)))
    assert load_scenario(name).profile == Profile((Dwell((0.0, 0.0, 0.0), 7.0),))
    assert ready_made == reference_file.ready_made()[0].profile


# ------------------------------------------------------------------------------------------- the table under command

TABLE = """
seed = 5
[table]
axes = ["middle", "inner"]
seed = 9
rate_dps = 100.0
stops_deg = [-45.0, 90.0]
wobble_sd_arcmin = 3.0
[[table_fault]]
at_s = 2.0
kind = "stuck"
axis = "middle"
seconds = 1.5
[[table_fault]]
at_s = 3.0
kind = "slow"
delay_s = 0.04
"""


def test_a_table_and_its_faults_are_read(tmp_path: Path) -> None:
    (tmp_path / "table.toml").write_text(TABLE)
    made = load_scenario(tmp_path / "table.toml")
    assert made.table.axes == ("middle", "inner")
    assert (made.table.seed, made.seed) == (9, 5)
    assert made.table.rate == pytest.approx(np.deg2rad(100.0))
    assert made.table.wobble_sd == pytest.approx(np.deg2rad(0.05))
    assert made.table.ends("middle") == pytest.approx(np.deg2rad([-45.0, 90.0]))
    assert made.table.ends("inner") == (-np.inf, np.inf)
    assert made.table.accel == Scenario().table.accel
    assert made.table_faults == (
        TableFault(2.0, "stuck", axis="middle", seconds=1.5),
        TableFault(3.0, "slow", delay=0.04),
    )


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[table]\nspeed = 1", "`speed` is unknown"),
        ('[table]\naxes = "inner"', "not a list of names"),
        ('[table]\naxes = ["up"]', "not one of"),
        ("[table]\nrate_dps = 0", "not all positive"),
        ("[table]\nrate_dps = -1", "rate_dps"),
        ("[table]\nstops_deg = [1.0]", "not two angles"),
        ("[table]\nstops_deg = [10.0, 20.0]", "angle below 0"),
        ("[[table_fault]]\nat_s = 1\nkind = 'worn'", "not one of: interlock"),
        ("[[table_fault]]\nat_s = 1\nkind = 'cut'\naxis = 'inner'", "`axis` is unknown"),
        ("[[table_fault]]\nat_s = 1\nkind = 'stuck'\naxis = 'up'", "not one of"),
        ("[[table_fault]]\nat_s = 1\nkind = 'unrecognised'\ncount = 0", "count"),
        ("[[table_fault]]\nkind = 'cut'", "`at_s` is missing"),
    ],
)
def test_a_table_that_is_none_is_refused_with_its_key(tmp_path: Path, text: str, why: str) -> None:
    (tmp_path / "table.toml").write_text(text)
    with pytest.raises(ScenarioError, match=why):
        load_scenario(tmp_path / "table.toml")

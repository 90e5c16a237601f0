"""A recording of each logger that docs/importing.md lists, as it writes one, by the command of that page."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import imutui
from helpers.paths import ROOT

from imutui.logbook import reader

N, HZ = 300, 100.0
_rng = np.random.default_rng(3)
GYRO = np.array([0.5, -0.4, 0.2]) + _rng.normal(0.0, 0.05, (N, 3))  # deg/s
ACCEL = np.array([0.01, -0.02, 1.0]) + _rng.normal(0.0, 1e-3, (N, 3))  # g
W, F = np.deg2rad(GYRO), ACCEL * 9.80665
K = range(N)


def rows(cells: str, *columns: object) -> str:
    """Rows of a text, by a format and a column a field."""
    return "".join(cells % row + "\n" for row in zip(*columns, strict=True))


PHYPHOX = '"Time (s)","Acceleration x (m/s^2)","Acceleration y (m/s^2)","Acceleration z (m/s^2)",' + (
    '"Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)"\n'
)
EUROC = "#timestamp [ns]," + ",".join(
    [f"w_RS_S_{a} [rad s^-1]" for a in "xyz"] + [f"a_RS_S_{a} [m s^-2]" for a in "xyz"]
)
PX4 = (
    "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,"
    "accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_integral_dt\n"
)
ARDUPILOT = "timestamp,TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz\n"
XSENS = "// General information:\n//  MT Manager version: 2022.0\n// Start Time: 12:00:00\n"
VECTORNAV = "$VNIMU,+00.1,+00.2,+00.3,%+.6f,%+.6f,%+.6f,%+.9f,%+.9f,%+.9f,+25.0,+101.3*5A"

LOGGERS: dict[str, str] = {
    "phyphox": PHYPHOX + rows("%.9E,%.9E,%.9E,%.9E,%.9E,%.9E,%.9E", [k / HZ for k in K], *F.T, *W.T),
    "EuRoC": EUROC + "\n" + rows(
        "%d,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f", [1403636579758555392 + k * 10**7 for k in K], *W.T, *F.T
    ),
    "Arduino, ESP: labels": rows(
        "ms:%d,ax:%.6f,ay:%.6f,az:%.6f,gx:%.6f,gy:%.6f,gz:%.6f", [10 * k for k in K], *ACCEL.T, *GYRO.T
    ),
    "Arduino, ESP: counts": rows(
        "%d %d %d %d %d %d %d", [10 * k for k in K], *np.round(ACCEL * 16384).T, *np.round(GYRO * 131).T
    ),
    "Arduino IDE with time stamps": rows(
        "12:%02d:%06.3f -> %.6f\t%.6f\t%.6f\t%.6f\t%.6f\t%.6f",
        [(59 * 100 + k) // 6000 for k in K], [(59 * 100 + k) % 6000 / 100 for k in K], *ACCEL.T, *GYRO.T,
    ),
    "PX4": PX4 + rows(
        "%d,%.9f,%.9f,%.9f,5000,0,%.9f,%.9f,%.9f,5000", [87_000_000 + k * 10_000 for k in K], *W.T, *F.T
    ),
    "ArduPilot": ARDUPILOT + rows(
        "%.6f,%d,0,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,0,0,38.5,1,1,1000,1000",
        [1.7e9 + k / HZ for k in K], [10_000 * k + 5_000_000 for k in K], *W.T, *F.T,
    ),
    "Sensor Logger": "time,gyro_z,gyro_y,gyro_x,accel_z,accel_y,accel_x\n" + rows(
        "%d,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f", [1_700_000_000_000_000_000 + k * 10**7 for k in K],
        *W.T[::-1], *F.T[::-1],
    ),
    "VectorNav": rows(VECTORNAV, *F.T, *W.T),
    "Xsens": XSENS + "\t".join(
        ["PacketCounter", "SampleTimeFine", "Acc_X", "Acc_Y", "Acc_Z", "Gyr_X", "Gyr_Y", "Gyr_Z", "Mag_X"]
    ) + "\n" + rows("%05d\t%d\t%.9f\t%.9f\t%.9f\t%.9f\t%.9f\t%.9f\t0.1", K, [100 * k + 7 for k in K], *F.T, *W.T),
}  # fmt: skip


def commands() -> dict[str, str]:
    """The table of the docs: what a logger writes, and the command."""
    text = (ROOT / "docs/importing.md").read_text()
    found = re.findall(r"^\| ([^|]+) \| [^|]+ \| `(imutui import [^`]+)` \|$", text, flags=re.MULTILINE)
    return dict(found)


def test_the_docs_have_a_command_for_each_logger() -> None:
    assert set(commands()) == set(LOGGERS)


@pytest.mark.parametrize("logger", LOGGERS)
def test_the_command_of_the_docs_takes_what_the_logger_writes(tmp_path: Path, logger: str) -> None:
    words = shlex.split(commands()[logger])[1:]
    source, log_path = tmp_path / words[1], tmp_path / words[words.index("-o") + 1]
    source.write_text(LOGGERS[logger])
    words[1], words[words.index("-o") + 1] = str(source), str(log_path)
    imutui(*words, "--gravity", "9.80665", "--reference", "gravity")
    log = reader.read(log_path)
    axes = log.info.axes()
    coarse = "counts" in logger
    gyro, accel = (
        np.rad2deg(axes.gyro_to_instrument(log.samples.gyro)),
        axes.accel_to_instrument(log.samples.accel) / 9.80665,
    )
    assert np.allclose(gyro, GYRO, atol=4e-3 if coarse else 1e-6)
    assert np.allclose(accel, ACCEL, atol=4e-5 if coarse else 1e-6)
    assert np.allclose(log.seconds(), np.arange(N) / HZ, atol=1e-6)

"""Small recordings as other programs leave them, of one simulated unit at rest: what it read is known."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

HZ, COUNT = 100.0, 3000
GYRO_DPS = np.array([0.10, -0.20, 0.30])
FORCE_G = np.array([0.002, -0.003, 0.999])
"""What the unit reads: rates, and specific force with z up, as phones and flight controllers have it."""
STANDARD_GRAVITY = 9.80665


def readings(seed: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times (s), rates (deg/s) and specific force (g)."""
    rng = np.random.default_rng(seed)
    t = np.arange(COUNT) / HZ
    gyro = GYRO_DPS + rng.normal(0.0, 0.05, (COUNT, 3))
    return t, gyro, FORCE_G + rng.normal(0.0, 0.001, (COUNT, 3))


def _rows(*columns: np.ndarray, form: str = "%.9g", separator: str = ",") -> str:
    return "".join(separator.join(form % value for value in row) + "\n" for row in np.column_stack(columns))


def phyphox(t: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> str:
    """Return a CSV of phyphox: units in the names."""
    axes = [f'"Gyroscope {axis} (rad/s)"' for axis in "xyz"] + [f'"Acceleration {axis} (m/s^2)"' for axis in "xyz"]
    return ",".join(['"Time (s)"', *axes]) + "\n" + _rows(t, np.deg2rad(gyro), accel * STANDARD_GRAVITY)


def phyphox_german(t: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> str:
    """Return the same with tabs and decimal commas."""
    return phyphox(t, gyro, accel).replace(",", "\t").replace(".", ",")


def euroc(t: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> str:
    """Return the data.csv of an IMU of a EuRoC data set."""
    names = "#timestamp [ns]," + ",".join(f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz")
    names += "," + ",".join(f"a_RS_S_{axis} [m s^-2]" for axis in "xyz")
    rows = zip(t, np.deg2rad(gyro), accel * STANDARD_GRAVITY, strict=True)
    return (
        names
        + "\n"
        + "".join(
            f"{1403636579758555392 + round(s * 1e9)},{','.join(f'{x:.9f}' for x in (*w, *f))}\n" for s, w, f in rows
        )
    )


def px4(t: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> str:
    """Return sensor_combined of ulog2csv."""
    names = ["timestamp", *(f"gyro_rad[{k}]" for k in range(3)), "gyro_integral_dt", "accelerometer_timestamp_relative"]
    names += [*(f"accelerometer_m_s2[{k}]" for k in range(3)), "accelerometer_integral_dt"]
    whole = np.full(t.size, 10_000.0)
    return (
        ",".join(names)
        + "\n"
        + _rows(
            np.round(t * 1e6) + 112_574_307,
            np.deg2rad(gyro),
            whole,
            0.0 * whole,
            accel * STANDARD_GRAVITY,
            whole,
            form="%.12g",
        )
    )


def ardupilot(t: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> str:
    """Return the IMU messages of mavlogdump."""
    names = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T"
    zeros = np.zeros(t.size)
    columns = np.round(t * 1e6), zeros, np.deg2rad(gyro), accel * STANDARD_GRAVITY, zeros, zeros, zeros + 41.5
    return names + "\n" + _rows(*columns, form="%.12g")


def arduino(t: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> str:
    """Return prints of a sketch: milliseconds and counts of an MPU-6050, tabs, a line of its start."""
    return (
        "MPU6050 ready\n"
        + "millis\tax\tay\taz\tgx\tgy\tgz\n"
        + _rows(np.round(t * 1e3), np.round(accel * 16384), np.round(gyro * 131), form="%d", separator="\t")
    )


def vectornav(t: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> str:
    """Return a CSV of VectorNav's Control Center."""
    names = "TimeStartup (ns),UncompAccel_X (m/s^2),UncompAccel_Y (m/s^2),UncompAccel_Z (m/s^2)"
    names += ",UncompGyro_X (rad/s),UncompGyro_Y (rad/s),UncompGyro_Z (rad/s),Temperature (C)"
    whole = np.full(t.size, 31.25)
    return names + "\n" + _rows(np.round(t * 1e9), accel * STANDARD_GRAVITY, np.deg2rad(gyro), whole, form="%.12g")


def xsens(t: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> str:
    """Return an ASCII export of MT Manager: remarks, a fine sample time in 0.1 ms, SI without words."""
    head = "// General information:\n//  MT Manager version:\t4.6.0\n// Device information:\n//  DeviceId:\t00340754\n"
    names = "PacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\n"
    counter = np.arange(t.size) + 17_402
    columns = counter, np.round(t * 1e4) + 5_000, accel * STANDARD_GRAVITY, np.deg2rad(gyro)
    return head + names + _rows(*columns, form="%.9g", separator="\t")


def sensor_logger(t: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> str:
    """Return a merged CSV of Sensor Logger."""
    names = "time,seconds_elapsed,gyroscope_x,gyroscope_y,gyroscope_z,accelerometer_x,accelerometer_y,accelerometer_z"
    stamps = 1_698_501_144_401_000_000 + np.round(t * 1e9).astype(np.int64)
    rows = zip(stamps.tolist(), t, np.deg2rad(gyro), accel * STANDARD_GRAVITY, strict=True)
    return names + "\n" + "".join(f"{ns},{s:.6f},{','.join(f'{x:.9f}' for x in (*w, *f))}\n" for ns, s, w, f in rows)


LOGGERS: dict[str, Callable[[np.ndarray, np.ndarray, np.ndarray], str]] = {
    "phyphox.csv": phyphox, "phyphox_german.csv": phyphox_german, "euroc.csv": euroc, "px4_sensor_combined_0.csv": px4,
    "ardupilot_imu.csv": ardupilot, "arduino.log": arduino, "vectornav.csv": vectornav, "xsens.txt": xsens,
    "sensor_logger.csv": sensor_logger,
}  # fmt: skip


def write(folder: Path, seed: int = 5) -> list[Path]:
    """Write a recording of each logger; returns the files."""
    made = []
    for name, text in LOGGERS.items():
        path = folder / name
        path.write_text(text(*readings(seed)), encoding="utf-8")
        made.append(path)
    return made

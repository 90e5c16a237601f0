"""Small recordings as other programs leave them, of one simulated unit at rest: what it read is known."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

HZ, COUNT = 100.0, 3000
GYRO_DPS = np.array([0.10, -0.20, 0.30])
FORCE_G = np.array([0.002, -0.003, 0.999])
"""What the unit reads: rates, and specific force with z up, as phones and flight controllers have it."""
STANDARD_GRAVITY = 9.80665
START_NS = 1_714_550_000_000_000_000


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


def _clock(form: str, t: np.ndarray) -> list[str]:
    """Times of day from 12:00 on, of a format with minutes, seconds and ms."""
    return [form % (ms // 60_000, ms // 1000 % 60, ms % 1000) for ms in np.round(t * 1e3).astype(int).tolist()]


def _stamped(names: str, stamps: list[str], *columns: np.ndarray, separator: str = ",") -> str:
    rows = _rows(*columns, form="%.9g", separator=separator).splitlines()
    return names + "\n" + "".join(f"{a}{separator}{b}\n" for a, b in zip(stamps, rows, strict=True))


_G, _rad = STANDARD_GRAVITY, np.deg2rad
_SHORT = "gx,gy,gz,ax,ay,az"
VARIANTS: dict[str, Callable[[np.ndarray, np.ndarray, np.ndarray], str]] = {
    # STMicroelectronics, WitMotion, Physics Toolbox, AndroSensor, Shimmer, Movella DOT, OpenIMU, OpenLog Artemis
    "st.csv": lambda t, w, f: "Timestamp [s],Acc_X [mg],Acc_Y [mg],Acc_Z [mg],Gyro_X [dps],Gyro_Y [dps],Gyro_Z [dps]\n"
    + _rows(t, 1e3 * f, w),
    "st_without_units.csv": lambda t, w, f: f"t,{_SHORT}\n" + _rows(t, 1e3 * w, 1e3 * f),
    "witmotion.txt": lambda t, w, f: "StartTime: 2024-05-01 12:00:00.000\n"
    + "Time(s)\tax(g)\tay(g)\taz(g)\twx(deg/s)\twy(deg/s)\twz(deg/s)\tT(\u00b0)\n"
    + _rows(t, f, w, 0.0 * t + 31.2, separator="\t"),
    "physics_toolbox.csv": lambda t, w, f: "time,gFx,gFy,gFz,wx,wy,wz\n" + _rows(t, f, _rad(w)),
    "androsensor.csv": lambda t, w, f: ";".join(
        [f"{name} {axis} ({unit})" for name, unit in (("ACCELEROMETER", "m/s\u00b2"), ("GYROSCOPE", "rad/s"))
         for axis in "XYZ"]
    ) + ";Time since start in ms\n" + _rows(f * _G, _rad(w), np.round(t * 1e3), separator=";"),
    "shimmer.csv": lambda t, w, f: '"sep=\t"\n' + "\t".join(
        ["S_Timestamp_Unix_CAL", *(f"S_Accel_LN_{a}_CAL" for a in "XYZ"), *(f"S_Gyro_{a}_CAL" for a in "XYZ")]
    ) + "\nms\tm/(s^2)\tm/(s^2)\tm/(s^2)\tdeg/s\tdeg/s\tdeg/s\n"
    + _rows(1.7145e12 + 1e3 * t, f * _G, w, form="%.15g", separator="\t"),
    "movella_dot.csv": lambda t, w, f: "sep=,\nDeviceTag:,DOT\n\nPacketCounter,SampleTimeFine,"
    + "Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z\n" + _rows(np.arange(t.size), np.round(t * 1e6) + 3e6, f * _G, w),
    "openimu.csv": lambda t, w, f: "counter, time (msec), "
    + ", ".join([f"{a}Accel (m/s^2)" for a in "xyz"] + [f"{a}Rate (rad/s)" for a in "xyz"]) + "\n"
    + _rows(np.arange(t.size), np.round(t * 1e3), f * _G, _rad(w)),
    "openlog.txt": lambda t, w, f: _stamped(
        "rtcDate,rtcTime,aX,aY,aZ,gX,gY,gZ", [f"05/11/2020,{c}" for c in _clock("12:%02d:%02d.%03d", t)], 1e3 * f, w
    ),
    # programs around ROS, prints of sketches, increments, counts
    "rostopic.csv": lambda t, w, f: "%time,field.header.seq,field.orientation.x,field.orientation.y,"
    + ",".join(f"field.{name}.{a}" for name in ("angular_velocity", "linear_acceleration") for a in "xyz") + "\n"
    + _rows(START_NS + 1e9 * t, np.arange(t.size), 0.0 * w[:, :2], _rad(w), f * _G, form="%.19g"),
    "plotjuggler.csv": lambda t, w, f: "__time,"
    + ",".join(f"/imu/{name}/{a}" for name in ("angular_velocity", "linear_acceleration") for a in "xyz") + "\n"
    + _rows(START_NS / 1e9 + t, _rad(w), f * _G, form="%.16g"),
    "lines.json": lambda t, w, f: "".join(
        json.dumps(dict(zip(("t", *_SHORT.split(",")), map(float, row), strict=True))) + "\n"
        for row in np.column_stack([t, w, f])
    ),
    "labels.txt": lambda t, w, f: "".join(
        " ".join(f"{name}={x:.6f}" for name, x in zip(("t", *_SHORT.split(",")), row, strict=True)) + "\n"
        for row in np.column_stack([t, w, f])
    ),
    "increments.csv": lambda t, w, f: "t,dtheta_x,dtheta_y,dtheta_z,dvel_x,dvel_y,dvel_z\n"
    + _rows(t, _rad(w) / HZ, f * _G / HZ),
    "counts.csv": lambda t, w, f: "time_ms,ax,ay,az,gx,gy,gz\n"
    + _rows(np.round(1e3 * t), np.round(f * 10923), np.round(w * 131), form="%d"),
    "gal.csv": lambda t, w, f: f"epoch_ms,{_SHORT}\n"
    + _rows(START_NS / 1e6 + 1e3 * t, w, f * _G * 100.0, form="%.15g"),
    # dates, clocks, stamps
    "date_german.csv": lambda t, w, f: _stamped(
        "Zeit;" + _SHORT.replace(",", ";"), _clock("01.05.2024 12:%02d:%02d,%03d", t), w, f, separator=";"
    ),
    "date_and_time.csv": lambda t, w, f: _stamped(
        f"Date,Time,{_SHORT}", [f"2024-05-01,{c}" for c in _clock("12:%02d:%02d.%03d", t)], w, f
    ),
    "clock_colons.csv": lambda t, w, f: _stamped(f"time,{_SHORT}", _clock("12:%02d:%02d:%03d", t), w, f),
    "micros_overflow.csv": lambda t, w, f: f"micros,{_SHORT}\n"
    + _rows((np.round(1e6 * t) + 2**32 - 10_000_000) % 2**32, w, f, form="%.10g"),
    "clock_back_twice.csv": lambda t, w, f: f"t,{_SHORT}\n" + _rows(t - 0.5 * (t >= 10.0) - 0.5 * (t >= 20.0), w, f),
    "rows_doubled.csv": lambda t, w, f: f"t,{_SHORT}\n"
    + _rows(*(np.repeat(x, 1 + (np.arange(t.size) % 50 == 7), axis=0) for x in (t, w, f))),
    "rounded.csv": lambda t, w, f: f"t,{_SHORT}\n" + _rows(np.float32(t + 20_000.0).astype(float), w, f),
    # units: two in one file, directions
    "two_units.csv": lambda t, w, f: f"t,id,{_SHORT}\n" + _rows(
        np.repeat(t, 2) + np.tile([0.0, 0.003], t.size), np.tile([0, 1], t.size),
        np.column_stack([w, w + 1.0]).reshape(-1, 3), np.repeat(f, 2, axis=0),
    ),
    "two_units_in_columns.csv": lambda t, w, f: "t,"
    + ",".join(f"imu{k}_{name}" for k in (1, 2) for name in _SHORT.split(",")) + "\n" + _rows(t, w, f, w + 1.0, f),
    "down.csv": lambda t, w, f: f"t,{_SHORT}\n" + _rows(t, w, -f),
    "on_its_side.csv": lambda t, w, f: f"t,{_SHORT}\n" + _rows(t, w, f[:, [2, 0, 1]]),
    "deg_per_hour.csv": lambda t, w, f: "t [s],"
    + ",".join([f"gyro_{a} [deg/h]" for a in "xyz"] + [f"a{a} [m/s^2]" for a in "xyz"]) + "\n"
    + _rows(t, 3600.0 * w, f * _G),
}  # fmt: skip


def write(folder: Path, seed: int = 5, loggers: Mapping[str, Callable[..., str]] = LOGGERS) -> list[Path]:
    """Write a recording of each logger; returns the files."""
    made = []
    for name, text in loggers.items():
        path = folder / name
        path.write_text(text(*readings(seed)), encoding="utf-8")
        made.append(path)
    return made

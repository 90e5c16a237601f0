"""Twenty units, each with one physical error, for a three-axis table under command."""

import math

import numpy

DT = 3.0 / 400.0
G = 9.80665
RAD = math.pi / 180.0
MG = 1e-3


def rate_scale_z(seed):
    """The z gyro's scale factor is a little too large, the same both ways."""

    def error(t, temp, ang, rate, w, f):
        return 0.0, 0.0, 0.0028 * w[2], 0.0, 0.0, 0.0

    return error


def rate_asymmetry_x(seed):
    """The x gyro reads too much when it turns the positive way and is right the other way."""

    def error(t, temp, ang, rate, w, f):
        return 0.0065 * max(w[0], 0.0), 0.0, 0.0, 0.0, 0.0, 0.0

    return error


def gyro_skew_y(seed):
    """The y gyro is not square to the others: it sees some of the rate about x, and less of that about z."""

    def error(t, temp, ang, rate, w, f):
        return 0.0, 0.0061 * w[0] - 0.0023 * w[2], 0.0, 0.0, 0.0, 0.0

    return error


def g_sensitivity(seed):
    """The biases of the x and y gyros follow the specific force, as the proof masses are not balanced."""

    def error(t, temp, ang, rate, w, f):
        return 0.1 * f[1] - 0.035 * f[2], 0.06 * f[1], 0.0, 0.0, 0.0, 0.0

    return error


def cubic_force_z(seed):
    """The z accelerometer is not linear: a term with the cube of the force, trimmed to nothing at 1 g."""

    def error(t, temp, ang, rate, w, f):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 11.0 * MG * f[2] * (f[2] * f[2] - 1.0)

    return error


def lever_arm(seed):
    """The accelerometers sit some centimetres from where the axes meet and feel the turning and its changes."""
    arm = numpy.array([0.021, -0.034, 0.012])
    last = None
    spin_up = numpy.zeros(3)

    def error(t, temp, ang, rate, w, f):
        nonlocal last, spin_up
        now = numpy.array(w, dtype=float) * RAD
        if last is None:
            last = now
        spin_up = spin_up + (DT / 0.03) * ((now - last) / DT - spin_up)
        last = now
        a = (numpy.cross(spin_up, arm) + numpy.cross(now, numpy.cross(now, arm))) / G
        return 0.0, 0.0, 0.0, float(a[0]), float(a[1]), float(a[2])

    return error


def scale_with_temperature_y(seed):
    """The y gyro's scale factor falls as the unit gets warmer than at its calibration."""

    def error(t, temp, ang, rate, w, f):
        return 0.0, -0.00055 * (temp - 22.0) * w[1], 0.0, 0.0, 0.0, 0.0

    return error


def compressed_rate_x(seed):
    """The x gyro's drive loop runs short of force above 55 deg/s, and what is beyond that is read too small."""

    def error(t, temp, ang, rate, w, f):
        beyond = max(abs(w[0]) - 55.0, 0.0)
        return -math.copysign(0.048 * beyond, w[0]), 0.0, 0.0, 0.0, 0.0, 0.0

    return error


def last_direction_z(seed):
    """A stuck lead holds the z gyro's frame to the side to which it was last turned, and lets go over minutes."""
    level = 0.0

    def error(t, temp, ang, rate, w, f):
        nonlocal level
        if abs(w[2]) > 3.0:
            level += (DT / 1.5) * (math.copysign(1.0, w[2]) - level)
        else:
            level -= (DT / 240.0) * level
        return 0.0, 0.0, 0.16 * level, 0.0, 0.0, 0.0

    return error


def late_rate_z(seed):
    """The z gyro comes later than the others by a few milliseconds."""
    last = None

    def error(t, temp, ang, rate, w, f):
        nonlocal last
        if last is None:
            last = float(w[2])
        late = 0.9 * (last - float(w[2]))
        last = float(w[2])
        return 0.0, 0.0, late, 0.0, 0.0, 0.0

    return error


def creep_after_tilt_z(seed):
    """The glue under the accelerometer gives way slowly: after a tilt the z force creeps to its new value."""
    settled = None

    def error(t, temp, ang, rate, w, f):
        nonlocal settled
        if settled is None:
            settled = float(f[2])
        settled += (DT / 45.0) * (float(f[2]) - settled)
        return 0.0, 0.0, 0.0, 0.0, 0.0, -3.2 * MG * (float(f[2]) - settled)

    return error


def rectified_jolts_x(seed):
    """Angular acceleration of either sign shakes the x accelerometer, which rectifies it into a shift of one sign."""
    last = None
    shaken = 0.0

    def error(t, temp, ang, rate, w, f):
        nonlocal last, shaken
        now = numpy.array(rate, dtype=float)
        if last is None:
            last = now
        jolt = float(numpy.abs(now - last).sum()) / DT
        last = now
        shaken += (DT / 2.0) * (min(jolt, 2000.0) - shaken)
        return 0.0, 0.0, 0.0, 7.0 * MG * shaken / 75.0, 0.0, 0.0

    return error


def rate_times_force_z(seed):
    """Under a force along x the z gyro's sense frame bends and sees the rate about y."""

    def error(t, temp, ang, rate, w, f):
        return 0.0, 0.0, 0.0075 * w[1] * f[0], 0.0, 0.0, 0.0

    return error


def cable_with_play_y(seed):
    """The cable winds up with the inner axis after some play, and pulls on the case along y until it slips."""
    before = None
    turned = 0.0
    wound = 0.0

    def error(t, temp, ang, rate, w, f):
        nonlocal before, turned, wound
        now = float(ang[2])
        if before is None:
            before = now
        turned += (now - before + 180.0) % 360.0 - 180.0
        before = now
        wound = min(max(wound, turned - 25.0), turned + 25.0)
        wound = min(max(wound, -220.0), 220.0)
        turned = min(max(turned, wound - 25.0), wound + 25.0)
        return 0.0, 0.0, 0.0, 0.0, 3.5 * MG * wound / 220.0, 0.0

    return error


def warm_up_y(seed):
    """The y gyro's bias settles exponentially after the power comes on, whatever the temperature."""

    def error(t, temp, ang, rate, w, f):
        return 0.0, 0.24 * math.exp(-t / 260.0), 0.0, 0.0, 0.0, 0.0

    return error


def late_heat_y(seed):
    """The y accelerometer's bias follows how far a slow part of the case lags behind the temperature."""
    slow = None

    def error(t, temp, ang, rate, w, f):
        nonlocal slow
        if slow is None:
            slow = float(temp)
        slow += (DT / 300.0) * (float(temp) - slow)
        return 0.0, 0.0, 0.0, 0.0, 0.75 * MG * (float(temp) - slow), 0.0

    return error


def faint_heat_x(seed):
    """The x gyro's bias rises with the temperature by next to nothing."""

    def error(t, temp, ang, rate, w, f):
        return 0.0007 * (temp - 25.0), 0.0, 0.0, 0.0, 0.0, 0.0

    return error


def two_levels_x(seed):
    """A trapped charge makes the x gyro's bias jump between two levels at random."""
    rng = numpy.random.default_rng(seed)
    up = bool(rng.integers(2))
    until = float(rng.exponential(35.0))

    def error(t, temp, ang, rate, w, f):
        nonlocal up, until
        while t >= until:
            up = not up
            until += float(rng.exponential(20.0 if up else 35.0))
        return (0.13 if up else 0.0), 0.0, 0.0, 0.0, 0.0, 0.0

    return error


def leaning_person(seed):
    """Now and then a person leans on the table's base and tilts it, which x and y feel."""
    rng = numpy.random.default_rng(seed)
    begin = float(rng.uniform(15.0, 60.0))
    end = begin + float(rng.uniform(15.0, 50.0))
    size = float(rng.uniform(1.5, 4.0))
    lean = 0.0

    def error(t, temp, ang, rate, w, f):
        nonlocal begin, end, size, lean
        if t >= end:
            begin = end + float(rng.uniform(20.0, 90.0))
            end = begin + float(rng.uniform(15.0, 50.0))
            size = float(rng.uniform(1.5, 4.0))
        lean += (DT / 0.8) * ((size if t >= begin else 0.0) - lean)
        return 0.0, 0.0, 0.0, 1.0 * MG * lean, -0.6 * MG * lean, 0.0

    return error


def wandering_z(seed):
    """The z accelerometer's bias wanders at random, held by a weak pull to its mean."""
    rng = numpy.random.default_rng(seed)
    tau = 150.0
    sd = 2.7 * MG
    level = sd * float(rng.standard_normal())
    keep = math.exp(-DT / tau)
    kick = sd * math.sqrt(1.0 - keep * keep)

    def error(t, temp, ang, rate, w, f):
        nonlocal level
        level = keep * level + kick * float(rng.standard_normal())
        return 0.0, 0.0, 0.0, 0.0, 0.0, level

    return error


def _entry(title, channels, driver, d, *, same_as=(), in_log=True, memory=False, motion="table"):
    return {
        "title": title,
        "channels": list(channels),
        "driver": list(driver),
        "same_as": list(same_as),
        "in_log": in_log,
        "memory": memory,
        "noise": "simulated",
        "d": d,
        "motion": motion,
    }


EFFECTS = {
    "rate_scale_z": _entry("Scale factor of the z gyro", ["gz"], ["rate_z"], 30),
    "rate_asymmetry_x": _entry("Scale factor of the x gyro differs by direction", ["gx"], ["rate_x"], 45),
    "gyro_skew_y": _entry("The y gyro is not square to x and z", ["gy"], ["rate_x", "rate_z"], 65),
    "g_sensitivity": _entry("Gyro biases follow the force", ["gx", "gy"], ["force_y", "force_z"], 20),
    "cubic_force_z": _entry("Cubic non-linearity of the z accelerometer", ["az"], ["force_z"], 45),
    "lever_arm": _entry(
        "Accelerometers off the centre of rotation",
        ["ax", "ay", "az"],
        ["rate_x", "rate_y", "rate_z", "rate_change"],
        60,
    ),
    "scale_with_temperature_y": _entry(
        "Scale factor of the y gyro falls with temperature", ["gy"], ["rate_y", "temperature"], 80
    ),
    "compressed_rate_x": _entry("The x gyro is compressed at high rate", ["gx"], ["rate_x"], 190),
    "last_direction_z": _entry(
        "The z gyro remembers the direction of its last turn",
        ["gz"],
        ["motion_history", "rate_z"],
        30,
        memory=True,
    ),
    "late_rate_z": _entry(
        "The z gyro comes late", ["gz"], ["rate_z", "rate_change"], 75, same_as=["motion_history"], memory=True
    ),
    "creep_after_tilt_z": _entry(
        "The z accelerometer creeps after a tilt", ["az"], ["force_z", "motion_history"], 32, memory=True
    ),
    "rectified_jolts_x": _entry(
        "Angular acceleration is rectified by the x accelerometer",
        ["ax"],
        ["rate_change"],
        42,
        same_as=["motion_history"],
        memory=True,
    ),
    "rate_times_force_z": _entry(
        "The z gyro sees the rate about y under a force along x", ["gz"], ["rate_y", "force_x"], 60
    ),
    "cable_with_play_y": _entry(
        "A cable with play pulls on the case",
        ["ay"],
        ["angle_inner", "motion_history"],
        40,
        memory=True,
    ),
    "warm_up_y": _entry("The y gyro settles after power-on", ["gy"], ["time"], 20, motion="still"),
    "late_heat_y": _entry(
        "The y accelerometer follows a lag of temperature",
        ["ay"],
        ["temperature_history"],
        100,
        same_as=["temperature_rate"],
        memory=True,
        motion="still",
    ),
    "faint_heat_x": _entry(
        "The x gyro hardly follows temperature", ["gx"], ["temperature"], "too weak to see", motion="still"
    ),
    "two_levels_x": _entry("The x gyro jumps between two levels", ["gx"], ["hidden"], 30, in_log=False, memory=True),
    "leaning_person": _entry(
        "A person leans on the table's base", ["ax", "ay"], ["hidden"], 30, in_log=False, memory=True
    ),
    "wandering_z": _entry("The z accelerometer wanders", ["az"], ["hidden"], 30, in_log=False, memory=True),
}

"""Undeclared effects, first set: twelve errors of supply, bench, moisture, mounts, fluids, clocks and stray fields."""

import math

import numpy

DT = 0.0075  # s between samples


def oven_on_the_mains(seed):
    """Supply sags while a laboratory oven heats; two output stages shift with it."""
    rng = numpy.random.default_rng(seed)
    depth = rng.uniform(0.8, 1.2)  # how heavily the line is loaded today
    heating = bool(rng.random() < 0.5)
    change = rng.uniform(10.0, 40.0)
    sag = depth if heating else 0.0

    def error(t, temp, ang, rate, w, f):
        nonlocal heating, change, sag
        if t >= change:
            heating = not heating
            change = t + (rng.uniform(25.0, 45.0) if heating else rng.uniform(30.0, 60.0))
        # the transformer and the buffer capacitor follow the load within seconds
        sag += DT / 3.0 * ((depth if heating else 0.0) - sag)
        return 0.25 * sag, 0.0, 0.0, 0.0, 0.0, -0.003 * sag

    return error


def air_leveller_hunts(seed):
    """The bench on air springs sinks by a leak and is lifted again by its levelling valve."""
    rng = numpy.random.default_rng(seed)
    sink = rng.uniform(40.0, 70.0)  # s from the upper to the lower end of the dead band
    height = rng.uniform(-1.0, 1.0)
    lower = -1.0
    lifting = False

    def error(t, temp, ang, rate, w, f):
        nonlocal sink, height, lower, lifting
        if lifting:
            height += DT * 2.0 / 6.0
            if height >= 1.0:
                lifting = False
                sink = rng.uniform(40.0, 70.0)
                lower = rng.uniform(-1.2, -0.8)
        else:
            height -= DT * 2.0 / sink
            if height <= lower:
                lifting = True
        # one corner moves, so the level plate tilts in one fixed direction: gravity appears on both level axes
        return 0.0, 0.0, 0.0, 0.0022 * height, -0.0015 * height, 0.0

    return error


def dew_on_the_board(seed):
    """Below the dew point of the enclosed air a water film grows and leaks current into one gyro's integrator."""
    rng = numpy.random.default_rng(seed)
    dew = rng.uniform(25.0, 33.0)  # degC, by the moisture closed in with the air
    film = 0.0

    def error(t, temp, ang, rate, w, f):
        nonlocal film
        # condenses below the dew point, dries above it, more quickly than it came
        excess = dew - temp
        film += DT * (0.004 * excess if excess > 0.0 else 0.006 * excess)
        if film < 0.0:
            film = 0.0
        elif film > 2.0:
            film = 2.0
        return 0.0, 0.2 * film / (film + 0.4), 0.0, 0.0, 0.0, 0.0

    return error


def lid_snaps(seed):
    """The domed lid over the accelerometer snaps through when warm and snaps back only when clearly colder."""
    popped = None

    def error(t, temp, ang, rate, w, f):
        nonlocal popped
        if popped is None:
            popped = temp > 30.0
        # two stable shapes: out above 33 degC, in below 27 degC, as it was in between
        if temp > 33.0:
            popped = True
        elif temp < 27.0:
            popped = False
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0028 if popped else 0.0

    return error


def loose_sensor_board(seed):
    """The board of the level accelerometers has play about z and lies on one stop or the other."""
    rng = numpy.random.default_rng(seed)
    side = 1.0 if rng.random() < 0.5 else -1.0  # where it lay when it was switched on
    angle = 0.003  # rad to each stop

    def error(t, temp, ang, rate, w, f):
        nonlocal side
        fx = float(f[0])
        # friction holds it until the force on its heavy edge exceeds 0.35 g
        if fx > 0.35:
            side = 1.0
        elif fx < -0.35:
            side = -1.0
        turn = angle * side
        return 0.0, 0.0, 0.0, turn * float(f[1]), -turn * fx, 0.0

    return error


def stirred_air(seed):
    """Turning blows away the warm air at the case and cools one accelerometer below the temperature sensor."""
    cool = 0.0  # K by which the element is colder (warmer if negative) than the sensor says

    def error(t, temp, ang, rate, w, f):
        nonlocal cool
        speed = abs(float(rate[0])) + abs(float(rate[1])) + abs(float(rate[2]))
        # heat transfer saturates with speed; the room has 22 degC; the element follows in half a minute
        cool += DT / 30.0 * (speed / (speed + 30.0) * (temp - 22.0) - cool)
        return 0.0, 0.0, 0.0, 0.0, 0.00037 * cool, 0.0

    return error


def spin_stretches_ring(seed):
    """Centrifugal load of a spin about z stretches the ring of gyro x a little, by the square of the rate."""

    def error(t, temp, ang, rate, w, f):
        wz = float(w[2]) / 100.0
        return 0.02 * wz * wz, 0.0, 0.0, 0.0, 0.0, 0.0

    return error


def magnet_beside_table(seed):
    """A magnet fixed to the pillar acts on two gyros while the middle axis carries them past it."""

    def error(t, temp, ang, rate, w, f):
        # field along the way past the magnet: a hump on one axis, its two-sided flank on the other
        u = ((float(ang[1]) - 40.0 + 180.0) % 360.0 - 180.0) / 35.0
        if abs(u) > 5.0:
            return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        hump = math.exp(-u * u)
        return 0.25 * hump, -0.25 * u * hump, 0.0, 0.0, 0.0, 0.0

    return error


def rubber_mounts_ring(seed):
    """The case stands on soft mounts and rings about z after each start, stop or reversal."""
    omega = 2.0 * math.pi * 1.4  # rad/s
    zeta = 0.04
    twist = 0.0
    speed = 0.0
    last = None

    def error(t, temp, ang, rate, w, f):
        nonlocal twist, speed, last
        wz = float(w[2])
        if last is None:
            last = wz
        # a lightly damped twist driven by the angular acceleration of the table; only part of it reaches the gyro
        speed += -(wz - last) - DT * (2.0 * zeta * omega * speed + omega * omega * twist)
        twist += DT * speed
        last = wz
        return 0.0, 0.0, 0.05 * speed, 0.0, 0.0, 0.0

    return error


def bubble_in_the_oil(seed):
    """A bubble in the damping oil wanders along y under gravity and unbalances the pendulum of accelerometer x."""
    rng = numpy.random.default_rng(seed)
    place = rng.uniform(-1.0, 1.0)  # where it stopped last time; the walls are at -1 and 1

    def error(t, temp, ang, rate, w, f):
        nonlocal place
        # creeping speed by the force along y over the viscosity, which falls by a third in ten degrees
        place += DT * 0.05 * math.exp(0.04 * (temp - 30.0)) * float(f[1])
        if place > 1.0:
            place = 1.0
        elif place < -1.0:
            place = -1.0
        return 0.0, 0.0, 0.0, 0.006 * place, 0.0, 0.0

    return error


def clocks_beat(seed):
    """Drive of gyro z and clock of its converter beat at a frequency that goes through zero at 29 degC."""
    rng = numpy.random.default_rng(seed)
    phase = rng.uniform(0.0, 1.0)  # turns; the two oscillators start at any phase

    def error(t, temp, ang, rate, w, f):
        nonlocal phase
        # the aliased tone has the difference of the two frequencies, the phase is its integral
        phase += DT * 0.015 * (temp - 29.0)
        return 0.0, 0.0, 0.18 * math.sin(2.0 * math.pi * phase), 0.0, 0.0, 0.0

    return error


def doors_press_the_lid(seed):
    """Doors of the building change the air pressure for some seconds and dent the sealed lid slightly."""
    rng = numpy.random.default_rng(seed)
    pressure = 0.0
    event = rng.uniform(5.0, 30.0)

    def error(t, temp, ang, rate, w, f):
        nonlocal pressure, event
        if t >= event:
            pressure += rng.uniform(0.5, 1.0) * (1.0 if rng.random() < 0.5 else -1.0)
            event = t + rng.exponential(25.0)
        pressure -= DT / 8.0 * pressure  # the room vents through its gaps
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0005 * pressure

    return error


EFFECTS = {
    "oven_on_the_mains": {
        "title": "Supply sags while an oven on the same line heats",
        "channels": ["gx", "az"],
        "driver": ["hidden"],
        "same_as": [],
        "in_log": False,
        "memory": False,
        "noise": "simulated",
        "d": 50,
        "motion": "still",
    },
    "air_leveller_hunts": {
        "title": "The bench on air springs sinks and is lifted again",
        "channels": ["ax", "ay"],
        "driver": ["hidden"],
        "same_as": [],
        "in_log": False,
        "memory": False,
        "noise": "measured",
        "d": 80,
        "motion": "still",
    },
    "dew_on_the_board": {
        "title": "A film of dew grows below the dew point and leaks current",
        "channels": ["gy"],
        "driver": ["hidden", "temperature_history"],
        "same_as": [],
        "in_log": False,
        "memory": True,
        "noise": "measured",
        "d": 50,
        "motion": "still",
    },
    "lid_snaps": {
        "title": "A domed lid snaps out when warm and back when colder",
        "channels": ["az"],
        "driver": ["temperature", "temperature_history"],
        "same_as": [],
        "in_log": True,
        "memory": True,
        "noise": "measured",
        "d": 90,
        "motion": "still",
    },
    "loose_sensor_board": {
        "title": "A board with play about z falls from one stop to the other",
        "channels": ["ax", "ay"],
        "driver": ["force_x", "force_y", "motion_history"],
        "same_as": ["angle_outer", "angle_middle", "angle_inner"],
        "in_log": True,
        "memory": True,
        "noise": "measured",
        "d": 90,
        "motion": "table",
    },
    "stirred_air": {
        "title": "Turning stirs the air and cools one accelerometer",
        "channels": ["ay"],
        "driver": ["motion_history", "temperature"],
        "same_as": ["temperature_history"],
        "in_log": True,
        "memory": True,
        "noise": "measured",
        "d": 70,
        "motion": "table",
    },
    "spin_stretches_ring": {
        "title": "Spin about z stretches the ring of gyro x",
        "channels": ["gx"],
        "driver": ["rate_z"],
        "same_as": [],
        "in_log": True,
        "memory": False,
        "noise": "measured",
        "d": "too weak to see",
        "motion": "table",
    },
    "magnet_beside_table": {
        "title": "A magnet on the pillar acts as the middle axis passes it",
        "channels": ["gx", "gy"],
        "driver": ["angle_middle"],
        "same_as": [],
        "in_log": True,
        "memory": False,
        "noise": "simulated",
        "d": 40,
        "motion": "table",
    },
    "rubber_mounts_ring": {
        "title": "Soft mounts ring about z after each start and stop",
        "channels": ["gz"],
        "driver": ["rate_change", "motion_history"],
        "same_as": [],
        "in_log": True,
        "memory": True,
        "noise": "simulated",
        "d": 60,
        "motion": "table",
    },
    "bubble_in_the_oil": {
        "title": "A bubble in the damping oil wanders under gravity",
        "channels": ["ax"],
        "driver": ["force_y", "motion_history", "temperature"],
        "same_as": ["angle_outer", "angle_middle", "angle_inner"],
        "in_log": True,
        "memory": True,
        "noise": "simulated",
        "d": 40,
        "motion": "table",
    },
    "clocks_beat": {
        "title": "Two clocks beat at a frequency that follows the temperature",
        "channels": ["gz"],
        "driver": ["temperature_history"],  # the phase at the start is drawn at each power-on
        "same_as": [],
        "in_log": True,
        "memory": True,
        "noise": "simulated",
        "d": 55,
        "motion": "still",
    },
    "doors_press_the_lid": {
        "title": "Doors change the air pressure and dent the lid",
        "channels": ["az"],
        "driver": ["hidden"],
        "same_as": [],
        "in_log": False,
        "memory": False,
        "noise": "simulated",
        "d": "too weak to see",
        "motion": "still",
    },
}

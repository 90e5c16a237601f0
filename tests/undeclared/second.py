"""Undeclared effects, second set: faults of mounting, electronics, firmware and laboratory, missing in usual lists."""

import math

import numpy

DT = 0.0075  # s between samples


def _intervals(rng, low, high, end=420.0):
    """Times of events, apart by low to high seconds, until after the end of the recording."""
    times = []
    now = rng.uniform(0.2, 1.0) * high
    while now < end:
        times.append(float(now))
        now += rng.uniform(low, high)
    times.append(1e9)
    return times


def washer_slip(seed):
    """Stress from expansion builds up under a board's washer and is released in slips."""
    rng = numpy.random.default_rng(seed)
    share = 0.85e-3  # g per K of expansion that friction still holds
    kept = 0.25  # share of the stress left after a slip
    anchor = None
    limit = float(rng.uniform(2.2, 3.4))

    def error(t, temp, ang, rate, w, f):
        nonlocal anchor, limit
        temp = float(temp)
        if anchor is None:
            anchor = temp - float(rng.uniform(-1.0, 1.0))
        held = temp - anchor
        # no two slips need quite the same stress
        if abs(held) > limit:
            held *= kept
            anchor = temp - held
            limit = float(rng.uniform(2.2, 3.4))
        return 0.0, 0.0, 0.0, 0.0, 0.0, share * held

    return error


def autozero_leak(seed):
    """The capacitor that holds the zero of the z gyro leaks until firmware refreshes it every 41 s."""
    period = 41.0
    speed = 3.3e-3  # deg/s per s at 30 degC; the leakage current doubles every 9 K
    level = 0.0
    turn = 0

    def error(t, temp, ang, rate, w, f):
        nonlocal level, turn
        now = int(t / period)
        if now != turn:
            turn = now
            level = 0.0
        level += speed * DT * 2.0 ** ((float(temp) - 30.0) / 9.0)
        return 0.0, 0.0, level, 0.0, 0.0, 0.0

    return error


def person_on_floor(seed):
    """A person walks about a soft floor, which tilts table and instrument under the weight."""
    rng = numpy.random.default_rng(seed)
    # tilt in g along x and y with the person at the desk, at the rack, at the window, out of the room
    places = ((2.3e-3, -0.7e-3), (-1.6e-3, -1.6e-3), (0.6e-3, 2.3e-3), (0.0, 0.0))
    times = _intervals(rng, 9.0, 40.0)
    place = int(rng.integers(4))
    x, y = places[place]
    sway = float(rng.uniform(0.0, 6.28))
    number = 0

    def error(t, temp, ang, rate, w, f):
        nonlocal place, x, y, number
        if t >= times[number]:
            number += 1
            place = (place + int(rng.integers(1, 4))) % 4
        goal_x, goal_y = places[place]
        # some two seconds to walk over and for the floor to settle
        x += (goal_x - x) * DT / 1.8
        y += (goal_y - y) * DT / 1.8
        # shifting from foot to foot
        shift = 1.0 + 0.15 * math.sin(1.7 * t + sway)
        return 0.0, 0.0, 0.0, x * shift, y * shift, 0.0

    return error


def folding_converter(seed):
    """A folding converter of the y accelerometer has a gain error that starts anew in every fold."""
    fold = 0.31  # g
    height = 4.6e-3  # g from one end of a fold to the other

    def error(t, temp, ang, rate, w, f):
        part = float(f[1]) / fold + 0.37
        return 0.0, 0.0, 0.0, 0.0, height * (part - math.floor(part) - 0.5), 0.0

    return error


def oil_drop(seed):
    """A drop of oil runs along a groove beside the x accelerometer, whose mass it loads, and sticks where it stops."""
    rng = numpy.random.default_rng(seed)
    load = 4.2e-3  # g with the drop at an end of the groove
    place = float(rng.uniform(-1.0, 1.0))

    def error(t, temp, ang, rate, w, f):
        nonlocal place
        pull = float(f[1])
        # surface tension holds it against a slight slope; warm oil runs faster
        if abs(pull) > 0.12:
            place += 0.07 * DT * pull * 2.0 ** ((float(temp) - 30.0) / 10.0)
            place = 1.0 if place > 1.0 else -1.0 if place < -1.0 else place
        return 0.0, 0.0, 0.0, load * place, 0.0, 0.0

    return error


def microphonic_capacitor(seed):
    """A ceramic capacitor at the edge of the board is bent when the rate about z changes."""
    gain = 1e-4  # deg/s per deg/s^2
    before = None
    smooth = 0.0

    def error(t, temp, ang, rate, w, f):
        nonlocal before, smooth
        now = float(w[2])
        if before is None:
            before = now
        # the filter behind the amplifier takes 20 ms
        smooth += ((now - before) / DT - smooth) * DT / 0.02
        before = now
        return 0.0, 0.0, gain * smooth, 0.0, 0.0, 0.0

    return error


def heater_return(seed):
    """The current of the chamber's heater returns through the ground of the y gyro while it is on."""
    drop = 0.2  # deg/s with the heater on; it is on or off, whatever the speed of heating
    slow = None
    on = False
    level = 0.0

    def error(t, temp, ang, rate, w, f):
        nonlocal slow, on, level
        temp = float(temp)
        if slow is None:
            slow = temp
        speed = (temp - slow) / 1.5
        slow += speed * DT
        on = speed > (0.03 if on else 0.05)
        level += ((drop if on else 0.0) - level) * DT / 0.1
        return 0.0, level, 0.0, 0.0, 0.0, 0.0

    return error


def door_pressure(seed):
    """Doors of the laboratory change the air pressure, which bows the lid until a leak lets the case follow."""
    rng = numpy.random.default_rng(seed)
    bow = 1.4e-4  # g per Pa across the lid
    leak = 14.0  # s
    times = _intervals(rng, 8.0, 34.0)
    room = float(rng.uniform(-15.0, 15.0))
    goal = room
    case = room
    number = 0

    def error(t, temp, ang, rate, w, f):
        nonlocal room, goal, case, number
        if t >= times[number]:
            number += 1
            goal = float(rng.uniform(8.0, 25.0)) * (-1.0 if goal > 0.0 else 1.0)
        room += (goal - room) * DT / 0.8
        case += (room - case) * DT / leak
        return 0.0, 0.0, 0.0, 0.0, 0.0, bow * (room - case)

    return error


def clouds_on_chip(seed):
    """Daylight through a slot falls on a bare chip of the x gyro, and clouds pass."""
    rng = numpy.random.default_rng(seed)
    depth = 0.005  # deg/s
    phases = [float(p) for p in rng.uniform(0.0, 6.28, 3)]
    speeds = [float(s) for s in rng.uniform(0.06, 0.25, 3)]

    def error(t, temp, ang, rate, w, f):
        light = 0.0
        for speed, phase in zip(speeds, phases, strict=True):
            light += math.sin(speed * t + phase)
        # behind a cloud there is hardly any light
        return depth * max(0.0, light), 0.0, 0.0, 0.0, 0.0, 0.0

    return error


def radio_keyed(seed):
    """A hand-held radio near the table is keyed; its carrier is rectified more or less as the cable is turned."""
    rng = numpy.random.default_rng(seed)
    x, z = 0.32, -0.19  # deg/s at full field
    times = _intervals(rng, 7.0, 30.0)
    on = bool(rng.integers(2))
    field = float(rng.uniform(0.8, 1.2))
    number = 0

    def error(t, temp, ang, rate, w, f):
        nonlocal on, field, number
        if t >= times[number]:
            number += 1
            on = not on
            field = float(rng.uniform(0.8, 1.2))
        if not on:
            return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        # the cable leaves the case sideways: the part of it along the aerial, squared by the rectifier
        along = math.cos(math.radians(float(ang[2]) - 35.0))
        power = field * (0.25 + 0.75 * along * along)
        return x * power, 0.0, z * power, 0.0, 0.0, 0.0

    return error


def stop_touched(seed):
    """Turned fast one way about y, the frame of the x gyro touches a stop and is pushed aside."""
    start = 52.0  # deg/s
    push = 0.02  # deg/s per deg/s beyond

    def error(t, temp, ang, rate, w, f):
        beyond = float(w[1]) - start
        return (push * beyond if beyond > 0.0 else 0.0), 0.0, 0.0, 0.0, 0.0, 0.0

    return error


def rubbed_charge(seed):
    """Turning rubs charge onto a plastic sleeve beside the sensors; it leaks slowly and sparks over at a limit."""
    rng = numpy.random.default_rng(seed)
    y_gyro, y_force = 0.44, 4.5e-3  # deg/s and g at the charge that sparks over
    charge = float(rng.uniform(0.0, 0.3))

    def error(t, temp, ang, rate, w, f):
        nonlocal charge
        turned = abs(float(rate[0])) + abs(float(rate[1])) + abs(float(rate[2]))
        charge += (turned / 1500.0 - charge / 55.0) * DT
        if charge > 1.0:
            charge = 0.1
        return 0.0, y_gyro * charge, 0.0, 0.0, y_force * charge, 0.0

    return error


EFFECTS = {
    "washer_slip": {
        "title": "A washer holds the board against expansion and slips in jumps",
        "channels": ["az"],
        "driver": ["temperature_history"],
        "same_as": [],
        "in_log": True,
        "memory": True,
        "noise": "measured",
        "d": 90,
        "motion": "still",
    },
    "autozero_leak": {
        "title": "A held zero leaks away, faster when warm, and is refreshed every 41 s",
        "channels": ["gz"],
        "driver": ["time", "temperature_history"],
        "same_as": ["temperature"],
        "in_log": True,
        "memory": True,
        "noise": "measured",
        "d": 60,
        "motion": "still",
    },
    "person_on_floor": {
        "title": "The floor tilts under a person who walks about the room",
        "channels": ["ax", "ay"],
        "driver": ["hidden"],
        "same_as": [],
        "in_log": False,
        "memory": False,
        "noise": "measured",
        "d": 100,
        "motion": "still",
    },
    "folding_converter": {
        "title": "A folding converter errs alike in every fold of its range",
        "channels": ["ay"],
        "driver": ["force_y"],
        "same_as": [],
        "in_log": True,
        "memory": False,
        "noise": "measured",
        "d": 80,
        "motion": "table",
    },
    "oil_drop": {
        "title": "A drop of oil runs to and fro in a groove and sticks where it stops",
        "channels": ["ax"],
        "driver": ["force_y", "motion_history", "temperature"],
        "same_as": [],
        "in_log": True,
        "memory": True,
        "noise": "measured",
        "d": 100,
        "motion": "table",
    },
    "microphonic_capacitor": {
        "title": "A capacitor is bent by changes of the rate",
        "channels": ["gz"],
        "driver": ["rate_change"],
        "same_as": [],
        "in_log": True,
        "memory": False,
        "noise": "measured",
        "d": "too weak to see",
        "motion": "table",
    },
    "heater_return": {
        "title": "The heater's current returns through the sensor's ground",
        "channels": ["gy"],
        "driver": ["temperature_rate"],
        "same_as": ["temperature_history"],
        "in_log": True,
        "memory": False,
        "noise": "simulated",
        "d": 40,
        "motion": "still",
    },
    "door_pressure": {
        "title": "Doors change the air pressure and the lid bows until the case has followed",
        "channels": ["az"],
        "driver": ["hidden"],
        "same_as": [],
        "in_log": False,
        "memory": True,
        "noise": "simulated",
        "d": 35,
        "motion": "still",
    },
    "clouds_on_chip": {
        "title": "Daylight falls on a bare chip and clouds pass",
        "channels": ["gx"],
        "driver": ["hidden"],
        "same_as": [],
        "in_log": False,
        "memory": False,
        "noise": "simulated",
        "d": "too weak to see",
        "motion": "still",
    },
    "radio_keyed": {
        "title": "A radio is keyed near a cable that turns with the table",
        "channels": ["gx", "gz"],
        "driver": ["hidden", "angle_inner"],
        "same_as": [],
        "in_log": False,
        "memory": False,
        "noise": "simulated",
        "d": 50,
        "motion": "table",
    },
    "stop_touched": {
        "title": "Turned fast one way about y, the frame of the x gyro touches a stop",
        "channels": ["gx"],
        "driver": ["rate_y"],
        "same_as": [],
        "in_log": True,
        "memory": False,
        "noise": "simulated",
        "d": 60,
        "motion": "table",
    },
    "rubbed_charge": {
        "title": "Turning rubs up a charge that leaks slowly and sparks over",
        "channels": ["gy", "ay"],
        "driver": ["motion_history"],
        "same_as": [],
        "in_log": True,
        "memory": True,
        "noise": "simulated",
        "d": 45,
        "motion": "table",
    },
}

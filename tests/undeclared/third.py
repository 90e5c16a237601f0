"""Sixteen undeclared errors of an inertial measurement unit.

The set asks for what real units and real tables do and no data sheet says: a resonator that crosses another mode,
glue that softens, friction under a lid, a plug that is loose, charge that creeps in an oxide, a bearing that is not
round. It was written without any knowledge of the program that is tried on it.

Each function takes the seed of one power-on and returns error(t, temp, ang, rate, w, f), called once a sample in
order, which returns six numbers: deg/s about x, y, z and g along x, y, z. Constants below belong to the unit and are
the same at each power-on; whatever is drawn from the seed differs from power-on to power-on. Unless a function says
otherwise it draws nothing.

Amplitudes are set for the white noise the table names under "noise": 0.075 deg/s/rtHz and 1.7 mg/rtHz if simulated,
half of that (gyros) and a quarter of that (accelerometers) if measured.
"""

import math

import numpy as np

DT = 3.0 / 400.0  # s between samples
MG = 1e-3  # g


def follow(tau):
    """Share of the way that a first-order lag of tau seconds goes in one sample."""
    return 1.0 - math.exp(-DT / tau)


# ---------------------------------------------------------------- temperature, its present value


def resonator_dip(seed):
    """The drive mode of gyro y crosses a mode of its frame at 29.4 degC.

    Near the crossing the two exchange energy and phase, so the bias has a lopsided bump, about 2 K wide, and nothing
    far away.
    """
    centre, half_width, height = 29.4, 1.1, 0.145

    def error(t, temp, ang, rate, w, f):
        u = (temp - centre) / half_width
        return 0.0, height * (1.0 - 0.7 * u) / (1.0 + u * u) ** 1.5, 0.0, 0.0, 0.0, 0.0

    return error


def glue_softens(seed):
    """The glue under the accelerometers softens above 33 degC and expands several times more.

    Below the kink there is no error, above it x and y go with a constant slope; the kink is rounded over about 1 K.
    """
    knee, round_off, slope_x, slope_y = 33.0, 0.4, 0.60 * MG, -0.33 * MG

    def error(t, temp, ang, rate, w, f):
        rise = round_off * float(np.logaddexp(0.0, (temp - knee) / round_off))
        return 0.0, 0.0, 0.0, slope_x * rise, slope_y * rise, 0.0

    return error


# ---------------------------------------------------------------- temperature, its past


def handover_step(seed):
    """The unit's own correction of gyro x has three temperature ranges whose ends do not meet.

    The bias steps where one range hands over to the next. So as not to chatter, the firmware hands over at a higher
    temperature when it warms than when it cools, by 2 K. At power-on it takes the range of the present temperature.
    """
    up = (27.2, 35.6)  # degC, warming past these selects the next range
    down = (25.2, 33.6)  # degC, cooling past these selects the range before
    level = (0.0, 0.098, 0.034)  # deg/s in each range
    index = None

    def error(t, temp, ang, rate, w, f):
        nonlocal index
        if index is None:
            index = sum(temp > 0.5 * (a + b) for a, b in zip(up, down, strict=True))
        while index < 2 and temp > up[index]:
            index += 1
        while index > 0 and temp < down[index - 1]:
            index -= 1
        return level[index], 0.0, 0.0, 0.0, 0.0, 0.0

    return error


def lid_sticks(seed):
    """The lid expands more than the body, and friction at its rim holds it back.

    Each change of temperature loads the lid until the rim slips; from there the load stays at the friction limit, of
    the sign of the last change, and stays while the temperature rests. Accelerometers z and y read that load. The
    load at power-on is what the last use left: drawn.
    """
    rng = np.random.default_rng(seed)
    limit = 3.5  # K of expansion that friction can hold
    gain_z, gain_y = 0.68 * MG, 0.26 * MG  # per K of expansion held
    load = float(rng.uniform(-limit, limit))
    before = None

    def error(t, temp, ang, rate, w, f):
        nonlocal load, before
        if before is not None:
            load = min(limit, max(-limit, load + temp - before))
        before = temp
        return 0.0, 0.0, 0.0, 0.0, gain_y * load, gain_z * load

    return error


def faint_draught(seed):
    """A gradient across the board, in proportion to how fast it warms, moves gyro z: too little to be seen."""
    share = follow(3.0)
    gain = 0.042  # deg/s per K/s
    lag = None

    def error(t, temp, ang, rate, w, f):
        nonlocal lag
        if lag is None:
            lag = temp
        lag += share * (temp - lag)
        return 0.0, 0.0, gain * (temp - lag) / 3.0, 0.0, 0.0, 0.0

    return error


# ---------------------------------------------------------------- time since power-on


def reference_settles(seed):
    """The voltage reference of the accelerometers settles after power-on: fast at first, then ever more slowly.

    Traps in it empty over all time constants, hence a stretched exponential. How full they are depends on how long
    the unit was off: drawn, within 25 % of the usual. Accelerometer z shows it, x a third of it with the other sign.
    """
    rng = np.random.default_rng(seed)
    amount = 4.0 * MG * float(rng.uniform(0.75, 1.25))
    tau, stretch = 38.0, 0.6

    def error(t, temp, ang, rate, w, f):
        left = amount * math.exp(-((t / tau) ** stretch))
        return 0.0, 0.0, 0.0, -0.33 * left, 0.0, left

    return error


def rezero(seed):
    """Every 61 s, counted from power-on, the unit takes the temperature to which it corrects gyro z.

    Between two such moments the correction stands still and the error grows with the way the temperature has gone
    since; at the next it jumps back to zero. Where the temperature rests there is nothing to see.
    """
    period, gain = 61.0, 0.0196  # s, deg/s per K
    zeroed, at_zero = -1, 0.0

    def error(t, temp, ang, rate, w, f):
        nonlocal zeroed, at_zero
        count = int(t // period)
        if count != zeroed:
            zeroed, at_zero = count, temp
        return 0.0, 0.0, gain * (temp - at_zero), 0.0, 0.0, 0.0

    return error


# ---------------------------------------------------------------- motion and its past


def dielectric_soak(seed):
    """The voltage that holds up the mass of accelerometer z draws charge into the oxide, and the charge creeps.

    The error follows the force along z with two lags, 9 s and 75 s: after each tilt the reading goes on creeping. At
    power-on the charge is at rest at the first force.
    """
    quick, slow = follow(9.0), follow(75.0)
    gain_quick, gain_slow = 0.80 * MG, 1.5 * MG  # per g
    near = far = None

    def error(t, temp, ang, rate, w, f):
        nonlocal near, far
        z = float(f[2])
        if near is None:
            near = far = z
        near += quick * (z - near)
        far += slow * (z - far)
        return 0.0, 0.0, 0.0, 0.0, 0.0, gain_quick * near + gain_slow * far

    return error


def spin_heats(seed):
    """Turning about z at speed, in either sense, heats the drive of gyro y, which cools again in 45 s.

    The heat grows with the square of the rate. The thermometer, at the other end of the board, does not feel it.
    """
    tau = 45.0
    share = DT / tau
    gain = 0.0118  # deg/s per (10 deg/s)^2 of mean square rate over tau
    heat = 0.0

    def error(t, temp, ang, rate, w, f):
        nonlocal heat
        heat += share * ((float(w[2]) / 10.0) ** 2 - heat)
        return 0.0, -gain * heat, 0.0, 0.0, 0.0, 0.0

    return error


def loop_slews(seed):
    """The loops that hold gyros x and z at rest lag behind a change of rate, until their output stage is at its limit.

    The error goes against the angular acceleration about the same axis and saturates well within that of a swing. It
    is zero in a steady turn. The acceleration is taken over six samples, the width of the loop's filter.
    """
    limit_x, limit_z = 0.25, 0.44  # deg/s
    knee = 60.0  # deg/s^2
    past = []

    def error(t, temp, ang, rate, w, f):
        now = (float(w[0]), float(w[2]))
        past.append(now)
        if len(past) > 7:
            past.pop(0)
        span = DT * max(1, len(past) - 1)
        change_x = (now[0] - past[0][0]) / span
        change_z = (now[1] - past[0][1]) / span
        return -limit_x * math.tanh(change_x / knee), 0.0, -limit_z * math.tanh(change_z / knee), 0.0, 0.0, 0.0

    return error


# ---------------------------------------------------------------- inputs of other axes


def pendulum_knee(seed):
    """The mass of gyro x sags under a force along y, but only as far as its soft stop, a third of a g away.

    A g-sensitivity to the wrong axis that is nearly full at 0.5 g: between dwells at 30 and at 90 deg there is little
    to choose.
    """
    gain, knee = 0.065, 0.3  # deg/s, g

    def error(t, temp, ang, rate, w, f):
        return gain * math.tanh(float(f[1]) / knee), 0.0, 0.0, 0.0, 0.0, 0.0

    return error


def hot_crosstalk(seed):
    """Gyro x takes in the rate about y, the more the further the board is from 25 degC, where it was trimmed."""
    gain, trimmed_at = 3.5e-4, 25.0  # per K, degC

    def error(t, temp, ang, rate, w, f):
        return gain * (temp - trimmed_at) * float(w[1]), 0.0, 0.0, 0.0, 0.0, 0.0

    return error


# ---------------------------------------------------------------- angles of the table


def oval_bearing(seed):
    """The bearing of the inner axis is out of round, with two high places, so that the table nods twice in a turn.

    A nod of twice the angle in the room is one of once the angle in the instrument, which turns with the table; at
    the same time y has a part at three times the angle. 0.7 mg is 0.04 deg.
    """
    nod, third = 0.73 * MG, 0.24 * MG
    phase = math.radians(65.0)

    def error(t, temp, ang, rate, w, f):
        a = math.radians(float(ang[2]))
        return (
            0.0,
            0.0,
            0.0,
            nod * math.cos(a + phase),
            -0.6 * nod * math.sin(a + phase) + third * math.sin(3.0 * a),
            0.0,
        )

    return error


def worn_slip_ring(seed):
    """A worn place of the slip ring, around 50 deg of the inner axis, has a film whose resistance rises as it warms.

    There the supply of the instrument drops: gyro y and accelerometer x move together. Below 20 degC the film
    conducts well and nothing is lost; elsewhere on the ring neither.
    """
    centre, width = math.radians(50.0), 4.0  # rad, sharpness
    gain_y, gain_x = 0.225, 2.1 * MG  # at 30 degC, in the middle of the place

    def error(t, temp, ang, rate, w, f):
        place = math.exp(width * (math.cos(math.radians(float(ang[2])) - centre) - 1.0))
        loss = place * max(0.0, temp - 20.0) / 10.0
        return 0.0, gain_y * loss, 0.0, gain_x * loss, 0.0, 0.0

    return error


# ---------------------------------------------------------------- causes that no recording holds


def converter_modes(seed):
    """The converter that feeds the unit has two ways of switching, and changes with the load of the rest of the rig.

    The load is not recorded. The supply has two levels with a few millivolts between them; gyro z and accelerometer y
    show it at once. The moments are drawn: a mean of 26 s in either way, at least 3 s.
    """
    rng = np.random.default_rng(seed)
    step_z, step_y = 0.215, 1.9 * MG
    high = bool(rng.integers(2))
    until = 3.0 + float(rng.exponential(23.0))

    def error(t, temp, ang, rate, w, f):
        nonlocal high, until
        while t >= until:
            high = not high
            until += 3.0 + float(rng.exponential(23.0))
        return 0.0, 0.0, step_z if high else 0.0, 0.0, step_y if high else 0.0, 0.0

    return error


def loose_plug(seed):
    """A plug on the moving part is loose: each time the table starts from rest it settles in another place.

    The resistance that it then has is the hidden cause, drawn anew at each start and kept until the next; gyro y
    shows it. The recording tells when it may have changed, not by how much or which way.
    """
    rng = np.random.default_rng(seed)
    spread = 0.075  # deg/s, half the width of what is drawn
    level = float(rng.uniform(-spread, spread))
    rest = 0.0

    def error(t, temp, ang, rate, w, f):
        nonlocal level, rest
        if max(abs(float(r)) for r in rate) > 1.0:
            if rest > 1.0:
                level = float(rng.uniform(-spread, spread))
            rest = 0.0
        else:
            rest += DT
        return 0.0, level, 0.0, 0.0, 0.0, 0.0

    return error


# ---------------------------------------------------------------- the table

# Force along an axis follows from the table's angles, hence the angles under "same_as" where a force drives. A rate
# taken over a few samples is no memory: the change itself is the driver.

EFFECTS = {
    "resonator_dip": {
        "title": "A bump of bias where the drive mode of gyro y crosses a mode of its frame",
        "channels": ["gy"],
        "driver": ["temperature"],
        "same_as": [],
        "in_log": True,
        "memory": False,
        "noise": "measured",
        "d": 30,
        "motion": "still",
    },
    "glue_softens": {
        "title": "Glue under the accelerometers softens: a kink at 33 degC",
        "channels": ["ax", "ay"],
        "driver": ["temperature"],
        "same_as": [],
        "in_log": True,
        "memory": False,
        "noise": "simulated",
        "d": 40,
        "motion": "still",
    },
    "handover_step": {
        "title": "Correction in ranges that do not meet, handed over 2 K later on warming than on cooling",
        "channels": ["gx"],
        "driver": ["temperature", "temperature_history"],
        "same_as": [],
        "in_log": True,
        "memory": True,
        "noise": "measured",
        "d": 35,
        "motion": "still",
    },
    "lid_sticks": {
        "title": "Friction holds the lid back as it expands, until it slips",
        "channels": ["ay", "az"],
        "driver": ["temperature_history"],
        "same_as": [],
        "in_log": True,
        "memory": True,
        "noise": "simulated",
        "d": 40,
        "motion": "still",
    },
    "faint_draught": {
        "title": "A gradient across the board while it warms, too small to matter",
        "channels": ["gz"],
        "driver": ["temperature_rate"],
        "same_as": ["temperature_history"],
        "in_log": True,
        "memory": False,
        "noise": "simulated",
        "d": "too weak to see",
        "motion": "still",
    },
    "reference_settles": {
        "title": "The voltage reference settles after power-on, fast and then slowly",
        "channels": ["ax", "az"],
        "driver": ["time"],
        "same_as": [],
        "in_log": True,
        "memory": False,
        "noise": "measured",
        "d": 50,
        "motion": "still",
    },
    "rezero": {
        "title": "Every 61 s the unit takes a new temperature to correct to, and drifts with it until the next",
        "channels": ["gz"],
        "driver": ["time", "temperature", "temperature_history"],
        "same_as": [],
        "in_log": True,
        "memory": True,
        "noise": "simulated",
        "d": 40,
        "motion": "still",
    },
    "dielectric_soak": {
        "title": "Charge creeps into an oxide after each tilt",
        "channels": ["az"],
        "driver": ["force_z", "motion_history"],
        "same_as": ["angle_outer", "angle_middle"],
        "in_log": True,
        "memory": True,
        "noise": "measured",
        "d": 30,
        "motion": "table",
    },
    "spin_heats": {
        "title": "Turning about z heats a gyro's drive, which cools slowly",
        "channels": ["gy"],
        "driver": ["rate_z", "motion_history"],
        "same_as": [],
        "in_log": True,
        "memory": True,
        "noise": "simulated",
        "d": 35,
        "motion": "table",
    },
    "loop_slews": {
        "title": "A loop lags behind changes of rate, to a limit",
        "channels": ["gx", "gz"],
        "driver": ["rate_change"],
        "same_as": ["motion_history"],
        "in_log": True,
        "memory": False,
        "noise": "simulated",
        "d": 40,
        "motion": "table",
    },
    "pendulum_knee": {
        "title": "Gyro x feels the force along y, up to a soft stop",
        "channels": ["gx"],
        "driver": ["force_y"],
        "same_as": ["angle_outer", "angle_middle", "angle_inner"],
        "in_log": True,
        "memory": False,
        "noise": "measured",
        "d": 25,
        "motion": "table",
    },
    "hot_crosstalk": {
        "title": "Gyro x takes in the rate about y, more so away from 25 degC",
        "channels": ["gx"],
        "driver": ["temperature", "rate_y"],
        "same_as": [],
        "in_log": True,
        "memory": False,
        "noise": "measured",
        "d": 85,
        "motion": "table",
    },
    "oval_bearing": {
        "title": "The inner bearing is out of round and the table nods as it turns",
        "channels": ["ax", "ay"],
        "driver": ["angle_inner"],
        "same_as": [],
        "in_log": True,
        "memory": False,
        "noise": "measured",
        "d": 18,
        "motion": "table",
    },
    "worn_slip_ring": {
        "title": "A worn place of the slip ring drops the supply, more so when warm",
        "channels": ["gy", "ax"],
        "driver": ["angle_inner", "temperature"],
        "same_as": [],
        "in_log": True,
        "memory": False,
        "noise": "simulated",
        "d": 30,
        "motion": "table",
    },
    "converter_modes": {
        "title": "The supply goes over between two levels with a load that nobody records",
        "channels": ["gz", "ay"],
        "driver": ["hidden"],
        "same_as": [],
        "in_log": False,
        "memory": False,
        "noise": "simulated",
        "d": 45,
        "motion": "still",
    },
    "loose_plug": {
        "title": "A loose plug settles anew each time the table starts to move",
        "channels": ["gy"],
        "driver": ["hidden", "motion_history"],
        "same_as": [],
        "in_log": False,
        "memory": True,
        "noise": "measured",
        "d": 35,
        "motion": "table",
    },
}

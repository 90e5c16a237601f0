"""The six readings of an instrument: their order, names and numbers, and the units in which people are told of them.

Needs the standard library only, so that texts and reports can name channels without loading an array library.
"""

import math

CHANNELS = ("gx", "gy", "gz", "ax", "ay", "az")  # names, in the order of all arrays of six in the instrument's axes

GYROS, ACCELS = (0, 1, 2), (3, 4, 5)  # numbers of the gyros and of the accelerometers

STANDARD_GRAVITY = 9.80665  # m/s² of one g, where a reading is in g

PAPER_PLACE = (-23.21132308, -45.85917610, 641.203)  # latitude, longitude, deg, and height, m, of the paper's table

DPS = math.pi / 180.0  # rad/s of one deg/s, and rad of one degree
G = STANDARD_GRAVITY  # m/s² of one g
MG = 1e-3 * STANDARD_GRAVITY  # m/s² of one mg


def error_unit(channel: int) -> tuple[str, float]:
    """Unit in which errors of a channel's number are told, deg/s or mg, and its SI value."""
    return ("deg/s", DPS) if channel in GYROS else ("mg", MG)

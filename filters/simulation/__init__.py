"""Readings of a unit with known truth; nothing from here is ever called measured.

The way of a reading, each step where it physically happens:

    1. `truth`     what there is to sense: the table's motion, Earth rate, gravity, at the place and time of the sensor
                   (delay, lever_arm, tilt, gravity, earth_rate, mounting)
    2. `additive`, `catalogue`   the sensor's own errors, added to that and to the bias (thermal_lin … gauss_markov)
    3. white noise of the specification's density (noise_level, noise_crosstalk); the band limit of it all (bandwidth)
    4. `output`    the electronics behind: saturation, coarse, stuck, spikes; then what the line loses: dropout, jitter

All of it is in the instrument's own axes and sign (`filters.imu.AxisMap`): an effect on ax is what ax shows. What the
filters take, `Samples`, is in body axes. Quantisation to counts is the instrument's, not done here.

`turn_table` is a table under command: what it does is not known ahead, so readings on it are made up to now.

A recording may stand in place of bias and noise (`background`): the errors are then added to what a sensor really read.

`catalogue.EFFECTS` lists the effects; their names are those of the tracer, whose regressors are not used here: what
the simulator applies and what the tracer believes are two things.
"""

from filters.imu import LOOP_HZ
from filters.simulation.catalogue import EFFECTS, Effect
from filters.simulation.scenario import (
    FAULT_KINDS,
    TABLE_FAULT_KINDS,
    Fault,
    Personality,
    PowerOn,
    Scenario,
    TableFault,
    Temperature,
    Truth,
    draw,
)
from filters.simulation.turn_table import OnTable, TableModel, TurnTable
from filters.simulation.unit import Recording, StillUnit, Unit, simulate

__all__ = [
    "EFFECTS",
    "FAULT_KINDS",
    "LOOP_HZ",
    "TABLE_FAULT_KINDS",
    "Effect",
    "Fault",
    "OnTable",
    "Personality",
    "PowerOn",
    "Recording",
    "Scenario",
    "StillUnit",
    "TableFault",
    "TableModel",
    "Temperature",
    "Truth",
    "TurnTable",
    "Unit",
    "draw",
    "simulate",
]

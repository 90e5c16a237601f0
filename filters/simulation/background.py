"""A recording in place of made biases and noise: a scenario's errors are then added to what a sensor really read.

The recording gives readings, temperature if it has one, and what there was to sense: its own motion where that is
known, else rest. What it leaves out: files (`imutui.cli.played_recording`), what is added (`filters.simulation.unit`).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from filters import attitude, earth
from filters.errors import InputError
from filters.imu import AxisMap
from filters.motion.kinematics import angles_of, attitudes, body_rate
from filters.state import Site
from filters.types import Array

# attitudes are differenced over this time: an optical reference has about 0.1 deg of noise, and motion is slower
_RATE_SPAN_S = 0.1
# temperatures come in counts of some hundredths of a kelvin: their rate is taken over more time than a count lasts
_KELVIN_SPAN_S = 30.0
_SAME_FORCE = 0.2  # g: a recording that differs more from what a unit at rest reads has another sign or attitude


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """Motion known at instants, straight lines between them; one row is rest."""

    t: Array  # s, increasing, shape (M,)
    sensed: Array  # as `World.perfect`, shape (M, 6)
    # table_angles, table_rates: as `World.angles` and `World.rates`, unwrapped, shape (M, 3)
    table_angles: Array
    table_rates: Array

    def perfect(self, t: Array) -> Array:
        """As `World`."""
        return self._between(t, self.sensed)

    def angles(self, t: Array) -> Array:
        """As `World`."""
        return self._between(t, self.table_angles)

    def rates(self, t: Array) -> Array:
        """As `World`."""
        return self._between(t, self.table_rates)

    @property
    def moves(self) -> bool:
        """Whether it is more than rest."""
        return self.t.size > 1

    def _between(self, t: Array, columns: Array) -> Array:
        return np.stack([np.interp(t, self.t, column) for column in columns.T], axis=1)


def at_rest(accel: Array, site: Site) -> RecordedMotion:
    """Rest in an attitude that nobody knows: gravity has the direction of the mean reading, the site's magnitude.

    `accel`: readings, m/s², instrument axes and sign, shape (N, 3).
    `site`: where; Earth rate, whose direction is not known, is left out.
    """
    mean = accel.mean(axis=0)
    norm = float(np.linalg.norm(mean))
    force = mean * (site.gravity / norm) if norm > 0.0 else mean
    row = np.concatenate([np.zeros(3), force])[None]
    return RecordedMotion(np.zeros(1), row, np.zeros((1, 3)), np.zeros((1, 3)))


def from_angles(t: Array, angles: Array, rates: Array, axes: AxisMap, site: Site) -> RecordedMotion:
    """Motion of a table whose angles and rates are known (rad, rad/s, shape (M, 3)) at times, shape (M,)."""
    C_bn = np.swapaxes(attitudes(angles), 1, 2)
    turning = body_rate(angles, rates) + C_bn @ earth.earth_rate_n(np.array(site.latitude))
    force = C_bn @ np.array([0.0, 0.0, -site.gravity])
    sensed = np.hstack([axes.gyro_to_instrument(turning), axes.accel_to_instrument(force)])
    return RecordedMotion(t, sensed, np.unwrap(angles, axis=0), rates)


def from_attitudes(t: Array, C_nb: Array, axes: AxisMap, site: Site) -> RecordedMotion:
    """Motion of a unit whose attitude is known at times, shape (M,) and (M, 3, 3), in body axes; no row is NaN."""
    step = max(round(0.5 * _RATE_SPAN_S * (t.size - 1) / max(float(t[-1] - t[0]), 1e-9)), 1)
    rows = np.arange(t.size)
    behind, ahead = np.maximum(rows - step, 0), np.minimum(rows + step, t.size - 1)
    turned = np.swapaxes(C_nb[behind], 1, 2) @ C_nb[ahead]
    # one row alone has turned by nothing
    seconds = np.maximum(t[ahead] - t[behind], 1e-9)
    C_bn = np.swapaxes(C_nb, 1, 2)
    turning = attitude.log(turned) / seconds[:, None] + C_bn @ earth.earth_rate_n(np.array(site.latitude))
    force = C_bn @ np.array([0.0, 0.0, -site.gravity])
    angles = np.unwrap(angles_of(C_nb), axis=0)
    rates = (angles[ahead] - angles[behind]) / seconds[:, None]
    sensed = np.hstack([axes.gyro_to_instrument(turning), axes.accel_to_instrument(force)])
    return RecordedMotion(t, sensed, angles, rates)


@dataclass(frozen=True, slots=True)
class RecordedTemperature:
    """Temperature of a recording, straight lines between its samples."""

    t: Array  # s, increasing, shape (N,)
    degc: Array  # shape (N,)

    def at(self, t: Array) -> Array:
        """Temperature, degC, shape (N,)."""
        return np.asarray(np.interp(t, self.t, self.degc))

    def rate(self, t: Array) -> Array:
        """Its time derivative over some seconds, K/s, shape (N,)."""
        return (self.at(t + 0.5 * _KELVIN_SPAN_S) - self.at(t - 0.5 * _KELVIN_SPAN_S)) / _KELVIN_SPAN_S


@dataclass(frozen=True, slots=True)
class Background:
    """A recording that is played."""

    # readings at times since power-on, shape (N,): rad/s and m/s², instrument axes and sign, shape (N, 6); NaN after
    # its end
    readings: Callable[[Array], Array]
    motion: RecordedMotion  # what there was to sense
    temperature: RecordedTemperature | None = None  # none if it has none

    def check_rest(self, perfect: Array, gravity: float) -> None:
        """Refuse to move a recording that is not of a unit at rest as the scenario has it.

        `perfect`: what a perfect unit at rest on the level table reads, shape (6,).
        `gravity`: m/s².
        Raises InputError if it moves, or its gravity points elsewhere.
        """
        if self.motion.moves:
            raise InputError(
                "the recording has a motion of its own, and the scenario adds one: leave out its profile and the"
                " effects of motion (delay, lever_arm, tilt, gravity, earth_rate, mounting)"
            )
        force = self.motion.sensed[0, 3:]
        if np.abs(force - perfect[3:]).max() > _SAME_FORCE * gravity:
            raise InputError(
                f"the recording reads gravity as {_in_g(force, gravity)}, and the scenario's unit on its level table as"
                f" {_in_g(perfect[3:], gravity)}: its motion can't be added to that. Name the recording's sign and"
                ' mounting in the scenario\'s [instrument], such as accel_sign = 1, mount = "x,-y,-z"'
            )


def _in_g(force: Array, gravity: float) -> str:
    return "(" + ", ".join(f"{value / gravity:+.2f}" for value in force.tolist()) + ") g"

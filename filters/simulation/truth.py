"""What there is to sense: motion of the table, Earth rate and gravity, where and when the sensors are.

`World` holds what is not as the tracer's reference believes; each effect here changes it. In instrument axes: lever arm
and mounting rotation; about north and east: the tilt of the base.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Protocol

import numpy as np

from filters import attitude, earth
from filters.channels import DPS
from filters.imu import AxisMap
from filters.simulation.parameters import ACCEL_CHANNELS, GYRO_CHANNELS, EffectKind, ScenarioParameter
from filters.state import Site
from filters.types import Array

# of the difference quotient that angular acceleration is: rounding and the ramps' corners both stay far below noise
_STEP_S = 1e-4


class Motion(Protocol):
    """What a table does: a `Profile`, or what a table under command has done."""

    def angles(self, t: Array) -> Array:
        """Rotations about north, east and down, rad, shape (N, 3)."""
        ...

    def rates(self, t: Array) -> Array:
        """Their derivatives, rad/s, shape (N, 3)."""
        ...

    def pose(self, t: Array) -> tuple[Array, Array]:
        """Attitude C_nb, shape (N, 3, 3), and angular rate in body axes, rad/s, shape (N, 3)."""
        ...


@dataclass(frozen=True, slots=True)
class World:
    """Motion and its errors."""

    profile: Motion | None  # of the table; level and still without
    site: Site  # where it stands
    axes: AxisMap  # how the instrument sits on it
    delays: Array = field(default_factory=lambda: np.zeros(6))  # of each channel, s, shape (6,)
    # from the centre of rotation to the accelerometers, instrument axes, m, shape (3,)
    lever: Array = field(default_factory=lambda: np.zeros(3))
    # takes what is at the instrument's axes to what its sensors' axes see, shape (3, 3)
    rotation: Array = field(default_factory=lambda: np.eye(3))
    # rotation of the base about north, east, down, rad, shape (3,)
    tilt: Array = field(default_factory=lambda: np.zeros(3))
    # gravity_ratio, earth_ratio: gravity over the site's; Earth rate over the true one, for each gyro, shape (3,)
    gravity_ratio: float = 1.0
    earth_ratio: Array = field(default_factory=lambda: np.ones(3))

    def angles(self, t: Array) -> Array:
        """Rotations of the table about north, east, down, rad, shape (N, 3)."""
        return np.zeros((t.size, 3)) if self.profile is None else self.profile.angles(t)

    def rates(self, t: Array) -> Array:
        """Their derivatives, rad/s, shape (N, 3)."""
        return np.zeros((t.size, 3)) if self.profile is None else self.profile.rates(t)

    def perfect(self, t: Array) -> Array:
        """What an instrument without errors of its own reads, its axes and sign, SI, shape (N, 6)."""
        out = np.empty((t.size, 6))
        for delay in np.unique(self.delays):
            columns = self.delays == delay
            out[:, columns] = self._undelayed(t - delay)[:, columns]
        return out

    def _undelayed(self, t: Array) -> Array:
        tilt = attitude.exp(self.tilt)
        earth_n = tilt @ earth.earth_rate_n(np.array(self.site.latitude))
        force_n = tilt @ np.array([0.0, 0.0, -self.site.gravity * self.gravity_ratio])
        if self.profile is None:
            turning, spin, force = np.zeros((1, 3)), earth_n[None], force_n[None]
        else:
            C_nb, turning = self.profile.pose(t)
            spin, force = np.einsum("nij,i->nj", C_nb, earth_n), np.einsum("nij,i->nj", C_nb, force_n)
            force = force + self._centripetal(t, turning)
        gyro = self.axes.gyro_to_instrument(turning) + self.earth_ratio * self.axes.gyro_to_instrument(spin)
        both = np.hstack([gyro @ self.rotation.T, self.axes.accel_to_instrument(force) @ self.rotation.T])
        return np.broadcast_to(both, (t.size, 6))

    def _centripetal(self, t: Array, turning: Array) -> Array:
        """ω × (ω × r) + ω' × r, body axes, m/s²."""
        assert self.profile is not None
        if not self.lever.any():
            return np.zeros((1, 3))
        ahead, behind = (self.profile.pose(t + h)[1] for h in (0.5 * _STEP_S, -0.5 * _STEP_S))
        r = self.axes.mount @ self.lever
        return np.cross(turning, np.cross(turning, r)) + np.cross((ahead - behind) / _STEP_S, r)


class MotionEffect(EffectKind):
    """Something about the motion that is not as believed."""

    everywhere: ClassVar = True

    @abstractmethod
    def changed(self, world: World) -> World:
        """The world as the sensor meets it when the effect is there."""

    def three(self, keys: Sequence[str]) -> Array:
        """Values of parameters, one an axis; those that there are none of are zero."""
        return np.array([self.number(key) if key else 0.0 for key in keys])


class Delay(MotionEffect):
    """Senses what was `tau_s` ago; e = -τ x' to first order. On all channels unless named."""

    selectable: ClassVar = True
    parameters: ClassVar = (ScenarioParameter("tau", "tau_s", least=0.0),)

    def changed(self, world: World) -> World:
        delays = world.delays.copy()
        delays[self.named] += self.number("tau")
        return replace(world, delays=delays)


class LeverArm(MotionEffect):
    """Accelerometers away from the centre of rotation: e = ω × (ω × r) + ω' × r; `x_m`, `y_m`, `z_m` (0 each)."""

    channels: ClassVar = ACCEL_CHANNELS
    parameters: ClassVar = tuple(ScenarioParameter(axis, f"{axis}_m", 0.0) for axis in "xyz")

    def changed(self, world: World) -> World:
        return replace(world, lever=world.lever + self.three("xyz"))


class Tilt(MotionEffect):
    """Base turned by δ: specific force in n is exp(δ) (0, 0, -γ), Earth rate likewise; `north_deg`, `east_deg` (0)."""

    channels: ClassVar = ACCEL_CHANNELS
    parameters: ClassVar = tuple(ScenarioParameter(axis, f"{axis}_deg", 0.0, factor=DPS) for axis in ("north", "east"))

    def changed(self, world: World) -> World:
        return replace(world, tilt=world.tilt + self.three(("north", "east", "")))


class Gravity(MotionEffect):
    """Gravity that is not the site's: e = k C (0, 0, -γ); `relative`."""

    channels: ClassVar = ACCEL_CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "relative"),)

    def changed(self, world: World) -> World:
        return replace(world, gravity_ratio=world.gravity_ratio + self.number("k"))


class EarthRate(MotionEffect):
    """e = k C ω_ie on top of the true one: -1, the default, is a unit that does not sense it; `coefficient`."""

    channels: ClassVar = GYRO_CHANNELS
    selectable: ClassVar = True
    parameters: ClassVar = (ScenarioParameter("k", "coefficient", -1.0),)

    def changed(self, world: World) -> World:
        ratio = world.earth_ratio.copy()
        ratio[self.named] += self.number("k")
        return replace(world, earth_ratio=ratio)


class Mounting(MotionEffect):
    """Sensors turned in their case by d, gyros and accelerometers alike: v becomes exp(d)ᵀ v, e = v × d to first order.

    `x_rad`, `y_rad`, `z_rad` (0 each), instrument axes.
    """

    parameters: ClassVar = tuple(ScenarioParameter(axis, f"{axis}_rad", 0.0) for axis in "xyz")

    def changed(self, world: World) -> World:
        return replace(world, rotation=attitude.exp(self.three("xyz")).T @ world.rotation)

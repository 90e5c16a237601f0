"""What there is to sense: motion of the table, Earth rate and gravity, where and when the sensors are.

`World` holds what is not as the tracer's reference believes; each effect here changes it. In instrument axes: lever arm
and mounting rotation; about north and east: the tilt of the base.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from filters import attitude, earth
from filters.channels import CHANNELS, DPS
from filters.imu import AxisMap
from filters.motion.kinematics import attitudes, body_rate
from filters.motion.profile import Profile
from filters.simulation.parameters import ACCEL_CHANNELS, GYRO_CHANNELS, ScenarioParameter, Setup
from filters.state import Site
from filters.types import Array

# of the difference quotient that angular acceleration is: rounding and the ramps' corners both stay far below noise
_STEP_S = 1e-4


@dataclass(frozen=True, slots=True)
class World:
    """Motion and its errors."""

    profile: Profile | None  # of the table; level and still without
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
            angles, rates = self.profile.angles(t), self.profile.rates(t)
            C_nb = attitudes(angles)
            turning = body_rate(angles, rates)
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
        ahead, behind = (
            body_rate(self.profile.angles(t + h), self.profile.rates(t + h)) for h in (0.5 * _STEP_S, -0.5 * _STEP_S)
        )
        r = self.axes.mount @ self.lever
        return np.cross(turning, np.cross(turning, r)) + np.cross((ahead - behind) / _STEP_S, r)


@runtime_checkable
class MotionEffect(Protocol):
    """Something about the motion that is not as believed."""

    def changed(self, world: World) -> World:
        """The world as the sensor meets it when the effect is there."""
        ...


class Delay:
    """Senses what was `tau_s` ago; e = -τ x' to first order. On all channels unless named."""

    channels: ClassVar = CHANNELS
    everywhere: ClassVar = True
    selectable: ClassVar = True
    parameters: ClassVar = (ScenarioParameter("tau", "tau_s", least=0.0),)

    def __init__(self, setup: Setup) -> None:
        self._tau, self._channels = setup.number("tau"), list(setup.channels)

    def changed(self, world: World) -> World:
        """World with channels that lag."""
        delays = world.delays.copy()
        delays[self._channels] += self._tau
        return replace(world, delays=delays)


class LeverArm:
    """Accelerometers away from the centre of rotation: e = ω × (ω × r) + ω' × r; `x_m`, `y_m`, `z_m` (0 each)."""

    channels: ClassVar = ACCEL_CHANNELS
    everywhere: ClassVar = True
    parameters: ClassVar = tuple(ScenarioParameter(axis, f"{axis}_m", 0.0) for axis in "xyz")

    def __init__(self, setup: Setup) -> None:
        self._lever = np.array([setup.number(axis) for axis in "xyz"])

    def changed(self, world: World) -> World:
        """World with accelerometers farther out."""
        return replace(world, lever=world.lever + self._lever)


class Tilt:
    """Base turned by δ: specific force in n is exp(δ) (0, 0, -γ), Earth rate likewise; `north_deg`, `east_deg` (0)."""

    channels: ClassVar = ACCEL_CHANNELS
    everywhere: ClassVar = True
    parameters: ClassVar = tuple(ScenarioParameter(axis, f"{axis}_deg", 0.0, factor=DPS) for axis in ("north", "east"))

    def __init__(self, setup: Setup) -> None:
        self._tilt = np.array([setup.number("north"), setup.number("east"), 0.0])

    def changed(self, world: World) -> World:
        """World on a base that is not level."""
        return replace(world, tilt=world.tilt + self._tilt)


class Gravity:
    """Gravity that is not the site's: e = k C (0, 0, -γ); `relative`."""

    channels: ClassVar = ACCEL_CHANNELS
    everywhere: ClassVar = True
    parameters: ClassVar = (ScenarioParameter("k", "relative"),)

    def __init__(self, setup: Setup) -> None:
        self._k = setup.number("k")

    def changed(self, world: World) -> World:
        """World that pulls harder."""
        return replace(world, gravity_ratio=world.gravity_ratio + self._k)


class EarthRate:
    """e = k C ω_ie on top of the true one: -1, the default, is a unit that does not sense it; `coefficient`."""

    channels: ClassVar = GYRO_CHANNELS
    everywhere: ClassVar = True
    selectable: ClassVar = True
    parameters: ClassVar = (ScenarioParameter("k", "coefficient", -1.0),)

    def __init__(self, setup: Setup) -> None:
        self._k, self._channels = setup.number("k"), list(setup.channels)

    def changed(self, world: World) -> World:
        """World that turns faster or slower."""
        ratio = world.earth_ratio.copy()
        ratio[self._channels] += self._k
        return replace(world, earth_ratio=ratio)


class Mounting:
    """Sensors turned in their case by d, gyros and accelerometers alike: v becomes exp(d)ᵀ v, e = v × d to first order.

    `x_rad`, `y_rad`, `z_rad` (0 each), instrument axes.
    """

    channels: ClassVar = CHANNELS
    everywhere: ClassVar = True
    parameters: ClassVar = tuple(ScenarioParameter(axis, f"{axis}_rad", 0.0) for axis in "xyz")

    def __init__(self, setup: Setup) -> None:
        self._rotation = attitude.exp(np.array([setup.number(axis) for axis in "xyz"])).T

    def changed(self, world: World) -> World:
        """World seen from turned axes."""
        return replace(world, rotation=self._rotation @ world.rotation)

"""The 15 error states as named slices, and the navigation state they are errors of (equations (1)-(5))."""

from dataclasses import dataclass

import numpy as np

from filters import attitude, earth
from filters.channels import PAPER_PLACE as PAPER_PLACE
from filters.errors import InputError
from filters.types import Array

POSITION = slice(0, 3)
VELOCITY = slice(3, 6)
ATTITUDE = slice(6, 9)
ACCEL_BIAS = slice(9, 12)
GYRO_BIAS = slice(12, 15)
NAVIGATION = slice(0, 9)
SIZE = 15


@dataclass(frozen=True, slots=True)
class Site:
    """Where the table stands; by default the paper's (section 2), in Brazil."""

    # latitude, longitude: geodetic, rad
    latitude: float
    longitude: float
    height: float  # above the ellipsoid, m
    gravity: float  # local gravity, m/s²

    def __post_init__(self) -> None:
        if not np.isfinite([self.latitude, self.longitude, self.height]).all():
            raise InputError(
                f"`height` {self.height}, `latitude` {self.latitude} or `longitude` {self.longitude} is not finite"
            )
        if not 0.0 < self.gravity < np.inf:
            raise InputError(f"`gravity` is {self.gravity} m/s², not a positive number")

    @classmethod
    def at(cls, latitude_deg: float, longitude_deg: float, height: float, gravity: float | None = None) -> "Site":
        """Site from degrees and metres; gravity in m/s² is WGS-84 normal gravity unless given."""
        latitude = np.deg2rad(latitude_deg)
        if gravity is None:
            gravity = float(earth.normal_gravity(np.array(latitude), np.array(height)))
        return cls(float(latitude), float(np.deg2rad(longitude_deg)), height, gravity)


Place = tuple[float, float, float]
"""Latitude and longitude in degrees, height above the ellipsoid in metres."""
PAPER_SITE = Site.at(*PAPER_PLACE)


@dataclass(frozen=True, slots=True)
class NavState:
    """Navigation state and biases of one unit, or of many at once along leading axes."""

    # latitude, longitude, height: rad, rad, m; shape (...)
    latitude: Array
    longitude: Array
    height: Array
    velocity_n: Array  # m/s, shape (..., 3)
    C_nb: Array  # attitude, shape (..., 3, 3)
    # accel_bias, gyro_bias: body axes, m/s² and rad/s, shape (..., 3)
    accel_bias: Array
    gyro_bias: Array

    @classmethod
    def of(
        cls,
        position: Array,
        velocity_n: Array,
        C_nb: Array,
        accel_bias: Array | tuple[float, ...] = (0.0, 0.0, 0.0),
        gyro_bias: Array | tuple[float, ...] = (0.0, 0.0, 0.0),
    ) -> "NavState":
        """State from copies of what is given; `position` is latitude, longitude and height, shape (..., 3)."""
        latitude, longitude, height = (np.array(part) for part in position.T)
        biases = np.array(accel_bias), np.array(gyro_bias)
        return cls(latitude, longitude, height, np.array(velocity_n), np.array(C_nb), *biases)

    @classmethod
    def at_rest(cls, site: Site, C_nb: Array) -> "NavState":
        """Still at `site` with attitude `C_nb` (3, 3) and no biases."""
        return cls.of(np.array([site.latitude, site.longitude, site.height]), np.zeros(3), C_nb)

    def at(self, index: int) -> "NavState":
        """One of many along the first axis."""
        return NavState(
            self.latitude[index],
            self.longitude[index],
            self.height[index],
            self.velocity_n[index],
            self.C_nb[index],
            self.accel_bias[index],
            self.gyro_bias[index],
        )

    def plus(self, error: Array) -> "NavState":
        """State with errors added: position in metres, attitude by C_nb ← exp(ε) C_nb, the rest by sums.

        `error`: shape (..., 15), broadcast against this state.
        Returns with the leading shape of `error`.
        """
        north, east, down = error[..., 0], error[..., 1], error[..., 2]
        R_n, R_e = earth.curvature(self.latitude, self.height)
        return NavState(
            self.latitude + north / R_n,
            self.longitude + east / (R_e * np.cos(self.latitude)),
            self.height - down,
            self.velocity_n + error[..., VELOCITY],
            attitude.exp(error[..., ATTITUDE]) @ self.C_nb,
            self.accel_bias + error[..., ACCEL_BIAS],
            self.gyro_bias + error[..., GYRO_BIAS],
        )

    def minus(self, other: "NavState") -> Array:
        """Errors that turn `other` into this state: ``other.plus(self.minus(other))`` is this state to first order.

        `other`: one state, without leading axes.
        Returns shape (..., 15).
        """
        R_n, R_e = earth.curvature(other.latitude, other.height)
        d_longitude = np.remainder(self.longitude - other.longitude + np.pi, 2.0 * np.pi) - np.pi
        out = np.empty((*np.shape(self.latitude), SIZE))
        out[..., 0] = (self.latitude - other.latitude) * R_n
        out[..., 1] = d_longitude * R_e * np.cos(other.latitude)
        out[..., 2] = other.height - self.height
        out[..., VELOCITY] = self.velocity_n - other.velocity_n
        out[..., ATTITUDE] = attitude.log(self.C_nb @ other.C_nb.T)
        out[..., ACCEL_BIAS] = self.accel_bias - other.accel_bias
        out[..., GYRO_BIAS] = self.gyro_bias - other.gyro_bias
        return out

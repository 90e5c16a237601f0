"""The Earth: WGS-84 radii, normal gravity, rotation. Leaves out geoid and deflection of the vertical."""

import numpy as np

from filters.channels import STANDARD_GRAVITY
from filters.types import Array

# NIMA TR8350.2 (WGS-84), tables 3.1, 3.3 and 3.4
SEMI_MAJOR_AXIS = 6378137.0
FLATTENING = 1.0 / 298.257223563
SEMI_MINOR_AXIS = SEMI_MAJOR_AXIS * (1.0 - FLATTENING)
ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)
EARTH_RATE = 7.292115e-5
GRAVITATIONAL_CONSTANT = 3.986004418e14
EQUATORIAL_GRAVITY = 9.7803253359
SOMIGLIANA = 0.00193185265241
GRAVITY_SPREAD = 2.6e-3 * STANDARD_GRAVITY
"""Standard deviation of normal gravity over the places where people live, m/s²: what is unknown without a site."""
_M_RATIO = EARTH_RATE**2 * SEMI_MAJOR_AXIS**2 * SEMI_MINOR_AXIS / GRAVITATIONAL_CONSTANT


def radii(sine: Array) -> tuple[Array, Array]:
    """Radii of curvature in the meridian and in the prime vertical, m; R_n and R_e of equation (1) without height.

    `sine` is that of the geodetic latitude, of any shape. Numba compiles this for the filter's step.
    """
    w2 = 1.0 - ECCENTRICITY_SQUARED * sine * sine
    w = np.sqrt(w2)
    return SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / (w2 * w), SEMI_MAJOR_AXIS / w


def curvature(latitude: Array, height: Array) -> tuple[Array, Array]:
    """R_n and R_e of equation (1), m, with height: `radii` at a geodetic latitude, rad, and a height, m, any shape."""
    R_n, R_e = radii(np.sin(latitude))
    return R_n + height, R_e + height


def normal_gravity(latitude: Array, height: Array) -> Array:
    """WGS-84 normal gravity, m/s²: Somigliana's formula with the second-order height term (NIMA TR8350.2, 4-1, 4-3)."""
    s = np.sin(latitude)
    s2 = s * s
    surface = EQUATORIAL_GRAVITY * (1.0 + SOMIGLIANA * s2) / np.sqrt(1.0 - ECCENTRICITY_SQUARED * s2)
    linear = 2.0 / SEMI_MAJOR_AXIS * (1.0 + FLATTENING + _M_RATIO - 2.0 * FLATTENING * s2) * height
    return surface * (1.0 - linear + 3.0 * height * height / (SEMI_MAJOR_AXIS * SEMI_MAJOR_AXIS))


def earth_rate_n(latitude: Array) -> Array:
    """Rotation of the Earth in navigation axes, Ω_e (cos φ, 0, -sin φ), of equation (3), rad/s, shape (..., 3)."""
    zero = np.zeros_like(latitude)
    return EARTH_RATE * np.stack([np.cos(latitude), zero, -np.sin(latitude)], axis=-1)

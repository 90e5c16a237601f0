"""What is known of the motion: still and level, or still with gravity as the only witness of attitude."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters import attitude, earth, state
from filters.state import NavState, Site
from filters.types import Array

_DEG = np.pi / 180.0

PAPER_R_SD = np.array([10.0, 10.0, 30.0, 0.1, 0.1, 0.1, 0.1 * _DEG, 0.1 * _DEG, 0.5 * _DEG])
"""Standard deviations of the nine pseudo-measurements (section 4): m, m/s, rad; attitude about north, east, down."""

ALIGN_SECONDS = 10.0
ALIGN_SAMPLES = 10
_VERTICAL = 0.7


@dataclass(frozen=True, slots=True)
class Reference:
    """Known position, velocity and attitude of a unit at rest.

    Attributes
    ----------
    kind : str
        "level" or "gravity".
    nav : NavState
        The known navigation state; its biases are zero and mean nothing.
    rows : integer array
        Indices of the error states that are known, of 0..8, shape (m,).
    R_sd : Array
        Standard deviations of those rows, shape (m,).
    P0_sd : Array
        Standard deviations of the nine navigation states at the start, shape (9,).
    observable : tuple of bool
        For each body axis, whether its accelerometer bias can be told from attitude.
    gravity : float
        Local gravity, m/s².
    """

    kind: str
    nav: NavState
    rows: NDArray[np.int_]
    R_sd: Array
    P0_sd: Array
    observable: tuple[bool, bool, bool]
    gravity: float

    def rates_and_forces(self) -> tuple[Array, Array]:
        """Angular rate (rad/s) and specific force (m/s²) in body axes that a perfect unit measures here; each (3,)."""
        rate_n = earth.earth_rate_n(self.nav.latitude)
        return self.nav.C_nb.T @ rate_n, self.nav.C_nb.T @ np.array([0.0, 0.0, -self.gravity])


def level(site: Site) -> Reference:
    """The paper's case: body axes on north, east, down; all nine rows known (section 4).

    Parameters
    ----------
    site : Site
        Where the table stands.

    Returns
    -------
    Reference
    """
    return Reference(
        "level",
        NavState.at_rest(site, np.eye(3)),
        np.arange(9),
        PAPER_R_SD,
        PAPER_R_SD,
        (True, True, True),
        site.gravity,
    )


def gravity(site: Site, mean_force_b: Array, accel_bias_sd: float) -> Reference:
    """Still at unknown attitude: roll and pitch from the mean specific force, heading called zero.

    Roll and pitch start there and are no measurement: they came from the very accelerometers whose bias is asked
    for, so tilt starts as uncertain as that bias makes it. The yaw row is kept with reference 0; without it the
    vertical gyro bias would not be seen. It is read to Earth rate's 0.004 deg/s, because true heading is unknown.

    Parameters
    ----------
    site : Site
        Where the unit stands.
    mean_force_b : Array
        Mean specific force, body axes, m/s², shape (3,).
    accel_bias_sd : float
        Standard deviation of the accelerometer bias at the start, m/s².

    Returns
    -------
    Reference
        Rows position, velocity and yaw.

    Raises
    ------
    ValueError
        If the mean force is not within 10 % of gravity: then the unit does not stand still, or units are wrong.
    """
    norm = float(np.linalg.norm(mean_force_b))
    if not 0.9 < norm / site.gravity < 1.1:
        raise ValueError(
            f"`mean_force_b` has magnitude {norm:.3f} m/s², not gravity's {site.gravity:.3f}:"
            " not at rest, or wrong units"
        )
    roll = np.arctan2(-mean_force_b[1], -mean_force_b[2])
    pitch = np.arctan2(mean_force_b[0], np.hypot(mean_force_b[1], mean_force_b[2]))
    C_nb = attitude.from_rpy(float(roll), float(pitch), 0.0)
    P0_sd = PAPER_R_SD.copy()
    P0_sd[6:8] = accel_bias_sd / site.gravity
    rows = np.array([0, 1, 2, 3, 4, 5, 8])
    x, y, z = np.abs(C_nb[2]) > _VERTICAL
    return Reference(
        "gravity",
        NavState.at_rest(site, C_nb),
        rows,
        PAPER_R_SD[rows],
        P0_sd,
        (bool(x), bool(y), bool(z)),
        site.gravity,
    )


KINDS = ("level", "gravity")
assert state.NAVIGATION.stop == PAPER_R_SD.size

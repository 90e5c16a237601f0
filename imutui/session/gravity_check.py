"""Whether gravity reads where it should, of a unit whose axes its own configuration may turn."""

import numpy as np
import numpy.typing as npt

from filters.imu import AxisMap

# cos 37 degrees: whoever is further off does not lie level at all
_ALONG = 0.8


def upside_down(accels_g: npt.NDArray[np.float64], axes: AxisMap) -> str | None:
    """What to say of a unit that should lie level and reads as if upside down; None of one that does not.

    Parameters
    ----------
    accels_g : np.ndarray
        What the accelerometers read at rest, g, instrument axes and sign, shape (3,).
    axes : AxisMap
        To body axes, of which Z points down.
    """
    z = float(axes.accel_to_body(accels_g)[2])
    if z < _ALONG:
        return None
    return (
        f"level, the body's Z should read -1 g of specific force, and it reads {z:+.2f} g: the unit lies upside down,"
        " or its own configuration turns its axes. Turn it, or name how it lies: --mount x,-y,-z"
    )

"""Whether gravity reads where it should, of a unit whose axes its own configuration may turn."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from filters.imu import AxisMap, format_mount, parse_mount
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from filters.motion.segments import Dwell
from imutui.instrument.instrument import Instrument
from imutui.logbook.session_info import SessionInfo

# cos 37 degrees: whoever is further off does not lie along that axis at all
_ALONG = 0.8
_TURNED_OVER = np.diag([1.0, -1.0, -1.0])


class GravityCheck:
    """Looks once, after the first second, whether gravity reads where it should.

    `instrument`: only of one that turns its own axes something is said: of others the filter's alarms say enough.
    """

    def __init__(self, instrument: Instrument) -> None:
        self._to_be_looked_at = instrument.turns_axes

    def news(
        self, accels_g: npt.NDArray[np.float64] | None, info: SessionInfo, motion: Profile | Trajectory | None
    ) -> list[str]:
        """What to say of readings on a table that begins level; None: there are none yet."""
        if accels_g is None or not self._to_be_looked_at or not _begins_level(info.reference, motion):
            return []
        self._to_be_looked_at = False
        said = unexpected_gravity(accels_g, info.axes(), info.own_mount)
        return [] if said is None else [said]


def _begins_level(reference: str, motion: Profile | Trajectory | None) -> bool:
    if not isinstance(motion, Profile):
        return reference == "level"
    first = motion.segments[0]
    # joined by marks it begins when the operator says so
    return motion.align == "none" and isinstance(first, Dwell) and first.angles[:2] == (0.0, 0.0)


def unexpected_gravity(accels_g: npt.NDArray[np.float64], axes: AxisMap, own_mount: str = "") -> str | None:
    """What to say of a unit that should lie level and reads as if it did not; None of one that reads as it should.

    Of one that lies on a side, and whose own configuration does not explain it, nothing is said: it may be a tilt that
    is meant.

    `accels_g`: what the accelerometers read at rest, g, instrument axes and sign, shape (3,).
    `axes`: to body axes, of which Z points down, as the operator says that the unit is mounted.
    `own_mount`: axes of its case in those of its packets, as its own configuration has them; "" if it does not say.
    """
    z = float(axes.accel_to_body(accels_g)[2])
    if z < -_ALONG:
        return None
    reads = f"level, the body's Z should read -1 g of specific force, and it reads {z:+.2f} g"
    as_configured = _turned_by_itself(accels_g, axes, own_mount)
    if z < _ALONG:
        if as_configured is None:
            return None
        return (
            f"{reads}: the unit's own configuration turns its axes so that they read like this when it is level. Name"
            f" how they lie: --mount {as_configured}"
        )
    turned_over = format_mount(_TURNED_OVER @ axes.mount)
    if as_configured is not None and as_configured != turned_over:
        return (
            f"{reads}: the unit lies upside down (--mount {turned_over}), or its own configuration turns its axes"
            f" (--mount {as_configured}). Turn it, or name which of them it is"
        )
    known = own_mount and as_configured is None
    why = "its own configuration does not explain it" if known else "or its own configuration turns its axes"
    return f"{reads}: the unit lies upside down, {why}. Turn it, or name how it lies: --mount {turned_over}"


def _turned_by_itself(accels_g: npt.NDArray[np.float64], axes: AxisMap, own_mount: str) -> str | None:
    """Mounting with what the unit's own configuration turns, if the unit reads level with it."""
    if not own_mount:
        return None
    with_its_own = replace(axes, mount=axes.mount @ parse_mount(own_mount))
    return format_mount(with_its_own.mount) if with_its_own.accel_to_body(accels_g)[2] < -_ALONG else None

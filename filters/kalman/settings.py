"""All that decides the estimates, apart from the samples, and the reference that it asks for."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from filters import state
from filters.errors import InputError
from filters.imu import IMU400CD_200, STANDARD_GRAVITY, ImuSpec, Noise
from filters.motion import alignment, reference
from filters.motion.profile import Profile
from filters.motion.reference import Reference, TableMotion, Trajectory
from filters.state import PAPER_SITE, Site

if TYPE_CHECKING:
    # what the effects are takes a filter; that there are some does not
    from filters.kalman.augmentation import MakeEffects

FILTERS = ("spkf", "spkf-paper", "ekf")  # filters by name; `filters.kalman.engines.ENGINES` makes them
MEASUREMENTS = ("exact", "drawn")  # how the reference is fed: as it is, or with noise of covariance R

P0_ACCEL_BIAS_SD = 18e-3 * STANDARD_GRAVITY  # m/s²; 1.5 times Table 1
P0_GYRO_BIAS_SD = 1.5 * np.pi / 180.0  # rad/s; 1.5 times Table 1

GAP_PERIODS = 2.5  # sample periods beyond which a step is a gap
MAX_TURN = 1.0  # rad between two samples that no filter can make up for


@dataclass(frozen=True, slots=True)
class Settings:
    """All that decides the estimates, apart from the samples."""

    period: float  # sample period the log was made for, s; a step above `GAP_PERIODS` times this is a gap
    filter: str = "spkf"  # a name of `FILTERS`
    reference: str = "level"  # "level", "gravity", "turned", "profile" or "trajectory"
    site: Site = PAPER_SITE  # position and gravity of the table
    measurements: str = "exact"  # "exact": the reference itself is fed. "drawn": with noise of covariance R.
    seed: int = 0  # of the drawn noise
    kappa: float = 0.0  # κ of equation (11)
    spec: ImuSpec = IMU400CD_200  # limits, and noise densities unless `noise` gives them
    noise: Noise | None = None  # process noise; None takes the specification's white noise and constant biases
    motion: Profile | Trajectory | None = None  # for the references "profile" and "trajectory"
    offset: float = 0.0  # time of the first sample's clock at which a profile starts, s
    offset_sd: float | None = None  # its standard deviation, s; None takes the profile's own
    # makes the effects that join the filter, anew for each run; "spkf" alone takes them
    effects: "MakeEffects | None" = None
    # of the six biases, accelerometer then gyro, body axes, those whose channels were not read: their readings are
    # those of the reference, which carry no information on the biases
    unread: tuple[bool, ...] = (False,) * 6

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("filter", self.filter, FILTERS),
            ("reference", self.reference, reference.KINDS),
            ("measurements", self.measurements, MEASUREMENTS),
        ):
            if value not in allowed:
                raise InputError(f'`{name}` is "{value}", not one of: {", ".join(allowed)}')
        if self.effects is not None and self.filter != "spkf":
            raise InputError(
                f'`filter` is "{self.filter}", but effects are to be included, which join the filter "spkf" only.'
                " Choose it, or leave the effects out"
            )
        if self.seed < 0:
            raise InputError(f"`seed` is {self.seed}, negative")
        if not self.period > 0.0:
            raise InputError(f"`period` is {self.period} s, not positive")
        if not state.SIZE + self.kappa > 0.0:
            raise InputError(f"`kappa` is {self.kappa}: 15 + kappa must be positive")

    def process_noise(self) -> Noise:
        """Process noise in force."""
        return self.noise if self.noise is not None else Noise.of(self.spec)


def alignment_of(settings: Settings) -> alignment.Alignment | None:
    """What finds the reference in the first samples, where it has to be found; raises InputError if it cannot be."""
    if settings.reference == "gravity":
        return alignment.Levelling(settings.site, P0_ACCEL_BIAS_SD)
    if settings.reference == "turned":
        return alignment.Levelling(settings.site, P0_ACCEL_BIAS_SD, is_any_rest=True)
    if settings.reference == "trajectory":
        if not isinstance(settings.motion, Trajectory):
            raise InputError('`motion` is missing: the reference "trajectory" needs one')
        if alignment.knows_attitude_only(settings.motion):
            return alignment.Starting(settings.motion, settings.site)
        return alignment.InMotion(settings.motion, settings.site, P0_ACCEL_BIAS_SD)
    return None


def reference_of(settings: Settings) -> Reference:
    """The reference that is known from the start; raises InputError if no motion is given, or the rate is too slow."""
    if settings.reference == "level":
        return reference.level(settings.site)
    profile = settings.motion
    if not isinstance(profile, Profile):
        raise InputError('`motion` is missing: the reference "profile" needs one')
    if profile.align == "gyro" and settings.offset_sd is None:
        raise InputError(
            '`align` is "gyro": the profile is found in the whole log, so it cannot be used live. Record, then replay;'
            ' or align by "marks"'
        )
    if profile.max_rate * settings.period > MAX_TURN:
        raise InputError(
            f"`profile` turns at up to {np.rad2deg(profile.max_rate):.0f} deg/s, which is"
            f" {np.rad2deg(profile.max_rate * settings.period):.0f} deg between two samples at"
            f" {1.0 / settings.period:g} Hz: nothing is known of the rate in between. Sample faster, or turn slower"
        )
    return TableMotion(profile, settings.site, settings.spec, settings.period, settings.offset, settings.offset_sd)

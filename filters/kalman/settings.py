"""All that decides the estimates, apart from the samples."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from filters import state
from filters.imu import IMU400CD_200, ImuSpec, Noise
from filters.motion import reference
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from filters.state import PAPER_SITE, Site

if TYPE_CHECKING:
    # what the effects are takes a filter; that there are some does not
    from filters.kalman.augmentation import MakeEffects

FILTERS = ("spkf", "spkf-paper", "ekf")
"""Filters by name; `filters.kalman.engines.ENGINES` makes them."""
MEASUREMENTS = ("exact", "drawn")
GAP = 2.5
"""Sample periods beyond which a step is a gap."""


@dataclass(frozen=True, slots=True)
class Settings:
    """All that decides the estimates, apart from the samples.

    Attributes
    ----------
    period : float
        Sample period the log was made for, s; a step above 2.5 times this is a gap.
    filter : str
        A name of `FILTERS`.
    reference : str
        "level", "gravity", "profile" or "trajectory".
    site : Site
        Position and gravity of the table.
    measurements : str
        "exact": the reference itself is fed. "drawn": with noise of covariance R.
    seed : int
        Of the drawn noise.
    kappa : float
        κ of equation (11).
    spec : ImuSpec
        Limits, and noise densities unless `noise` gives them.
    noise : Noise or None
        Process noise; None takes the specification's white noise and constant biases.
    motion : Profile, Trajectory or None
        For the references "profile" and "trajectory".
    offset : float
        Time of the first sample's clock at which a profile starts, s.
    offset_sd : float or None
        Its standard deviation, s; None takes the profile's own.
    effects : callable or None
        Makes the effects that join the filter, anew for each run; "spkf" alone takes them.
    """

    period: float
    filter: str = "spkf"
    reference: str = "level"
    site: Site = PAPER_SITE
    measurements: str = "exact"
    seed: int = 0
    kappa: float = 0.0
    spec: ImuSpec = IMU400CD_200
    noise: Noise | None = None
    motion: Profile | Trajectory | None = None
    offset: float = 0.0
    offset_sd: float | None = None
    effects: "MakeEffects | None" = None

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("filter", self.filter, FILTERS),
            ("reference", self.reference, reference.KINDS),
            ("measurements", self.measurements, MEASUREMENTS),
        ):
            if value not in allowed:
                raise ValueError(f'`{name}` is "{value}", not one of: {", ".join(allowed)}')
        if self.effects is not None and self.filter != "spkf":
            raise ValueError(
                f'`filter` is "{self.filter}", but effects are to be included, which join the filter "spkf" only.'
                " Choose it, or leave the effects out"
            )
        if self.seed < 0:
            raise ValueError(f"`seed` is {self.seed}, negative")
        if not self.period > 0.0:
            raise ValueError(f"`period` is {self.period} s, not positive")
        if not state.SIZE + self.kappa > 0.0:
            raise ValueError(f"`kappa` is {self.kappa}: 15 + kappa must be positive")

    def process_noise(self) -> Noise:
        """Process noise in force."""
        return self.noise if self.noise is not None else Noise.of(self.spec)

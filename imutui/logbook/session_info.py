"""The metadata record `imutui.session`: what was recorded, how, and with which settings of the filter."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, cast

import numpy as np

from filters import specification
from filters.errors import InputError
from filters.imu import AxisMap, Noise, parse_mount
from filters.kalman.settings import Settings
from filters.state import PAPER_PLACE, PAPER_SITE, Place, Site
from filters.tracing.trace_document import IdentityEntry
from imutui import declared
from imutui.declared import Meta
from imutui.plain_text import in_line
from imutui.settings import AccelSign, LoggedSettings, Range

if TYPE_CHECKING:
    from filters.kalman.augmentation import MakeEffects
    from filters.motion.profile import Profile
    from filters.motion.reference import Trajectory

METADATA = "imutui.session"

MEASURED = "measured"
SIMULATED = "simulated"
UNKNOWN = "unknown"

TABLE_1 = "table1"
FROM_LOG = "log"
NOISES = (TABLE_1, FROM_LOG)

Overrides: TypeAlias = Mapping[str, str | float]
"""Values of some fields of `SessionInfo`, by the field's name, to replace a log's own."""


@lru_cache
def _axes(mount: str, accel_sign: int, gyro_sign: str) -> AxisMap:
    return AxisMap(parse_mount(mount), accel_sign, parse_signs(gyro_sign))


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionInfo(LoggedSettings):
    """One recording session. Every field is written as a string and read back; unknown ones are ignored."""

    # instrument, serial_number, firmware: what the unit said of itself, or what the recording's maker says
    instrument: str = "IMU400CD-200"  # "" where it is not stated
    serial_number: str = ""
    firmware: str = ""
    # configuration, own_mount: how the unit was configured when it was found, in words, and how its case's axes lie in
    # its packets'; "" of units that do not say
    configuration: str = ""
    own_mount: str = ""
    kind: str = UNKNOWN  # "measured", "simulated" or "unknown": whether a sensor made the readings
    # the fields that follow are never None, as they may be in settings; 0 where a range is not stated
    accel_sign: AccelSign = -1
    rate_range_dps: Range = 200.0
    accel_range_g: Range = 4.0
    rate_hz: Annotated[float, Meta(least=1e-6, most=1e6)] = 133.0  # asked for; the nominal rate of output samples
    baud: int = 0
    # mode, sampling: measurement mode; "stream" (averaged over each period), "polled", or "imported"
    mode: str = "scaled"
    sampling: str = "stream"
    port: str = ""
    host: str = ""
    note: str = ""
    # latitude_deg, longitude_deg, height_m, gravity_mps2: site; the default one where nobody stated another
    latitude_deg: Annotated[float, Meta(least=-90.0, most=90.0)] = PAPER_PLACE[0]
    longitude_deg: Annotated[float, Meta(least=-360.0, most=360.0)] = PAPER_PLACE[1]
    height_m: Annotated[float, Meta(least=-1e5, most=1e6)] = PAPER_PLACE[2]
    gravity_mps2: Annotated[float, Meta(least=0.0, most=100.0)] = PAPER_SITE.gravity
    site_stated: bool = False  # whether an option, a setting or a form stated the site or its gravity
    reference_sha256: str = ""  # of the file that the reference comes from, if it does
    effects_sha256: str = ""  # of the effects file, if effects join the filter
    software: str = ""
    stamps: str = ""  # what each time stamp means
    # where the readings come from: the name of an imported recording's file, or what a virtual unit says of them
    source: str = ""
    # corrected_from_sha256, applied_effects_sha256: of a corrected log: hashes of the log that it was made of, and of
    # the effects file that was taken out of it
    corrected_from_sha256: str = ""
    applied_effects_sha256: str = ""
    log_id: str = ""  # of the log; "" of other programs' logs
    power_on: str = ""  # which power-on it is a part of: the id of its first log
    part: int = 1  # which part, from 1
    # continues, continues_id, continues_sha256: name, id and hash of the log that it goes on from; "" if it begins a
    # power-on, or nothing is known of one
    continues: str = ""
    continues_id: str = ""
    continues_sha256: str = ""
    # acquisition, batch, boot_id: name of the acquisition, of the batch that it is one of, and which run of the
    # computer it was recorded in
    acquisition: str = ""
    batch: str = ""
    boot_id: str = ""
    # previous, previous_id, previous_end, restart: name and id of the recording before it that it takes up after,
    # "finished" or "unfinished", and what was started anew since, "process" or "computer": see
    # `imutui.session.metadata`. "" where nothing is to be said.
    previous: str = ""
    previous_id: str = ""
    previous_end: str = ""
    restart: str = ""
    power_on_ns: Annotated[int, Meta(least=0, most=2**63 - 1024)] = (
        0  # UTC of the power-on's first known sample, ns; 0 for the log's own first one
    )
    clock_s: Annotated[float, Meta(least=-1e18, most=1e18)] = (
        0.0  # what an imported recording's own clock said at its first sample, s
    )
    # controller, controller_identity: URL of the table's controller, and what it said of itself; "" of a table that was
    # not under command
    controller: str = ""
    controller_identity: str = ""
    # what the filter's effects remember of the file before it, JSON; "" if nothing: history is unknown then
    memory: str = ""

    def axes(self) -> AxisMap:
        """Between instrument and body axes."""
        return _axes(self.mount, self.accel_sign, self.gyro_sign)

    def site(self) -> Site:
        """Where the unit stood."""
        return Site(
            float(np.deg2rad(self.latitude_deg)),
            float(np.deg2rad(self.longitude_deg)),
            self.height_m,
            self.gravity_mps2,
        )

    def placed(self, place: Place | None, gravity: float | None) -> "SessionInfo":
        """Return the session at a site.

        `place`: latitude, longitude (degrees) and height (m); None where it is not stated.
        `gravity`: local gravity, m/s²; None takes WGS-84 normal gravity.
        """
        latitude, longitude, height = place or (self.latitude_deg, self.longitude_deg, self.height_m)
        return replace(
            self,
            latitude_deg=latitude,
            longitude_deg=longitude,
            height_m=height,
            gravity_mps2=Site.at(latitude, longitude, height, gravity).gravity,
            site_stated=place is not None or gravity is not None,
        )

    def settings(
        self,
        motion: "Profile | Trajectory | None" = None,
        noise: Noise | None = None,
        offset: float = 0.0,
        offset_sd: float | None = None,
        effects: "MakeEffects | None" = None,
    ) -> Settings:
        """Settings of the filter for this session's samples; "none" as the filter gives those of the default one.

        What is no text or number comes from outside: a motion, noise that was measured, a profile's place in time,
        the effects of a file.
        """
        if self.noise not in NOISES:
            raise InputError(f'`noise` is "{self.noise}", not one of: {", ".join(NOISES)}')
        return Settings(
            1.0 / self.rate_hz,
            spec=specification.of_model(self.instrument),
            filter="spkf" if self.filter == "none" else self.filter,
            reference=self.reference,
            site=self.site(),
            measurements=self.measurements,
            seed=self.seed,
            kappa=self.kappa,
            noise=noise,
            motion=motion,
            offset=offset,
            offset_sd=offset_sd,
            effects=effects,
        )

    def overridden(self, values: Overrides) -> "SessionInfo":
        """The same session with other values of some fields; raises TypeError if there is no such field."""
        return replace(self, **cast("dict[str, Any]", values))

    def strings(self) -> dict[str, str]:
        """Fields as MCAP metadata; no text in them acts on who shows it."""
        return {
            key: repr(value) if isinstance(value, float) else in_line(str(value)) for key, value in asdict(self).items()
        }

    @classmethod
    def from_strings(cls, strings: dict[str, str]) -> "SessionInfo":
        """Fields from MCAP metadata.

        Raises InputError if a number does not read as one, naming the field, or if its axes or settings cannot be.
        """
        values = asdict(FOREIGN)
        for name, value in values.items():
            if name in strings:
                try:
                    values[name] = _CONVERTERS[type(value)](strings[name])
                except ValueError as error:
                    raise InputError(f'metadata field `{name}` is "{strings[name]}", not a number') from error
        try:
            info = declared.read(values, cls)
        except InputError as error:
            raise InputError(f"metadata field {error}") from error
        info.axes(), info.settings()
        return info

    def outward(self, accel: np.ndarray, gyro: np.ndarray, *, sd: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Return specific force in mg and angular rate in deg/s, instrument axes, of those in SI and body axes.

        `accel`, `gyro`: shape (..., 3); biases too, or standard deviations if `sd`.
        """
        axes = self.axes()
        if sd:
            accel, gyro = axes.sd_to_instrument(accel), axes.sd_to_instrument(gyro)
        else:
            accel, gyro = axes.accel_to_instrument(accel), axes.gyro_to_instrument(gyro)
        return accel / self.g_unit * 1e3, np.rad2deg(gyro)

    def identity(self) -> IdentityEntry:
        """Whose samples these are, and who recorded them, for a result."""
        return cast("IdentityEntry", {name: in_line(getattr(self, name)) for name in IdentityEntry.__annotations__})

    def config_sha256(self) -> str:
        """Hash of all that decides the estimates apart from the samples."""
        settings = asdict(self.settings())
        del settings["effects"], settings["unread"]  # code, whose file has a hash; and what the samples themselves say
        del settings["spec"]["source"]  # words
        decisive = {"settings": settings, "mount": self.mount, "accel_sign": self.accel_sign}
        decisive |= {"gyro_sign": self.gyro_sign, "g_unit": self.g_unit}
        decisive |= {"noise": self.noise, "reference_sha256": self.reference_sha256}
        if self.effects_sha256:
            decisive["effects_sha256"] = self.effects_sha256
        if self.memory:
            decisive["memory"] = self.memory
        text = json.dumps(decisive, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


FOREIGN = SessionInfo(instrument="", rate_range_dps=0.0, accel_range_g=0.0, accel_sign=1, sampling="foreign")
"""What is known of a recording before its file states anything: no instrument, no ranges, no site; specific force."""


_CONVERTERS: dict[type, Callable[[str], Any]] = {
    bool: lambda text: bool(("False", "True").index(text)),
    int: int,
    float: float,
    str: str,
}


def parse_signs(text: str) -> np.ndarray:
    """Three signs such as "-1,1,1", or one for all.

    Raises InputError if `text` does not read so.
    """
    parts = [part.strip() for part in text.split(",")]
    if len(parts) == 1:
        parts = parts * 3
    if len(parts) != 3 or any(part not in ("1", "+1", "-1") for part in parts):
        raise InputError(f'`gyro_sign` is "{text}", not one or three of -1 and 1 such as "-1,1,1"')
    return np.array([float(part) for part in parts])

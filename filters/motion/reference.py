"""What is known of the motion: still and level, still under gravity, a table's profile, a trajectory.

A reference says for each sample which of the nine navigation states are known, how well, and what a perfect unit would
read; `known` gives it as rows in the layout of `COLUMNS`. How a reference is found, where it
has to be, is `filters.motion.alignment`'s.
"""

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from filters import attitude, earth, state
from filters.imu import ImuSpec
from filters.motion import kinematics
from filters.motion.profile import Profile
from filters.motion.segments import Dwell
from filters.state import NavState, Site
from filters.types import Array

_DEG = np.pi / 180.0

PAPER_R_SD = np.array([10.0, 10.0, 30.0, 0.1, 0.1, 0.1, 0.1 * _DEG, 0.1 * _DEG, 0.5 * _DEG])
"""Standard deviations of the nine pseudo-measurements (section 4): m, m/s, rad; attitude about north, east, down."""
assert state.NAVIGATION.stop == PAPER_R_SD.size

KINDS = ("level", "gravity", "turned", "profile", "trajectory")

COLUMNS = 25
"""Columns of `Reference.known`: position 3, velocity 3, quaternion n←b 4, variances of the nine rows (negative where
not known, `ENDED` where the reference has ended), angular rate 3 and specific force 3 of a perfect unit in body axes
(NaN where not known)."""
POSITION, VELOCITY, QUATERNION = slice(0, 3), slice(3, 6), slice(6, 10)
VARIANCES, RATE, FORCE = slice(10, 19), slice(19, 22), slice(22, 25)

ENDED = -2.0
"""Variance of the first row where there is no reference: it has not begun, has ended, or has been away for too long."""
AWAY = 60.0
"""s after a marked dwell for which the filter predicts, towards the next; then navigation is not worth going on with.

Measured: with a wait of 60 s between dwells biases are within two of their standard deviations; with 300 s, nine off.
"""
AFTER = 2.0  # s for which a trajectory is still of use after its last row: the filter predicts
SETTLE = 2.0  # s after a mark, or after coming to rest, before a dwell's rows are used
_TOLD = re.compile(r"^\s*(?:segment|dwell)\s+(\d+)\b(\s+ends\b)?", re.IGNORECASE)


class Reference(ABC):
    """What the runner asks of a reference."""

    moving: ClassVar[bool] = True  # whether the unit may move: readings are then taken as linear between samples

    @abstractmethod
    def start(self) -> tuple[NavState, Array]:
        """State at the first sample, and standard deviations of its nine navigation errors, shape (9,)."""

    @abstractmethod
    def known(self, t: Array, before: float, gyro: Array) -> Array:
        """Rows for samples at `t` s, shape (N, 25), or one for all, (1, 25); see `COLUMNS`.

        `before` is the time of the sample before the first of these (-inf: none), `gyro` what the unit read (N, 3).
        """

    def observable(self, bias_sd: Array, P0_sd: Array) -> tuple[bool, ...]:
        """For the six biases, accelerometer then gyro, body axes, whether the reference shows them.

        Unless more is known, those that the motion so far has made known to half of what they were.
        """
        return tuple(bool(x) for x in bias_sd < 0.5 * P0_sd)


@dataclass(frozen=True, slots=True)
class Still(Reference):
    """Known position, velocity and attitude of a unit at rest."""

    nav: NavState  # the known navigation state; its biases are zero and mean nothing
    rows: NDArray[np.int_]  # indices of the error states that are known, of 0..8, shape (m,)
    R_sd: Array  # standard deviations of those rows, shape (m,)
    P0_sd: Array  # standard deviations of the nine navigation states at the start, shape (9,)
    seen: tuple[bool, bool, bool]  # for each body axis, whether its accelerometer bias can be told from attitude
    gravity: float  # local gravity, m/s²
    moving: ClassVar[bool] = False

    def start(self) -> tuple[NavState, Array]:
        """The known state itself."""
        return self.nav, self.P0_sd

    def known(self, t: Array, before: float, gyro: Array) -> Array:
        """One row for all samples."""
        row = np.empty((1, COLUMNS))
        row[0, POSITION] = self.nav.latitude, self.nav.longitude, self.nav.height
        row[0, VELOCITY] = self.nav.velocity_n
        row[0, QUATERNION] = attitude.to_quaternion(self.nav.C_nb)
        row[0, VARIANCES] = -1.0
        row[0, VARIANCES][self.rows] = self.R_sd**2
        row[0, RATE], row[0, FORCE] = self.rates_and_forces()
        return row

    def observable(self, bias_sd: Array, P0_sd: Array) -> tuple[bool, ...]:
        """Gyros always, accelerometers where the attitude is known apart from them."""
        return (*self.seen, True, True, True)

    def rates_and_forces(self) -> tuple[Array, Array]:
        """Angular rate (rad/s) and specific force (m/s²) in body axes that a perfect unit measures here; each (3,)."""
        rate_n = earth.earth_rate_n(self.nav.latitude)
        return self.nav.C_nb.T @ rate_n, self.nav.C_nb.T @ np.array([0.0, 0.0, -self.gravity])


def level(site: Site) -> Still:
    """The paper's case: body axes on north, east, down; all nine rows known (section 4)."""
    nav = NavState.at_rest(site, np.eye(3))
    return Still(nav, np.arange(9), PAPER_R_SD, PAPER_R_SD, (True, True, True), site.gravity)


class TableMotion(Reference):
    """A table's profile: dwells and, where its time is joined to the log's well enough, what lies between.

    Attitude and velocity are used in dwells, from 2 s after the mark or after coming to rest and while the gyros are
    quiet. Everywhere else only once aligned: with rate × `offset_sd` added to the standard deviation of attitude. Else
    the filter predicts only.

    `profile`: with `align` "none" (profile time is log time), "marks", or "gyro" (joined by `offset`).
    `site`: where the table stands.
    `spec`: decides what a quiet gyro is.
    `period`: sample period, s.
    `offset`: Log time at which the profile starts, s.
    `offset_sd`: its standard deviation; None takes the profile's.
    """

    def __init__(
        self,
        profile: Profile,
        site: Site,
        spec: ImuSpec,
        period: float,
        offset: float = 0.0,
        offset_sd: float | None = None,
    ) -> None:
        self.profile = profile
        self.offset = offset
        self.offset_sd = profile.offset_sd if offset_sd is None else offset_sd
        self.quiet = 3.0 * spec.gyro_bias_limit + 5.0 * spec.gyro_arw / np.sqrt(period)
        self._site = site
        self._rest_starts = profile.rest_starts
        self._dwells = [k for k, segment in enumerate(profile.segments) if isinstance(segment, Dwell)]
        self._marks: list[tuple[float, int, bool]] = []

    def mark(self, t: float, text: str) -> None:
        """Take an operator's mark.

        It begins the segment it names ("segment 3", counted from 1), or the next dwell; "segment 3 ends" says that the
        table has left it before its time.
        """
        dwells = self._dwells
        told = _TOLD.match(text)
        if told:
            segment = int(told[1]) - 1
        else:
            last = self._marks[-1][1] if self._marks else -1
            segment = next((k for k in dwells if k > last), -1)
        if segment in dwells:
            self._marks.append((t, segment, told is None or told[2] is None))

    def start(self) -> tuple[NavState, Array]:
        """At rest with the angles of the first sample's time; aligned by marks, those of the last dwell marked."""
        profile_t = self._by_marks(np.zeros(1))[0] if self.profile.align == "marks" else np.zeros(1) - self.offset
        C_nb = kinematics.attitudes(self.profile.angles(profile_t))[0]
        return NavState.at_rest(self._site, C_nb), PAPER_R_SD

    def known(self, t: Array, before: float, gyro: Array) -> Array:
        """Rows for samples at `t`; rows of the table are all known or none."""
        profile_t, rests, aligned = self.joined(t)
        rows = self._motion(profile_t)
        used = aligned | (rests & (np.abs(gyro) < self.quiet).all(axis=1))
        rows[~used, VARIANCES] = -1.0
        rows[~used, RATE.start :] = np.nan
        ended = self._ended(t, profile_t) & ~rests & ~aligned
        rows[ended, VARIANCES] = ENDED
        rows[ended, RATE.start :] = np.nan
        return rows

    def _ended(self, t: Array, profile_t: Array) -> NDArray[np.bool_]:
        """Whether the profile is over at each of the samples.

        By marks, it is so before the first of them, for the operator may be a long way from the first dwell; once its
        last dwell is over, until another mark; and where the next mark does not come for `AWAY`. Where it ends with a
        dwell, or is joined to the log, the table is still known to rest there; see `Profile`.
        """
        if self.profile.align != "marks":
            return profile_t > self.profile.duration
        last, ended = self._dwells[-1] if self._dwells else -1, np.ones(t.size, bool)
        for at, segment, begins in self._marks:
            dwell = self.profile.segments[segment]
            assert isinstance(dwell, Dwell)
            until = at + (dwell.seconds if begins else 0.0) + (0.0 if segment == last else AWAY)
            ended[t >= at] = t[t >= at] > until
        return ended

    def motion(self, t: Array) -> Array:
        """Rows for samples at `t` as the profile has them, whether or not they are known well enough."""
        return self._motion(self.joined(t)[0])

    def _motion(self, profile_t: Array) -> Array:
        angles, rates = self.profile.angles(profile_t), self.profile.rates(profile_t)
        C = kinematics.attitudes(angles)
        turning_b = kinematics.body_rate(angles, rates)
        site, omega = self._site, earth.EARTH_RATE
        rows = np.empty((profile_t.size, COLUMNS))
        rows[:, POSITION] = site.latitude, site.longitude, site.height
        rows[:, VELOCITY] = 0.0
        rows[:, QUATERNION] = attitude.to_quaternion(C)
        # written out, since a matrix product may add in an order that depends on how many samples come at once
        north, down = C[:, 0], C[:, 2]
        rows[:, RATE] = omega * (np.cos(site.latitude) * north - np.sin(site.latitude) * down) + turning_b
        rows[:, FORCE] = -site.gravity * down
        rows[:, VARIANCES] = PAPER_R_SD**2
        if self.offset_sd is not None:
            late = [sum(C[:, i, k] * turning_b[:, k] for k in range(3)) * self.offset_sd for i in range(3)]
            rows[:, VARIANCES][:, state.ATTITUDE] += np.stack(late, axis=-1) ** 2
        return rows

    def segment_of(self, t: Array) -> NDArray[np.int_]:
        """Number of the profile's segment at `t` s of the log, (N,); that of the last dwell marked, if by marks."""
        return self.profile.index(self.joined(t)[0])

    def joined(self, t: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
        """Profile time, whether the table is settled in a dwell then, and whether the joint is good for all else."""
        if self.profile.align == "marks":
            return self._by_marks(t)
        profile_t = t - self.offset
        index = self.profile.index(profile_t)
        since = profile_t - np.where(np.isnan(self._rest_starts), np.inf, self._rest_starts)[index]
        first = profile_t < np.append(self.profile.starts, np.inf)[1] if self.profile.align == "none" else False
        rests = self.profile.phase(profile_t) & ((since >= SETTLE) | first)
        return profile_t, rests, np.full(t.size, self.offset_sd is not None)

    def _by_marks(self, t: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
        profile_t = np.zeros(t.size)
        rests, aligned = np.zeros(t.size, bool), np.zeros(t.size, bool)
        for at, segment, begins in self._marks:
            dwell = self.profile.segments[segment]
            assert isinstance(dwell, Dwell)
            here = t >= at
            since = t[here] - at
            rests[here] = (since >= SETTLE) & (since <= dwell.seconds - SETTLE) if begins else False
            # held at the dwell's rest: past its end nobody says when the table moves on
            profile_t[here] = self._rest_starts[segment]
        return profile_t, rests, aligned


@dataclass(frozen=True, slots=True)
class Trajectory:
    """What is known of a motion, row by row."""

    t: Array  # s since the log's first sample, shape (N,), increasing
    # latitude, longitude (rad), height (m); velocity north, east, down (m/s); roll, pitch, yaw (3-2-1, rad) of C_nb.
    # Shape (N, 9), NaN where unknown.
    values: Array


@dataclass
class Path(Reference):
    """A trajectory: each of its rows is used once, at the first sample from its time on."""

    trajectory: Trajectory  # what is known
    nav: NavState  # state at the first sample
    P0_sd: Array  # of its nine errors
    partial: dict[float, Array] = field(default_factory=dict)
    _end: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        told = np.isfinite(self.trajectory.values).any(axis=1)
        self._end = float(self.trajectory.t[told][-1]) if told.any() else -np.inf

    def start(self) -> tuple[NavState, Array]:
        """State and standard deviations that alignment found, for the filter to start from."""
        return self.nav, self.P0_sd

    def known(self, t: Array, before: float, gyro: Array) -> Array:
        """Rows for samples at `t`; position is carried from its own time to the sample's with the known velocity."""
        rows = np.full((t.size, COLUMNS), np.nan)
        rows[:, VARIANCES] = -1.0
        newest = np.searchsorted(self.trajectory.t, t + 1e-9, side="right") - 1
        fresh = newest > np.concatenate(
            [[np.searchsorted(self.trajectory.t, before + 1e-9, side="right") - 1], newest[:-1]]
        )
        which = np.flatnonzero(fresh)
        if which.size:
            rows[which] = self._rows(newest[which], t[which])
        rows[t > self._end + AFTER, VARIANCES.start] = ENDED
        return rows

    def _rows(self, index: NDArray[np.int_], t: Array) -> Array:
        """Rows of the trajectory as known at t, shape (n, 25)."""
        values = self.trajectory.values[index]
        rows = np.full((index.size, COLUMNS), np.nan)
        late = t - self.trajectory.t[index]
        moved = np.nan_to_num(values[:, 3:6]) * late[:, None]
        latitude = np.where(np.isfinite(values[:, 0]), values[:, 0], float(self.nav.latitude))
        height = np.where(np.isfinite(values[:, 2]), values[:, 2], float(self.nav.height))
        R_n, R_e = earth.curvature(latitude, height)
        rows[:, 0] = values[:, 0] + moved[:, 0] / R_n
        rows[:, 1] = values[:, 1] + moved[:, 1] / (R_e * np.cos(latitude))
        rows[:, 2] = values[:, 2] - moved[:, 2]
        rows[:, VELOCITY] = values[:, 3:6]
        known = np.isfinite(values)
        whole = known[:, 6:9].all(axis=1)
        rows[whole, QUATERNION] = attitude.to_quaternion(attitude.from_rpys(values[whole, 6:9]))
        # with part of the attitude known, the rest is the filter's own: `complete` fills it in
        known[:, 6:8] = (known[:, 6] & known[:, 7])[:, None]
        rows[:, VARIANCES] = np.where(known, PAPER_R_SD**2, -1.0)
        for k in np.flatnonzero(known[:, 6:9].any(axis=1) & ~whole):
            self.partial[float(t[k])] = values[k, 6:9]
        return rows

    def complete(self, row: Array, t: float, C_nb: Array) -> None:
        """Fill the unknown angles of a row with the filter's own attitude, in place."""
        own = attitude.to_rpy(C_nb)
        angles = np.where(np.isnan(self.partial[t]), own, self.partial[t])
        row[QUATERNION] = attitude.to_quaternion(attitude.from_rpy(*map(float, angles)))

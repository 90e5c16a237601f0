"""Finding a reference from data: roll and pitch from gravity, attitude from a trajectory, a profile's place in time.

An alignment holds back the first samples until it has enough of them; how many it needs does not depend on the data
itself, so that live and replay align on the same ones.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from filters import attitude
from filters.errors import InputError
from filters.motion import kinematics
from filters.motion.profile import Profile
from filters.motion.reference import PAPER_R_SD, VARIANCES, VELOCITY, Path, Reference, Still, Trajectory
from filters.state import ATTITUDE, NavState, Site
from filters.types import Array

# still time, and samples, that roll and pitch are found from
SECONDS, SAMPLES = 10.0, 10
_VERTICAL = 0.7

# a trajectory: slower is standing, and after so much of faster its heading can be found
_STANDING = 0.5
_MOVING = 2.0
_MOVING_SECONDS = 15.0
_INTERVAL = 1.0
_TILT_SD = np.deg2rad(2.0)
_HEADING_SD = np.deg2rad(10.0)
_STEP = 0.05
_BIAS = np.deg2rad(5.0)
_SLOPE_S = 1e-3
_BLOCK_S = 2.0
_TELLS = 1e-3  # share of a channel's own slope that its other unknowns do not follow
_TOLD_SD = 2e-3  # s: of a lag that counts
_APART = 5.0  # standard deviations from where a lag is another one
_NOT_THIS_ONE = "is not what the gyros saw (another profile, another `sign`, or another mounting)"


class Alignment(Protocol):
    """Waits for samples and finds a reference from them."""

    def enough(self, t: float, count: int) -> bool:
        """Whether `count` samples up to `t` s are enough."""
        ...

    def found(self, t: Array, gyro: Array, accel: Array) -> Reference:
        """Reference from the samples, body axes; raises InputError if they do not give one."""
        ...


@dataclass(slots=True)
class Levelling:
    """Still at unknown attitude; see `level_by_gravity`."""

    site: Site  # where the unit stands
    accel_bias_sd: float  # at the start, m/s²
    is_any_rest: bool = False  # whether the rest need not begin with the log
    begun: float = 0.0  # time of the rest's first sample, s; set by the first question

    def enough(self, t: float, count: int) -> bool:
        """10 s and 10 samples."""
        if count == 1 and self.is_any_rest:
            self.begun = t
        return t - self.begun >= SECONDS and count >= SAMPLES

    def found(self, t: Array, gyro: Array, accel: Array) -> Reference:
        """Roll and pitch of the mean specific force."""
        return level_by_gravity(self.site, accel.mean(axis=0), self.accel_bias_sd)


def level_by_gravity(site: Site, mean_force_b: Array, accel_bias_sd: float) -> Still:
    """Still at unknown attitude: roll and pitch from the mean specific force, heading called zero.

    Roll and pitch start there and are no measurement: they came from the very accelerometers whose bias is asked
    for, so tilt starts as uncertain as that bias makes it. The yaw row is kept with reference 0; without it the
    vertical gyro bias would not be seen. It is read to Earth rate's 0.004 deg/s, because true heading is unknown.

    `mean_force_b`: mean specific force, body axes, m/s², shape (3,).
    `accel_bias_sd`: standard deviation of the accelerometer bias at the start, m/s².
    Raises InputError if the mean force is not within 10 % of gravity: the unit moves, or units are wrong.
    """
    norm = float(np.linalg.norm(mean_force_b))
    if not 0.9 < norm / site.gravity < 1.1:
        raise InputError(
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
    nav = NavState.at_rest(site, C_nb)
    return Still(nav, rows, PAPER_R_SD[rows], P0_sd, (bool(x), bool(y), bool(z)), site.gravity)


class InMotion:
    """Attitude at the start of a trajectory that gives position and velocity, perhaps attitude.

    Where the first row has roll, pitch and yaw, they are it. Else it is found by comparing what the accelerometers felt
    with how the velocity changed (`attitude_from_velocity`), over all up to 15 s of motion; a trajectory that never
    moves gives roll and pitch, and heading 0.

    `trajectory`: its first row must give position and velocity.
    `site`: gravity.
    `accel_bias_sd`: at the start, m/s².
    Raises InputError if the first row lacks position or velocity.
    """

    def __init__(self, trajectory: Trajectory, site: Site, accel_bias_sd: float) -> None:
        whole = np.flatnonzero(np.isfinite(trajectory.values[:, :6]).all(axis=1))
        if not whole.size:
            raise InputError("`trajectory` has no row with both position and velocity: the filter has nowhere to start")
        # what is before the first sample is the past; only the last of it says where the unit is then
        past = whole[trajectory.t[whole] <= 0.0]
        first = int(past[-1] if past.size else whole[0])
        self._trajectory = Trajectory(trajectory.t[first:], trajectory.values[first:])
        self._site = site
        self._accel_bias_sd = accel_bias_sd
        self._told = bool(np.isfinite(trajectory.values[first, 6:9]).all()) and float(trajectory.t[first]) <= 1.0
        self._until = 0.0 if self._told else self._moved_enough()

    def _moved_enough(self) -> float:
        """Time by which the trajectory has moved for 15 s; infinity if it never does."""
        t, speed = self._trajectory.t, np.linalg.norm(self._trajectory.values[:, 3:6], axis=1)
        steps = np.diff(t, prepend=t[0])
        moving = np.cumsum(np.where(speed > _MOVING, np.minimum(steps, 2.0), 0.0))
        enough = np.flatnonzero(moving >= _MOVING_SECONDS)
        return float(t[enough[0]]) if enough.size else np.inf

    def enough(self, t: float, count: int) -> bool:
        """When the trajectory has moved enough, or at once where it tells attitude."""
        return t >= self._until

    def found(self, t: Array, gyro: Array, accel: Array) -> Reference:
        """Path with its initial state."""
        value = self._trajectory.values[0]
        if self._told:
            C_nb = attitude.from_rpy(*map(float, value[6:9]))
            P0_sd = PAPER_R_SD.copy()
        elif np.isfinite(self._until):
            C_nb = attitude_from_velocity(self._trajectory, self._site.gravity, t, gyro, accel)
            P0_sd = PAPER_R_SD.copy()
            P0_sd[6:9] = _TILT_SD, _TILT_SD, _HEADING_SD
        else:
            still = level_by_gravity(self._site, accel[t <= t[0] + SECONDS].mean(axis=0), self._accel_bias_sd)
            C_nb, P0_sd = still.nav.C_nb, still.P0_sd.copy()
            P0_sd[8] = _HEADING_SD
        return Path(self._trajectory, NavState.of(value[:3], value[3:6], C_nb), P0_sd)


def attitude_from_velocity(trajectory: Trajectory, gravity: float, t: Array, gyro: Array, accel: Array) -> Array:
    """Attitude at the first sample from velocities, by Wahba's problem.

    Between two known velocities v₁, v₂ the accelerometers integrate to C_nb(0) ∫ C_b0b f dt = v₂ - v₁ - g (t₂ - t₁),
    with C_b0b from the gyros, less their median while standing. All such pairs give C_nb(0) by least squares (singular
    value decomposition of Σ α βᵀ, Markley 1988).

    `trajectory`: known velocities.
    `gravity`: m/s².
    `t`, `gyro`, `accel`: samples, s, rad/s, m/s², body axes, shape (N,), (N, 3), (N, 3).
    Returns C_nb at t[0], shape (3, 3).
    Raises InputError if fewer than three pairs of velocities lie within the samples.
    """
    velocity = trajectory.values[:, 3:6]
    use = np.isfinite(velocity).all(axis=1) & (trajectory.t >= t[0]) & (trajectory.t <= t[-1])
    fix_t, fix_v = trajectory.t[use], velocity[use]
    speed = np.interp(t, fix_t, np.linalg.norm(fix_v, axis=1)) if fix_t.size else np.zeros(t.size)
    standing = speed < _STANDING
    bias = np.median(gyro[standing], axis=0) if standing.any() else np.zeros(3)
    dt = np.diff(t, prepend=t[0])
    C = np.eye(3)
    felt = np.zeros((t.size, 3))
    turns = attitude.exp((gyro - bias) * dt[:, None])
    for k in range(1, t.size):
        C = C @ turns[k]
        felt[k] = felt[k - 1] + C @ accel[k] * dt[k]
    # at least a second between the two: noise of a velocity counts against gravity's pull over that time
    pairs, last = [], 0
    for k in range(1, fix_t.size):
        if fix_t[k] - fix_t[last] >= _INTERVAL:
            pairs.append((last, k))
            last = k
    if len(pairs) < 3:
        raise InputError(f"`trajectory` has {len(pairs)} usable pairs of velocities; three are needed to find attitude")
    first, second = np.array(pairs).T
    alpha = fix_v[second] - fix_v[first]
    alpha[:, 2] -= gravity * (fix_t[second] - fix_t[first])
    at = np.stack([np.interp(fix_t, t, felt[:, i]) for i in range(3)], axis=-1)
    beta = at[second] - at[first]
    U, _, Vt = np.linalg.svd(alpha.T @ beta)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt)


def offset_of_profile(profile: Profile, t: Array, gyro: Array) -> tuple[float, float]:
    """Log time at which a profile starts, found from the gyros.

    Least squares of gyro = profile's rate(t - offset) + bias: first on a grid of 0.05 s by correlation, then by
    Gauss-Newton steps.

    `profile`: with moving segments.
    `t`, `gyro`: samples, s and rad/s, body axes, shape (N,) and (N, 3).
    Returns offset and its standard deviation, s.
    Raises InputError if the profile does not move, or the gyros do not follow it.
    """
    grid = np.arange(0.0, profile.duration, _STEP)
    wanted = _rates(profile, grid)
    if not np.any(np.abs(wanted) > 1e-3):
        raise InputError("`profile` never turns: there is nothing to find its time by; use marks")
    seen_t = np.arange(t[0], t[-1], _STEP)
    seen = np.stack([np.interp(seen_t, t, gyro[:, i]) for i in range(3)], axis=-1)
    shift = _best_shift(seen, wanted)
    offset = float(seen_t[0]) + _STEP * shift
    sd = np.inf
    for _ in range(8):
        expected = _rates(profile, t - offset)
        slope = (_rates(profile, t - offset - 1e-3) - _rates(profile, t - offset + 1e-3)) / 2e-3
        residual = gyro - expected
        residual = residual - residual.mean(axis=0)
        slope = slope - slope.mean(axis=0)
        information = float(np.sum(slope**2))
        if information == 0.0:
            raise InputError(f"`profile` {_NOT_THIS_ONE}: it does not lie in this log")
        step = float(np.sum(slope * residual)) / information
        offset += float(np.clip(step, -_STEP, _STEP))
        sd = float(np.sqrt(np.mean(residual**2) / information))
        if abs(step) < 1e-5:
            break
    _check_fit(gyro, expected)
    return offset, sd


def shift_of_most(profile: Profile, t: Array, offset: float, site: Site, reading: Array, latency: Array) -> float:
    """How much later than `offset` a profile starts by most of the six channels, s; 0 where they agree with it.

    A gyro that answers angular acceleration reads as one that is late. Where two do, the offset that all three give
    makes every other channel look early, so the time that clearly more channels have in common counts.

    `t`: samples, s, shape (N,).
    `reading`: what the sensors read, body axes, rad/s and m/s², shape (N, 6).
    `latency`: how late they are known to read, s, shape (6,).
    """
    lags, sds = _lags(profile, t, offset, site, reading)
    lags -= latency
    told = sds < _TOLD_SD
    lags, sds = lags[told], sds[told]

    def apart(at: float) -> Array:
        return np.minimum(((lags - at) / sds) ** 2, _APART**2)

    best = min((float(lag) for lag in lags), key=lambda lag: float(apart(lag).sum()), default=0.0)
    most = apart(best) < _APART**2
    if not most.any() or apart(0.0).sum() - apart(best).sum() < _APART**2:
        return 0.0
    return float(np.average(lags[most], weights=sds[most] ** -2))


def _lags(profile: Profile, t: Array, offset: float, site: Site, reading: Array) -> tuple[Array, Array]:
    """How late each channel reads, and its standard deviation, s, each (6,); infinite where it does not tell.

    The lag is one of the unknowns beside bias, scale factor, cross axes and, of an accelerometer, lever arm. What these
    leave is no white noise, so that the deviation is that of sums over `_BLOCK_S`.
    """

    def inputs(at: Array) -> tuple[Array, Array]:
        C_nb = kinematics.attitudes(profile.angles(at))
        return _rates(profile, at), -site.gravity * C_nb[:, 2]

    at = t - offset
    (rate, force), early, late = inputs(at), inputs(at - _SLOPE_S), inputs(at + _SLOPE_S)
    x_dot = np.hstack([b - a for a, b in zip(early, late, strict=True)]) / (2.0 * _SLOPE_S)
    # ω × (ω × r) + ω' × r for r along each axis, shape (N, 3, 3)
    arms = np.stack(
        [np.cross(rate, np.cross(rate, r)) + np.cross(x_dot[:, :3], r) for r in np.eye(3)],
        axis=2,
    )
    block = (t // _BLOCK_S).astype(np.int64)
    lags, sds = np.zeros(6), np.full(6, np.inf)
    for c in range(6):
        beside = [np.ones((t.size, 1)), rate if c < 3 else force, *([arms[:, c - 3]] if c >= 3 else [])]
        both = np.column_stack([x_dot[:, c], reading[:, c]])
        columns = np.hstack(beside)
        z, e = (both - columns @ np.linalg.lstsq(columns, both, rcond=None)[0]).T
        energy = float(np.sum(z**2))
        if energy > _TELLS * float(np.sum(x_dot[:, c] ** 2)) > 0.0:
            lags[c] = -float(np.sum(z * e)) / energy
            sums = np.bincount(block - block[0], z * (e + lags[c] * z))
            sds[c] = float(np.sqrt(np.sum(sums**2))) / energy
    return lags, sds


def _best_shift(seen: Array, wanted: Array) -> int:
    """Shift of `wanted` (zero outside) at which seen - wanted - a constant has the least sum of squares."""
    n = len(seen)
    size = 1 << int(np.ceil(np.log2(n + len(wanted))))

    def correlated(a: Array, b: Array) -> Array:
        product = np.fft.rfft(a, size, axis=0) * np.conj(np.fft.rfft(b, size, axis=0))
        return np.asarray(np.fft.irfft(product, size, axis=0))

    seen = seen - seen.mean(axis=0)
    inside = np.ones((n, 1))
    cost = correlated(inside, wanted**2) - 2.0 * correlated(seen, wanted) - correlated(inside, wanted) ** 2 / n
    shift = int(np.argmin(cost.sum(axis=1)))
    return shift if shift < n else shift - size


def _check_fit(gyro: Array, expected: Array) -> None:
    """Refuse a profile that the gyros did not follow: in all, by each axis' own share, and by the bias it takes."""
    bias = np.mean(gyro - expected, axis=0)
    if np.any(np.abs(bias) > _BIAS):
        raise InputError(
            f"`profile` {_NOT_THIS_ONE}: it fits only with a gyro bias of {np.rad2deg(np.abs(bias).max()):.0f} deg/s"
        )
    centred, wanted = gyro - gyro.mean(axis=0), expected - expected.mean(axis=0)
    explained = 1.0 - np.sum((centred - wanted) ** 2) / np.sum(centred**2)
    if explained < 0.5:
        raise InputError(f"`profile` {_NOT_THIS_ONE}: it explains {max(0.0, explained) * 100:.0f} % of it")
    energy = np.sum(wanted**2, axis=0)
    noise = np.mean((centred - wanted) ** 2, axis=0)
    for i, axis in enumerate("xyz"):
        # an axis that hardly turns says nothing
        if energy[i] > 100.0 * noise.min() and energy[i] > 0.0:
            share = float(np.sum(centred[:, i] * wanted[:, i]) / energy[i])
            if not 0.5 < share < 1.5:
                raise InputError(f"`profile` {_NOT_THIS_ONE}: the {axis} gyro saw {share * 100:.0f} % of its rate")


def _rates(profile: Profile, t: Array) -> Array:
    return kinematics.body_rate(profile.angles(t), profile.rates(t))


# ------------------------------------------------------------------------------------------------------ attitude only
# A reference that knows how the unit is turned and nothing of where it is: an optical one, a quaternion's.
#
# Gyro biases and attitude can be estimated with it. Position and velocity start at the site, at rest; velocity is held
# within what a unit that is carried reaches, only so that it stays a number, and nothing is concluded from it.

_SPEED_SD = 30.0  # m/s: of the velocity that is held
_START_SPEED_SD = 1.0
_OFFSET_SD = 5e-3  # s: of the time of one recording in the other's, which a turning unit sees as an angle
_HELD_S = 1.0  # from one row of velocity to the next, s


def knows_attitude_only(trajectory: Trajectory) -> bool:
    """Whether a trajectory has attitudes, and nowhere both position and velocity."""
    known = np.isfinite(trajectory.values)
    return bool(np.any(known[:, 6:9].all(axis=1))) and not bool(np.any(known[:, :6].all(axis=1)))


@dataclass
class Turning(Path):
    """Attitude rows of a trajectory, each used once, and a velocity that is held loosely."""

    def known(self, t: Array, before: float, gyro: Array) -> Array:
        """Rows for samples at `t`: attitude where there is a new one, and once a second a velocity near zero."""
        rows = super().known(t, before, gyro)
        late = np.sum(gyro**2, axis=1)[:, None] * _OFFSET_SD**2
        attitudes = rows[:, VARIANCES][:, ATTITUDE]
        rows[:, VARIANCES.start + ATTITUDE.start : VARIANCES.start + ATTITUDE.stop] = np.where(
            attitudes > 0.0, attitudes + late, attitudes
        )
        second = np.floor(t / _HELD_S)
        held = second > np.append(np.floor(before / _HELD_S) if np.isfinite(before) else -np.inf, second[:-1])
        rows[held, VELOCITY] = 0.0
        rows[held, VARIANCES.start + 3 : VARIANCES.start + 6] = _SPEED_SD**2
        return rows

    def observable(self, bias_sd: Array, P0_sd: Array) -> tuple[bool, ...]:
        """Gyro biases as far as the attitude has made them known; accelerometer biases never."""
        return (False, False, False, *super().observable(bias_sd, P0_sd)[3:])


class Starting:
    """Attitude at the first sample: the first one known, carried back by the gyros.

    `trajectory`: with attitudes.
    `site`: where position is held.
    """

    def __init__(self, trajectory: Trajectory, site: Site) -> None:
        rows = np.flatnonzero(np.isfinite(trajectory.values[:, 6:9]).all(axis=1))
        values = np.full((rows.size, 9), np.nan)
        values[:, 6:9] = trajectory.values[rows, 6:9]
        self._trajectory = Trajectory(trajectory.t[rows], values)
        self._site = site
        past = np.flatnonzero(self._trajectory.t <= 0.0)
        self._first = int(past[-1]) if past.size else 0

    def enough(self, t: float, count: int) -> bool:
        """When the first attitude is known."""
        return t >= float(self._trajectory.t[self._first])

    def found(self, t: Array, gyro: Array, accel: Array) -> Reference:
        """Reference with its initial state."""
        C_nb = attitude.from_rpy(*map(float, self._trajectory.values[self._first, 6:9]))
        until = min(float(self._trajectory.t[self._first]), float(t[-1]))
        before = t < until
        steps = np.diff(np.append(t[before], until))[:, None]
        for turn in (gyro[before] * steps)[::-1]:
            C_nb = C_nb @ attitude.exp(-turn)
        nav = NavState.at_rest(self._site, C_nb)
        P0_sd = PAPER_R_SD.copy()
        P0_sd[3:6] = _START_SPEED_SD
        return Turning(self._trajectory, nav, P0_sd)

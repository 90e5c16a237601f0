"""What is known of a log's motion, at its samples: angles of the table, their rates, and where they are not known."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator
from scipy.signal import savgol_filter

from filters import attitude
from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY
from filters.motion import alignment, attitude_rows, kinematics
from filters.motion.profile import Profile
from filters.motion.reference import TableMotion, Trajectory
from filters.tracing.run import rest_attitudes
from filters.types import Array
from imutui.jobs import replay
from imutui.jobs.replay_input import level_force
from imutui.logbook import reader
from imutui.logbook.reader import Log
from imutui.logbook.reading import Reading
from imutui.logbook.session_info import SessionInfo

_IMPORTED = "imported"
_MOSTLY = 0.5
_NO_SPEED = 1e-3  # m/s
_WILD = 0.5 * STANDARD_GRAVITY
# nearer to middle = ±90° than this, outer and inner cannot be told apart
_GIMBAL = np.cos(np.deg2rad(87.0))
# what a controller measures: so few readings are none; so long between two, and nobody knows; steps that are evened out
_CERTAIN, _INTERVAL_S = 3.0, 0.05
_LEAST_STATES, _GAP_S, _STEPS_S = 10, 0.5, (0.002, 0.05)
# cubics that take the noise off, s and points; how well rates must agree with angles to be theirs
_SMOOTHED_S, _LEAST_WIDTH, _AGREE = 0.25, 7, 0.1
# an axis stands: slower than this for so long, and so near to one angle
_SLOW, _STANDS_S, _STANDS = np.deg2rad(0.02), 0.5, np.deg2rad(0.003)


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion of the table at the samples of a log."""

    # angles, rates: rad (unwrapped) and rad/s, shape (N, 3), or (1, 3) at rest
    angles: Array
    rates: Array
    C_nb: Array | None = None  # attitude of a unit at rest that does not sit as the angles say, shape (3, 3)
    unknown: NDArray[np.bool_] | None = None  # samples at which none of it is known, shape (N,)
    how: str = ""  # in words, where that is worth a word
    # quaternion w, x, y, z of C_nb of a unit that moves on no table, shape (N, 4); then `angles` are zeros and `rates`
    # those of the body about its own axes
    attitude: Array | None = None
    # samples at which the unit may be moved from place to place, so that its specific force is not known, shape (N,)
    carried: NDArray[np.bool_] | None = None


def motion_of(log: Log, info: SessionInfo, reading: Reading, latency: Array | None = None) -> Motion:
    """Motion at the samples, by the log's own reference or the one that is asked for.

    `info`: from `replay.session_of`.
    `reading`: `reference` and `overrides` count.
    `latency`: how late the six channels are known to read, s, shape (6,): a profile that is joined by them is joined
      so much too late.
    Raises InputError if the reference does not say the attitude, or the log does not follow it.
    """
    still = np.zeros((1, 3))
    own = reading.reference is None
    if own and log.states.stamp_ns.size >= _LEAST_STATES:
        return _from_states(log, info, reading)
    if info.reference in ("level", "turned"):  # turned by hand: the readings themselves say where it rests
        return Motion(still, still)
    if info.reference == "gravity":
        return Motion(still, still, _levelled(log, info))
    if own and info.reference == "trajectory" and np.isfinite(log.table.angles_deg).all(axis=1).any():
        return _from_table(log, info)
    known = replay.motion_of(log, info, reading, 0.0)
    if isinstance(known, Profile):
        return _from_profile(log, info, known, np.zeros(6) if latency is None else latency)
    if isinstance(known, Trajectory):
        return _from_trajectory(log, known)
    raise InputError(
        f"{log.path}: the reference is {info.reference!r}, not level, gravity, turned, or a file. Name one: --reference"
        " level|gravity|turned|FILE."
    )


def _levelled(log: Log, info: SessionInfo) -> Array:
    force = _calm_mean(log.samples.accel[log.samples.valid]) if log.samples.valid.any() else np.zeros(3)
    try:
        force = level_force(force, info.gravity_mps2)
    except InputError as error:
        raise InputError(
            f"{log.path}: {error}. If it is level: --reference level; else name how it stands: --reference FILE."
        ) from error
    try:
        return alignment.level_by_gravity(info.settings().site, force, 0.0).nav.C_nb
    except InputError as error:
        raise InputError(
            f"{log.path}: the mean specific force has magnitude {np.linalg.norm(force):.3f} m/s², gravity is"
            f" {info.gravity_mps2:.3f}: the unit does not stand still, a channel is dead, or units are wrong. Name how"
            " the table moves (--reference FILE), or import again with the right flags."
        ) from error


def _calm_mean(force: Array) -> Array:
    """Mean without wild samples, which the tracer will name."""
    calm = ~(np.abs(force - np.median(force, axis=0)) >= _WILD).any(axis=1)
    return np.asarray(force[calm].mean(axis=0) if calm.any() else force.mean(axis=0))


# --------------------------------------------------------------------------------------------------- a table's profile


def _from_profile(log: Log, info: SessionInfo, profile: Profile, latency: Array) -> Motion:
    t, settings = log.seconds(), info.settings()
    offset, how = 0.0, ""
    if profile.align == "gyro":
        use = log.samples.valid
        try:
            offset, sd = alignment.offset_of_profile(profile, t[use], log.samples.gyro[use])
        except InputError as error:
            raise InputError(f"{log.path}: {error}. Name the profile of this log: --reference FILE.") from error
        offset -= float(latency[:3].mean())
        reading = np.hstack([log.samples.gyro[use], log.samples.accel[use]])
        shift = alignment.shift_of_most(profile, t[use], offset, settings.site, reading, latency)
        offset += shift
        by = "found from the gyros" + (f", {1e3 * shift:+.1f} ms for most channels" if shift else "")
        how = f"the profile starts at {offset:.3f} ± {sd:.3f} s (1 sd) of the log, {by}"
    table = TableMotion(profile, settings.site, settings.spec, 1.0 / info.rate_hz, offset)
    for event in log.events:
        if event.name == "mark":
            table.mark(float(reader.seconds_since(event.stamp_ns, log.first_ns)), event.text)
    profile_t, rests, _ = table.joined(t)
    angles, rates = profile.angles(profile_t), profile.rates(profile_t)
    unknown = None
    if profile.align == "marks":
        if not rests.any():
            raise InputError(
                f'{log.path}: its profile is joined to the log by marks (align = "marks"), and the log has none that'
                ' fits. Join it by the gyros (align = "gyro") or from the first sample (align = "none"): --reference'
                " FILE."
            )
        unknown = ~rests
        how = "only dwells are used: a profile joined by marks does not say when the table moves"
    return _made(angles, rates, unknown, how)


# ------------------------------------------------------------------------ angles that a table's controller measured


def _from_states(log: Log, info: SessionInfo, reading: Reading) -> Motion:
    """Angles that the table's controller measured, joined at their own stamps; the sign is the profile's, if any."""
    known = replay.motion_of(log, info, reading, 0.0) if info.reference in ("profile", "trajectory") else None
    sign = np.array(known.sign if isinstance(known, Profile) else (1, 1, 1))
    t, states = log.seconds(), log.states
    seconds = reader.seconds_since(states.stamp_ns, log.first_ns)
    certain = _certain(seconds, states.uncertainty_ns)
    at, first = np.unique(seconds[certain], return_index=True)
    first = certain[first]
    measured = np.unwrap(np.deg2rad(states.angles_deg[first]) * sign, axis=0)
    angles, rates = measured_motion(at, measured, np.deg2rad(states.rates_dps[first]) * sign, t)
    near = np.searchsorted(at, t)
    between = at[np.clip(near, 0, at.size - 1)] - at[np.clip(near - 1, 0, at.size - 1)]
    unknown: NDArray[np.bool_] = (t < at[0]) | (t > at[-1]) | (between > _GAP_S)
    share = 1.0 - float(unknown.mean())
    if share < _MOSTLY:
        raise InputError(_mostly_unknown(log, share))
    how = "the table's angles are as its controller measured them"
    how += "" if share == 1.0 else f"; they are not known for {100.0 * (1.0 - share):.2f} % of the samples"
    return _made(angles, rates, unknown if unknown.any() else None, how)


def _certain(t: Array, uncertainty: NDArray[np.int_]) -> NDArray[np.int_]:
    """Numbers of measurements whose stamps are as certain as most are, and of the most certain one of each interval.

    An answer of a host that was held up came at an unknown time in between: at 90 deg/s 5 ms are half a degree.
    """
    good = uncertainty <= _CERTAIN * np.percentile(uncertainty, 25.0)
    interval = np.floor(t / _INTERVAL_S)
    order = np.lexsort((uncertainty, interval))
    good[order[np.diff(interval[order], prepend=np.nan) != 0.0]] = True
    return np.flatnonzero(good)


def measured_motion(at: Array, angles: Array, rates: Array, t: Array) -> tuple[Array, Array]:
    """Angles and rates at times `t` from measured ones, whose noise does not become noise of the rates.

    Between measurements angles are cubics that have the measured rates (Hermite), or monotone ones (PCHIP, Fritsch and
    Carlson 1980) of a controller whose rates are not those of its angles. On an even grid a cubic is fitted to a
    quarter of a second around each point (Savitzky and Golay 1964); its slope is the rate. Where an axis stands it has
    one angle, and rate zero.

    `at`: s, increasing, shape (M,); `angles`, `rates`: rad and rad/s, shape (M, 3); `t`: s, shape (N,).
    Returns angles and rates at `t`, shape (N, 3) each.
    """
    step = float(np.clip(np.median(np.diff(at)), *_STEPS_S))
    grid = at[0] + step * np.arange(max(2.0, np.ceil((at[-1] - at[0]) / step)) + 1)
    slopes, seconds = np.diff(angles, axis=0), np.diff(at)[:, None]
    off = slopes - 0.5 * (rates[1:] + rates[:-1]) * seconds
    agree = np.sum(off**2) <= _AGREE**2 * np.sum(slopes**2)
    joined = CubicHermiteSpline(at, angles, rates) if agree else PchipInterpolator(at, angles)
    even = np.asarray(joined(np.minimum(grid, at[-1])))
    width = max(_LEAST_WIDTH, round(_SMOOTHED_S / step) // 2 * 2 + 1)
    if grid.size > width:
        rough = even
        even = savgol_filter(rough, width, 3, axis=0)
        slope = savgol_filter(rough, width, 3, deriv=1, delta=step, axis=0)
        _stand(even, slope, rough, round(_STANDS_S / step))
    else:
        slope = np.gradient(even, step, axis=0)
    smooth = CubicHermiteSpline(grid, even, slope)
    inside = np.clip(t, grid[0], grid[-1])
    return np.asarray(smooth(inside)), np.asarray(smooth(inside, 1))


def _stand(angles: Array, rates: Array, rough: Array, least: int) -> None:
    """Give an axis one angle, in place, wherever it stands for `least` points."""
    for k in range(3):
        noise = 1.4826 * float(np.median(np.abs(np.diff(rough[:, k], 2)))) / np.sqrt(6.0)
        slow = np.abs(rates[:, k]) < _SLOW
        edges = np.flatnonzero(np.diff(np.r_[False, slow, False].astype(int)))
        for first, last in edges.reshape(-1, 2).tolist():
            if last - first < least:
                continue
            rest = slice(first, last)
            near = np.abs(angles[rest, k] - np.median(angles[rest, k])) < max(_STANDS, 4.0 * noise)
            where = first + np.flatnonzero(near)
            angles[where, k] = rough[where, k].mean()
            rates[where, k] = 0.0


# -------------------------------------------------------------------------------------------- a table's recorded angles


def _from_table(log: Log, info: SessionInfo) -> Motion:
    """Angles as the log has them: those of an imported recording hold until they change; others are joined by lines."""
    table, t = log.table, log.seconds()
    if np.array_equal(table.stamp_ns, log.samples.stamp_ns):
        angles, rates = np.deg2rad(table.angles_deg), np.deg2rad(table.rates_dps)
    elif info.sampling == _IMPORTED:
        row = np.maximum(np.searchsorted(table.stamp_ns, log.samples.stamp_ns, side="right") - 1, 0)
        angles, rates = np.deg2rad(table.angles_deg[row]), np.deg2rad(table.rates_dps[row])
    else:
        at = reader.seconds_since(table.stamp_ns, log.first_ns)
        angles = _lines(t, at, np.deg2rad(table.angles_deg), turns=True)
        rates = np.full_like(angles, np.nan)
    return _completed(log, t, angles, rates)


def _from_trajectory(log: Log, known: Trajectory) -> Motion:
    rows: NDArray[np.bool_] = np.asarray(np.isfinite(known.values[:, 6:9]).all(axis=1))
    if not rows.any():
        raise InputError(
            f"{log.path}: its trajectory has no attitude (roll, pitch, yaw are empty), and tracing needs the attitude"
            " at each sample. Trace a part at rest with --reference gravity, or import with arrays `ang` or `ref_quat`,"
            " or name a table profile: --reference FILE."
        )
    if np.count_nonzero(rows) < 2:
        raise InputError(
            f"{log.path}: its trajectory has one row of attitude. Of a unit at rest: --reference level|gravity."
        )
    if _stays(known):
        return _from_turns(log, known, rows)
    return _from_attitudes(log, known.t[rows], attitude.from_rpys(known.values[rows, 6:9]))


def _stays(known: Trajectory) -> bool:
    """Whether a trajectory says that the unit turns in one place: its velocity is known, and zero, in every row."""
    velocity = known.values[:, 3:6]
    return bool(np.isfinite(velocity).all() and np.abs(velocity).max() <= _NO_SPEED)


def _from_turns(log: Log, known: Trajectory, rows: NDArray[np.bool_]) -> Motion:
    """A trajectory of a unit that turns in one place, as a table's angles; those of other units where it can't be."""
    t, at = log.seconds(), known.t[rows]
    # roll, pitch, yaw turn about the same axes in the other order: Rz Ry Rx is the transpose of Rx(-) Ry(-) Rz(-)
    own = kinematics.angles_of(kinematics.attitudes(-known.values[rows, 6:9]).transpose(0, 2, 1))
    if np.abs(np.cos(own[:, 1])).min() < _GIMBAL:
        return _from_attitudes(log, at, attitude.from_rpys(known.values[rows, 6:9]), carried=False)
    angles = _lines(t, at, own, turns=True)
    # farther from a row than three of their steps, nobody knows the attitude
    step = float(np.median(np.diff(at)))
    angles[_distance(t, at) > 3.0 * step + t[-1] / t.size] = np.nan
    return _completed(log, t, angles, np.full_like(angles, np.nan))


def _from_attitudes(log: Log, at: Array, C_nb: Array, *, carried: bool = True) -> Motion:
    """Motion of a unit of which only the attitude is known, such as by an optical reference.

    Where it moves, nothing says what specific force acts on it, if it may be carried; at rest gravity does.
    """
    t = log.seconds()
    known = attitude_rows.at_samples(t, at, C_nb)
    share = 1.0 - float(known.unknown.mean())
    if share < _MOSTLY:
        raise InputError(_mostly_unknown(log, share))
    stretches = attitude_rows.rests(t, log.samples.gyro, log.samples.accel, known)
    known = attitude_rows.at_rest(known, stretches)
    rest = np.zeros(t.size, bool)
    for first, last in stretches.tolist():
        rest[first:last] = True
    said = [] if share == 1.0 else [f"the attitude is not known for {100.0 * (1.0 - share):.2f} % of the samples"]
    if carried:
        seconds = float(rest.mean()) * float(t[-1])
        said.append(
            f"accelerometers are used at rest only ({seconds:.0f} of {t[-1]:.0f} s): the reference says how the unit is"
            " turned, not how it is carried"
        )
    return Motion(
        np.zeros((t.size, 3)),
        known.rate,
        None,
        known.unknown if known.unknown.any() else None,
        "; ".join(said),
        known.quaternion,
        ~rest if carried else None,
    )


def _completed(log: Log, t: Array, angles: Array, rates: Array) -> Motion:
    """Angles without gaps, which are marked as unknown, and rates from them where there are none of their own."""
    known: NDArray[np.bool_] = np.asarray(np.isfinite(angles).all(axis=1))
    if known.mean() < _MOSTLY:
        raise InputError(_mostly_unknown(log, float(known.mean())))
    angles = np.unwrap(angles, axis=0) if known.all() else _lines(t, t[known], angles[known], turns=True)
    told = np.isfinite(rates)
    if not told.all():
        rates = np.where(told, rates, np.gradient(angles, t, axis=0) if t.size > 1 else 0.0)
    unknown = None if known.all() else ~known
    how = "" if known.all() else f"the attitude is not known for {100.0 * (1.0 - known.mean()):.2f} % of the samples"
    return _made(angles, rates, unknown, how)


def _mostly_unknown(log: Log, share: float) -> str:
    return (
        f"{log.path}: the attitude is known for {100.0 * share:.0f} % of the samples; tracing needs most of them. Take"
        " the part where it is known when importing (--start, --end), or name a reference: --reference"
        " level|gravity|FILE."
    )


def _made(angles: Array, rates: Array, unknown: NDArray[np.bool_] | None, how: str) -> Motion:
    rest = rest_attitudes(angles)
    if len(rest) == 1 and not rates.any():
        return Motion(rest, np.zeros((1, 3)), None, unknown, how)
    # unmoving angles of one axis beside moving rates contradict each other; that is for who compares them with readings
    return Motion(np.unwrap(angles, axis=0), rates, None, unknown, how)


def _lines(t: Array, at: Array, values: Array, *, turns: bool) -> Array:
    """Straight lines through rows of values, shape (N, 3); angles by the short way round."""
    whole = np.isfinite(values).all(axis=1)
    values = np.unwrap(values[whole], axis=0) if turns else values[whole]
    return np.stack([np.interp(t, at[whole], column) for column in values.T], axis=1)


def _distance(t: Array, at: Array) -> Array:
    """From each time to the nearest of others, s."""
    after = np.clip(np.searchsorted(at, t), 1, at.size - 1) if at.size > 1 else np.zeros(t.size, np.int64)
    before = np.maximum(after - 1, 0)
    return np.asarray(np.minimum(np.abs(t - at[before]), np.abs(t - at[after])))

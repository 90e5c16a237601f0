"""From a log to a run: readings in the instrument's axes and sign, temperature, and what is known of the motion.

Samples that the log flags as no reading (a count at its limit) stay in and are flagged.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from filters import specification
from filters.errors import InputError
from filters.imu import AxisMap
from filters.tracing.run import Run
from filters.types import Array
from imutui.instrument import registry
from imutui.jobs import replay
from imutui.jobs.log_motion import motion_of
from imutui.logbook import reader
from imutui.logbook.reader import Log
from imutui.logbook.session_info import SessionInfo

_SHORTEST_S = 60.0
_AT_ONCE = 1 << 18


@dataclass(frozen=True, slots=True)
class LoggedRun:
    """A log that was read for tracing."""

    path: Path
    info: SessionInfo  # its session, with the reference in force
    run: Run  # its samples
    finished: bool  # whether the file has its footer
    damage: str  # what is wrong with the file, if anything
    how: str  # how the motion is known, where that is worth a word
    first_ns: int  # its first sampling instant, UTC, ns
    sha256: str  # of the file


def read_run(path: Path, name: str, options: replay.ReplayOptions, shortest: float = _SHORTEST_S) -> LoggedRun:
    """Read a log as one run.

    `options`: reference and overrides of the session.
    `shortest`: least length, s: what tracing needs.
    Raises UnreadableLogError if there is nothing to read.
    Raises InputError if it is too short, or its motion is not known.
    """
    log = reader.read(path)
    t = log.seconds()
    if t[-1] < shortest:
        raise InputError(
            f"{path} lasts {t[-1]:.1f} s; tracing needs at least {shortest:.0f} s, better half an hour a run with"
            " the unit warming up. Record a longer one."
        )
    info = replay.session_of(log, options)
    axes = info.axes()
    lsb, bandwidth, latency = _figures(info) if log.own else (None, None, np.zeros(6))
    motion = motion_of(log, info, options, float(latency[:3].mean()))
    reading = _reading(log, axes)
    lacks = np.isnan(reading).all(axis=0)
    reading[:, lacks] = 0.0
    bad = ~log.valid if motion.unknown is None else ~log.valid | motion.unknown
    flagged = None
    if bad.any() or lacks.any() or motion.carried is not None:
        flagged = np.repeat(bad[:, None], 6, axis=1)
        if motion.carried is not None:
            flagged[:, 3:] |= motion.carried[:, None]
        flagged[:, lacks] = True
    run = Run(
        name,
        t,
        reading,
        _temperature(log, t),
        motion.angles,
        motion.rates,
        axes,
        info.settings().site,
        motion.C_nb,
        lsb,
        bandwidth,
        latency,
        flagged if flagged is not None and flagged.any() else None,
        averaged=info.sampling == "stream",
        attitude=motion.attitude,
        unread=tuple(np.flatnonzero(lacks).tolist()),
    )
    return LoggedRun(path, info, run, log.finished, log.damage, motion.how, int(log.stamp_ns[0]), reader.sha256(path))


def _reading(log: Log, axes: AxisMap) -> Array:
    """Readings in the instrument's axes, SI, shape (N, 6); the log's own are given up, of a day half a gigabyte.

    From the end on, each part as soon as it is copied: both at once would be what a trace needs most.
    """
    reading = np.empty((log.stamp_ns.size, 6))
    gyro, accel = (x if x.flags.owndata else x.copy() for x in (log.gyro, log.accel))
    log.gyro, log.accel = np.empty((0, 3)), np.empty((0, 3))
    for first in reversed(range(0, len(reading), _AT_ONCE)):
        reading[first : first + _AT_ONCE, :3] = axes.gyro_to_instrument(gyro[first:])
        reading[first : first + _AT_ONCE, 3:] = axes.accel_to_instrument(accel[first:])
        gyro.resize((first, 3), refcheck=False)
        accel.resize((first, 3), refcheck=False)
    return reading


def _temperature(log: Log, t: Array) -> Array | None:
    """Temperature at the samples by straight lines between the messages, degC; None if the log has none.

    In parts: a day has as many messages as samples.
    """
    stamps, values = log.temperature_stamp_ns, log.temperature_degc
    known = np.isfinite(values)
    if not known.any():
        return None
    if not known.all():
        stamps, values = stamps[known], values[known]
    if (stamps[1:] < stamps[:-1]).any():
        order = np.argsort(stamps, kind="stable")
        stamps, values = stamps[order], values[order]
    out, origin = np.empty(t.size), int(log.stamp_ns[0])
    for first in range(0, t.size, _AT_ONCE):
        rows = slice(first, first + _AT_ONCE)
        ends = np.array([t[rows].min(), t[rows].max()]) * 1e9 + origin
        low, high = np.searchsorted(stamps, ends)
        near = slice(max(0, int(low) - 2), int(high) + 2)
        out[rows] = np.interp(t[rows], reader.seconds_since(stamps[near], origin), values[near])
    return out


def _figures(info: SessionInfo) -> tuple[Array | None, Array | None, Array]:
    """Size of a count (SI), band limits (Hz) and latencies (s) of the six channels, as far as the unit is known."""
    if info.sampling == "imported" or not registry.is_known(info.instrument):
        return None, None, np.zeros(6)
    instrument, spec = registry.of_model(info.instrument), specification.of_model(info.instrument)
    scaling = instrument.scaling(info.rate_range_dps, info.accel_range_g)
    lsb = np.repeat([np.deg2rad(float(scaling.rates_dps(1))), float(scaling.accels_g(1)) * info.g_unit], 3)
    loop_hz = instrument.low_pass_loop_hz
    if loop_hz is None:
        return lsb, None, np.zeros(6)
    bandwidth = np.repeat([spec.gyro_bandwidth, spec.accel_bandwidth], 3)
    # the first-order filter that the unit runs once a loop, y += (1 - p) (x - y): a ramp comes out p/(1 - p) loops late
    p = np.exp(-2.0 * np.pi * bandwidth / loop_hz)
    return lsb, bandwidth, p / (1.0 - p) / loop_hz

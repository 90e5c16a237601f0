"""White noise and drift of a log's own samples, for a filter that is to expect these instead of a data sheet's."""

import numpy as np

from filters.errors import InputError
from filters.imu import Noise
from filters.kalman.settings import GAP_PERIODS
from imutui.jobs.replay_input import Part
from imutui.logbook.session_info import SessionInfo


def measured(info: SessionInfo, part: Part) -> Noise:
    """White noise and drift of the samples themselves, by Allan deviation, from the longest stretch without a gap.

    Raises InputError if the unit moves by its reference, or the log is too short.
    """
    if info.reference not in ("level", "gravity"):
        raise InputError(
            f'`noise` is "log" with reference "{info.reference}": noise is measured on a unit at rest. Measure it on a'
            " still log, or leave filter.noise at table1."
        )
    period = 1.0 / info.rate_hz
    breaks = np.flatnonzero(np.diff(part.t) > GAP_PERIODS * period) + 1
    # bursts of a host's stamps are no gaps in the samples
    if breaks.size > 0.001 * part.t.size:
        breaks = breaks[:0]
    edges = np.concatenate([[0], breaks, [part.t.size]])
    longest = int(np.argmax(np.diff(edges)))
    piece = slice(edges[longest], edges[longest + 1])
    # its fit brings solvers along that no other replay needs
    from filters import allan

    levels = allan.noise_of(np.column_stack([part.accel[piece], part.gyro[piece]]), period)
    white, drift = (_like_the_others(each, part.unread).tolist() for each in (levels.white, levels.drift))
    return Noise(tuple(white[:3]), tuple(white[3:]), tuple(drift[:3]), tuple(drift[3:]))


def _like_the_others(levels: np.ndarray, unread: tuple[bool, ...]) -> np.ndarray:
    """Levels of six channels; one that was not read has no noise of its own, and gets the most of its kind."""
    if not unread:
        return levels
    kinds = np.where(unread, 0.0, levels).reshape(2, 3)
    return np.where(unread, np.repeat(kinds.max(axis=1), 3), levels)

"""Channels that a recording lacks: NaN throughout. They stay NaN in the log, and are left out of everything."""

import numpy as np

from filters.channels import CHANNELS
from filters.imu import AxisMap


def unread(gyro: np.ndarray, accel: np.ndarray) -> np.ndarray:
    """Which channels are NaN throughout, gyros first, bool, shape (6,); readings of shape (N, 3) each."""
    return np.concatenate([np.isnan(values).all(axis=0) for values in (gyro, accel)])


def in_instrument_axes(of_body: np.ndarray, axes: AxisMap) -> np.ndarray:
    """The same of channels in body axes, bool, shape (6,), told in the instrument's."""
    return np.concatenate([axes.sd_to_instrument(part.astype(float)) > 0.5 for part in (of_body[:3], of_body[3:])])


def names(unread_ones: np.ndarray) -> tuple[str, ...]:
    """Names of channels by a mask, shape (6,)."""
    return tuple(name for name, lacks in zip(CHANNELS, unread_ones.tolist(), strict=True) if lacks)

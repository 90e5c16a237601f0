"""Channel health of a log: its packets at their full rate, or its samples where it has no packets."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from filters.health.monitor import HealthMonitor
from imutui.instrument.registry import of_model
from imutui.jobs.replay_input import Part
from imutui.logbook import health, reader
from imutui.logbook.pieces import ROWS
from imutui.logbook.reader import seconds_since
from imutui.logbook.session_info import SessionInfo


def has_packets(info: SessionInfo) -> bool:
    """Whether a log of this session holds packets."""
    return info.sampling in ("stream", "polled")


class PacketHealth:
    """Feeds a log's packets to a monitor of channel health, as the acquisition did."""

    def __init__(self, info: SessionInfo) -> None:
        scaling = of_model(info.instrument).scaling(info.rate_range_dps, info.accel_range_g)
        self._readings = health.Readings(scaling, info.g_unit)
        self.monitor = HealthMonitor(health.expected(info, self._readings.lsb))
        self._first_ns: int | None = None

    def add(self, stamps_ns: np.ndarray, packets: np.ndarray) -> None:
        """Take packets: sampling instants, UTC, ns, (N,), and records of `schemas.RAW_DTYPE`, (N,)."""
        if not stamps_ns.size:
            return
        self._first_ns = int(stamps_ns[0]) if self._first_ns is None else self._first_ns
        # counts of temperature below zero travel as words without a sign
        counts = np.column_stack([packets["counts"], packets["temperature"].astype(np.int16)])
        self.monitor.add(seconds_since(stamps_ns, self._first_ns), *self._readings.of(counts))


class SampleHealth:
    """Feeds samples to a monitor of channel health."""

    def __init__(self, info: SessionInfo) -> None:
        self._axes = info.axes()
        self.monitor = HealthMonitor(health.expected(info, None))

    def add(self, t: np.ndarray, gyro: np.ndarray, accel: np.ndarray, degc: np.ndarray) -> None:
        """Take samples: s (N,), rad/s and m/s² in body axes (N, 3), degC (N,)."""
        self.monitor.add(t, self._axes.gyro_to_instrument(gyro), self._axes.accel_to_instrument(accel), degc)

    def seen(self, parts: Iterable[Part]) -> Iterator[Part]:
        """Yield parts as they come; channels that the log lacks count as not read."""
        for part in parts:
            gyro, accel = part.gyro, part.accel
            if part.unread:
                lacks = np.array(part.unread)
                accel, gyro = np.where(lacks[:3], np.nan, accel), np.where(lacks[3:], np.nan, gyro)
            self.add(part.t, gyro, accel, part.temperature)
            yield part


def of_packets(path: Path, info: SessionInfo, first_ns: int | None, last_ns: int | None) -> HealthMonitor:
    """Return a monitor that has had the packets of a log from one instant to another, UTC, ns; None for no bound."""
    fed = PacketHealth(info)
    for part in reader.parts(path, ROWS, raw=True):
        stamps, packets = part.packet_stamp_ns, part.packets
        if first_ns is not None or last_ns is not None:
            least, most = np.iinfo(np.int64).min, np.iinfo(np.int64).max
            use = (stamps >= (least if first_ns is None else first_ns)) & (
                stamps <= (most if last_ns is None else last_ns)
            )
            stamps, packets = stamps[use], packets[use]
        fed.add(stamps, packets)
    return fed.monitor

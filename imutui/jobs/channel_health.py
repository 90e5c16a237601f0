"""Channel health of a log: of its packets at their full rate, or of its samples where it has no packets."""

from pathlib import Path

import numpy as np

from filters.health.finding import HealthEntry
from filters.health.monitor import HealthMonitor
from imutui.instrument.registry import of_model
from imutui.logbook import health, pieces, reader
from imutui.logbook.reader import seconds_since
from imutui.logbook.reading import Reading
from imutui.logbook.samples import Samples
from imutui.logbook.session_info import SessionInfo

EARLIEST_NS, LATEST_NS = -(2**63), 2**63 - 1  # bounds that leave nothing out


class LogHealth:
    """Feeds a log, a part at a time, to the monitor that the acquisition feeds."""

    def __init__(self, info: SessionInfo) -> None:
        self._axes = info.axes()
        self._of_packets: health.Readings | None = None
        if info.sampling in ("stream", "polled"):
            scaling = of_model(info.instrument).scaling(info.rate_range_dps, info.accel_range_g)
            self._of_packets = health.Readings(scaling, info.g_unit)
        self._monitor = HealthMonitor(health.expected(info, None if self._of_packets is None else self._of_packets.lsb))
        self._first_ns: int | None = None

    def packets(self, stamps_ns: np.ndarray, packets: np.ndarray) -> None:
        """Take packets: sampling instants, UTC, ns, (N,), and records of `schemas.RAW_DTYPE`, (N,)."""
        if self._of_packets is None or not stamps_ns.size:
            return
        # counts of temperature below zero travel as words without a sign
        counts = np.column_stack([packets["counts"], packets["temperature"].astype(np.int16)])
        self._add(stamps_ns, *self._of_packets.of(counts))

    def samples(self, samples: Samples) -> None:
        """Take samples, where the log has no packets."""
        if self._of_packets is None and samples.valid.any():
            used = samples.rows(samples.valid)
            gyro, accel = self._axes.gyro_to_instrument(used.gyro), self._axes.accel_to_instrument(used.accel)
            self._add(used.stamp_ns, gyro, accel, used.degc)

    def _add(self, stamps_ns: np.ndarray, gyro: np.ndarray, accel: np.ndarray, degc: np.ndarray) -> None:
        self._first_ns = int(stamps_ns[0]) if self._first_ns is None else self._first_ns
        self._monitor.add(seconds_since(stamps_ns, self._first_ns), gyro, accel, degc)

    def entries(self, bias_sd: np.ndarray | None = None, *, moving: bool = True) -> list[HealthEntry]:
        """Faults found; the arguments are those of `HealthMonitor.findings`."""
        return health.entries(self._monitor.findings(bias_sd, moving=moving, final=True))


def of_log(
    path: Path, info: SessionInfo, reading: Reading, first_ns: int = EARLIEST_NS, last_ns: int = LATEST_NS
) -> LogHealth:
    """Return the health of a log's channels from one instant to another, UTC, ns."""
    found = LogHealth(info)
    for part in reader.parts(path, pieces.ROWS, raw=True, reading=reading):
        use, used = (
            (stamps >= first_ns) & (stamps <= last_ns) for stamps in (part.packet_stamp_ns, part.samples.stamp_ns)
        )
        found.packets(part.packet_stamp_ns[use], part.packets[use])
        found.samples(part.samples.rows(used))
    return found

"""Numbers for the screen: the last packets in a ring, with mean and standard deviation; instrument axes and signs."""

import numpy as np

from filters import imu
from imutui.instrument.counts import DataPacket, Scaling
from imutui.session.snapshot import ChannelSnapshot, SeriesSnapshot

CHANNELS = (*imu.CHANNELS, "T")
UNITS = ("deg/s", "deg/s", "deg/s", "mg", "mg", "mg", "degC")
STATISTICS_S = 10.0
_SERIES_S = 30.0
_CAPACITY = 8192
_MAX_ROWS = 4000


class RecentPackets:
    """Keeps the last minute of packets.

    `scaling`: ranges of the unit.
    """

    def __init__(self, scaling: Scaling) -> None:
        self._scaling = scaling
        self._t = np.zeros(_CAPACITY)
        self._values = np.zeros((_CAPACITY, 7))
        self._counts = np.zeros(7, int)
        self.count = 0
        self._interrupted_at = 0
        self._interrupted = False

    def interrupt(self) -> None:
        """Take note that the next packets do not belong with those before: statistics begin anew with them."""
        self._interrupted = True

    def _recent(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and values that statistics are made of: the last 10 s, as far as they belong together."""
        t, values = self._last(self.count - self._interrupted_at)
        recent = t >= (t[-1] if t.size else 0.0) - STATISTICS_S
        return t[recent], values[recent]

    def add(self, t: float, packet: DataPacket) -> None:
        """Take a packet, and the seconds since start at which it was sampled."""
        if self._interrupted:
            self._interrupted_at, self._interrupted = self.count, False
        slot = self.count % _CAPACITY
        self._t[slot] = t
        values = self._values[slot]
        values[:3] = self._scaling.rates_dps(packet.rates)
        values[3:6] = self._scaling.accels_g(packet.accels) * 1e3
        values[6] = self._scaling.temperature_degc(packet.temperature)
        self._counts[:] = *packet.rates, *packet.accels, packet.temperature
        self.count += 1

    def _last(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        n = min(n, self.count, _CAPACITY)
        slots = np.arange(self.count - n, self.count) % _CAPACITY
        return self._t[slots], self._values[slots]

    def channels(self) -> list[ChannelSnapshot]:
        """Newest counts and value of each channel, and mean, sd, least and largest over the last 10 s."""
        _, recent = self._recent()
        if not len(recent):
            return []
        mean = recent.mean(axis=0)
        sd = recent.std(axis=0, ddof=1) if len(recent) > 1 else np.full(7, np.nan)
        low, high = recent.min(axis=0), recent.max(axis=0)
        return [
            {
                "name": name,
                "counts": int(self._counts[i]),
                "value": float(recent[-1, i]),
                "unit": unit,
                "mean": float(mean[i]),
                "sd": float(sd[i]) if np.isfinite(sd[i]) else None,
                "min": float(low[i]),
                "max": float(high[i]),
            }
            for i, (name, unit) in enumerate(zip(CHANNELS, UNITS, strict=True))
        ]

    def rates_dps(self) -> np.ndarray | None:
        """Mean of the rate sensors over the last 10 s, deg/s, shape (3,); None without packets."""
        _, recent = self._recent()
        return np.asarray(recent[:, :3].mean(axis=0)) if len(recent) else None

    def accels_g(self) -> np.ndarray | None:
        """Mean of the accelerometers over the last 10 s, g, shape (3,); None without packets."""
        _, recent = self._recent()
        return np.asarray(recent[:, 3:6].mean(axis=0)) / 1e3 if len(recent) else None

    def rate_hz(self) -> float | None:
        """Packets a second over the last 10 s."""
        t, _ = self._recent()
        return float((t.size - 1) / (t[-1] - t[0])) if t.size > 2 else None

    def series(self, since: int) -> SeriesSnapshot:
        """Packets from number `since` on, at most the last 30 s."""
        t, values = self._last(min(self.count - max(since, 0), _MAX_ROWS))
        if t.size:
            keep = t >= t[-1] - _SERIES_S
            t, values = t[keep], values[keep]
        return {"next": self.count, "t": np.round(t, 4).tolist(), "values": np.round(values, 5).tolist()}

"""Numbers for the screen: the last packets in a ring, with mean and standard deviation; instrument axes and signs."""

import numpy as np

from imutui.instrument.counts import Scaling
from imutui.session.channel_statistics import NAMES, UNITS
from imutui.session.snapshot import ChannelSnapshot, SeriesSnapshot

STATISTICS_S = 10.0
_SERIES_S = 30.0
_CAPACITY = 8192
_MAX_ROWS = 4000


class RecentPackets:
    """Keeps the last minute of packets."""

    def __init__(self, scaling: Scaling) -> None:
        self._scaling = scaling
        self._t = np.zeros(_CAPACITY)
        self._counts = np.zeros((_CAPACITY, 7), int)
        self.count = 0
        self._interrupted_at = 0
        self._interrupted = False

    def interrupt(self) -> None:
        """Take note that the next packets do not belong with those before: statistics begin anew with them."""
        self._interrupted = True

    def _recent(self) -> np.ndarray:
        """Places of what statistics are made of: the last 10 s, as far as they belong together."""
        slots = self._last(self.count - self._interrupted_at)
        return slots[self._t[slots] >= self._t[slots[-1]] - STATISTICS_S] if slots.size else slots

    def add(self, t: np.ndarray, counts: np.ndarray) -> None:
        """Take packets: seconds since start at which each was sampled, (N,), and its readings, (N, 7)."""
        if self._interrupted:
            self._interrupted_at, self._interrupted = self.count, False
        slots = np.arange(self.count, self.count + t.size)[-_CAPACITY:] % _CAPACITY
        self._t[slots], self._counts[slots] = t[-_CAPACITY:], counts[-_CAPACITY:]
        self.count += t.size

    def _last(self, n: int) -> np.ndarray:
        return np.arange(self.count - min(n, self.count, _CAPACITY), self.count) % _CAPACITY

    def _values(self, slots: np.ndarray) -> np.ndarray:
        counts, values = self._counts[slots], np.empty((slots.size, 7))
        values[:, :3] = self._scaling.rates_dps(counts[:, :3])
        values[:, 3:6] = self._scaling.accels_g(counts[:, 3:6]) * 1e3
        values[:, 6] = self._scaling.temperature_degc(counts[:, 6])
        return values

    def channels(self) -> list[ChannelSnapshot]:
        """Newest counts and value of each channel, and mean, sd, least and largest over the last 10 s."""
        recent = self._values(self._recent())
        if not len(recent):
            return []
        mean = recent.mean(axis=0)
        sd = recent.std(axis=0, ddof=1) if len(recent) > 1 else np.full(7, np.nan)
        low, high, newest = recent.min(axis=0), recent.max(axis=0), self._counts[(self.count - 1) % _CAPACITY]
        return [
            {
                "name": name,
                "counts": int(newest[i]),
                "value": float(recent[-1, i]),
                "unit": unit,
                "mean": float(mean[i]),
                "sd": float(sd[i]) if np.isfinite(sd[i]) else None,
                "min": float(low[i]),
                "max": float(high[i]),
            }
            for i, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
        ]

    def mean(self) -> np.ndarray | None:
        """Mean of each channel over the last 10 s, in `UNITS`, shape (7,); None without packets."""
        recent = self._values(self._recent())
        return np.asarray(recent.mean(axis=0)) if len(recent) else None

    def rate_hz(self) -> float | None:
        """Packets a second over the last 10 s."""
        t = self._t[self._recent()]
        return float((t.size - 1) / (t[-1] - t[0])) if t.size > 2 else None

    def series(self, since: int) -> SeriesSnapshot:
        """Packets from number `since` on, at most the last 30 s."""
        slots = self._last(min(self.count - max(since, 0), _MAX_ROWS))
        if slots.size:
            slots = slots[self._t[slots] >= self._t[slots[-1]] - _SERIES_S]
        rows = np.round(self._values(slots), 5)
        return {"next": self.count, "t": np.round(self._t[slots], 4).tolist(), "values": rows.tolist()}

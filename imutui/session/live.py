"""Numbers for the screen: the last packets in a ring, with mean and standard deviation; instrument axes and signs."""

from typing import Any

import numpy as np

CHANNELS = ("gx", "gy", "gz", "ax", "ay", "az", "T")
UNITS = ("deg/s", "deg/s", "deg/s", "mg", "mg", "mg", "degC")
STATISTICS_S = 10.0
_SERIES_S = 30.0
_CAPACITY = 8192
_MOST_ROWS = 4000


class LiveView:
    """Keeps the last minute of packets."""

    def __init__(self) -> None:
        self._t = np.zeros(_CAPACITY)
        self._values = np.zeros((_CAPACITY, 7))
        self._counts = np.zeros(7, int)
        self.count = 0

    def add(self, t: float, counts: tuple[int, ...], values: np.ndarray) -> None:
        """Take a packet: seconds since start, seven counts, seven values in `UNITS`."""
        slot = self.count % _CAPACITY
        self._t[slot] = t
        self._values[slot] = values
        self._counts = np.array(counts)
        self.count += 1

    def _last(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        n = min(n, self.count, _CAPACITY)
        slots = np.arange(self.count - n, self.count) % _CAPACITY
        return self._t[slots], self._values[slots]

    def channels(self) -> list[dict[str, Any]]:
        """Newest counts and value of each channel, and mean and sd over the last 10 s."""
        if not self.count:
            return []
        t, values = self._last(_CAPACITY)
        recent = values[t >= t[-1] - STATISTICS_S]
        mean = recent.mean(axis=0)
        sd = recent.std(axis=0, ddof=1) if len(recent) > 1 else np.full(7, np.nan)
        return [
            {
                "name": name,
                "counts": int(self._counts[i]),
                "value": float(values[-1, i]),
                "unit": unit,
                "mean": float(mean[i]),
                "sd": float(sd[i]) if np.isfinite(sd[i]) else None,
            }
            for i, (name, unit) in enumerate(zip(CHANNELS, UNITS, strict=True))
        ]

    def rate_hz(self) -> float | None:
        """Packets a second over the last 10 s."""
        t, _ = self._last(_CAPACITY)
        recent = t[t >= t[-1] - STATISTICS_S] if t.size else t
        return float((recent.size - 1) / (recent[-1] - recent[0])) if recent.size > 2 else None

    def series(self, since: int) -> dict[str, Any]:
        """Packets from number `since` on, at most the last 30 s."""
        t, values = self._last(min(self.count - max(since, 0), _MOST_ROWS))
        if t.size:
            keep = t >= t[-1] - _SERIES_S
            t, values = t[keep], values[keep]
        return {"next": self.count, "t": np.round(t, 4).tolist(), "values": np.round(values, 5).tolist()}

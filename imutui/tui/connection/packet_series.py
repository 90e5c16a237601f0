"""The packets that plots show: a growing series with a bounded past, whose last seconds are one contiguous view."""

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating]
CHANNELS = 7  # values of a packet: three rates, three accelerometers, temperature
TEMPERATURE = CHANNELS - 1  # column of the temperature


class PacketSeries:
    """Instants and rows of values of the packets that came.

    `capacity`: rows kept; half an hour of packets by default.
    """

    def __init__(self, columns: int, capacity: int = 1 << 18) -> None:
        self.capacity = capacity
        self._t = np.zeros(2 * capacity)
        self._values = np.zeros((2 * capacity, columns), np.float32)
        self._end = 0

    def __len__(self) -> int:
        return min(self._end, self.capacity)

    def extend(self, t: Floats, values: Floats) -> None:
        """Append rows; what is not later than the newest row starts the series anew (another run)."""
        t, values = t[-self.capacity :], values[-self.capacity :]
        if not t.size:
            return
        if self._end and t[0] < self._t[self._end - 1]:
            self._end = 0
        if self._end + t.size > self._t.size:
            keep = slice(self._end - self.capacity, self._end)
            self._t[: self.capacity] = self._t[keep]
            self._values[: self.capacity] = self._values[keep]
            self._end = self.capacity
        new = slice(self._end, self._end + t.size)
        self._t[new], self._values[new] = t, values
        self._end += t.size

    def last(self, seconds: float) -> tuple[Floats, Floats]:
        """Instants (N,) and values (N, columns) of the last seconds: views, not copies."""
        start = max(self._end - self.capacity, 0)
        t = self._t[start : self._end]
        if t.size:
            start += int(np.searchsorted(t, t[-1] - seconds))
        return self._t[start : self._end], self._values[start : self._end]

    def frozen(self) -> "PacketSeries":
        t, values = self.last(np.inf)
        copy = PacketSeries(values.shape[1], max(t.size, 1))
        copy.extend(t, values)
        return copy

    def slope_per_minute(self, column: int, seconds: float = 60.0) -> float | None:
        """Straight line through the last seconds of a column; None before half of them have come."""
        t, values = self.last(seconds)
        if t.size < 3 or t[-1] - t[0] < seconds / 2:
            return None
        centred = t - t.mean()
        return float(60.0 * (centred @ values[:, column]) / (centred @ centred))

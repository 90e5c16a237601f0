"""The virtual unit's own loop: when it samples, in either mode, on a grid that begins with the first request."""

import math

from imutui.instrument.imu400.messages import Mode
from imutui.instrument.imu400.unit_options import UnitOptions
from imutui.instrument.transmitter import SAME_INSTANT_S


class SamplingLoop:
    """Numbers and instants of samples. Each mode has a rate, hence numbers, of its own; both begin together."""

    def __init__(self, options: UnitOptions) -> None:
        self._hz = {Mode.SCALED: options.loop_hz, Mode.VOLTAGE: options.loop_hz_voltage}
        self._start = math.inf  # not begun

    @property
    def has_begun(self) -> bool:
        """Whether it has."""
        return self._start < math.inf

    def begin(self, now: float) -> None:
        """Begin, if it has not."""
        self._start = min(self._start, now)

    def instant(self, sample: int, mode: Mode) -> float:
        """When a sample is taken: a product, so that no rounding piles up."""
        return self._start + sample / self._hz[mode]

    def newest(self, now: float, mode: Mode) -> int:
        """Sample that was taken last; -1 if none was."""
        if now == -math.inf:
            return -1
        return math.floor((now - self._start + SAME_INSTANT_S) * self._hz[mode])

    def last_before(self, now: float, mode: Mode) -> int:
        """Sample before the first one that is taken from `now` on."""
        newest = self.newest(now, mode)
        return newest - 1 if self.instant(newest, mode) >= now - SAME_INSTANT_S else newest

    def reading(self, sample: int, mode: Mode) -> int:
        """Number of a sample as the source counts: in scaled mode's."""
        return math.floor((sample / self._hz[mode] + SAME_INSTANT_S) * self._hz[Mode.SCALED])

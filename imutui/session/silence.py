"""Whether the unit has fallen silent, or speaks again."""

_LEAST_S = 1.0
_PERIODS = 3.0


class SilenceMonitor:
    """Notices when packets stop coming, and when they come again.

    Parameters
    ----------
    period_s : float
        Of the packets that are asked for one by one; 0 for a unit that streams.
    """

    def __init__(self, period_s: float) -> None:
        self._limit_s = max(_LEAST_S, _PERIODS * period_s)
        self._silent = False

    def check(self, silence_s: float, *, expected: bool) -> bool | None:
        """Look at how long there was no packet.

        Parameters
        ----------
        silence_s : float
            Since the last one.
        expected : bool
            Whether the silence is asked for, and therefore none.

        Returns
        -------
        bool or None
            True if the unit has fallen silent since the last look, False if it speaks again, None if nothing changed.
        """
        silent = silence_s > self._limit_s and not expected
        if silent == self._silent:
            return None
        self._silent = silent
        return silent

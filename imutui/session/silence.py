"""Whether the unit has fallen silent, or speaks again."""

_LEAST_S = 1.0
_PERIODS = 3.0


class SilenceMonitor:
    """Notices when packets stop coming, and when they come again.

    `period_s`: of the packets that are asked for one by one; 0 for a unit that streams.
    """

    def __init__(self, period_s: float) -> None:
        self._limit_s = max(_LEAST_S, _PERIODS * period_s)
        self._silent = False

    def is_silent(self, silence_s: float) -> bool:
        """Whether so many seconds without a packet are a silence, and no pause between two packets."""
        return silence_s > self._limit_s

    def check(self, silence_s: float, *, expected: bool) -> bool | None:
        """Look at how long there was no packet.

        `silence_s`: since the last one.
        `expected`: whether the silence is asked for, and therefore none.
        Returns true if the unit has fallen silent since the last look, False if it speaks again, None if nothing
          changed.
        """
        silent = self.is_silent(silence_s) and not expected
        if silent == self._silent:
            return None
        self._silent = silent
        return silent


def at_the_end(silence_s: float, advice: str) -> str:
    """What to say of a unit that had been silent for so long when its acquisition ended, and where to look."""
    return (
        f"the unit was silent at the end: its last packet came {silence_s:.1f} s before. What came is recorded and the"
        f" file is finished. Before the next one: {advice}"
    )

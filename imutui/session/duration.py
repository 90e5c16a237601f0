"""How long an acquisition lasts: seconds by the clock from the first packet on, whatever came since."""

# the packet that completes the last period may be on its way
_LEEWAY_NS = 250_000_000


class Duration:
    """Follows the time of what was recorded, through all files of a recording.

    `seconds`: from the first packet on; None for no end.
    """

    def __init__(self, seconds: float | None) -> None:
        self._seconds = seconds
        self._from_ns: int | None = None
        self._until_ns = 0

    def begin(self) -> None:
        """Count anew, from the next packet on."""
        self._from_ns = None

    def add(self, stamp_ns: int) -> None:
        """Take a packet's stamp, monotonic."""
        self._from_ns = stamp_ns if self._from_ns is None else self._from_ns
        self._until_ns = stamp_ns

    def has_all(self) -> bool:
        """Whether the packets reach the end."""
        end_ns = self._end_ns()
        return end_ns is not None and self._until_ns >= end_ns

    def is_over(self, now_ns: int) -> bool:
        """Whether the end has come, by the packets or by the clock."""
        end_ns = self._end_ns()
        return end_ns is not None and (self.has_all() or now_ns >= end_ns + _LEEWAY_NS)

    def _end_ns(self) -> int | None:
        if self._seconds is None or self._from_ns is None:
            return None
        return self._from_ns + round(self._seconds * 1e9)

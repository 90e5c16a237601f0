"""Count the packets that a step of the unit's time counter spans; no I/O, knows no host time.

Where the unit's loop sets the pace, every packet steps by one period. Where the line does, a packet carries the newest
sample: its step is now one period, now two, and only the mean is a packet's time on the line. One rule covers both: the
counter stays within half a period of a regular grid, and a missing packet shifts it by a whole step.
"""

from collections.abc import Sequence

_TOLERANCE = 0.02
_SPREAD_DECAY = 1.0 / 256.0
_PHASE_GAIN = 1.0 / 64.0
_SPACING_GAIN = 1.0 / 4096.0
_MOST_SPREAD = 0.45
_ALIKE = 1.6


class PacketGrid:
    """Regular grid of a stream's packets, in ticks of the unit's counter.

    `line_ticks`: time that a packet spends on the line: none follows sooner.
    `spacing`: mean ticks from packet to packet. It is 0 until `learn` finds a grid, and if the counter stands still or
      counts something other than time.
    """

    def __init__(self, line_ticks: float) -> None:
        self.spacing = 0.0
        self._line = line_ticks
        self._phase = 0.0
        self._spread = 0.0

    def learn(self, steps: Sequence[int]) -> None:
        """Find the grid from packets that follow each other; the newest packet is then the first of them.

        `steps`: ticks from each to the next, at least one.
        """
        median = sorted(steps)[len(steps) // 2]
        usual = [step for step in steps if step <= _ALIKE * median]
        mean = sum(usual) / len(usual)
        # no packet leaves before the one before it has: at that pace one packet's step may be another's twice
        paced_by_line = mean < (1.0 + _TOLERANCE) * self._line
        self.spacing = 0.0 if median < 0.5 * self._line else self._line if paced_by_line else mean
        at, phases = 0.0, [0.0]
        for step in steps if self.spacing else ():
            at += step - self.spacing * (1 if paced_by_line else max(1, round(step / self.spacing)))
            phases.append(at)
        self._phase, self._spread = -(max(phases) + min(phases)) / 2.0, (max(phases) - min(phases)) / 2.0

    def place(self, step: float) -> tuple[int, bool]:
        """Return the packets, at least one, that a step spans, and True if it leads onto the grid, as whole ones do."""
        packets = max(1, round((step + self._phase) / self.spacing))
        return packets, abs(step + self._phase - packets * self.spacing) <= self._tolerance()

    def is_next(self, step: float, *, anywhere: bool = False) -> bool:
        """Return True if a step is that of the very next packet.

        `anywhere`: True if the packet before it is not the newest one that `advance` took, but anywhere on the grid.
        """
        if anywhere:
            return abs(step - self.spacing) <= self._tolerance() + self._spread
        return self.place(step) == (1, True)

    def _tolerance(self) -> float:
        return min(_MOST_SPREAD * self.spacing, _TOLERANCE * self.spacing + 1.2 * self._spread)

    def advance(self, step: float, packets: int) -> None:
        """Take a step that spans so many packets."""
        self._phase += step - packets * self.spacing
        if abs(self._phase) > _MOST_SPREAD * self.spacing:
            self._phase = 0.0  # the unit began anew: so does the grid
            return
        self._spread = max(abs(self._phase), self._spread * (1.0 - _SPREAD_DECAY))
        self.spacing += _SPACING_GAIN * self._phase
        self._phase -= _PHASE_GAIN * self._phase

"""What a virtual unit of any kind measures: a record, and the protocol of a source of readings."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Reading:
    """What the sensors read at one instant, in the instrument's own axes and signs, before the words clip and round."""

    rates_dps: tuple[float, float, float]  # angular rate about X, Y, Z, deg/s
    # acceleration along X, Y, Z as this instrument reads it (+1 g on Z when level), g
    accels_g: tuple[float, float, float]
    temperature_degc: float  # inside the case, degC


class Source(Protocol):
    """What the virtual unit measures."""

    def reading(self, k: int) -> Reading | None:
        """Return what the unit's own loop reads at its instant `k`, or None once there is no more.

        Instants are counted at the options' `loop_hz` from the first command that needs a reading. `k` never decreases;
        it repeats when the host polls faster than the loop, and skips what the line was too slow for.
        """
        ...

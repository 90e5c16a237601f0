"""What is taken out of runs, or set aside, before effects are compared: faults of the data, and lines."""

from dataclasses import dataclass, replace

from filters.channels import CHANNELS
from filters.effects import faults
from filters.effects.fault_records import DataFault
from filters.effects.lines import SpectralLine
from filters.tracing.identifiability import UntestableEffect
from filters.tracing.noise_level import NoiseDriver
from filters.tracing.noise_structure import NoiseFinding
from filters.tracing.residual import perfect
from filters.tracing.run import Run


@dataclass(frozen=True, slots=True)
class FaultOfRun:
    """A fault of the data, and the name of the run that has it."""

    run: str
    fault: DataFault


@dataclass(frozen=True, slots=True, kw_only=True)
class Screening:
    """What is said of runs beside effects on the mean of their readings."""

    faults: tuple[FaultOfRun, ...]
    lines: tuple[SpectralLine, ...]
    noise_drivers: tuple[NoiseDriver, ...]  # what the level of the noise follows
    noise_findings: tuple[NoiseFinding, ...]  # its colour, and its correlation between channels
    untestable: tuple[UntestableEffect, ...]  # what these runs can't show

    def concerns(self, channel: int) -> bool:
        """Whether lines, an uneven level or a structure of its noise, or coarse steps explain what a channel shows.

        All other faults of the data are set aside, and explain nothing.
        """
        name = CHANNELS[channel]
        return (
            any(name in f.fault.channels and f.fault.effect == "coarse" for f in self.faults)
            or any(name in line.channels for line in self.lines)
            or any(driver.channel == channel for driver in self.noise_drivers)
            or any(name in found.channels for found in self.noise_findings)
        )


def without_faults(run: Run) -> tuple[Run, list[FaultOfRun]]:
    """A run with its faults flagged, and what they are."""
    flagged, found = faults.find(run.t, run.reading, perfect(run), run.lsb)
    if run.flagged is not None:
        flagged |= run.flagged
    # the steps of averaged samples are uneven by design, and their stamps say so truly
    kept = [f for f in found if not (run.averaged and f.effect == "jitter")]
    # a channel that the recording lacks has no fault
    lacking = {CHANNELS[c] for c in run.unread}
    kept = [f for f in kept if not f.channels or not set(f.channels) <= lacking]
    return replace(run, flagged=flagged if flagged.any() else None), [FaultOfRun(run.name, f) for f in kept]

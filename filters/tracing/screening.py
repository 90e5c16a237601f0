"""What is taken out of runs, or set aside, before effects are compared: faults of the data, and lines."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from filters.channels import CHANNELS
from filters.effects import faults, noise
from filters.effects.fault_records import DataFault
from filters.effects.lines import SpectralLine
from filters.tracing.line_search import at_full_rate
from filters.tracing.noise_level import NoiseDriver
from filters.tracing.residual import perfect, residual_of
from filters.tracing.run import Run
from filters.tracing.trace_document import FindingEntry, ParameterEntry, UntestableEntry, odds_of


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
    noise_findings: tuple[FindingEntry, ...]  # its colour, and its correlation between channels
    untestable: tuple[UntestableEntry, ...]  # what these runs can't show

    def concerns(self, channel: int) -> bool:
        """Whether lines, an uneven level or a structure of its noise, or coarse steps explain what a channel shows.

        All other faults of the data are set aside, and explain nothing.
        """
        name = CHANNELS[channel]
        return (
            any(name in f.fault.channels and f.fault.effect == "coarse" for f in self.faults)
            or any(name in line.channels for line in self.lines)
            or any(driver.channel == channel for driver in self.noise_drivers)
            or any(name in found["channels"] for found in self.noise_findings)
        )


def without_faults(run: Run, *, by_hand: bool = False) -> tuple[Run, list[FaultOfRun]]:
    """A run with its faults flagged, and what they are.

    `by_hand`: it was turned by hand, so that its motion is not known; one reading of an accelerometer is a knock.
    """
    if run.full_rate is not None:  # they are in no mean
        flagged, found = run.flagged, list(run.full_rate.faults)
    else:
        known = np.full((1, len(CHANNELS)), np.nan) if by_hand else perfect(run)
        flagged, found = faults.find(run.t, run.reading, known, run.lsb)
        found = [f for f in found if not (by_hand and f.effect == "spikes" and f.channels[0].startswith("a"))]
        if run.flagged is not None:
            flagged |= run.flagged
    # the steps of averaged samples are uneven by design, and their stamps say so truly
    kept = [f for f in found if not (run.averaged and f.effect == "jitter")]
    # a channel that the recording lacks has no fault
    lacking = {CHANNELS[c] for c in run.unread}
    kept = [f for f in kept if not f.channels or not set(f.channels) <= lacking]
    flags = flagged if flagged is not None and flagged.any() else None
    return replace(run, flagged=flags), [FaultOfRun(run.name, f) for f in kept]


# ---------------------------------------------------------------------------------------------------- noise structure
# Findings on the colour of the noise and on its correlation between channels, over whole runs at the full rate.

_LEAST_CORRELATION = 0.03


def noise_findings(runs: Sequence[Run]) -> list[FindingEntry]:
    """What the colour of the noise of runs, and its correlation between channels, show that their specification lacks.

    `runs`: without faults and lines; the first one's band limits are what is expected.
    """
    series = [(part.rate_hz, residual_of(part)) for run in runs for part in at_full_rate(run)]
    found = []
    for b in noise.bandwidth(series, runs[0].bandwidth):
        expected = "white" if not np.isfinite(b.spec_hz) else f"a band limit of {b.spec_hz:.3g} Hz"
        limit = f"is band-limited at {b.hz:.3g} Hz" if np.isfinite(b.hz) else "has no band limit that shows"
        # no band limit at all has no value
        value = [_parameter("hz", b.hz, b.sd_hz, "Hz")] if np.isfinite(b.hz) else []
        label = f"noise {limit}, where {expected} is expected"
        found.append(_finding("bandwidth", label, [b.channel], value, b.score))
    for x in noise.crosstalk(series):
        if abs(x.correlation) >= _LEAST_CORRELATION:
            label = f"noise of {x.channels[0]} and {x.channels[1]} is correlated"
            value = [_parameter("correlation", x.correlation, x.sd, "1")]
            found.append(_finding("noise_crosstalk", label, [*x.channels], value, x.z**2))
    return found


def _parameter(name: str, value: float, sd: float, unit: str) -> ParameterEntry:
    return {"name": name, "value": value, "sd": sd, "unit": unit, "plausible": True}


def _finding(effect: str, label: str, channels: list[str], params: list[ParameterEntry], score: float) -> FindingEntry:
    return {
        "effect": effect, "label": label, "channels": channels, "params": params, "shape": {}, "score": score,
        "gain": score, "heldout_gain": None, "share_of_excess": None, "driver_curve": None, "proposed_form": None,
        "rivals": [], "include_as": "N", "confirmed": None, "odds": odds_of(score), "common": None,
    }  # fmt: skip

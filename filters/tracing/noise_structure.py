"""Findings on the colour of the noise and on its correlation between channels, over whole runs at the full rate."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from filters.effects import noise
from filters.tracing.residual import residual_of
from filters.tracing.run import Run

_LEAST_CORRELATION = 0.03


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseFinding:
    """A finding on the noise, with its one parameter."""

    # effect, label: bandwidth or noise_crosstalk, and words for a sentence
    effect: str
    label: str
    channels: tuple[str, ...]  # one, or the two that are correlated
    # name, unit: of the parameter,
    name: str
    unit: str
    # value, sd: and what it is
    value: float
    sd: float
    score: float  # drop of chi-square


def noise_findings(runs: Sequence[Run]) -> list[NoiseFinding]:
    """What the noise of runs shows that their specification does not say.

    `runs`: without faults and lines; the first one's band limits are what is expected.
    """
    series = [(run.rate_hz, residual_of(run)) for run in runs]
    found = []
    for b in noise.bandwidth(series, runs[0].bandwidth):
        expected = "white" if not np.isfinite(b.spec_hz) else f"a band limit of {b.spec_hz:.3g} Hz"
        limit = f"is band-limited at {b.hz:.3g} Hz" if np.isfinite(b.hz) else "has no band limit that shows"
        label = f"noise {limit}, where {expected} is expected"
        found.append(
            NoiseFinding(
                effect="bandwidth",
                label=label,
                channels=(b.channel,),
                name="hz",
                unit="Hz",
                value=b.hz,
                sd=b.sd_hz,
                score=b.score,
            )
        )
    for x in noise.crosstalk(series):
        if abs(x.correlation) < _LEAST_CORRELATION:
            continue
        found.append(
            NoiseFinding(
                effect="noise_crosstalk",
                label=f"noise of {x.channels[0]} and {x.channels[1]} is correlated",
                channels=x.channels,
                name="correlation",
                unit="1",
                value=x.correlation,
                sd=x.sd,
                score=x.z**2,
            )
        )
    return found

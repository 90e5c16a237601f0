"""What a log that nothing was fitted to says of each effect: confirmed, refuted, or neither.

An effect is refuted if the error with it is larger than without it beyond the 95 % interval of the difference, rests or
turns drawn again; confirmed if it is smaller beyond it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from filters.channels import ACCELS, DPS, MG
from filters.effects.hypothesis import ChannelEffect
from filters.multiposition.calibration import Calibration, HeldOut, own_biases
from filters.multiposition.choice import Choice
from filters.tracing.error_figure import DRAWS, rms
from filters.types import Array


@dataclass(frozen=True)
class Verdict:
    """On one effect."""

    effect: ChannelEffect
    confirmed: bool | None  # none where nothing judges it: without a log held out, and of the bias of each power-on
    refuted: bool  # whether it raises the error
    # metric, unit: which error
    metric: str
    unit: str
    # with_it, without: that error with everything that was chosen, and without all that is not confirmed
    with_it: float
    without: float


def verdicts(found: Calibration, seed: int) -> dict[ChannelEffect, Verdict]:
    """Verdict on each effect that was chosen."""
    out: dict[ChannelEffect, Verdict] = {}
    for chosen in (found.accelerometers, found.gyros):
        if chosen is not None:
            out |= _of_triad(found, chosen, seed)
    return out


def _of_triad(found: Calibration, chosen: Choice, seed: int) -> dict[ChannelEffect, Verdict]:
    apart, gyros = found.heldout, chosen is found.gyros
    metric, unit, si = ("gravity_direction", "deg", DPS) if gyros else ("gravity_norm", "mg", MG)
    judged = [e for e in chosen.triad.effects if not (gyros and e.effect == "bias")]
    if apart is None or (gyros and not found.angles.size):
        judged = []
    unknown = float("nan")
    out = {e: Verdict(e, None, False, metric, unit, unknown, unknown) for e in chosen.triad.effects}
    if not judged or apart is None:
        return out
    with_all = _errors(apart, chosen, [])
    intervals = {e: _difference(with_all, _errors(apart, chosen, [e]), seed) for e in judged}
    left_out = [e for e in judged if intervals[e][1] >= 0.0]
    without = rms(_errors(apart, chosen, left_out)) / si
    for e, (low, high) in intervals.items():
        out[e] = Verdict(e, high < 0.0, low > 0.0, metric, unit, rms(with_all) / si, without)
    return out


def _errors(apart: HeldOut, chosen: Choice, gone: Sequence[ChannelEffect]) -> Array:
    """Errors on the log held out, without some effects."""
    if gone:
        places = np.concatenate([chosen.places(e) for e in gone])
        triad = chosen.triad
        for effect in gone:
            triad = triad.without(effect)
        chosen = Choice(triad, chosen.fit.without(places), (), chosen.count, chosen.logs)
    if chosen.triad.channels == ACCELS:
        return apart.observed.errors(chosen.triad, chosen.fit.theta)
    assert apart.turned is not None
    return apart.turned.angles(chosen.triad, own_biases(chosen, apart.turned))


def _difference(with_it: Array, without: Array, seed: int) -> tuple[float, float]:
    """Interval of the difference of mean squares, 95 %."""
    difference = with_it**2 - without**2
    picks = np.random.default_rng(seed).integers(0, difference.size, (DRAWS, difference.size))
    low, high = np.quantile(difference[picks].mean(axis=1), [0.025, 0.975])
    return float(low), float(high)

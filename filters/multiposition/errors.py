"""Error before and after: every rest left out in turn, or rests of a log that nothing was fitted to.

`gravity_norm` is the magnitude of the corrected specific force of a rest less gravity's. `gravity_direction` is the
angle between a rest's direction of gravity, carried through the turn by the gyros, and the next rest's. Before:
readings as they are, gyros less their mean at rest, which is the model of constant biases.
"""

from collections.abc import Sequence

import numpy as np

from filters.channels import DPS, MG
from filters.multiposition import turns
from filters.multiposition.accelerometer import Rests, triad_of
from filters.multiposition.choice import Choice
from filters.multiposition.rests import Rest
from filters.multiposition.turns import Turns
from filters.tracing.error_figure import DRAWS, ErrorFigure, chi2_quantiles, rms, rms_interval
from filters.tracing.run import Run
from filters.tracing.trace_document import HeldOut
from filters.types import Array

FEWEST = 3  # errors of which a figure is made


def norms_left_out(rests: Rests, chosen: Choice) -> Array:
    """Error of the magnitude at every rest with a fit to all others, m/s², shape (n,)."""
    out = np.empty(len(rests.mean))
    for k in range(out.size):
        made = rests.without([k]).fit(chosen.triad, chosen.fit.theta, chosen.fit.excess)
        out[k] = rests.errors(chosen.triad, made.theta)[k]
    return out


def directions_left_out(rests: Rests, accelerometers: Choice, observed: Turns, gyros: Choice) -> Array:
    """Angle that every turn misses by, with both its rests and itself left out of the fits, rad, shape (n,)."""
    out = np.empty(len(observed.turns))
    for k, turn in enumerate(observed.turns):
        both = [turn.first, turn.second]
        made = rests.without(both).fit(accelerometers.triad, accelerometers.fit.theta, accelerometers.fit.excess)
        up = observed.directions(accelerometers.triad.true(rests.mean[both], made.theta))
        out[k] = observed.left_out(gyros.triad, gyros.fit, k, up)
    return out


def norm_figure(rests: Rests, after: Array, seed: int, heldout: HeldOut) -> ErrorFigure | None:
    """Figure of the magnitude; None of too few rests."""
    before = rests.errors(triad_of(), np.zeros(0))
    return _figure("gravity_norm", "mg", MG, before, after, rests.noise, 1, seed, heldout)


def direction_figure(
    runs: Sequence[Run], rests: Sequence[Sequence[Rest]], observed: Turns, after: Array, seed: int, heldout: HeldOut
) -> ErrorFigure | None:
    """Figure of the direction; None of too few turns."""
    plain = Turns(runs, rests)
    plain.sense(triad_of(), np.zeros(0))
    before = plain.angles(turns.triad_of(), plain.still_biases())
    return _figure("gravity_direction", "deg", DPS, before, after, observed.floor, 2, seed, heldout)


def _figure(
    metric: str,
    unit: str,
    si: float,
    before: Array,
    after: Array,
    noise: Array,
    freedom: int,
    seed: int,
    heldout: HeldOut,
) -> ErrorFigure | None:
    n = after.size
    if n < FEWEST:
        return None
    picks = np.random.default_rng(seed).integers(0, n, (DRAWS, n))
    floor = float(np.sqrt(noise.mean())) / si
    low, high = (float(np.sqrt(q / (freedom * n))) * floor for q in chi2_quantiles(freedom * n))
    return ErrorFigure(
        metric=metric,
        channel=None,
        unit=unit,
        before=rms(before) / si,
        after=rms(after) / si,
        floor=floor,
        ci95=rms_interval(after, picks, 1.0 / si),
        before_ci95=rms_interval(before, picks, 1.0 / si),
        floor_band95=(low, high),
        n=n,
        heldout=heldout,
    )

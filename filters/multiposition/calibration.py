"""From logs of a unit turned by hand to its effects: rests found, forms chosen, everything judged on what is left out.

Each step is a module of its own; the package's docstring lists them in order.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from filters.channels import ACCELS, GYROS
from filters.errors import InputError
from filters.multiposition import choice, errors, rests
from filters.multiposition.accelerometer import Rests
from filters.multiposition.choice import Choice
from filters.multiposition.rests import Rest
from filters.multiposition.turns import Turns
from filters.tracing.error_figure import ErrorFigure
from filters.tracing.run import Run
from filters.types import Array

if TYPE_CHECKING:
    from filters.tracing.trace_document import HeldOut as Judge

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class HeldOut:
    """A log that nothing was fitted to."""

    run: Run
    rests: tuple[Rest, ...]
    observed: Rests  # its rests for the accelerometers
    turned: Turns | None  # its turns, None without gyros


@dataclass(frozen=True)
class Calibration:
    """What units turned by hand show."""

    runs: tuple[Run, ...]  # logs that were fitted to, each a power-on
    rests: tuple[tuple[Rest, ...], ...]  # of each of them
    directions: int  # distinct ones, of all together
    observed: Rests  # for the accelerometers
    turned: Turns | None  # for the gyros; None without them, or without a turn
    # accelerometers, gyros: what was chosen
    accelerometers: Choice
    gyros: Choice | None
    heldout: HeldOut | None  # the log that judges; without one, rests and turns are left out in turn
    # norms, angles: errors after, of each rest (m/s²) and of each turn (rad), as they were judged
    norms: Array
    angles: Array
    figures: tuple[ErrorFigure, ...]  # of them


def calibrate(
    runs: Sequence[Run],
    heldout: Run | None,
    seed: int = 0,
    progress: Progress = lambda share, text: None,
) -> Calibration:
    """Calibrate a unit that was turned by hand between rests.

    `runs`: logs of one unit to fit to, each a power-on.
    `heldout`: a log to judge on.
    `seed`: of intervals.
    `progress`: told a share from 0 to 1 and what is being done.
    Raises InputError if a log has no rests or lacks an accelerometer; the message names it.
    """
    progress(0.0, "looking for rests")
    found = tuple(_rests_of(run) for run in runs)
    every = [rest for own in found for rest in own]
    gravity = runs[0].site.gravity
    observed, directions = Rests(every, gravity), rests.distinct_directions(every)
    if directions < 2:
        raise InputError(
            f"{', '.join(run.name for run in runs)}: the unit was never turned: {len(every)} rests, all in one"
            " direction. Lay it down in at least nine; or trace it at rest: --reference gravity."
        )
    progress(0.1, "fitting accelerometers")
    accelerometers = choice.accelerometers(observed, directions)
    turned = _turned(runs, found, accelerometers)
    progress(0.2, "fitting gyros")
    gyros = None if turned is None else choice.gyros(turned)
    apart = None if heldout is None else _apart(heldout, accelerometers)
    progress(0.7, "judging")
    norms, angles, figures = _judged(runs, found, observed, turned, accelerometers, gyros, apart, seed)
    progress(1.0, "done")
    return Calibration(
        tuple(runs), found, directions, observed, turned, accelerometers, gyros, apart, norms, angles, figures
    )


def _rests_of(run: Run) -> tuple[Rest, ...]:
    if not rests.has_accelerometers(run):
        have = rests.recorded(run)
        lack = ", ".join(name for name, c in zip(("x", "y", "z"), ACCELS, strict=True) if not have[c])
        raise InputError(
            f"{run.name}: accelerometer {lack} was not recorded, or reads the same throughout, and the magnitude of"
            " gravity takes all three. Record all of them, or trace the log at one rest: --reference gravity with"
            " --start and --end on import."
        )
    found = rests.find_rests(run)
    if not found:
        raise InputError(
            f"{run.name}: no rest was found: nowhere do all channels stay quiet for {rests.WINDOW_S:g} s together. Put"
            " the unit down for some seconds in at least nine directions."
        )
    return found


def _turned(runs: Sequence[Run], found: Sequence[Sequence[Rest]], accelerometers: Choice) -> Turns | None:
    if not all(rests.has_gyros(run) for run in runs):
        return None
    turned = Turns(runs, found)
    turned.sense(accelerometers.triad, accelerometers.fit.theta)
    return turned


def _apart(run: Run, accelerometers: Choice) -> HeldOut:
    own = _rests_of(run)
    return HeldOut(run, own, Rests(own, run.site.gravity), _turned([run], [own], accelerometers))


def _judged(
    runs: Sequence[Run],
    found: Sequence[Sequence[Rest]],
    observed: Rests,
    turned: Turns | None,
    accelerometers: Choice,
    gyros: Choice | None,
    apart: HeldOut | None,
    seed: int,
) -> tuple[Array, Array, tuple[ErrorFigure, ...]]:
    """Errors after and their figures: on the log held out, else on rests and turns left out in turn."""
    angles = np.zeros(0)
    how = _how(runs, apart)
    if apart is not None:
        runs, found, observed, turned = [apart.run], [apart.rests], apart.observed, apart.turned
        norms = observed.errors(accelerometers.triad, accelerometers.fit.theta)
    else:
        norms = errors.norms_left_out(observed, accelerometers)
    figures = [errors.norm_figure(observed, norms, seed, how)]
    if turned is not None and gyros is not None and turned.turns:
        if apart is None:
            angles = errors.directions_left_out(observed, accelerometers, turned, gyros)
        else:
            angles = turned.angles(gyros.triad, own_biases(gyros, turned))
        figures.append(errors.direction_figure(runs, found, turned, angles, seed, how))
    return norms, angles, tuple(figure for figure in figures if figure is not None)


def _how(runs: Sequence[Run], apart: HeldOut | None) -> "Judge":
    """What judges: rests left out in turn, another power-on, or another part of one that was fitted to."""
    if apart is None:
        return "folds"
    known = apart.run.power_on
    return "part" if known and any(run.power_on == known for run in runs) else "run"


def own_biases(gyros: Choice, turned: Turns) -> Array:
    """Parameters of the gyros for another power-on: the biases of its own rests, and what was fitted."""
    shared = gyros.fit.theta[3 * gyros.logs :]
    pull = turned.readings_of_rests(gyros.triad, np.concatenate([np.zeros(3), shared]))
    weight = np.array([rest.seconds for rest in turned.rests])
    mean = np.array([rest.mean[list(GYROS)] for rest in turned.rests])
    return np.concatenate([weight @ (mean - pull) / weight.sum(), shared])

"""Which effects the rests and turns need: forms by chi-square less the tracer's price, then one by one.

The error of the model is taken from the fullest form that is determined, so that gains of forms are comparable. What
the data cannot determine is left out before, and said.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray

from filters.effects.hypothesis import Hypothesis
from filters.multiposition import accelerometer, turns
from filters.multiposition.accelerometer import Rests
from filters.multiposition.least_squares import Fit
from filters.multiposition.triad import Triad
from filters.multiposition.turns import Turns
from filters.types import Array

ACCEPT = 9.0  # score that an effect beyond the usual ones must exceed
KEEP = 4.5  # score below which an effect is taken out again
_FREE = 6  # rests beyond the number of parameters before more effects are tried

Groups = Sequence[Sequence[Hypothesis]]


@dataclass(frozen=True)
class Choice:
    """A triad that was chosen."""

    triad: Triad  # its effects
    fit: Fit  # to all observations
    undetermined: tuple[Hypothesis, ...]  # what the data cannot tell
    count: int  # observations whose logarithm is the price of a parameter: rests, or turns
    logs: int = 1  # how often the biases stand in the fit, once a log; 1 where the logs share them

    def places(self, effect: Hypothesis) -> np.ndarray:
        """Where an effect's parameters stand in the fit: of a bias one a log."""
        return places(self.triad, effect, self.logs)

    def gain(self, effect: Hypothesis) -> float:
        """By how much chi-square would grow without it."""
        return self.fit.gain(self.places(effect))

    def score(self, effect: Hypothesis) -> float:
        """The gain less the price of the parameters."""
        return self.gain(effect) - self.places(effect).size * float(np.log(max(2, self.count)))


def places(triad: Triad, effect: Hypothesis, logs: int) -> np.ndarray:
    """Where an effect's parameters stand in a fit to several logs: biases of log after log, then all that is shared."""
    own = np.arange(triad.size)[triad.places(effect)]
    if logs > 1 and effect.effect == "bias":
        return np.concatenate([own + 3 * log for log in range(logs)])
    return own + 3 * (logs - 1)


def accelerometers(rests: Rests, directions: int) -> Choice:
    """Effects of the accelerometers that the rests ask for.

    `rests`: of all logs that are fitted to.
    `directions`: how many of them are distinct.
    """
    groups = accelerometer.FORMS if directions >= accelerometer.FEWEST else accelerometer.FORMS[:2]
    asked = tuple(chain.from_iterable(accelerometer.FORMS))
    full, fullest = _determined(accelerometer.triad_of(*groups), lambda triad: rests.fit(triad), 1)
    count = len(rests.mean)
    price = float(np.log(max(2, count)))
    best, least = accelerometer.triad_of(), float("inf")
    for k in range(len(groups) + 1):
        triad = accelerometer.triad_of([e for group in groups[:k] for e in group if e in full.effects])
        cost = rests.fit(triad, None, fullest.excess).chi2 + price * triad.size
        if cost < least:
            best, least = triad, cost
    best = _beyond(rests, best)
    triad, made = _pruned(best, lambda t: rests.fit(t), count, 1)
    return Choice(triad, made, tuple(e for e in asked if e not in full.effects), count)


def gyros(observed: Turns) -> Choice:
    """Effects of the gyros that turns and rests ask for; the biases of each log are always in."""
    start = observed.still_biases()

    def fit(triad: Triad) -> Fit:
        begin = np.zeros(3 * observed.logs + triad.size - 3)
        begin[: start.size] = start
        return observed.fit(triad, begin)

    asked = tuple(chain.from_iterable(turns.GROUPS))
    full, made = _determined(turns.triad_of(*turns.GROUPS), fit, observed.logs)
    count = max(2, len(observed.turns))
    groups = [[e for e in group if e in full.effects] for group in turns.GROUPS]
    best, least = full, float("inf")
    for chosen in chain.from_iterable(combinations(groups, n) for n in range(len(groups) + 1)):
        triad = turns.triad_of(*chosen)
        gone = [places(full, e, observed.logs) for e in full.effects if e not in triad.effects]
        cost = (made.without(np.concatenate(gone)) if gone else made).chi2 + float(np.log(count)) * triad.size
        if cost < least:
            best, least = triad, cost
    triad, made = _pruned(best, fit, count, observed.logs, made if best == full else None)
    return Choice(triad, made, tuple(e for e in asked if e not in full.effects), count, observed.logs)


def _determined(triad: Triad, fit: Callable[[Triad], Fit], logs: int) -> tuple[Triad, Fit]:
    """A triad without what the data cannot tell to what is plausible, the last that joined first."""
    while True:
        made = fit(triad)
        loose = [e for e in triad.effects if _ratio(triad, made, e, logs) > 1.0]
        if not loose:
            return triad, made
        families = [e.effect for e in triad.effects]
        last = max(loose, key=lambda e: (families.index(e.effect), _ratio(triad, made, e, logs)))
        if logs and last.effect == "bias" and last in turns.BIAS:
            return triad, made
        triad = triad.without(last)


def _ratio(triad: Triad, made: Fit, effect: Hypothesis, logs: int) -> float:
    """The worst of an effect's standard deviations, in what is plausible of the parameter."""
    plausible = np.array([p.prior * p.si for p in effect.parameters])
    sd = made.sd[places(triad, effect, logs)]
    return float(np.max(sd / np.resize(plausible, sd.size)))


def _pruned(
    triad: Triad, fit: Callable[[Triad], Fit], count: int, logs: int, made: Fit | None = None
) -> tuple[Triad, Fit]:
    """A triad without effects that score too little by themselves, the least first; gyros keep their biases."""
    made = fit(triad) if made is None else made
    while True:
        choice = Choice(triad, made, (), count, logs)
        own = {e: choice.score(e) for e in triad.effects if e not in turns.BIAS}
        worst = min(own, key=lambda e: own[e], default=None)
        if worst is None or own[worst] >= KEEP:
            return triad, made
        triad = triad.without(worst)
        made = fit(triad)


def _beyond(rests: Rests, triad: Triad) -> Triad:
    """A triad with such effects beyond bias, scale and misalignment as clearly gain, also on rests left out."""
    candidates = [e for e in accelerometer.BEYOND if triad.effects]
    count = len(rests.mean)
    price = float(np.log(max(2, count)) + 2.0 * np.log(len(accelerometer.BEYOND)))
    made = rests.fit(triad)
    while candidates and count >= triad.size + _FREE:
        tried = {e: rests.fit(Triad(triad.channels, (*triad.effects, e))) for e in candidates}
        best = max(tried, key=lambda e: tried[e].gain(np.arange(triad.size, triad.size + 1)))
        found = tried[best]
        gain = found.gain(np.arange(triad.size, triad.size + 1))
        if gain - price <= ACCEPT or _unseen(found) >= _unseen(made):
            break
        triad, made = Triad(triad.channels, (*triad.effects, best)), found
        candidates.remove(best)
    return triad


def _unseen(made: Fit) -> float:
    """Mean square of residuals each left out of the fit."""
    return float(np.mean([made.left_out(np.array([k])) ** 2 for k in range(made.residual.size)]))


def unseen_residuals(made: Fit, blocks: Sequence[NDArray[np.int_]]) -> Array:
    """Residuals of blocks of observations, each left out of the fit, one after the other."""
    return np.concatenate([made.left_out(block) for block in blocks])

"""Which effects the rests and turns need: forms by chi-square less the tracer's price, then one by one.

The error of the model is taken from the fullest form that is determined, so that gains of forms are comparable. What
the data cannot determine is left out before, and said.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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


@dataclass(frozen=True)
class Choice:
    """A triad that was chosen."""

    triad: Triad  # its effects
    fit: Fit  # to all observations
    undetermined: tuple[Hypothesis, ...]  # what the data cannot tell
    count: int  # observations whose logarithm is the price of a parameter: rests, or turns
    logs: int = 1  # how often the biases stand in the fit, once a log; 1 where the logs share them

    def places(self, effect: Hypothesis) -> np.ndarray:
        """Where an effect's parameters stand: the biases of log after log first, then all that logs share."""
        own = np.arange(self.triad.size)[self.triad.places(effect)]
        if effect.effect in self.triad.own:
            return np.concatenate([own + self.triad.owned * log for log in range(self.logs)])
        return own + self.triad.owned * (self.logs - 1)

    @property
    def own(self) -> list[Array]:
        """Parameters of each power-on, shape (p,) each."""
        return [self.triad.of_power_on(self.fit.theta, log, self.logs) for log in range(self.logs)]

    @property
    def mean(self) -> Array:
        """Parameters to expect of a power-on yet unknown, shape (p,)."""
        return self.triad.mean(self.fit.theta, self.logs)

    def lacks(self, groups: Sequence[Sequence[Hypothesis]]) -> tuple[Hypothesis, ...]:
        """Effects of groups that are not in it."""
        return tuple(e for e in chain.from_iterable(groups) if e not in self.triad.effects)

    def less(self, effect: Hypothesis, fit: Callable[[Triad], Fit]) -> "Choice":
        """The choice without an effect, fitted anew."""
        triad = self.triad.without(effect)
        return replace(self, triad=triad, fit=fit(triad))

    def looseness(self, effect: Hypothesis) -> float:
        """The worst of an effect's standard deviations, in what is plausible of the parameter."""
        plausible = np.array([p.prior * p.si for p in effect.parameters])
        sd = self.fit.sd[self.places(effect)]
        return float(np.max(sd / np.resize(plausible, sd.size)))

    def gain(self, effect: Hypothesis) -> float:
        """By how much chi-square would grow without it."""
        return self.fit.gain(self.places(effect))

    def score(self, effect: Hypothesis) -> float:
        """The gain less the price of the parameters."""
        return self.gain(effect) - self.places(effect).size * float(np.log(max(2, self.count)))


def accelerometers(rests: Rests, directions: int, own: Sequence[str] = ("bias",)) -> Choice:
    """Effects of the accelerometers that the rests, of all logs that are fitted to, in so many directions, ask for.

    `own`: kinds of effects that each power-on has its own of.
    """
    groups = accelerometer.FORMS if directions >= accelerometer.FEWEST else accelerometer.FORMS[:2]
    count = len(rests.mean)
    widest = accelerometer.triad_of(*groups).owning(own)
    full = _determined(Choice(widest, rests.fit(widest), (), count, rests.logs), rests.fit)
    price = float(np.log(max(2, count)))
    best, least = widest, float("inf")
    for k in range(len(groups) + 1):
        triad = accelerometer.triad_of([e for group in groups[:k] for e in group if e in full.triad.effects])
        triad = triad.owning(own)
        made = rests.fit(triad, None, full.fit.excess)
        cost = made.chi2 + price * made.theta.size
        if cost < least:
            best, least = triad, cost
    best = _beyond(rests, best)
    return _pruned(Choice(best, rests.fit(best), full.lacks(accelerometer.FORMS), count, rests.logs), rests.fit)


def gyros(observed: Turns) -> Choice:
    """Effects of the gyros that turns and rests ask for; the biases of each log are always in."""
    fit, widest, count = observed.fit, turns.triad_of(*turns.GROUPS), max(2, len(observed.turns))
    full = _determined(Choice(widest, fit(widest), (), count, observed.logs), fit)
    groups = [[e for e in group if e in full.triad.effects] for group in turns.GROUPS]
    best, least = full.triad, float("inf")
    for chosen in chain.from_iterable(combinations(groups, n) for n in range(len(groups) + 1)):
        triad = turns.triad_of(*chosen)
        gone = [full.places(e) for e in full.triad.effects if e not in triad.effects]
        cost = (full.fit.without(np.concatenate(gone)) if gone else full.fit).chi2 + float(np.log(count)) * triad.size
        if cost < least:
            best, least = triad, cost
    full = replace(full, undetermined=full.lacks(turns.GROUPS))
    return _pruned(full if best == full.triad else replace(full, triad=best, fit=fit(best)), fit)


def owning(choice: Choice, kinds: Sequence[str], observed: Rests | Turns) -> Choice:
    """The choice with some kinds of effects fitted to each power-on by itself."""
    triad = choice.triad.owning(kinds)
    return replace(choice, triad=triad, fit=observed.fit(triad))


def _determined(choice: Choice, fit: Callable[[Triad], Fit]) -> Choice:
    """Without what the data cannot tell to what is plausible, the last that joined first; gyros keep their biases."""
    while True:
        effects = choice.triad.effects
        loose = {e: ratio for e in effects if (ratio := choice.looseness(e)) > 1.0}
        families = [e.effect for e in effects]
        last = max(loose, key=lambda e: (families.index(e.effect), loose[e]), default=None)
        if last is None or last in turns.BIAS:
            return choice
        choice = choice.less(last, fit)


def _pruned(choice: Choice, fit: Callable[[Triad], Fit]) -> Choice:
    """Without effects that score too little by themselves, the least first; gyros keep their biases."""
    while True:
        own = {e: choice.score(e) for e in choice.triad.effects if e not in turns.BIAS}
        worst = min(own, key=lambda e: own[e], default=None)
        if worst is None or own[worst] >= KEEP:
            return choice
        choice = choice.less(worst, fit)


def _beyond(rests: Rests, triad: Triad) -> Triad:
    """A triad with such effects beyond bias, scale and misalignment as clearly gain, also on rests left out."""
    candidates = [e for e in accelerometer.BEYOND if triad.effects]
    count = len(rests.mean)
    price = float(np.log(max(2, count)) + 2.0 * np.log(len(accelerometer.BEYOND)))
    made = rests.fit(triad)
    while candidates and count >= made.theta.size + _FREE:
        tried = {e: rests.fit(replace(triad, effects=(*triad.effects, e))) for e in candidates}
        best = max(tried, key=lambda e: tried[e].gain(slice(-1, None)))
        found = tried[best]
        gain = found.gain(slice(-1, None))
        if gain - price <= ACCEPT or _unseen(found) >= _unseen(made):
            break
        triad, made = replace(triad, effects=(*triad.effects, best)), found
        candidates.remove(best)
    return triad


def _unseen(made: Fit) -> float:
    """Mean square of residuals each left out of the fit."""
    return float(np.mean([made.left_out(np.array([k])) ** 2 for k in range(made.residual.size)]))


def unseen_residuals(made: Fit, blocks: Sequence[NDArray[np.int_]]) -> Array:
    """Residuals of blocks of observations, each left out of the fit, one after the other."""
    return np.concatenate([made.left_out(block) for block in blocks])

"""A triad of sensors as the sum of what is true and of effects of the catalogue: reading = x + Σ φ(x) θ.

The effects are those of `filters.effects.catalogue`, so that signs, units and parameters are the filter's own.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from filters.effects.hypothesis import Hypothesis
from filters.effects.inputs import FOLLOWED, LAGS, PLAY_WIDTHS, Inputs
from filters.types import Array

_ROUNDS = 40
_SAME = 1e-13
_STRAIGHT = ("bias", "scale", "cross_axis", "g_sensitivity")


@dataclass(frozen=True)
class Triad:
    """Three sensors of a kind with their effects."""

    channels: tuple[int, ...]  # numbers of the three
    effects: tuple[Hypothesis, ...]  # in the order of their parameters
    own: tuple[str, ...] = ("bias",)  # kinds of effects that each power-on has its own of; such effects come first

    @cached_property
    def size(self) -> int:
        """How many parameters there are."""
        return sum(len(e.parameters) for e in self.effects)

    @cached_property
    def _places(self) -> tuple[slice, ...]:
        """Where the parameters of each effect stand: a fit asks for it at every reading."""
        edges = [0, *itertools.accumulate(len(e.parameters) for e in self.effects)]
        return tuple(itertools.starmap(slice, itertools.pairwise(edges)))

    def places(self, effect: Hypothesis) -> slice:
        """Where an effect's parameters stand."""
        return self._places[self.effects.index(effect)]

    # Over several power-ons what is each one's own stands first, one after the other, and last what they share.

    @cached_property
    def owned(self) -> int:
        """How many parameters are each power-on's own."""
        return sum(len(e.parameters) for e in self.effects if e.effect in self.own)

    def owning(self, kinds: Sequence[str]) -> "Triad":
        """The triad with these kinds of effects each power-on's own, and all else shared."""
        return Triad(self.channels, tuple(sorted(self.effects, key=lambda e: e.effect not in kinds)), tuple(kinds))

    def of_power_on(self, theta: Array, log: int, logs: int) -> Array:
        """Parameters of one power-on among those of `logs`, shape (p,)."""
        b = self.owned
        return np.concatenate([theta[b * log : b * (log + 1)], theta[b * logs :]])

    def mean(self, theta: Array, logs: int) -> Array:
        """Parameters of a power-on yet unknown: the mean of what is each one's own, and what all share, shape (p,)."""
        b = self.owned
        return np.concatenate([theta[: b * logs].reshape(logs, b).mean(axis=0), theta[b * logs :]])

    def spread(self, columns: Array, log: int, logs: int) -> Array:
        """Derivatives by the parameters of one power-on (…, p) among those of `logs`."""
        b = self.owned
        out = np.zeros((*columns.shape[:-1], b * (logs - 1) + columns.shape[-1]))
        out[..., b * log : b * (log + 1)] = columns[..., :b]
        out[..., b * logs :] = columns[..., b:]
        return out

    def priors(self, logs: int) -> Array:
        """Standard deviations that fits begin with, SI: so wide that what the data show counts alone."""
        own = np.array([_WIDE.get(e.effect, 20.0 * p.prior * p.si) for e in self.effects for p in e.parameters])
        return np.concatenate([np.tile(own[: self.owned], logs), own[self.owned :]])

    def without(self, effect: Hypothesis) -> "Triad":
        """The triad with one effect less."""
        return replace(self, effects=tuple(e for e in self.effects if e != effect))

    def regressor(self, x: Array) -> Array:
        """Regressor φ at n states, what a perfect unit reads being x (n, 6); shape (n, 3, p)."""
        out = np.zeros((len(x), 3, self.size))
        inputs = _inputs(x)
        for effect, places in zip(self.effects, self._places, strict=True):
            row = self.channels.index(effect.channel)
            out[:, row, places] = effect.columns(inputs, effect.channel)
        return out

    def true(self, reading: Array, theta: Array, other: Array | None = None) -> Array:
        """What the triad truly sensed, shape (n, 3).

        `reading`: of the triad, SI, shape (n, 3).
        `theta`: parameters, shape (p,).
        `other`: what the other triad truly sensed, shape (n, 3); zero where nothing depends on it.
        """
        x = np.zeros((len(reading), 6))
        mine = list(self.channels)
        others = [c for c in range(6) if c not in mine]
        if other is not None:
            x[:, others] = other
        # about zero most effects are straight lines: then the first step is the last
        probes = np.vstack([np.zeros(6), np.eye(6)])
        error = self.regressor(probes) @ theta
        straight = (error[1:] - error[0]).T
        inverse = np.linalg.inv(np.eye(3) + straight[:, mine])
        x[:, mine] = (reading - error[0] - x[:, others] @ straight[:, others].T) @ inverse.T
        if all(effect.effect in _STRAIGHT for effect in self.effects):
            return x[:, mine]
        scale = max(1.0, float(np.abs(reading).max(initial=0.0)))
        for _ in range(_ROUNDS):
            with np.errstate(over="ignore", invalid="ignore"):  # far from any plausible unit; the fit steps back
                step = (reading - x[:, mine] - self.regressor(x) @ theta) @ inverse.T
            x[:, mine] += step
            if float(np.abs(step).max(initial=0.0)) < _SAME * scale:
                break
        return x[:, mine]

    def slope(self, x: Array, theta: Array, step: float) -> Array:
        """Derivative of the reading by what is truly sensed, at x (n, 6), shape (n, 3, 3)."""
        # all six at once: of few readings a regressor costs much more than of each row
        moved = np.zeros((2, 3, 1, 6))
        moved[0, range(3), 0, self.channels] = step
        moved[1] = -moved[0]
        phi = self.regressor((x + moved).reshape(-1, 6)).reshape(2, 3, len(x), 3, self.size)
        return np.asarray(np.moveaxis((phi[0] - phi[1]) @ theta / (2.0 * step), 0, 2) + np.eye(3))


_WIDE = {"scale": 0.3, "cross_axis": 0.3}


def _inputs(x: Array) -> Inputs:
    """Drivers of which only what is sensed is known."""
    n = len(x)
    zero, none = np.zeros((n, 3)), np.full(n, np.nan)
    return Inputs(
        t=none,
        x=x,
        x_dot=np.zeros((n, 6)),
        temperature=none,
        temperature_rate=none,
        lagged=np.full((n, len(LAGS)), np.nan),
        plays=np.full((n, len(PLAY_WIDTHS)), np.nan),
        spin=zero,
        horizontal=np.zeros((n, 3, 2)),
        centripetal=np.zeros((n, 3, 3)),
        angles=zero,
        rates=zero,
        table_accel=np.zeros(n),
        since_motion=none,
        direction=zero,
        followed=np.full((n, len(FOLLOWED)), np.nan),
    )

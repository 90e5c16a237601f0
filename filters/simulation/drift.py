"""Errors that nothing logged drives: two-level noise, random walk, Gauss-Markov drift. Drawn anew at each power-on."""

import math
from typing import ClassVar

import numpy as np

from filters.channels import CHANNELS
from filters.first_order import first_order
from filters.simulation.parameters import ScenarioParameter, Setup, TrueInputs, positive
from filters.types import Array


class Telegraph:
    """e = k s(t), s in {0, 1}, each level held for an exponential time; `{e}`, `mean_s` (mean of those times)."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "{e}"), positive("mean", "mean_s"))

    def __init__(self, setup: Setup) -> None:
        self._k, self._mean, self._rng = setup.number("k"), setup.number("mean"), setup.rng
        self._level = int(self._rng.integers(2))
        self._until = self._rng.exponential(self._mean)

    def error(self, inputs: TrueInputs) -> Array:
        out = np.empty(inputs.t.size)
        done = 0
        while done < out.size:
            end = int(np.searchsorted(inputs.t, self._until))
            out[done:end] = self._level
            if end < out.size:
                self._level = 1 - self._level
                self._until += self._rng.exponential(self._mean)
            done = end
        return self._k * out


class RandomWalk:
    """e(k+1) = e(k) + q √T n(k), n white of unit variance, T the sampling period, from 0; `{e}_per_sqrt_s` is q."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("q", "{e}_per_sqrt_s", least=0.0),)

    def __init__(self, setup: Setup) -> None:
        self._sd, self._rng = setup.number("q") / math.sqrt(setup.rate_hz), setup.rng
        self._at = 0.0

    def error(self, inputs: TrueInputs) -> Array:
        walk = self._at + np.cumsum(self._sd * self._rng.standard_normal(inputs.t.size))
        self._at = float(walk[-1])
        return walk


class GaussMarkov:
    """e(k+1) = p e(k) + σ √(1 - p²) n(k), p = exp(-T/τ), stationary from the start; `{e}` is σ, `tau_s`."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("sd", "{e}", least=0.0), positive("tau", "tau_s"))

    def __init__(self, setup: Setup) -> None:
        self._pole = math.exp(-1.0 / (setup.rate_hz * setup.number("tau")))
        self._sd = setup.number("sd") * math.sqrt(-math.expm1(-2.0 / (setup.rate_hz * setup.number("tau"))))
        self._rng = setup.rng
        self._memory = self._pole * setup.number("sd") * float(self._rng.standard_normal())

    def error(self, inputs: TrueInputs) -> Array:
        drive = self._sd * self._rng.standard_normal(inputs.t.size)
        out, self._memory = first_order(drive, 1.0, self._pole, self._memory)
        return out

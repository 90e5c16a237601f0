"""Simulated thermal cycles of one channel: down, up, down again, with a bias that is a curve, remembers and wanders."""

from dataclasses import dataclass

import numpy as np

from filters.effects import thermal_average
from filters.effects.inputs import LAGS
from filters.effects.temperature import lag, plays
from filters.tracing.thermal_forms import Rows

PERIOD = 2.0


@dataclass(frozen=True)
class Cycle:
    """Rows of a cycle of three legs: time, temperature, bias with noise, white standard deviation, ends of the legs."""

    t: np.ndarray
    T: np.ndarray
    y: np.ndarray
    sd: float
    walk: float
    ends: tuple[int, int, int]

    def columns(self, fitted: slice) -> np.ndarray:
        """Those of the forms, scaled as in the rows that are fitted; shape (n, K)."""
        lagged = np.stack([lag(self.T, tau / PERIOD) for tau in LAGS], axis=1)
        low, high = float(self.T[fitted].min()), float(self.T[fitted].max())
        made = thermal_average.columns(self.T, lagged, plays(self.T - self.T[0])[0], low, high)
        return np.column_stack(made)

    def rows(self, fitted: slice) -> Rows:
        """Some of them, to be fitted; from the first on."""
        n = self.t[fitted].size
        nothing = np.zeros((n, 0))
        T = self.T[fitted]
        variance, begins = np.full(n, self.sd**2), np.array([0])
        columns = self.columns(fitted)[fitted]
        return Rows(
            self.y[fitted], nothing, nothing, columns, self.t[fitted], variance, begins, float(T.min()), float(T.max())
        )


def cycle(seed: int, kind: str = "both", scale: float = 1.0) -> Cycle:
    """A cycle; `kind` is what remembers: none, lag, play, both."""
    rng = np.random.default_rng([seed, 7])
    corners = [rng.uniform(20, 55), rng.uniform(-30, 5), rng.uniform(50, 80), rng.uniform(20, 45)]
    rates = rng.uniform(0.025, 0.08, 3)
    legs = [
        np.linspace(a, b, int(abs(b - a) / rate / PERIOD))
        for a, b, rate in zip(corners[:-1], corners[1:], rates, strict=True)
    ]
    T = lag(np.concatenate(legs), 5.0)
    bias = scale * (np.vander((T - 25.0) / 45.0, 4, increasing=True)[:, 1:] @ rng.normal(0.0, [1.0, 0.6, 0.3]))
    if kind in ("lag", "both"):
        remembered = lag(T, float(np.exp(rng.uniform(3.0, 7.8))) / PERIOD) - T
        bias = bias + rng.normal(0.0, 0.4) * remembered / remembered.std()
    if kind in ("play", "both"):
        half_widths = np.exp(rng.uniform(1.1, 4.6)) * np.arange(1, 21) / 20
        at, out = T[0] + rng.uniform(-1, 1) * half_widths, np.empty(T.size)
        share = rng.dirichlet(np.ones(20))
        for k, value in enumerate(T.tolist()):
            at = np.clip(at, value - half_widths, value + half_widths)
            out[k] = share @ at
        bias = bias + rng.normal(0.0, 0.4) * (out - T) / max(float((out - T).std()), 0.1)
    sd, walk = float(np.exp(rng.uniform(-5.8, -3.5))), float(np.exp(rng.uniform(-7.6, -4.8)))
    noise = np.cumsum(walk * np.sqrt(PERIOD) * rng.standard_normal(T.size)) + sd * rng.standard_normal(T.size)
    ends = np.cumsum([leg.size for leg in legs]).tolist()
    return Cycle(PERIOD * np.arange(T.size), T, bias + noise, sd, walk, (ends[0], ends[1], ends[2]))

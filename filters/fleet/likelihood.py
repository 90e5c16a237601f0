"""Restricted likelihood of two nested components of variance beside known variances of measurement.

    y_ij = μ + a_i + b_ij + e_ij,   a_i ~ N(0, σ_u²),   b_ij ~ N(0, σ_p²),   e_ij ~ N(0, s_ij²), s_ij known

for power-on j of unit i. With w_ij = 1/(σ_p² + s_ij²), W_i = Σ_j w_ij, m_i = Σ_j w_ij y_ij / W_i, T_i = σ_u² + 1/W_i,
c = 1 / Σ_i 1/T_i and μ̂ = c Σ_i m_i/T_i the restricted log likelihood is, but for a constant,

    -½ [Σ_ij -log w_ij + Σ_i log W_i + Σ_i log T_i - log c + Σ_ij w_ij (y_ij - m_i)² + Σ_i (m_i - μ̂)²/T_i]

which costs a sum over power-ons. Its Fisher information is I_kl = ½ tr(P V_k P V_l), P = V⁻¹ - V⁻¹ 1 c 1ᵀ V⁻¹. Source:
S. R. Searle, G. Casella, C. E. McCulloch, "Variance components", chapters 6 and 11, with known variances added.
"""

from dataclasses import dataclass

import numpy as np

from filters.fleet.readings import PowerOns
from filters.types import Array


@dataclass(frozen=True, slots=True)
class Conditional:
    """What follows where both components are given, for G pairs of them."""

    log_likelihood: Array  # restricted, shape (G,)
    # mean, mean_variance: of the model: μ̂ and c, shape (G,)
    mean: Array
    mean_variance: Array
    # unit_means, unit_variances: m_i and 1/W_i, shape (G, U)
    unit_means: Array
    unit_variances: Array
    information: Array  # of σ_u² and σ_p²: I_uu, I_up, I_pp, shape (3, G)


def conditional(data: PowerOns, unit_variance: Array, power_on_variance: Array) -> Conditional:
    """Likelihood, information, and means, at pairs of components.

    `data`: values, P of them of U units.
    `unit_variance`, `power_on_variance`: σ_u² and σ_p², shape (G,), not negative.
    """
    starts = data.starts

    def per_unit(x: Array) -> Array:
        made: Array = np.add.reduceat(x, starts, axis=1)
        return made

    w = 1.0 / (power_on_variance[:, None] + data.variances)
    W = per_unit(w)
    m = per_unit(w * data.values) / W
    deviations = data.values - np.repeat(m, data.counts, axis=1)
    T = unit_variance[:, None] + 1.0 / W
    c = 1.0 / np.sum(1.0 / T, axis=1)
    mean = c * np.sum(m / T, axis=1)
    told = -np.sum(np.log(w), axis=1) + np.sum(np.log(W) + np.log(T), axis=1) - np.log(c)
    squares = np.sum(w * deviations**2, axis=1) + np.sum((m - mean[:, None]) ** 2 / T, axis=1)
    information = _information(per_unit(w**2), per_unit(w**3), W, 1.0 / T, c)
    return Conditional(-0.5 * (told + squares), mean, c, m, 1.0 / W, information)


def _information(w2: Array, w3: Array, W: Array, B: Array, c: Array) -> Array:
    """I_uu, I_up, I_pp; B = 1/T. P is a part within units, which σ_p² alone moves, and one between their means."""
    r = w2 / W**2  # squared length of the weights that make a unit's mean
    k = c[:, None]
    total = np.sum(B**2, axis=1)
    uu = total - 2.0 * c * np.sum(B**3, axis=1) + (c * total) ** 2
    up = np.sum(r * (B**2 - 2.0 * k * B**3 + k**2 * total[:, None] * B**2), axis=1)
    within = np.sum(w2 - 2.0 * w3 / W + r * w2, axis=1)
    across = np.sum((B - k * B**2) * (w3 / W**2 - r * w2 / W), axis=1)
    rr = np.sum((r * B) ** 2, axis=1) - 2.0 * c * np.sum(r**2 * B**3, axis=1) + (c * np.sum(r * B**2, axis=1)) ** 2
    # the difference of nearly equal sums may come out below 0 where there is no information at all
    made: Array = 0.5 * np.maximum(np.stack([uu, up, within + 2.0 * across + rr]), 0.0)
    return made

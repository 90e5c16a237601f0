"""What joins the filter: findings that carry over and were not refuted, drift, levels of noise, gates, slow tones."""

import numpy as np

from filters.channels import CHANNELS, error_unit
from filters.effects.drivers import Driver
from filters.effects.records import Included, ShapeValue, State
from filters.effects.run_specific import Tone
from filters.effects.thermal_average import ThermalAverage
from filters.tracing.assessment import Assessment
from filters.tracing.findings import Finding
from filters.tracing.noise_level import NoiseDriver
from filters.tracing.whitening import Drift, inverse_root
from filters.types import Array

_SPIKE = 7.0
_TONE_S = 600.0
_NOT_IN_THE_FILTER = ("since_motion", "table_accel")  # drivers that follow the table's past motion


def included_effects(assessment: Assessment) -> tuple[tuple[Included, ...], Array]:
    """Effects that join the filter.

    `assessment`: with findings.
    Returns in order: constant states, drift, levels of noise, gates, tones.
    Returns correlation of all their states in order, shape (p, p).
    """
    chosen = assessment.selection
    fit = chosen.fit()
    lasting = [f for f in assessment.joining if f.lasting]
    rows: list[int] = []
    for f in lasting:
        first = fit.offsets[chosen.terms.index(f.term)]
        rows += range(first, first + f.term.size)
    tones = [f for f in assessment.findings if isinstance(f.term.hypothesis, Tone)]
    drifting = [_drift(c, assessment.design.drift[c]) for c in assessment.drifting]
    correlation = np.eye(len(rows) + len(drifting) + 2 * len(tones))
    if rows:
        P = fit.covariance[np.ix_(rows, rows)]
        scale = inverse_root(np.diag(P))
        correlation[: len(rows), : len(rows)] = P * np.outer(scale, scale)
        np.fill_diagonal(correlation, 1.0)  # also of a parameter that only a channel shows that is missing
        _free_averages(correlation, [(f.term.key in chosen.averages, f.term.size) for f in lasting])
    levels = [
        _noise_level(d)
        for d in assessment.screening.noise_drivers
        if d.knots and not d.driver.startswith(_NOT_IN_THE_FILTER)
    ]
    constant = [_constant(f) for f in lasting]
    return (*constant, *drifting, *levels, *_gates(assessment), *(_tone(f) for f in tones)), correlation


def _free_averages(correlation: Array, terms: list[tuple[bool, int]]) -> None:
    """Amplitudes of averages are known from their forms, not from the fit, and none from another; in place."""
    own = np.flatnonzero(np.repeat([is_average for is_average, _ in terms], [size for _, size in terms]))
    correlation[own, :] = 0.0
    correlation[:, own] = 0.0
    correlation[own, own] = 1.0


def _constant(f: Finding) -> Included:
    h = f.term.hypothesis
    sd = np.sqrt(np.maximum(np.diag(f.covariance), 0.0))
    states = tuple(
        State(p.name, p.unit, float(v / p.si), float(s / p.si))
        for p, v, s in zip(h.parameters, f.theta, sd, strict=True)
    )
    parameters: dict[str, ShapeValue] = dict(h.shape)
    if isinstance(h, Driver) and h.knots:
        parameters["knots"] = list(h.knots)
    if isinstance(h, ThermalAverage):
        parameters |= h.coefficients()
    return Included(h.effect, tuple(CHANNELS[c] for c in h.channels), "A", parameters, states)


def _drift(channel: int, drift: Drift) -> Included:
    unit, si = error_unit(channel)
    level = drift.level / si
    q = level if drift.is_walk else level * float(np.sqrt(2.0 / drift.tau))
    state = State("drift", unit, 0.0, 1e-9 if drift.is_walk else level, drift.tau, q)
    return Included(drift.kind, (CHANNELS[channel],), "S", {}, (state,))


def _noise_level(driver: NoiseDriver) -> Included:
    parameters: dict[str, ShapeValue] = {"driver": driver.driver, "knots": list(driver.knots), "ratio": list(driver.at)}
    return Included("noise_level", (CHANNELS[driver.channel],), "N", parameters)


def _gates(assessment: Assessment) -> list[Included]:
    """Readings that the filter is to predict through: spikes and limits."""
    out = []
    for effect in ("spikes", "saturation"):
        for c in assessment.channels:
            faults = [f.fault for f in assessment.screening.faults]
            sizes = [f.size for f in faults if f.effect == effect and CHANNELS[c] in f.channels and f.size]
            if not sizes:
                continue
            limit = _spike_limit(assessment, c) if effect == "spikes" else min(sizes)
            out.append(Included(effect, (CHANNELS[c],), "P", {"limit": limit / error_unit(c)[1]}))
    return out


def _spike_limit(assessment: Assessment, channel: int) -> float:
    """Distance from the median of its neighbours beyond which a reading is a spike, SI."""
    blocks = assessment.design.stack.blocks
    rough = [b.rough[:, channel].sum() / max(1.0, b.pairs[:, channel].sum()) for b in blocks]
    return _SPIKE * float(np.sqrt(0.5 * np.median(rough)))


def _tone(f: Finding) -> Included:
    """A slow tone as two states that forget in ten minutes: its phase is every run's own."""
    h = f.term.hypothesis
    assert isinstance(h, Tone)
    unit, si = error_unit(h.channel)
    # of the runs that have the channel
    amplitude = float(np.sqrt(np.mean(f.theta[np.diag(f.covariance) > 0.0] ** 2))) / si
    q = amplitude * float(np.sqrt(2.0 / _TONE_S))
    states = tuple(State(name, unit, 0.0, amplitude, _TONE_S, q) for name in ("sin", "cos"))
    return Included("tone", (CHANNELS[h.channel],), "S", {"hz": h.hz}, states)

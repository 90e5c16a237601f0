"""Evidence of slow effects beside drift: whitening by spectra, calibrated probabilities, steps as a part of drift."""

from dataclasses import dataclass

import numpy as np
import pytest
from helpers.runs import power_ons

from filters.channels import DPS
from filters.simulation import Effect
from filters.tracing.blocks import average
from filters.tracing.design_matrix import Design
from filters.tracing.evidence import PRIOR, Candidates, Judge, Rival
from filters.tracing.selection import select
from filters.tracing.spectrum import SLOPES, Spectrum, Whitening, covariances, density
from filters.tracing.stack import Stack
from filters.types import Array

ROW_S, COUNT = 5.0, 120
T: Array = ROW_S * (np.arange(COUNT) + 0.5)
STARTS = np.array([0, COUNT])
NAMES = ("slope", "bend", "relaxing")


@pytest.fixture(scope="module")
def whitening() -> Whitening:
    return Whitening(np.tile(T, 2), STARTS, np.ones(2 * COUNT), ROW_S)


def drift(rng: np.random.Generator, slope: float, period: float) -> Array:
    """White noise and drift of two power-ons; made from its spectrum, with lines 64 times closer than the record's."""
    size = 64 * COUNT
    f = np.fft.rfftfreq(size, ROW_S)[1:]
    density = 1.0 + (1.0 / (f * period)) ** slope
    out = []
    for _ in range(2):
        spectrum = np.sqrt(density * size / 2.0) * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
        out.append(np.fft.irfft(np.concatenate([[0.0], spectrum]), size)[:COUNT])
    return np.concatenate(out)


def inputs(rng: np.random.Generator) -> Array:
    """A temperature that wanders otherwise in each power-on, its square, and what settles after power-on."""
    knots = rng.uniform(-1.0, 1.0, (2, 6))
    x = np.concatenate([np.interp(T, np.linspace(0.0, T[-1], 6), own) for own in knots])
    return np.column_stack([x, x**2, np.tile(np.exp(-T / 150.0), 2)])


@dataclass(frozen=True)
class Case:
    truth: str
    rivals: list[Rival]

    @property
    def told(self) -> float:
        return sum(r.probability for r in self.rivals)


def case(whitening: Whitening, seed: int) -> Case:
    """Drift and an effect's size are drawn as the prior has them, but every second channel has an effect."""
    rng = np.random.default_rng([seed, 31])
    y = drift(rng, float(rng.choice(SLOPES[1:4])), float(rng.uniform(20.0, 300.0)))
    columns = inputs(rng)
    truth = ""
    if seed % 2:
        k = int(rng.integers(3))
        own = columns[:, k] - np.repeat([p.mean() for p in np.split(columns[:, k], 2)], COUNT)
        y += rng.standard_normal() * rng.choice([15.0, 50.0, 150.0, 500.0, 1500.0, 5000.0]) * own / np.linalg.norm(own)
        truth = NAMES[k]
    candidates = Candidates(whitening, columns, [np.array([k]) for k in range(3)], NAMES)
    return Case(truth, Judge(candidates, y, np.zeros((y.size, 0))).rivals())


@pytest.fixture(scope="module")
def cases(whitening: Whitening) -> list[Case]:
    return [case(whitening, seed) for seed in range(160)]


@pytest.mark.parametrize("slope", SLOPES)
def test_drift_has_its_density_which_falls_as_its_slope_says(slope: float) -> None:
    n, rows = 2048, 1.0
    made = covariances(np.arange(n) * rows, rows)[SLOPES.index(slope)]
    assert density(slope, 100.0, rows) / density(slope, 50.0, rows) == pytest.approx(2.0**slope, rel=0.1)
    window = np.hanning(n)
    for period in (40.0, 80.0):
        line = window * np.exp(-2j * np.pi * np.arange(n) / period)
        power = float((line.conj() @ made @ line).real / np.sum(window**2)) * rows
        assert power == pytest.approx(density(slope, period, rows), rel=0.05)


def test_whitened_drift_is_white_under_its_own_spectrum(whitening: Whitening) -> None:
    k = min(
        range(len(whitening.spectra)),
        key=lambda k: abs(whitening.spectra[k].slope - 1.4) + abs(np.log(whitening.spectra[k].period / 100.0)),
    )
    own = whitening.spectra[k]
    made = [whitening.white(k, drift(np.random.default_rng(s), own.slope, own.period)[:, None]) for s in range(40)]
    squares = [float(np.sum(w**2)) / (2 * COUNT - 2) for w in made]
    assert np.mean(squares) == pytest.approx(1.0, abs=0.08)
    assert whitening.spectra[0] == Spectrum(0.0, np.inf)


def test_probabilities_are_right_as_often_as_they_say(cases: list[Case]) -> None:
    """With every second case an effect: odds of one in ten are turned into odds of one in two, then counted."""
    odds = np.array([c.told / max(1e-12, 1.0 - c.told) * (1.0 - PRIOR) / PRIOR for c in cases])
    told, true = odds / (1.0 + odds), np.array([bool(c.truth) for c in cases])
    for low, high in ((0.0, 0.3), (0.3, 0.8), (0.8, 1.0)):
        own = (told >= low) & (told <= high)
        expected, sd = told[own].sum(), np.sqrt(np.sum(told[own] * (1.0 - told[own])) + 1.0)
        assert abs(true[own].sum() - expected) < 3.0 * sd, (low, high, true[own].sum(), expected)
    assert np.sum(told > 0.8) > 30


def test_what_is_told_is_named(cases: list[Case]) -> None:
    told = [c for c in cases if c.told > 0.9 and c.truth]
    assert len(told) > 30
    assert np.mean([c.rivals[0].name == c.truth for c in told]) > 0.85
    assert sum(c.told > 0.5 for c in cases if not c.truth) <= 2


def test_a_step_at_any_time_is_drift_and_no_cause(whitening: Whitening) -> None:
    told = []
    for seed in range(20):
        rng = np.random.default_rng([seed, 7])
        y = drift(rng, 1.4, 150.0)
        y[int(rng.integers(20, 100)) : COUNT] += 12.0
        columns = inputs(rng)
        candidates = Candidates(whitening, columns, [np.array([k]) for k in range(3)], NAMES)
        told.append(sum(r.probability for r in Judge(candidates, y, np.zeros((y.size, 0))).rivals()))
    assert sum(p > 0.5 for p in told) <= 1


WALK = Effect("random_walk", ("gy",), {"dps_per_sqrt_s": 0.002})


@pytest.mark.parametrize(
    ("form", "effects"),
    [
        (lambda T, t: 0.03 * np.maximum(T - 27.0, 0.0), {"cause:kink(temperature)"}),
        (lambda T, t: 0.09 * np.log1p(t / 10.0), {"cause:creep(time)", "cause:power(time)"}),
    ],
)
def test_forms_that_the_catalogue_lacks_are_named_by_what_they_follow(form, effects: set[str]) -> None:  # type: ignore[no-untyped-def]
    runs = power_ons(WALK)
    for run in runs:
        assert run.temperature is not None
        run.reading[:, 1] += form(run.temperature, run.t) * DPS
    chosen = select(Design(Stack.of([average(run) for run in runs])), [1])
    (found,) = chosen.terms
    assert found.hypothesis.effect in effects

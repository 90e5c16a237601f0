"""Effects first, lines after: a delay of fast motion is no line, and lines stay lines, in its band and outside."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.runs import WHITE, run_of

from filters.attitude import exp
from filters.effects.lines import SpectralLine
from filters.motion import attitude_rows
from filters.motion.kinematics import attitudes
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Sine
from filters.simulation import Effect, Scenario
from filters.tracing.comparison import Compared, compare
from filters.tracing.line_search import lines_of
from filters.tracing.run import Run
from filters.types import Array

DEG = np.pi / 180.0
REST = Dwell((0.0, 0.0, 0.0), 12.0)
SHAKES = tuple(
    part
    for axis, hz in (("inner", 2.3), ("outer", 1.9), ("middle", 3.1), ("inner", 4.3))
    for part in (REST, Sine(axis, 8.0 * DEG, hz, 20.0))
)
SHAKEN = Profile((*SHAKES, REST, REST))
IN_BAND = 3.1


def shaken(*effects: Effect, seed: int = 1) -> Run:
    """Fast swings about each axis with rests between, 100 Hz."""
    scenario = Scenario(seed=seed, spec=WHITE, effects=effects, profile=SHAKEN)
    return run_of(scenario, 0, 100.0, SHAKEN.duration)


def with_tone(run: Run, hz: float, dps: float, channels: tuple[int, ...], where: Array | None = None) -> Run:
    """A run with a sine on gyros, all the time or at some samples only."""
    reading = run.reading.copy()
    tone = dps * DEG * np.sin(2.0 * np.pi * hz * run.t + 0.4)
    for c in channels:
        reading[:, c] += tone if where is None else np.where(where, tone, 0.0)
    return replace(run, reading=reading)


def compared(*runs: Run) -> Compared:
    return compare(runs, None, 0.25, 60.0, lambda share: None)


def delays(result: Compared) -> tuple[list[float], list[float]]:
    """Delays that were selected and their sds, s."""
    fit = result.chosen.fit()
    found = [k for k, term in enumerate(fit.terms) if term.hypothesis.effect == "delay"]
    return [float(fit.theta[k][0]) for k in found], [float(np.sqrt(fit.of(k)[1][0, 0])) for k in found]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_delay_of_fast_motion_is_a_delay(seed: int) -> None:
    result = compared(shaken(Effect("delay", (), {"tau_s": 0.004}), seed=seed))
    (tau,), _ = delays(result)
    assert tau == pytest.approx(0.004, rel=0.01)
    assert result.lines == []


def test_a_line_outside_the_band_is_found_beside_a_delay() -> None:
    run = with_tone(shaken(Effect("delay", (), {"tau_s": 0.004})), 21.0, 0.3, (0, 2))
    result = compared(run)
    (line,) = result.lines
    assert set(line.channels) == {"gx", "gz"}
    assert line.hz == pytest.approx(21.0, abs=0.02)
    assert delays(result)[0] == [pytest.approx(0.004, rel=0.01)]


def test_a_line_in_the_band_is_one_if_it_stays_at_rest() -> None:
    """At the frequency of a swing: found when it is there all the time, not when it comes with the motion only."""
    run = shaken()
    moves = np.abs(run.rates).sum(axis=1) > 0.0

    def sought(tone: Run) -> list[SpectralLine]:
        return lines_of([run], [tone])

    (line,) = sought(with_tone(run, IN_BAND, 0.4, (1,)))
    assert line.channels == ("gy",)
    assert line.hz == pytest.approx(IN_BAND, abs=0.01)
    assert sought(with_tone(run, IN_BAND, 0.4, (1,), moves)) == []


def test_a_line_that_wanders_is_one_beside_a_motion() -> None:
    run = shaken(Effect("delay", (), {"tau_s": 0.004}))
    reading, u = run.reading.copy(), run.t / run.t[-1]
    phase = 2.0 * np.pi * np.cumsum(22.0 + 2.0 * (u - 0.5)) / run.rate_hz
    for c in (0, 2):
        reading[:, c] += 0.3 * DEG * np.sin(phase)
    result = compared(replace(run, reading=reading))
    (line,) = result.lines
    assert line.wanders
    assert set(line.channels) == {"gx", "gz"}
    assert line.hz == pytest.approx(22.0, abs=0.2)
    assert line.width_hz == pytest.approx(1.8, abs=0.3)
    assert delays(result)[0] == [pytest.approx(0.004, rel=0.01)]


def optical(run: Run, seed: int) -> Run:
    """A run whose attitude comes from rows with noise of 0.02 degrees, and a gap of 3 s in the motion."""
    rng = np.random.default_rng(seed)
    turned = attitudes(run.angles) @ np.stack([exp(v) for v in 3e-4 * rng.standard_normal((run.t.size, 3))])
    kept = (run.t < 40.0) | (run.t > 43.0)
    known = attitude_rows.at_samples(run.t, run.t[kept], turned[kept])
    rests = attitude_rows.rests(run.t, run.reading[:, :3], run.reading[:, 3:], known)
    known = attitude_rows.at_rest(known, rests)
    return replace(
        run,
        angles=np.zeros((run.t.size, 3)),
        rates=known.rate,
        attitude=known.quaternion,
        flagged=np.repeat(known.unknown[:, None], 6, axis=1),
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_attitude_with_noise_and_a_gap_gives_the_delay(seed: int) -> None:
    result = compared(optical(shaken(Effect("delay", (), {"tau_s": 0.004}), seed=seed), seed))
    (tau,), (sd,) = delays(result)
    assert abs(tau - 0.004) < 3.0 * sd + 0.01 * 0.004
    assert result.lines == []
    assert [term.hypothesis.effect for term in result.chosen.terms if min(term.places) < 3] == ["delay"]

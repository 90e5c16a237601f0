"""Motions for a table under command: within what it can, enough to begin with, and the most telling one first."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from helpers.runs import WHITE, run_of
from hypothesis import given
from hypothesis import strategies as st

from filters.motion.profile import Profile
from filters.motion.segments import AXES, Dwell
from filters.simulation import Effect, Scenario
from filters.tracing import detectability, planning, table_motions
from filters.tracing.candidate_motions import CandidateMotion
from filters.tracing.table_motions import AxisRange, Table
from filters.tracing.trace import assessed

DEG = math.pi / 180.0
FREE = AxisRange(200.0 * DEG, 200.0 * DEG)
THREE: Table = dict.fromkeys(AXES, FREE)
ONE: Table = {"inner": AxisRange(100.0 * DEG, 50.0 * DEG)}
WITH_STOPS: Table = {"outer": AxisRange(30.0 * DEG, 50.0 * DEG, -100.0 * DEG, 80.0 * DEG), "inner": FREE}


def joined(motions: Sequence[CandidateMotion]) -> Profile:
    first = motions[0].profile
    return Profile(
        tuple(segment for motion in motions for segment in motion.profile.segments), slew=first.slew, accel=first.accel
    )


@pytest.mark.parametrize("table", [THREE, ONE, WITH_STOPS])
def test_no_motion_goes_beyond_what_the_axes_can(table: Table) -> None:
    """Rates, accelerations and stops hold at every instant, and an axis that is not there does not move."""
    judge = table_motions.held_out(table, None)
    assert judge is not None
    for motion in (*table_motions.start(table), *table_motions.rounds(table, 30.0), judge):
        t = np.linspace(0.0, motion.seconds, 20_000)
        angles, rates = motion.profile.angles(t), motion.profile.rates(t)
        for k, axis in enumerate(AXES):
            own = table.get(axis, AxisRange(0.0, 0.0, 0.0, 0.0))
            assert np.abs(rates[:, k]).max() <= own.rate * 1.001 + 1e-9, motion.description
            assert own.low - 1e-6 <= angles[:, k].min(), motion.description
            assert angles[:, k].max() <= own.high + 1e-6, motion.description
        rests = [segment.angles for segment in motion.profile.segments if isinstance(segment, Dwell)]
        for one, other in itertools.pairwise(rests):
            turned = [abs(math.remainder(a - b, 2.0 * math.pi)) for a, b in zip(one, other, strict=True)]
            assert max(turned) < 179.0 * DEG, f"{motion.description}: half a turn has two ways"


@pytest.mark.parametrize(
    ("axis", "fits"),
    [
        (AxisRange(61.0 * DEG, 101.0 * DEG), True),
        (AxisRange(59.0 * DEG, 101.0 * DEG), False),
        (AxisRange(61.0 * DEG, 99.0 * DEG), False),
        (AxisRange(61.0 * DEG, 101.0 * DEG, -85.0 * DEG), False),
        (AxisRange(61.0 * DEG, 101.0 * DEG, -math.inf, 170.0 * DEG), False),
    ],
)
def test_a_motion_beyond_a_limit_does_not_fit(axis: AxisRange, fits: bool) -> None:
    """Six positions, from -90 to 180 deg with moves of 60 deg/s and 100 deg/s²: each limit by itself refuses them."""
    motion = next(m for m in table_motions.rounds(THREE, None) if "six positions" in m.description)
    assert table_motions.fits(motion.profile, dict.fromkeys(AXES, axis)) is fits


def test_the_first_motions_let_all_be_told_that_takes_no_hour() -> None:
    """Of an unknown unit everything that motion shows is testable after them, and not after some of them."""

    def hidden(motions: Sequence[CandidateMotion]) -> set[tuple[str, bool]]:
        d = detectability.of_motion(joined(motions))[-1]
        return {(q.effect, q.channel.startswith("g")) for q, value in d.items() if value < detectability.TESTABLE}

    first = table_motions.start(THREE)
    assert sum(motion.seconds for motion in first) < 400.0
    assert hidden(first) == {("nonlinearity_cubic", False), ("earth_rate", False)}
    for left_out in first:
        assert len(hidden([motion for motion in first if motion is not left_out])) > 2


@given(st.floats(0.001, 0.999), st.floats(0.0, 30.0))
def test_a_test_tells_at_most_what_is_not_known(p: float, d: float) -> None:
    """Its information is that of the choice if it decides, nothing if it sees nothing, and the same for both sides."""
    all_of_it = -(p * math.log2(p) + (1.0 - p) * math.log2(1.0 - p))
    assert 0.0 <= planning.information(p, d) <= all_of_it + 1e-9
    assert planning.information(p, 0.0) == pytest.approx(0.0, abs=1e-9)
    assert planning.information(p, 40.0) == pytest.approx(all_of_it, abs=1e-6)
    assert planning.information(p, d) == pytest.approx(planning.information(1.0 - p, d), abs=1e-6)


def test_the_information_of_a_test_is_that_of_its_draws() -> None:
    """Log odds that are drawn leave as much open on average as the integral says."""
    p, d, rng = 0.3, 1.5, np.random.default_rng(1)
    truth = rng.random(400_000) < p
    x = rng.standard_normal(truth.size) + d * truth
    after = 1.0 / (1.0 + (1.0 - p) / p * np.exp(-(d * x - 0.5 * d * d)))
    left = -(after * np.log2(after) + (1.0 - after) * np.log2(1.0 - after)).mean()
    before = -(p * math.log2(p) + (1.0 - p) * math.log2(1.0 - p))
    assert planning.information(p, d) == pytest.approx(before - left, abs=3e-3)


@pytest.fixture(scope="module")
def known() -> planning.Assessment:
    """Of a unit whose z gyro has a scale error, after it was turned about the inner axis at one rate."""
    motion = table_motions.commanded("turns", table_motions.turned(ONE, "inner", (0.5, -0.5)), ONE)
    assert motion is not None
    effect = Effect("scale", ("gz",), {"relative": 0.004})
    scenario = Scenario(seed=3, spec=WHITE, profile=motion.profile, effects=(effect,))
    return assessed([run_of(scenario, seconds=motion.seconds)], None)


def test_the_motion_that_tells_rivals_apart_comes_first(known: planning.Assessment) -> None:
    """What scales with a rate is told from what does not by other rates, be they those of moves; not by rest."""
    motions = table_motions.rounds(ONE, None)
    planner = planning.Planner(known, motions, 200.0, 15.0)
    assert any("gz" in dispute.channels for dispute in planner.disputes)
    first = planner.chosen(0.0)[0]
    assert first.between is not None
    assert "gz" in first.between.channels
    assert first.motion.profile.max_rate > 50.0 * DEG  # those at hand were made at 47.5
    assert first.rivals > 0.5
    rest = next(motion for motion in motions if motion.still)
    assert planning.Planner(known, [rest], 200.0, 15.0, [rest.description]).chosen(0.0) == []


def test_what_is_planned_already_is_not_worth_the_same_again(known: planning.Assessment) -> None:
    """Of two motions alike the second is expected to tell less than the first."""
    motion = next(
        m for m in table_motions.rounds(ONE, None) if "four rates" in m.description and "turn" in m.description
    )
    planner = planning.Planner(known, [motion, motion], 200.0, 15.0)
    both = planner.chosen(10_000.0)
    assert both
    left = both[1].bits if len(both) == 2 else planner.best_bits()
    assert left < 0.8 * both[0].bits


def test_a_kind_of_motion_is_new_once(known: planning.Assessment) -> None:
    """What no effect stands for may show in any motion that was not made, at whatever tilt; made once it is not new."""
    slow = [m for m in table_motions.rounds(THREE, None) if "slowly" in m.description]
    assert len(slow) > 2
    first, *others = planning.Planner(known, slow, 200.0, 15.0).chosen(10_000.0)
    assert first.new == planning.WORTH
    assert all(other.new == 0.0 for other in others)
    again = planning.Planner(known, slow, 200.0, 15.0, [slow[0].description])
    assert again.chosen(10_000.0, only_new=True) == []

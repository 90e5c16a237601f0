"""The experiment asked for: it can be carried out, and once it is, the truth leads."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.turned import lacking

from filters.effects.deterministic import thermal_scale
from filters.effects.hypothesis import Hypothesis
from filters.effects.temperature import lag
from filters.imu import AxisMap, ImuSpec
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate
from filters.simulation import Effect, PowerOn, Scenario, Temperature, Unit
from filters.tracing import candidate_motions, experiment, selection
from filters.tracing.blocks import average
from filters.tracing.candidate_motions import CandidateMotion, ObservedRange
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.tracing.findings import rivals
from filters.tracing.run import Run, rest_attitudes
from filters.tracing.stack import Stack
from filters.tracing.trace import trace
from filters.tracing.trace_document import SEPARATES
from imutui import scenario
from imutui.logbook import reference_file

DEG = np.pi / 180.0
WHITE = ImuSpec(gyro_bandwidth=0.0, accel_bandwidth=0.0)
STILL_HZ, MOVING_HZ = 2.0, 20.0
COLD = Temperature()  # 24 degC and 6 K more after ten minutes
COLD_S = 1800.0
TURNS = Profile(
    (Dwell((0.0, 0.0, 0.0), 20.0), Rate("inner", 30 * DEG, 40.0), Rate("inner", -30 * DEG, 40.0)), align="gyro"
)
SIX = Profile(
    tuple(Dwell((o * DEG, m * DEG, 0.0), 20.0) for o, m in ((0, 0), (90, 0), (180, 0), (-90, 0), (0, 90), (0, -90)))
)


def performed(
    effects: Sequence[Effect], seed: int, thermal: Any = None, profile: Profile | None = None, seconds: float = COLD_S
) -> Run:
    """One power-on, its temperature read to 0.05 K with noise."""
    temperature = COLD if thermal is None else Temperature(tuple((t, T) for t, T in thermal))
    hz = STILL_HZ if profile is None or len(profile.segments) == 1 else MOVING_HZ
    made = Scenario(
        seed=5,
        spec=WHITE,
        effects=tuple(effects),
        profile=profile,
        temperature=temperature,
        power_ons=(PowerOn(seed=seed),),
    )
    recorded = Unit(made, 0, hz).record(round(seconds * hz))
    axes = AxisMap()
    reading = np.hstack(
        [axes.gyro_to_instrument(recorded.samples.gyro), axes.accel_to_instrument(recorded.samples.accel)]
    )
    noise = np.random.default_rng(seed).normal(0.0, 0.02, reading.shape[0])
    read = np.round((recorded.temperature_degc + noise) / 0.05) * 0.05
    angles = rest_attitudes(recorded.angles)
    rates = recorded.rates[: len(angles)]
    return Run(f"run {seed}", recorded.samples.t, reading, read, angles, rates, axes, made.site)


def designed(*runs: Run) -> Design:
    return Design(Stack.of([average(run, 1.0 if run.still else 0.5) for run in runs]))


def named(design: Design, effect: str, channel: int, **shape: float | str) -> Term:
    """The first term of an effect on a channel, of a shape."""
    return next(
        a
        for a in design.terms
        if a.hypothesis.effect == effect
        and channel in a.places
        and all(a.hypothesis.shape.get(key) == value for key, value in shape.items())
    )


def added(design: Design, hypothesis: Hypothesis) -> Term:
    """A hypothesis that the design has left out, since these runs don't tell it from another."""
    columns = [hypothesis.columns(blocks.slow(), hypothesis.channel) for blocks in design.stack.blocks]
    return design.add(hypothesis, np.vstack(columns))


def of_size(design: Design, term: Term, d: float) -> np.ndarray:
    """Parameter with which the runs at hand show an effect at so many standard deviations."""
    information = sum(design.gram(c)[0][p[0], p[0]] for c, p in term.places.items())
    return np.array([d / np.sqrt(information)])


def leading(design: Design, channel: int) -> str:
    """Effect with the best score on a channel."""
    chosen = selection.select(design, [channel])
    own = {a.hypothesis.effect: chosen.own_gain(a) - chosen.price(a) for a in chosen.on(channel)}
    return max(own, key=lambda effect: own[effect], default="")


def again(made: dict[str, Any], effects: Sequence[Effect], seed: int) -> Run:
    """The run that was asked for; the case follows the chamber a minute late, and rounds its corners."""
    profile = made.profile
    t = np.arange(0.0, made.duration_s, 4.0)
    T = lag(np.interp(t, *np.array(made.thermal).T), 60.0 / 4.0)
    return performed(effects, seed, zip(t.tolist(), T.tolist(), strict=True), profile, made.duration_s)


@pytest.fixture(scope="module")
def cold() -> Design:
    return designed(performed((), 1))


@pytest.fixture(scope="module")
def tumbled() -> Design:
    return designed(performed((), 2, profile=SIX, seconds=SIX.duration))


def all_candidates() -> list[CandidateMotion]:
    return candidate_motions.candidates(
        ObservedRange(22.0, 28.0, 32.0, ((0.0, 22.0), (1800.0, 28.0)), 90 * DEG), moving=True
    )


def test_cooling_and_reheating_tells_temperature_from_its_rate_where_a_cold_start_does_not(cold: Design) -> None:
    a, b = named(cold, "thermal_lin", 1), named(cold, "thermal_rate", 1)
    options = experiment.CandidateRuns(cold, cold.stack.blocks[0].run).options(a, of_size(cold, a, 40.0), [b])
    d = {o.candidate.description.split(",")[0]: o.d[0] for o in options}
    print({description: round(value, 1) for description, value in d.items()})
    assert options[0].candidate.description.startswith("cool the warm unit down by 10 K and heat it again")
    assert 40.0 < d["cool the warm unit down by 10 K and heat it again"] < 160.0
    assert d["switch the unit off until it has the room's temperature and start it again"] < 4.0


PAIRS = [
    (Effect("thermal_lin", ("gy",), {"dps_per_k": 0.05}), "thermal_rate", 1, None),
    (Effect("thermal_rate", ("gz",), {"dps_s_per_k": 28.0}), "thermal_lin", 2, None),
    (Effect("warmup", ("ax",), {"mg": 6.0, "tau_s": 400.0}), "thermal_lin", 3, None),
    (Effect("scale", ("gz",), {"relative": 0.005}), "nonlinearity_cubic", 2, TURNS),
    (Effect("nonlinearity_cubic", ("gz",), {"dps_per_dps3": 5e-6}), "scale", 2, TURNS),
    (Effect("g_sensitivity", ("gx",), {"z_dps_per_g": 0.15}), "harmonic", 0, SIX),
]


@pytest.mark.parametrize(("truth", "rival", "channel", "profile"), PAIRS, ids=[f"{p[0].name}-{p[1]}" for p in PAIRS])
def test_after_the_run_asked_for_the_truth_leads(
    truth: Effect, rival: str, channel: int, profile: Profile | None
) -> None:
    names = []
    for seed in (10, 20, 30):
        first = performed([truth], seed, profile=profile, seconds=COLD_S if profile is None else profile.duration)
        design = designed(first)
        found = leading(design, channel)
        a, b = (named(design, name, channel) for name in sorted((truth.name, rival), key=lambda name: name != found))
        made = experiment.separating(design, a, design.fit([a]).theta[0], [b], first)
        assert made is not None
        assert made.a == found
        assert made.d_expected > SEPARATES
        names.append(leading(designed(first, again(made, [truth], seed + 1)), channel))
    assert names.count(truth.name) >= 2
    assert rival not in names


def test_performing_the_worst_plan_leaves_the_rivals(cold: Design) -> None:
    """The same cold start again: the loser is then still within what chance gives, which is why it is not asked for."""
    truth = Effect("thermal_lin", ("gy",), {"dps_per_k": 0.05})
    design = designed(performed([truth], 10), performed([truth], 11))
    chosen = selection.select(design, [1])
    (found,) = chosen.on(1)
    effects = {found.hypothesis.effect, *(r.term.hypothesis.effect for r in rivals(chosen, found))}
    assert {"thermal_lin", "thermal_rate"} <= effects


def test_gravity_is_never_told_from_a_common_scale_factor(tumbled: Design) -> None:
    gravity = next(a for a in tumbled.terms if a.hypothesis.effect == "gravity")
    x, y, z = (named(tumbled, "scale", c) for c in (3, 4, 5))
    run = tumbled.stack.blocks[0].run
    options = experiment.CandidateRuns(tumbled, run).options(gravity, of_size(tumbled, gravity, 40.0), [z], [x, y])
    assert len(options) > 15
    assert max(o.d[0] for o in options) < 0.01
    assert experiment.separating(tumbled, gravity, of_size(tumbled, gravity, 40.0), [z], run, [x, y]) is None


def test_one_scale_factor_is_told_from_gravity(tumbled: Design) -> None:
    """Gravity would show on all three accelerometers: shared parameters are taken over all channels."""
    run = tumbled.stack.blocks[0].run
    scale, gravity = named(tumbled, "scale", 5), named(tumbled, "gravity", 5)
    made = experiment.separating(tumbled, scale, of_size(tumbled, scale, 40.0), [gravity], run)
    assert made is not None
    assert made.d_expected > SEPARATES


def test_an_effect_too_small_to_separate_says_so(cold: Design) -> None:
    a, b = named(cold, "thermal_lin", 1), named(cold, "thermal_rate", 1)
    made = experiment.separating(cold, a, of_size(cold, a, 0.7), [b], cold.stack.blocks[0].run)
    assert made is not None
    assert 1.0 < made.d_expected < SEPARATES
    assert made.motion.startswith("nothing known separates them; nearest comes ")


def test_a_way_without_a_chamber_is_named_where_it_will_do(cold: Design) -> None:
    a, b = named(cold, "thermal_lin", 1), named(cold, "warmup", 1, tau_s=400.0)
    made = experiment.separating(cold, a, of_size(cold, a, 40.0), [b], cold.stack.blocks[0].run)
    assert made is not None
    assert "in a chamber" in made.motion
    assert "or, without a chamber: switch the warm unit off" in made.motion


def test_a_free_curve_is_left_behind_by_larger_rates() -> None:
    """A driver keeps its knots, and is constant beyond them: a straight line goes on."""
    design = designed(performed((), 3, profile=TURNS, seconds=TURNS.duration))
    a, b = named(design, "scale", 2), named(design, "driver:wz", 2)
    made = experiment.separating(design, a, of_size(design, a, 40.0), [b], design.stack.blocks[0].run)
    assert made is not None
    assert made.d_expected > 20.0
    assert made.profile.max_rate > 40 * DEG


def test_more_that_was_found_takes_from_what_a_plan_shows(cold: Design) -> None:
    """The rest of the selection is projected out like the rival: d cannot grow by it."""
    run = cold.stack.blocks[0].run
    a, b = named(cold, "thermal_lin", 1), named(cold, "thermal_rate", 1)
    rest = [named(cold, "hysteresis", 1, width_k=10.0), named(cold, "warmup", 1, tau_s=120.0)]
    candidate_runs = experiment.CandidateRuns(cold, run)
    alone, beside = (candidate_runs.options(a, of_size(cold, a, 40.0), [b], others) for others in ([], rest))
    least = {o.candidate.description: o.d[0] for o in beside}
    assert all(least[o.candidate.description] <= o.d[0] + 0.5 for o in alone if o.d[0] > 5.0)


def test_a_step_beside_it_does_not_happen_again() -> None:
    truth = [Effect("thermal_lin", ("gy",), {"dps_per_k": 0.05}), Effect("step", ("gy",), {"dps": 0.2, "at_s": 900.0})]
    run = performed(truth, 10)
    design = designed(run)
    chosen = selection.select(design, [1])
    step = next(a for a in chosen.terms if a.hypothesis.effect == "step")
    a, b = named(design, "thermal_lin", 1), named(design, "thermal_rate", 1)
    made = experiment.separating(design, a, of_size(design, a, 40.0), [b], run, [step])
    assert made is not None
    assert made.d_expected > 40.0


def test_of_several_rivals_most_are_separated_at_once(cold: Design) -> None:
    run = cold.stack.blocks[0].run
    design = designed(run)
    a = named(design, "thermal_lin", 5)
    rivals = [
        added(design, thermal_scale(5)),
        named(design, "thermal_rate", 5),
        named(design, "warmup", 5, tau_s=400.0),
    ]
    made = experiment.separating(design, a, of_size(design, a, 40.0), rivals, run)
    assert made is not None
    assert made.leaves == ()
    assert made.d_expected > SEPARATES
    assert "and again at" in made.motion


def test_a_cause_of_absurd_size_is_not_worth_a_run() -> None:
    """A gyro at rest that drifts with temperature might have a scale factor of thirty times Earth rate: it has not."""
    run = performed([Effect("thermal_rate", ("gz",), {"dps_s_per_k": 28.0})], 40)
    design = designed(run)
    a = added(design, thermal_scale(2))
    rivals = [named(design, "thermal_lin", 2), named(design, "thermal_rate", 2)]
    made = experiment.separating(design, a, design.fit([a]).theta[0], rivals, run)
    assert made is not None
    assert (made.a, made.b) == ("thermal_lin", "thermal_rate")
    assert "heat it again" in made.motion


def test_what_no_plan_separates_stays_possible(cold: Design) -> None:
    run = cold.stack.blocks[0].run
    a = named(cold, "thermal_lin", 1)
    made = experiment.separating(cold, a, of_size(cold, a, 40.0), [a, named(cold, "thermal_rate", 1)], run)
    assert made is not None
    assert made.b == "thermal_rate"
    assert made.leaves == ("thermal_lin",)
    assert "(thermal_lin would stay possible)" in made.motion


def test_without_a_thermometer_only_motions_are_asked_for() -> None:
    known = performed((), 3, profile=TURNS, seconds=TURNS.duration)
    run = Run("blind", known.t, known.reading, None, known.angles, known.rates, known.axes, known.site)
    design = designed(run)
    a, b = named(design, "scale", 2), named(design, "nonlinearity_cubic", 2)
    made = experiment.separating(design, a, of_size(design, a, 40.0), [b], run)
    assert made is not None
    assert made.thermal is None
    assert "degC" not in made.motion
    assert "warmed up" not in made.motion


def test_a_trace_asks_for_an_experiment_when_rivals_are_left() -> None:
    truth = Effect("scale", ("gz",), {"relative": 0.01})
    found = trace([performed([truth], 10, profile=TURNS, seconds=TURNS.duration)], None)
    assert found.document["status"]["gz"] == "confounded"
    made = found.experiment
    assert made is not None
    assert made.d_expected > SEPARATES
    assert "turn" in made.motion or "swing" in made.motion


# ----------------------------------------------------------------------------------------------- candidate motions


@pytest.mark.parametrize("candidate", all_candidates(), ids=lambda candidate: candidate.description[:60])
def test_a_candidate_comes_back_from_its_text(candidate: CandidateMotion) -> None:
    profile = candidate.profile
    assert reference_file.from_document(tomllib.loads(reference_file.to_toml(profile))) == profile
    assert candidate.seconds > 90.0
    assert candidate.thermal is not None
    t, T = np.array(candidate.thermal).T
    assert t[0] == 0.0
    assert t[-1] == pytest.approx(candidate.seconds)
    assert (np.diff(t) > 0.0).all()
    assert T.min() >= 22.0
    assert T.max() <= 32.0


def test_the_library_has_what_tells_effects_apart() -> None:
    description = [candidate.description for candidate in all_candidates()]
    assert len(set(description)) == len(description) == 24
    parts = ("eighteen positions", "slowly, twice round", "±30 and ±90", "swing", "and again at 32 degC", "start it")
    for part in parts:
        assert any(part in w for w in description)


def test_what_was_asked_for_drives_a_scenario(tmp_path: Path) -> None:
    candidate = next(p for p in all_candidates() if "and again at" in p.description)
    (tmp_path / "experiment.toml").write_text(reference_file.to_toml(candidate.profile))
    assert candidate.thermal is not None
    history = [list(point) for point in candidate.thermal]
    lines = ["seed = 1", 'profile = "experiment.toml"', "[temperature]", f"history = {history}"]
    (tmp_path / "scenario.toml").write_text("\n".join(lines))
    made = scenario.load_scenario(tmp_path / "scenario.toml")
    assert made.profile == candidate.profile
    recorded = Unit(made, 0, 5.0).record(round(5.0 * candidate.seconds))
    assert recorded.temperature_degc[0] == pytest.approx(22.0)
    assert recorded.temperature_degc[-1] == pytest.approx(32.0)
    assert np.ptp(recorded.angles, axis=0).max() > DEG * 180.0


def test_an_experiment_separates_causes_of_channels_of_which_one_is_missing() -> None:
    """A table that is tilted, or gravity that is off, on a unit without its third accelerometer."""
    run = lacking(performed([Effect("gravity", (), {"relative": 3e-3})], 1, profile=SIX, seconds=SIX.duration), "az")
    design = designed(run)
    a, b = (next(x for x in design.terms if x.hypothesis.effect == name) for name in ("gravity", "tilt"))
    made = experiment.separating(design, a, np.array([3e-3]), [b], run)
    assert made is not None
    assert np.isfinite(made.d_expected)

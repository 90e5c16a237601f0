"""Curve, memory and drift chosen jointly: what they say of a leg apart, how sure they are, what is carried over."""

from functools import cache

import numpy as np
import pytest
from helpers.cycles import PERIOD, Cycle, cycle
from helpers.runs import parts_of, power_ons

from filters.channels import CHANNELS, DPS
from filters.effects import catalogue
from filters.effects.inputs import LAGS
from filters.effects.records import Included
from filters.effects.runtime import CausalEffects
from filters.effects.thermal_average import ORDERS, ThermalAverage
from filters.motion.reference import COLUMNS
from filters.simulation import Effect, Temperature
from filters.tracing.blocks import average_all
from filters.tracing.result import Trace
from filters.tracing.run import Run
from filters.tracing.thermal_forms import Average, Form, all_forms, average
from filters.tracing.thermal_memory import carried_over, spreads, there_and_back
from filters.tracing.trace import trace
from imutui.logbook import effects_file

KINDS = ("none", "lag", "play", "both")
SEEDS = range(10, 22)
HOLD = round(60.0 / PERIOD)


@cache
def third_leg(seed: int) -> tuple[Cycle, Average, float, float, float, float]:
    """A cycle fitted on two legs; errors of the third as it is, corrected, with a plain cubic; z of its end."""
    made = cycle(seed, KINDS[seed % 4])
    fitted, rest = slice(0, made.ends[1]), slice(made.ends[1], None)
    found = average(made.rows(fitted), 0)
    X = made.columns(fitted)
    cubic = np.polyval(np.polyfit(made.T[fitted], made.y[fitted], 3), made.T)
    errors = [_after_hold((made.y - said)[rest]) for said in (0.0, X @ found.weights, cubic)]
    moved = X[-5:].mean(axis=0) - X[rest][:HOLD].mean(axis=0)
    wandered = made.walk**2 * (made.t[-1] - made.t[made.ends[1]]) + made.sd**2 / 5.0
    end = (made.y - X @ found.weights)[rest]
    z = (end[-5:].mean() - end[:HOLD].mean()) / np.sqrt(moved @ found.covariance @ moved + wandered)
    return made, found, *errors, float(z)


def _after_hold(r: np.ndarray) -> float:
    return float(np.sqrt(np.mean((r[HOLD:] - r[:HOLD].mean()) ** 2)))


def test_a_third_leg_is_foretold_from_two() -> None:
    legs = [third_leg(seed) for seed in SEEDS]
    held, ours, cubic = (np.array([leg[k] for leg in legs]) for k in (2, 3, 4))
    assert np.exp(np.mean(np.log(ours / held))) < 0.33
    assert np.exp(np.mean(np.log(ours / cubic))) < 0.6
    assert np.mean(ours > 1.1 * held) <= 0.2


def test_errors_at_the_end_of_the_third_leg_are_as_large_as_their_sd() -> None:
    """Within and between forms, with the walk: over cycles the error over its standard deviation is about 1."""
    z = np.array([third_leg(seed)[5] for seed in SEEDS])
    assert 0.5 < np.sqrt(np.mean(z**2)) < 2.0


def test_two_spreads_hold_most_of_what_forms_differ_in_on_the_way_back() -> None:
    shares = []
    for seed in SEEDS:
        made, found, *_ = third_leg(seed)
        fitted = slice(0, made.ends[1])
        X = made.columns(fitted)[made.ends[1] :]
        X = X - X[:HOLD].mean(axis=0)
        kept = sum(float(np.sum((X @ d) ** 2)) for d in spreads(there_and_back(made.rows(fitted))[1], found.covariance))
        shares.append(kept / float(np.einsum("ij,jk,ik->", X, found.covariance, X)))
    assert np.median(shares) > 0.6
    assert max(shares) < 1.0 + 1e-6


def test_weights_are_shares_of_the_evidence() -> None:
    for seed in SEEDS:
        found = third_leg(seed)[1]
        weights = [form.weight for form in found.forms]
        assert weights == sorted(weights, reverse=True)
        assert 0.98 < sum(weights) <= 1.0 + 1e-9
        of_families = [weight for _, weight in found.families]
        assert of_families == sorted(of_families, reverse=True)
        assert sum(of_families) <= 1.0 + 1e-9
        assert found.score <= found.none


def test_a_lag_alone_is_found_as_one() -> None:
    made = cycle(5, "none", scale=0.0)
    k = LAGS.index(320.0)
    y = 0.5 * made.columns(slice(None))[:, ORDERS + k] + 0.003 * np.random.default_rng(1).standard_normal(made.t.size)
    found = average(Cycle(made.t, made.T, y, 0.003, 1e-6, made.ends).rows(slice(0, made.ends[1])), 0)
    form, weight = found.families[0]
    assert form.effect == "thermal_lag"
    assert weight > 0.6
    assert form.lag is not None
    assert abs(form.lag - k) <= 1


def test_forms_are_all_there_is_once() -> None:
    forms = all_forms()
    assert len({(f.order, f.lag, f.bank) for f in forms}) == len(forms)
    assert forms[0].places == []
    assert forms[0].effect == ""
    assert Form(3, 0, 0).places == [0, 1, 2, ORDERS, ORDERS + len(LAGS)]


def share(made: Cycle, fitted: slice) -> float:
    """What is carried over of what was fitted."""
    rows = made.rows(fitted)
    return carried_over(*there_and_back(rows), average(rows, 0))


def test_after_one_way_only_what_hysteresis_may_be_is_not_carried_over() -> None:
    """The catalogue's plausible hysteresis is 0.3 deg/s: of less nothing is known on the way back, of much more all."""
    for seed in (10, 14):
        made = cycle(seed, "none")
        one, two = slice(0, made.ends[0]), slice(0, made.ends[1])
        curve = 1.0 / np.ptp(made.T[one]) * (made.T - made.T[0])
        of_span = [
            Cycle(made.t, made.T, made.y * 0.0 + span * curve, 0.01, 1e-6, made.ends) for span in (0.1, 1.0, 10.0)
        ]
        once, both = ([share(own, legs) for own in of_span] for legs in (one, two))
        assert once == sorted(once)
        assert once[0] < 0.5
        assert once[2] > 0.8
        assert all(after_both > after_one for after_one, after_both in zip(once, both, strict=True))
        assert both[2] > 0.99


def test_the_way_that_temperature_went_is_known_better_than_the_way_back() -> None:
    for seed in SEEDS:
        made = cycle(seed, KINDS[seed % 4])
        rows = made.rows(slice(0, made.ends[0]))
        found = average(rows, 0)
        there, back = (np.einsum("ij,jk,ik->i", x - x[0], found.covariance, x - x[0]) for x in there_and_back(rows))
        assert np.mean(there) < 0.3 * np.mean(back)


# ------------------------------------------------------------------------------------------------------- in a trace

CHAMBER = Temperature(((0.0, 45.0), (700.0, -10.0), (1500.0, 55.0), (2000.0, 20.0)))
LAGGING = Effect("thermal_lag", ("gy",), {"dps_per_k": 0.03, "tau_s": 320.0})
CURVED = Effect("thermal_lin", ("gy",), {"dps_per_k": 0.02})


@cache
def chamber() -> tuple[list[Run], Trace]:
    """A unit that goes through a chamber; the last 500 s, cooling, held out as a part of the same power-on."""
    (run,) = power_ons(LAGGING, CURVED, seed=3, count=1, seconds=2000.0, hz=2.0, histories=(CHAMBER,))
    parts = parts_of(run, (1500.0, 1500.0))
    return parts, trace(parts[:1], parts[1])


def _e10(made: Trace, channel: str) -> float:
    (entry,) = [x for x in made.document["error"] if x["metric"] == "e10" and x["channel"] == channel]
    assert entry["after"] is not None
    assert entry["before"] is not None
    return entry["after"] / entry["before"]


def test_a_trace_joins_the_average_and_names_its_forms() -> None:
    made = chamber()[1]
    (finding,) = made.document["findings"]
    assert finding["effect"] == "thermal_lag"
    assert finding["channels"] == ["gy"]
    by_name = {p["name"]: p["value"] for p in finding["params"]}
    assert 0.9 < by_name["carried_over"] < 1.0
    assert by_name["k_lag"] == pytest.approx(0.03, rel=0.2)
    assert 180.0 <= by_name["tau"] <= 640.0
    weights = [rival["weight"] for rival in finding["rivals"]]
    assert 0.0 < by_name["weight"] + sum(weights) <= 1.0 + 1e-9
    assert finding["confirmed"] is True
    assert _e10(made, "gy") < 0.33


def test_the_filter_takes_the_average_that_was_judged() -> None:
    parts, made = chamber()
    document = effects_file.parse(effects_file.dumps(made, "a test").encode())
    (own,) = [e for e in document.effects if e.include_as == "A"]
    assert own == _included(made)
    assert np.array_equal(document.correlation, made.correlation)
    whole = [s.temperature for s in parts]
    T = np.concatenate([x for x in whole if x is not None])
    filtered = CausalEffects([own], np.eye(len(own.states)), parts[0].axes, parts[0].site, 0.5)
    t, zeros = 0.5 * np.arange(T.size), np.zeros((T.size, 3))
    phi = filtered.rows(t, zeros, zeros, T, np.full((T.size, COLUMNS), np.nan))[0]
    h = average_of(own)
    theirs = np.concatenate([h.columns(b.slow(), 1) for b in average_all(parts)])
    ours = parts[0].axes.gyro_to_instrument(np.moveaxis(phi[:, 3:], 1, 2))[:, :, 1]
    late = slice(60, None)  # smoothing from the past begins with the first reading
    difference = (ours - theirs)[late] - (ours - theirs)[late].mean(axis=0)
    assert np.abs(difference[:, 0]).max() < 0.03 * np.ptp(theirs[:, 0])
    assert np.ptp(theirs[:, 0]) > 0.5 * DPS


def _included(made: Trace) -> Included:
    (own,) = [e for e in made.included if e.include_as == "A"]
    return own


def average_of(own: Included) -> ThermalAverage:
    h = catalogue.hypothesis(own.effect, own.channels, own.parameters)
    assert isinstance(h, ThermalAverage)
    return h


def test_little_temperature_leaves_the_selection_alone() -> None:
    mild = Temperature(((0.0, 20.0), (600.0, 32.0), (1200.0, 18.0)))
    made = trace(power_ons(CURVED, seed=4, count=1, seconds=1200.0, hz=4.0, histories=(mild,)), None)
    assert [f["effect"] for f in made.document["findings"]] == ["thermal_lin"]
    assert "form" not in made.document["findings"][0]["shape"]


def test_quiet_channels_have_no_average() -> None:
    for seed in (1, 2):
        (run,) = power_ons(seed=seed, count=1, seconds=2000.0, hz=2.0, histories=(CHAMBER,))
        made = trace([run], None)
        assert made.document["findings"] == []
        assert set(made.document["status"]) == set(CHANNELS)

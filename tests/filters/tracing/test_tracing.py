"""The whole trace on simulated power-ons: clean stays clean, what is there is named, doubt is said, contracts hold."""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers.runs import HISTORIES, TUMBLE, power_ons
from helpers.turned import lacking

from filters.effects import catalogue
from filters.effects.runtime import CausalEffects
from filters.imu import AxisMap
from filters.simulation import Effect
from filters.state import PAPER_SITE
from filters.tracing.result import Trace
from filters.tracing.trace import trace
from filters.tracing.trace_document import TraceFindings
from imutui.declared import problem

CHANNELS = ("gx", "gy", "gz", "ax", "ay", "az")
METRICS = {"e10", "nis", "drift_10s", "drift_60s", "bias_prediction", "coverage", "gravity_norm", "gravity_direction"}


@cache
def many(seed: int) -> Trace:
    """Something of everything, on channels of their own; two power-ons to learn from and one held out."""
    runs = power_ons(
        Effect("thermal_lin", ("gy",), {"dps_per_k": 0.02}),
        Effect("warmup", ("ax",), {"mg": 4.0, "tau_s": 120.0}),
        Effect("noise_level", ("ay",), {"log_variance_per_unit": 0.12, "driver": "temperature"}),
        Effect("gauss_markov", ("az",), {"mg": 2.0, "tau_s": 40.0}),
        Effect("tone", ("gx",), {"dps": 0.3, "hz": 4.3}),
        Effect("step", ("gz",), {"dps": 0.15, "at_s": 350.0}),
        seed=seed,
    )
    return trace(runs[:2], runs[2], seed=seed, asked=("thermal_lin",))


def found(t: Trace) -> dict[tuple[str, str], dict[str, Any]]:
    return {(f["effect"], " ".join(f["channels"])): f for f in t.document["findings"]}


def errors(t: Trace, metric: str, channel: str) -> dict[str, Any]:
    (figure,) = [e for e in t.document["error"] if (e["metric"], e["channel"]) == (metric, channel)]
    return dict(figure)


def test_clean_logs_stay_clean() -> None:
    findings, others, states = 0, 0, []
    for seed in range(1, 11):
        runs = power_ons(seed=seed, count=2, seconds=500.0)
        document = trace(runs[:1], runs[1]).document
        findings += len(document["findings"])
        others += sum(len(document[name]) for name in ("drift", "integrity", "lines", "noise_level", "remainder"))
        states += list(document["status"].values())
    assert findings <= 1
    assert others <= 1
    assert states.count("clean") >= len(states) - 3


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_several_effects_at_once_are_named_each_on_its_channel(seed: int) -> None:
    t = many(seed)
    own = found(t)
    assert set(own) == {("thermal_lin", "gy"), ("warmup", "ax"), ("step", "gz")}
    for key, truth in ((("thermal_lin", "gy"), 0.02), (("warmup", "ax"), 4.0)):
        k = own[key]["params"][0]
        assert abs(k["value"] - truth) < 3.0 * k["sd"]
        assert k["sd"] < 0.1 * truth
        assert k["plausible"] is True
        assert own[key]["confirmed"] is True
        assert own[key]["share_of_excess"] > 0.8
    assert t.document["status"] == {
        "gx": "explained",
        "gy": "explained",
        "gz": "run_specific",
        "ax": "explained",
        "ay": "explained",
        "az": "stochastic",
    }
    assert [d["channels"] for d in t.document["drift"]] == [["az"]]
    assert [(level["channels"], level["driver"]) for level in t.document["noise_level"]] == [(["ay"], "temperature")]
    assert [line["channels"] for line in t.document["lines"]] == [["gx"]]
    assert t.document["lines"][0]["hz"] == pytest.approx(4.3, abs=0.01)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_held_out_error_comes_down_to_its_floor(seed: int) -> None:
    for channel, before in (("gy", 3.0), ("ax", 1.2)):
        error = errors(many(seed), "e10", channel)
        assert error["before_x_floor"] > before
        assert error["after_x_floor"] < 1.3
        assert errors(many(seed), "nis", channel)["after"] < 1.25
    assert errors(many(seed), "drift_60s", "all")["after"] < errors(many(seed), "drift_60s", "all")["before"]


@pytest.mark.parametrize(
    "drift",
    [
        Effect("gauss_markov", ("ax",), {"mg": 1.4, "tau_s": 20.0}),
        Effect("random_walk", ("ax",), {"mg_per_sqrt_s": 0.14}),
    ],
)
def test_drift_that_was_fitted_is_honest_on_another_run(drift: Effect) -> None:
    figures = []
    for seed in range(4):
        runs = power_ons(drift, seed=seed, hz=4.0)
        figures.append(errors(trace(runs[:2], runs[2], seed=seed), "nis", "ax"))
    squares = np.array([f["after"] ** 2 for f in figures])
    assert np.mean([f["before"] for f in figures]) > 1.5
    # levels are known to a tenth from two runs of 15 minutes, which makes it a little more than one
    assert np.mean(squares) == pytest.approx(1.1, abs=0.2)
    assert sum(f["ci95"][0] < 1.0 < f["ci95"][1] for f in figures) >= 3


def test_one_cold_start_is_never_better_than_confounded() -> None:
    for seed in range(1, 4):
        runs = power_ons(Effect("thermal_lin", ("gy",), {"dps_per_k": 0.05}), seed=seed, count=1, histories=(None,))
        document = trace(runs, None).document
        assert document["status"]["gy"] in ("confounded", "stochastic", "partial")
        named = {f["effect"] for f in document["findings"]}
        named |= {r["effect"] for f in document["findings"] for r in f["rivals"]}
        assert "thermal_lin" in named or document["status"]["gy"] == "stochastic"
        assert all(f["confirmed"] is None for f in document["findings"])
        assert {e["heldout"] for e in document["error"]} == {"folds"}


def test_the_separating_experiment_is_of_a_finding_and_its_rivals() -> None:
    runs = power_ons(Effect("thermal_lin", ("gy",), {"dps_per_k": 0.05}), seed=2, count=1, histories=(None,))
    t = trace(runs, None)
    made = t.experiment
    assert made is not None
    families = [{f["effect"], *(r["effect"] for r in f["rivals"])} for f in t.document["findings"]]
    assert any({made.a, made.b, *made.leaves} <= family for family in families)
    if made.d_expected >= 5.0:
        assert "Next: to tell" in t.document["sentence"]


def test_the_result_ends_with_what_to_do_next() -> None:
    assert many(1).document["sentence"].endswith("with --effects of replay and record.")
    with_it = power_ons(Effect("thermal_lin", ("gy",), {"dps_per_k": 0.02}))
    contradicted = trace(with_it[:2], power_ons()[2]).document["sentence"]
    assert "Next: record more power-ons" in contradicted


def test_a_tone_has_amplitude_and_frequency() -> None:
    runs = power_ons(Effect("tone", ("gx",), {"dps": 0.05, "hz": 0.4}), hz=8.0)
    (tone,) = trace(runs[:2], runs[2]).document["findings"]
    amplitude, frequency = tone["params"]
    assert (amplitude["name"], frequency["name"]) == ("amplitude", "frequency")
    assert amplitude["value"] == pytest.approx(0.05, abs=3.0 * amplitude["sd"])
    assert amplitude["sd"] < 0.01
    assert frequency["value"] == pytest.approx(0.4, abs=1e-3)
    assert tone["share_of_excess"] is None


def test_a_tone_is_as_large_as_in_the_runs_that_have_its_channel() -> None:
    """Two of three runs lack the channel: they say nothing of the amplitude, not that there is none."""
    runs = power_ons(Effect("tone", ("gx",), {"dps": 0.05, "hz": 0.4}), hz=8.0)
    made = trace([runs[0], lacking(runs[1], "gx"), lacking(runs[2], "gx")], None)
    (tone,) = made.document["findings"]
    amplitude = tone["params"][0]
    assert amplitude["value"] == pytest.approx(0.05, abs=4.0 * amplitude["sd"])
    (included,) = [effect for effect in made.included if effect.effect == "tone"]
    # sine and cosine of the filter's states have half the square each
    assert included.states[0].sd == pytest.approx(amplitude["value"] / np.sqrt(2.0))


def test_a_parameter_that_no_channel_shows_is_correlated_with_none() -> None:
    """One gyro of a unit that sits turned feels two of the three angles: the third had NaN for its correlation."""
    turned = Effect("mounting", (), {"x_rad": 0.005, "y_rad": 0.004, "z_rad": -0.005})
    (run,) = power_ons(turned, count=1, profile=TUMBLE, seconds=TUMBLE.duration)
    made = trace([lacking(run, "gx", "gz", "ax", "ay", "az")], None)
    assert [effect.effect for effect in made.included if effect.effect == "mounting"]
    assert np.allclose(np.diag(made.correlation), 1.0)
    assert (np.abs(made.correlation) <= 1.0 + 1e-9).all()


def test_a_channel_with_only_faults_is_clean() -> None:
    runs = power_ons(count=2)
    reading = runs[0].reading.copy()
    reading[[4000, 9000], 1] += 2.0
    document = trace([replace(runs[0], reading=reading)], runs[1]).document
    assert [(f["effect"], f["channels"]) for f in document["integrity"]] == [("spikes", ["gy"])]
    assert document["status"]["gy"] == "clean"


def test_one_run_does_not_explain_by_temperature_even_without_a_rival() -> None:
    t = trace(power_ons(Effect("thermal_lin", ("gy",), {"dps_per_k": 0.02}), count=1), None)
    assert found(t)["thermal_lin", "gy"]["rivals"] == []
    assert t.document["status"]["gy"] == "confounded"


def test_a_still_log_says_what_it_cannot_show() -> None:
    runs = power_ons(count=1, seconds=1800.0, hz=10.0, histories=(None,))
    hidden = trace(runs, None).document["untestable"]
    assert {u["effect"] for u in hidden if u["reason"] != "collinear_with"} == {
        *("scale", "asymmetry", "nonlinearity_cubic", "nonlinearity_quadratic", "cross_axis", "mounting"),
        *("g_sensitivity", "g_squared", "tilt", "gravity", "lever_arm", "delay", "harmonic", "earth_rate"),
    }
    assert {u["effect"] for u in hidden if u["reason"] == "no_excitation"} == {"delay", "lever_arm"}
    alike = {frozenset((u["effect"], u["with"])) for u in hidden if u["reason"] == "collinear_with"}
    assert frozenset(("thermal_lin", "thermal_rate")) in alike
    assert frozenset(("thermal_lin", "warmup")) in alike
    assert all(0.99 < u["rho"] <= 1.0 + 1e-9 for u in hidden if u["reason"] == "collinear_with")


def test_a_table_that_turns_shows_nearly_all() -> None:
    runs = power_ons(Effect("gravity", (), {"relative": 3e-3}), profile=TUMBLE, seconds=TUMBLE.duration)
    t = trace(runs[:2], runs[2])
    hidden = {u["effect"] for u in t.document["untestable"] if u["reason"] != "collinear_with"}
    assert hidden <= {"earth_rate"}
    gravity = found(t)["gravity", "ax ay az"]
    assert gravity["params"][0]["value"] == pytest.approx(3e-3, abs=3.0 * gravity["params"][0]["sd"])
    assert "scale" in [r["effect"] for r in gravity["rivals"]]
    assert [t.document["status"][c] for c in CHANNELS] == ["clean"] * 3 + ["confounded"] * 3
    assert "not told from scale factor" in t.document["sentence"]


def test_what_the_held_out_run_contradicts_is_refuted() -> None:
    with_it = power_ons(Effect("thermal_lin", ("gy",), {"dps_per_k": 0.02}))
    without = power_ons()
    t = trace(with_it[:2], without[2])
    assert ("thermal_lin", "gy") not in found(t)
    (refuted,) = t.document["refuted"]
    assert (refuted["effect"], refuted["channels"], refuted["metric"]) == ("thermal_lin", ["gy"], "e10")
    assert t.document["status"]["gy"] == "unexplained"
    assert t.included == ()
    error = errors(t, "e10", "gy")
    assert error["after"] == pytest.approx(refuted["after_with"])
    assert error["after"] > 2.0 * error["before"]
    assert refuted["after_without"] == pytest.approx(error["before"])
    assert "Refuted by the held-out run: gy" in t.document["sentence"]


@pytest.mark.parametrize("axes", [AxisMap(accel_sign=1), AxisMap(np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]))])
def test_sign_and_mounting_do_not_matter(axes: AxisMap) -> None:
    runs = power_ons(Effect("thermal_lin", ("ax",), {"mg_per_k": 0.5}), axes=axes, seconds=600.0)
    t = trace(runs[:2], runs[2])
    k = found(t)["thermal_lin", "ax"]["params"][0]
    assert abs(k["value"] - 0.5) < 3.0 * k["sd"]


def test_a_document_is_what_the_contract_says() -> None:
    again = json.loads(json.dumps(many(1).document, allow_nan=False))
    assert problem(again, TraceFindings, "trace", exact=True) == ""
    assert set(again["status"]) == set(CHANNELS)
    for f in again["findings"]:
        assert f["effect"] in catalogue.EFFECTS or f["effect"].startswith("driver:")
        assert set(f["channels"]) <= set(CHANNELS)
        assert f["include_as"] in "ANSP"
    for e in again["error"]:
        assert e["metric"] in METRICS
        assert len(e["ci95"]) == len(e["floor_band95"]) == 2
        assert e["floor_band95"][0] <= e["floor_band95"][1]
        assert e["after_x_floor"] == pytest.approx(e["after"] / e["floor"])
    assert METRICS - {e["metric"] for e in again["error"]} == {"gravity_norm", "gravity_direction"}


def test_an_effect_that_was_asked_for_has_its_limit_said() -> None:
    limits = {limit["channels"][0]: limit for limit in many(1).document["limits"]}
    assert "gy" not in limits
    assert 0.0 < limits["gx"]["limit"] < 0.02
    assert "below what this log can show" in limits["gx"]["text"]


def test_what_was_found_joins_the_filter() -> None:
    t = many(1)
    kinds = {(i.effect, i.channels): i for i in t.included}
    drift = t.document["drift"][0]["kind"]
    assert set(kinds) == {("thermal_lin", ("gy",)), ("warmup", ("ax",)), (drift, ("az",)), ("noise_level", ("ay",))}
    effects = CausalEffects(t.included, t.correlation, AxisMap(), PAPER_SITE, 0.05)
    assert effects.covariance.shape == (3, 3)
    assert np.allclose(np.diag(t.correlation), 1.0)
    thermal = kinds["thermal_lin", ("gy",)].states[0]
    assert thermal.mean == pytest.approx(0.02, abs=3.0 * thermal.sd)


def test_series_show_the_residual_before_and_after() -> None:
    t = many(1)
    assert [s.run for s in t.series] == ["run 1", "run 2", "run 3"]
    held = t.series[-1]
    assert np.nanstd(held.after[:, 1]) < np.nanstd(held.before[:, 1])
    assert np.array_equal(held.after[:, 0], held.before[:, 0])
    assert held.t.size == held.before.shape[0]


def test_what_cannot_be_traced_is_refused() -> None:
    with pytest.raises(ValueError, match="empty"):
        trace([], None)
    (short,) = power_ons(count=1, seconds=4.0)
    with pytest.raises(ValueError, match="less than 20 means, 5 s"):
        trace([short], None)


def test_progress_goes_from_nothing_to_all() -> None:
    shares: list[float] = []
    runs = power_ons(count=1, seconds=120.0, histories=HISTORIES)
    trace(runs, None, progress=lambda share, text: shares.append(share))
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    assert shares == sorted(shares)


def test_a_run_without_temperature_is_traced_all_the_same() -> None:
    runs = [replace(run, temperature=None) for run in power_ons(count=2, seconds=600.0)]
    document = trace(runs[:1], runs[1]).document
    assert document["findings"] == []
    hidden = {u["effect"]: u["reason"] for u in document["untestable"]}
    assert hidden["thermal_lin"] == "no_excitation"

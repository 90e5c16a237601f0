"""Units turned by hand: rests, effects with honest standard deviations, errors judged on what is left out."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.paths import DATA
from helpers.turned import ACCELEROMETERS, GYROS, TRUTH, lacking, shaken, turned_run, values

from filters.imu import AxisMap, parse_mount
from filters.multiposition import accelerometer
from filters.multiposition.accelerometer import Rests
from filters.multiposition.calibration import Calibration, calibrate
from filters.multiposition.report import notes, report
from filters.multiposition.rests import distinct_directions, find_rests
from filters.tracing.run import Run
from filters.tracing.trace_document import FindingEntry, TraceFindings

AXES = (AxisMap(accel_sign=1), AxisMap(), AxisMap(parse_mount("y,-x,z"), -1))


def told(found: Calibration) -> TraceFindings:
    """What is reported."""
    return report(found, (), 0).document


def by_channel(document: TraceFindings) -> dict[tuple[str, str], FindingEntry]:
    """Findings by channel and effect."""
    return {(f["channels"][0], f["effect"]): f for f in document["findings"]}


def error(document: TraceFindings, metric: str) -> dict[str, float]:
    """The one figure of a metric."""
    return next(e for e in document["error"] if e["metric"] == metric)


def test_effects_of_a_unit_are_found_within_their_standard_deviations_whatever_sign_and_mounting() -> None:
    scores: dict[str, list[float]] = {}
    for seed in range(11, 14):
        run = turned_run(*ACCELEROMETERS, *GYROS, seed=seed, axes=AXES[seed % 3])
        document = told(calibrate([run], None))
        found = by_channel(document)
        assert set(found) == set(TRUTH)
        for key, truth in TRUTH.items():
            value, sd = values(found[key]["params"])
            scores.setdefault(key[0][0] + key[1], []).extend((value - np.array(truth)) / sd)
        assert error(document, "gravity_norm")["after"] < 0.1 < 5.0 < error(document, "gravity_norm")["before"]
        direction = error(document, "gravity_direction")
        assert direction["after"] < 0.05 < 1.0 < direction["before"]
    for kind, z in scores.items():
        assert np.abs(z).max() < 5.0, kind
        assert 0.4 < float(np.sqrt(np.mean(np.square(z)))) < 1.6, kind


def test_what_an_effect_explains_is_told_of_all_but_a_gyros_bias() -> None:
    """Its share of the excess over noise, by rests and turns left out; a rest shows a gyro's bias by itself."""
    shares = {
        (f["channels"][0][0], f["effect"]): f["share_of_excess"]
        for f in told(calibrate([turned_run(*ACCELEROMETERS, *GYROS, seed=11)], None))["findings"]
    }
    known = {key: share for key, share in shares.items() if share is not None}
    assert shares.keys() - known.keys() == {("g", "bias")}
    assert all(0.0 <= share <= 1.0 for share in known.values())
    assert known["a", "bias"] > 0.1


def test_a_unit_without_errors_has_no_findings_but_small_biases() -> None:
    for seed in (21, 22):
        document = told(calibrate([turned_run(seed=seed, biased=False)], None))
        assert not document["findings"]
        assert set(document["status"].values()) <= {"clean", "unexplained"}
        assert list(document["status"].values()).count("clean") >= 5


@pytest.mark.parametrize(
    ("name", "gravity", "aim", "before"),
    [
        ("xsens_mti_multiposition", 9.81744, 0.3, 103.0),
        ("mpu9150_multiposition_unit0", None, 0.4, 22.0),
        ("mpu9150_multiposition_unit1", None, 1.0, 20.0),
    ],
)
def test_measured_units_read_gravity_at_rests_that_were_left_out(
    name: str, gravity: float | None, aim: float, before: float
) -> None:
    """Three measured recordings: the magnitude of gravity within what a nine-parameter fit is known to reach."""
    path = DATA / f"{name}.npz"
    if not path.exists():
        pytest.skip(f"{path.name} is not here")
    document = told(calibrate([measured(name, gravity)], None))
    norm = error(document, "gravity_norm")
    assert norm["after"] <= aim
    assert norm["before"] == pytest.approx(before, rel=0.03)
    direction = error(document, "gravity_direction")
    assert direction["after"] < 0.1 * direction["before"]


def measured(name: str, gravity: float | None) -> Run:
    """A measured recording as a run."""
    with np.load(DATA / f"{name}.npz") as z:
        reading = np.hstack([np.deg2rad(z["gyro"].astype(float)), z["accel"].astype(float) * 9.80665])
        t = z["t"] - z["t"][0]
    run = turned_run(rests=2)
    site = run.site if gravity is None else replace(run.site, gravity=gravity)
    return replace(run, name=name, t=t, reading=reading, temperature=None, site=site)


def test_rests_are_found_where_the_unit_rests() -> None:
    run = turned_run(*ACCELEROMETERS, seed=5)
    rests = find_rests(run)
    assert len(rests) == 24
    assert all(3.5 < rest.seconds < 4.5 for rest in rests)
    assert distinct_directions(rests) >= 9


def test_a_violent_shake_is_no_rest_and_spoils_no_turn() -> None:
    run = turned_run(*ACCELEROMETERS, seed=6)
    rests = find_rests(run)
    bad = shaken(run, rests[8].start_s + 0.5, rests[8].start_s + 3.8, 40.0)
    again = find_rests(bad)
    assert len(again) == len(rests) - 1
    assert not any(abs(rest.start_s - rests[8].start_s) < 2.0 for rest in again)
    before, after = (by_channel(told(calibrate([r], None))) for r in (run, bad))
    for key in (("ax", "scale"), ("gz", "bias")):
        (a, sd), (b, _) = values(before[key]["params"]), values(after[key]["params"])
        assert np.abs(a - b).max() < 4.0 * sd.max()


def test_fewer_than_nine_directions_give_bias_and_scale_and_say_the_rest() -> None:
    run = turned_run(*ACCELEROMETERS[:3], seed=7, rests=8)
    document = told(calibrate([run], None))
    assert {"cross_axis"} <= {u["effect"] for u in document["untestable"]}
    found = by_channel(document)
    assert not [key for key in found if key[1] == "cross_axis" and key[0][0] == "a"]
    value, sd = values(found["ax", "bias"]["params"])
    assert abs(value[0] - TRUTH["ax", "bias"][0]) < 5.0 * sd[0]
    assert "nine directions" in document["sentence"]


def test_two_directions_tell_what_they_can_and_no_more() -> None:
    document = told(calibrate([turned_run(*ACCELEROMETERS, seed=8, rests=2, seconds=40.0)], None))
    assert {"bias", "scale", "cross_axis"} <= {u["effect"] for u in document["untestable"]}
    assert not [e for e in document["error"] if e["metric"] == "gravity_norm"]


def dead(run: Run, channel: int, value: float) -> Run:
    """A recording of which a channel reads the same throughout."""
    reading = run.reading.copy()
    reading[:, channel] = value
    return replace(run, reading=reading)


# turns take all three gyros; and with one that is dead no second would be as quiet as its quietest
@pytest.mark.parametrize(
    ("spoilt", "left", "noted"),
    [
        (lambda run: lacking(run, "gx", "gy", "gz"), set(), "gx, gy, gz not recorded"),
        (lambda run: lacking(run, "gy"), {"gx", "gz"}, "gy not recorded"),
        (lambda run: dead(run, 1, 0.01), {"gx", "gz"}, "gy not recorded, or dead"),
    ],
)
def test_without_all_gyros_the_accelerometers_are_calibrated_and_the_rest_is_said(
    spoilt: Callable[[Run], Run], left: set[str], noted: str
) -> None:
    found = calibrate([spoilt(turned_run(*ACCELEROMETERS, seed=9))], None)
    document = told(found)
    assert set(document["status"]) == left | {"ax", "ay", "az"}
    assert found.gyros is None
    assert ("ay", "cross_axis") in by_channel(document)
    assert any(noted in note for note in notes(found))
    assert [e["metric"] for e in document["error"]] == ["gravity_norm"]


def test_without_an_accelerometer_or_without_a_rest_the_message_says_what_to_do() -> None:
    run = turned_run(seed=9)
    with pytest.raises(ValueError, match="accelerometer y was not recorded"):
        calibrate([lacking(run, "ay")], None)
    with pytest.raises(ValueError, match=r"accelerometer y .* reads the same throughout"):
        calibrate([dead(run, 4, 0.1)], None)
    rng = np.random.default_rng(1)
    level = rng.uniform(0.0, 1.0, run.t.size).cumsum()[:, None]
    wild = replace(run, reading=run.reading + np.exp(0.02 * level) * 1e-9 + 0.1 * np.sin(0.01 * level**1.5))
    short = replace(wild, t=run.t[:90], reading=wild.reading[:90], temperature=None)
    with pytest.raises(ValueError, match="no rest was found"):
        calibrate([short], None)


def test_another_log_of_the_unit_judges_and_another_unit_contradicts() -> None:
    first, second = (turned_run(*ACCELEROMETERS, *GYROS, seed=seed) for seed in (31, 32))
    document = told(calibrate([first], second))
    shared = [f for f in document["findings"] if f["effect"] != "bias" or f["channels"][0][0] == "a"]
    assert len(shared) >= 12
    assert all(f["confirmed"] for f in shared)
    assert error(document, "gravity_norm")["heldout"] == "run"
    assert error(document, "gravity_norm")["after"] < 0.1
    assert error(document, "gravity_direction")["after"] < 0.05

    document = told(calibrate([first], turned_run(seed=33)))
    refuted = {(r["channels"][0], r["effect"]) for r in document["refuted"]}
    assert ("az", "scale") in refuted
    assert len(refuted) >= 2
    assert all(r["after_with"] > r["after_without"] for r in document["refuted"])
    assert document["status"]["az"] in ("partial", "unexplained")


def test_several_logs_share_what_is_the_units_and_keep_a_gyro_bias_each() -> None:
    first, second = (turned_run(*ACCELEROMETERS, *GYROS, seed=seed) for seed in (41, 42))
    reading = second.reading.copy()
    reading[:, 0] += np.deg2rad(0.3)
    trace = report(calibrate([first, replace(second, reading=reading)], None), (), 0)
    found = by_channel(trace.document)
    value, _ = values(found["gx", "bias"]["params"])
    assert value[1] - value[0] == pytest.approx(0.3, abs=0.02)
    assert len(found["gx", "scale"]["params"]) == 1
    own = next(i for i in trace.included if (i.effect, i.channels) == ("bias", ("gx",)))
    assert own.states[0].mean == pytest.approx(value.mean())
    assert own.states[0].sd > 0.1


def test_a_common_scale_factor_may_as_well_be_gravity() -> None:
    run = turned_run(seed=51)
    document = told(calibrate([replace(run, site=replace(run.site, gravity=run.site.gravity * 0.998))], None))
    scales = [f for f in document["findings"] if f["effect"] == "scale" and f["channels"][0][0] == "a"]
    assert len(scales) == 3
    assert all([r["effect"] for r in f["rivals"]] == ["gravity"] for f in scales)
    assert {document["status"][c] for c in ("ax", "ay", "az")} == {"confounded"}
    apart = next(u for u in document["untestable"] if u["effect"] == "gravity")
    assert (apart["reason"], apart["with"]) == ("collinear_with", "scale")


def test_the_derivative_of_the_magnitude_is_that_of_the_model() -> None:
    rests = Rests.of(find_rests(turned_run(*ACCELEROMETERS, seed=3)), 9.78637)
    triad = accelerometer.triad_of(*accelerometer.FORMS, accelerometer.BEYOND[:4])
    # plausible sizes: a quadratic term of 1e-2 s²/m would be as large as gravity
    theta = np.random.default_rng(0).standard_normal(triad.size) * ([1e-2] * 9 + [1e-4] * 3 + [1e-5])
    _, slope = rests.residuals(triad, theta)
    for k, step in enumerate(1e-6 * np.eye(triad.size)):
        numeric = (rests.errors(triad, theta + step) - rests.errors(triad, theta - step)) / 2e-6
        np.testing.assert_allclose(slope[:, k], numeric, atol=1e-5 * (1.0 + np.abs(numeric).max()))


def test_samples_at_the_converters_end_and_holes_are_told_and_their_turns_left_out() -> None:
    """Gyros that clip in two turns, a hole in a third: told with channel and count; the scale factors stay true."""
    run = turned_run(*ACCELEROMETERS, *GYROS, seed=12)
    rests = find_rests(run)
    limit = 0.8 * np.abs(run.reading[:, 2]).max()
    reading = run.reading.copy()
    reading[:, 2] = np.clip(reading[:, 2], -limit, limit)
    at = np.flatnonzero(np.abs(reading[:, 2]) == limit)
    hole = np.r_[: rests[4].last + 20, rests[4].last + 60 : run.t.size]
    spoilt = replace(run, t=run.t[hole], reading=reading[hole], temperature=None)
    found = calibrate([spoilt], None)
    document = told(found)
    told_of = {(e["effect"], tuple(e["channels"])): e for e in document["integrity"]}
    counted = sum(e["count"] for e in document["integrity"] if e["effect"] == "saturation")
    assert {effect for effect, _ in told_of} == {"saturation", "dropout"}
    assert counted >= 0.9 * at.size > 10
    assert any("left out: samples are missing" in note for note in notes(found))
    value, sd = values(by_channel(document)["gz", "scale"]["params"])
    assert abs(value[0] - 0.01) < 5.0 * sd[0]
    assert not told(calibrate([run], None))["integrity"]


def power_ons(count: int, seed: int, bias_sd: float, scale_sd: float = 0.0) -> list[Run]:
    """Power-ons of one unit between which accelerometer biases (m/s²) and scale factors differ so much, 1 sd."""
    rng = np.random.default_rng(seed)
    out = []
    for k in range(count):
        run = turned_run(*ACCELEROMETERS, *GYROS, seed=100 * seed + k, rests=20)
        reading = run.reading.copy()
        reading[:, 3:] *= 1.0 + scale_sd * rng.standard_normal(3)
        reading[:, 3:] += bias_sd * rng.standard_normal(3)
        out.append(replace(run, reading=reading))
    return out


def test_what_differs_between_power_ons_is_told_from_what_carries_over() -> None:
    """A bias that differs by 5 mg must be measured again, all else holds; a scale factor that differs likewise."""
    for seed, scale_sd in ((71, 0.0), (72, 2e-3)):
        *runs, last = power_ons(4, seed, 0.05, scale_sd)
        trace = report(calibrate(runs, last), (), 0)
        document = trace.document
        told_of = {(e["effect"], e["channels"][0][0]): e for e in document["carries_over"]}
        bias, scale = told_of["bias", "a"], told_of["scale", "a"]
        assert bias["measure_again"] is True
        assert bias["power_ons"] == 4
        assert bias["session_ci95"][0] < 0.05 / 9.80665e-3 < bias["session_ci95"][1]
        assert scale["measure_again"] is bool(scale_sd)
        assert told_of["cross_axis", "a"]["measure_again"] is False
        assert "must measure again: bias of the accelerometers" in document["sentence"]
        norm = error(document, "gravity_norm")
        assert norm["after_again"] < 0.1 < 2.0 < norm["after"] < norm["before"]
        assert error(document, "gravity_direction")["after_again"] < 0.1
        assert not [r for r in document["refuted"] if r["effect"] == "cross_axis"]
        own = {(i.effect, i.channels): i.states[0].sd for i in trace.included}
        assert 2.0 < own["bias", ("ax",)] < 20.0


def test_one_power_on_cannot_say_what_carries_over() -> None:
    """Also of a power-on whose later part judges."""
    run = turned_run(*ACCELEROMETERS, seed=73)
    document = told(calibrate([run], None))
    assert all(e["measure_again"] is None and e["session_sd"] is None for e in document["carries_over"])
    assert "Of one power-on" in document["sentence"]
    parts = [replace(each, power_on="a") for each in (run, turned_run(*ACCELEROMETERS, seed=74))]
    assert "Of one power-on" in told(calibrate(parts[:1], parts[1]))["sentence"]


def test_a_power_on_of_few_rests_spoils_nothing() -> None:
    """Where nothing differs biases are shared, so that four rests need not tell a bias of their own."""
    runs = [turned_run(*ACCELEROMETERS, *GYROS, seed=75 + k, rests=rests) for k, rests in enumerate((20, 4, 20))]
    document = told(calibrate(runs, None))
    assert error(document, "gravity_norm")["after"] < 0.1
    assert len(by_channel(document)["ax", "bias"]["params"]) == 1
    assert not [e for e in document["carries_over"] if e["measure_again"]]

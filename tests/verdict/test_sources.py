"""One verdict on a run: the same word from its last snapshot and from its result, and a headline that agrees."""

from typing import Any

import numpy as np
import pytest
from helpers.fake_client import bias, estimates
from helpers.shapes import whole

from filters.kalman.consistency import ConvergenceMonitor
from filters.kalman.temperature_trend import TemperatureTrend
from imutui.estimates import NAMES, Bias, Estimates
from imutui.logbook.results import ResultDocument
from imutui.verdict import rules, sources

QUIET = [{"channel": name, "ratio": 1.1, "windows": 6} for name in ("gx", "gy", "gz", "ax", "ay", "az")]
LOUD = [{**row, "ratio": 3.4} for row in QUIET]


def snapshot(**changes: Any) -> Any:
    """A filter of which nothing bad can be said."""
    return estimates(**{"biases": quiet(), "remainder": QUIET, "temperature_k_per_min": 0.02, **changes})


def quiet(changed: int = 0, **changes: Any) -> list[Bias]:
    """Biases that have converged; one of them may be changed."""
    made = [bias(name, 0.1, 0.02 if "gyro" in name else 0.3) for name in NAMES]
    made[changed] = made[changed]._replace(**changes)
    return made


def document(of: Any, **changes: Any) -> Any:
    """The result of a run whose last snapshot is `of`."""
    same = {key: of[key] for key in Estimates.__annotations__}
    return whole(ResultDocument, {**same, "log": "/logs/a.mcap", "duration_s": 61.0, **changes})


def unsettled(**changes: Any) -> Any:
    """The same with a bias that has not converged."""
    return snapshot(biases=quiet(2, converged_s=None, sd=0.4 / 3.0), **changes)


def shown(effect: str, extent: float, *, size: float = 1.0, shows: bool = True) -> list[dict[str, Any]]:
    """An effect on the y gyro."""
    numbers = {"size": size, "sd": 0.01, "unit": "deg/s", "extent": extent, "odds": 50.0, "t": 60.0, "since": 3.0}
    return [
        {"effect": effect, "channel": "gy", **numbers, "hz": None, "shows": shows, "text": f"gy {effect} (odds 50:1)"}
    ]


CASES = [
    (snapshot(), "GREEN", True),
    (snapshot(causes=shown("tone", 0.2)), "AMBER", False),
    (snapshot(causes=shown("tone", 0.04)), "GREEN", True),
    (snapshot(causes=shown("tone", 0.2, shows=False)), "GREEN", True),
    (snapshot(causes=shown("noise_level", 0.0, size=1.4)), "AMBER", False),
    (snapshot(causes=shown("noise_level", 0.0, size=1.1)), "GREEN", True),
    (snapshot(temperature_k_per_min=-0.4), "AMBER", False),
    (snapshot(confounded=["the table turned one way"]), "AMBER", False),
    (unsettled(), "AMBER", False),
    (snapshot(remainder=LOUD), "RED", False),
    (snapshot(departure="segment 5: ax reads 10.1 mg more than the model: scale factor of +1.00 %?"), "RED", False),
    (snapshot(alarms=["accelerometers are off the reference by 1.99 g"]), "RED", False),
]


@pytest.mark.parametrize(("of", "word", "passes"), CASES)
def test_a_result_has_the_word_that_its_last_snapshot_had(of: Any, word: str, passes: bool) -> None:
    """Its headline says "converged" above nothing that is RED."""
    over = document(of)
    for found in (rules.judge(of), sources.of_document(over)):
        assert (found.word, found.passes) == (word, passes)
    said = sources.headline(over)
    assert said.startswith(word)
    assert ("converged" in said) == (word != "RED")
    assert ("NOT converged" in said) == (of == unsettled())


def noise_of(gyros: float, relative_sd: float | None, y_gyro: float = 1.0) -> dict[str, Any]:
    """White noise as measured, the gyros' so many times what the filter takes for it, one of them more still."""
    used = {"gyro_arw_deg_sqrt_h": [4.5] * 3, "accel_vrw_mps_sqrt_h": [1.0] * 3}
    arw = [4.6 * gyros, 4.5 * gyros * y_gyro, None]
    measured = {"gyro_arw_deg_sqrt_h": arw, "accel_vrw_mps_sqrt_h": [1.1, 0.9, 1.0]}
    return {**measured, "relative_sd": relative_sd, "used": used}


@pytest.mark.parametrize(
    ("gyros", "relative_sd", "reference", "word"),
    [
        (1.9, 0.15, "level", "AMBER"),
        (1.9, 0.15, "gravity", "AMBER"),
        (1.9, 0.15, "profile", "GREEN"),
        (1.9, 0.19, "level", "GREEN"),
        (2.5, 0.25, "level", "GREEN"),
        (1.25, 0.01, "level", "GREEN"),
        (0.2, 0.01, "level", "GREEN"),
        (2.5, None, "level", "GREEN"),
    ],
    ids=["noisy", "tilted", "on a table that moves", "perhaps", "too soon", "a little", "quiet", "not known"],
)
def test_readings_that_are_noisier_than_the_filter_expects_are_told(
    gyros: float, relative_sd: float | None, reference: str, word: str
) -> None:
    found = rules.judge(snapshot(noise=noise_of(gyros, relative_sd), reference=reference))
    assert (found.word, found.passes) == (word, word == "GREEN")
    if word == "AMBER":
        assert "gyros are 1.9 × as noisy as the filter expects, so their ± are too small by as much" in found.reason
        assert "full rate" in found.todo


def test_what_moves_one_channel_alone_is_no_noise_of_the_unit() -> None:
    assert rules.judge(snapshot(noise=noise_of(1.0, 0.05, y_gyro=3.0))).word == "GREEN"


@pytest.mark.parametrize(("times", "least", "most"), [(1.0, 0, 1), (2.0, 40, 40)], ids=["as expected", "twice"])
def test_noise_as_expected_is_hardly_ever_called_too_much(times: float, least: int, most: int) -> None:
    rng = np.random.default_rng(5)
    called = 0
    for _ in range(40):
        monitor = ConvergenceMonitor(0.05)
        monitor.begin(0.0)
        for second in range(1, 301):
            monitor.close(float(second), times * rng.standard_normal(6), np.zeros(6), np.zeros(6), np.ones(6))
            noise, sd = monitor.noise(), monitor.noise_relative_sd()
            if noise is None or sd is None:
                continue
            measured = {"accel_vrw_mps_sqrt_h": noise[:3].tolist(), "gyro_arw_deg_sqrt_h": noise[3:].tolist()}
            used = {"accel_vrw_mps_sqrt_h": [1.0] * 3, "gyro_arw_deg_sqrt_h": [1.0] * 3}
            if rules.judge(snapshot(noise={**measured, "relative_sd": sd, "used": used})).word == "AMBER":
                called += 1
                break
    assert least <= called <= most


def test_live_a_wide_vertical_is_said_and_does_not_keep_from_green() -> None:
    """Three standard deviations of 7.8 mg because of the site are none of the filter's, which has 0.3 mg."""
    wide = {"sd": 7.8058 / 3.0, "site_sd": 2.6, "change_10s": 0.2}
    found = rules.judge(snapshot(biases=quiet(5, **wide)))
    assert found.word == "GREEN"
    assert "z accel is wide, as the site is not stated: --site LAT,LON,H" in found.reason
    assert rules.filter_sd(quiet(5, **wide)[5]) == pytest.approx(0.1, rel=0.01)
    waits = rules.judge(snapshot(biases=quiet(5, **wide, converged_s=None)))
    assert "z accel moves 2.0 sd in 10 s" in waits.reason


@pytest.mark.parametrize(
    ("model", "bias_dps", "word", "limit"),
    [
        ("IMU400CD-200", 0.9, "GREEN", "x gyro at 90 % of Table 1's, the most"),
        ("IMU400CD-200", 1.5, "RED", "Table 1's ±1 deg/s"),
        ("IMU381ZA-400", 0.9, "RED", "IMU440 data sheet's ±0.75 deg/s"),
        ("MPU-9150", 1.5, "GREEN", "not judged: the data sheet of this unit is not known"),
        ("", 1.5, "GREEN", "not judged: the data sheet of this unit is not known"),
    ],
)
def test_a_unit_is_judged_by_the_limits_of_its_kind(model: str, bias_dps: float, word: str, limit: str) -> None:
    """A limit that is not known is not judged, and is not called looked at."""
    found = rules.judge(snapshot(biases=quiet(0, value=bias_dps), identity={"instrument": model}))
    (check,) = [check for check in found.checks if check.name == "limit"]
    assert found.word == word
    assert limit in check.said
    if word == "GREEN":
        assert ("limits" in found.todo_at_length) == (check.level == "good")


@pytest.mark.parametrize(
    ("model", "said"),
    [
        ("IMU400CD-200", ("Table 1: 4.5", "Table 1: 1")),
        ("IMU381ZA-400", ("IMU440: 4.5", "IMU440: 1")),
    ],
)
def test_noise_is_beside_that_of_the_unit_s_own_sheet(model: str, said: tuple[str, str]) -> None:
    assert sources.noise_stated(document(snapshot(), identity={"instrument": model})) == said


def test_a_damaged_log_converged_only_in_the_part_that_can_be_read() -> None:
    said = sources.headline(document(snapshot(), damage="the file ends in the middle of a chunk"))
    assert said == "GREEN, converged in the 61.0 s of it that can be read: /logs/a.mcap"


def test_red_in_a_profile_names_the_position_and_traces_it_unless_something_has_to_be_put_right_first() -> None:
    """An effect of 1 % is no reference that belongs to something else; the place is named in either case."""
    said = "segment 5: ax reads 10.1 mg more than the model: scale factor of +1.00 %?"
    found = rules.judge(snapshot(departure=said))
    assert (found.reason, found.todo, found.brief) == (said, rules.TRACE_KEY, "segment 5: ax")
    assert sources.reasons(document(snapshot(departure=said))).endswith("? `imutui trace` looks for the cause.")
    gross = rules.judge(snapshot(departure=said, alarms=["90 updates were left out"]))
    assert (gross.reason.partition(";")[0], gross.todo) == (f"alarm: {said}", "put that right first")


def test_held_biases_are_told_with_the_verdict_and_are_not_waited_for() -> None:
    """Since when there is no reference stands beside whatever else is said; waiting would help nobody."""
    held = "no reference any more since 0:02:11, biases held"
    done = rules.judge(snapshot(held_since_s=131.2))
    assert done.reason == f"all 6 biases converged; means over 10 s are as noise allows; {held}"
    late = rules.judge(unsettled(held_since_s=131.2))
    assert (late.word, late.todo) == ("AMBER", "record again, with a longer reference")
    assert sources.of_document(document(snapshot(held_since_s=131.2))).reason == done.reason


def test_without_a_filter_only_an_alarm_is_judged() -> None:
    alone: Any = {"log": "/logs/a.mcap", "samples": 7, "alarms": [], "health": []}
    assert sources.of_document(alone).passes
    stopped = sources.of_document({**alone, "alarms": ["the filter stopped, recording goes on: no reference"]})
    assert (stopped.word, stopped.passes) == ("RED", False)


def test_the_trend_of_the_temperature_is_the_same_however_many_samples_come_at_once() -> None:
    t = np.arange(0.0, 95.0, 1.0 / 133.0)
    temperature = 25.0 + 0.4 * t / 60.0 + 0.02 * np.random.default_rng(1).standard_normal(t.size)
    temperature[::7] = np.nan
    found = []
    for size in (1, 13, 8192, t.size):
        trend = TemperatureTrend()
        for first in range(0, t.size, size):
            trend.take(t[first : first + size], temperature[first : first + size])
        found.append(trend.k_per_min())
    assert len(set(found)) == 1
    assert found[0] == pytest.approx(0.4, abs=0.02)
    brief = TemperatureTrend()
    brief.take(t[t < 25.0], temperature[t < 25.0])
    assert brief.k_per_min() is None
    assert TemperatureTrend().k_per_min() is None

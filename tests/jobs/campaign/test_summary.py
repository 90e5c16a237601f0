"""A summary tells units, model and days apart, what drifts and what fails, and says what it can't tell."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import fleets
from helpers.fleets import results

from filters import specification
from imutui.jobs.campaign import stored_rows, summary
from imutui.jobs.campaign.summary_document import ChannelField, GroupField
from imutui.logbook import json_text
from imutui.logbook.reader import UnreadableLogError

UNITS = ("0101", "0102", "0103", "0104")


def summed(rows: list[dict[str, Any]]) -> Any:
    return summary.summary(rows, "results.json")  # type: ignore[arg-type]


def channel(group: GroupField, name: str) -> ChannelField:
    (found,) = [one for one in group["channels"] if one["channel"] == name]
    return found


@cache
def drifting() -> GroupField:
    """Of four units with eight power-ons each the second drifts in az, and a day of the third is far off in ay."""
    rows = fleets.fleet(UNITS, 8, seed=3, drift_mg={"0102": 0.8}, finding=UNITS[:3])
    rows[21]["final"]["accel_bias_mg"][1] += 6.0
    (group,) = summed(rows)["groups"]
    found: GroupField = group
    return found


def test_parts_are_those_that_the_fleet_was_made_with() -> None:
    for name, key in (("ax", "accel_bias_mg"), ("gy", "gyro_bias_dps")):
        one = channel(drifting(), name)
        assert one["between_units"] is not None
        assert one["between_power_ons"] is not None
        assert one["between_units"]["low"] < fleets.UNIT_SD[key] < one["between_units"]["high"]
        assert one["between_power_ons"]["low"] < fleets.DAY_SD[key] < one["between_power_ons"]["high"]
        assert one["undetermined"] == []


def test_only_the_unit_that_drifts_is_said_to() -> None:
    told = {
        (unit["serial_number"], one["channel"]): unit["drift"]
        for one in drifting()["channels"]
        for unit in one["units"]
        if unit["drift"]["verdict"] != "none"
    }
    assert list(told) == [("0102", "az")]
    slope = told["0102", "az"]["per_month"]
    assert slope is not None
    assert slope["low"] < 0.8 < slope["high"]
    assert told["0102", "az"]["per_kelvin"] is not None


def test_a_day_out_of_control_is_told_with_its_log() -> None:
    out = [(u["serial_number"], p) for u in channel(drifting(), "ay")["units"] for p in u["points"] if p["outside"]]
    ((unit, point),) = out
    assert (unit, point["log"], point["start_utc"][:7] if point["start_utc"] else "") == (
        "0103",
        "0103/05.mcap",
        "2026-06",
    )
    assert point["high"] is not None
    assert point["value"] > point["high"]


def test_an_effect_of_three_units_in_four_is_the_models() -> None:
    (effect,) = drifting()["effects"]
    assert (effect["effect"], effect["channels"], effect["level"]) == ("thermal_lin", ["gx"], "model")
    assert (len(effect["units"]), effect["units_traced"]) == (3, 4)
    assert (effect["power_ons"], effect["power_ons_traced"], effect["confirmed"]) == (24, 32, 24)
    (parameter,) = effect["params"]
    assert parameter["model"] is not None
    assert parameter["model"]["low"] < 0.02 < parameter["model"]["high"]
    assert [unit["serial_number"] for unit in parameter["units"]] == list(UNITS[:3])


@pytest.mark.parametrize(
    ("found", "asked", "level"),
    [
        ({("a", "1")}, {("a", "1")}, "not_told"),
        ({("a", "1")}, {("a", "1"), ("b", "1")}, "not_told"),
        ({("a", "1")}, {("a", k) for k in "123"}, "day"),
        ({("a", "1"), ("a", "2")}, {("a", "1"), ("a", "2")}, "not_told"),
        ({("a", "1"), ("a", "2")}, {("a", "1"), ("a", "2"), ("b", "1")}, "unit"),
        ({("a", "1"), ("b", "1")}, {(u, "1") for u in "abcde"}, "some_units"),
        ({("a", "1"), ("b", "1")}, {(u, "1") for u in "abcd"}, "model"),
    ],
)
def test_where_an_effect_belongs_follows_from_where_it_was_found(found: Any, asked: Any, level: str) -> None:
    rows = []
    for unit, day in sorted(asked):
        (one,) = fleets.fleet((unit,), 1, finding=(unit,))
        one |= {"power_on": day, "log": f"{unit}{day}"}
        rows.append(one if (unit, day) in found else one | {"findings": []})
    (effect,) = summed(rows)["groups"][0]["effects"]
    assert effect["level"] == level


def test_one_unit_and_one_power_on_are_told_as_undetermined() -> None:
    for serials, power_ons, said in (
        (("0101",), 5, ["its own part is not told apart from the model's"]),
        (UNITS, 1, ["the day's part is not told apart from the unit's"]),
        (("0101",), 1, ["the model's", "the day's part is not told apart"]),
    ):
        for one in summed(fleets.fleet(serials, power_ons))["groups"][0]["channels"]:
            assert len(one["undetermined"]) == len(said)
            assert all(part in sentence for part, sentence in zip(said, one["undetermined"], strict=True))


@pytest.mark.parametrize(
    ("change", "quantity", "verdict"),
    [
        ({"final": {"accel_bias_mg": [12.2, 0.0, 0.0], "gyro_bias_dps": [0.0] * 3}}, "bias", "fails"),
        ({"final": {"accel_bias_mg": [0.0] * 3, "gyro_bias_dps": [-1.1, 0.0, 0.0]}}, "bias", "fails"),
        ({"final": {"accel_bias_mg": [-11.9, 0.0, 0.0], "gyro_bias_dps": [0.0] * 3}}, "bias", "not_told"),
        ({"noise": {"gyro_arw_deg_sqrt_h": [9.0, 3.0, 3.0], "accel_vrw_mps_sqrt_h": [0.5] * 3, "relative_sd": 0.1}},
         "noise", "fails"),
        ({"noise": {"gyro_arw_deg_sqrt_h": [9.0, None, None], "accel_vrw_mps_sqrt_h": [None] * 3, "relative_sd": 0.5}},
         "noise", "not_told"),
    ],
)  # fmt: skip
def test_a_unit_fails_table_1_beyond_three_sd(change: dict[str, Any], quantity: str, verdict: str) -> None:
    """Bias 12 mg and 1 deg/s, noise 4.5 deg/√h and 1 m/s/√h; as near on the other side is not told."""
    (found,) = summed([fleets.row("a.mcap", **change), fleets.row("b.mcap", serial_number="0002")])["groups"][0][
        "limits"
    ]
    assert (found["serial_number"], found["quantity"], found["verdict"]) == ("0001", quantity, verdict)
    assert (found["log"], found["of"]) == ("a.mcap", 1)


def test_noise_is_judged_by_the_model_s_own_specification(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model whose data sheet allows three times the noise of Table 1 does not fail at twice Table 1's."""
    noisy = replace(specification.IMU440CA_200, gyro_arw=3.0 * specification.IMU400CD_200.gyro_arw)
    monkeypatch.setitem(specification._SPECIFICATIONS, "IMU440", noisy)
    noise = {"gyro_arw_deg_sqrt_h": [9.0] * 3, "accel_vrw_mps_sqrt_h": [0.5] * 3, "relative_sd": 0.1}
    rows = [fleets.row("a.mcap", noise=noise, instrument=model) for model in ("IMU440CA-200", "IMU400CD-200")]
    told = {g["instrument"]: [one["verdict"] for one in g["limits"]] for g in summed(rows)["groups"]}
    assert told == {"IMU440CA-200": [], "IMU400CD-200": ["fails"] * 3}


def test_a_bias_that_has_not_settled_fails_nothing() -> None:
    """It may be on its way; it is told all the same."""
    final = {"accel_bias_mg": [30.0, 0.0, 0.0], "gyro_bias_dps": [0.0] * 3}
    since = {"accel_bias": [None, 1.0, 1.0], "gyro_bias": [1.0] * 3}
    (group,) = summed([fleets.row("a.mcap", final=final, converged_s=since)])["groups"]
    (found,) = group["limits"]
    assert (found["verdict"], found["converged"]) == ("not_told", False)
    assert channel(group, "ax")["unconverged"] == 1


def test_simulated_and_measured_are_never_in_one_estimate() -> None:
    rows = fleets.fleet(("a",), 2) + fleets.fleet(("a",), 3, kind="simulated") + fleets.fleet(("a",), 1, instrument="X")
    told = [(g["kind"], g["instrument"], g["logs"], channel(g, "ax")["logs"]) for g in summed(rows)["groups"]]
    assert told == [
        ("measured", "IMU400CD-200", 2, 2),
        ("measured", "X", 1, 1),
        ("simulated", "IMU400CD-200", 3, 3),
    ]


def test_logs_without_a_serial_number_are_no_unit() -> None:
    high = {"accel_bias_mg": [20.0, 0.0, 0.0], "gyro_bias_dps": [0.0] * 3}
    rows = [
        *fleets.fleet(UNITS, 2),
        fleets.row("x.mcap", serial_number=""),
        fleets.row("y.mcap", serial_number="", final=high),
    ]
    (group,) = summed(rows)["groups"]
    assert group["unknown_unit"] == ["x.mcap", "y.mcap"]
    assert len(group["units"]) == 4
    assert channel(group, "ax")["logs"] == 8
    assert [(one["serial_number"], one["log"]) for one in group["limits"]] == [("", "y.mcap")]
    assert group["notes"][0].startswith("2 logs state no serial number")


def test_what_the_reference_does_not_show_or_the_filter_does_not_know_is_left_out() -> None:
    none = {"accel_bias_mg": [None, 0.0, 0.0], "gyro_bias_dps": [0.0] * 3}
    vague = {"accel_bias_mg": [0.1, 17.0, 0.1], "gyro_bias_dps": [0.01] * 3}
    rows = [fleets.row("a.mcap", final=none, sd=vague | {"accel_bias_mg": [None, 17.0, 0.1]}), fleets.row("b.mcap")]
    (group,) = summed(rows)["groups"]
    told = [(one["logs"], one["unobservable"], one["unmeasured"]) for one in group["channels"]]
    assert told == [(2, 0, 0)] * 3 + [(1, 1, 0), (1, 0, 1), (2, 0, 0)]


def test_a_channel_that_no_log_shows_is_empty_beside_full_ones() -> None:
    """As the rotation about the vertical is with a level reference."""
    rows = fleets.fleet(UNITS, 4)
    for row in rows:
        row["final"]["gyro_bias_dps"][2] = row["sd"]["gyro_bias_dps"][2] = None
    (group,) = summed(rows)["groups"]
    empty = channel(group, "gz")
    assert (empty["logs"], empty["unobservable"], empty["units"], empty["model"]) == (0, 16, [], None)
    assert len(channel(group, "gy")["units"]) == 4


def test_rows_without_a_time_or_temperature_are_used_for_what_they_tell() -> None:
    (group,) = summed(fleets.fleet(UNITS, 4, start_utc=None, temperature_degc=None))["groups"]
    one = channel(group, "az")
    assert {unit["drift"]["verdict"] for unit in one["units"]} == {"no_times"}
    assert one["between_units"] is not None
    assert "do not say when" in group["notes"][-1]


def test_bad_logs_are_counted_and_listed_with_reasons() -> None:
    (found,) = summed([*fleets.fleet(("a",), 1), fleets.bad("b.mcap")])["errors"]
    assert found == {"log": "b.mcap", "error": "it is no log: the first bytes are not MCAP's"}
    every = summed([fleets.bad("a.mcap"), fleets.bad("b.mcap")])
    assert (every["rows"], every["used"], every["groups"], len(every["errors"])) == (2, 0, [], 2)


def test_a_summary_is_a_json_document() -> None:
    document = summed([*fleets.fleet(UNITS, 3), fleets.bad("b.mcap")])
    assert json.loads(json_text.dumps(document)) == document


def row_with(**fields: Any) -> dict[str, Any]:
    """A row of which some fields are as no campaign writes them; without those that are ...."""
    return {key: value for key, value in (fleets.row("a") | fields).items() if value is not ...}


BAD: list[tuple[Any, str]] = [
    ([], "`results` is not an object"),
    (results(), "has no row in it"),
    (results(1), "results: item 1 of `rows` is 1, not a table"),
    (results(row_with(final=...)), "results, rows 1: `final` is missing"),
    (results(row_with(sd={"accel_bias_mg": [float("nan"), 0, 0]})), "sd: item 1 of `accel_bias_mg` is nan"),
    (results(row_with(wall_s=float("nan"))), "results, rows 1: `wall_s` is nan, not a finite number"),
    (results(fleets.row("a"), version=0), "its version is 0, not 1"),
    ({"rows": []}, "it states no version"),
]


@pytest.mark.parametrize(("content", "said"), BAD)
def test_rows_of_another_shape_are_refused_in_words(tmp_path: Path, content: Any, said: str) -> None:
    (tmp_path / "results.json").write_text(json.dumps(content))
    with pytest.raises(UnreadableLogError) as error:
        stored_rows.rows_of(tmp_path)
    assert said in str(error.value)
    assert "imutui campaign" in str(error.value)


@pytest.mark.parametrize("name", ["results.json", "rows.jsonl"])
def test_results_of_another_version_name_the_command_that_makes_them_anew(tmp_path: Path, name: str) -> None:
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / name).write_text(json.dumps(results(version=0)) + "\n")
    with pytest.raises(UnreadableLogError, match="its version is 0, not 1") as error:
        stored_rows.rows_of(tmp_path / "old")
    assert f"`imutui campaign /data/logs -o {tmp_path / 'old-anew'}` makes them anew" in str(error.value)


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnreadableLogError, match=r"results\.json: No such file"):
        stored_rows.rows_of(tmp_path)


def test_rows_are_read_from_the_folder_or_the_file(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text(json.dumps(results(*fleets.fleet(("a",), 2), fleets.bad("b"))))
    assert stored_rows.rows_of(tmp_path) == stored_rows.rows_of(path)
    assert len(stored_rows.rows_of(path)) == 3


def test_an_unstated_site_widens_no_difference_between_logs_and_is_reported() -> None:
    """Drift and control chart compare logs of one place; limits are about the level, which gravity moves."""
    rows = fleets.fleet(UNITS, 8, seed=3, drift_mg={"0102": 0.8})
    known = channel(summed(rows)["groups"][0], "az")
    for row in rows:
        row["sd"]["accel_bias_mg"] = [0.05, 0.05, float(np.hypot(0.05, 2.6))]
        row["site_sd_mg"] = [0.0, 0.0, 2.6]
    group = summed(rows)["groups"][0]
    unstated = channel(group, "az")
    (said,) = unstated["undetermined"]
    assert "site of 32 logs is not stated" in said
    assert channel(group, "ax")["undetermined"] == []
    for one, other in zip(unstated["units"], known["units"], strict=True):
        assert one["drift"]["verdict"] == other["drift"]["verdict"]
        assert [point["sd"] for point in one["points"]] == pytest.approx([point["sd"] for point in other["points"]])
    for row in rows:
        row["final"]["accel_bias_mg"] = [0.0, 0.0, 13.0]
    assert {limit["verdict"] for limit in summed(rows)["groups"][0]["limits"]} == {"not_told"}

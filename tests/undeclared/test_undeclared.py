"""Effects that no scenario declares, over the wire: how sets are read and judged, a few of them run from end to end.

And a measured recording played through the virtual instrument with an effect added on the way.
"""

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sample_effects
from helpers.commands import imutui_json
from helpers.documents import toml
from helpers.places import own_places
from helpers.shared import once
from unit_time import SLOW_LINE, record, virtual

from filters.channels import CHANNELS
from imutui.logbook import reader

SAMPLE_SET = Path(sample_effects.__file__)


# -- the format -------------------------------------------------------------------------------------------------------

ENTRY = (
    '{"title": "a", "channels": ["gx"], "driver": ["time"], "in_log": True, "memory": False, "noise": "simulated",'
    ' "d": 20, "motion": "still"}'
)
WRONG = {
    "no table": ("def a(seed): ...", "EFFECTS"),
    "no function": (f"EFFECTS = {{'a': {ENTRY}}}", "no function"),
    "channel": (ENTRY.replace("gx", "gw"), "`channels` is ['gw']"),
    "driver": (ENTRY.replace("time", "moon"), "`driver` is ['moon']"),
    "missing": (ENTRY.replace('"memory": False, ', ""), "`memory` is None"),
    "size": (ENTRY.replace("20", '"strong"'), "`d` is 'strong'"),
    "more": (ENTRY.replace('"d"', '"size": 3, "d"'), "size"),
    "hidden in the log": (ENTRY.replace("time", "hidden"), "in_log"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_set_that_is_not_as_the_text_has_it_is_refused(tmp_path: Path, wrong: str) -> None:
    """Which effect, which field: a writer learns it from the check, not from a run of ten minutes."""
    import undeclared_sets as sets

    text, words = WRONG[wrong]
    if text.startswith("{"):
        text = f"def a(seed): ...\nEFFECTS = {{'a': {text}}}"
    path = tmp_path / "set.py"
    path.write_text(text)
    with pytest.raises(SystemExit) as refused:
        sets.load_set(path)
    assert words in str(refused.value)


def test_detectability_is_the_norm_about_the_mean_over_the_noise() -> None:
    """Of a sine of amplitude A over T: A √(T/2) / density, whatever constant is beneath, summed over power-ons."""
    import undeclared_sets as sets

    t = np.arange(40_000) / sets.LOOP_HZ
    run = np.zeros((t.size, 6))
    run[:, 1] = 5.0 + 0.3 * np.sin(2.0 * np.pi * t / 30.0)
    d = sets.detectability([run, run], np.full(6, 0.1))
    assert d[1] == pytest.approx(np.sqrt(2.0) * 0.3 * np.sqrt(300.0 / 2.0) / 0.1, rel=1e-3)
    assert d[[0, 2, 3, 4, 5]] == pytest.approx(0.0)


def test_the_check_says_how_large_an_effect_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """d of the channels that an effect is on, and a word where that is not what its table says."""
    import undeclared_sets as sets

    monkeypatch.setattr(sets, "FITTED_S", 100.0)
    text = SAMPLE_SET.read_text()
    assert '"channels": ["gz", "ax"]' in text
    path = tmp_path / "set.py"
    path.write_text(text.replace('"channels": ["gz", "ax"]', '"channels": ["gz"]'))
    lines = list(sets.check(path, tmp_path))
    assert "1 with a hidden driver, 1 with memory" in lines[0]
    told = {line.split(":")[0]: line for line in lines[1:] if not line.startswith(" ")}
    assert set(told) == {"heating_root", "supply", "faint"}
    assert "gz" in told["supply"]
    assert "ax" in told["supply"]
    assert "    the table says gz" in lines


# -- the judgement ----------------------------------------------------------------------------------------------------

NAMES = [
    (("temperature",), (), "thermal_lin", "gx", True),
    (("temperature",), (), "driver:temperature", "gx", True),
    (("temperature",), (), "warmup", "gx", False),
    (("temperature_rate",), (), "thermal_lag", "gx", True),
    (("temperature_rate",), (), "thermal_lin", "gx", False),
    (("rate_x",), (), "scale", "gx", True),
    (("rate_x",), (), "scale", "gy", False),
    (("rate_x",), (), "cross_axis", "gy", True),
    (("force_z",), (), "g_sensitivity", "gy", True),
    (("rate_x", "temperature"), (), "thermal_scale", "gx", True),
    (("rate_x",), (), "thermal_scale", "gx", False),
    (("rate_x", "force_y"), (), "driver:wx*fy", "az", True),
    (("force_y",), (), "driver:wx*fy", "az", False),
    (("force_y",), ("angle_outer",), "driver:angle_outer", "az", True),
    (("hidden",), (), "warmup", "gx", False),
    (("hidden",), (), "tone", "gx", True),
    (("temperature",), (), "random_walk", "gx", False),
]


@pytest.mark.parametrize(("driver", "same_as", "effect", "channel", "right"), NAMES)
def test_a_name_is_right_if_what_drives_it_drives_the_effect(
    driver: tuple[str, ...], same_as: tuple[str, ...], effect: str, channel: str, right: bool
) -> None:
    """All that it names, and on that channel; what names no driver is right of what the recording does not hold."""
    import undeclared_score as score
    import undeclared_sets as sets

    truth = sets.Undeclared(
        "a", Path("a.py"), 0, 0, "a", ("gx",), driver, same_as, "hidden" not in driver, False, False, False, 20.0
    )
    assert score.is_right(truth, effect, channel) is right


def test_every_effect_of_the_catalogue_can_be_judged() -> None:
    """No name that a trace may give is without a rule, be it that it is no cause."""
    import undeclared_score as score

    from filters.effects.catalogue import EFFECTS

    other = ("noise_level", "spikes", "stuck", "saturation", "coarse", "dropout", "jitter")
    known = {*score._DRIVEN_BY, *score._WITHOUT_DRIVER, *other}
    assert set(EFFECTS) <= known


def test_an_explanation_by_what_does_not_drive_it_counts_against_the_tracer() -> None:
    """A wrong name counts where the channel is called explained, and only there; a hidden driver explained always."""
    import undeclared_score as score
    import undeclared_sets as sets

    truth = sets.Undeclared(
        "a", Path("a.py"), 0, 0, "a", ("gx",), ("hidden",), (), False, False, False, False, 40.0
    )  # fmt: skip
    d = dict.fromkeys(CHANNELS, 0.0) | {"gx": 40.0}
    document: dict[str, Any] = {
        "findings": [
            {"effect": "thermal_lin", "channels": ["gx"], "rivals": []},
            {"effect": "scale", "channels": ["ay"], "rivals": []},
        ],
        "weak": [], "drift": [], "lines": [], "refuted": [], "common": [],
        "status": dict.fromkeys(CHANNELS, "clean") | {"gx": "explained", "ay": "explained"},
    }  # fmt: skip
    judged = score.judged(truth, d, document, None)
    assert judged["explained_wrongly"] == {"gx": ["thermal_lin"]}
    assert judged["outside_log_explained"] == ["gx"]
    assert judged["false_on_untouched"] == {"ay": ["scale"]}
    assert judged["flagged"] == ["gx"]
    document["refuted"] = [{"effect": "ramp", "channels": ["gx"]}]
    assert "ramp" in score.judged(truth, d, document, None)["found_beyond_control"]["gx"]
    document["status"]["gx"] = "partial"
    judged = score.judged(truth, d, document, None)
    assert not judged["explained_wrongly"]
    assert not judged["outside_log_explained"]
    counts = score.summary([(truth, {"judged": judged, "d": d})])
    assert counts["explained_wrongly"]["count"] == 0
    assert counts["false_on_untouched_channels"] == {"count": 1, "of": 5, "ci95": [0.036, 0.624]}


# -- over the wire ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """One effect of the sample set, three short power-ons, recorded over pseudo terminals, traced and judged."""

    def make(folder: Path) -> None:
        import undeclared
        import undeclared_sets as sets

        with pytest.MonkeyPatch.context() as patch:
            own_places(patch, folder)
            patch.setattr(sets, "FITTED_S", 95.0)
            patch.setattr(sets, "HELDOUT_S", 105.0)
            patch.setattr(sets, "HISTORIES", (sets.HISTORIES[0], sets.HISTORIES[2], sets.HISTORIES[3]))
            options = sets.record_options
            patch.setattr(sets, "record_options", lambda *to, **how: [*options(*to, **how), *SLOW_LINE])
            effects = [effect for effect in sets.load_set(SAMPLE_SET) if effect.name == "supply"]
            found = undeclared.results(effects, folder, None, lambda text: None)
        (folder / "result.json").write_text(json.dumps(found))

    folder = once(tmp_path_factory, "undeclared", make)
    return dict(json.loads((folder / "result.json").read_text()))


def test_an_effect_that_nobody_declared_is_seen_where_it_is(result: dict[str, Any]) -> None:
    """What drives it is not in the log: it is told on both of its channels, and explained by nothing."""
    case = result["effects"]["supply"]
    assert case["judged"]["visible"] == ["gz", "ax"]
    assert case["judged"]["flagged"] == ["gz", "ax"]
    assert not case["judged"]["explained_wrongly"]
    assert not case["judged"]["outside_log_explained"]
    assert {run["kind"] for run in case["trace"]["runs"]} == {"simulated"}
    assert {run["source"] for run in case["trace"]["runs"]} == {"simulated readings + supply"}
    assert result["summary"]["visible_right_channel"]["count"] == 1


def test_a_result_can_be_printed_and_holds_nothing_of_this_machine(result: dict[str, Any], tmp_path: Path) -> None:
    """A row an effect, and no path in the file that is kept."""
    import undeclared_score as score
    import undeclared_sets as sets

    effects = [effect for effect in sets.load_set(SAMPLE_SET) if effect.name in result["effects"]]
    lines = score.table([(effect, result["effects"][effect.name]) for effect in effects])
    assert len(lines) == 2 + len(effects)
    assert lines[2].startswith("| supply | gz ax | simulated, still |")
    assert "/tmp" not in json.dumps(result)
    assert str(tmp_path.parents[1]) not in json.dumps(result)


SCENARIO = toml(
    seed=5,
    instrument={"accel_sign": 1},
    effect=[{"name": "thermal_lin", "channel": "gy", "dps_per_k": 0.02}],
    power_on=[
        {"temperature": {"history": [[0.0, 20.0], [50.0, 40.0], [110.0, 24.0], [150.0, 24.0]]}},
        {"temperature": {"history": [[0.0, 38.0], [30.0, 38.0], [80.0, 20.0], [150.0, 34.0]]}},
        {"temperature": {"history": [[0.0, 26.0], [90.0, 22.0], [200.0, 40.0], [310.0, 25.0]]}},
    ],
)
SECONDS = (150.0, 150.0, 310.0)


def test_an_effect_on_a_measured_recording_is_found_over_the_wire(home: Path, recording: Callable[[str], Path]) -> None:
    """Real noise and drift, an effect and a temperature that were added on the way: cause, size, and the error left."""
    source = recording("adis16405_static_a.npz")
    (home / "unit.toml").write_text(SCENARIO)

    def take(number: int) -> Path:
        log = home / f"part{number}.mcap"
        options = ("--from", str(source), "--from-start", f"{1000 + 400 * number}", "--scenario", "unit.toml")
        with virtual(*options, "--power-on", str(number)) as unit:
            record(*unit, log, SECONDS[number], "--reference", "gravity", "--accel-sign", "+1", *SLOW_LINE)
        return log

    with ThreadPoolExecutor(2) as pool:
        logs = sorted(pool.map(take, (2, 0, 1)))
    info = reader.read(logs[0]).info
    told = "measured noise of adis16405_static_a.npz + thermal_lin; temperature simulated"
    assert (info.kind, info.source) == ("simulated", told)
    result = imutui_json("trace", *logs)
    assert {(run["kind"], run["source"]) for run in result["runs"]} == {("simulated", told)}
    gyros = [f for f in result["findings"] if set(f["channels"]) & {"gx", "gy", "gz"}]
    assert [(f["effect"], f["channels"]) for f in gyros] == [("thermal_lin", ["gy"])]
    assert gyros[0]["params"][0]["value"] == pytest.approx(0.02, abs=0.002)
    assert result["status"]["gy"] in ("explained", "partial")
    error = next(e for e in result["error"] if (e["metric"], e["channel"]) == ("e10", "gy"))
    assert error["before_x_floor"] > 5.0
    assert error["after_x_floor"] < 2.0

"""`imutui trace` around the tracer: which logs it gets, what comes out where, and how it ends."""

import io
import json
import re
import sys
import tomllib
import types
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from helpers import traces
from helpers.commands import Done, imutui, imutui_json
from helpers.traces import arrays, imported

from filters.tracing.result import Trace
from filters.tracing.run import Run
from imutui.cli import exit_codes
from imutui.report import figures, trace_tables
from imutui.scenario import load_profile, load_scenario


@dataclass
class Tracer:
    """In place of the tracer: takes what it is given and returns a hand-made result."""

    made: Callable[[tuple[str, ...]], Trace] = traces.trace
    runs: list[str] = field(default_factory=list)
    heldout: str | None = None
    seed: int = -1

    def trace(self, runs: Sequence[Run], heldout: Run | None, *, asked: Sequence[str] = (), seed: int = 0,
              progress: Callable[[float, str], None] = lambda share, what: None) -> Trace:  # fmt: skip
        self.runs = [run.name for run in runs]
        self.heldout = None if heldout is None else heldout.name
        self.seed = seed
        progress(0.5, "selecting")
        return self.made((*self.runs, *([self.heldout] if self.heldout else [])))


@pytest.fixture
def tracer(home: Path, monkeypatch: pytest.MonkeyPatch) -> Tracer:
    """The one call to the method is replaced."""
    import filters

    stand_in = Tracer()
    module = types.ModuleType("filters.tracing.trace")
    module.trace = stand_in.trace  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "filters.tracing.trace", module)
    monkeypatch.setattr(filters, "tracing", module, raising=False)
    return stand_in


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Three runs of a unit at rest, ten seconds past a minute."""
    folder = tmp_path_factory.mktemp("logs")
    return {name: imported(folder / f"{name}.mcap", arrays(70.0, moving=False, seed=n), kind="simulated")
            for n, name in enumerate("abc")}  # fmt: skip


def run(*arguments: str | Path, check: int = 0) -> Done:
    return imutui("trace", *arguments, check=check)


def test_the_last_of_several_logs_is_held_out(tracer: Tracer, logs: dict[str, Path]) -> None:
    done = run(logs["a"], logs["b"], logs["c"], "--json", "--seed", "5")
    assert (tracer.runs, tracer.heldout, tracer.seed) == (["a", "b"], "c", 5)
    result = json.loads(done.stdout)
    assert [r["heldout"] for r in result["runs"]] == [False, False, True]
    first = result["runs"][0]
    assert (first["id"], first["kind"], first["accel_sign"]) == ("a", "simulated", -1)
    assert first["rate_hz"] == pytest.approx(20.0)
    assert first["seconds"] == pytest.approx(70.0)
    assert result["library"].startswith("imutui ")
    assert set(traces.document()) < set(result)
    assert any("held-out run lasts 70 s" in note for note in result["notes"])
    assert done.stderr == ""


def test_one_log_is_judged_by_folds(tracer: Tracer, logs: dict[str, Path]) -> None:
    done = run(logs["a"])
    assert (tracer.runs, tracer.heldout) == (["a"], None)
    assert "that does not show transfer" in " ".join(done.stdout.split())


def test_another_log_can_be_held_out(tracer: Tracer, logs: dict[str, Path]) -> None:
    run(logs["a"], logs["b"], "--holdout", logs["c"])
    assert (tracer.runs, tracer.heldout) == (["a", "b"], "c")
    done = run(logs["a"], logs["b"], logs["c"], "--holdout", logs["a"])
    assert (tracer.runs, tracer.heldout) == (["b", "c"], "a")
    assert "not among the logs that are fitted" in " ".join(done.stdout.split())
    done = run(logs["a"], "--holdout", logs["a"], check=2)
    assert "no other log" in done.stderr


def test_the_text_fits_eighty_columns_and_says_it_is_simulated(tracer: Tracer, logs: dict[str, Path]) -> None:
    text = run(logs["a"], logs["b"]).stdout
    assert max(map(len, text.splitlines())) <= 80
    assert "SIMULATED" in text
    assert "0.0200 ± 0.0010 deg/s/K" in text
    assert re.search(r"gy  8\.41 → 1\.01  █░░░ +linear in +several fit", text)
    assert "on run b, to which nothing was fitted" in " ".join(text.split())


@pytest.mark.parametrize("encoding", ["ascii", "iso-8859-1"])
def test_a_terminal_without_unicode_has_its_own_bars(monkeypatch: pytest.MonkeyPatch, encoding: str) -> None:
    stdout = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", stdout)
    text = exit_codes.in_signs(trace_tables.text(traces.whole_document(), "x", 80, signs=exit_codes.in_signs))
    assert "8.41 -> 1.01  #:::" in text
    assert text.isascii()
    exit_codes.tell(text + " √ ± → 中")


def test_effects_and_experiment_are_written(tracer: Tracer, logs: dict[str, Path], home: Path) -> None:
    done = run(logs["a"], logs["b"], "-o", "effects.toml")
    read = tomllib.loads((home / "effects.toml").read_text())
    assert read["source"] == "trace of a.mcap; held out b.mcap"
    assert len(read["effect"]) == 2
    assert "gy: bias follows temperature" in done.stderr
    assert load_profile(home / "experiment.toml").duration == 60.0
    assert (home / "experiment.toml").read_text().startswith("# ")
    profile = load_scenario(home / "experiment.toml").profile
    assert profile is not None
    assert profile.duration == 60.0
    refused = run(logs["a"], logs["b"], "-o", "effects.toml", check=2)
    assert "--force" in refused.stderr
    other = run(logs["a"], logs["b"], "-o", "other.toml")
    assert "experiment.toml exists" in other.stderr
    run(logs["a"], logs["b"], "-o", "effects.toml", "--force")


def test_a_clean_unit_gives_an_empty_effects_file(tracer: Tracer, logs: dict[str, Path], home: Path) -> None:
    tracer.made = traces.nothing
    done = run(logs["a"], "-o", "effects.toml")
    assert "no effect" in done.stderr
    assert "effect" not in tomllib.loads((home / "effects.toml").read_text())
    assert "nothing  clean" in done.stdout


def test_a_report_is_a_page_with_figures(tracer: Tracer, logs: dict[str, Path], home: Path) -> None:
    pytest.importorskip("matplotlib")
    tracer.made = lambda names: replace(traces.nothing(names), series=())
    done = run(logs["a"], logs["b"], "--report", "r")
    assert (home / "r" / "index.html").exists()
    assert "figures" in done.stderr
    run(logs["a"], logs["b"], "--report", "r", check=2)


def test_without_matplotlib_a_report_is_refused_first(
    tracer: Tracer, logs: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "available", lambda: False)
    done = run(logs["a"], "--report", "r", check=2)
    assert "pip install" in done.stderr
    assert tracer.runs == []


def test_a_damaged_log_is_traced_as_far_as_it_goes(tracer: Tracer, logs: dict[str, Path], home: Path) -> None:
    long = imported(home / "long.mcap", arrays(200.0, moving=False, seed=4))
    content = long.read_bytes()
    long.write_bytes(content[: int(len(content) * 0.8)])
    done = run("long.mcap", "--json", check=1)
    assert "long.mcap: the file ends in the middle" in done.stderr
    assert json.loads(done.stdout)["runs"][0]["seconds"] > 60.0


def test_a_channel_that_is_dead_does_not_stop_the_trace(tracer: Tracer, logs: dict[str, Path], home: Path) -> None:
    given = arrays(70.0, seed=2)
    given["gyro"][:, 1] = 0.0
    given["accel"][:, 2] = 4.0
    imported(home / "dead.mcap", given)
    run("dead.mcap")


def test_mistakes_end_with_one_paragraph_and_a_next_step(tracer: Tracer, logs: dict[str, Path], home: Path) -> None:
    imported(home / "up.mcap", arrays(70.0, sign=1, moving=False, seed=5))
    (home / "text.mcap").write_text("text")
    cases: dict[tuple[str, ...], tuple[int, str]] = {
        ("absent.mcap",): (3, "no such file"),
        ("text.mcap",): (3, "imutui import"),
        ("up.mcap",): (2, "--accel-sign"),
        (str(logs["a"]), str(logs["b"]), str(logs["b"])): (2, "given twice"),
        (str(logs["a"]), "--reference", "upright"): (2, "level"),
        (str(logs["a"]), "--reference", "absent.toml"): (3, "absent.toml"),
        (str(logs["a"]), "-o", str(logs["a"])): (2, "itself"),
        (str(logs["a"]), "-o", "no/where.toml"): (2, "no folder"),
        (str(logs["a"]), "--about", "magic"): (2, "thermal_lin"),
        (): (2, ""),
    }
    for arguments, (code, words) in cases.items():
        done = run(*arguments, check=code)
        assert words in done.stderr, (arguments, done)
        assert done.stdout == ""


def test_a_reference_can_be_named(tracer: Tracer, logs: dict[str, Path], home: Path) -> None:
    (home / "table.toml").write_text(traces.PROFILE)
    for reference in ("level", "gravity", "table.toml"):
        result = imutui_json("trace", logs["a"], "--reference", reference)
        assert result["runs"][0]["reference"] == reference.replace("table.toml", "profile")


def test_no_sample_is_left_out(tracer: Tracer, home: Path) -> None:
    seen: list[Run] = []
    tracer.made = lambda names: traces.nothing(names)
    original = tracer.trace
    sys.modules["filters.tracing.trace"].trace = lambda runs, heldout, **rest: (  # type: ignore[attr-defined]
        seen.extend(runs), original(runs, heldout, **rest))[1]  # fmt: skip
    given = arrays(70.0, moving=False, seed=6)
    imported(home / "a.mcap", given)
    run("a.mcap")
    assert np.array_equal(seen[0].t, given["t"])

"""What is told of a result: sentences, numbers, figures and page, from a hand-made one."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import traces

from imutui.report import figures, page, sentences
from imutui.report.numbers import duration, plus_minus, share, times_floor

SOURCE = "trace of a.mcap; held out b.mcap"
RUN = {"id": "a", "kind": "simulated", "rate_hz": 20.0, "seconds": 900.0, "reference": "level", "heldout": False}


def document(**changes: Any) -> dict[str, Any]:
    runs = [RUN, {**RUN, "id": "b", "heldout": True}]
    return {**traces.document(), "runs": runs, "notes": ["a note"], "library": "imutui 1"} | changes


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (0.02, 0.001, "0.0200 ± 0.0010 deg/s"),
        (-12.3456, 0.5, "-12.35 ± 0.50 deg/s"),
        (1234.5, 100.0, "1234 ± 100 deg/s"),
        (1.5e-6, 2e-7, "(1.50 ± 0.20)e-6 deg/s"),
        (1.0, None, "1 deg/s"),
        (1.0, 0.0, "1 deg/s"),
    ],
)
def test_value_and_deviation_end_at_the_same_digit(value: float, sd: float | None, text: str) -> None:
    """Two digits of the deviation."""
    assert plus_minus(value, sd, "deg/s") == text


COMMON = {
    "kind": "event", "label": "step together and come back", "channels": ["ax", "ay"], "coherence": 0.93,
    "t_start_s": 700.0, "t_end_s": 1000.0, "curve": {"t_s": [699.5, 700.5], "y": [0.01, 2.75]}, "unit": "mg",
    "sizes": [{"channel": "ax", "value": 2.75, "sd": 0.1, "unit": "mg"}], "p": 1e-9, "record": ["supply voltage"],
    "run": "a",
}  # fmt: skip


def test_a_common_cause_is_told_with_what_to_record() -> None:
    """Which channels, when, how much, what to log, and where its course is."""
    (section,) = [s for s in sentences.sections(document(common=[COMMON])) if s.title.startswith("Shared")]
    assert section.sentences == (
        "ax ay: step together and come back, 700 to 1000 s of run a (ax 2.75 ± 0.10 mg, 1 sd; coherence 0.93); record"
        " supply voltage. Its course is common_1.csv, which --report DIR saves.",
    )


def test_a_report_has_the_course_of_a_common_cause(tmp_path: Path) -> None:
    """A CSV that can be plotted against anything logged elsewhere, and a figure."""
    written = {path.name for path in page.write(tmp_path, document(common=[COMMON]), traces.trace().series, SOURCE)}
    assert {"common_1.csv", "common-1.png"} <= written
    assert (tmp_path / "common_1.csv").read_text() == "t_s,value\n699.500,0.01\n700.500,2.75\n"


def test_numbers_never_claim_more_than_they_are() -> None:
    """Shares short of all are no 100 %, ratios keep two digits below ten."""
    assert (share(0.9712), share(0.9996), share(0.9951)) == ("97 %", "99.9 %", "99.5 %")
    assert (times_floor(1.013), times_floor(84.2), times_floor(8431.0)) == ("1.01", "84.2", "8431")
    assert (duration(90.0), duration(1800.0), duration(9000.0)) == ("90 s", "30 min", "2.5 h")


def test_a_finding_is_a_sentence() -> None:
    """What, how much, how much of it, what else it may be, and the error before and after."""
    lines = {line.channel: line for line in sentences.channel_lines(document())}
    assert list(lines) == ["gx", "gy", "gz", "ax", "ay", "az"]
    first, last = lines["gy"].sentences
    assert first == (
        "bias follows temperature (thermal_lin), 0.0200 ± 0.0010 deg/s/K (1 sd); explains 97 %; or: bias follows the"
        " rate of temperature (thermal_rate) (score -3)."
    )
    assert last == "Error 8.41 → 1.01 × floor on a run not used."
    assert lines["gy"].status == "several causes fit"
    assert "Drift (Gauss-Markov), 0.004 deg/s, over 80 s" in lines["gx"].sentences[0]
    assert "Faults of the data, set aside: spikes." in lines["gx"].sentences
    assert "Line at 31.41 Hz." in lines["ax"].sentences
    assert "up to 0.5 mg at 6 points" in lines["az"].sentences[0]
    assert "NOT confirmed" in lines["az"].sentences[0]
    assert lines["gz"].sentences == ("Nothing found. The noise changes with the size of the rate.",)


REFUTED = {
    "effect": "ramp", "label": "bias runs away with time", "channels": ["az"], "metric": "e10", "after_with": 16.12,
    "after_without": 5.786, "unit": "mg",
}  # fmt: skip


def test_what_is_refuted_is_told_with_both_errors() -> None:
    """On its channel, in words and with its code name."""
    lines = {line.channel: line for line in sentences.channel_lines(document(refuted=[REFUTED]))}
    assert (
        "REFUTED by the held-out run, and not used: bias runs away with time (ramp); error 16.1 mg with all that was"
        " fitted, 5.79 mg without."
    ) in lines["az"].sentences


def test_of_what_is_weak_the_best_are_told_with_the_size_that_would_be_used() -> None:
    """Three a channel, each with its reason; the others are counted."""
    params = [{"name": "k", "value": 1e-3, "sd": 2e-4, "unit": "deg/s/K", "plausible": True}]
    one = {
        "effect": "thermal_lin", "label": "bias follows temperature", "channels": ["gx"], "params": params,
        "score": 7.0, "guarded_score": 1.0, "why": "not told from drift", "limit": 0.0021,
    }  # fmt: skip
    weak = [{**one, "score": float(k)} for k in range(5)]
    (section,) = [s for s in sentences.sections(document(weak=weak)) if s.title.startswith("Weak")]
    assert len(section.sentences) == 4
    assert section.sentences[0] == (
        "gx: bias follows temperature (thermal_lin), 0.00100 ± 0.00020 deg/s/K (1 sd) (score 4): not told from drift;"
        " 0.0021 deg/s/K would be used."
    )
    assert section.sentences[3] == "gx: 2 more, which --json lists."


def test_shared_faulty_weak_and_untestable_things_are_said_once() -> None:
    """Each in its section, grouped and short."""
    sections = {section.title: section.sentences for section in sentences.sections(document())}
    assert len(sections["Over several channels"]) == 1
    assert "x 0.0500 ± 0.0020 m, y" in sections["Over several channels"][0]
    assert "implausibly large" in sections["Over several channels"][0]
    assert sections["Data"] == ("gx: spikes (spikes), 3 times (12.5 s of run a).",)
    assert sections["These logs cannot show"] == (
        "scale factor is off (scale), bias follows the square of specific force (g_squared): would look like a constant"
        " bias.",
        "gravity is not as assumed (gravity) apart from scale factor is off (scale).",
    )
    assert sections["Errors"] == ("√(NIS/dof): gy 1.84 → 1 (floor 1).",)
    assert "30 min" in sections["To separate the causes"][0]
    assert "bias follows the rate of temperature" in sections["To separate the causes"][0]
    assert sections["Notes"] == ("Errors before and after are those of run b, to which nothing was fitted.", "a note.")


@pytest.mark.parametrize(
    ("motion", "d", "said"),
    [
        (
            "cool it down and heat it again, 18 min",
            42.0,
            "(d = 42, 5 is enough): cool it down and heat it again, 18 min.",
        ),
        ("nothing known separates them; nearest comes …", 2.1, "? Nothing known separates them; nearest comes …."),
    ],
)
def test_what_would_separate_is_said_as_an_operator_does_it(motion: str, d: float, said: str) -> None:
    """Motion and temperatures, or that nothing would."""
    made = {**document()["separating_experiment"], "motion": motion, "d_expected": d}
    sections = {s.title: s.sentences for s in sentences.sections(document(separating_experiment=made))}
    assert said in sections["To separate the causes"][0]
    assert ("tell them apart" in sections["To separate the causes"][0]) == (d > 5.0)


def test_one_run_is_said_to_show_no_transfer() -> None:
    """Folds are no other power-on."""
    assert "does not show transfer" in sentences.held_out(document(runs=[RUN]))


def test_simulated_readings_are_called_simulated() -> None:
    """In the first lines, whatever else is there."""
    assert "SIMULATED" in sentences.headline(document(), SOURCE)[1]
    assert "SIMULATED" not in sentences.headline(document(runs=[{**RUN, "kind": "measured"}]), SOURCE)[1]


def test_a_page_has_all_sentences_and_figures_in_one_file(tmp_path: Path) -> None:
    """It can be sent by itself; the experiment lies beside it. Gaps and a channel without any weight stop no figure."""
    pytest.importorskip("matplotlib")
    (series,) = traces.trace(("a",)).series
    before = series.before.copy()
    before[:, 3] = np.nan
    written = page.write(tmp_path / "r", document(), [replace(series, before=before)], SOURCE)
    names = {path.name for path in written}
    wanted = {"residual-1.png", "driver-1.png", "spectrum.png", "allan.png", "scores.png"}
    assert names == wanted | {"index.html", "error.png", "experiment.toml"}
    text = (tmp_path / "r" / "index.html").read_text()
    assert text.count("data:image/png;base64,") == 6
    assert 'src="http' not in text
    for line in sentences.channel_lines(document()):
        for sentence in line.sentences:
            assert sentence.replace("'", "&#x27;") in text
    assert (tmp_path / "r" / "experiment.toml").read_text() == traces.PROFILE


def test_equal_results_give_equal_files() -> None:
    """No date, no chance, no version of a library in a figure."""
    pytest.importorskip("matplotlib")
    one, two = (next(figures.pictures(document(findings=[]), [])) for _ in range(2))
    assert one.name == "error.png"
    assert one.png == two.png


def test_a_text_cannot_become_markup() -> None:
    """Names of files and notes are text."""
    assert "<b>" not in page.page(document(notes=["<b>x"]), [], "trace of <b>.mcap")

"""What a trace found as tables: every entry once, in 80 columns, the same for page, terminal and screen."""

import itertools
from typing import Any

import pytest
from helpers import traces
from helpers.traces import COMMON, RUN
from helpers.traces import of_two_runs as document
from hypothesis import given
from hypothesis import strategies as st

from filters.channels import CHANNELS
from filters.effects import plain_names
from imutui.report import plain, trace_glance, trace_tables
from imutui.report.blocks import Column, Items, Paragraph, Section, Table
from imutui.report.trace_glance import TERMINAL, bar
from imutui.tui.terminal.glyphs import GLYPHS

STATUSES = ("clean", "explained", "confounded", "partial", "stochastic", "run_specific", "unexplained")
EFFECTS = (*plain_names._EFFECTS, "driver:temperature*wx", "driver:since_motion")


def tables(d: Any) -> dict[str, Table]:
    made = trace_tables.sections(d, TERMINAL)
    return {s.title: block for s in made for block in s.blocks if isinstance(block, Table)}


def causes(**changes: Any) -> list[tuple[str, ...]]:
    return list(tables(document(**changes))["Causes, their parameters and rivals"].rows)


def glance(**changes: Any) -> dict[str, tuple[str, ...]]:
    return {row[0]: row[1:] for row in tables(document(**changes))["Channels"].rows}


SIZES = st.floats(-1e6, 1e6, allow_subnormal=False)
RATIOS = st.none() | st.floats(1e-3, 1e6)
ON = st.lists(st.sampled_from(CHANNELS), min_size=1, max_size=6, unique=True).map(
    lambda c: sorted(c, key=CHANNELS.index)
)


@st.composite
def documents(draw: st.DrawFn) -> dict[str, Any]:
    """A result with any number of entries of any kind, each with a label of its own."""
    labels = (f"label{n}" for n in itertools.count())

    def named() -> dict[str, Any]:
        return {"effect": draw(st.sampled_from(EFFECTS)), "label": next(labels), "channels": draw(ON)}

    def parameters() -> list[dict[str, Any]]:
        sds = draw(st.lists(st.none() | st.floats(1e-9, 1e4), max_size=7))
        names = ("k", "k1", "tau", "carried_over", "weight", "at 3 s", "frequency")
        return [{"name": n, "value": draw(SIZES), "sd": sd, "unit": draw(st.sampled_from(("1", "deg/s/K"))),
                 "plausible": draw(st.booleans())} for n, sd in zip(names, sds, strict=False)]  # fmt: skip

    def rival() -> dict[str, Any]:
        weight = draw(st.sampled_from(({}, {"weight": 0.4})))
        return {"effect": draw(st.sampled_from(EFFECTS)), "label": next(labels), "score_difference": -3.0, **weight}

    few = st.integers(0, 3)
    findings = [
        {**named(), "params": parameters(), "shape": {}, "score": 812.0, "gain": 1.0, "heldout_gain": None,
         "share_of_excess": draw(st.none() | st.floats(0.0, 1.0)), "driver_curve": None, "proposed_form": None,
         "rivals": [rival() for _ in range(draw(few))], "include_as": draw(st.sampled_from("ANSP")),
         "confirmed": draw(st.sampled_from((None, True, False)))}
        for _ in range(draw(few))
    ]  # fmt: skip
    refuted = [{**named(), "metric": "e10", "after_with": 2.0, "after_without": 1.0, "unit": "mg"}
               for _ in range(draw(few))]  # fmt: skip
    weak = [{**named(), "params": parameters(), "score": draw(SIZES), "guarded_score": 1.0,
             "limit": draw(st.none() | SIZES), "why": "not told from drift"} for _ in range(draw(few))]  # fmt: skip
    common = [{**named(), "kind": "event", "coherence": 0.9, "t_start_s": 1.0, "t_end_s": 2.0, "curve": {}, "p": 0.1,
               "unit": "mg", "sizes": [], "record": ["supply voltage"]} for _ in range(draw(few))]  # fmt: skip
    error = [{"metric": "e10", "channel": c, "unit": "mg", "before": 1.0, "after": 1.0, "floor": 1.0, "ci95": [1, 2],
              "n": 5, "before_x_floor": draw(RATIOS), "after_x_floor": draw(RATIOS), "heldout": "run"}
             for c in CHANNELS]  # fmt: skip
    status = {c: draw(st.sampled_from(STATUSES)) for c in CHANNELS}
    changes = {"findings": findings, "refuted": refuted, "weak": weak, "common": common, "error": error}
    return document(status=status, separating_experiment=None, **changes)


@given(documents())
def test_every_entry_is_told_once_in_eighty_columns(d: dict[str, Any]) -> None:
    cells = [cell for table in tables(d).values() for row in table.rows for cell in row]
    for kind in ("findings", "refuted", "weak", "common"):
        for entry in d[kind]:
            for label in (entry["label"], *(r["label"] for r in entry.get("rivals", []))):
                assert len([cell for cell in cells if label in cell.replace(",", " ").split()]) == 1, label
    text = trace_tables.text(d, "trace of a.mcap", 80)
    assert max(map(len, text.splitlines())) <= 80
    assert {word for cell in cells for word in cell.replace("`", "").split()} <= set(text.split())
    assert [row[0] for row in tables(d)["Channels"].rows] == list(CHANNELS)


def test_a_channel_is_a_row_of_answers() -> None:
    rows = glance()
    assert rows["gy"] == ("8.41 → 1.01", "█░░░", "linear in temperature", "several fit", "run experiment, use effects")
    assert rows["gz"] == ("–", "", "uneven noise", "clean", "nothing")
    assert rows["gx"] == ("–", "", "Gauss-Markov drift + 1", "drift", "check wiring, estimate often")
    assert rows["az"][3:] == ("not explained, not confirmed", "use effects, leave out")
    assert glance(refuted=[REFUTED])["az"][3] == "not explained, not confirmed, refuted"


def test_a_finding_has_its_parameters_and_rivals_below_it() -> None:
    rows = causes()
    at = next(n for n, row in enumerate(rows) if row[0] == "gy")
    assert rows[at : at + 2] == [
        ("gy", "bias follows temperature (thermal_lin)",
         "0.0200 ± 0.0010 deg/s/K; fits better by 812, odds 40:1, explains 97 %, confirmed"),
        ("", "or: bias follows the rate of temperature (thermal_rate)", "fits worse by 3"),
    ]  # fmt: skip
    at = next(n for n, row in enumerate(rows) if row[0] == "ax ay az")
    assert rows[at][1] == "the accelerometers sit off the table's centre (lever_arm)"
    assert rows[at + 1 : at + 4] == [
        ("", "x", "0.0500 ± 0.0020 m"), ("", "y", "0.0500 ± 0.0020 m"),
        ("", "z", "0.0500 ± 0.0020 m, implausibly large for this physics"),
    ]  # fmt: skip
    told = {row[:2]: row[2] for row in rows}
    assert told["gx", "Gauss-Markov drift"] == "0.004 deg/s over 80 s; nothing logged explains it"
    assert told["gx", "spikes (spikes)"] == "3 times, set aside: 12.5 s of run a"
    assert told["ax ay", "line at 31.41 Hz, 0.1 Hz wide"] == "0.4 mg rms"
    assert told["gz", "noise changes with the size of the rate (rate_norm)"] == "by up to 1.60 ×"
    assert told["ax", "not traced"] == "1.42 × the noise's variance at 16 s"
    free = told["az", "error is a function of since_motion (driver:since_motion)"]
    assert free.startswith("0.50 ± 0.10 mg at 5.0, the largest of 6 points; fits better by 812, odds 40:1, ")
    assert free.endswith("NOT confirmed, not used, form tanh")


def test_what_carries_over_has_its_standard_deviation() -> None:
    thermal = traces.document()["findings"][0]
    params = [
        *thermal["params"],
        {"name": "carried_over", "value": 0.69, "sd": 0.557, "unit": "1", "plausible": True},
        {"name": "weight", "value": 0.9996, "sd": None, "unit": "1", "plausible": True},
    ]
    told = dict(row[1:] for row in causes(findings=[{**thermal, "params": params}]))
    assert told["carries over to other runs"] == "0.69 ± 0.56"
    assert told["weight of this form"] == "99.9 %"


REFUTED = {
    "effect": "ramp", "label": "bias runs away with time", "channels": ["az"], "metric": "e10", "after_with": 16.12,
    "after_without": 5.786, "unit": "mg",
}  # fmt: skip


def test_what_is_refuted_has_both_errors() -> None:
    (told,) = (row for row in causes(refuted=[REFUTED]) if row[2].startswith("REFUTED"))
    assert told == ("az", "bias runs away with time (ramp)",
                    "REFUTED, not used: error 16.1 mg with all that was fitted, 5.79 without")  # fmt: skip


def test_a_common_cause_says_what_to_record() -> None:
    rows = causes(common=[COMMON])
    at = next(n for n, row in enumerate(rows) if "common cause" in row[1])
    assert rows[at : at + 2] == [
        ("ax ay", "common cause 1: step together and come back, 700 to 1000 s of run a",
         "not in this log; coherence 0.93; course in common_1.csv, which --report DIR saves"),
        ("", "on ax", "2.75 ± 0.10 mg"),
    ]  # fmt: skip
    (todo,) = (row for row in tables(document(common=[COMMON]))["What to do"].rows if row[0] == "log more")
    assert todo[1] == "ax ay"
    assert "supply voltage" in todo[2]


def test_what_is_weak_has_the_size_that_would_be_used() -> None:
    params = [{"name": "k", "value": 1e-3, "sd": 2e-4, "unit": "deg/s/K", "plausible": True}]
    one = {
        "effect": "thermal_lin", "label": "bias follows temperature", "channels": ["gx"], "params": params,
        "score": 7.0, "guarded_score": 1.0, "why": "not told from drift", "limit": 0.0021,
    }  # fmt: skip
    rows = tables(document(weak=[{**one, "score": float(k)} for k in range(5)]))["Weak, and not used"].rows
    assert rows[0] == ("gx", "bias follows temperature (thermal_lin)", "0.00100 ± 0.00020 deg/s/K",
                       "fits better by 4: not told from drift; 0.0021 deg/s/K would be used")  # fmt: skip
    assert [row[3].split(":")[0] for row in rows] == [f"fits better by {k}" for k in (4, 3, 2, 1, 0)]


def test_errors_and_limits_are_rows() -> None:
    made = tables(document())
    assert made["Errors"].rows == (
        ("10 s means", "gy", "0.0840", "0.0101", "0.00900 to 0.0110", "0.0100", "deg/s", "84"),
        ("innovation / its sd", "gy", "1.84", "1.00", "0.00900 to 0.0110", "1.00", "", "84"),
    )
    assert made["These logs cannot show"].rows == (
        ("scale factor, g squared", "would look like a constant bias"), ("gravity", "looks like scale factor"),
    )  # fmt: skip
    none = trace_tables.sections(document(error=[]), TERMINAL)
    assert next(s for s in none if s.title == "Errors").blocks[0].text.startswith("None was measured")  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("motion", "d", "name", "said"),
    [
        (
            "cool it down",
            42.0,
            "run experiment",
            "To tell (42 sd apart are expected, 5 are enough): cool it down. `-o FILE`",
        ),
        ("nothing known separates them", 2.1, "stays open", "? nothing known separates them"),
    ],
)
def test_what_would_separate_is_said_as_an_operator_does_it(motion: str, d: float, name: str, said: str) -> None:
    made = {**document()["separating_experiment"], "motion": motion, "d_expected": d}
    row = tables(document(separating_experiment=made))["What to do"].rows[1]
    assert row[:2] == (name, "gy")
    assert said in row[2]


def test_a_clean_unit_needs_nothing_and_one_power_on_no_more_than_another() -> None:
    runs = [{**RUN, "power_on": "p"}, {**RUN, "power_on": "q"}]
    clean = document(**traces.nothing().document, runs=runs, separating_experiment=None)
    assert [row[0] for row in tables(clean)["What to do"].rows] == ["nothing"]
    assert {row[1:] for row in tables(clean)["Channels"].rows} == {("–", "", "nothing", "clean", "nothing")}
    assert tables(document(runs=[RUN]))["What to do"].rows[-1][0] == "record again"
    assert "does not show transfer" in trace_tables.held_out(document(runs=[RUN]))


def test_simulated_readings_are_called_simulated() -> None:
    assert "SIMULATED" in trace_tables.headline(document(), "x")[1]
    assert "SIMULATED" not in trace_tables.headline(document(runs=[{**RUN, "kind": "measured"}]), "x")[1]


@given(st.floats(1e-3, 1e6), st.floats(1e-3, 1e6))
def test_a_bar_is_logarithmic_from_a_half_to_a_thousand(before: float, after: float) -> None:
    """Ten marks at most, three a decade; a mark is left at the floor, and more error is never less bar."""
    made = bar(before, after)
    assert len(made) <= 10
    assert ("▒" in made) <= (after > before)
    assert ("░" in made) <= (after < before)
    assert made.count("█") <= bar(max(before, 1.0), max(after, 1.0)).count("█")


def test_bars_of_known_ratios() -> None:
    assert [bar(x, x) for x in (0.2, 0.5, 1.0, 10.0, 100.0, 1000.0, 1e5)] == [
        "█" * n for n in (0, 0, 1, 4, 7, 10, 10)
    ]  # fmt: skip
    assert bar(329.0, 55.4) == "██████░░░"
    assert bar(146.0, 320.0) == "███████▒▒"
    assert bar(None, 1.0) == ""


def test_cells_go_on_below_in_their_column() -> None:
    columns = (Column("Channel", "code"), Column("Value", "number"), Column("Said"))
    table = Table(columns, (("gx", "1.25", "one two three four"), ("gy", "", "five")), "All of it.")
    made = plain.text([Section("Title", (table, Paragraph("Last `words`."), Items(("an item",))))], 22)
    assert made.splitlines() == [
        "Title", "    Value  Said", "gx   1.25  one two", "           three four", "gy         five", "All of it.",
        "Last words.", "- an item",
    ]  # fmt: skip


def test_signs_that_are_wider_shift_no_column() -> None:
    ascii_text = trace_tables.text(document(), "x", 80, signs=GLYPHS["ascii"].text)
    assert ascii_text.isascii()
    assert max(map(len, ascii_text.splitlines())) <= 80
    lines = ascii_text.splitlines()[3:]
    row = next(line for line in lines if line.startswith("gy"))
    assert "8.41 -> 1.01  #:::" in row
    assert lines[1].index("Cause") == row.index("linear")
    assert "8.41" in trace_tables.text(document(), "x", 12)


def test_every_effect_has_a_short_name() -> None:
    for effect in EFFECTS:
        assert len(plain_names.short(effect).split()) <= 3 or effect.startswith("driver:")
        assert "_" not in plain_names.short(effect)
    assert trace_glance.status_words("confounded") == "several fit"


def test_what_a_new_power_on_must_measure_again_is_said_and_what_one_cannot_tell() -> None:
    """A row a kind; in the list of what to do only what differs. Of one power-on nothing is known."""
    known = (
        ("bias", "mg", 3.7, [2.4, 8.1], True),
        ("scale", "1", 0.0, [0.0, 1e-5], False),
        ("cross_axis", "rad", 0.1, [0.0, 1.0], None),
        ("g_squared", "mg", None, None, None),
    )
    names = ("effect", "unit", "session_sd", "session_ci95", "measure_again")
    common = {"channels": ["ax", "ay"], "power_ons": 3, "expected_sd": 1.0}
    rows = [{**common, **dict(zip(names, values, strict=True))} for values in known]
    made = tables(document(carries_over=rows))
    told = [row[1:] for row in made["What carries over to the next power-on"].rows]
    assert told == [
        ("bias", "3.7 mg", "2.4 to 8.1 mg", "must measure it again"),
        ("scale factor", "0", "0 to 1e-05", "has the same"),
        ("cross axis", "0.1 rad", "0 to 1 rad", "not told by so few"),
        ("g squared", "not known", "", "can't be known of one"),
    ]
    (again,) = [row for row in made["What to do"].rows if row[0] == "measure again"]
    assert again[1] == "ax ay"
    assert again[2].startswith("bias at every power-on")


def test_a_bias_of_four_power_ons_is_no_curve() -> None:
    params = [{"name": f"b run{k}", "value": k, "sd": 0.1, "unit": "mg", "plausible": True} for k in range(4)]
    assert len(trace_tables._parameters(params)) == 4

"""What a trace says of an undeclared effect, judged against what its set says of it.

The rules stand here once, before anything is run. A name is right if what drives it drives the effect: drivers of the
set's words, a family of names each. Nothing here knows a set.
"""

from collections.abc import Iterable
from typing import Any

import bench
from undeclared_sets import FAINT_D, VISIBLE_D, Undeclared

from filters.channels import CHANNELS

Document = dict[str, Any]

# what drives an effect of the catalogue, in a set's words; own: the channel's own input, others: those beside it
_DRIVEN_BY: dict[str, tuple[str, ...]] = {
    "thermal_lin": ("temperature",),
    "thermal_poly": ("temperature",),
    "thermal_rate": ("temperature_rate",),
    "thermal_lag": ("temperature_history",),
    "hysteresis": ("temperature_history",),
    "warmup": ("time",),
    "ramp": ("time",),
    "scale": ("own",),
    "asymmetry": ("own",),
    "nonlinearity_cubic": ("own",),
    "nonlinearity_quadratic": ("own",),
    "thermal_scale": ("own", "temperature"),
    "cross_axis": ("others",),
    "mounting": ("others",),
    "g_sensitivity": ("force_x", "force_y", "force_z"),
    "g_squared": ("force_x", "force_y", "force_z"),
    "earth_rate": ("angle_outer", "angle_middle", "angle_inner"),
    "harmonic": ("angle_outer", "angle_middle", "angle_inner"),
    "delay": ("rate_change",),
    "lever_arm": ("rate_x", "rate_y", "rate_z", "rate_change"),
    "tilt": ("force_x", "force_y", "force_z"),
    "gravity": ("force_x", "force_y", "force_z"),
    "bias": (),
}
# what says when, or how it wanders, but not why
_WITHOUT_DRIVER = ("tone", "step", "telegraph", "random_walk", "gauss_markov", "bandwidth", "noise_crosstalk")
_INPUTS = {"w": "rate", "f": "force"}
_FREE = {
    "time": ("time",),
    "temperature": ("temperature",),
    "temperature_threshold": ("temperature",),
    "temperature_rate": ("temperature_rate",),
    "since_motion": ("motion_history",),
    "rate_norm": ("rate_x", "rate_y", "rate_z"),
    "table_accel": ("rate_change",),
}
_OF_ANGLES = {"angle": "angle_", "direction": "motion_history", "turns": "motion_history", "settling": "motion_history"}

# a driver of the set and names that say the same of it: a rate of temperature is told by how the past differs from now
_REMEMBER = {"lag", "play", "relay", "hold"}  # operators with a memory
_ALSO = {
    "temperature_rate": ("temperature_history",),
    "temperature_history": ("temperature_rate",),
    "rate_change": ("motion_history",),
}


def drivers_of(effect: str, channel: str) -> frozenset[str]:
    """Drivers, in a set's words, that a finding's name says are behind an error of a channel."""
    if effect.startswith("driver:"):
        return frozenset(word for factor in effect[7:].split("*") for word in _free(factor))
    if effect.startswith("cause:"):
        return frozenset(_of_chain(effect[6:]))
    kind, axis = ("rate" if channel[0] == "g" else "force"), channel[1]
    words: set[str] = set()
    for word in _DRIVEN_BY.get(effect, ()):
        if word == "own":
            words.add(f"{kind}_{axis}")
        elif word == "others":
            words |= {f"{kind}_{other}" for other in "xyz" if other != axis}
        else:
            words.add(word)
    return frozenset(words)


def _of_chain(name: str) -> tuple[str, ...]:
    """What a chain of operators is over; of temperature with a memory its past."""
    *operators, of = name.rstrip(")").split("(")
    if operators == ["rate"] and of[0] == "w":
        return ("rate_change",)
    return ("temperature_history",) if of == "temperature" and _REMEMBER & {*operators} else _free(of)


def _free(name: str) -> tuple[str, ...]:
    if name in _FREE:
        return _FREE[name]
    if name[0] in _INPUTS and name[1:] in ("x", "y", "z"):
        return (f"{_INPUTS[name[0]]}_{name[1:]}",)
    what, _, axis = name.partition("_")
    word = _OF_ANGLES.get(what)
    return () if word is None else (word + axis if word.endswith("_") else word,)


def is_right(truth: Undeclared, effect: str, channel: str) -> bool:
    """Whether a name is right for an effect on a channel: it names some of its drivers, and none beside them.

    A name without a driver (a tone, a step, a random walk) is right of what the recording does not hold. Where several
    inputs stand for one name, as all forces for g_sensitivity, one of them is enough.
    """
    known = {*truth.driver, *truth.same_as}
    known |= {also for word in truth.driver for also in _ALSO.get(word, ())}
    if truth.memory and "temperature" in known:
        known.add("temperature_history")
    if effect in _WITHOUT_DRIVER:
        return not truth.in_log
    named = drivers_of(effect, channel)
    several = len(named) > 1 and not effect.startswith(("driver:", "cause:")) and effect != "thermal_scale"
    return bool(named & known) if several else bool(named) and named <= known


def judged(truth: Undeclared, d: dict[str, float], document: Document, control: Document | None) -> dict[str, Any]:
    """A trace beside the truth.

    `truth`: what the set says.
    `d`: achieved on each channel.
    `document`: from `imutui trace --json`.
    `control`: of the same measured recording without an effect: what is found there is the recording's.
    """
    visible = [c for c in CHANNELS if d[c] >= VISIBLE_D]
    touched = [c for c in CHANNELS if d[c] > 0.0]
    told = {c: _told(document, c) for c in CHANNELS}
    before = {c: set() if control is None else _told(control, c) for c in CHANNELS}
    explained = {c: document["status"][c] == "explained" for c in CHANNELS}
    # a line explains a channel too, unless the recording has it by itself
    causes = {c: _deterministic(document, c) | (_lines(document, c) - before[c]) for c in touched}
    wrong = {c: sorted(e for e in causes[c] if not is_right(truth, e, c)) for c in touched if explained[c]}
    held = {c: told[c] - (_refuted(document, c) - _deterministic(document, c)) for c in touched}
    return {
        "visible": visible,
        "faint": [c for c in CHANNELS if FAINT_D <= d[c] < VISIBLE_D],
        "flagged": [c for c in visible if _flagged(document, control, c)],
        "found_beyond_control": {c: sorted(told[c] - before[c]) for c in touched},
        "named_rightly": [c for c in touched if any(is_right(truth, e, c) for e in held[c])],
        "right_or_rival": [c for c in touched if any(is_right(truth, e, c) for e in held[c] | _rivals(document, c))],
        "explained_wrongly": {c: names for c, names in wrong.items() if names},
        "outside_log_explained": [
            c for c in touched if not truth.in_log and explained[c] and _deterministic(document, c)
        ],
        "false_on_untouched": {
            c: names for c in CHANNELS
            if c not in touched and (names := sorted(_deterministic(document, c) - before[c]))
        },
    }  # fmt: skip


def _told(document: Document, channel: str) -> set[str]:
    """Names of all that is reported of a channel, whether it was held or not, without what is only weak."""
    names = {f["effect"] for f in document["findings"] if channel in f["channels"]}
    names |= _refuted(document, channel) | _lines(document, channel)
    names |= {entry["kind"] for entry in document["drift"] if channel in entry["channels"]}
    return names | {f"common_{e['kind']}" for e in document["common"] if channel in e["channels"]}


def _lines(document: Document, channel: str) -> set[str]:
    return {"tone" for line in document["lines"] if channel in line["channels"]}


def _refuted(document: Document, channel: str) -> set[str]:
    return {f["effect"] for f in document["refuted"] if channel in f["channels"]}


def _rivals(document: Document, channel: str) -> set[str]:
    return {
        rival["effect"] for f in document["findings"] if channel in f["channels"] for rival in f["rivals"]
    }  # fmt: skip


def _deterministic(document: Document, channel: str) -> set[str]:
    """Findings of a channel that say what drives it."""
    return {
        f["effect"] for f in document["findings"]
        if channel in f["channels"] and f["effect"] not in _WITHOUT_DRIVER
    }  # fmt: skip


def _flagged(document: Document, control: Document | None, channel: str) -> bool:
    """Whether a channel is said to be not as it should be; on a recording that drifts by itself, more than there."""
    status = document["status"][channel]
    if control is None:
        return bool(status != "clean")
    if status != control["status"][channel] and status != "clean":
        return True
    more = _told(document, channel) - _told(control, channel)
    weak = {f["effect"] for f in document["weak"] if channel in f["channels"]}
    weak -= {f["effect"] for f in control["weak"] if channel in f["channels"]}
    return bool(more or weak) or _drift_level(document, channel) > 2.0 * _drift_level(control, channel)


def _drift_level(document: Document, channel: str) -> float:
    return max((float(e["level"]) for e in document["drift"] if channel in e["channels"]), default=0.0)


# ------------------------------------------------------------------------------------------------------------ all of it


def summary(results: Iterable[tuple[Undeclared, Document]]) -> dict[str, Any]:
    """Counts over a set, with Wilson intervals; each case as in the result file."""
    cases = list(results)
    visible = [case["judged"] for _, case in cases if case["judged"]["visible"]]
    outside = [case["judged"] for truth, case in cases if not truth.in_log]
    inside = [case["judged"] for truth, case in cases if truth.in_log and case["judged"]["visible"]]
    channels = [(c in judge["flagged"]) for judge in visible for c in judge["visible"]]
    untouched = sum(6 - len([c for c in CHANNELS if case["d"][c] > 0.0]) for _, case in cases)
    false = sum(len(case["judged"]["false_on_untouched"]) for _, case in cases)
    alone = [case["without"] for _, case in cases if case.get("without") is not None]
    return {
        "visible_right_channel": _count(sum(bool(j["flagged"]) for j in visible), len(visible)),
        "visible_channels_flagged": _count(sum(channels), len(channels)),
        "named_rightly_in_log": _count(sum(bool(j["named_rightly"]) for j in inside), len(inside)),
        "right_or_rival_in_log": _count(sum(bool(j["right_or_rival"]) for j in inside), len(inside)),
        "explained_wrongly": _count(sum(bool(case["judged"]["explained_wrongly"]) for _, case in cases), len(cases)),
        "outside_log_explained": _count(sum(bool(j["outside_log_explained"]) for j in outside), len(outside)),
        "false_on_untouched_channels": _count(false, untouched),
        "false_on_measured_noise_alone": _count(
            sum(bool(_deterministic(document, c)) for document in alone for c in CHANNELS), 6 * len(alone)
        ),
    }


def _count(hits: int, n: int) -> dict[str, Any]:
    low, high = bench.wilson(hits, n)
    return {"count": hits, "of": n, "ci95": [round(low, 3), round(high, 3)]}


def table(results: Iterable[tuple[Undeclared, Document]]) -> list[str]:
    """The cases as rows of Markdown."""
    lines = [
        "| effect | on | noise, motion | d | driver | found | status | E10/floor | visible channels flagged | wrong |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for truth, case in results:
        document, judge = case["trace"], case["judged"]
        touched = [c for c in CHANNELS if case["d"][c] > 0.0]
        found = "; ".join(f"{c}: {', '.join(sorted(_told(document, c))) or '–'}" for c in touched)
        status = ", ".join(f"{c} {document['status'][c]}" for c in touched)
        wrong = "; ".join(f"{c}: {', '.join(names)}" for c, names in judge["explained_wrongly"].items())
        flagged = f"{len(judge['flagged'])} of {len(judge['visible'])}" if judge["visible"] else "none is visible"
        errors = ", ".join(f"{c} {b:.2f} → {a:.2f}" for c, b, a in _e10(document) if c in touched)
        where = f"{'measured' if truth.measured else 'simulated'}, {'table' if truth.table else 'still'}"
        sizes = ", ".join(format(case["d"][c], ".0f") for c in touched)
        lines.append(
            f"| {truth.name} | {' '.join(touched)} | {where} | {sizes} | {' '.join(truth.driver)} | {found} |"
            f" {status} | {errors} | {flagged} | {wrong or 'no'} |"
        )
    return lines


def _e10(document: Document) -> list[tuple[str, float, float]]:
    return [
        (e["channel"], e["before_x_floor"], e["after_x_floor"])
        for e in document["error"]
        if e["metric"] == "e10" and e["before_x_floor"] is not None and e["after_x_floor"] is not None
    ]


def words(counts: dict[str, Any]) -> list[str]:
    """The summary as rows of Markdown."""
    lines = ["| | count | 95 % |", "|---|---|---|"]
    return lines + [
        f"| {name.replace('_', ' ')} | {v['count']} of {v['of']} | {v['ci95'][0]:.2f}–{v['ci95'][1]:.2f} |"
        for name, v in counts.items()
    ]

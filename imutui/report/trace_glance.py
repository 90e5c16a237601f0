"""The answer of a trace at a glance: a row a channel, and what to do."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from filters.channels import CHANNELS
from filters.effects import plain_names
from filters.tracing.sentence import OF_ONE_RUN
from filters.tracing.trace_document import SEPARATES, ErrorEntry, FindingEntry, TraceDocument
from imutui.report.blocks import Column, Table
from imutui.report.numbers import NOTHING, duration, times_floor

_STATUS = {
    "confounded": "several fit",
    "partial": "in part",
    "stochastic": "drift",
    "run_specific": "one run only",
    "unexplained": "not explained",
}
METRICS = {
    "e10": "10 s means",
    "nis": "innovation / its sd",
    "drift_10s": "drift in 10 s",
    "drift_60s": "drift in 60 s",
    "bias_prediction": "bias 60 s on",
    "coverage": "truth inside 3 σ",
    "gravity_norm": "size of gravity",
    "gravity_direction": "direction of gravity",
}
_LEAST, _MOST, _MARKS = 0.5, 1000.0, 10
_BAR = (
    "The bar is logarithmic, 0.5 to 1000 × the floor, three marks a decade: █ is left, ░ was taken away, ▒ was added."
)
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Places:
    """How a reader gets what goes with a result: the effects file, the separating motion, courses of common causes."""

    effects: str = "`-o effects.toml` writes them"
    experiment: str = "`-o FILE` or `--report DIR` saves it as experiment.toml"
    course: str = "which --report DIR saves"


TERMINAL = Places()


_Action = tuple[str, str, str]


def status_words(status: str) -> str:
    """What became of a channel, in a word or two."""
    return _STATUS.get(status, status)


def glance(d: TraceDocument) -> Table:
    """A row a channel: error before and after over its floor, cause, how sure, what to do."""
    columns = (Column("Channel", "code"), Column("× floor", "number"), Column("log scale", "bar"), Column("Cause"),
               Column("How sure"), Column("What to do"))  # fmt: skip
    actions = _actions(d, TERMINAL)
    rows = [
        (channel, *_ratios(_error(d, channel)), _cause(d, channel), _how_sure(d, channel), _next(d, channel, actions))
        for channel in CHANNELS if channel in d["status"]
    ]  # fmt: skip
    rows += [
        ("all", *_ratios(e), METRICS[e["metric"]], NOTHING, NOTHING)
        for e in d["error"] if e["metric"] in ("gravity_norm", "gravity_direction")
    ]  # fmt: skip
    held = [f"run {run['id']}" for run in d["runs"] if run["heldout"]]
    where = f"on {held[0]}, to which nothing was fitted" if held else "within the run, by folds"
    return Table(columns, tuple(rows), f"Error of 10 s means before → after, {where}. {_BAR}")


def _error(d: TraceDocument, channel: str) -> ErrorEntry | None:
    return next((e for e in d["error"] if e["metric"] == "e10" and e["channel"] == channel), None)


def _ratios(e: ErrorEntry | None) -> tuple[str, str]:
    """Both ratios to the floor, and their bar."""
    if e is None or e["after"] is None:
        return NOTHING, ""
    before, after = e["before_x_floor"], e["after_x_floor"]
    told = [times_floor(x) for x in (before, after)]
    return (told[0] if told[0] == told[1] else " → ".join(told)), bar(before, after)


def bar(before: float | None, after: float | None) -> str:
    """Ratios to the floor on a logarithmic scale: what is left, then what was taken away or added."""
    if before is None or after is None:
        return ""
    a, b = _marks(before), _marks(after)
    return "█" * min(a, b) + "░" * (a - b) + "▒" * (b - a)


def _marks(ratio: float) -> int:
    inside = min(max(ratio, _LEAST), _MOST)
    return round(_MARKS * math.log(inside / _LEAST) / math.log(_MOST / _LEAST))


def _on(entries: Iterable[T], channel: str) -> list[T]:
    return [entry for entry in entries if channel in entry["channels"]]  # type: ignore[index]


def _cause(d: TraceDocument, channel: str) -> str:
    """The leading cause in a few words, and how many more there are; what is only suspected comes last."""
    found = _on(d["findings"], channel)
    # what lasts, and is confirmed, leads
    found.sort(key=lambda f: (f["confirmed"] is False, f["include_as"] == "N", f["effect"] in OF_ONE_RUN))
    lasting = [_short(f) for f in found if f["confirmed"] is not False]
    doubtful = [_short(f) for f in found if f["confirmed"] is False]
    names = lasting + [plain_names.short(x["kind"]) for x in _on(d["drift"], channel)]
    names += [f"line {x['hz']:.4g} Hz" for x in _on(d["lines"], channel)] + doubtful
    names += [plain_names.short(x["effect"]) for x in _on([*d["refuted"], *d["integrity"]], channel)]
    names += ["uneven noise" for _ in _on(d["noise_level"], channel)]
    names = list(dict.fromkeys(names)) or ["nothing"]
    return names[0] + (f" + {len(names) - 1}" if len(names) > 1 else "")


def _short(f: FindingEntry) -> str:
    hz = next((p["value"] for p in f["params"] if p["name"] == "frequency"), None)
    return plain_names.short(f["effect"]) + (f" {hz:.3g} Hz" if hz is not None else "")


def _how_sure(d: TraceDocument, channel: str) -> str:
    words = [status_words(d["status"][channel])]
    words += ["not confirmed"] if any(f["confirmed"] is False for f in _on(d["findings"], channel)) else []
    words += ["refuted"] if _on(d["refuted"], channel) else []
    return ", ".join(words)


def _next(d: TraceDocument, channel: str, actions: Sequence[_Action]) -> str:
    names = [name for name, channels, _ in actions if channel in channels.split()]
    return ", ".join(names[:2]) or ("nothing" if d["status"][channel] == "clean" else NOTHING)


# ------------------------------------------------------------------------------------------------------ what to do


def to_do(d: TraceDocument, places: Places) -> Table:
    """What the last column of the glance asks for, in order: on which channels, and how."""
    nothing = "estimate constant biases as each run begins, as the filter does; there is nothing else to correct"
    rows = _actions(d, places) or [("nothing", "all", nothing)]
    return Table((Column("Do"), Column("Channels", "code"), Column("How")), tuple(rows))


def _actions(d: TraceDocument, places: Places) -> list[_Action]:
    """What to do, in the order in which to do it."""
    found = d["findings"]
    held = [f for f in found if f["confirmed"] is not False and f["include_as"] != "N"]
    doubtful = [*(f for f in found if f["confirmed"] is False), *d["refuted"]]
    common, drift = d["common"], [entry for entry in d["drift"] if entry["common"] is None]
    again = [e for e in d["carries_over"] if e["measure_again"]]
    kinds = dict.fromkeys(plain_names.short(e["effect"]) for e in again)
    times = [tau for entry in drift if (tau := entry["tau_s"])]
    once = len({run["power_on"] for run in d["runs"]}) < 2
    record = ", ".join(dict.fromkeys(what for entry in common for what in entry["record"]))
    within = f", within {duration(min(times))}" if times else ""
    every = [
        ("check wiring", d["integrity"], "look at cable, connector and supply before the next recording"),
        _separate(d, places),
        ("use effects", [f for f in held if f["effect"] not in OF_ONE_RUN],
         f"{places.effects}; `record`, `replay` and `apply` take them with `--effects effects.toml`"),
        ("measure again", again,
         f"{', '.join(kinds)} at every power-on: rest in several directions, and trace that log"),
        ("leave out", doubtful, "the held-out run refutes or does not confirm it: record that condition again"),
        ("see what was", [f for f in held if f["effect"] in OF_ONE_RUN],
         "look for what happened then; it is in no effects file, for it says nothing of the next run"),
        ("log more", common, f"record {record} beside the readings: these channels move together"),
        ("vary the run", [{"channels": [c]} for c, s in d["status"].items() if s in ("unexplained", "partial")],
         "something is left: record a run in which something else changes, and trace it with these"),
        ("estimate often", drift, f"take the bias at rest again{within}; the effects file has the filter expect it"),
        ("record again", [*held, *drift] if once else [],
         "another power-on shows whether these results hold for the next one"),
    ]  # fmt: skip
    made = []
    for name, entries, how in every:
        own = {c for entry in entries for c in entry["channels"]}  # type: ignore[attr-defined]
        if own:
            made.append((name, " ".join(c for c in CHANNELS if c in own), how))
    return made


def _separate(d: TraceDocument, places: Places) -> tuple[str, list[FindingEntry], str]:
    made = d["separating_experiment"]
    if not made:
        return "", [], ""
    a, b = made["a"], made["b"]
    pairs = [f for f in d["findings"] if {a, b} <= {f["effect"], *(r["effect"] for r in f["rivals"])}]
    pairs = pairs or d["findings"]
    what = f"{plain_names.short(a)} or {plain_names.short(b)}?"
    motion = made["motion"]
    if made["d_expected"] < SEPARATES:
        return "stays open", pairs, f"{what} {motion}"
    apart = f"{made['d_expected']:.0f} sd apart are expected, {SEPARATES:.0f} are enough"
    return "run experiment", pairs, f"{what} To tell ({apart}): {motion}. {places.experiment}"

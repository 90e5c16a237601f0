"""The result in words, made of the document's own entries: what was found, what was refuted, what to do next.

Standard library only. What is said of each channel is the page's matter (`imutui.report`); this is what stands first.
"""

from collections.abc import Sequence

from filters.effects import plain_names
from filters.tracing.trace_document import SEPARATES, FindingEntry, TraceFindings

_HOW = {
    "run": "on a run not used",
    "part": "on a part of the power-on that was not used, which does not show transfer to another power-on",
    "folds": "within the run, which does not show transfer",
}
_RIVALS = 3
OF_ONE_RUN = ("step", "telegraph")
"""Effects of which nothing can be foretold: how much of the error they explain is said of no other run."""


Joining = Sequence[tuple[str, tuple[str, ...]]]


def sentence(d: TraceFindings, *, next_run: str, joining: Joining) -> str:
    """The result in a few sentences, the last of which says what to do next.

    `d`: all but its sentence.
    `next_run`: what an operator does to tell rivals apart; empty where nothing would, or nothing is to be told apart.
    `joining`: effects that join the filter, with their channels.
    """
    told = [_found(d), *_refuted(d), _common(d), _next(d, next_run=next_run, joining=joining)]
    return " ".join(text for text in told if text)


def _found(d: TraceFindings) -> str:
    lasting = [f for f in d["findings"] if f["include_as"] != "N"]
    # what the held-out run confirms comes first, what it does not last
    lasting.sort(key=lambda f: {True: 0, None: 1, False: 2}[f["confirmed"]])
    if lasting:
        return _finding(lasting[0], len(d["findings"]) - 1) + _error(d, lasting[0])
    if d["drift"]:
        names = ", ".join(c for entry in d["drift"] for c in entry["channels"])
        return f"{names}: drift that no logged variable explains; nothing else was found."
    if d["refuted"]:
        return "Nothing that was found holds on the held-out run."
    if d["findings"]:
        f = d["findings"][0]
        return f"{', '.join(f['channels'])}: {plain_names.short(f['effect'])}; no other effect was found."
    if d["integrity"] or d["lines"] or d["noise_level"]:
        kinds = [
            *dict.fromkeys(plain_names.effect(entry["effect"]) for entry in d["integrity"]),
            *(["lines"] if d["lines"] else []),
            *(["an uneven noise level"] if d["noise_level"] else []),
        ]
        return f"No effect was found on the mean of the readings, only {', '.join(kinds)}."
    return "Nothing was found: constant biases and white noise explain these data, as far as their motion can show."


def _finding(f: FindingEntry, more: int) -> str:
    text = f"{', '.join(f['channels'])}: {plain_names.short(f['effect'])}"
    if f["confirmed"] is False:
        text += ", which the held-out run neither confirms nor contradicts"
    elif f["share_of_excess"] is not None and f["effect"] not in OF_ONE_RUN:
        text += f", explains {_share(f['share_of_excess'])} of the error"
    if f["rivals"]:
        text += f", not told from {' or '.join(plain_names.short(r['effect']) for r in f['rivals'][:_RIVALS])}"
    text += f"; {more} more finding{'s' if more > 1 else ''}" if more else ""
    return text + "."


def _share(share: float) -> str:
    percent = 100.0 * share
    return "less than 1 %" if percent < 1.0 else f"{percent:.0f} %" if percent < 99.5 else "nearly all"


def _error(d: TraceFindings, f: FindingEntry) -> str:
    own = [x for x in d["error"] if x["metric"] == "e10" and x["channel"] in f["channels"]]
    known = [(before, after, x) for x in own if (before := x["before_x_floor"]) and (after := x["after_x_floor"])]
    if not known:
        return ""
    before, after, x = max(known, key=lambda entry: entry[0])
    return f" Error {_times(before)} → {_times(after)} × floor {_HOW[x['heldout']]}."


def _times(ratio: float) -> str:
    """Two digits, and all before the point."""
    return f"{ratio:.0f}" if ratio >= 9.95 else f"{ratio:.2g}"


def _refuted(d: TraceFindings) -> list[str]:
    names = [f"{', '.join(x['channels'])} {plain_names.short(x['effect'])}" for x in d["refuted"]]
    return [f"Refuted by the held-out run: {'; '.join(names)}."] if names else []


def _common(d: TraceFindings) -> str:
    """Which channels share something, and what to record for it."""
    which = ", and ".join(dict.fromkeys(" ".join(entry["channels"]) for entry in d["common"]))
    wanted = dict.fromkeys(x for entry in d["common"] for x in entry["record"])
    return f"{which} move together; the cause is not in this log: record {', '.join(wanted)}." if which else ""


def _next(d: TraceFindings, *, next_run: str, joining: Joining) -> str:
    """What to do next: tell rivals apart, show transfer, warm up, use what was found, or move the unit."""
    heldout = {x["heldout"] for x in d["error"]}
    effects = [f for f in d["findings"] if f["include_as"] in ("A", "S")]
    if next_run:
        return f"Next: {next_run}."
    if (effects or d["drift"]) and not heldout & {"run"}:
        return "Next: record another power-on, with another temperature history, and name it last: it will judge."
    if any(
        f["include_as"] == "A" and f["confirmed"] and (f["effect"], tuple(f["channels"])) in joining for f in effects
    ):
        return "Next: use the effects file that -o writes, with --effects of replay and record."
    if d["refuted"] or any(f["confirmed"] is False for f in effects):
        return "Next: record more power-ons that differ, so that what does not carry over shows before it is judged."
    if joining:
        return "Next: use the effects file that -o writes: the filter's covariance then allows for what is there."
    hidden = {u["effect"] for u in d["untestable"] if u["reason"] != "collinear_with"}
    if "thermal_lin" in hidden:
        return "Next: record a warm-up, with temperature in the log: without one no thermal effect can be seen."
    if "scale" in hidden:
        return "Next: move the unit on a table: at rest in one attitude no effect of motion can be seen."
    return ""


def next_run(duration_s: float, d_expected: float, pair: Sequence[str]) -> str:
    """What an operator does to tell a pair of effects apart, without its full stop; empty if it would not.

    `duration_s`, `d_expected`: of the separating experiment.
    `pair`: the two effects.
    """
    if d_expected < SEPARATES:
        return ""
    a, b = map(plain_names.short, pair)
    return f"to tell {a} from {b}, record the experiment of {duration_s / 60.0:.0f} min"

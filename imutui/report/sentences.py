"""What a trace found, in sentences; the terminal and the page say the same ones.

Pure functions from the result document (docs/formats.md) to text. Everything it names is in the instrument's own
axes and sign.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from filters.channels import CHANNELS as CHANNELS
from filters.effects import plain_names
from filters.tracing.sentence import OF_ONE_RUN
from filters.tracing.trace_document import (
    SEPARATES,
    DriftEntry,
    ErrorEntry,
    FindingEntry,
    IntegrityEntry,
    LimitEntry,
    LineEntry,
    NoiseLevelEntry,
    ParameterEntry,
    RefutedEntry,
    RivalEntry,
    TraceDocument,
    UntestableEntry,
    WeakEntry,
)
from imutui.report import wrapping
from imutui.report.numbers import duration, plus_minus, share, times_floor

_UNITS = {"g": "deg/s", "a": "mg"}
_KINDS = {
    "simulated": "SIMULATED readings",
    "measured": "measured readings",
    "unknown": "origin of readings not stated",
}
_STATUS = {
    "clean": "clean",
    "explained": "explained",
    "confounded": "several causes fit",
    "partial": "explained in part",
    "stochastic": "drifts",
    "run_specific": "event of one run",
    "unexplained": "not explained",
}
_METRICS = {
    "e10": "10 s mean error",
    "nis": "√(NIS/dof)",
    "drift_10s": "free drift over 10 s",
    "drift_60s": "free drift over 60 s",
    "bias_prediction": "bias predicted 60 s ahead",
    "coverage": "truth inside the bias' 3σ band",
    "gravity_norm": "magnitude of gravity",
    "gravity_direction": "direction of gravity",
}
_REASONS = {
    "equals_bias": "would look like a constant bias",
    "no_excitation": "nothing here excites it",
    "collinear_with": "",
}
SAVED = "The motion is experiment.toml, which --report DIR or -o FILE saves."
_FEW = 3
_ONE_SD = " (1 sd)"
_IN_LABEL = ("order", "at", "run", "start", "switches", "frequency")


@dataclass(frozen=True, slots=True)
class ChannelLine:
    """A channel, its status in a word or two, and what is said of it."""

    channel: str
    status: str
    sentences: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Section:
    """A heading with its sentences."""

    title: str
    sentences: tuple[str, ...]


def status_words(status: str) -> str:
    """What became of a channel, in words."""
    return _STATUS.get(status, status)


def text(d: TraceDocument, source: str, width: int, saved: str = SAVED) -> str:
    """All of it as paragraphs of at most so many characters a line.

    `d`: the result document.
    `source`: which logs it is of.
    `width`: of a line.
    `saved`: how the separating motion is saved, a sentence.
    """
    out = [wrapping.fill(line, width) for line in headline(d, source)]
    out.append("")
    for line in channel_lines(d):
        first = f"{line.channel}  {line.status:<18} "
        for n, sentence in enumerate(line.sentences or ("–",)):
            begin = first if n == 0 else " " * len(first)
            out.append(wrapping.fill(start(sentence), width, initial_indent=begin, subsequent_indent=" " * len(first)))
    for section in sections(d, saved):
        out += ["", section.title]
        out += [
            wrapping.fill(start(sentence), width, initial_indent="  ", subsequent_indent="    ")
            for sentence in section.sentences
        ]
    return "\n".join(out)


def start(sentence: str) -> str:
    """A sentence begins with a capital, unless it begins with the name of a channel or a run."""
    first = sentence.split(" ", 1)[0]
    named = first.endswith(":") or first in CHANNELS
    return sentence if named else sentence[:1].upper() + sentence[1:]


def headline(d: TraceDocument, source: str) -> list[str]:
    """What was traced, whose readings, how long, and the one sentence of the result."""
    runs = d["runs"]
    kinds = sorted({run["kind"] for run in runs})
    words = ", ".join(_KINDS.get(kind, kind) for kind in kinds)
    total = sum(run["seconds"] for run in runs)
    rates = sorted({round(run["rate_hz"], 2) for run in runs})
    rate = f"{rates[0]:g}" if len(rates) == 1 else f"{rates[0]:g} to {rates[-1]:g}"
    references = ", ".join(sorted({run["reference"] for run in runs if "reference" in run}))
    size = f"{len(runs)} run{'s' if len(runs) > 1 else ''}, {duration(total)} at {rate} Hz, {words}"
    lines = [source, size + (f", reference {references}" if references else "")]
    return [*lines, sentence] if (sentence := d.get("sentence")) else lines


def channel_lines(d: TraceDocument) -> list[ChannelLine]:
    """One entry a channel, in order, with what was found on it alone."""
    lines = []
    for channel in CHANNELS:
        status = d.get("status", {}).get(channel, "clean")
        said = [_finding(f, d) for f in d.get("findings", []) if tuple(f["channels"]) == (channel,)]
        said += [
            f"with others: {f['label']} (below)."
            for f in d.get("findings", [])
            if channel in f["channels"] and len(f["channels"]) > 1
        ]
        said += [_refuted(entry) for entry in d.get("refuted", []) if channel in entry["channels"]]
        said += [_drift(entry, channel) for entry in d.get("drift", []) if channel in entry["channels"]]
        said += _beside(d, channel)
        said += _remainder(d, channel)
        if error := _error(d, channel):
            said.append(error)
        if status == "clean":
            said = [" ".join(["Nothing found.", *said])]
        lines.append(ChannelLine(channel, status_words(status), tuple(said)))
    return lines


def sections(d: TraceDocument, saved: str = SAVED) -> list[Section]:
    """What is to be said of several channels or of none: shared effects, data, weak terms, limits, what to do next.

    `d`: the result document.
    `saved`: how the separating motion is saved, a sentence.
    """
    made = [
        Section("Over several channels", tuple(_finding(f, d, names=True) for f in shared(d))),
        Section("Shared by several channels, not in this log", tuple(_common(d))),
        Section("Data", tuple(_fault(entry) for entry in d.get("integrity", []))),
        Section("Lines", tuple(_line(entry) for entry in d.get("lines", []))),
        Section("Noise level", tuple(_noise(entry) for entry in d.get("noise_level", []))),
        Section("Weak, and not used", tuple(_weak(d.get("weak", [])))),
        Section("Errors", tuple(_errors(d))),
        Section("Asked about", tuple(_limit(entry) for entry in d.get("limits", []))),
        Section("To separate the causes", tuple(_experiment(d, saved))),
        Section("These logs cannot show", tuple(_untestable(d.get("untestable", [])))),
        Section("Notes", (held_out(d), *(_sentence(note) for note in d.get("notes", [])))),
    ]
    return [section for section in made if section.sentences]


def shared(d: TraceDocument) -> list[FindingEntry]:
    """Findings with one parameter over several channels."""
    return [f for f in d.get("findings", []) if len(f["channels"]) > 1]


def held_out(d: TraceDocument) -> str:
    """How error before and after was measured."""
    held = [run["id"] for run in d["runs"] if run.get("heldout")]
    if held:
        return f"Errors before and after are those of run {held[0]}, to which nothing was fitted."
    return (
        "Held out: folds of the one run. Errors before and after are within-run; that does not show transfer to another"
        " power-on."
    )


# ------------------------------------------------------------------------------------------------------- one finding


def _finding(f: FindingEntry, d: TraceDocument, *, names: bool = False) -> str:
    parts = [plain_names.named(f["label"], f["effect"])]
    if amount := _amount(f.get("params", [])):
        parts.append(amount)
    text = ", ".join(parts)
    if names:
        text = f"{' '.join(f['channels'])}: {text}"
    told = []
    of_one_run = f["effect"] in OF_ONE_RUN
    if (explained := f.get("share_of_excess")) is not None and f.get("confirmed") is not False and not of_one_run:
        told.append(f"explains {share(explained)}")
    if f.get("proposed_form"):
        told.append(f"form: {f['proposed_form']}")
    if f.get("confirmed") is False:
        told.append("NOT confirmed: the held-out run's error neither falls nor rises with it; not used")
    if any(p.get("plausible") is False for p in f.get("params", [])):
        told.append("implausibly large for this physics: read it as an empirical term")
    if any(p["name"] == "carried_over" for p in f.get("params", [])):
        told.append("several forms fit alike and their average joins the filter; the figures are the likeliest form's")
    if f.get("rivals"):
        told.append("or: " + ", ".join(_rival(r) for r in f["rivals"][:_FEW]) + _more(len(f["rivals"]) - _FEW))
    return _sentence("; ".join([text, *told]))


def _amount(params: list[ParameterEntry]) -> str:
    """What was fitted, with one standard deviation, and what fixes its shape; of many the largest."""
    fitted = [p for p in params if p.get("sd") is not None]
    # the label says the time of an event, and the number of terms
    shape = [p for p in params if p.get("sd") is None and p["name"] not in _IN_LABEL]
    if not fitted and not shape:
        return ""
    if len(fitted) > _FEW and len({p["unit"] for p in fitted}) == 1:
        largest = max(fitted, key=lambda p: abs(p["value"]))
        return f"up to {abs(largest['value']):.3g} {_unit(largest)} at {len(fitted)} points".replace("  ", " ")
    named = len(fitted) + len(shape) > 1
    told = [
        ", ".join((f"{_name(p)} " if named else "") + plus_minus(p["value"], p.get("sd"), _unit(p)) for p in some)
        for some in (fitted, shape)
    ]
    return ", ".join(text + (_ONE_SD if n == 0 else "") for n, text in enumerate(told) if text)


def _name(p: ParameterEntry) -> str:
    """A parameter in words."""
    return plain_names.parameter(p["name"])


def _unit(entry: ParameterEntry | ErrorEntry) -> str:
    """The unit of a pure number is not said."""
    unit = entry.get("unit") or ""
    return "" if unit == "1" else str(unit)


def _rival(r: RivalEntry) -> str:
    label = plain_names.named(str(r.get("label", plain_names.effect(r["effect"]))), r["effect"])
    if r.get("weight") is not None:
        return f"{label} (weight {share(r['weight'])})"
    return label if r.get("score_difference") is None else f"{label} (score {r['score_difference']:+.0f})"


def _more(count: int) -> str:
    return f" and {count} more" if count > 0 else ""


def _refuted(x: RefutedEntry) -> str:
    errors = f"{x['after_with']:.3g} {x['unit']} with all that was fitted, {x['after_without']:.3g} {x['unit']} without"
    return f"REFUTED by the held-out run, and not used: {plain_names.named(x['label'], x['effect'])}; error {errors}."


def _beside(d: TraceDocument, channel: str) -> list[str]:
    """What a channel has beside effects on its mean: lines, a noise level that changes, faults that were set aside."""
    lines = [f"{entry['hz']:.4g} Hz" for entry in d.get("lines", []) if channel in entry["channels"]]
    drivers = [plain_names.driver(e["driver"]) for e in d.get("noise_level", []) if channel in e["channels"]]
    kinds = [plain_names.effect(e["effect"]) for e in d.get("integrity", []) if channel in e["channels"]]
    said = []
    if lines:
        said.append(f"Line{'s' if len(lines) > 1 else ''} at {', '.join(lines)}.")
    if drivers:
        said.append(f"The noise changes with {', '.join(drivers)}.")
    if kinds:
        said.append(f"Faults of the data, set aside: {', '.join(kinds)}.")
    return said


def _drift(entry: DriftEntry, channel: str) -> str:
    level = f"{entry['level']:.3g} {entry['unit']}"
    if entry["kind"] == "random_walk":
        return f"Random walk, {level}; nothing logged explains it."
    tau = entry.get("tau_s")
    over = "" if tau is None else f", over {duration(tau)}"
    return f"Drift (Gauss-Markov), {level}{over}; nothing logged explains it."


def _remainder(d: TraceDocument, channel: str) -> list[str]:
    own = [e for e in d.get("remainder", []) if e["channel"] == channel]
    ratios = [(ratio, e["scale_s"]) for e in own if (ratio := e["ratio"]) is not None]
    if not ratios:
        return []
    worst, scale_s = max(ratios, key=lambda entry: abs(entry[0] - 1.0))
    return [f"Not traced: {worst:.1f} × the noise's variance at {scale_s:.3g} s."]


def _error(d: TraceDocument, channel: str) -> str:
    for e in d.get("error", []):
        if e["metric"] == "e10" and e.get("channel") == channel:
            unused = {"run": "on a run not used", "part": "on a part of the power-on that was not used"}
            where = unused.get(e.get("heldout", ""), "within the run")
            before, after = times_floor(e.get("before_x_floor")), times_floor(e.get("after_x_floor"))
            if before == after:
                return f"Error {before} × floor {where}."
            return f"Error {before} → {after} × floor {where}."
    return ""


# ------------------------------------------------------------------------------------------------------- the rest


def _common(d: TraceDocument) -> Iterable[str]:
    for number, entry in enumerate(d.get("common", []), 1):
        sizes = ", ".join(f"{s['channel']} {plus_minus(s['value'], s['sd'], s['unit'])}" for s in entry["sizes"])
        where = f" of run {entry['run']}" if entry.get("run") else ""
        when = f", {entry['t_start_s']:.0f} to {entry['t_end_s']:.0f} s{where}"
        yield (
            f"{' '.join(entry['channels'])}: {entry['label']}{when} ({sizes}, 1 sd; coherence {entry['coherence']:.2f})"
            f"; record {', '.join(entry['record'])}. Its course is {common_file(number)}, which --report DIR saves."
        )


def common_file(number: int) -> str:
    """Name of the file with the course of a common cause, 1 first."""
    return f"common_{number}.csv"


def _fault(entry: IntegrityEntry) -> str:
    where = entry.get("where")
    text = where if isinstance(where, str) else ", ".join(map(str, (where or [])[:_FEW]))
    n = entry.get("count")
    count = "" if not n else ", once" if n == 1 else f", {n} times"
    return _sentence(
        f"{' '.join(entry['channels'])}: {_plain(entry['effect'])}{count}" + (f" ({text})" if text else "")
    )


def _line(entry: LineEntry) -> str:
    width = f", {entry['width_hz']:.2g} Hz wide" if entry.get("width_hz") else ""
    text = f"{' '.join(entry['channels'])}: {entry['hz']:.4g} Hz{width}, {entry['rms']:.3g} {entry['unit']} rms"
    if entry.get("rivals"):
        text += "; or: " + ", ".join(_rival(r) for r in entry["rivals"][:_FEW])
    return _sentence(text)


def _noise(entry: NoiseLevelEntry) -> str:
    driver = plain_names.named(plain_names.driver(entry["driver"]), entry["driver"])
    text = f"{' '.join(entry['channels'])}: changes with {driver}"
    return _sentence(f"{text}, by up to {entry['ratio']:.2f} ×" if entry.get("ratio") is not None else text)


def _weak(entries: Sequence[WeakEntry]) -> Iterable[str]:
    """The best few of each channel, with size, why they are not used, and the size that would be."""
    of_channel: dict[tuple[str, ...], list[WeakEntry]] = {}
    for entry in entries:
        of_channel.setdefault(tuple(entry["channels"]), []).append(entry)
    for channels, own in of_channel.items():
        best = sorted(own, key=lambda entry: -entry["score"])
        for entry in best[:_FEW]:
            yield f"{' '.join(channels)}: {_one_weak(entry)}"
        if len(best) > _FEW:
            yield f"{' '.join(channels)}: {len(best) - _FEW} more, which --json lists."


def _one_weak(entry: WeakEntry) -> str:
    params = entry.get("params", [])
    amount = _amount(params)
    text = plain_names.named(entry.get("label") or plain_names.effect(entry["effect"]), entry["effect"])
    text += f", {amount}" if amount else ""
    text += f" (score {entry['score']:.0f})"
    if entry.get("why"):
        text += f": {entry['why']}"
    if entry.get("limit") is not None and params:
        text += f"; {entry['limit']:.2g} {_unit(params[0])}".rstrip() + " would be used"
    return _sentence(text)


def _limit(entry: LimitEntry) -> str:
    where = f"{' '.join(entry['channels'])}: " if entry["channels"] else ""
    return _sentence(f"{where}{_plain(entry['effect'])}: {entry['text']}")


def _errors(d: TraceDocument) -> Iterable[str]:
    """Before, after and floor of all but the headline error, a sentence a metric."""
    by_metric: dict[str, list[ErrorEntry]] = {}
    for e in d.get("error", []):
        if e["metric"] != "e10" and e.get("after") is not None:
            by_metric.setdefault(e["metric"], []).append(e)
    for metric, entries in by_metric.items():
        changed = [e for e in entries if _differs(e)]
        if not changed and len(entries) > 1:
            yield f"{_METRICS.get(metric, metric)}: unchanged."
            continue
        told = [_change(e) for e in changed or entries]
        yield f"{_METRICS.get(metric, metric)}: {'; '.join(told)}."


def _differs(e: ErrorEntry) -> bool:
    before, after = e.get("before"), e["after"]
    return before is None or after is None or abs(before - after) > 0.02 * max(abs(before), abs(after))


def _change(e: ErrorEntry) -> str:
    who = f"{e['channel']} " if e.get("channel") and e["channel"] != "all" else ""
    unit = f" {_unit(e)}" if _unit(e) else ""
    before = "–" if e.get("before") is None else f"{e['before']:.3g}"
    floor = f" (floor {e['floor']:.3g})" if e.get("floor") is not None else ""
    if not _differs(e):
        return f"{who}{e['after']:.3g}{unit}, unchanged{floor}"
    return f"{who}{before} → {e['after']:.3g}{unit}{floor}"


def _experiment(d: TraceDocument, saved: str) -> Iterable[str]:
    experiment = d.get("separating_experiment")
    if experiment:
        a, b = label_of(d, experiment["a"]), label_of(d, experiment["b"])
        words = experiment.get("motion") or f"a run of {duration(experiment['duration_s'])}"
        expected = float(experiment["d_expected"])
        if expected < SEPARATES:
            yield f"{_upper(a)}, or {b}? {_upper(words)}."
            return
        yield (
            f"{_upper(a)}, or {b}? What would tell them apart (d = {expected:.0f}, {SEPARATES:.0f} is enough):"
            f" {words}. {saved}"
        )


def label_of(d: TraceDocument, effect: str) -> str:
    """An effect of a result in words, with its code name."""
    for f in d.get("findings", []):
        if f["effect"] == effect:
            return plain_names.named(str(f["label"]), effect)
        for r in f.get("rivals", []):
            if r["effect"] == effect and "label" in r:
                return plain_names.named(str(r["label"]), effect)
    return _plain(effect)


def _untestable(entries: Iterable[UntestableEntry]) -> Iterable[str]:
    """Grouped by reason, each effect once."""
    groups: dict[tuple[str, str], dict[str, None]] = {}
    for entry in entries:
        other = str(entry.get("with") or "") if entry["reason"] == "collinear_with" else ""
        groups.setdefault((entry["reason"], other), {})[_plain(entry["effect"])] = None
    order = {reason: n for n, reason in enumerate(_REASONS)}
    for (reason, other), effects in sorted(
        groups.items(), key=lambda item: (order.get(item[0][0], len(order)), item[0])
    ):
        if reason == "collinear_with":
            yield f"{', '.join(effects)} apart from {_plain(other)}."
        else:
            yield f"{', '.join(effects)}: {_REASONS.get(reason, reason)}."


def _plain(effect: str) -> str:
    """An effect in words, with its code name."""
    return plain_names.named(plain_names.effect(effect), effect)


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


def _sentence(text: str) -> str:
    return text if text.endswith((".", "!", "?")) else text + "."

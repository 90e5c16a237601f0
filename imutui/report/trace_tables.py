"""What a trace found, as tables: what page, terminal and screen show, made once from the result document.

Everything that it names is in the instrument's own axes and sign.
"""

from collections.abc import Callable, Iterator, Sequence

from filters.channels import CHANNELS
from filters.effects import plain_names
from filters.tracing.sentence import OF_ONE_RUN
from filters.tracing.trace_document import ParameterEntry, RivalEntry, TraceDocument
from imutui.report import plain, trace_glance, wrapping
from imutui.report.blocks import Block, Column, Items, Paragraph, Section, Table
from imutui.report.numbers import NOTHING, duration, odds, plus_minus, readings, share, three_digits
from imutui.report.trace_glance import TERMINAL, Places

_IN_LABEL = ("order", "at", "run", "start", "switches", "frequency")  # parameters that the label of a finding says
_FEW = 3
_CERTAIN = 1000.0  # odds from which on they need not be told
_RULE = (
    '± is one standard deviation. "Fits better by" is what the likelihood gains (2 ln) less what the parameters and'
    " their choice cost. A cause joins above 9, beside drift too; of a channel that drifts, a step, or what channels"
    " share, needs more than 30. A slow effect joins where its odds over drift alone are 9:1. A cause leaves below 4.5,"
    " because others explain it."
)
_RULE_BY_HAND = (
    "± is one standard deviation. Scale factors, cross-axis terms and the gyros' sensitivity to specific force join as"
    " groups, where the gain of a group is above its price; each leaves where it fits better by less than 4.5. What"
    " goes beyond them (an accelerometer's square, cube, asymmetry) needs more than 9. The gyros' biases are always in."
)
_CARRIES_OVER = (
    "Each power-on was fitted by itself; what differs beyond the standard deviations of the fits is the power-on's. The"
    " value that joins the filter is the unit's, as wide as power-ons differ, and wider where they are few. A power-on"
    " that was held out counts here, and changes no value."
)
_NO_ERROR = (
    "None was measured: after the first minute, in which the bias is taken, or in folds of a shorter run, too little is"
    " left."
)
_ERRORS = (
    'The floor is what white noise alone gives; n is the number of windows. "Innovation / its sd" is the root mean'
    " square of what the filter did not foresee over the standard deviation that it stated, √(NIS/dof): 1 is right,"
    " above 1 the filter is too sure."
)
_AVERAGED = "Where forms are averaged, the figures are those of the likeliest one, and the average joins the filter."


def headline(d: TraceDocument, source: str) -> list[str]:
    """What was traced, and whose readings, how long."""
    runs = d["runs"]
    words = ", ".join(readings(kind) for kind in sorted({run["kind"] for run in runs}))
    rates = sorted({round(run["rate_hz"], 2) for run in runs})
    rate = f"{rates[0]:g}" if len(rates) == 1 else f"{rates[0]:g} to {rates[-1]:g}"
    references = ", ".join(sorted({run["reference"] for run in runs}))
    total = duration(sum(run["seconds"] for run in runs))
    size = f"{len(runs)} run{'s' if len(runs) > 1 else ''}, {total} at {rate} Hz, {words}"
    return [source, f"{size}, reference {references}"]


def text(
    d: TraceDocument, source: str, width: int, places: Places = TERMINAL, signs: Callable[[str], str] = str
) -> str:
    """All of it as lines of at most so many characters; `source` is which logs it is of.

    `signs` puts what a terminal can show in the place of what it cannot.
    """
    head = [line for said in headline(d, source) for line in wrapping.wrap(said, width)]
    return "\n".join([*head, "", plain.text(sections(d, places), width, signs)])


def sections(d: TraceDocument, places: Places) -> list[Section]:
    """All that is said of a trace: the answer at a glance, what to do, causes, errors, limits, notes."""
    shown = [
        Section("Channels", (trace_glance.glance(d), Paragraph(d["sentence"]))),
        Section("What to do", (trace_glance.to_do(d, places),)),
        Section("Causes, their parameters and rivals", tuple(_filled(_causes(d, places)))),
        Section("Weak, and not used", tuple(_filled(_weak(d)))),
        Section("Errors", tuple(_filled(_errors(d))) or (Paragraph(_NO_ERROR),)),
        Section("What carries over to the next power-on", tuple(_filled(_carries_over(d)))),
        Section("Asked about", tuple(_filled(_limits(d)))),
        Section("These logs cannot show", tuple(_filled(_untestable(d)))),
        Section("Notes", (Items((held_out(d), *map(_sentence, d["notes"]))),)),
    ]
    return [section for section in shown if section.blocks]


def _filled(table: Table) -> Iterator[Block]:
    if table.rows:
        yield table


def held_out(d: TraceDocument) -> str:
    """How error before and after was measured."""
    held = [run["id"] for run in d["runs"] if run["heldout"]]
    if held:
        return f"Errors before and after are those of run {held[0]}, to which nothing was fitted."
    return (
        "Held out: folds of the one run. Errors before and after are within-run; that does not show transfer to another"
        " power-on."
    )


# ---------------------------------------------------------------------------------------------------------- causes


Row = tuple[str, str, str]


def _causes(d: TraceDocument, places: Places) -> Table:
    """Everything that was found, by channel: a row each, under it its parameters and what would do in its place."""
    groups = [*_findings(d), *_refuted(d), *_common(d, places), *_beside(d), *_remainder(d)]
    order = {channel: n for n, channel in enumerate(CHANNELS)}
    groups.sort(key=lambda rows: order.get(rows[0][0].split(" ")[0], len(order)))
    averaged = any(p["name"] == "carried_over" for f in d["findings"] for p in f["params"])
    by_hand = all(run["reference"] == "turned" for run in d["runs"])
    caption = (_RULE_BY_HAND if by_hand else _RULE) + (f" {_AVERAGED}" if averaged else "")
    columns = (
        Column("Channel", "code"),
        Column("Cause, its parameters, or what else fits"),
        Column("Value ± sd, and how well it fits"),
    )
    return Table(columns, tuple(row for rows in groups for row in rows), caption)


def _findings(d: TraceDocument) -> Iterator[list[Row]]:
    for f in d["findings"]:
        told = [_fits(f["score"])]
        if f["odds"] < _CERTAIN:
            told.append(odds(f["odds"]))
        confirmed = f["confirmed"]
        if f["share_of_excess"] is not None and confirmed is not False and f["effect"] not in OF_ONE_RUN:
            told.append(f"explains {share(f['share_of_excess'])}")
        if confirmed is not None:
            told.append("confirmed" if confirmed else "NOT confirmed, not used")
        told += [f"form {f['proposed_form']}"] if f["proposed_form"] else []
        told += [f"of common cause {f['common'] + 1}"] if f["common"] is not None else []
        parameters = _parameters(f["params"])
        if len(parameters) == 1:
            told = [f"{parameters.pop()[2]}; {told[0]}", *told[1:]]
        rows = [(" ".join(f["channels"]), plain_names.named(f["label"], f["effect"]), ", ".join(told))]
        yield rows + parameters + _rivals(f["rivals"])


def _parameters(params: Sequence[ParameterEntry]) -> list[Row]:
    """Each with its standard deviation; of the points of a free curve the largest, of power-ons all."""
    points = [p for p in params if p["sd"] is not None]
    words = {p["name"].split(" ")[0] for p in points}
    curve = words == {"at"} or len(words) == len(points)
    if curve and len(points) > _FEW and len({p["unit"] for p in points}) == 1:
        largest = max(points, key=lambda p: abs(p["value"]))
        return [("", "", f"{_value(largest)} {largest['name']}, the largest of {len(points)} points")]
    shown = [p for p in params if p["sd"] is not None or p["name"] not in _IN_LABEL]
    return [("", plain_names.parameter(p["name"]), _value(p)) for p in shown]


def _value(p: ParameterEntry) -> str:
    if p["name"] == "weight":
        return share(p["value"])
    unit = "" if p["unit"] == "1" else p["unit"]
    odd = ", implausibly large for this physics" if not p["plausible"] else ""
    return plus_minus(p["value"], p["sd"], unit) + odd


def _rivals(rivals: Sequence[RivalEntry]) -> list[Row]:
    made = []
    for r in rivals:
        told = _fits(r["score_difference"]) if r["weight"] is None else f"weight {share(r['weight'])}"
        made.append(("", f"or: {plain_names.named(r['label'], r['effect'])}", told))
    return made


def _fits(score: float) -> str:
    """A score in words: how much better or worse the readings fit."""
    return f"fits {'worse' if score < 0 else 'better'} by {abs(score):.0f}"


def _refuted(d: TraceDocument) -> Iterator[list[Row]]:
    for x in d["refuted"]:
        errors = f"error {x['after_with']:.3g} {x['unit']} with all that was fitted, {x['after_without']:.3g} without"
        yield [(" ".join(x["channels"]), plain_names.named(x["label"], x["effect"]), f"REFUTED, not used: {errors}")]


def _common(d: TraceDocument, places: Places) -> Iterator[list[Row]]:
    for number, entry in enumerate(d["common"], 1):
        where = f" of run {entry['run']}" if entry["run"] else ""
        when = f"{entry['t_start_s']:.0f} to {entry['t_end_s']:.0f} s{where}"
        told = f"not in this log; coherence {entry['coherence']:.2f}; course in {common_file(number)}, {places.course}"
        yield [
            (" ".join(entry["channels"]), f"common cause {number}: {entry['label']}, {when}", told),
            *(("", f"on {s['channel']}", plus_minus(s["value"], s["sd"], s["unit"])) for s in entry["sizes"]),
        ]


def common_file(number: int) -> str:
    """Name of the file with the course of a common cause, 1 first."""
    return f"common_{number}.csv"


def _beside(d: TraceDocument) -> Iterator[list[Row]]:
    """Drift, lines, noise that changes, faults of the data."""
    for x in d["drift"]:
        over = f" over {duration(tau)}" if (tau := x["tau_s"]) else ""
        told = f"{x['level']:.3g} {x['unit']}{over}; nothing logged explains it"
        yield [(" ".join(x["channels"]), plain_names.short(x["kind"]), told)]
    for line in d["lines"]:
        width = f", {line['width_hz']:.2g} Hz wide" if line["width_hz"] else ""
        told = f"{line['rms']:.3g} {line['unit']} rms"
        yield [
            (" ".join(line["channels"]), f"line at {line['hz']:.4g} Hz{width}", told),
            *_rivals(line["rivals"]),
        ]
    for level in d["noise_level"]:
        driver = plain_names.named(plain_names.driver(level["driver"]), level["driver"])
        by = f"by up to {level['ratio']:.2f} ×" if level["ratio"] is not None else ""
        yield [(" ".join(level["channels"]), f"noise changes with {driver}", by)]
    for fault in d["integrity"]:
        count = "" if not (n := fault["count"]) else "once, " if n == 1 else f"{n} times, "
        where = f": {fault['where']}" if fault["where"] else ""
        yield [(" ".join(fault["channels"]), _plain(fault["effect"]), f"{count}set aside{where}")]


def _carries_over(d: TraceDocument) -> Table:
    """How each kind of effect differs between power-ons, and what the next one must measure again."""
    columns = (
        Column("Channels", "code"), Column("Effect"), Column("Differs, 1 sd"), Column("95 % interval"),
        Column("The next power-on"),
    )  # fmt: skip
    said: dict[bool | None, str] = {True: "must measure it again", False: "has the same"}
    rows = []
    for e in d["carries_over"]:
        sd, ends = e["session_sd"], e["session_ci95"]
        unit = "" if e["unit"] == "1" else f" {e['unit']}"
        differs = "not known" if sd is None else f"{sd:.2g}{unit}"
        interval = "" if ends is None else f"{ends[0]:.2g} to {ends[1]:.2g}{unit}"
        then = said.get(e["measure_again"], "can't be known of one" if sd is None else "not told by so few")
        rows.append((" ".join(e["channels"]), plain_names.short(e["effect"]), differs, interval, then))
    return Table(columns, tuple(rows), _CARRIES_OVER if rows else "")


def _remainder(d: TraceDocument) -> Iterator[list[Row]]:
    """Of each channel the scale on which most is left, or is missing."""
    for channel in CHANNELS:
        own = [(ratio, e["scale_s"]) for e in d["remainder"]
               if e["channel"] == channel and (ratio := e["ratio"]) is not None]  # fmt: skip
        if own:
            ratio, scale_s = max(own, key=lambda one: abs(one[0] - 1.0))
            yield [(channel, "not traced", f"{ratio:.2f} × the noise's variance at {scale_s:.3g} s")]


# ------------------------------------------------------------------------------------------------------- the rest


def _weak(d: TraceDocument) -> Table:
    rows = []
    for x in sorted(d["weak"], key=lambda x: (CHANNELS.index(x["channels"][0]), -x["score"])):
        parameters = _parameters(x["params"])
        sizes = [value if len(parameters) == 1 else f"{name} {value}" for _, name, value in parameters]
        known = "" if x["odds"] is None else f", {odds(x['odds'])}"
        told = [f"{_fits(x['score'])}{known}" + (f": {x['why']}" if x["why"] else "")]
        if x["limit"] is not None and x["params"]:
            unit = x["params"][0]["unit"].removeprefix("1")
            told.append(f"{x['limit']:.2g} {unit}".rstrip() + " would be used")
        label = plain_names.named(x["label"], x["effect"])
        rows.append((" ".join(x["channels"]), label, ", ".join(sizes) or NOTHING, "; ".join(told)))
    return Table(
        (Column("Channel", "code"), Column("Cause"), Column("Size ± sd"), Column("Why it is not used")), tuple(rows)
    )


def _errors(d: TraceDocument) -> Table:
    """Every figure of error: before, after with its interval, floor."""
    every = [e for e in d["error"] if e["after"] is not None]
    order = list(dict.fromkeys(e["metric"] for e in every))
    rows = tuple(
        (
            trace_glance.METRICS.get(e["metric"], e["metric"]),
            e["channel"] or "all",
            three_digits(e["before"]),
            three_digits(e["after"]),
            " to ".join(map(three_digits, e["ci95"])),
            three_digits(e["floor"]),
            "" if e["unit"] == "1" else e["unit"],
            str(e["n"]),
        )
        for e in sorted(every, key=lambda e: order.index(e["metric"]))
    )
    columns = (Column("Error of"), Column("Channel", "code"), *(Column(text, "number") for text in (
        "Before", "After", "95 % of it", "Floor")), Column("Unit"), Column("n", "number"))  # fmt: skip
    return Table(columns, rows, _ERRORS)


def _limits(d: TraceDocument) -> Table:
    rows = ((" ".join(x["channels"]), _plain(x["effect"]), x["text"]) for x in d["limits"])
    return Table((Column("Channel", "code"), Column("Effect"), Column("Smallest that would show")), tuple(rows))


def _untestable(d: TraceDocument) -> Table:
    """Grouped by reason, each effect once."""
    reasons = {"equals_bias": "would look like a constant bias", "no_excitation": "nothing here excites it"}
    groups: dict[str, dict[str, None]] = {reason: {} for reason in reasons.values()}
    for x in d["untestable"]:
        why = reasons.get(x["reason"], x["reason"])
        if x["reason"] == "collinear_with":
            why = f"looks like {plain_names.short(str(x['with']))}"
        groups.setdefault(why, {})[plain_names.short(x["effect"])] = None
    rows = tuple((", ".join(effects), why) for why, effects in groups.items() if effects)
    return Table((Column("Effects"), Column("Why")), rows)


def _plain(effect: str) -> str:
    return plain_names.named(plain_names.effect(effect), effect)


def _sentence(text: str) -> str:
    return text if text.endswith((".", "!", "?")) else text + "."

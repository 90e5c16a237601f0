"""A trace as an article: unit and files, verdict, what to do, error before and after, figures, detail, method."""

from collections.abc import Iterator, Sequence

from filters.tracing.trace_document import ErrorEntry, TraceDocument
from imutui.jobs.page_data import LogData
from imutui.report import advice, data_quality, filter_figures, how_to_apply, identity, sentences, trace_figures
from imutui.report.blocks import (
    Article,
    Block,
    Code,
    Column,
    Facts,
    Figure,
    Items,
    Paragraph,
    Section,
    Subheading,
    Table,
)
from imutui.report.numbers import three_digits

EXPERIMENT = "experiment.toml"
_SAVED = f"Its profile is `{EXPERIMENT}`; its text stands at the end of this page."
_OTHER_METRICS = {
    "nis": "√(NIS/dof)",
    "drift_10s": "free drift over 10 s",
    "drift_60s": "free drift over 60 s",
    "bias_prediction": "bias predicted 60 s ahead",
    "coverage": "truth inside the 3 σ band",
    "gravity_norm": "magnitude of gravity",
    "gravity_direction": "direction of gravity",
}
_HELD_OUT = {
    "run": "on a run that nothing was fitted to",
    "part": "on a part of the power-on that nothing was fitted to",
    "folds": "within the runs that were fitted, by folds",
}
_RULE = (
    "A cause joins where its score, beside drift too, is above 9; of a channel that drifts, a step, or what channels"
    " share, needs more than 30. It is taken out again where its score falls below 4.5, because others explain it."
)
_RULE_BY_HAND = (
    "Scale factors, cross-axis terms and the gyros' sensitivity to specific force join as groups, where the gain of a"
    " group is above its price; each is taken out again where its own score is below 4.5. What goes beyond them (an"
    " accelerometer's square, cube, asymmetry) needs more than 9. The gyros' biases are always in."
)
_DASH = "–"
NO_DATA = LogData()


def article(d: TraceDocument, log: LogData = NO_DATA) -> Article:
    """All that is said of a trace.

    `d`: the result; fields that came later may lack.
    `log`: what its logs add.
    """
    logs = [identity.of_run(run) for run in d["runs"]]
    kind = identity.kind_of(logs)
    made = [
        identity.section(logs, str(d.get("library", ""))),
        Section("Verdict", tuple(_verdict(d))),
        Section("What to do", (Items(tuple(advice.after_trace(d)), numbered=True),)),
        Section("Error before and after", tuple(_errors(d))),
        Section("Figures", tuple(_figures(d, log))),
        Section("What was found, in detail", tuple(_detail(d))),
        how_to_apply.of_trace(d, log),
        data_quality.of_trace(d, log),
        Section("Method and provenance", tuple(_method(d))),
    ]
    title = d.get("source") or "trace of " + ", ".join(run["id"] for run in d["runs"])
    sections = tuple(section for section in made if section.blocks)
    return Article(title[:1].upper() + title[1:], kind, identity.ORIGINS[kind], sections)


def _verdict(d: TraceDocument) -> Iterator[Block]:
    if sentence := d.get("sentence"):
        yield Paragraph(sentence)
    yield from (Paragraph(f"Damaged: {sentence}") for sentence in d.get("damage", []))
    rows = tuple(
        (line.channel, line.status, " ".join(map(sentences.start, line.sentences)) or _DASH)
        for line in sentences.channel_lines(d)
    )
    yield Table((Column("Channel", "code"), Column("Status"), Column("What was found")), rows)


def _errors(d: TraceDocument) -> Iterator[Block]:
    every = [e for e in d.get("error", []) if e.get("after") is not None]
    main = [e for e in every if e["metric"] == "e10"]
    if not every:
        yield Paragraph(
            "No error was measured: after the first minute, in which the bias is taken, too little is left."
        )
        return
    yield Paragraph(sentences.held_out(d))
    if main:
        yield _main_table(main)
        if figure := trace_figures.error_figure(d):
            yield figure
    elif _by_hand(d):
        yield _other_table(every, "Errors of the unit's rests and of its turns between them.")


def _main_table(errors: Sequence[ErrorEntry]) -> Table:
    columns = ("Channel", "Unit", "Before (95 %)", "After (95 %)", "Floor (95 % of clean units)", "Before / floor",
               "After / floor", "Windows")  # fmt: skip
    rows = tuple(
        (
            e["channel"] or _DASH,
            e["unit"],
            _interval(e["before"], e.get("before_ci95")),
            _interval(e["after"], e.get("ci95")),
            _interval(e["floor"], e.get("floor_band95")),
            _ratio(e.get("before_x_floor")),
            _ratio(e.get("after_x_floor")),
            str(e["n"]),
        )
        for e in errors
    )
    where = ", ".join(dict.fromkeys(_HELD_OUT.get(e["heldout"], e["heldout"]) for e in errors))
    return Table(
        tuple(Column(text, {"Channel": "code", "Unit": "text"}.get(text, "number")) for text in columns),
        rows,
        f"Error of 10 s means after the bias was taken over 60 s, {where}. The floor is what white noise alone gives.",
    )


def _other_table(errors: Sequence[ErrorEntry], caption: str = "Other figures of error.") -> Table:
    columns = (Column("Figure"), Column("Channel", "code"), Column("Unit"), Column("Before (95 %)", "number"),
               Column("After (95 %)", "number"), Column("Floor", "number"))  # fmt: skip
    order = list(dict.fromkeys(e["metric"] for e in errors))
    rows = tuple(
        (
            _OTHER_METRICS.get(e["metric"], e["metric"]),
            e["channel"] or "all",
            "" if e["unit"] == "1" else e["unit"],
            _interval(e["before"], e.get("before_ci95")),
            _interval(e["after"], e.get("ci95")),
            _interval(e["floor"], None),
        )
        for e in sorted(errors, key=lambda e: order.index(e["metric"]))
    )
    return Table(columns, rows, caption)


def _interval(value: float | None, interval: Sequence[float | None] | None) -> str:
    """A value, and below it its interval."""
    if value is None:
        return _DASH
    low, high = interval or (None, None)
    between = "" if low is None or high is None else f"\n({three_digits(low)} to {three_digits(high)})"
    return three_digits(value) + between


def _ratio(value: float | None) -> str:
    return _DASH if value is None else three_digits(value)


def _figures(d: TraceDocument, log: LogData) -> Iterator[Figure | Paragraph]:
    yield from trace_figures.of_drivers(log.driver_curves)
    yield from trace_figures.figures(d)
    for n, course in enumerate(log.courses, 1):
        yield filter_figures.biases(course, d["runs"][-1]["rate_hz"], f"convergence-{n}")
    if found := filter_figures.nis(log.courses, "nis"):
        yield found
    yield from (Paragraph(sentence) for sentence in log.missing)
    if _by_hand(d):
        yield Paragraph(
            "There is no residual over time: of a unit that was turned by hand the motion between rests is not known."
            " The errors above are those of its rests and turns."
        )
    elif not d.get("curves"):
        yield Paragraph(
            "This result has no curves of the residual: it was made by an older imutui. `imutui trace` with the same"
            " logs makes them."
        )


def _by_hand(d: TraceDocument) -> bool:
    return all(run.get("reference") == "turned" for run in d["runs"])


def _detail(d: TraceDocument) -> Iterator[Block]:
    for section in sentences.sections(d, _SAVED):
        if section.title in ("Errors", "Notes"):  # the table above, the method below
            continue
        yield Subheading(section.title)
        yield Items(section.sentences)
    if d.get("findings"):
        yield _causes(d)
    others = [e for e in d.get("error", []) if e["metric"] != "e10" and e.get("after") is not None]
    if others and not _by_hand(d):  # above, where they are all that there is
        yield _other_table(others)


def _causes(d: TraceDocument) -> Table:
    """What was found, with what else would do: the score of each."""
    rows: list[tuple[str, str, str]] = []
    for f in d["findings"]:
        rows.append((" ".join(f["channels"]), f["label"], f"{f['score']:.0f}"))
        rows += [
            ("", "or: " + r.get("label", r["effect"]), f"{f['score'] + r['score_difference']:.0f}")
            for r in f.get("rivals", [])
        ]
    columns = (Column("Channel", "code"), Column("Cause"), Column("Score", "number"))
    return Table(
        columns,
        tuple(rows),
        f"Causes that were weighed, with their scores in the final model. {_RULE_BY_HAND if _by_hand(d) else _RULE}",
    )


def _method(d: TraceDocument) -> Iterator[Block]:
    yield Paragraph(
        "Each log was compared with what a perfect unit would read under its reference. Of what is left, physical"
        " effects were fitted and chosen one after the other on evidence that the fit had not seen; then the error was"
        " measured without them (before) and with all of them (after). Intervals are of 95 %; ± is one standard"
        " deviation. All values are in the unit's own axes and sign: corrected reading = reading − effect."
    )
    runs = d["runs"]
    references = ", ".join(sorted({run["reference"] for run in runs if "reference" in run})) or identity.NOT_STATED
    signs = ", ".join(sorted({f"{run['accel_sign']:+d}" for run in runs if "accel_sign" in run}))
    mounts = ", ".join(sorted({run["mount"] for run in runs if "mount" in run}))
    rows = (
        ("Reference", references),
        ("Accelerometer sign", signs or identity.NOT_STATED),
        ("Mounting (table x, y, z)", mounts or identity.NOT_STATED),
        ("Seed of everything random", str(d.get("seed", identity.NOT_STATED))),
        ("Result document", f"version {d.get('version', identity.NOT_STATED)}, beside this page as `result.json`"),
    )
    yield Facts(rows)
    if notes := d.get("notes"):
        yield Subheading("Notes")
        yield Items(tuple(notes))
    experiment = d.get("separating_experiment")
    if experiment and experiment.get("profile"):
        yield Subheading(f"`{EXPERIMENT}`, the motion that would tell the causes apart")
        yield Code(experiment["profile"])

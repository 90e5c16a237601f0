"""Results of one kind beside each other: unit against unit, day against day, before and after.

Differences are to the first result; their standard deviation is that of independent estimates,
and none where they are of the same readings.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from filters.channels import CHANNELS
from filters.tracing.trace_document import TraceDocument
from imutui.estimates import biases
from imutui.jobs.page_data import LogData
from imutui.report import comparison_figures, identity
from imutui.report.blocks import Article, Block, Column, Paragraph, Section, Table
from imutui.report.comparison_figures import Compared, Estimate, difference
from imutui.report.identity import NOT_STATED, LogFacts
from imutui.report.numbers import NOTHING, ORIGIN, plus_minus, three_digits
from imutui.report.trace_glance import METRICS, status_words
from imutui.verdict import sources

if TYPE_CHECKING:
    from imutui.jobs.documents import ResultDocument
    from imutui.jobs.result_files import Result


def article(results: "Sequence[Result]", logs: Sequence[LogData]) -> Article | None:
    """What is said of results beside each other; None where no two are of one kind."""
    sections: list[Section] = []
    facts: list[LogFacts] = []
    every = [
        (result, _of(result), log, letter(n)) for n, (result, log) in enumerate(zip(results, logs, strict=True), 1)
    ]
    for is_trace in (False, True):
        own = [one for one in every if ("findings" in one[0]) is is_trace and (is_trace or "final" in one[0])]
        if len(own) > 1:
            names = [Compared(name, *_told(of), log) for _, of, log, name in own]
            documents: Any = [result for result, *_ in own]
            sections += (_traces if is_trace else _replays)(documents, names)
            facts += [of for _, every_log, *_ in own for of in every_log]
    if not sections:
        return None
    kind = identity.kind_of(facts)
    origin = identity.ORIGINS[kind]
    if len({of.kind for of in facts}) > 1:
        origin = "Results of different origin are compared here, not all of them of a real unit: each is marked."
    return Article("Comparison", kind, origin, tuple(sections))


def _of(result: Any) -> list[LogFacts]:
    """Facts of the logs of a trace, or of that of a replay."""
    return [identity.of_run(run) for run in result["runs"]] if "findings" in result else [identity.of_result(result)]


def letter(number: int) -> str:
    """A to Z, then by number, as results are numbered on the page."""
    return chr(ord("A") + number - 1) if number <= 26 else f"no. {number}"


def _told(logs: Sequence[LogFacts]) -> tuple[str, str, str, str]:
    """Unit, date, files and origin of a result."""
    units = dict.fromkeys(_unit(log) for log in logs)
    dates = sorted(identity.minute(log.start_utc) for log in logs if log.start_utc)
    files = ", ".join(PurePath(log.log).name for log in logs) or NOT_STATED
    kind = ORIGIN[identity.kind_of(logs)]
    return ", ".join(units), " to ".join(dict.fromkeys([*dates[:1], *dates[-1:]])) or NOT_STATED, files, kind


def _unit(log: LogFacts) -> str:
    said = log.identity
    if said is None or not (said["instrument"] or said["serial_number"]):
        return NOT_STATED
    return f"{said['instrument']} {said['serial_number']}".strip()


def _who(names: Sequence[Compared], more: Sequence[tuple[str, ...]], headings: tuple[str, ...]) -> Table:
    columns = (Column("Result", "code"), Column("Unit"), Column("Begins (UTC)"), Column("File", "file"),
               Column("Readings"), *map(Column, headings))  # fmt: skip
    rows = tuple((c.letter, c.unit, c.date, c.files, c.origin, *own) for c, own in zip(names, more, strict=True))
    return Table(columns, rows, f"Differences are to {names[0].letter}.")


def _replays(documents: "Sequence[ResultDocument]", names: Sequence[Compared]) -> Iterator[Section]:
    more = [
        # how many states of effects the filter had, and whether effects were taken out of the log before
        (
            d["filter"],
            d["reference"],
            str(len(d["effects"])) + ("; taken out of the log" if c.log.corrected_from else ""),
            sources.of_document(d).word,
        )
        for d, c in zip(documents, names, strict=True)
    ]
    blocks: list[Block] = [_who(names, more, ("Filter", "Reference", "States of effects", "Verdict"))]
    blocks += map(Paragraph, _kinship(documents, names))
    bad = [c.letter for c, d in zip(names, documents, strict=True) if not sources.of_document(d).passes]
    if bad:
        blocks.append(Paragraph(f"Not to be relied on as they are: {', '.join(bad)}. Their verdicts say why."))
    yield Section("What is compared", tuple(blocks))
    related = [
        _readings(d, name) == _readings(documents[0], names[0]) for d, name in zip(documents, names, strict=True)
    ]
    yield Section(
        "Biases beside each other",
        (_bias_table(documents, names, related), *comparison_figures.of_replays(documents, names, related)),
    )
    yield Section("Noise beside each other", (_noise_table(documents, names),))
    yield Section("Runs beside each other", (_run_table(documents, names),))


def _run_table(documents: "Sequence[ResultDocument]", names: Sequence[Compared]) -> Table:
    headings = ("Samples", "Seconds", "Lost", "Gaps", "Outliers", "Alarms", "Converged, s")
    rows = []
    for d, name in zip(documents, names, strict=True):
        since = [bias.converged_s for bias in biases(d) if bias.converged_s is not None]
        counts = (d["lost_packets"], len(d["gaps"]), d["rejected"], len(d["alarms"]))
        seconds = f"{d['duration_s']:.1f}"
        last = f"{max(since):.1f}" if since else NOTHING
        rows.append((name.mark, str(d["samples"]), seconds, *map(str, counts), last))
    columns = (Column("Result", "code"), *(Column(heading, "number") for heading in headings))
    return Table(columns, tuple(rows), "Lost: packets. Converged: when the last of the biases that converged did.")


def _readings(d: "ResultDocument", name: Compared) -> str:
    """What tells readings: the hash of the log as it was recorded."""
    return name.log.corrected_from or d["log_sha256"] or name.letter


def _kinship(documents: "Sequence[ResultDocument]", names: Sequence[Compared]) -> Iterator[str]:
    """What results have in common."""
    seen: list[tuple[ResultDocument, Compared]] = []
    related = False
    for d, name in zip(documents, names, strict=True):
        if twin := next((c.letter for other, c in seen if other == d), None):
            yield f"{name.letter} is the same result as {twin}, given twice."
        elif name.log.corrected_from:
            every = zip(documents, names, strict=True)
            of = next((c.letter for other, c in every if other["log_sha256"] == name.log.corrected_from), None)
            yield f"{name.letter} is of {f'the log of {of}' if of else 'a log'} from which effects were taken out."
        related |= any(_readings(d, name) == _readings(other, c) for other, c in seen)
        seen.append((d, name))
    if related:
        yield (
            "Some are of the same readings. Their errors are not independent, so that no standard deviation stands at"
            " such a difference."
        )


def _bias_table(documents: "Sequence[ResultDocument]", names: Sequence[Compared], related: Sequence[bool]) -> Table:
    rows: list[tuple[str, ...]] = []
    for same in zip(*map(biases, documents), strict=True):
        estimates = [(bias.value, bias.sd) for bias in same]
        rows += _beside(same[0].channel, estimates, same[0].unit, names, related, "not observable")
    caption = "In each unit's own axes and sign. A difference of more than three of its sd is hardly chance."
    return Table(_columns(Column("Channel", "code"), "Bias", names), tuple(rows), caption)


def _columns(first: Column, value: str, names: Sequence[Compared]) -> tuple[Column, ...]:
    return (first, Column("Result", "code"), Column(f"{value} ± sd", "number"),
            Column(f"Minus {names[0].letter} ± sd", "number"), Column("In sd", "number"))  # fmt: skip


def _beside(
    what: str, estimates: Sequence[Estimate], unit: str, names: Sequence[Compared], related: Sequence[bool], lacks: str
) -> Iterator[tuple[str, ...]]:
    """A row a result: its value, and its difference to that of the first."""
    for k, ((value, sd), name) in enumerate(zip(estimates, names, strict=True)):
        minus, minus_sd = difference(estimates[0], (value, sd), related=related[k]) if k else (None, None)
        yield (
            what,
            name.mark,
            lacks if value is None else plus_minus(value, sd, unit),
            NOTHING if minus is None else plus_minus(minus, minus_sd, unit),
            NOTHING if minus is None or not minus_sd else f"{round(minus / minus_sd, 1) + 0.0:+.1f}",
        )


def _noise_table(documents: "Sequence[ResultDocument]", names: Sequence[Compared]) -> Table:
    columns = (Column("Result", "code"), Column("Gyros x y z, deg/√h", "number"),
               Column("Accelerometers x y z, m/s/√h", "number"),
               Column("NIS / degrees of freedom", "number"))  # fmt: skip
    rows = []
    for d, name in zip(documents, names, strict=True):
        nis, noise = d["nis"], d["noise"]
        ratio = nis["mean"] / nis["dof"] if nis["mean"] is not None and nis["dof"] else None
        triples = (noise["gyro_arw_deg_sqrt_h"], noise["accel_vrw_mps_sqrt_h"])
        rows.append((name.mark, *(" ".join(map(three_digits, triple)) for triple in triples), three_digits(ratio)))
    return Table(columns, tuple(rows), f"White noise measured on each log. {_specified(documents, names)}")


def _specified(documents: "Sequence[ResultDocument]", names: Sequence[Compared]) -> str:
    """The specification's noise; of each result by itself where they differ."""
    told: dict[str, list[str]] = {}
    for d, name in zip(documents, names, strict=True):
        limits = d["noise"]["specification"]
        gyro, accel = (
            next((f"{value:.3g} {unit}" for value in triple if value is not None), NOT_STATED)
            for triple, unit in ((limits["gyro_arw_deg_sqrt_h"], "deg/√h"), (limits["accel_vrw_mps_sqrt_h"], "m/s/√h"))
        )
        told.setdefault(f"{gyro} and {accel}", []).append(name.letter)
    if [*told] == [f"{NOT_STATED} and {NOT_STATED}"]:
        return "No data sheet of these units is known."
    if len(told) == 1:
        return f"The specification has {next(iter(told))}."
    each = "; ".join(f"{what} ({', '.join(own)})" for what, own in told.items())
    return f"The specifications have {each}."


def _traces(documents: Sequence[TraceDocument], names: Sequence[Compared]) -> Iterator[Section]:
    more = [(d["sentence"] or NOTHING,) for d in documents]
    told = [
        f"{b.letter} is the same result as {a.letter}, given twice."
        if d == e
        else f"{a.letter} and {b.letter} have readings in common: no standard deviation stands at their differences."
        for (d, a), (e, b) in combinations(zip(documents, names, strict=True), 2)
        if {run["log_sha256"] for run in d["runs"]} & {run["log_sha256"] for run in e["runs"]}
    ]
    yield Section("Traces that are compared", (_who(names, more, ("What was found",)), *map(Paragraph, told)))
    yield Section(
        "Errors beside each other", (_error_table(documents, names), *comparison_figures.of_traces(documents, names))
    )
    table = _parameter_table(documents, names)
    if table.rows:
        yield Section("Effects beside each other", (table,))


def _error_table(documents: Sequence[TraceDocument], names: Sequence[Compared]) -> Table:
    columns = (Column("Of"), Column("Result", "code"), Column("Status"), Column("Before", "number"),
               Column("After", "number"), Column("After / floor", "number"))  # fmt: skip
    rows = []
    metrics = {e["metric"] for d in documents for e in d["error"]}
    # gravity where units were turned by hand
    of: list[tuple[str, str | None]] = [*(("e10", channel) for channel in CHANNELS)]
    of += [(metric, None) for metric in ("gravity_norm", "gravity_direction") if metric in metrics]
    for metric, channel in of:
        for d, name in zip(documents, names, strict=True):
            error = next((e for e in d["error"] if e["metric"] == metric and e["channel"] == channel), None)
            status = NOTHING if channel is None else status_words(d["status"].get(channel, NOTHING))
            figures = (NOTHING, NOTHING, NOTHING) if error is None else (
                _with_interval(error["before"], error["before_ci95"], error["unit"]),
                _with_interval(error["after"], error["ci95"], error["unit"]),
                three_digits(error["after_x_floor"]),
            )  # fmt: skip
            rows.append((channel or METRICS[metric], name.mark, status, *figures))
    caption = "Error of 10 s means after the bias was taken over 60 s, with 95 % intervals."
    return Table(columns, tuple(rows), caption)


def _with_interval(value: float | None, interval: Sequence[float], unit: str) -> str:
    if value is None:
        return NOTHING
    return f"{three_digits(value)} ({' to '.join(map(three_digits, interval))}) {unit}"


def _parameter_table(documents: Sequence[TraceDocument], names: Sequence[Compared]) -> Table:
    """Parameters of what was found, of each effect that any of the traces has on a channel."""
    found: list[dict[tuple[str, str, str], Estimate]] = [
        {(f"{' '.join(f['channels'])}: {f['label']}", p["name"], p["unit"]): (p["value"], p["sd"])
         for f in d["findings"] for p in f["params"]}
        for d in documents
    ]  # fmt: skip
    logs = [{run["log_sha256"] for run in d["runs"]} for d in documents]
    related = [not logs[0].isdisjoint(own) for own in logs]
    rows: list[tuple[str, ...]] = []
    for key in dict.fromkeys(key for own in found for key in own):
        effect, parameter, unit = key
        estimates = [own.get(key, (None, None)) for own in found]
        rows += _beside(f"{effect}, {parameter}", estimates, unit, names, related, "not found")
    return Table(_columns(Column("Effect"), "Value", names), tuple(rows))

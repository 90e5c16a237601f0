"""Results of one kind beside each other: unit against unit, day against day, before and after.

Differences are to the first result; their standard deviation is that of independent estimates,
and none where they are of the same readings.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import PurePath
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias, cast

from filters.channels import CHANNELS
from filters.tracing.trace_document import TraceDocument
from imutui.jobs.page_data import LogData
from imutui.report import comparison_figures, identity
from imutui.report.blocks import Article, Block, Column, Paragraph, Section, Table
from imutui.report.comparison_figures import Compared
from imutui.report.identity import NOT_STATED, LogFacts
from imutui.report.numbers import ORIGIN, plus_minus, three_digits
from imutui.verdict import sources

if TYPE_CHECKING:
    from imutui.jobs.documents import ResultDocument

_DASH = "–"


class _Bias(NamedTuple):
    """Three biases: fields of the document, unit."""

    channels: tuple[str, ...]
    key: Literal["gyro_bias_dps", "accel_bias_mg"]
    unit: str


_BIASES = (_Bias(CHANNELS[:3], "gyro_bias_dps", "deg/s"), _Bias(CHANNELS[3:], "accel_bias_mg", "mg"))
Result: TypeAlias = "TraceDocument | ResultDocument"


@dataclass(frozen=True, slots=True)
class Difference:
    """A value minus that of the first result; None where either is not known."""

    # value, sd: difference and its standard deviation
    value: float | None
    sd: float | None

    @property
    def in_sd(self) -> float | None:
        """How many of its standard deviations it is."""
        return None if self.value is None or not self.sd else self.value / self.sd


def difference(a: float | None, a_sd: float | None, b: float | None, b_sd: float | None) -> Difference:
    """B minus a, and the standard deviation of that for independent estimates."""
    if a is None or b is None:
        return Difference(None, None)
    return Difference(b - a, None if a_sd is None or b_sd is None else math.hypot(a_sd, b_sd))


def article(results: Sequence[Result], logs: Sequence[LogData]) -> Article | None:
    """What is said of results beside each other; None where no two are of one kind.

    `results`: all of a page.
    `logs`: what their logs add, in the same order.
    """
    replays = [(n, r, log) for n, (r, log) in enumerate(zip(results, logs, strict=True), 1)
               if "findings" not in r and "final" in r]  # fmt: skip
    traces = [(n, r, log) for n, (r, log) in enumerate(zip(results, logs, strict=True), 1) if "findings" in r]
    sections: list[Section] = []
    facts: list[LogFacts] = []
    if len(replays) > 1:
        of_replays = [identity.of_result(d) for _, d, _ in replays]
        names = [Compared(letter(n), *_told([of]), log) for (n, _, log), of in zip(replays, of_replays, strict=True)]
        sections += _replays([d for _, d, _ in replays], names)
        facts += of_replays
    if len(traces) > 1:
        documents = [cast("TraceDocument", d) for _, d, _ in traces]
        of_traces = [[identity.of_run(run) for run in d["runs"]] for d in documents]
        names = [Compared(letter(n), *_told(own), log) for (n, _, log), own in zip(traces, of_traces, strict=True)]
        sections += _traces(documents, names)
        facts += [of for own in of_traces for of in own]
    if not sections:
        return None
    kind = identity.kind_of(facts)
    origin = identity.ORIGINS[kind]
    if len({of.kind for of in facts}) > 1:
        origin = "Results of different origin are compared here, not all of them of a real unit: each is marked."
    return Article("Comparison", kind, origin, tuple(sections))


def letter(number: int) -> str:
    """A to Z, then by number, as results are numbered on the page."""
    return chr(ord("A") + number - 1) if number <= 26 else f"no. {number}"


def _told(logs: Sequence[LogFacts]) -> tuple[str, str, str, str]:
    """Unit, date, files and origin of a result."""
    units = dict.fromkeys(_unit(log) for log in logs)
    dates = sorted({log.start_utc[:16].replace("T", " ") for log in logs if log.start_utc})
    files = ", ".join(PurePath(log.log).name for log in logs) or NOT_STATED
    kind = ORIGIN[identity.kind_of(logs)]
    return ", ".join(units), " to ".join(dict.fromkeys([*dates[:1], *dates[-1:]])) or NOT_STATED, files, kind


def _unit(log: LogFacts) -> str:
    said = log.identity
    if said is None or (said["instrument"] in ("", "unknown") and not said["serial_number"]):
        return NOT_STATED
    return f"{said['instrument']} {said['serial_number']}".strip()


def _who(names: Sequence[Compared], more: Sequence[tuple[str, ...]], headings: tuple[str, ...]) -> Table:
    columns = (Column("Result", "code"), Column("Unit"), Column("Begins (UTC)"), Column("File", "file"),
               Column("Readings"), *map(Column, headings))  # fmt: skip
    rows = tuple((c.letter, c.unit, c.date, c.files, c.origin, *own) for c, own in zip(names, more, strict=True))
    return Table(columns, rows, f"Differences are to {names[0].letter}.")


def _replays(documents: "Sequence[ResultDocument]", names: Sequence[Compared]) -> Iterator[Section]:
    more = [
        (d["filter"], d["reference"], _effects(d, c), sources.of_document(d).word)
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


def _effects(d: "ResultDocument", name: Compared) -> str:
    """How many states the filter had, and whether effects were taken out of the log before."""
    return str(len(d["effects"])) + ("; taken out of the log" if name.log.corrected_from else "")


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
    columns = (Column("Channel", "code"), Column("Result", "code"), Column("Bias ± sd", "number"),
               Column(f"Minus {names[0].letter} ± sd", "number"), Column("In sd", "number"))  # fmt: skip
    rows = []
    for kind in _BIASES:
        for i, channel in enumerate(kind.channels):
            first = documents[0]["final"][kind.key][i], documents[0]["sd"][kind.key][i]
            for k, (d, name) in enumerate(zip(documents, names, strict=True)):
                value, sd = d["final"][kind.key][i], d["sd"][kind.key][i]
                made = difference(first[0], None if related[k] else first[1], value, sd)
                rows.append(
                    (
                        channel,
                        f"{name.letter} {name.mark}".strip(),
                        "not observable" if value is None else plus_minus(value, sd, kind.unit),
                        *(_cells(made, kind.unit) if k else (_DASH, _DASH)),
                    )
                )
    caption = "In each unit's own axes and sign. A difference of more than three of its sd is hardly chance."
    return Table(columns, tuple(rows), caption)


def _cells(made: Difference, unit: str) -> tuple[str, str]:
    if made.value is None:
        return _DASH, _DASH
    return plus_minus(made.value, made.sd, unit), _DASH if made.in_sd is None else f"{round(made.in_sd, 1) + 0.0:+.1f}"


def _noise_table(documents: "Sequence[ResultDocument]", names: Sequence[Compared]) -> Table:
    columns = (Column("Result", "code"), Column("Gyros x y z, deg/√h", "number"),
               Column("Accelerometers x y z, m/s/√h", "number"),
               Column("NIS / degrees of freedom", "number"))  # fmt: skip
    rows = []
    for d, name in zip(documents, names, strict=True):
        nis = d["nis"]
        ratio = _DASH if nis["mean"] is None or not nis["dof"] else three_digits(nis["mean"] / nis["dof"])
        noise = d["noise"]
        triples = (noise["gyro_arw_deg_sqrt_h"], noise["accel_vrw_mps_sqrt_h"])
        rows.append(
            (f"{name.letter} {name.mark}".strip(), *(" ".join(map(_or_dash, triple)) for triple in triples), ratio)
        )
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
    if len(told) == 1:
        return f"The specification has {next(iter(told))}."
    each = "; ".join(f"{what} ({', '.join(own)})" for what, own in told.items())
    return f"The specifications have {each}."


def _or_dash(value: float | None) -> str:
    return _DASH if value is None else three_digits(value)


def _traces(documents: Sequence[TraceDocument], names: Sequence[Compared]) -> Iterator[Section]:
    more = [(d.get("sentence") or _DASH,) for d in documents]
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
    for metric, channel, label in _error_rows(documents):
        for d, name in zip(documents, names, strict=True):
            error = next((e for e in d["error"] if e["metric"] == metric and e["channel"] == channel), None)
            status = _DASH if channel is None else str(d["status"].get(channel, _DASH)).replace("_", " ")
            mark = f"{name.letter} {name.mark}".strip()
            if error is None:
                rows.append((label, mark, status, _DASH, _DASH, _DASH))
                continue
            before, after = (
                _with_interval(value, interval, error["unit"])
                for value, interval in ((error["before"], error["before_ci95"]), (error["after"], error["ci95"]))
            )
            rows.append((label, mark, status, before, after, _or_dash(error["after_x_floor"])))
    caption = "Error of 10 s means after the bias was taken over 60 s, with 95 % intervals."
    return Table(columns, tuple(rows), caption)


def _error_rows(documents: Sequence[TraceDocument]) -> list[tuple[str, str | None, str]]:
    """Metric, channel and heading: every channel, and gravity where units were turned by hand."""
    metrics = {e["metric"] for d in documents for e in d["error"]}
    gravity = (("gravity_norm", "magnitude of gravity"), ("gravity_direction", "direction of gravity"))
    return [
        *(("e10", channel, channel) for channel in CHANNELS),
        *((metric, None, label) for metric, label in gravity if metric in metrics),
    ]


def _with_interval(value: float | None, interval: Sequence[float], unit: str) -> str:
    if value is None:
        return _DASH
    return f"{three_digits(value)} ({' to '.join(map(three_digits, interval))}) {unit}"


def _parameter_table(documents: Sequence[TraceDocument], names: Sequence[Compared]) -> Table:
    """Parameters of what was found, of each effect that any of the traces has on a channel."""
    found: list[dict[tuple[str, str, str], tuple[float | None, float | None]]] = [
        {(f"{' '.join(f['channels'])}: {f['label']}", p["name"], p["unit"]): (p["value"], p["sd"])
         for f in d["findings"] for p in f["params"]}
        for d in documents
    ]  # fmt: skip
    logs = [{run["log_sha256"] for run in d["runs"]} for d in documents]
    columns = (Column("Effect"), Column("Result", "code"), Column("Value ± sd", "number"),
               Column(f"Minus {names[0].letter} ± sd", "number"), Column("In sd", "number"))  # fmt: skip
    rows = []
    for key in dict.fromkeys(key for own in found for key in own):
        effect, parameter, unit = key
        unknown: tuple[float | None, float | None] = (None, None)
        first = found[0].get(key, unknown)
        for k, (own, name) in enumerate(zip(found, names, strict=True)):
            value, sd = own.get(key, unknown)
            said = "not found" if value is None else plus_minus(value, sd, unit)
            same = not logs[0].isdisjoint(logs[k])
            made = difference(first[0], None if same else first[1], value, sd)
            cells = _cells(made, unit) if k else (_DASH, _DASH)
            rows.append((f"{effect}, {parameter}", f"{name.letter} {name.mark}".strip(), said, *cells))
    return Table(columns, tuple(rows))

"""Quality of the data behind a result: gaps, clipping, temperatures, length against what is needed, what is missing."""

from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING

from filters.tracing.trace_document import TraceDocument
from imutui.estimates import biases
from imutui.jobs.page_data import LogData, Quality
from imutui.report.blocks import Block, Column, Items, Paragraph, Section, Subheading, Table
from imutui.report.identity import NOT_STATED
from imutui.report.numbers import duration

if TYPE_CHECKING:
    from imutui.jobs.documents import RunDocument

TITLE = "Data quality"
TRACE_LEAST_S, TRACE_GOOD_S = 5.0, 1800.0
_NOISE_SHARE = 0.1
_SHORT_NOISE_S = 10.0


def of_replay(d: "RunDocument", log: LogData) -> Section:
    """Of a replay."""
    blocks: list[Block] = [_logs(log.quality) if log.quality else _counted(d)]
    blocks += _findings(log.quality)
    needs = list(_replay_needs(d))
    if needs:
        blocks.append(_needs(needs))
    return Section(TITLE, (*blocks, *_missing(log)))


def of_trace(d: TraceDocument, log: LogData) -> Section:
    """Of a trace."""
    blocks: list[Block] = [_logs(log.quality)] if log.quality else []
    blocks += _findings(log.quality)
    powered = {run["power_on"] for run in d["runs"]}
    needs = [
        (f"Tracing {run['id']}", f"{duration(TRACE_LEAST_S)}; {duration(TRACE_GOOD_S)} with the unit warming up",
         duration(run["seconds"]), _enough(run["seconds"], TRACE_GOOD_S))
        for run in d["runs"]
    ]  # fmt: skip
    needs.append(
        ("Showing that it holds for the next power-on", "2 power-ons", str(len(powered)), _enough(len(powered), 2))
    )
    return Section(TITLE, (*blocks, _needs(needs), *_missing(log)))


def _logs(every: Sequence[Quality]) -> Table:
    columns = (
        Column("File", "file"), Column("Length"), Column("Samples", "number"), Column("Without a reading", "number"),
        Column("Gaps"), Column("Lost packets", "number"), Column("Bad checksums", "number"), Column("Temperature"),
    )  # fmt: skip
    rows = tuple(
        (
            PurePath(q.log).name,
            duration(q.seconds),
            str(q.samples),
            str(q.without_reading),
            "none" if not q.gaps else f"{q.gaps}, longest {q.longest_gap_s:.3g} s, {q.missing_s:.3g} s in all",
            *(NOT_STATED if count is None else str(count) for count in (q.lost_packets, q.bad_checksums)),
            _span(q.temperature_degc),
        )
        for q in every
    )
    caption = "Of whole files. A sample without a reading had a count at its limit (clipping), or was marked as none."
    return Table(columns, rows, caption)


def _counted(d: "RunDocument") -> Table:
    """What a result itself says of its log."""
    gaps = NOT_STATED
    if "final" in d:
        longest = max((gap["seconds"] for gap in d["gaps"]), default=0.0)
        gaps = f"{len(d['gaps'])}" + (f", longest {longest:.3g} s" if longest else "")
    rows = (
        ("Gaps", gaps),
        ("Lost packets", str(d["lost_packets"])),
        ("Bad checksums", str(d["bad_checksums"])),
        ("Samples without a reading", NOT_STATED),
    )
    return Table((Column("What"), Column("How much")), rows, "As the result says; the log is not at hand.")


def _span(values: tuple[float, float] | None) -> str:
    if values is None:
        return NOT_STATED
    low, high = values
    return f"{low:.1f} to {high:.1f} °C, {high - low:.1f} K"


def _findings(every: Sequence[Quality]) -> Iterator[Block]:
    found = [f"{PurePath(q.log).name}: {text}" for q in every for text in q.findings]
    if found:
        yield Subheading("What `imutui check` finds")
        yield Items(tuple(found))
    elif every:
        yield Paragraph("`imutui check` finds nothing wrong with " + ("it." if len(every) == 1 else "them."))


def _replay_needs(d: "RunDocument") -> Iterator[tuple[str, str, str, str]]:
    if "final" not in d:
        return
    seconds = d["duration_s"]
    since = [bias.converged_s for bias in biases(d) if bias.value is not None]
    settled = [s for s in since if s is not None]
    if since and len(settled) == len(since):
        yield "Convergence of all biases", f"{max(settled):.0f} s", duration(seconds), "yes"
    elif since:
        yield "Convergence of all biases", f"more than {duration(seconds)}", duration(seconds), "no"
    relative = d["noise"]["relative_sd"]
    if relative:
        least = max(_SHORT_NOISE_S, seconds * (relative / _NOISE_SHARE) ** 2)
        yield "White noise to 10 %", duration(least), duration(seconds), _enough(seconds, least)
    yield (
        "Tracing what the model lacks",
        f"{duration(TRACE_LEAST_S)}; {duration(TRACE_GOOD_S)} with the unit warming up",
        duration(seconds),
        _enough(seconds, TRACE_GOOD_S, TRACE_LEAST_S),
    )


def _enough(there: float, good: float, least: float | None = None) -> str:
    if there >= good:
        return "yes"
    return "no" if least is None or there < least else "just"


def _needs(rows: Sequence[tuple[str, str, str, str]]) -> Table:
    columns = (Column("What for"), Column("Least"), Column("Here"), Column("Enough"))
    return Table(columns, tuple(rows), "Length against what is needed.")


def _missing(log: LogData) -> Iterator[Block]:
    if log.missing:
        yield Subheading("Left out of this page")
        yield Items(log.missing)

"""A folder to hand over: the page, its figures as files, the result, what goes beside a trace."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, cast

from filters.tracing.trace_document import CommonEntry, TraceDocument
from imutui.logbook import json_text
from imutui.plain_text import in_line
from imutui.report import figures, html, replay_report, sentences, trace_report
from imutui.report.blocks import Article, Page

if TYPE_CHECKING:
    from imutui.jobs.documents import ResultDocument

INDEX, RESULT = "index.html", "result.json"
Result: TypeAlias = "TraceDocument | ResultDocument"


def page(results: Sequence[Result]) -> Page:
    """A page of results, of traces and of replays.

    Parameters
    ----------
    results : sequence of TraceDocument or ResultDocument
        At least one.
    """
    articles = tuple(_article(result) for result in results)
    title = articles[0].title if len(articles) == 1 else f"{len(articles)} results"
    return Page(title, articles)


def is_trace(result: Result) -> bool:
    """Whether a result is a trace's."""
    return "findings" in result


def write(folder: Path, results: Sequence[Result]) -> list[Path]:
    """Write page, figures, results, and of a trace the courses of common causes and the experiment, into a folder.

    Parameters
    ----------
    folder : Path
        Made if absent; files of these names are replaced.
    results : sequence of TraceDocument or ResultDocument
        At least one.

    Returns
    -------
    list of Path
        What was written, the page first.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made = page(results)
    contents: dict[str, bytes] = {INDEX: html.document(made).encode("utf-8", "replace")}
    contents[RESULT] = (json_text.dumps(results[0] if len(results) == 1 else list(results)) + "\n").encode()
    for number, (result, article) in enumerate(zip(results, made.articles, strict=True), 1):
        prefix = "" if len(results) == 1 else f"{number}-"
        for figure in article.figures():
            for kind in ("svg", "png"):
                contents[f"{prefix}{figure.name}.{kind}"] = figures.file(figure, kind)
        if is_trace(result):
            contents |= {prefix + name: text.encode() for name, text in _beside(cast("TraceDocument", result)).items()}
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    return [folder / name for name in contents]


def _article(result: Result) -> Article:
    if is_trace(result):
        return trace_report.article(cast("TraceDocument", result))
    return replay_report.article(cast("ResultDocument", result))


def _beside(d: TraceDocument) -> dict[str, str]:
    made = {sentences.common_file(n): course(entry) for n, entry in enumerate(d.get("common", []), 1)}
    experiment = d.get("separating_experiment")
    if experiment and experiment.get("profile"):
        made[trace_report.EXPERIMENT] = experiment["profile"]
    return made


def course(entry: CommonEntry) -> str:
    """CSV of a common cause's course: s since the start of the run, value in the unit of the leading channel."""
    curve = entry["curve"]
    runs = curve.get("run")
    head = "t_s,value" + (",run" if runs else "")
    lines = [f"{t:.3f},{y:.9g}" for t, y in zip(curve["t_s"], curve["y"], strict=True)]
    if runs:
        lines = [f'{line},"{_cell(run)}"' for line, run in zip(lines, runs, strict=True)]
    return "\n".join([head, *lines]) + "\n"


def _cell(text: str) -> str:
    return in_line(text).replace('"', '""')

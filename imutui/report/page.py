"""A folder to hand over: the page as HTML, Markdown and JSON, its figures as files, the results, what goes beside."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, cast

from filters.tracing.trace_document import CommonEntry, TraceDocument
from imutui.jobs.page_data import LogData
from imutui.logbook import json_text
from imutui.plain_text import in_line
from imutui.report import (
    comparison,
    figures,
    how_to_apply,
    html,
    markdown,
    page_document,
    replay_report,
    trace_report,
    trace_tables,
)
from imutui.report.blocks import Article, Figure, Page

if TYPE_CHECKING:
    from imutui.jobs.documents import ResultDocument

INDEX, RESULT, MARKDOWN, REPORT, PRINT = "index.html", "result.json", "report.md", "report.json", "report.pdf"
NAMES = (INDEX, MARKDOWN, REPORT, RESULT, PRINT)
"""What every page has; the last where a browser is at hand."""
Result: TypeAlias = "TraceDocument | ResultDocument"


@dataclass(frozen=True, slots=True)
class Story:
    """A result with what its logs add to it."""

    result: Result
    log: LogData = field(default_factory=LogData)  # what its logs add; nothing where they are not at hand


def page(stories: Sequence[Story]) -> Page:
    """A page of results, of traces and of replays; several of a kind are compared first.

    `stories`: at least one.
    """
    articles = tuple(_article(story) for story in stories)
    if len(articles) == 1:
        return Page(articles[0].title, articles)
    articles = tuple(
        replace(article, title=f"{comparison.letter(n)}: {article.title}") for n, article in enumerate(articles, 1)
    )
    compared = comparison.article([story.result for story in stories], [story.log for story in stories])
    return Page(f"{len(articles)} results", articles if compared is None else (compared, *articles))


def is_trace(result: Result) -> bool:
    """Whether a result is a trace's."""
    return "findings" in result


def write(folder: Path, stories: Sequence[Story]) -> list[Path]:
    """Write page, figures, results, and files that go beside them, into a folder.

    `folder`: made if absent. Files of these names are replaced, and figures of the page before that this one has not
      are removed.
    `stories`: at least one.
    Returns what was written, the page first.
    """
    made = page(stories)
    contents: dict[str, bytes] = {INDEX: html.document(made).encode("utf-8", "replace")}
    names = _Names(made, len(stories))
    contents[MARKDOWN] = markdown.document(made, names.of).encode("utf-8", "replace")
    results = [story.result for story in stories]
    contents[RESULT] = (json_text.dumps(results[0] if len(results) == 1 else results) + "\n").encode()
    for number, article in enumerate(made.articles, 1):
        for figure in article.figures():
            for kind in ("svg", "png"):
                contents[f"{names.of(number, figure)}.{kind}"] = figures.file(figure, kind)
    for number, story in enumerate(stories, 1):
        prefix = "" if len(stories) == 1 else f"{number}-"
        contents |= {prefix + name: text.encode("utf-8", "replace") for name, text in _beside(story).items()}
    contents[REPORT] = b""
    contents[REPORT] = (json_text.dumps(page_document.document(made, names.of, list(contents))) + "\n").encode()
    folder.mkdir(parents=True, exist_ok=True)
    for name in page_document.figures_of(folder / REPORT):
        (folder / name).unlink(missing_ok=True)
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    return [folder / name for name in contents]


class _Names:
    """Names of figures' files: of several results each has its number, of their comparison none."""

    def __init__(self, made: Page, results: int) -> None:
        self._first = len(made.articles) - results
        self._single = results == 1

    def of(self, number: int, figure: Figure) -> str:
        """Name without suffix of a figure of an article, which are numbered from 1."""
        own = number - self._first
        return figure.name if self._single or own < 1 else f"{own}-{figure.name}"


def _article(story: Story) -> Article:
    if is_trace(story.result):
        return trace_report.article(cast("TraceDocument", story.result), story.log)
    return replay_report.article(cast("ResultDocument", story.result), story.log)


def _beside(story: Story) -> dict[str, str]:
    d = story.result
    made: dict[str, str] = {}
    for section in _article(story).sections:
        if section.title == how_to_apply.TITLE:
            made |= how_to_apply.files(section.blocks)
    if is_trace(d):
        made |= _of_trace(cast("TraceDocument", d))
    return made


def _of_trace(d: TraceDocument) -> dict[str, str]:
    made = {trace_tables.common_file(n): course(entry) for n, entry in enumerate(d.get("common", []), 1)}
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

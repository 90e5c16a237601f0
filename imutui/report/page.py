"""A folder to hand over: the page as HTML, JSON and PDF, its figures as files, the results, what goes beside.

The only place that starts a browser, which prints the page if one is at hand.
"""

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filters.errors import InputError
from filters.tracing.trace_document import CommonEntry
from imutui import outside_file
from imutui.document_shape import VERSION
from imutui.jobs.page_data import LogData
from imutui.logbook import atomic_file, json_text
from imutui.plain_text import in_line
from imutui.report import comparison, figures, how_to_apply, html, replay_report, trace_report, trace_tables
from imutui.report.blocks import Article, Block, Code, Facts, Figure, Items, Page, Paragraph, Subheading, Table

if TYPE_CHECKING:
    from imutui.jobs.result_files import Result

INDEX, RESULT, REPORT, PRINT = "index.html", "result.json", "report.json", "report.pdf"
NAMES = (INDEX, REPORT, RESULT, PRINT)  # what every page has; the last where a browser is at hand
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_LIMIT = 2**26
_FIGURE = re.compile(
    r"(?:\d+-)?(?:error|residual|allan|spectrum|driver|common|temperature|motion|convergence|nis|biases|compared-[a-z]+)"
    r"(?:-\d+)?\.(?:svg|png)"
)
_BESIDE = re.compile(r"(?:\d+-)?(?:effects\.toml|imu\.yaml|experiment\.toml|common_\d+\.csv)")
_LONGEST_S = 120.0
_WORDS = 160


@dataclass(frozen=True, slots=True)
class Story:
    """A result with what its logs add to it."""

    result: "Result"
    log: LogData = field(default_factory=LogData)  # what its logs add; nothing where they are not at hand


def page(stories: Sequence[Story]) -> Page:
    """A page of results, of traces and of replays; several of a kind are compared first."""
    articles = tuple(_article(story) for story in stories)
    if len(articles) == 1:
        return Page(articles[0].title, articles)
    articles = tuple(
        replace(article, title=f"{comparison.letter(n)}: {article.title}") for n, article in enumerate(articles, 1)
    )
    compared = comparison.article([story.result for story in stories], [story.log for story in stories])
    return Page(f"{len(articles)} results", articles if compared is None else (compared, *articles))


def may_write(name: str) -> bool:
    """Return whether a page of some result writes a file of this name into its folder."""
    return name in NAMES or _FIGURE.fullmatch(name) is not None or _BESIDE.fullmatch(name) is not None


def write(folder: Path, stories: Sequence[Story], *, overwrite: bool = False, own: Collection[str] = ()) -> list[Path]:
    """Write page, figures, results, and files that go beside them, into a folder.

    `folder`: made if absent.
    `overwrite`: replace files, and remove the figures of an earlier page that this one does not have.
    `own`: names that may be replaced anyway, since the caller has written them.
    Returns what was written, the page first.
    Raises FileExistsError if a file exists and may not be replaced; then nothing is written.
    """
    made = page(stories)
    contents: dict[str, bytes] = {INDEX: html.document(made).encode("utf-8", "replace")}
    results = [story.result for story in stories]
    contents[RESULT] = (json_text.dumps(results[0] if len(results) == 1 else results) + "\n").encode()
    articles = list(_prefixed(made, len(results)))
    for prefix, article in articles:
        contents |= figures.files(article, prefix)
    for (prefix, article), result in zip(articles[-len(results) :], results, strict=True):
        texts = {prefix + name: text for name, text in _beside(article, result).items()}
        contents |= {name: text.encode("utf-8", "replace") for name, text in texts.items()}
    contents[REPORT] = b""
    contents[REPORT] = (json_text.dumps(_document(made, len(results), list(contents))) + "\n").encode()
    for name in _earlier_figures(folder / REPORT) if overwrite else ():
        if name not in contents:
            (folder / name).unlink(missing_ok=True)
    return atomic_file.write_all(folder, contents, overwrite=overwrite, own=own)


def _document(page: Page, results: int, files: Sequence[str]) -> dict[str, Any]:
    """A page as JSON, for programs: blocks are those of the page, in order, each with its kind."""
    articles = [
        {
            "title": article.title,
            "kind": article.kind,
            "origin": article.origin,
            "sections": [
                {"title": section.title, "blocks": [_block(block, prefix) for block in section.blocks]}
                for section in article.sections
            ],
        }
        for prefix, article in _prefixed(page, results)
    ]
    return {"version": VERSION, "title": page.title, "articles": articles, "files": list(files)}


def _prefixed(page: Page, results: int) -> Iterator[tuple[str, Article]]:
    """Articles, and what their figures' files begin with: of several results its number, else nothing."""
    for number, article in enumerate(page.articles, 1 - (len(page.articles) - results)):
        yield "" if results == 1 or number < 1 else f"{number}-", article


def _block(block: Block, prefix: str) -> dict[str, Any]:
    kind = {"block": type(block).__name__.lower()}
    match block:
        case Paragraph(text) | Subheading(text) | Code(text):
            return kind | {"text": text}
        case Items(texts, numbered):
            return kind | {"texts": texts, "numbered": numbered}
        case Facts(rows):
            return kind | {"rows": rows}
        case Table(columns, rows, caption):
            return kind | {"caption": caption, "columns": [column.heading for column in columns], "rows": rows}
        case Figure(name, title, caption, panels):
            files = [f"{prefix}{name}.{suffix}" for suffix in figures.KINDS]
            return kind | {"title": title, "caption": caption, "panels": [p.name for p in panels], "files": files}


def _earlier_figures(path: Path) -> list[str]:
    """Return the names of the figures that the JSON of an earlier page lists; none where it is no such JSON."""
    try:
        found = outside_file.read_json(path, _LIMIT)
    except (OSError, InputError):
        return []
    files = found.get("files") if isinstance(found, dict) else None
    return [name for name in files or () if isinstance(name, str) and _FIGURE.fullmatch(name)]


def _article(story: Story) -> Article:
    if "findings" in story.result:
        return trace_report.article(story.result, story.log)
    return replay_report.article(story.result, story.log)


def _beside(article: Article, result: "Result") -> dict[str, str]:
    """Texts of the files of a result by name: how to apply it, courses of common causes, the separating experiment."""
    made: dict[str, str] = {}
    for section in article.sections:
        if section.title == how_to_apply.TITLE:
            made |= how_to_apply.files(section.blocks)
    if "findings" in result:
        made |= {trace_tables.common_file(n): course(entry) for n, entry in enumerate(result["common"], 1)}
        if result["separating_experiment"] is not None:
            made[trace_report.EXPERIMENT] = result["separating_experiment"]["profile"]
    return made


def course(entry: CommonEntry) -> str:
    """CSV of a common cause's course: s since the start of the run, value in the unit of the leading channel."""
    curve = entry["curve"]
    runs = curve["run"]
    head = "t_s,value" + (",run" if runs else "")
    lines = [f"{t:.3f},{y:.9g}" for t, y in zip(curve["t_s"], curve["y"], strict=True)]
    if runs:
        cells = (in_line(run).replace('"', '""') for run in runs)
        lines = [f'{line},"{cell}"' for line, cell in zip(lines, cells, strict=True)]
    return "\n".join([head, *lines]) + "\n"


class PrintError(Exception):
    """Nothing was printed; the message says why: no browser is here, or what it said."""


def browser() -> str | None:
    """Path of a browser that can print without a screen; None without one."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def print_page(page: Path, output: Path, *, overwrite: bool = False) -> Path:
    """Print a page on A4, by a browser, which is looked for.

    `output`: PDF, in a folder that exists; returned.
    `overwrite`: whether an existing one may be replaced.
    Raises PrintError if nothing was printed.
    """
    program = browser()
    if program is None:
        raise PrintError("it takes chromium or chrome, and neither is here")
    # beside the page: a browser in a container of its own sees no other temporary folder
    with tempfile.TemporaryDirectory(prefix=".print-", dir=output.parent) as own:
        made = Path(own) / "page.pdf"
        command = [program, "--headless", "--disable-gpu", "--no-first-run", f"--user-data-dir={own}/profile"]
        command += ["--disable-background-networking", "--no-pdf-header-footer", f"--print-to-pdf={made.resolve()}"]
        # as root there is no sandbox, and the page has no script
        command += ["--no-sandbox"] if os.geteuid() == 0 else []
        try:
            done = subprocess.run(
                [*command, page.resolve().as_uri()], capture_output=True, text=True, timeout=_LONGEST_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise PrintError(f"{Path(program).name}: {error}"[:_WORDS]) from error
        if not made.is_file() or not made.stat().st_size:
            said = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
            raise PrintError(f"{Path(program).name} printed nothing: {said}"[:_WORDS])
        atomic_file.write(output, made.read_bytes(), overwrite=overwrite)
    return output

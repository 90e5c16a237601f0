"""A page as JSON: what was reported, for programs. Blocks are those of the page, in order, each with its kind."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypedDict

from filters.errors import InputError
from imutui import outside_file
from imutui.report.blocks import Article, Block, Code, Facts, Figure, Items, Page, Paragraph, Subheading, Table

VERSION = 1
_LIMIT = 2**26
_FIGURE = re.compile(r"[A-Za-z0-9][A-Za-z0-9-]*\.(svg|png)")


class SectionDocument(TypedDict):
    """A heading with blocks under it."""

    title: str
    blocks: list[dict[str, Any]]


class ArticleDocument(TypedDict):
    """All that is said of one result, or of several beside each other."""

    title: str
    kind: str
    origin: str
    sections: list[SectionDocument]


class PageDocument(TypedDict):
    """All of a page, and the files of its folder."""

    version: int
    title: str
    articles: list[ArticleDocument]
    files: list[str]


def document(page: Page, names: Callable[[int, Figure], str], files: Sequence[str]) -> PageDocument:
    """A page as JSON.

    `page`: what it says.
    `names`: name of a figure's files without suffix, of the article's number from 1 and the figure.
    `files`: what lies in the folder.
    """
    articles = [_article(article, n, names) for n, article in enumerate(page.articles, 1)]
    return {"version": VERSION, "title": page.title, "articles": articles, "files": list(files)}


def _article(article: Article, number: int, names: Callable[[int, Figure], str]) -> ArticleDocument:
    sections: list[SectionDocument] = [
        {"title": section.title, "blocks": [_block(block, number, names) for block in section.blocks]}
        for section in article.sections
    ]
    return {"title": article.title, "kind": article.kind, "origin": article.origin, "sections": sections}


def _block(block: Block, number: int, names: Callable[[int, Figure], str]) -> dict[str, Any]:
    match block:
        case Paragraph() | Subheading() | Code():
            text = block.text
            return {"block": type(block).__name__.lower(), "text": text}
        case Items():
            return {"block": "items", "texts": list(block.texts), "numbered": block.numbered}
        case Facts():
            return {"block": "facts", "rows": [list(row) for row in block.rows]}
        case Table():
            columns = [column.heading for column in block.columns]
            return {
                "block": "table", "caption": block.caption, "columns": columns, "rows": [list(r) for r in block.rows],
            }  # fmt: skip
        case Figure():
            name = names(number, block)
            return {
                "block": "figure", "title": block.title, "caption": block.caption,
                "panels": [panel.name for panel in block.panels], "files": [f"{name}.svg", f"{name}.png"],
            }  # fmt: skip


def figures_of(path: Path) -> list[str]:
    """Names of the figures of the page that a folder has; none where its JSON is none of ours."""
    try:
        document = outside_file.read_json(path, _LIMIT)
    except (OSError, InputError):
        return []
    files = document.get("files") if isinstance(document, dict) else None
    return [name for name in files or () if isinstance(name, str) and _FIGURE.fullmatch(name)]

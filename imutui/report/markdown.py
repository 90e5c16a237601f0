"""A page as Markdown, with its figures as files beside it. Text is text: nothing in it is markup."""

import re
from collections.abc import Callable

from imutui.plain_text import visible
from imutui.report.blocks import Article, Code, Facts, Figure, Items, Page, Paragraph, Section, Subheading, Table

_BADGES = {"measured": "MEASURED", "simulated": "SIMULATED", "unknown": "ORIGIN NOT STATED"}
_SPECIAL = re.compile(r"([\\*_<>\[\]|#~$])")
_FIRST = re.compile(r"^(\s*)([-+=]|\d+[.)])")


def document(page: Page, names: Callable[[int, Figure], str]) -> str:
    """Text of the file.

    `page`: what it says.
    `names`: name of a figure's files without suffix, of the article's number from 1 and the figure.
    """
    parts = [f"# {text(page.title)}"] if len(page.articles) > 1 else []
    for number, article in enumerate(page.articles, 1):
        parts += _article(article, lambda figure, n=number: names(n, figure), 1 if len(page.articles) == 1 else 2)  # type: ignore[misc]
    return "\n\n".join(parts) + "\n"


def text(value: str) -> str:
    """Text as Markdown shows it; what stands in backticks is to be typed."""
    parts = visible(value).replace("\n", " ").split("`")
    if len(parts) % 2 == 0:  # a backtick of its own, from outside
        return _plain("'".join(parts))
    return "".join(f"`{part}`" if n % 2 and part else _plain(part) for n, part in enumerate(parts))


def _plain(value: str) -> str:
    return _SPECIAL.sub(r"\\\1", value).replace("&", "&amp;")


def _article(article: Article, name: Callable[[Figure], str], level: int) -> list[str]:
    head = [f"{'#' * level} {text(article.title)}", f"**{_BADGES[article.kind]}** {text(article.origin)}"]
    return head + [part for section in article.sections for part in _section(section, name, level + 1)]


def _section(section: Section, name: Callable[[Figure], str], level: int) -> list[str]:
    made = [f"{'#' * level} {text(section.title)}"]
    for block in section.blocks:
        match block:
            case Paragraph(said):
                made.append(_FIRST.sub(r"\1\\\2", text(said)))
            case Subheading(said):
                made.append(f"{'#' * (level + 1)} {text(said)}")
            case Items():
                made.append(_items(block))
            case Facts(rows):
                made.append(_rows(("", ""), rows))
            case Table():
                made += [text(block.caption)] if block.caption else []
                made.append(_rows(tuple(column.heading for column in block.columns), block.rows))
            case Code():
                made.append(text(block.folded) if block.folded else _code(block.text))
            case Figure():
                made.append(f"![{text(block.title)}]({name(block)}.svg)")
                made.append(f"**{text(block.title)}.** {text(block.caption)}")
    return made


def _items(block: Items) -> str:
    return "\n".join(f"{f'{n}.' if block.numbered else '-'} {text(item)}" for n, item in enumerate(block.texts, 1))


def _rows(head: tuple[str, ...], rows: tuple[tuple[str, ...], ...]) -> str:
    lines = [head, tuple("---" for _ in head)]
    made = [f"| {' | '.join(map(text, lines[0]))} |", f"| {' | '.join(lines[1])} |"]
    return "\n".join([*made, *(f"| {' | '.join(map(text, row))} |" for row in rows)])


def _code(said: str) -> str:
    """A block that nothing inside it ends."""
    fence = "`" * max(3, 1 + max((len(run) for run in re.findall("`+", said)), default=0))
    lines = "\n".join(visible(line) for line in said.rstrip("\n").split("\n"))
    return f"{fence}\n{lines}\n{fence}"

"""A page as HTML in one file, pictures and style in it, which requests nothing from anywhere.

Text is text: nothing in it is a tag. For wide and narrow screens, light and dark ones, and for A4.
"""

from collections.abc import Callable
from html import escape as escaped

from imutui.plain_text import visible
from imutui.report import figures
from imutui.report.blocks import Article, Code, Facts, Figure, Items, Page, Paragraph, Section, Subheading, Table
from imutui.report.html_style import STYLE

_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
_SHORT = 30
_BADGES = {"measured": "MEASURED", "simulated": "SIMULATED", "unknown": "ORIGIN NOT STATED"}


def document(page: Page) -> str:
    """Text of the file.

    `page`: what it says.
    """
    body = "\n".join(_article(article, n) for n, article in enumerate(page.articles, 1))
    if len(page.articles) > 1:
        body = f"<h1>{text(page.title)}</h1>\n{_contents(page)}\n{body}"
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{escape(page.title)}</title><style>{STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def escape(value: str) -> str:
    """Text as HTML shows it: nothing in it is a tag, and nothing acts on what stands around it."""
    return escaped(visible(value))


def text(value: str) -> str:
    """Text with what stands in backticks as something to be typed."""
    parts = escape(value).split("`")
    if len(parts) % 2 == 0:  # a backtick of its own, from outside
        return "`".join(parts)
    return "".join(_typed(part) if n % 2 else part for n, part in enumerate(parts))


def _typed(part: str) -> str:
    kind = ' class="short"' if len(part) < _SHORT else ""
    return f"<code{kind}>{part}</code>"


def _contents(page: Page) -> str:
    items = "".join(
        f'<li><a href="#result-{n}">{escape(article.title)}</a> ({_BADGES[article.kind]})</li>'
        for n, article in enumerate(page.articles, 1)
    )
    return f"<nav><ol>{items}</ol></nav>"


def _article(article: Article, number: int) -> str:
    sections = "\n".join(_section(section, number) for section in article.sections)
    badge = f'<p class="origin {article.kind}"><strong>{_BADGES[article.kind]}</strong> {text(article.origin)}</p>'
    return f'<article id="result-{number}">\n<h1>{text(article.title)}</h1>\n{badge}\n{sections}\n</article>'


def _section(section: Section, number: int) -> str:
    blocks = "\n".join(_figure(b, number) if isinstance(b, Figure) else _WRITERS[type(b)](b) for b in section.blocks)
    return f"<section>\n<h2>{text(section.title)}</h2>\n{blocks}\n</section>"


def _paragraph(block: Paragraph) -> str:
    return f"<p>{text(block.text)}</p>"


def _subheading(block: Subheading) -> str:
    return f"<h3>{text(block.text)}</h3>"


def _items(block: Items) -> str:
    tag = "ol" if block.numbered else "ul"
    return f"<{tag}>" + "".join(f"<li>{text(item)}</li>" for item in block.texts) + f"</{tag}>"


def _facts(block: Facts) -> str:
    rows = "".join(f"<dt>{text(label)}</dt><dd>{text(value)}</dd>" for label, value in block.rows)
    return f"<dl>{rows}</dl>"


def _table(block: Table) -> str:
    head = "".join(f'<th class="{column.kind}" scope="col">{text(column.heading)}</th>' for column in block.columns)
    rows = "".join(f"<tr>{_cells(block, row)}</tr>" for row in block.rows)
    caption = f"<caption>{text(block.caption)}</caption>" if block.caption else ""
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _cells(block: Table, row: tuple[str, ...]) -> str:
    return "".join(
        f'<td class="{column.kind}" data-label="{escape(column.heading)}">{text(cell)}</td>'
        for column, cell in zip(block.columns, row, strict=True)
    )


def _code(block: Code) -> str:
    whole = f"<pre>{escape(block.text)}</pre>"
    return f"<details><summary>{text(block.folded)}</summary>{whole}</details>" if block.folded else whole


def _figure(block: Figure, number: int) -> str:
    several = len(block.panels) > 1
    drawn = "".join(
        figures.picture(panel, f"{block.title}{': ' + panel.name if several else ''}", f"r{number}-{block.name}-{n}")
        for n, panel in enumerate(block.panels)
    )
    caption = f"<figcaption><strong>{text(block.title)}.</strong> {text(block.caption)}</figcaption>"
    kind = "several" if several else "single"
    return f'<figure id="r{number}-{block.name}" class="{kind}">{caption}<div class="panels">{drawn}</div></figure>'


_WRITERS: dict[type, Callable[..., str]] = {
    Paragraph: _paragraph,
    Subheading: _subheading,
    Items: _items,
    Facts: _facts,
    Table: _table,
    Code: _code,
}

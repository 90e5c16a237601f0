"""A page as HTML in one file, pictures and style in it, which requests nothing from anywhere.

Text is text: nothing in it is a tag. For wide and narrow screens, light and dark ones, and for A4.
"""

from html import escape as escaped
from pathlib import Path

from imutui.plain_text import visible
from imutui.report import figures
from imutui.report.blocks import Article, Block, Code, Facts, Figure, Items, Page, Paragraph, Section, Subheading, Table
from imutui.report.numbers import NOTHING, ORIGIN

STYLE = "\n" + Path(__file__).with_name("page.css").read_text()
_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
_SHORT = 30


def document(page: Page) -> str:
    """Text of the file."""
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
        f'<li><a href="#result-{n}">{escape(article.title)}</a> ({ORIGIN[article.kind].upper()})</li>'
        for n, article in enumerate(page.articles, 1)
    )
    return f"<nav><ol>{items}</ol></nav>"


def _article(article: Article, number: int) -> str:
    sections = "\n".join(_section(section, number) for section in article.sections)
    badge = (
        f'<p class="origin {article.kind}"><strong>{ORIGIN[article.kind].upper()}</strong> {text(article.origin)}</p>'
    )
    return f'<article id="result-{number}">\n<h1>{text(article.title)}</h1>\n{badge}\n{sections}\n</article>'


def _section(section: Section, number: int) -> str:
    blocks = "\n".join(_block(block, number) for block in section.blocks)
    return f"<section>\n<h2>{text(section.title)}</h2>\n{blocks}\n</section>"


def _block(block: Block, number: int) -> str:
    match block:
        case Paragraph(said):
            return f"<p>{text(said)}</p>"
        case Subheading(said):
            return f"<h3>{text(said)}</h3>"
        case Items(texts, numbered):
            tag = "ol" if numbered else "ul"
            return f"<{tag}>" + "".join(f"<li>{text(item)}</li>" for item in texts) + f"</{tag}>"
        case Facts(rows):
            return f"<dl>{''.join(f'<dt>{text(label)}</dt><dd>{text(value)}</dd>' for label, value in rows)}</dl>"
        case Table():
            return _table(block)
        case Code(said, folded):
            whole = f"<pre>{escape(said)}</pre>"
            return f"<details><summary>{text(folded)}</summary>{whole}</details>" if folded else whole
        case Figure():
            return _figure(block, number) if block.panels else ""


def _table(block: Table) -> str:
    head = "".join(f'<th class="{column.kind}" scope="col">{text(column.heading)}</th>' for column in block.columns)
    rows = "".join(f"<tr>{_cells(block, row)}</tr>" for row in block.rows)
    caption = f"<caption>{text(block.caption)}</caption>" if block.caption else ""
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _cells(block: Table, row: tuple[str, ...]) -> str:
    return "".join(
        f'<td class="{column.kind}" data-label="{escape(column.heading)}">{_cell(cell, column.kind)}</td>'
        for column, cell in zip(block.columns, row, strict=True)
    )


def _cell(cell: str, kind: str) -> str:
    is_link = kind == "link" and cell != NOTHING
    return f'<a href="{escape(cell)}">{escape(cell)}</a>' if is_link else text(cell)


def _figure(block: Figure, number: int) -> str:
    several = len(block.panels) > 1
    drawn = "".join(
        figures.picture(panel, f"{block.title}{': ' + panel.name if several else ''}", f"r{number}-{block.name}-{n}")
        for n, panel in enumerate(block.panels)
    )
    caption = f"<figcaption><strong>{text(block.title)}.</strong> {text(block.caption)}</figcaption>"
    kind = "several" if several else "single"
    return f'<figure id="r{number}-{block.name}" class="{kind}">{caption}<div class="panels">{drawn}</div></figure>'

"""A page as HTML in one file, pictures and style in it, which requests nothing from anywhere.

Text is text: nothing in it is a tag. For wide and narrow screens, light and dark ones, and for A4.
"""

from html import escape as escaped

from imutui.plain_text import visible
from imutui.report import figures
from imutui.report.blocks import Article, Block, Code, Facts, Figure, Items, Page, Paragraph, Section, Subheading, Table
from imutui.report.numbers import ORIGIN

# for wide and narrow screens, light and dark ones, and paper; colours of figures are named here once for each
STYLE = """
:root { color-scheme: light dark; --ink: #1c1c1c; --paper: #fff; --faint: #595959; --rule: #d8d8d8; --fill: #f3f4f6;
  --before: #c2530a; --after: #1b4f9c; --floor: #8a8a8a; --good: #e7f3ea; --warn: #fdf0d5 }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e6; --paper: #16181c; --faint: #a9adb5; --rule: #3a3f47;
  --fill: #22262c; --before: #f0954f; --after: #7fb2ff; --floor: #8a8f98; --good: #1d3325; --warn: #40310f } }
* { box-sizing: border-box }
body { font: 16px/1.5 system-ui, "DejaVu Sans", sans-serif; color: var(--ink); background: var(--paper);
  max-width: 64rem; margin: 0 auto; padding: 1.5rem 1rem 3rem; overflow-wrap: break-word }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 1rem 0 .6rem }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .6rem; padding-bottom: .25rem; border-bottom: 2px solid var(--rule) }
h3 { font-size: 1rem; margin: 1.2rem 0 .3rem }
h1, h2, h3 { break-after: avoid } ul, ol { margin: .3rem 0 1rem; padding-left: 1.6rem }
p, li { max-width: 48rem } li { margin: .35rem 0 }
a { color: var(--after) } article + article { margin-top: 4rem; border-top: 4px solid var(--rule) }
code, pre, td.code { font-family: ui-monospace, "DejaVu Sans Mono", monospace; font-size: .9em }
code { overflow-wrap: anywhere } pre { background: var(--fill); padding: .8rem; white-space: pre-wrap;
  overflow-wrap: anywhere }
td.code { font-size: 1em }
.origin { padding: .6rem .9rem; border-left: .4rem solid var(--floor); background: var(--fill); max-width: none }
.origin.simulated { border-color: var(--before); background: var(--warn) }
.origin.measured { border-color: var(--after); background: var(--good) }
dl { display: grid; grid-template-columns: minmax(9rem, max-content) minmax(0, 1fr); gap: .25rem 1.2rem;
  margin: .5rem 0 1rem }
dt { color: var(--faint) } dd { margin: 0; overflow-wrap: anywhere }
table { border-collapse: collapse; width: 100%; margin: .8rem 0 1.2rem; font-size: .92rem }
caption { text-align: left; color: var(--faint); padding-bottom: .4rem }
th { text-align: left; vertical-align: bottom; font-weight: 600; color: var(--faint) }
th, td { padding: .4rem .9rem .4rem 0; border-bottom: 1px solid var(--rule); vertical-align: top }
th.number, td.number { text-align: right; font-variant-numeric: tabular-nums } td.number { white-space: pre }
td.file, td.hash { font-family: ui-monospace, "DejaVu Sans Mono", monospace; font-size: .85em;
  overflow-wrap: anywhere }
td.file { min-width: 9rem } td.hash { min-width: 33ch; width: 33ch } code.short { white-space: nowrap }
td.bar { font-family: ui-monospace, "DejaVu Sans Mono", monospace; white-space: pre; color: var(--after);
  min-width: 6.5rem }
td:last-child, th:last-child { padding-right: 0 }
tr, svg, figcaption, figure, table { break-inside: avoid } summary { cursor: pointer }
figcaption, caption { break-after: avoid }
figure { margin: 1.6rem 0 } figcaption { margin-bottom: .5rem; max-width: 48rem; color: var(--faint) }
figcaption strong { color: var(--ink) }
.panels { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 21rem), 1fr)); gap: .8rem 1.2rem }
.panels svg { width: 100%; height: auto; display: block; color: var(--ink); max-width: 40rem }
@media screen and (max-width: 44rem) {
  body { padding: .75rem .9rem 2rem } dl { grid-template-columns: minmax(0, 1fr); gap: 0 } dd { margin-bottom: .5rem }
  thead { position: absolute; left: -999rem } table, tbody, tr, td, caption { display: block }
  tr { padding: .5rem 0; border-bottom: 1px solid var(--rule) } td, td.number, td.hash { border: 0; padding: .1rem 0;
  text-align: left; width: auto; min-width: 0; white-space: normal }
  tbody td:first-child { font-weight: 600 } td:empty { display: none }
  td::before { content: attr(data-label) ": "; color: var(--faint);
  font-family: system-ui, "DejaVu Sans", sans-serif }
}
@media print { :root { color-scheme: light; --ink: #000; --paper: #fff; --faint: #444; --rule: #bbb; --fill: #f3f4f6;
  --before: #c2530a; --after: #1b4f9c; --floor: #8a8a8a; --good: #e7f3ea; --warn: #fdf0d5 }
  article + article { break-before: page }
  body { font-size: 10.5pt; max-width: none; padding: 0 } h2 { margin-top: 1.4rem } table { font-size: 9pt }
  .panels { grid-template-columns: 1fr 1fr } .panels svg:only-child { max-width: 12cm }
  .origin { print-color-adjust: exact; -webkit-print-color-adjust: exact } }
@page { size: A4; margin: 16mm 15mm 18mm }
"""


# --------------------------------------------------------------------------------------------------------------- html

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
            return _figure(block, number)


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


def _figure(block: Figure, number: int) -> str:
    several = len(block.panels) > 1
    drawn = "".join(
        figures.picture(panel, f"{block.title}{': ' + panel.name if several else ''}", f"r{number}-{block.name}-{n}")
        for n, panel in enumerate(block.panels)
    )
    caption = f"<figcaption><strong>{text(block.title)}.</strong> {text(block.caption)}</figcaption>"
    kind = "several" if several else "single"
    return f'<figure id="r{number}-{block.name}" class="{kind}">{caption}<div class="panels">{drawn}</div></figure>'

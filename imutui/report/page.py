"""One HTML page of a trace, with its figures inside: a file that can be sent."""

import base64
from collections.abc import Sequence
from html import escape as escaped
from pathlib import Path

from filters.tracing.result import RunSeries
from filters.tracing.trace_document import CommonEntry, TraceDocument
from imutui.plain_text import in_line, visible
from imutui.report import sentences
from imutui.report.figures import Picture, pictures

INDEX, EXPERIMENT = "index.html", "experiment.toml"

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #1a1a1a }
h1 { font-size: 1.5rem } h2 { font-size: 1.15rem; margin-top: 2rem }
table { border-collapse: collapse } td { vertical-align: top; padding: .3rem .9rem .3rem 0; border-top: 1px solid #ddd }
td:first-child { font-family: monospace } td:nth-child(2) { white-space: nowrap }
img { max-width: 100% } figure { margin: 1.5rem 0 } figcaption { color: #555 }
pre { background: #f4f4f4; padding: .7rem }
"""


def write(folder: Path, document: TraceDocument, series: Sequence[RunSeries], source: str) -> list[Path]:
    """Write page, figures, courses of common causes, and the experiment that would separate rivals, into a folder.

    Parameters
    ----------
    folder : Path
        Made if absent; files of these names are replaced.
    document : TraceDocument
        Contracts section 6.
    series : sequence of RunSeries
        Residuals of all runs.
    source : str
        What it is a trace of.

    Returns
    -------
    list of Path
        What was written, the page first.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made = list(pictures(document, series))
    written = [folder / INDEX]
    for picture in made:
        (folder / picture.name).write_bytes(picture.png)
        written.append(folder / picture.name)
    for number, entry in enumerate(document.get("common", []), 1):
        path = folder / sentences.common_file(number)
        path.write_text(course(entry), encoding="utf-8")
        written.append(path)
    experiment = document.get("separating_experiment")
    if experiment and experiment.get("profile"):
        (folder / EXPERIMENT).write_text(experiment["profile"], encoding="utf-8")
        written.append(folder / EXPERIMENT)
    written[0].write_text(page(document, made, source), encoding="utf-8")
    return written


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


def escape(text: str) -> str:
    """Text as HTML shows it: nothing in it is a tag, and nothing acts on what stands around it."""
    return escaped(visible(text))


def page(document: TraceDocument, made: Sequence[Picture], source: str) -> str:
    """HTML of the page, pictures and style in it."""
    head, *lines = sentences.headline(document, source)
    body = [f"<h1>{escape(head)}</h1>", *(f"<p>{escape(line)}</p>" for line in lines), "<table>"]
    for line in sentences.channel_lines(document):
        said = escape(" ".join(line.sentences))
        body.append(f"<tr><td>{line.channel}</td><td>{escape(line.status)}</td><td>{said}</td></tr>")
    body.append("</table>")
    for section in sentences.sections(document):
        body.append(f"<h2>{escape(section.title)}</h2>")
        body += [f"<p>{escape(sentence)}</p>" for sentence in section.sentences]
    experiment = document.get("separating_experiment")
    if experiment and experiment.get("profile"):
        body.append(f"<h2>{EXPERIMENT}</h2><pre>{escape(experiment['profile'])}</pre>")
    if made:
        body.append("<h2>Figures</h2>")
    for picture in made:
        data = base64.b64encode(picture.png).decode()
        title = escape(picture.title)
        body.append(
            f'<figure><img alt="{title}" src="data:image/png;base64,{data}"><figcaption>{title}</figcaption></figure>'
        )
    body.append(f"<p>{escape(str(document.get('library', '')))}, seed {document.get('seed')}</p>")
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(head)}</title>'
        f"<style>{_STYLE}</style></head>\n<body>\n" + "\n".join(body) + "\n</body></html>\n"
    )

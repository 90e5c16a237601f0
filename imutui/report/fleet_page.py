"""A folder to hand over: the page of a fleet, its figures as files, the summary."""

from pathlib import Path

from imutui.jobs.campaign.summary_document import SummaryDocument
from imutui.logbook import json_text
from imutui.report import figures, fleet_report, html

INDEX, SUMMARY = "index.html", "summary.json"


def write(folder: Path, document: SummaryDocument) -> list[Path]:
    """Write page, figures and summary into a folder.

    `folder`: made if absent; files of these names are replaced.
    `document`: of `imutui.jobs.campaign.summary`.
    Returns what was written, the page first.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made = fleet_report.page(document)
    contents = {INDEX: html.document(made).encode("utf-8", "replace")}
    contents[SUMMARY] = (json_text.dumps(document) + "\n").encode()
    for number, article in enumerate(made.articles, 1):
        prefix = "" if len(made.articles) == 1 else f"{number}-"
        for figure in article.figures():
            for kind in ("svg", "png"):
                contents[f"{prefix}{figure.name}.{kind}"] = figures.file(figure, kind)
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    return [folder / name for name in contents]

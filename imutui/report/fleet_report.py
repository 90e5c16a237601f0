"""A fleet's summary as articles, one a group: what fails, what drifts, what stands out, parts, charts, effects."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from filters import specification
from imutui.jobs.campaign.summary_document import GroupField, SummaryDocument
from imutui.jobs.quantities import plural
from imutui.logbook import atomic_file, json_text
from imutui.report import figures, fleet_figures, fleet_sentences, html, identity, plain, wrapping
from imutui.report.blocks import Article, Block, Column, Facts, Items, Page, Paragraph, Section, Subheading, Table
from imutui.report.numbers import NOTHING, ORIGIN

INDEX, SUMMARY = "index.html", "summary.json"
_FIGURE = re.compile(r"(?:\d+-)?(?:units|chart-\d+)\.(?:svg|png)")


@dataclass(frozen=True, slots=True)
class Extent:
    """How much of a fleet is told."""

    most: int  # sentences of one kind, units and logs that are listed
    others: str  # where the rest is
    is_page: bool = True  # whether it has tables of units, charts and the method too


PAGE = Extent(200, f"All are in `{SUMMARY}`, beside this page.")
TERMINAL = Extent(12, "`--json` and `--report` list all.", is_page=False)


def text(document: SummaryDocument, width: int) -> str:
    """A summary as lines of at most so many characters."""
    told = []
    for article in page(document, TERMINAL).articles:
        badge = wrapping.fill(f"{ORIGIN[article.kind].upper()}: {article.origin}", width)
        told.append(f"{article.title}\n{badge}\n\n{plain.text(article.sections, width)}")
    return "\n\n\n".join(told)


def page(document: SummaryDocument, extent: Extent = PAGE) -> Page:
    """The page of a summary.

    `document`: with or without groups: without, all logs are bad, and that is what it says.
    """
    title = f"Fleet: {document['results']}"
    left_out = Section("Logs without a result", tuple(_errors(document, extent)))
    articles = [_article(group, document, extent) for group in document["groups"]]
    if not articles:
        nothing = Section("Verdict", (Paragraph("No log has a result: there is nothing to summarise."),))
        articles = [Article(title, "unknown", "No readings are behind this page.", (nothing, left_out))]
    elif document["errors"] or document["trace_errors"]:
        articles[-1] = replace(articles[-1], sections=(*articles[-1].sections, left_out))
    return Page(title, tuple(articles))


def _article(group: GroupField, document: SummaryDocument, extent: Extent) -> Article:
    known = specification.is_known(group["instrument"])
    source = specification.of_model(group["instrument"]).source if known else "their data sheet"
    sections = [
        Section("Fleet", tuple(_fleet(group, document, extent))),
        Section(f"Which units fail {source}", (_items(fleet_sentences.limits(group), extent),)),
    ]
    if group["units"]:  # else nothing can be told of units that nothing tells apart
        sections += [
            Section("Which units drift", (_items(fleet_sentences.drifts(group), extent),)),
            Section("Which days stand out", tuple(_days(group, extent))),
            Section("Model, unit and day", tuple(_parts(group, extent))),
            *([Section("Control charts", tuple(_charts(group)))] if extent.is_page else []),
            Section("Which effects recur", tuple(_effects(group, extent))),
        ]
    sections += [Section("Method", tuple(_method(document)))] if extent.is_page else []
    title = f"Fleet of {group['instrument'] or 'instrument not stated'}"
    return Article(title, group["kind"], identity.ORIGINS[group["kind"]], tuple(sections))


def _items(sentences: list[str], extent: Extent) -> Items:
    more = len(sentences) - extent.most
    return Items((*sentences[: extent.most], *((f"And {more:,} more. {extent.others}",) if more > 0 else ())))


def _fleet(group: GroupField, document: SummaryDocument, extent: Extent) -> Iterator[Block]:
    yield Paragraph(f"{fleet_sentences.extent(group)}. {fleet_sentences.left_out(document)}")
    told = [*group["notes"], *fleet_sentences.undetermined(group), *fleet_sentences.repeats(group)]
    if told := [*told, *fleet_sentences.omissions(group)]:
        yield Items(tuple(told))
    rows = tuple(
        (str(n), unit["serial_number"], str(unit["power_ons"]), str(unit["logs"]),
         fleet_sentences.from_to(first, last) if (first := unit["first_utc"]) and (last := unit["last_utc"])
         else identity.NOT_STATED)
        for n, unit in enumerate(group["units"][: extent.most], 1)
    )  # fmt: skip
    if rows and extent.is_page:
        columns = (Column("No.", "number"), Column("Unit", "code"), Column("Power-ons", "number"),
                   Column("Logs", "number"), Column("Recorded, UTC"))  # fmt: skip
        more = f" The first {len(rows)} of {len(group['units'])}. {extent.others}"
        yield Table(columns, rows, "Units by serial number." + (more if len(group["units"]) > len(rows) else ""))


def _days(group: GroupField, extent: Extent) -> Iterator[Block]:
    yield Paragraph(fleet_sentences.charts(group))
    told = fleet_sentences.days_out(group)
    if told:
        yield _items(told, extent)
    elif any(one["chart_dof"] for one in group["channels"]):
        yield Paragraph("None does.")


def _parts(group: GroupField, extent: Extent) -> Iterator[Block]:
    together = any(one["together"] for one in group["channels"])
    between = (
        (Column("Between units and days together", "number"),)
        if together
        else (Column("Between units", "number"), Column("Between days", "number"))
    )
    columns = (Column("Channel", "code"), Column("Unit"), Column("Mean of the model", "number"), *between)
    parts = ("together",) if together else ("between_units", "between_power_ons")
    rows = tuple(
        (one["channel"], one["unit"], fleet_sentences.value(one["model"]),
         *(fleet_sentences.component(one[part]) for part in parts))  # type: ignore[literal-required]
        for one in group["channels"]
    )  # fmt: skip
    caption = (
        "Mean ± sd of the model's biases, and the standard deviations of units about the model and of power-ons about"
        " their unit, each with its interval of 95 %. An interval that begins at 0 does not tell a part from none."
    )
    yield Table(columns, rows, caption)
    if told := fleet_sentences.in_control(group):
        yield Items(tuple(told))
    if extent.is_page and (figure := fleet_figures.units(group)):
        yield figure
        yield _own(group)


def _own(group: GroupField) -> Table:
    """Value of each unit in each channel."""
    numbers = fleet_figures.numbers(group)
    shown = list(numbers)[: PAGE.most]
    values = {(unit["serial_number"], one["channel"]): fleet_sentences.value(unit["value"])
              for one in group["channels"] for unit in one["units"]}  # fmt: skip
    channels = [(one["channel"], one["unit"]) for one in group["channels"]]
    rows = tuple((serial, *(values.get((serial, channel), NOTHING) for channel, _ in channels)) for serial in shown)
    columns = (Column("Unit", "code"), *(Column(f"{channel}, {unit}", "number") for channel, unit in channels))
    return Table(columns, rows, "What each unit's power-ons scatter about, ± sd; this holds on a day not yet seen.")


def _charts(group: GroupField) -> Iterator[Block]:
    figures = fleet_figures.charts(group)
    several = sum(unit["power_ons"] > 1 for unit in group["units"])
    if not figures:
        yield Paragraph("No unit has two power-ons: there is no course to draw.")
        return
    if several > len(figures):
        yield Paragraph(
            f"Drawn are {len(figures)} of {several} units, those first of which there is most to tell. {PAGE.others}"
        )
    yield from figures


def _effects(group: GroupField, extent: Extent) -> Iterator[Block]:
    if not group["traced_logs"]:
        yield Paragraph("No log was traced: `imutui campaign --trace` does it.")
        return
    yield Paragraph(f"{plural(group['traced_logs'], 'log')} of known units traced.")
    if not group["effects"]:
        yield Paragraph("No effect was found in any.")
        return
    columns = (Column("Channel", "code"), Column("Effect"), Column("Where found"), Column("Whose"))
    rows = tuple(
        (" ".join(e["channels"]), f"{e['label']} ({e['effect']})", fleet_sentences.effect_where(e),
         fleet_sentences.LEVELS[e["level"]])
        for e in group["effects"][: extent.most]
    )  # fmt: skip
    yield Table(columns, rows, "Effects that traces found, the most frequent first.")
    of_sizes = (Column("Channel", "code"), Column("Parameter"), Column("Unit", "code"),
               Column("Mean of the model", "number"), Column("Between units", "number"),
               Column("Between days", "number"))  # fmt: skip
    sizes = tuple(
        (" ".join(e["channels"]), f"{e['effect']} {p['name']}", p["unit"], fleet_sentences.value(p["model"]),
         fleet_sentences.component(p["between_units"]), fleet_sentences.component(p["between_power_ons"]))
        for e in group["effects"][: extent.most] for p in e["params"]
    )  # fmt: skip
    if sizes:
        yield Subheading("What they amount to")
        yield Table(of_sizes, sizes, "Of logs in which the effect was found: small ones come out too large.")


def _errors(document: SummaryDocument, extent: Extent) -> Iterator[Block]:
    yield Paragraph(fleet_sentences.left_out(document))
    for told, what in ((document["errors"], "No result"), (document["trace_errors"], "No trace")):
        if told:
            yield _items([f"{what}: {one['log']}: {one['error']}" for one in told], extent)


def _method(document: SummaryDocument) -> Iterator[Block]:
    yield Paragraph(
        "A bias is taken as model + unit + day + error of measurement. The error has the standard deviation that the"
        " filter says; those of units and days are estimated by restricted maximum likelihood, and intervals are"
        " integrated over what is not known of them. ± is one standard deviation, or half the interval that holds"
        " 68 %. Simulated and measured logs are never in one estimate. All values are in the unit's own axes and sign."
    )
    yield Facts((("Rows", document["results"]), ("Made with", document["library"])))


# --------------------------------------------------------------------------------------------------------- fleet page
# A folder to hand over: the page of a fleet, its figures as files, the summary.


def may_write(name: str) -> bool:
    """Return whether a fleet's page writes a file of this name into its folder."""
    return name in (INDEX, SUMMARY) or _FIGURE.fullmatch(name) is not None


def write(folder: Path, document: SummaryDocument, *, overwrite: bool = False) -> list[Path]:
    """Write page, figures and summary into a folder.

    `folder`: made if absent.
    Returns what was written, the page first.
    Raises FileExistsError if a file exists and may not be replaced; then none is written.
    """
    made = page(document)
    contents = {INDEX: html.document(made).encode("utf-8", "replace")}
    contents[SUMMARY] = (json_text.dumps(document) + "\n").encode()
    for number, article in enumerate(made.articles, 1):
        contents |= figures.files(article, "" if len(made.articles) == 1 else f"{number}-")
    return atomic_file.write_all(folder, contents, overwrite=overwrite)

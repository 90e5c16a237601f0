"""The result of a batch on one page, with links to the pages of its units: what each comes to, why, what all share."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from filters import specification
from imutui.jobs.campaign.batch import BatchDocument, Outcome, UnitField, folder_of, is_the_tables
from imutui.jobs.campaign.common_errors import CommonField
from imutui.jobs.campaign.summary_document import LimitField
from imutui.jobs.quantities import plural
from imutui.logbook import atomic_file, json_text
from imutui.report import fleet_sentences, html, identity, plain, wrapping
from imutui.report.blocks import Article, Block, Column, Facts, Items, Page, Paragraph, Section, Table
from imutui.report.numbers import NOTHING, ORIGIN, plus_minus

INDEX, DOCUMENT = "index.html", "batch.json"
WORDS: dict[Outcome, str] = {"fail": "FAIL", "table": "table", "not_told": "not told", "pass": "pass"}


def text(document: BatchDocument, width: int) -> str:
    """The result as lines of at most so many characters."""
    (article,) = page(document, is_page=False).articles
    badge = wrapping.fill(f"{ORIGIN[article.kind].upper()}: {article.origin}", width)
    return f"{article.title}\n{badge}\n\n{plain.text(article.sections, width)}"


def page(document: BatchDocument, *, is_page: bool = True) -> Page:
    """The page of a batch; else what the terminal has of it."""
    units = document["units"]
    title = f"Batch {document['batch']}: {_count(units, 'pass')} of {plural(len(units), 'unit')} pass"
    kinds = {unit["kind"] for unit in units}
    kind = next(iter(kinds)) if len(kinds) == 1 else "simulated" if "simulated" in kinds else "unknown"
    sections = [
        Section("Units", tuple(_units(document, is_page=is_page))),
        Section("What units show together", tuple(_together(document))),
    ]
    if is_page:
        sections.append(Section("Method", tuple(_method(document))))
    return Page(title, (Article(title, kind, identity.ORIGINS[kind], tuple(sections)),))


def write(folder: Path, document: BatchDocument, *, overwrite: bool = False) -> list[Path]:
    """Write page and document into a folder; return their paths, the page first.

    Raises FileExistsError if one exists and may not be replaced; then none is written.
    """
    texts = {INDEX: html.document(page(document)), DOCUMENT: json_text.dumps(document) + "\n"}
    contents = {name: text.encode("utf-8", "replace") for name, text in texts.items()}
    return atomic_file.write_all(folder, contents, overwrite=overwrite)


def _count(units: Sequence[UnitField], outcome: Outcome) -> int:
    return sum(unit["outcome"] == outcome for unit in units)


def _units(document: BatchDocument, *, is_page: bool) -> Iterator[Block]:
    units = document["units"]
    counts = [f"{count} {WORDS[o]}" for o in WORDS if (count := _count(units, o))]
    since = min((unit["start_utc"] for unit in units if unit["start_utc"]), default="a time that is not stated")
    yield Paragraph(f"{plural(len(units), 'unit')}, recorded from {since}: {', '.join(counts)}.")
    columns = [Column("Unit", "code"), Column("Result", "code"), Column("Why")]
    rows = [[unit["name"], WORDS[unit["outcome"]], " ".join(why(unit, document))] for unit in units]
    if is_page:
        columns += [Column("Model"), Column("Lost", "number"), Column("degC", "number"), Column("Page", "link")]
        for row, unit in zip(rows, units, strict=True):
            lost, warm = unit["lost_packets"], unit["temperature_degc"]
            row += [
                unit["instrument"],
                NOTHING if lost is None else str(lost),
                NOTHING if warm is None else f"{warm[0]:.1f} to {warm[1]:.1f}",
                NOTHING if unit["verdict"] is None else f"{folder_of(unit['name'])}/{INDEX}",
            ]
    yield Table(tuple(columns), tuple(map(tuple, rows)))
    for serial in dict.fromkeys(unit["serial_number"] for unit in units):
        several = [unit["name"] for unit in units if serial and unit["serial_number"] == serial]
        if len(several) > 1:
            yield Paragraph(
                f"{len(several)} units have the same serial number, {serial}: {', '.join(several)}. They are told apart"
                " by their names in the batch, and by recordings that overlap in time. Give each unit a number of its"
                " own before the next batch."
            )
    if _count(units, "table"):
        yield Paragraph(
            "table: nothing is against the unit but what all units share. Put that right, and record it again."
        )


def why(unit: UnitField, document: BatchDocument) -> list[str]:
    """Why a unit comes to what it does, sentences."""
    told = [f"No result: {error}" for error in unit["errors"]]
    told += [f"{_limit(one)}." for one in unit["limits"] if one["verdict"] == "fails" or one["quantity"] == "bias"]
    if unit["by_itself"]:
        told.append(f"Moves by itself along {', '.join(unit['by_itself'])}, beside what all units share.")
    if shared := unit["shared_limits"]:
        told.append(f"With what all units share: {'; '.join(map(_limit, shared))}. Without it, it is within.")
    verdict = unit["verdict"]
    failed = shared or any(one["verdict"] == "fails" for one in unit["limits"])
    if verdict is not None and not failed and (not verdict["passes"] or verdict["word"] == "RED"):
        told.append(f"{verdict['word']}: {verdict['reason']}.")
    if unit["outcome"] == "table" and not shared:
        own = [document["common"][number] for number in unit["common"]]
        told.append(f"All units show it: {', '.join(_short(one) for one in own if is_the_tables(one))}.")
    told += [f"File: {damage}." for damage in unit["damage"]]
    return told or ["Nothing is against it."]


def _limit(one: LimitField) -> str:
    what = f"{one['quantity'].capitalize()} of {one['channel']} {plus_minus(one['value'], one['sd'], one['unit'])}"
    near = "" if one["verdict"] == "fails" else " is too near to tell" if one["converged"] else " has not settled"
    return f"{what}{near}, limit {one['limit']:g} {one['unit']}"


# ------------------------------------------------------------------------------------------------------ what is shared


def _together(document: BatchDocument) -> Iterator[Block]:
    common = document["common"]
    if len(document["units"]) < 2:
        yield Paragraph("There is one unit: what is the table's is not told apart from what is its own.")
    elif not common:
        yield Paragraph("Nothing: no step, drift, tilt or tone is common to them.")
    else:
        yield Items(tuple(sentence(one, len(document["units"])) for one in common))


_NAMES = {"tilt": "tilt", "gravity": "vertical", "event": "step", "drift": "drift", "tone": "tone", "noise": "noise"}
_LEAST_DEG = 0.005
_TO_DO = {
    "tilt": "Level the table, or record with a reference that has the tilt.",
    "gravity": "Is the site's gravity what was recorded with (`--gravity`)?",
    "event": "It is the table's, its supply's or the room's, no unit's: look what happened there then.",
    "drift": "It is the table's or the room's, no unit's: a table that settles, a floor that leans.",
    "tone": "It is the table's, its supply's or the room's, no unit's: a drive, a fan, a pump, mains.",
    "noise": "Look for what shakes the table before a unit is blamed.",
}


def _short(one: CommonField) -> str:
    return f"{_NAMES[one['kind']]} along {', '.join(size['axis'] for size in one['sizes'])}"


def sentence(one: CommonField, units: int) -> str:
    """A common error in sentences: what, when, how large, in which units, whose it is, what to do."""
    sizes = ", ".join(f"{size['axis']} {size['value']:.3g} {size['unit']}" for size in one["sizes"])
    who = (
        "all units"
        if len(one["units"]) == units
        else f"{len(one['units'])} of {units} units ({', '.join(one['units'])})"
    )
    tilts = zip(one["tilt_deg"] or (), ("north", "east"), strict=False)
    leans = " and ".join(f"{deg:.2f} deg about {axis}" for deg, axis in tilts if abs(deg) >= _LEAST_DEG)
    match one["kind"]:
        case "tilt":
            said = f"The table leans by {leans}, in {who} ({sizes})."
            if not one["told_apart"]:
                said += (
                    " All are mounted alike, and a bias that all had would look the same: turn some of them to tell."
                )
        case "gravity":
            said = f"Along the vertical, in {who}: {sizes}."
        case "event":
            ends = " and stays" if one["end_utc"] is None else f", until {one['end_utc']}"
            as_if = f", as if the table leant by {leans}" if leans else ""
            said = f"Step at {one['start_utc']}{ends}, in {who}: {sizes}{as_if}."
        case "drift":
            said = f"Drift alike, in {who}: {sizes} rms."
            if one["follows_temperature"]:
                return (
                    f"{said} It follows their temperature: the room's, or their warming up. Record when that is steady."
                )
        case "tone":
            said = f"Tone at {one['hz']:.2f} Hz, in {who}: {sizes} rms."
            if one["in_step"] is False:
                return f"{said} Each has a phase of its own: it is in the units, such as a frequency of their model."
        case "noise":
            said = f"Noise above the sheet, in {who}: {sizes}."
    return f"{said} {_TO_DO[one['kind']]}"


def _method(document: BatchDocument) -> Iterator[Block]:
    known = [unit["instrument"] for unit in document["units"] if specification.is_known(unit["instrument"])]
    sheets = dict.fromkeys(map(fleet_sentences.limits_of, known)) or ["their data sheet, which is not known"]
    yield Paragraph(
        "A unit fails if a bias that has settled, or its white noise, is beyond the limit by three standard deviations,"
        f" of: {'; '.join(sheets)}; or if the verdict on its filter is RED. What all units, or three of four, show in"
        " the same sense along one of the table's axes at one time is the table's, the room's or their supply's: of"
        " batches without it, fewer than one in a hundred are said to have it. Axes wx to fz are the table's north,"
        " east and down, rates and specific forces; channels gx to az are the unit's own."
    )
    yield Facts((("Rows", document["results"]), ("Made with", document["library"])))

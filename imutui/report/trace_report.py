"""A trace as an article: the answer at a glance, what to do, causes, error, figures, whose unit, method."""

from collections.abc import Iterator
from dataclasses import replace
from typing import cast

from filters.tracing.trace_document import TraceDocument
from imutui.jobs.investigation_diary import DiaryDocument
from imutui.jobs.page_data import LogData
from imutui.report import data_quality, filter_figures, how_to_apply, identity, trace_figures, trace_tables
from imutui.report.blocks import (
    Article,
    Block,
    Code,
    Column,
    Facts,
    Figure,
    Items,
    Paragraph,
    Section,
    Subheading,
    Table,
)
from imutui.report.trace_glance import Places

EXPERIMENT = "experiment.toml"
_PLACES = Places(
    "`effects.toml` beside this page has them",
    f"Its profile is `{EXPERIMENT}`; its text stands at the end of this page",
    "beside this page",
)
NO_DATA = LogData()


def article(d: TraceDocument, log: LogData = NO_DATA) -> Article:
    """All that is said of a trace."""
    logs = [identity.of_run(run) for run in d["runs"]]
    kind = identity.kind_of(logs)
    glance, *tables, notes = trace_tables.sections(d, _PLACES)
    damage = [Paragraph(f"Damaged: {sentence}") for sentence in d["damage"]]
    error = trace_figures.error_figure(d)
    made = [
        replace(glance, blocks=(*glance.blocks, *damage)),
        *tables,
        Section("Figures", (*([error] if error else []), *_figures(d, log))),
        identity.section(logs, d["library"]),
        how_to_apply.of_trace(d, log),
        data_quality.of_trace(d, log),
        Section("Method and provenance", tuple(_method(d))),
        notes,
        Section("Diary", tuple(_diary(cast("DiaryDocument | None", d["diary"])))),
    ]
    title = d["source"]
    sections = tuple(section for section in made if section.blocks)
    return Article(title[:1].upper() + title[1:], kind, identity.ORIGINS[kind], sections)


def _figures(d: TraceDocument, log: LogData) -> Iterator[Figure | Paragraph]:
    yield from trace_figures.of_drivers(log.driver_curves)
    yield from trace_figures.figures(d)
    for n, course in enumerate(log.courses, 1):
        yield filter_figures.biases(course, d["runs"][-1]["rate_hz"], f"convergence-{n}")
    if found := filter_figures.nis(log.courses, "nis"):
        yield found
    yield from (Paragraph(sentence) for sentence in log.missing)
    if all(run["reference"] == "turned" for run in d["runs"]):
        yield Paragraph(
            "There is no residual over time: of a unit that was turned by hand the motion between rests is not known."
            " The errors above are those of its rests and turns."
        )


def _method(d: TraceDocument) -> Iterator[Block]:
    yield Paragraph(
        "Each log was compared with what a perfect unit would read under its reference. Of what is left, physical"
        " effects were fitted and chosen one after the other on evidence that the fit had not seen; then the error was"
        " measured without them (before) and with all of them (after). Intervals are of 95 %; ± is one standard"
        " deviation. All values are in the unit's own axes and sign: corrected reading = reading − effect."
    )
    runs = d["runs"]
    rows = (
        ("Reference", ", ".join(sorted({run["reference"] for run in runs}))),
        ("Accelerometer sign", ", ".join(sorted({f"{run['accel_sign']:+d}" for run in runs}))),
        ("Mounting (table x, y, z)", ", ".join(sorted({run["mount"] for run in runs}))),
        ("Seed of everything random", str(d["seed"])),
        ("Result document", f"version {d['version']}, beside this page as `result.json`"),
    )
    yield Facts(rows)
    if d["separating_experiment"] is not None:
        yield Subheading(f"`{EXPERIMENT}`, the motion that would tell the causes apart")
        yield Code(d["separating_experiment"]["profile"])


_OUTCOMES = {
    "explained": "It ended when every channel was explained, and the run that judges confirmed it.",
    "not_here": "It ended when no motion of this table was expected to tell a bit more.",
    "time": "It ended with its time, before all was explained.",
    "": "It has not ended.",
}


def _diary(diary: DiaryDocument | None) -> Iterator[Block]:
    """The investigation that the runs are of: why each motion, what was expected, what came."""
    if diary is None:
        return
    minutes = f"{diary['spent_s'] / 60.0:.0f} of {60.0 * diary['hours']:.0f} min"
    yield Paragraph(
        f"A table under command made these runs in {minutes}. After each trace the motion was chosen that was expected"
        f" to tell most for its time. {_OUTCOMES[diary['outcome']]}"
    )
    columns = (
        *(Column("Begins, min", "number"), Column("Motion"), Column("Takes, min", "number"), Column("Why")),
        *(Column("Bits expected", "number"), Column("What came"), Column("Log", "file")),
    )
    yield Table(
        columns,
        tuple(
            (
                *(f"{r['start_s'] / 60.0:.0f}", r["motion"], f"{r['minutes']:.1f}", r["why"]),
                *(f"{r['expected_bits']:.1f}" if r["expected_bits"] else "", r["came"], r["log"]),
            )
            for r in diary["rounds"]
        ),
    )
    if diary["takes"]:
        yield Subheading("What it would take to explain the rest")
        yield Items(tuple(diary["takes"]))

"""`imutui campaign --summary`: a fleet's summary as text, JSON, and a page."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from imutui.cli.report import check_folder

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from imutui.jobs.campaign.summary_document import ChannelField, EffectField, GroupField, SummaryDocument

_MOST = 12
"""Sentences of one kind, and errors, in the terminal; the document and the page have all."""


def summarise(results: Path, report: Path | None, *, force: bool, json: bool) -> None:
    """Print the summary of a campaign's rows, and write its page.

    `results`: folder of a campaign, or its `results.json`.
    `report`: folder for the page.
    `force`: replace a page that is there.
    `json`: print the document instead of text.
    Raises UnreadableLogError if `results` holds no rows.
    Raises typer.Exit with 1 if no row has a result, with 2 if the page cannot or must not be made.
    """
    from imutui.cli.exit_codes import FINDINGS, fail, say
    from imutui.jobs.campaign import row_file, summary
    from imutui.logbook.json_text import dumps

    if report is not None:
        check_folder(report, force, "--report")
    rows = row_file.read(results)
    document = summary.summary(rows, str(row_file.path_of(results)))
    if report is not None:
        from imutui.report import fleet_report

        say(f"imutui: {fleet_report.write(report, document)[0]}: page of the fleet")
    if json:
        print(dumps(document))
    else:
        print_summary(document)
    if not document["groups"]:
        why = f"none of {len(rows):,} logs has a result, so that there is nothing to summarise"
        raise fail(FINDINGS, f"{results}: {why}. The reasons are above; `imutui check LOG` tells more.")


def print_summary(document: "SummaryDocument") -> None:
    """Print a summary for people on stdout, 80 columns wide where the terminal is no wider."""
    from rich.console import Console

    from imutui.report import fleet_sentences

    console = Console(highlight=False, markup=False, emoji=False)
    for group in document["groups"]:
        _print_group(console, group)
    lines = [fleet_sentences.left_out(document)]
    for told, what in ((document["errors"], "error"), (document["trace_errors"], "no trace")):
        lines += _shortened([f"{what}: {one['log']}: {one['error']}" for one in told])
    _lines(console, lines)


def _print_group(console: "Console", group: "GroupField") -> None:
    from filters import specification
    from imutui.report import fleet_sentences, numbers

    console.rule(f"{fleet_sentences.name(group)}, {numbers.ORIGIN[group['kind']]}", align="left", characters="─")
    _lines(console, [fleet_sentences.extent(group), *group["notes"]])
    source = specification.of_model(group["instrument"]).source
    if not group["units"]:  # no estimate can be: what is held to the limits is each log
        _lines(console, ["", source])
        _lines(console, [*_shortened(fleet_sentences.limits(group)), ""], indent=True)
        return
    for title, told in (
        (source, fleet_sentences.limits(group)),
        ("Drift", fleet_sentences.drifts(group)),
        ("Days that stand out", fleet_sentences.days_out(group) or [_no_day(group)]),
    ):
        _lines(console, ["", title])
        _lines(console, _shortened(told), indent=True)
    _lines(console, ["", "Model, unit and day (mean ± sd; standard deviations with 95 % interval)"])
    console.print(_parts(group["channels"]))
    about = [*fleet_sentences.undetermined(group), *fleet_sentences.in_control(group)]
    _lines(console, [*about, *fleet_sentences.repeats(group), *fleet_sentences.omissions(group)], indent=True)
    if group["effects"]:
        _lines(console, ["", "Effects that recur"])
        console.print(_effects(group["effects"][:_MOST]))
    _lines(console, [""])


def _no_day(group: "GroupField") -> str:
    from imutui.report import fleet_sentences

    charted = any(one["chart_dof"] for one in group["channels"])
    return "None: every power-on is within 3 σ of its unit's others." if charted else fleet_sentences.charts(group)


def _lines(console: "Console", told: Sequence[str], *, indent: bool = False) -> None:
    """Sentences, what is too long continued below itself."""
    import textwrap

    from rich.text import Text

    from imutui.plain_text import visible

    margin = "  " if indent else ""
    for sentence in told:
        # names of files are left whole, so that they can be copied
        lines = textwrap.wrap(visible(sentence), console.width, initial_indent=margin, subsequent_indent=margin,
                              break_long_words=False, break_on_hyphens=False)  # fmt: skip
        console.print(Text("\n".join(lines)), soft_wrap=True)


def _shortened(told: Sequence[str]) -> list[str]:
    more = len(told) - _MOST
    return [*told[:_MOST], *([f"and {more:,} more, which --json and --report list"] if more > 0 else [])]


def _parts(channels: Sequence["ChannelField"]) -> "Table":
    from rich.table import Table

    from imutui.report import fleet_sentences

    together = any(one["together"] for one in channels)
    heads = ("between units and days",) if together else ("between units", "between days")
    table = Table("", "unit", "model", *heads, box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for column in table.columns[2:]:
        column.justify = "right"
    for one in channels:
        parts = (one["together"],) if together else (one["between_units"], one["between_power_ons"])
        spreads = [fleet_sentences.component(part, " ") for part in parts]
        table.add_row(one["channel"], one["unit"], fleet_sentences.value(one["model"]), *spreads)
    return table


def _effects(effects: Sequence["EffectField"]) -> "Table":
    from rich.table import Table
    from rich.text import Text

    from imutui.plain_text import visible
    from imutui.report import fleet_sentences

    table = Table("", "effect", "where found", "whose", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for one in effects:
        where, whose = fleet_sentences.effect_where(one), fleet_sentences.LEVELS[one["level"]]
        sizes = [f"{p['name']} {fleet_sentences.value(p['model'], p['unit'])}" for p in one["params"] if p["model"]]
        cells = (" ".join(one["channels"]), "\n".join([one["label"], *sizes]), where, whose)
        table.add_row(*(Text(visible(cell)) for cell in cells))
    return table

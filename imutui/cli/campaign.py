"""`imutui campaign`."""

import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.each_log import width
from imutui.cli.exit_codes import (
    FINDINGS,
    FINE,
    USAGE,
    answer,
    check_output,
    fail,
    lacking,
    refuse_existing,
    say,
    say_if_not_kept,
    show_progress,
)
from imutui.cli.options import Effects, FilterName, Json, Reference, Set, effects_of, overrides_of, reference_of
from imutui.cli.report import check_folder, names_in, say_replaced

if TYPE_CHECKING:
    from imutui.jobs.campaign.log_list import LogList
    from imutui.jobs.campaign.run import Pace, RunDocument, Way


_LIVE_S, _SPARSE_S = 0.1, 60.0


def command(
    logs: Annotated[
        list[str] | None,
        typer.Argument(metavar="DIR|GLOB...", help="Folders, of which all *.mcap are taken, logs, or quoted patterns."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="RESULTS", help="Folder for the results.")
    ] = None,
    trace: Annotated[bool, typer.Option("--trace", help="Trace each log too, on its own.")] = False,
    workers: Annotated[
        int | None,
        typer.Option("--workers", metavar="N", help="Processes on this machine; as many as it has cores unless given."),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option("--cluster", metavar="tcp://HOST:PORT", help="Scheduler of dask, whose workers do the work."),
    ] = None,
    shard: Annotated[
        str | None,
        typer.Option("--shard", metavar="I/N", help="Part I of N of the logs, from 1/N to N/N, chosen by their paths."),
    ] = None,
    filter_name: FilterName = None,
    reference: Reference = None,
    effects: Effects = None,
    set_: Set = None,
    summary: Annotated[
        Path | None,
        typer.Option("--summary", metavar="RESULTS", help="Compute nothing: tell what the rows of RESULTS say."),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="DIR", help="With --summary: folder for a page of it.")
    ] = None,
    retry: Annotated[
        bool, typer.Option("--retry", help="Try rows with an error again though nothing changed.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Compute all rows anew; replace a page.")] = False,
    json: Json = False,
) -> None:
    """Run the filter over many logs, on this machine, on a cluster or in shards: a row of results for each.

    RESULTS is a folder: results.json, and results.parquet where pyarrow is installed. Rows that are there stay, unless
    their log or the settings changed: run it again to go on after an interruption, or with logs that are new. A log
    that cannot be read is a row with its error. --summary tells which units drift or fail, and which effects recur.

    Exit code 0: every log converged and is whole, 1: some did not, or have an error.

    Example: imutui campaign logs -o results
    """
    if summary is not None:
        if logs or output is not None:
            raise fail(USAGE, "--summary computes nothing: it takes no logs and no -o. Run the campaign first.")
        _summarise(summary, report, force=force, json=json)
        return
    from imutui import config
    from imutui.jobs.campaign import log_list, stored_rows
    from imutui.jobs.campaign.one_log import Settings
    from imutui.jobs.campaign.run import Campaign, run
    from imutui.logbook.reading import Reading

    if not logs or output is None:
        raise fail(USAGE, "what is asked for? Name logs and -o RESULTS, or --summary RESULTS. imutui campaign -h")
    if report is not None:
        raise fail(USAGE, "--report goes with --summary: first the campaign, then its page.")
    if workers is not None and (cluster is not None or workers < 1):
        raise fail(USAGE, f"--workers is {workers}: it takes 1 or more, and goes without --cluster, which has its own.")
    part = None if shard is None else log_list.parse_shard(shard)
    check_results(output, force)
    file, name = reference_of(reference)
    overrides = overrides_of(filter_name, name, set_ or [])
    settings = Settings(Reading(overrides=overrides, reference=file, effects=effects_of(effects)), trace)
    head = stored_rows.head_of(output)
    found = log_list.find(logs)
    found = found if head is None else found.below(head["root"])
    campaign = Campaign(found, settings, output, part, retry, force, config.load().file_mode)
    say_if_not_kept()
    try:
        document = run(campaign, _way(found, workers, cluster), _progress())
    except KeyboardInterrupt:
        say(f"imutui: {_rows_in(output)}; the same command goes on from there.")
        raise
    if document["table"] is None:
        say_no_table()
    answer(document, lambda: campaign_words(document), json=json)
    raise typer.Exit(FINDINGS if document["errors"] or document["not_fine"] else FINE)


def _rows_in(results: Path) -> str:
    """How many rows are kept in a folder of results, of these settings."""
    from filters.errors import InputError
    from imutui.jobs.campaign import stored_rows
    from imutui.jobs.quantities import that_many

    try:
        count = len(stored_rows.read(results).rows)
    except (OSError, InputError):  # interrupted before there was one
        count = 0
    return f"{that_many(count, 'row', 'is', 'are')} kept in {results}"


def _way(found: "LogList", workers: int | None, address: str | None) -> "Way":
    from imutui.jobs.campaign import cluster, local

    if address is None:
        return partial(local.rows, workers=workers or len(os.sched_getaffinity(0)))
    if not cluster.available():
        raise lacking("--cluster takes dask.distributed", "cluster")
    return partial(cluster.rows, address=address, root=found.root, say=lambda text: say(f"imutui: {text}"))


def _progress() -> "Callable[[Pace], None]":
    """Show how far it is: in place on a terminal, else a line now and then."""
    live = sys.stderr.isatty()
    shown = time.monotonic() if not live else 0.0

    def show(pace: "Pace") -> None:
        nonlocal shown
        now = time.monotonic()
        over = pace.done == pace.wanted
        if live and (over or not pace.done or now - shown >= _LIVE_S):
            show_progress("" if over else progress_text(pace))
            shown = now
        elif not live and now - shown >= _SPARSE_S:
            say(f"imutui: {progress_text(pace)}")
            shown = now

    return show


def progress_text(pace: "Pace") -> str:
    """How many logs are done, how many of these have an error, how fast, and how long it will take."""
    words = [f"{pace.done:,} of {pace.wanted:,} logs"]
    if not pace.done:
        words.append("workers start: the first time on a machine they compile the filter, some seconds")
    if pace.errors:
        words.append(f"{pace.errors:,} with an error")
    if (rate := pace.per_second()) is not None:
        words += [f"{60.0 * rate:,.0f} a minute", f"{_duration((pace.wanted - pace.done) / rate)} left"]
    return ", ".join(words)


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


def check_results(folder: Path, force: bool) -> None:
    """Raise the exit for a folder that -o names and that can't be made, or is none; no folder above it is made."""
    if folder.exists() and not folder.is_dir():
        raise fail(USAGE, f"{folder} is a file; -o names a folder.")
    if not folder.exists():
        check_output(folder, force=False)
    from imutui.jobs.campaign import results_folder

    if not results_folder.has_results(folder):
        refuse_existing(folder / results_folder.TABLE, force, "name another folder with -o")


def say_no_table() -> None:
    """Say why there is no `results.parquet`."""
    from imutui.cli.installed_from import command_for

    say(f"imutui: results.parquet is left out: it takes pyarrow, which is not installed here: {command_for('cluster')}")


def campaign_words(document: "RunDocument") -> str:
    """What a run has come to, some lines."""
    from imutui.jobs.quantities import plural, that_many

    made = f"{document['computed']:,} computed, {document['kept']:,} kept"
    pace = "" if document["per_minute"] is None else f" ({document['per_minute']:,.0f} a minute once workers were warm)"
    head = f"{document['results']}: {counted(document['logs'], document['errors'], document['not_fine'])}"
    lines = [head, f"{made}, in {_duration(document['wall_s'])}{pace}"]
    lines += [f"error: {error}" for error in document["first_errors"]]
    more = document["errors"] - len(document["first_errors"])
    if more > 0:
        lines.append(f"{that_many(more, 'more error', 'is', 'are')} in results.json")
    if document["beyond"]:
        lines.append(f"{that_many(document['beyond'], 'row', 'is', 'are')} of logs that were not asked for; they stay")
    if document["other_settings"]:
        lines.append(f"{that_many(document['other_settings'], 'row', 'is', 'are')} of other settings and left out")
    if document["broken_lines"]:
        lines.append(f"{plural(document['broken_lines'], 'line')} of rows.jsonl could not be read; computed again")
    return "\n".join(lines)


def counted(logs: int, errors: int, not_fine: int) -> str:
    """How many logs there are, and how many of them are not as they should be."""
    from imutui.jobs.quantities import plural

    words = [plural(logs, "log")]
    if errors:
        words.append(f"{errors:,} with an error")
    if not_fine:
        words.append(f"{not_fine:,} not converged, RED or damaged")
    return ", ".join(words if errors or not_fine else [*words, "all fine"])


def _summarise(results: Path, report: Path | None, *, force: bool, json: bool) -> None:
    """Print the summary of a campaign's rows, and write its page.

    Raises UnreadableLogError if `results` holds no rows.
    Raises typer.Exit with 1 if no row has a result, with 2 if the page cannot or must not be made.
    """
    from imutui.jobs.campaign import stored_rows, summary
    from imutui.report import fleet_report

    if report is not None:
        check_folder(report, force, "--report", fleet_report.may_write)
    rows = stored_rows.rows_of(results)
    document = summary.summary(rows, str(stored_rows.path_of(results)))
    if report is not None:
        before = names_in(report)
        written = fleet_report.write(report, document, overwrite=force)
        say_replaced(report, before, written)
        say(f"imutui: {written[0]}: page of the fleet")
    answer(document, lambda: fleet_report.text(document, width()), json=json)
    if not document["groups"]:
        why = f"none of {len(rows):,} logs has a result, so that there is nothing to summarise"
        raise fail(FINDINGS, f"{results}: {why}. The reasons are above; `imutui check LOG` tells more.")

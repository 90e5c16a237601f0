"""`imutui trace`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.each_log import progress, width
from imutui.cli.exit_codes import FINDINGS, FINE, USAGE, answer, check_output, fail, in_signs, say, say_if_not_kept
from imutui.cli.options import Force, Json, Output, ReadAs, Reference, reference_of, say_assumed, states_reading
from imutui.cli.report import check_folder, write_page

if TYPE_CHECKING:
    from filters.tracing.trace_document import TraceDocument


@states_reading
def command(
    read_as: ReadAs,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs of one unit; each is one power-on.")],
    holdout: Annotated[
        Path | None,
        typer.Option("--holdout", metavar="LOG", help="Run to which nothing is fitted; else the last of several logs."),
    ] = None,
    reference: Reference = None,
    output: Output = None,
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="DIR", help="Folder for a page with figures, and the separating experiment."),
    ] = None,
    about: Annotated[
        list[str] | None,
        typer.Option("--about", metavar="EFFECT", help="Effect whose smallest size is wanted that these logs show."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of everything random.")] = 0,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find what the model of the unit lacks: residual, effect, filter with the effect, error before and after.

    Give runs that differ: a cold start, a warm one, another motion. -o writes the effects for the filter.

    Example: imutui trace cold.mcap warm.mcap check.mcap -o effects.toml --report report
    """
    from imutui.jobs.trace import trace
    from imutui.report import trace_tables
    from imutui.report.page import may_write

    if seed < 0:
        raise fail(USAGE, f"--seed is {seed}; it must not be negative.")
    # before minutes are spent on it
    if output is not None:
        check_output(output, force, *logs)
    if report is not None:
        check_folder(report, force, "--report", may_write)
    file, name = reference_of(reference)
    reading = read_as(
        overrides={} if name is None else {"reference": name},
        reference=file,
    )
    say_if_not_kept()
    document = trace(
        logs,
        reading,
        progress,
        lambda text: say(text) if text else None,
        holdout=holdout,
        about=tuple(about or ()),
        seed=seed,
    )
    for entry in document["runs"]:
        say_assumed(Path(entry["log"]), entry["assumed"])
    for sentence in document["damage"]:
        say(f"imutui: {sentence}")
    answer(
        document,
        lambda: trace_tables.text(document, document["source"], width(), signs=in_signs),
        json=json,
    )
    written = [] if output is None else _write_effects(output, document, force)
    if report is not None:
        own = [path.name for path in written if path.parent.resolve() == report.resolve()]
        write_page(report, [document], force=force, own=own)
    raise typer.Exit(FINDINGS if document["damage"] else FINE)


def _write_effects(output: Path, document: "TraceDocument", force: bool) -> list[Path]:
    """Write the effects file, and beside it the motion of the separating experiment; return what was written."""
    from filters.effects import plain_names
    from imutui.logbook import atomic_file, effects_file

    atomic_file.write(output, document["effects_file"], overwrite=force)
    included = effects_file.parse(document["effects_file"].encode()).effects
    if included:
        names = "; ".join(plain_names.on_channels(effect.effect, effect.channels) for effect in included)
        say(f"imutui: {output}: {names}")
    else:
        say(f"imutui: {output}: no effect; with it the filter is what it is without")
    experiment = document["separating_experiment"]
    if experiment is not None:
        beside = output.with_name("experiment.toml")
        there = " (replaced)" if beside.exists() else ""
        try:
            atomic_file.write(beside, experiment["profile"], overwrite=force)
            say(f"imutui: {beside}: the motion that would separate the causes{there}")
            return [output, beside]
        except FileExistsError:
            say(
                f"imutui: {beside} exists and is left as it is: it is another trace's motion, and this one's is not"
                " saved; --force replaces it, or name -o in another folder"
            )
    return [output]

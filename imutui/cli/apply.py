"""`imutui apply`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.each_log import progress, width
from imutui.cli.exit_codes import FINDINGS, FINE, answer, check_output, say, say_if_not_kept
from imutui.cli.options import Force, Json, ReadAs, Reference, reference_of, say_assumed, states_reading

if TYPE_CHECKING:
    from imutui.jobs.apply import Applied


@states_reading
def command(
    read_as: ReadAs,
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log to correct; it stays as it is.")],
    effects: Annotated[
        Path,
        typer.Option("--effects", metavar="FILE", help="Effects to take out, a file that `imutui trace -o` wrote."),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Log to write.")],
    reference: Reference = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write a log as a corrected unit would have read it, for programs that know nothing of effects.

    Corrected reading = reading - effect, with the values in the file. Drifts stay, since only a filter follows them,
    and so do biases. Packets as received are not in the new log; all else is, and its metadata says what was done.

    Example: imutui apply logs/sample.mcap --effects effects.toml -o corrected.mcap
    """
    from imutui import config
    from imutui.document_shape import VERSION
    from imutui.jobs import apply as job
    from imutui.logbook import effects_file

    check_output(output, force, log)
    content = effects_file.from_file(effects)
    file, kind = reference_of(reference)
    overrides = {} if kind is None or file is not None else {"reference": kind}
    reading = read_as(
        overrides=overrides,
        reference=file,
    )
    say_if_not_kept()
    made = job.apply(
        log, content, output, reading=reading, overwrite=force,
        mode=config.load().file_mode, progress=lambda share: progress(share, str(log)),
    )  # fmt: skip
    say_assumed(log, made.assumed)
    if made.damage:
        say(f"imutui: warning: {log}: {made.damage}. All before that is corrected.")
    if made.other_unit:
        say(f"imutui: warning: {log}: {made.other_unit}.")
    document = {
        "version": VERSION, "log": str(log), "output": str(output), "effects": str(effects), "samples": made.samples,
        "set_aside": made.set_aside, "corrected": list(made.corrected), "left": list(made.left),
        "largest": made.largest, "damage": made.damage, "other_unit": made.other_unit,
        "assumed": list(made.assumed),
    }  # fmt: skip
    answer(document, lambda: _text(output, made), json=json)
    raise typer.Exit(FINDINGS if made.damage else FINE)


def _text(output: Path, made: "Applied") -> str:
    import textwrap

    lines = [f"{output}: {made.samples} samples; taken out: {'; '.join(made.corrected) or 'nothing'}."]
    units = {"g": "deg/s", "a": "mg"}
    sizes = [f"{name} {value:.3g} {units[name[0]]}" for name, value in made.largest.items() if value]
    if sizes:
        lines.append(f"Largest correction: {', '.join(sizes)}.")
    if made.set_aside:
        lines.append(f"{made.set_aside} samples are no readings by the file, and are marked so.")
    if made.left:
        lines.append(f"Left in: {'; '.join(made.left)}.")
    return "\n".join(textwrap.fill(line, width()) for line in lines)

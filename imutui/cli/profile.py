"""`imutui profile`."""

import shutil
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.exit_codes import UNREADABLE, USAGE, answer, check_output, fail, say
from imutui.cli.options import Force, Json, Output

if TYPE_CHECKING:
    from imutui.jobs.operator_steps import Offer, OperatorStep


def command(
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE|NAME]", help="Table profile, TOML or CSV, or a ready-made one's name; else a list."
        ),
    ] = None,
    output: Output = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Show a table profile as a list for an operator: what to do, and what each segment makes testable.

    The same list guides in the terminal UI (5 Table). Without a file: the ready-made profiles, whose names do wherever
    a profile's file does, and those here and in the logs folder. -o writes the profile to a file, to be changed.

    Example: imutui profile "six positions, 30 s each" -o six.toml
    """
    from imutui.jobs import operator_steps

    if file is None:
        if output is not None:
            raise fail(USAGE, '-o needs a profile to write: imutui profile "six positions, 30 s each" -o six.toml')
        from imutui.config import load

        found = operator_steps.offers([Path(), Path(load().text("paths.logs"))])
        answer([_row(offer) for offer in found], lambda: _listed(found), json=json)
        return
    offer = operator_steps.offer_of(file)
    if offer.error:
        raise fail(UNREADABLE, f"{file}: {offer.error}. `imutui profile` lists what there is.")
    if output is not None:
        _export(offer, output, force)
        return
    profile = operator_steps.load(offer.file, offer.text)
    steps = operator_steps.steps(profile)
    answer(operator_steps.document(profile, offer.name, steps), lambda: _text(offer, steps), json=json)


def _export(offer: "Offer", output: Path, force: bool) -> None:
    from imutui.logbook import atomic_file

    suffix = Path(offer.file).suffix
    if output.suffix.lower() != suffix.lower():
        raise fail(USAGE, f"{output} does not end in {suffix}, as a profile of this kind does.")
    check_output(output, force)
    atomic_file.write(output, offer.text, overwrite=force)
    say(f"imutui: {output}: {offer.name}, {offer.segments} segments, joined by {offer.align}")


def _row(offer: "Offer") -> dict[str, object]:
    return {
        "name": offer.name,
        "place": offer.place,
        "segments": offer.segments,
        "duration_s": offer.seconds,
        "align": offer.align,
        "error": offer.error or None,
    }


def _listed(found: "list[Offer]") -> str:
    width = max(len(offer.name) for offer in found)
    lines = []
    for offer in found:
        what = (
            f"can't be used: {offer.error}" if offer.error else f"{offer.segments:3d} segments {offer.seconds:6.0f} s"
        )
        lines.append(f"{offer.name:<{width}}  {what}  {offer.place}")
    return "\n".join(lines)


def _text(offer: "Offer", steps: "list[OperatorStep]") -> str:
    width = min(100, shutil.get_terminal_size((80, 24)).columns)
    lines = [f"{offer.name}: {offer.segments} segments, {offer.seconds:.0f} s of motion, joined by {offer.align}", ""]
    for number, step in enumerate(steps, 1):
        lines.append(f"{number:3d}  {step.text}, {step.seconds:g} s")
        shows = "; ".join(step.shows) or "nothing new by itself"
        lines += textwrap.wrap(f"makes testable: {shows}", width, initial_indent=" " * 5, subsequent_indent=" " * 7)
    return "\n".join(lines)

"""`imutui record`."""

from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.exit_codes import USAGE, check_output, fail
from imutui.cli.foxglove import check
from imutui.cli.options import (
    Effects,
    Flags,
    Force,
    Json,
    Limits,
    Name,
    Output,
    Reference,
    SiteText,
    YesMove,
    effects_of,
    parse_site,
    reference_of,
    takes_settings,
)
from imutui.instrument.names import NAMES


@takes_settings()
def command(
    *,
    port: Annotated[
        str | None, typer.Option("--port", help='Path such as /dev/ttyUSB0, stable id, pyserial URL, or "virtual".')
    ] = None,
    batch: Annotated[
        Path | None,
        typer.Option(
            "--batch",
            metavar="FILE",
            help="Units of a table, all at once; with --name those only, with commas between them, and with --port"
            " that one there.",
        ),
    ] = None,
    instrument: Annotated[
        str | None,
        typer.Option("--instrument", metavar="|".join(NAMES), help="Which unit it is; unless given, it is asked."),
    ] = None,
    flags: Flags,
    duration: Annotated[
        float | None, typer.Option("--duration", metavar="S", help="End so many seconds after the first packet.")
    ] = None,
    reference: Reference = None,
    effects: Effects = None,
    note: Annotated[str, typer.Option("--note", help="Goes into the file and its name.")] = "",
    controller: Annotated[
        str | None,
        typer.Option(
            "--controller",
            metavar="URL",
            help="Controller of the table, such as acutrol://HOST:PORT: its angles are recorded, and a profile given"
            " as the reference is run on it.",
        ),
    ] = None,
    limits: Limits = "",
    yes_move: YesMove = False,
    name: Name = None,
    unattended: Annotated[
        bool,
        typer.Option(
            "--unattended",
            help="For a service: exit code 0 whenever the recording is complete, whatever the filter found; each file"
            " names the one before it.",
        ),
    ] = False,
    output: Output = None,
    site: SiteText = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Acquire and record; this terminal follows it.

    The acquisition is a process of its own: it lives on if this terminal closes, and `imutui attach` finds it again.
    Ctrl+C finishes the file. A unit that falls silent is waited for; one that is silent at the end is told, with exit
    code 4. A recording in several files loses no packet between them; the filter begins anew with
    each, so that each replays by itself.

    Of a batch each unit has its own acquisition, named BATCH:UNIT, and its own log: one that fails keeps no other from
    its work. Asked again, it starts what does not run; the same with --name exchanges one while the others go on. What
    the first command asked holds for a unit that joins, unless its own command says otherwise.

    With --controller a profile with align = "marks" runs by itself, once somebody has said that the table may move:
    each segment begins when the table is there. The recording ends with the profile, or with --duration; the table is
    left where it is, its mode off. Ctrl+C, a lost link, a unit that falls silent, a fault: the table is stopped.

    Example: imutui record --port /dev/ttyUSB0 --rate 20 --note "table level"
    """
    from imutui import config
    from imutui.cli.follow_acquisition import follow
    from imutui.cli.session_options import may_move, plan_from
    from imutui.logbook import import_reference
    from imutui.session.plan import VIRTUAL_PORT

    if batch is None and port is None:
        raise fail(USAGE, "say which unit: --port; or --batch FILE for several. `imutui devices --probe` lists both.")
    if batch is not None and port is not None and (name is None or "," in name):
        raise fail(USAGE, "--port is of one unit: of a batch say with --name which one it is that is now there.")
    if batch is not None and output is not None:
        raise fail(USAGE, "-o is of one unit; with --batch each file is named in the logs folder.")
    if batch is not None and controller is not None:
        raise fail(USAGE, "--controller is of one unit; units of a batch are recorded while one of them commands.")
    if output is not None:
        check_output(output, force)
    file, kind = reference_of(reference)
    settings = flags if kind is None else flags | {"filter.reference": kind}
    plan = plan_from(
        config.load().with_flags(settings),
        parse_site(site),
        checked=batch is None,
        port=port or "",
        instrument=instrument or "",
        virtual=("--instrument", instrument) if instrument and port == VIRTUAL_PORT else (),
        record=True,
        duration_s=duration,
        note=note,
        name=(None if batch else name) or "default",
        unattended=unattended,
        output=str(Path(output).resolve()) if output is not None else "",
        overwrite=force,
        controller=controller or "",
        limits=limits,
        yes_move=yes_move,
        reference_file=("", "")
        if file is None
        else (import_reference.name_of(str(reference)), file.content.decode("utf-8-sig")),
        effects=(effects_of(effects) or b"").decode("utf-8-sig"),
    )
    if plan.foxglove_port:
        check(plan.foxglove_host)
    if batch is not None:
        from imutui.cli import follow_batch
        from imutui.settings import SETTINGS

        stated = {
            "duration_s": duration, "instrument": instrument, "reference": reference, "reference_file": reference,
            "effects": effects, "note": note or None, "unattended": unattended or None, "site": site,
            "gravity": flags.pop("site.gravity_mps2", None),
        }  # fmt: skip
        given = [*(SETTINGS[key].name for key in flags), *(key for key, value in stated.items() if value is not None)]
        follow_batch.record(batch, name, port, plan, given, json=json)
    if controller is not None and kind == "profile":
        plan = may_move(plan)
    follow(plan, json=json)

"""`imutui record`."""

from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.exit_codes import check_output
from imutui.cli.options import (
    AccelSign,
    Effects,
    Force,
    Gravity,
    GyroSign,
    Json,
    Mount,
    Name,
    Operator,
    Output,
    Place,
    Rate,
    Reference,
    RotateMb,
    RotateMinutes,
    SiteText,
    Table,
    effects_of,
    parse_site,
    reference_of,
)
from imutui.instrument.names import DEFAULT, NAMES


def command(
    port: Annotated[
        str, typer.Option("--port", help='Path such as /dev/ttyUSB0, stable id, pyserial URL, or "virtual".')
    ],
    rate: Rate = None,
    sampling: Annotated[
        str | None,
        typer.Option(
            "--sampling",
            metavar="stream|polled",
            help="What the unit streams, or means of it over each period; or one request a period.",
        ),
    ] = None,
    instrument: Annotated[
        str | None,
        typer.Option("--instrument", metavar="|".join(NAMES), help="Which unit it is; unless given, it is asked."),
    ] = None,
    baud: Annotated[int | None, typer.Option("--baud", help="Line speed.")] = None,
    duration: Annotated[
        float | None, typer.Option("--duration", metavar="S", help="End so many seconds after the first packet.")
    ] = None,
    filter_name: Annotated[
        str | None, typer.Option("--filter", metavar="spkf|spkf-paper|ekf|none", help="Filter to run.")
    ] = None,
    reference: Reference = None,
    effects: Effects = None,
    note: Annotated[str, typer.Option("--note", help="Goes into the file and its name.")] = "",
    operator: Operator = None,
    place: Place = None,
    table: Table = None,
    rotate_minutes: RotateMinutes = None,
    rotate_mb: RotateMb = None,
    name: Name = None,
    unattended: Annotated[
        bool,
        typer.Option(
            "--unattended",
            help="For a service: exit code 0 whenever the recording is complete, whatever the filter found; each file"
            " names the one before it.",
        ),
    ] = False,
    foxglove: Annotated[
        int | None,
        typer.Option("--foxglove", metavar="PORT", help="Stream what is recorded to Foxglove at this TCP port."),
    ] = None,
    foxglove_host: Annotated[
        str | None,
        typer.Option(
            "--foxglove-host",
            metavar="ADDR",
            help="Address that the stream is served at; unless given, 127.0.0.1: this computer only.",
        ),
    ] = None,
    output: Output = None,
    accel_sign: AccelSign = None,
    mount: Mount = None,
    gyro_sign: GyroSign = None,
    site: SiteText = None,
    gravity: Gravity = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Acquire and record; this terminal follows it.

    The acquisition is a process of its own: it lives on if this terminal closes, and `imutui attach` finds it again.
    Ctrl+C finishes the file. A unit that falls silent is waited for; one that is silent at the end is told, with exit
    code 4. A recording in several files loses no packet between them; the filter begins anew with
    each, so that each replays by itself. `imutui service` has it run without anybody.

    Example: imutui record --port /dev/ttyUSB0 --rate 20 --note "table level"
    """
    from imutui import config
    from imutui.cli.follow_acquisition import follow
    from imutui.cli.session_options import check_stream, plan_from
    from imutui.session.plan import VIRTUAL_PORT

    if output is not None:
        check_output(output, force)
    file, kind = reference_of(reference)
    flags = {
        "acquisition.rate_hz": rate,
        "acquisition.sampling": sampling,
        "acquisition.baud": baud,
        "acquisition.operator": operator,
        "acquisition.place": place,
        "acquisition.table": table,
        "acquisition.rotate_minutes": rotate_minutes,
        "acquisition.rotate_mb": rotate_mb,
        "foxglove.port": foxglove,
        "foxglove.host": foxglove_host,
        "filter.name": filter_name,
        "filter.reference": kind,
        "instrument.accel_sign": accel_sign,
        "instrument.mount": mount,
        "instrument.gyro_sign": gyro_sign,
        "site.gravity_mps2": gravity,
    }
    plan = plan_from(
        config.load().with_flags(flags),
        parse_site(site),
        port=port,
        instrument=instrument or (DEFAULT if port == VIRTUAL_PORT else ""),
        virtual=("--instrument", instrument) if instrument and port == VIRTUAL_PORT else (),
        record=True,
        duration_s=duration,
        note=note,
        name=name or "default",
        unattended=unattended,
        output=str(Path(output).resolve()) if output is not None else "",
        overwrite=force,
        reference_file=("", "") if file is None else (_name_of(str(reference)), file.content.decode("utf-8-sig")),
        effects=(effects_of(effects) or b"").decode("utf-8-sig"),
    )
    check_stream(plan)
    follow(plan, json=json)


def _name_of(reference: str) -> str:
    """Name of a file that --reference names; that which a ready-made profile would have."""
    from imutui.logbook import reference_file

    path = Path(reference)
    named = None if path.suffix.lower() in (".csv", ".toml") else reference_file.find(reference)
    return path.name if named is None else named.file

"""`imutui import`."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.options import (
    AccelSign,
    End,
    Force,
    Gravity,
    GyroSign,
    Mount,
    Reference,
    SiteText,
    Start,
    parse_site,
)


def command(
    file: Annotated[
        Path, typer.Argument(help="NPZ or CSV: t in s, gyro in deg/s, accel in g, optionally temp in degC.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Log to write.")],
    accel_sign: AccelSign = None,
    mount: Mount = None,
    gyro_sign: GyroSign = None,
    site: SiteText = None,
    gravity: Gravity = None,
    reference: Reference = None,
    start: Start = None,
    end: End = None,
    instrument: Annotated[str, typer.Option("--instrument", help="What made the recording.")] = "",
    kind: Annotated[
        str, typer.Option("--kind", metavar="measured|simulated|unknown", help="Who made the readings.")
    ] = "unknown",
    force: Force = False,
) -> None:
    """Make a log of a recording made elsewhere.

    A CSV has columns t, gyro_x, gyro_y, gyro_z, accel_x, accel_y, accel_z and perhaps temp.

    Example: imutui import still.npz -o still.mcap --accel-sign +1 --reference gravity
    """
    from imutui import config
    from imutui.cli.outcome import USAGE, fail, refuse_existing, say
    from imutui.cli.session_options import session_from
    from imutui.logbook import importer

    if kind not in ("measured", "simulated", "unknown"):
        raise fail(USAGE, f'--kind is "{kind}", not measured, simulated or unknown.')
    if output.exists() and file.exists() and output.samefile(file):
        raise fail(USAGE, f"-o names the recording itself, {file}; name another file.")
    refuse_existing(output, force)
    flags = {
        "instrument.accel_sign": accel_sign,
        "instrument.mount": mount,
        "instrument.gyro_sign": gyro_sign,
        "site.gravity_mps2": gravity,
        "filter.reference": reference,
    }
    info = session_from(config.load().with_flags(flags), parse_site(site))
    info = replace(info, instrument=instrument or "unknown", kind=kind)
    # refuse what cannot be before a long file is read
    info.axes()
    info.settings()
    recording = importer.load(file, start, end)
    if recording.not_imported:
        say(f"imutui: not imported from {file}: {', '.join(recording.not_imported)}")
    warning = importer.check_gravity(recording, info)
    if warning is not None:
        say(f"imutui: warning: {warning}")
    importer.write(recording, info, file, output, overwrite=force)
    duration = recording.t[-1] - recording.t[0]
    print(
        f"{output}: {recording.t.size} samples, {duration:.1f} s, {recording.rate_hz:.4f} Hz, {info.reference}",
        file=sys.stderr,
    )

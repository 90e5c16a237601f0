"""`imutui import`."""

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.each_log import progress
from imutui.cli.exit_codes import USAGE, check_output, fail, print_json, say
from imutui.cli.options import (
    AccelSign,
    End,
    Force,
    Gravity,
    GyroSign,
    Json,
    Mount,
    SiteText,
    Start,
    parse_site,
    say_assumed,
)

if TYPE_CHECKING:
    from imutui.logbook.importer import RecordingFile
    from imutui.logbook.reference_file import ReferenceFile
    from imutui.logbook.session_info import SessionInfo


def command(
    file: Annotated[
        Path,
        typer.Argument(help="Table of text, NPZ, Parquet or bag: t, gyro_x …, accel_x …, perhaps temp, ang_x …"),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Log to write.")],
    accel_sign: AccelSign = None,
    mount: Mount = None,
    gyro_sign: GyroSign = None,
    site: SiteText = None,
    gravity: Gravity = None,
    reference: Annotated[
        str | None,
        typer.Option(
            "--reference",
            metavar="level|gravity|turned|trajectory|FILE",
            help="What is known of the motion: turned is by hand between rests; trajectory is what the recording's own"
            " arrays say (the default where it has some); FILE is a trajectory (CSV) or a table profile (TOML), and"
            " goes into the log.",
        ),
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(
            "--columns", metavar="NAME=COLUMN[:UNIT],…", help="Which column is which, such as t=time:ms,gyro_x=#4."
        ),
    ] = None,
    units: Annotated[
        str | None,
        typer.Option("--units", metavar="NAME:UNIT,…", help="Units, such as t:us,gyro:rad/s,accel:m/s2,temp:K."),
    ] = None,
    topic: Annotated[
        str | None,
        typer.Option("--topic", metavar="NAME[,NAME]", help="Of a bag: topic of the samples; two: rates, then forces."),
    ] = None,
    stamps: Annotated[
        str, typer.Option("--stamps", metavar="sampling|arrival", help="What t is; arrival: fit the instants under it.")
    ] = "sampling",
    rate: Annotated[
        float | None, typer.Option("--rate", metavar="HZ", help="Rate of the rows, instead of their times.")
    ] = None,
    drop: Annotated[
        str | None, typer.Option("--drop", metavar="ROW,…", help="Rows to leave out; the first is 0.")
    ] = None,
    continues: Annotated[
        Path | None,
        typer.Option("--continues", metavar="LOG", help="Log of the same power-on that this recording goes on from."),
    ] = None,
    start: Start = None,
    end: End = None,
    instrument: Annotated[str, typer.Option("--instrument", help="What made the recording.")] = "",
    kind: Annotated[
        str, typer.Option("--kind", metavar="measured|simulated|unknown", help="Who made the readings.")
    ] = "unknown",
    force: Force = False,
    json: Json = False,
) -> None:
    """Make a log of a recording made elsewhere.

    A CSV has columns t, gyro_x, gyro_y, gyro_z, accel_x, accel_y, accel_z and perhaps temp, ang_x, … ref_quat_w, ….

    Example: imutui import still.npz -o still.mcap --accel-sign +1 --reference gravity
    """
    from imutui import config
    from imutui.cli.session_options import session_from
    from imutui.logbook import import_reference, importer, power_on
    from imutui.verdict.rules import SITE_NOT_STATED

    if kind not in ("measured", "simulated", "unknown"):
        raise fail(USAGE, f'--kind is "{kind}", not measured, simulated or unknown.')
    if stamps not in ("sampling", "arrival"):
        raise fail(USAGE, f'--stamps is "{stamps}", not sampling or arrival.')
    if reference == "profile":
        raise fail(USAGE, "--reference profile needs its file: name it, as in --reference table.toml.")
    check_output(output, force, file, *([continues] if continues else []))
    beside = import_reference.from_text(reference) if reference is not None else None
    if accel_sign is None and importer.is_bag(file):
        accel_sign = 1  # messages of ROS have specific force
    flags = {
        "instrument.accel_sign": accel_sign,
        "instrument.mount": mount,
        "instrument.gyro_sign": gyro_sign,
        "site.gravity_mps2": gravity,
        "filter.reference": reference if beside is None else beside.kind,
    }
    settings = config.load().with_flags(flags)
    info = session_from(settings, parse_site(site))
    info = replace(info, instrument=instrument, kind=kind)
    # refuse what cannot be before a long file is read
    info.axes()
    info.settings()
    before = None if continues is None else power_on.preceding(continues)
    if before is not None:
        power_on.check_same_unit(before, info)
    if rate is not None and not 0.0 < rate < math.inf:
        raise fail(USAGE, f"--rate is {rate:g}; it must be positive.")
    rows = _rows(drop)
    name = file.name
    asked = importer.Options(start, end, columns, units, topic, stamps == "arrival", rate, rows)
    recording = importer.RecordingFile(file, asked, lambda share: progress(0.5 * share, f"reading {name}"))
    attachment, unused = _reference(recording, info, reference, beside)
    if attachment is not None:
        info = replace(info, reference=attachment.kind)
    say_assumed(file, recording.assumed)
    if left := sorted({*recording.not_imported, *unused}):
        say(f"imutui: not imported from {file}: {', '.join(left)}")
    if recording.unread:
        channels = ", ".join(recording.unread)
        say(
            f"imutui: {file} has no readings of {channels} (NaN throughout): the log does without, and so does all else"
        )
    if not info.site_stated:
        say(f"imutui: {output}: {SITE_NOT_STATED}")
    for warning in (_bursts(recording), importer.check_gravity(recording, info)):
        if warning:
            say(f"imutui: warning: {warning}")
    first_ns = None
    if before is not None:
        info, first_ns, words = power_on.continuing(before, info, recording.origin_s + recording.first_s)
        say(f"imutui: {output} continues {before.path}: {words}")
    moved = importer.write(
        recording,
        info,
        output,
        overwrite=force,
        reference=attachment,
        first_ns=first_ns,
        progress=lambda share: progress(0.5 + 0.5 * share, f"writing {output.name}"),
        mode=settings.file_mode,
    )
    if moved:
        say(f"imutui: warning: {moved}. `touch` sets that time")
    duration = recording.last_s - recording.first_s
    document = {
        "version": 1, "log": str(output.resolve()), "source": str(file.resolve()), "samples": recording.count,
        "duration_s": duration, "rate_hz": recording.rate_hz, "reference": info.reference,
        "assumed": recording.assumed, "not_imported": left, "unread": list(recording.unread),
    }  # fmt: skip
    words = f"{output}: {recording.count} samples, {duration:.1f} s, {recording.rate_hz:.4f} Hz, {info.reference}"
    if json:
        print_json(document)
    else:
        say(words)


def _rows(text: str | None) -> tuple[int, ...]:
    """Return the rows that --drop names."""
    words = [word.strip() for word in (text or "").split(",") if word.strip()]
    if not all(word.isdigit() for word in words):
        raise fail(USAGE, f'--drop is "{text}"; it takes numbers of rows, the first is 0, such as 1500,1702.')
    return tuple(map(int, words))


def _reference(
    recording: "RecordingFile", info: "SessionInfo", asked: str | None, beside: "ReferenceFile | None"
) -> "tuple[ReferenceFile | None, set[str]]":
    """Return what goes into the log as its reference, and the names of arrays that then do not."""
    from imutui.logbook import import_reference, importer

    t, known = recording.known()
    if beside is not None or asked not in (None, "trajectory"):
        return beside, set(known)
    made = import_reference.from_arrays(t, known, info.axes().mount, info.site())
    if made is None and asked == "trajectory":
        raise importer.ImportDataError(
            f"{recording.path} says nothing of the motion: --reference trajectory needs one of ang, ref_quat, gps_pos,"
            " gps_vel_ned with values in it, or name a trajectory's file: --reference FILE.csv."
        )
    if made is None:
        return None, set(known)
    # a table's own angles say more than a quaternion beside them, and both at once could contradict each other
    return made, {"ref_quat"} & set(known) if "ang" in known else set()


def _bursts(recording: "RecordingFile") -> str:
    figures = recording.bursts()
    return figures and (
        f"stamps look like arrival times in bursts: {figures}; --stamps arrival rebuilds sampling instants"
    )

"""`imutui import`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.exit_codes import USAGE, check_output, fail, say
from imutui.cli.options import AccelSign, End, Force, Gravity, GyroSign, Mount, SiteText, Start, parse_site

if TYPE_CHECKING:
    from imutui.logbook.importer import Recording
    from imutui.logbook.reference_file import ReferenceFile
    from imutui.logbook.session_info import SessionInfo


def command(
    file: Annotated[
        Path,
        typer.Argument(help="NPZ or CSV: t in s, gyro in deg/s, accel in g; perhaps temp, ang, rate, ref_quat, gps_…"),
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
    stamps: Annotated[
        str, typer.Option("--stamps", metavar="sampling|arrival", help="What t is; arrival: fit the instants under it.")
    ] = "sampling",
    continues: Annotated[
        Path | None,
        typer.Option(
            "--continues",
            metavar="LOG",
            help="The same power-on as LOG, later: in a trace of both, biases and the memory of temperature carry over."
            " t counts on LOG's clock if it begins after LOG's end, else it is placed one period after it.",
        ),
    ] = None,
    start: Start = None,
    end: End = None,
    instrument: Annotated[str, typer.Option("--instrument", help="What made the recording.")] = "",
    kind: Annotated[
        str, typer.Option("--kind", metavar="measured|simulated|unknown", help="Who made the readings.")
    ] = "unknown",
    force: Force = False,
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
    recording = importer.load(file, start, end)
    attachment, unused = _reference(file, recording, info, reference, beside)
    if attachment is not None:
        info = replace(info, reference=attachment.kind)
    if left := sorted({*recording.not_imported, *unused}):
        say(f"imutui: not imported from {file}: {', '.join(left)}")
    if recording.unread:
        channels = ", ".join(recording.unread)
        say(
            f"imutui: {file} has no readings of {channels} (NaN throughout): the log does without, and so does all else"
        )
    if not info.site_stated:
        say(f"imutui: {output}: {SITE_NOT_STATED}")
    for warning in (_bursts(recording, stamps), importer.check_gravity(recording, info)):
        if warning:
            say(f"imutui: warning: {warning}")
    if stamps == "arrival":
        recording, fitted = importer.at_sampling_instants(recording)
        say(
            f"imutui: sampling instants fitted under {file}'s arrivals in {fitted.pieces} piece(s); they are late by"
            f" {fitted.median_late * 1e3:.1f} ms in the median, {fitted.max_late * 1e3:.1f} ms at most"
        )
    first_ns = None
    if before is not None:
        info, first_ns, words = power_on.continuing(before, info, recording.t)
        say(f"imutui: {output} continues {before.path}: {words}")
    mode = settings.file_mode
    moved = importer.write(
        recording, info, file, output, overwrite=force, reference=attachment, first_ns=first_ns, mode=mode
    )
    if moved:
        say(f"imutui: warning: {moved}. `touch` sets that time")
    duration = recording.t[-1] - recording.t[0]
    say(f"{output}: {recording.t.size} samples, {duration:.1f} s, {recording.rate_hz:.4f} Hz, {info.reference}")


def _reference(
    file: Path, recording: "Recording", info: "SessionInfo", asked: str | None, beside: "ReferenceFile | None"
) -> "tuple[ReferenceFile | None, set[str]]":
    """What goes into the log as its reference, and the names of arrays that then don't."""
    from imutui.logbook import import_reference, importer

    if beside is not None or asked not in (None, "trajectory"):
        return beside, set(recording.known)
    made = import_reference.from_arrays(recording.t, recording.known, info.axes().mount, info.site())
    if made is None and asked == "trajectory":
        raise importer.ImportDataError(
            f"{file} says nothing of the motion: --reference trajectory needs one of ang, ref_quat, gps_pos,"
            " gps_vel_ned with values in it, or name a trajectory's file: --reference FILE.csv."
        )
    if made is None:
        return None, set(recording.known)
    # a table's own angles say more than a quaternion beside them, and both at once could contradict each other
    return made, {"ref_quat"} & set(recording.known) if "ang" in recording.known else set()


def _bursts(recording: "Recording", stamps: str) -> str:
    from imutui.logbook.arrival_stamps import bursts

    figures = bursts(recording.t) if stamps == "sampling" else ""
    return figures and (
        f"stamps look like arrival times in bursts: {figures}; --stamps arrival rebuilds sampling instants"
    )

"""`imutui import`."""

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.exit_codes import USAGE, check_output, fail, print_json, say
from imutui.cli.options import End, Flags, Force, Json, SiteText, Start, parse_site, takes_settings

if TYPE_CHECKING:
    from imutui.logbook.importing.recording import Recording
    from imutui.logbook.importing.table import Asked
    from imutui.logbook.reference_file import ReferenceFile
    from imutui.logbook.session_info import SessionInfo


@takes_settings("instrument.accel_sign", "instrument.mount", "instrument.gyro_sign", "site.gravity_mps2")
def command(
    *,
    file: Annotated[
        Path,
        typer.Argument(
            help="CSV of any dialect, also .gz, NPZ, NPY, Parquet or bag: time, gyros, accelerometers; perhaps temp,"
            " ang, rate, ref_quat, gps_…"
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Log to write.")],
    columns: Annotated[
        str,
        typer.Option(
            "--columns",
            metavar='"t=NAME:ms, gyro_x=#2:rad/s, …"',
            help="Columns of the channels t, gyro_x, …, accel_z, temp: by name or position, with their unit."
            " t=row:100Hz counts rows; accel=none leaves channels out.",
        ),
    ] = "",
    units: Annotated[
        str,
        typer.Option(
            "--units",
            metavar='"t:us, gyro:rad/s, accel:m/s2, temp:K"',
            help="Units; else those in the names of columns, else s, deg/s, g, degC. g/16384 is 16384 counts per g.",
        ),
    ] = "",
    topic: Annotated[
        str,
        typer.Option("--topic", metavar="NAME[,NAME]", help="Of a bag: topic of the samples; two: rates, then forces."),
    ] = "",
    rate: Annotated[
        float | None,
        typer.Option("--rate", metavar="HZ", help="Rate of the rows, instead of their times; as t=row:100Hz has it."),
    ] = None,
    drop: Annotated[str, typer.Option("--drop", metavar="ROW,FROM-TO", help="Rows to leave out; the first is 0.")] = "",
    flags: Flags,
    site: SiteText = None,
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
        str,
        typer.Option(
            "--stamps",
            metavar="sampling|log|arrival",
            help="What t is; log: the log times of a bag; arrival: fit the instants under it.",
        ),
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
    json: Json = False,
    force: Force = False,
) -> None:
    """Make a log of a recording made elsewhere.

    What had to be assumed is one line on stderr. A recording that may be misread is refused with the command to type.

    Example: imutui import still.npz -o still.mcap --accel-sign +1 --reference gravity
    """
    from imutui import config
    from imutui.cli.each_log import progress
    from imutui.cli.session_options import session_from
    from imutui.document_shape import VERSION
    from imutui.logbook import bag, import_reference, power_on
    from imutui.logbook.importing import recording as recordings
    from imutui.logbook.importing.table import Asked
    from imutui.logbook.importing.write import write
    from imutui.settings import SETTINGS
    from imutui.verdict.rules import SITE_NOT_STATED

    if kind not in ("measured", "simulated", "unknown"):
        raise fail(USAGE, f'--kind is "{kind}", not measured, simulated or unknown.')
    if stamps not in ("sampling", "log", "arrival"):
        raise fail(USAGE, f'--stamps is "{stamps}", not sampling, log or arrival.')
    if reference == "profile":
        raise fail(USAGE, "--reference profile needs its file: name it, as in --reference table.toml.")
    check_output(output, force, file, *([continues] if continues else []))
    beside = import_reference.from_text(reference) if reference is not None else None
    if bag.is_bag(file):
        flags = {"instrument.accel_sign": 1} | flags  # messages of ROS have specific force
    kind_of_reference = reference if beside is None else beside.kind
    settings = config.load().with_flags(flags | {"filter.reference": kind_of_reference})
    info = session_from(settings, parse_site(site))
    info = replace(info, instrument=instrument, kind=kind)
    # refuse what cannot be before a long file is read
    info.axes()
    info.settings()
    before = None if continues is None else power_on.preceding(continues)
    if before is not None:
        power_on.check_same_unit(before, info)
    others = _words(
        **{SETTINGS[key].setting.flag[2:]: value for key, value in flags.items()}, site=site, reference=reference,
        continues=continues, instrument=instrument, kind=kind if kind != "unknown" else "", json=json, force=force,
    )  # fmt: skip
    if rate is not None and not 0.0 < rate < math.inf:
        raise fail(USAGE, f"--rate is {rate:g}; it must be positive.")
    columns = columns if rate is None else ", ".join(filter(None, (columns, f"t=row:{rate!r}Hz")))
    asked = Asked(columns, units, drop, stamps, topic, start, end, info.g_unit, output, others)
    recording = recordings.load(file, asked, lambda share: progress(0.3 * share, "reading"))
    attachment, unused = _reference(file, recording, info, reference, beside)
    if attachment is not None:
        info = replace(info, reference=attachment.kind)
    assumed = list(recording.assumed)
    if "instrument.accel_sign" not in flags and not recording.lacks[3:].all():
        up = info.accel_sign > 0
        assumed.append(
            f"--accel-sign {info.accel_sign:+d}: an axis that points {'up' if up else 'down'} reads +1 g at rest; if"
            f" one that points {'down' if up else 'up (phones, most boards)'} does: --accel-sign {-info.accel_sign:+d}"
        )
    if assumed:
        say(f"imutui: {file}: assumed: {'; '.join(assumed)}")
    if left := sorted({*recording.not_imported, *unused}):
        say(f"imutui: not imported from {file}: {', '.join(left)}")
    if recording.unread:
        channels = ", ".join(recording.unread)
        say(f"imutui: {file} has no readings of {channels}: every command does without them")
    if not info.site_stated:
        say(f"imutui: {output}: {SITE_NOT_STATED}")
    for warning in (_bursts(recording, asked), recordings.check_gravity(recording, info)):
        if warning:
            say(f"imutui: warning: {warning}")
    if fitted := recording.fitted:
        say(
            f"imutui: sampling instants fitted under {file}'s arrivals in {fitted.pieces} piece(s); they are late by"
            f" {fitted.median_late * 1e3:.1f} ms in the median, {fitted.max_late * 1e3:.1f} ms at most"
        )
    first_ns = None
    if before is not None:
        info, first_ns, words = power_on.continuing(before, info, recording.clock_s)
        say(f"imutui: {output} continues {before.path}: {words}")
    moved = write(
        recording, info, output, overwrite=force, reference=attachment, first_ns=first_ns, mode=settings.file_mode,
        progress=lambda share: progress(0.3 + 0.7 * share, "writing"),
    )  # fmt: skip
    if moved:
        say(f"imutui: warning: {moved}. `touch` sets that time")
    document = {
        "version": VERSION,
        "log": str(output),
        "samples": recording.samples,
        "duration_s": recording.duration_s,
        "rate_hz": recording.rate_hz,
        "reference": info.reference,
        "assumed": assumed,
        "not_imported": left,
        "unread": list(recording.unread),
    }
    if json:
        print_json(document)
        return
    say(
        f"{output}: {recording.samples} samples, {recording.duration_s:.1f} s, {recording.rate_hz:.4f} Hz,"
        f" {info.reference}"
    )


def _words(**options: object) -> tuple[str, ...]:
    """Words of options that were given, for a command that repeats them."""
    out: list[str] = []
    for name, value in options.items():
        if value is None or value is False or value == "":
            continue
        text = f"{value:+d}" if name == "accel-sign" else str(value)
        out += [f"--{name.replace('_', '-')}", *([] if value is True else [text])]
    return tuple(out)


def _reference(
    file: Path, recording: "Recording", info: "SessionInfo", asked: str | None, beside: "ReferenceFile | None"
) -> "tuple[ReferenceFile | None, set[str]]":
    """Return what goes into the log as its reference, and the names of arrays that then don't."""
    from imutui.logbook import import_reference
    from imutui.logbook.importing.table import ImportDataError

    if beside is not None or asked not in (None, "trajectory"):
        return beside, set(recording.known)
    made = import_reference.from_arrays(recording.known_t, recording.known, info.axes().mount, info.site())
    if made is None and asked == "trajectory":
        raise ImportDataError(
            f"{file} says nothing of the motion: --reference trajectory needs one of ang, ref_quat, gps_pos,"
            " gps_vel_ned with values in it, or name a trajectory's file: --reference FILE.csv."
        )
    if made is None:
        return None, set(recording.known)
    # a table's own angles say more than a quaternion beside them, and both at once could contradict each other
    return made, {"ref_quat"} & set(recording.known) if "ang" in recording.known else set()


def _bursts(recording: "Recording", asked: "Asked") -> str:
    """Return a warning of stamps that look like arrival times, "" if there is none."""
    return recording.bursts and (
        f"stamps look like arrival times in bursts: {recording.bursts}. To rebuild sampling instants:"
        f" `{asked.command(recording.path, stamps='arrival')}`"
    )

"""`imutui export`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.each_log import width
from imutui.cli.exit_codes import FINDINGS, USAGE, answer, check_output, fail, lacking, say, show_progress
from imutui.cli.options import End, Force, Json, ReadAs, Start, say_assumed, states_reading

if TYPE_CHECKING:
    from imutui.jobs.export import Exported


@states_reading
def command(
    read_as: ReadAs,
    log: Annotated[Path, typer.Argument(help="Log; another program's MCAP file with sensor_msgs/msg/Imu does too.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write.")],
    form: Annotated[
        str | None, typer.Option("--format", metavar="csv|npz|parquet", help="Unless the name of the file says it.")
    ] = None,
    start: Start = None,
    end: End = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Write a log's samples for other programs: CSV, NPZ or Parquet.

    t in s, gyro in deg/s, accel in g, temp in degC, perhaps ang and rate of the table: in the instrument's own axes and
    with its own sign. `imutui import` reads them back, with the flags that are printed.

    Example: imutui export logs/sample.mcap -o sample.csv
    """
    from imutui import config
    from imutui.document_shape import VERSION
    from imutui.jobs import export as job

    kind = form or output.suffix.lstrip(".").lower()
    if kind not in job.FORMATS:
        said = f'--format is "{form}"' if form else f"{output} does not say the format, and --format is not given"
        raise fail(USAGE, f"{said}; it is one of {', '.join(job.FORMATS)}.")
    if (extra := job.lacks(kind)) is not None:
        raise lacking("Parquet needs pyarrow", extra)
    check_output(output, force, log)
    made = job.export(
        log, output, kind, read_as(start=start, end=end), overwrite=force, mode=config.load().file_mode,
        progress=lambda rows: show_progress(f"{rows:,} rows"),
    )  # fmt: skip
    say_assumed(log, made.assumed)
    if made.damage:
        say(f"imutui: warning: {log}: {made.damage}. All before that is exported.")
    reference = None if made.reference is None else str(made.reference)
    document = {
        "version": VERSION, "log": str(log), "output": str(output), "format": kind, "rows": made.rows,
        "columns": list(made.columns), "units": made.units, "about": made.about, "reference": reference,
        "damage": made.damage, "assumed": list(made.assumed),
    }  # fmt: skip
    answer(document, lambda: _text(output, made), json=json)
    raise typer.Exit(FINDINGS if made.damage else 0)


def _text(output: Path, made: "Exported") -> str:
    import textwrap

    from imutui.command_line import joined

    columns = ", ".join(f"{name} ({made.units[name]})" if name in made.units else name for name in made.columns)
    rows = textwrap.fill(f"{output}: {made.rows} rows: {columns}", width())
    reference = ("--reference", made.reference) if made.reference else ()
    words = joined("imutui", "import", output, "-o", "LOG.mcap")
    flags = " ".join(filter(None, (made.about["import"], joined(*reference))))
    return f"{rows}\nTo read it back: {words} {flags}"

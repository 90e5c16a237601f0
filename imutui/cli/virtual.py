"""`imutui virtual`: the virtual instrument."""

import math
import signal
import sys
import threading
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.exit_codes import USAGE, fail, refuse_existing, say, tell
from imutui.cli.options import Force
from imutui.instrument import names


def command(
    instrument: Annotated[
        str | None,
        typer.Option(
            "--instrument",
            metavar="|".join(names.NAMES),
            help=f"Which unit to be ({names.DEFAULT}, or that of the log that is played).",
        ),
    ] = None,
    link: Annotated[Path | None, typer.Option("--link", help="Also make this symbolic link to the port.")] = None,
    from_: Annotated[
        Path | None, typer.Option("--from", metavar="LOG|NPZ|RAW", help="Play this recording instead of made readings.")
    ] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(
            "--scenario", metavar="FILE.toml", help="Make readings of this scenario: motion, effects, faults."
        ),
    ] = None,
    spoil: Annotated[
        str | None,
        typer.Option(
            "--spoil", metavar="FILE.py:NAME", help="Add errors that a Python function makes; for tests only."
        ),
    ] = None,
    from_start: Annotated[
        float | None, typer.Option("--from-start", metavar="S", help="Where in the recording to begin, seconds (0).")
    ] = None,
    power_on: Annotated[
        int | None, typer.Option("--power-on", metavar="K", help="Which of the scenario's power-ons, from 0 (0).")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", help="Of biases and noise of made readings (the scenario's, or 0).")
    ] = None,
    speed: Annotated[float, typer.Option("--speed", metavar="X", help="Times real time.")] = 1.0,
    tap: Annotated[Path | None, typer.Option("--tap", help="Write every byte sent to this file.")] = None,
    sent: Annotated[
        Path | None, typer.Option("--sent", metavar="FILE.csv", help="Write when each packet was sampled to this file.")
    ] = None,
    serial_number: Annotated[
        int | None,
        typer.Option(
            "--serial-number",
            help="Serial number that it reports (9911750 + the seed; without seed and scenario it follows from --link;"
            " of a file *.raw the recorded unit's).",
        ),
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option(
            "--controller",
            metavar="HOST:PORT",
            help="Serve a table's controller on loopback, and put the unit on that table (port 0: a free one).",
        ),
    ] = None,
    axes: Annotated[
        int | None, typer.Option("--axes", metavar="N", help="Axes of that table, 1 to 3 (the scenario's, or 3).")
    ] = None,
    force: Force = False,
    while_stdin: Annotated[bool, typer.Option("--while-stdin", help="End when standard input ends.")] = False,
) -> None:
    """Run a virtual instrument on a pseudo-terminal: an IMU400CD-200, or an IMU381ZA-200.

    Its port is the first line on stdout.
    It answers like the unit: ping, version, serial number, modes, polled and continuous packets at 133.3 Hz, auto-baud;
    the IMU381 identity, configuration fields and packets S0 and S1 at 100 Hz or slower, 115200 baud at first.
    Commands received are logged on stderr. Its readings are simulated (biases and noise of its data sheet, drawn from
    the seed) or made by a scenario's file, or played from a recording; time starts with the first request for data.
    With a recording and a scenario, the scenario's motion, temperature and effects are added to what was recorded:
    such readings are called simulated. A file *.raw is a stream that an IMU381 sent: it is played byte for byte, from
    its beginning each time that a host asks for its rate. With --controller the unit stands on a table that
    `imutui table` and others turn; its URL is the second line on stdout. Units of different seeds, or without seeds of
    different links, have different serial numbers. Ctrl+C ends it.

    Example: imutui virtual --link /tmp/imu --seed 7
    """
    from imutui.cli.spoil import load
    from imutui.cli.virtual_readings import Asked
    from imutui.cli.virtual_table import VirtualTable
    from imutui.cli.virtual_units import UNITS, instrument_of, recorded_unit
    from imutui.instrument.pseudo_terminal import PseudoTerminal
    from imutui.instrument.virtual import BURST_BYTES, Wire, sent_packets, serve
    from imutui.logbook.atomic_file import create

    if not 0.0 < speed < math.inf:
        raise fail(USAGE, f"--speed is {speed:g}; it must be positive.")
    if instrument is not None and instrument not in names.NAMES:
        raise fail(USAGE, f"--instrument is {instrument}; it must be one of: {', '.join(names.NAMES)}.")
    if serial_number is not None and not 0 <= serial_number < 2**32:
        raise fail(USAGE, f"--serial-number is {serial_number}; it travels as 32 bits, 0 to 4294967295.")
    if seed is not None and seed < 0:
        raise fail(USAGE, f"--seed is {seed}; it must not be negative.")
    for file in filter(None, (tap, sent)):
        refuse_existing(file, force)
    if power_on is not None and scenario is None:
        raise fail(USAGE, "--power-on is one of a scenario's: it needs --scenario.")
    if from_start is not None and from_ is None:
        raise fail(USAGE, "--from-start is a place in a recording: it needs --from.")
    if from_start is not None and not 0.0 <= from_start < math.inf:
        raise fail(USAGE, f"--from-start is {from_start:g}; it must be a number of seconds from 0 on.")
    if axes is not None and controller is None:
        raise fail(USAGE, "--axes are of a table with a controller: it needs --controller.")
    plays_bytes = from_ is not None and from_.suffix.lower() == ".raw"
    if plays_bytes and instrument not in (None, names.IMU381):
        raise fail(USAGE, f"{from_} is a stream of an IMU381: leave --instrument away.")
    if plays_bytes and (spoil is not None or power_on is not None or from_start is not None):
        raise fail(USAGE, f"{from_} is played byte for byte: leave --spoil, --power-on and --from-start away.")
    if plays_bytes and controller is not None:
        raise fail(USAGE, f"{from_} is played byte for byte, whatever a table does: leave --controller away.")
    table = None if controller is None else VirtualTable(controller, axes, speed)
    if plays_bytes and from_ is not None:
        made = recorded_unit(from_, scenario, seed, serial_number)
    else:
        added = None if spoil is None else load(spoil)
        on_table = None if table is None else partial(table.under, log=lambda text: say(f"table: {text}"))
        asked = Asked(scenario, power_on or 0, seed, from_, from_start or 0.0, added, on_table, link)
        made = UNITS[instrument or instrument_of(from_)](asked, serial_number)
    if made.source:
        say(f"imutui: {made.source}")
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        # where a shell has put us into the background, its Ctrl+C is for others, and ignored from the start
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: stop.set())

    with ExitStack() as files:
        sink = None if tap is None else files.enter_context(open(create(tap, overwrite=force), "wb", buffering=0))
        truth = None
        if sent is not None:
            stream = files.enter_context(open(create(sent, overwrite=force), "w", encoding="ascii"))
            truth = sent_packets(stream, made.unit)
        url = None if table is None else files.enter_context(table.served(made.unit))
        try:
            pty = files.enter_context(PseudoTerminal(link))
        except FileExistsError as error:
            raise fail(USAGE, str(error)) from error
        tell(pty.name)
        if url is not None:
            tell(url)
        sys.stdout.flush()
        wire = Wire(made.unit, made.line, speed, truth, None if table is None else table.began)
        serve(
            wire, pty, log=say, tap=sink, stop=stop, while_stdin=while_stdin,
            burst_bytes=0 if made.line is None else BURST_BYTES, on_idle=made.keep_up,
        )  # fmt: skip
    sys.stdout.flush()

"""`imutui virtual`: the virtual IMU400CD."""

import math
import signal
import sys
import threading
from pathlib import Path
from typing import Annotated, Optional

import typer

from imutui.cli.options import Force


def command(
    link: Annotated[Optional[Path], typer.Option("--link", help="Also make this symbolic link to the port.")] = None,  # noqa: UP045
    from_: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--from", metavar="LOG|NPZ", help="Play this recording instead of made readings."),
    ] = None,
    scenario: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "--scenario", metavar="FILE.toml", help="Make readings of this scenario: motion, effects, faults."
        ),
    ] = None,
    power_on: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option("--power-on", metavar="K", help="Which of the scenario's power-ons, from 0 (0)."),
    ] = None,
    seed: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option("--seed", help="Of biases and noise of made readings (the scenario's, or 0)."),
    ] = None,
    speed: Annotated[float, typer.Option("--speed", metavar="X", help="Times real time.")] = 1.0,
    tap: Annotated[Optional[Path], typer.Option("--tap", help="Write every byte sent to this file.")] = None,  # noqa: UP045
    serial_number: Annotated[int, typer.Option("--serial-number", help="Serial number that it reports.")] = 9911750,
    force: Force = False,
    while_stdin: Annotated[bool, typer.Option("--while-stdin", help="End when standard input ends.")] = False,
) -> None:
    """Run a virtual IMU400CD-200 on a pseudo-terminal.

    Its port is the first line on stdout.
    It answers like the unit: ping, version, serial number, modes, polled and continuous packets at 133.3 Hz, auto-baud.
    Commands received are logged on stderr. Its readings are simulated (Table 1 biases and noise, drawn from the seed)
    or made by a scenario's file, or played from a recording; time starts with the first request for data.
    Ctrl+C ends it.

    Example: imutui virtual --link /tmp/imu --seed 7
    """
    from imutui.cli.exit_codes import UNREADABLE, USAGE, fail, refuse_existing, say
    from imutui.cli.virtual_readings import SIMULATED, played, simulated
    from imutui.instrument.virtual import FaultyLine, Source, UnitOptions, VirtualUnit, serve
    from imutui.scenario import ScenarioError

    if not 0.0 < speed < math.inf:
        raise fail(USAGE, f"--speed is {speed:g}; it must be positive.")
    if not 0 <= serial_number < 2**32:
        raise fail(USAGE, f"--serial-number is {serial_number}; it travels as 32 bits, 0 to 4294967295.")
    if seed is not None and seed < 0:
        raise fail(USAGE, f"--seed is {seed}; it must not be negative.")
    if tap is not None:
        refuse_existing(tap, force)
    if from_ is not None and scenario is not None:
        raise fail(USAGE, "--from plays a recording and --scenario makes readings: give one of them.")
    if power_on is not None and scenario is None:
        raise fail(USAGE, "--power-on is one of a scenario's: it needs --scenario.")
    source: Source
    line: FaultyLine | None = None
    if from_ is not None:
        source, version = played(from_)
    else:
        try:
            readings = simulated(scenario, power_on or 0, seed)
        except ScenarioError as error:
            raise fail(UNREADABLE, str(error)) from error
        source, version, line, seed = readings, SIMULATED, readings.line(), readings.unit.scenario.seed
    unit = VirtualUnit(source, UnitOptions(serial_number=serial_number, version=version), seed or 0)
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        # where a shell has put us into the background, its Ctrl+C is for others, and ignored from the start
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: stop.set())

    def ready(port: str) -> None:
        print(port, flush=True)

    with open(tap if tap is not None else "/dev/null", "wb", buffering=0) as sink:
        try:
            serve(
                unit,
                link=link,
                tap=sink,
                on_ready=ready,
                log=say,
                speed=speed,
                while_stdin=while_stdin,
                stop=stop,
                line=line,
            )
        except FileExistsError as error:
            raise fail(USAGE, str(error)) from error
    sys.stdout.flush()

"""`imutui investigate`."""

import contextlib
import hashlib
import math
import os
import signal
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.exit_codes import (
    FINDINGS,
    FINE,
    INSTRUMENT,
    INTERRUPTED,
    USAGE,
    fail,
    handling,
    lacking,
    print_json,
    say,
    say_if_not_kept,
)
from imutui.cli.options import (
    Flags,
    Json,
    Limits,
    YesMove,
    ask_to_move,
    refuse_unasked,
    takes_settings,
)

if TYPE_CHECKING:
    from filters.tracing.candidate_motions import CandidateMotion
    from filters.tracing.run import Run
    from filters.tracing.table_motions import Table as Axes
    from filters.tracing.trace_document import TraceFindings
    from imutui.cli.investigation_page import Page
    from imutui.jobs.investigation_diary import Diary, RoundEntry
    from imutui.session.client import Client, EndReport
    from imutui.session.plan import Plan

NAME = "investigate "  # of its acquisitions, before the folder's
RATE_HZ = 20.0
NAME_LIMIT = 64
_MOST_H = 1000.0
_LOGS = "logs"
_LOOK_S = 0.2


@takes_settings(
    *("acquisition.rate_hz", "acquisition.operator", "acquisition.place", "acquisition.table"),
    *("instrument.accel_sign", "instrument.mount", "instrument.gyro_sign"),
)
def command(
    *,
    port: Annotated[
        str | None, typer.Option("--port", help="Of the unit: path, stable id, pyserial URL; not with --resume.")
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option("--controller", metavar="URL", help="Of the table, such as acutrol://HOST:PORT."),
    ] = None,
    hours: Annotated[
        float | None, typer.Option("--hours", metavar="H", help="Time that it may take, the run that judges included.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder for logs, diary, result and page.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the investigation that DIR has.")] = False,
    switched: Annotated[
        bool, typer.Option("--switched", help="With --resume: the unit was switched off and on since.")
    ] = False,
    limits: Limits = "",
    yes_move: YesMove = False,
    flags: Flags,
    json: Json = False,
) -> None:
    """Find what is wrong with a unit on a table under command: plan, move, record, trace, until all is explained.

    First motions that let every effect be told; then in rounds what tells most for its time. A last run judges. DIR
    has the logs, diary.json (why each motion, what was expected, what came), result.json, effects.toml and the page.
    Esc or Ctrl+C stops the table at once; --resume goes on after any stop, and makes a motion that was cut again.

    Exit code 0: every channel is explained, or it is said what it would take; 1: time was up before.

    Example: imutui investigate --port /dev/ttyUSB0 --controller acutrol://192.168.1.53:9000 --hours 2 -o unit7
    """
    from imutui.cli.investigation_page import Page
    from imutui.jobs.investigation import Investigation, check_hours

    if output is None:
        raise fail(USAGE, "-o DIR says where logs and diary go.")
    if hours is not None and not 0.0 < hours < _MOST_H:
        raise fail(USAGE, f"--hours is {hours:g}; it is a time that the table is free, such as 2.")
    diary = _diary(output, resume, switched, port, controller, hours)
    asked = diary.document["asked"]
    asked["flags"] |= flags
    limits = asked["limits"] = limits or asked["limits"]
    plan = _plan(diary, _name_of(output))
    refuse_unasked(yes_move=yes_move)
    _end_left_behind(plan.name)
    axes = _axes(plan.controller, limits)
    check_hours(axes, diary.document["hours"])
    say_if_not_kept()
    ask_to_move(plan.controller, "for as long as the investigation takes", yes_move=yes_move)
    output.mkdir(parents=True, exist_ok=True)
    with Page(diary.document) as page, handling({signal.SIGTERM: _interrupt, signal.SIGHUP: _interrupt}):
        laboratory = _Laboratory(output, plan, axes, page)
        going = Investigation(laboratory, diary, page.told)
        page.left_s = lambda: going.left_s + going.reserve_s
        try:
            if not diary.document["outcome"]:
                going.go()
        except KeyboardInterrupt:
            page.close()
            going.pause()
            from imutui.command_line import command as command_of

            say(f"stopped; the table stands. Go on with: {command_of('investigate', '--resume', '-o', output)}")
            raise typer.Exit(INTERRUPTED) from None
    _finish(output, laboratory, diary, json=json)


def _diary(
    output: Path,
    resume: bool,
    switched: bool,
    port: str | None,
    controller: str | None,
    hours: float | None,
) -> "Diary":
    """The diary to go on with, or a new one."""
    from imutui.jobs.investigation_diary import Diary

    if resume:
        diary = Diary.read(output)
        if diary.said:
            say(diary.said)
        asked = diary.document["asked"]
        if port is not None:
            asked["port"] = port
        if controller is not None:
            asked["controller"] = controller
        if hours is not None:
            diary.document["hours"] = hours
            if diary.document["outcome"] == "time":
                diary.document["outcome"] = ""
        if switched:
            diary.document["power_on"] += 1
            diary.document["outcome"] = ""
        return diary
    if port is None or controller is None or hours is None:
        raise fail(USAGE, "say which unit, which table, and for how long: --port, --controller, --hours.")
    if switched:
        raise fail(USAGE, "--switched belongs to --resume.")
    _refuse_files(output)
    diary = Diary.begun(hours, output)
    diary.document["asked"] |= {"port": port, "controller": controller}
    return diary


def _refuse_files(folder: Path) -> None:
    """Raise the exit for a folder with files that a new investigation would replace."""
    from imutui.jobs.investigation_diary import DIARY
    from imutui.report.page import may_write

    found = [*folder.glob("*"), *folder.glob(f"{_LOGS}/[0-9][0-9].mcap")]
    there = [str(path.relative_to(folder)) for path in found if may_write(path.name) or path.parent.name == _LOGS]
    if there and not (folder / DIARY).exists():
        said = f"{folder} has files that would be replaced, and stays as it is: {', '.join(sorted(there))}."
        raise fail(USAGE, f"{said} Name another folder.")


def _name_of(folder: Path) -> str:
    """Name of its acquisitions: of the folder, and of it alone; there is more than one `unit` on a machine."""
    path = folder.resolve()
    digest = hashlib.sha256(str(path).encode()).hexdigest()[:8]
    return f"{(NAME + path.name)[: NAME_LIMIT - 9]} {digest}"


def _end_left_behind(name: str) -> None:
    """End the acquisition of a session that was killed: it goes on to the end of its motion."""
    from imutui.session import client

    if name in client.running():
        say(f'the acquisition "{name}" of a session that was killed still runs: it is ended, and its motion made again')
        client.attach(name).stop("imutui investigate")


def _plan(diary: "Diary", name: str) -> "Plan":
    """What all acquisitions have in common."""
    from imutui import config
    from imutui.cli.session_options import plan_from

    asked = diary.document["asked"]
    flags: dict[str, float | str | int | None] = {
        "acquisition.rate_hz": RATE_HZ,
        "filter.name": "none",
        **asked["flags"],
    }
    return plan_from(
        config.load().with_flags(flags),
        None,
        port=asked["port"],
        instrument="",
        record=True,
        name=name,
        controller=asked["controller"],
        limits=asked["limits"],
        yes_move=True,
        needs_viewer=True,
    )


def _axes(url: str, limits: str) -> "Axes":
    """What the table's axes can do, as its controller and the operator say."""
    from filters.tracing.table_motions import AxisRange
    from imutui.table.acutrol import connect
    from imutui.table.links import TableError
    from imutui.table.motion import narrower, parse_limits

    given = parse_limits(limits)
    try:
        with contextlib.closing(connect(url)) as controller:
            known = narrower(controller.limits(), given)
            has = controller.axes
    except TableError as error:
        raise fail(INSTRUMENT, str(error)) from error
    lacking_limits = [axis for axis in has if axis not in known]
    if lacking_limits:
        raise fail(
            USAGE, f"the controller does not say the limits of the {lacking_limits[0]} axis: give them, --limits."
        )
    return {
        axis: AxisRange(
            math.radians(own.rate_dps),
            math.radians(own.accel_dps2),
            -math.inf if own.low_deg is None else math.radians(own.low_deg),
            math.inf if own.high_deg is None else math.radians(own.high_deg),
        )
        for axis, own in known.items()
        if axis in has
    }


def _interrupt(*_: object) -> None:
    """Take SIGTERM and SIGHUP for Ctrl+C: the table must not go on without the program that gives its motions."""
    raise KeyboardInterrupt


class _Laboratory:
    """The unit and the table on the line: an acquisition for each motion, in whose hands the table is."""

    def __init__(self, folder: Path, plan: "Plan", axes: "Axes", page: "Page") -> None:
        self.table, self._folder, self._plan, self._page = axes, folder, plan, page
        self._begun_s = time.monotonic()
        (folder / _LOGS).mkdir(exist_ok=True)

    def now_s(self) -> float:
        """Time since this session began, s."""
        return time.monotonic() - self._begun_s

    def record(self, motion: "CandidateMotion", number: int) -> str:
        """Have the table make a motion while the unit is recorded."""
        from dataclasses import replace

        from imutui.logbook.reference_file import to_toml
        from imutui.session import client
        from imutui.session.client import SessionError

        name = f"{_LOGS}/{number:02d}.mcap"
        plan = replace(
            self._plan,
            output=str((self._folder / name).resolve()),
            overwrite=True,
            note=motion.description,
            reference_file=(f"{number:02d}.toml", to_toml(motion.profile, [motion.instruction])),
        )
        connection = client.start(plan)
        try:
            end = self._follow(connection, motion.seconds)
        except BaseException:
            # whatever it is, the table must not go on
            try:
                connection.stop("imutui investigate")
            except (SessionError, TimeoutError):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(connection.pid, signal.SIGTERM)
            raise
        failed = [finding["text"] for finding in end["findings"] if finding["exit_code"] == INSTRUMENT]
        if failed or not end["by_itself"]:
            why = "; ".join(failed).rstrip(".") or f"ended by {end['ended_by']}"
            from imutui.command_line import command as command_of

            again = command_of("investigate", "--resume", "-o", self._folder)
            raise SessionError(f"{motion.description} was not finished: {why}. The table stands. Go on with: {again}")
        return name

    def _follow(self, connection: "Client", seconds: float) -> "EndReport":
        """Show the acquisition until it ends, and end it if the table was stopped; returns the record of its end."""
        from imutui.session.client import SessionError
        from imutui.session.snapshot import NO_SERIES

        # one that waits all the time hears of the end; who asks now and then may come when there is nobody any more
        waits = ThreadPoolExecutor(1, "end")
        ended = waits.submit(connection.wait)
        waits.shutdown(wait=False)
        while not ended.done():
            with contextlib.suppress(TimeoutError):
                ended.result(_LOOK_S)
            with contextlib.suppress(SessionError):  # busy, or just ending
                seen = connection.snapshot(since=NO_SERIES)
                self._page.seen(seen, seconds)
                if seen["guide"] is not None and seen["guide"]["state"] == "cancelled":
                    connection.stop("imutui investigate, since the table was stopped")
        return ended.result()

    def runs(self, rounds: "Sequence[RoundEntry]") -> "list[Run]":
        """Runs of the logs of rounds."""
        from imutui.jobs.trace import read_together

        return read_together(self._logs(rounds), _power_ons(rounds))

    def judged(self, rounds: "Sequence[RoundEntry]") -> "TraceFindings":
        """Trace with the last round held out; result and effects file are written."""
        from imutui.jobs.trace import trace
        from imutui.logbook import atomic_file, json_text

        document = trace(self._logs(rounds), power_on_numbers=_power_ons(rounds))
        texts = {"result.json": json_text.dumps(document) + "\n", "effects.toml": document["effects_file"]}
        for name, text in texts.items():
            atomic_file.write(self._folder / name, text, overwrite=True)
        return document

    def _logs(self, rounds: "Sequence[RoundEntry]") -> list[Path]:
        return [self._folder / entry["log"] for entry in rounds]


def _power_ons(rounds: "Sequence[RoundEntry]") -> tuple[int, ...]:
    return tuple(entry["power_on"] for entry in rounds)


def _finish(folder: Path, laboratory: _Laboratory, diary: "Diary", *, json: bool) -> None:
    """The page with the diary at its end, the result, and the exit code."""
    import importlib.util

    from imutui.cli.investigation_page import ended
    from imutui.cli.report import write_page
    from imutui.jobs import result_files

    (result,) = result_files.read(folder / "result.json")
    document = {**result, "diary": diary.document}
    if importlib.util.find_spec("matplotlib") is None:
        lacking("the page needs matplotlib", "report")
    else:
        write_page(folder, [document], force=True)  # type: ignore[list-item] # a result with a diary
    if json:
        print_json(document)
    else:
        for line in ended(diary.document, str(document["sentence"])):
            say(line)
    raise typer.Exit(FINDINGS if diary.document["outcome"] == "time" else FINE)

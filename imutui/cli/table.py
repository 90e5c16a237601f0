"""`imutui table`: command a turn table's controller by hand."""

import math
import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.exit_codes import INSTRUMENT, USAGE, answer, fail, say, show_progress
from imutui.cli.options import Json, Limits, YesMove, ask_to_move

if TYPE_CHECKING:
    from imutui.table.motion import AxisLimits, Motion, TableState
    from imutui.table.owner import KeptTable

_VALUES = {"status": "", "move": "OUTER MIDDLE INNER", "rate": "AXIS DPS", "stop": ""}
_RATE_DPS, _ACCEL_DPS2 = 20.0, 100.0  # as profiles move
_LIMITS = "rate_dps", "accel_dps2", "low_deg", "high_deg"  # of the answer in JSON
_LOOK_S = 0.05
_READ_S = 30.0
_STOP_S = 120.0
_TURN_DEG = 360.0


def command(
    action: Annotated[str, typer.Argument(metavar="|".join(_VALUES), help="What to do.")],
    values: Annotated[
        list[str] | None, typer.Argument(metavar="...", help="move: three angles, deg. rate: an axis, and deg/s.")
    ] = None,
    controller: Annotated[
        str, typer.Option("--controller", metavar="URL", help="The controller, such as acutrol://HOST:PORT.")
    ] = "",
    rate_dps: Annotated[
        float | None, typer.Option("--slew", metavar="DPS", help="move: no faster than this (20).")
    ] = None,
    accel_dps2: Annotated[
        float | None, typer.Option("--accel", metavar="DPS2", help="Acceleration, deg/s^2 (100).")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", metavar="S", help="rate: end after so long, not with Ctrl+C.")
    ] = None,
    limits: Limits = "",
    yes_move: YesMove = False,
    json: Json = False,
) -> None:
    """Report where a turn table is, move it, turn an axis, or stop it, through its controller.

    `status` only asks. `move OUTER MIDDLE INNER` goes to three angles and ends there; the angle of a missing axis is 0.
    `rate AXIS DPS` turns an axis until Ctrl+C. `stop` brings all axes to rest and turns their modes off, whichever
    program set them going. Nothing moves before the user has allowed it, and nothing goes beyond the limits of the
    controller and of --limits. Ctrl+C stops the table, and so does any other end of this process.

    Example: imutui table move 0 0 -90 --controller acutrol://192.168.1.53:9888
    """
    from imutui.table import acutrol
    from imutui.table.motion import parse_limits

    given = _checked(action, values or [], controller)
    if seconds is not None and not seconds > 0.0:
        raise fail(USAGE, f"--seconds is {seconds:g}; it is a time that an axis turns, such as 10.")
    acutrol.parse(controller)
    parse_limits(limits)
    if action == "status":
        _status(controller, limits, json)
    elif action == "stop":
        _stop(controller, json)
    else:
        _turn(action, given, controller, limits, (rate_dps, accel_dps2), seconds, yes_move, json)


def _checked(action: str, values: list[str], controller: str) -> list[str | float]:
    if action not in _VALUES:
        raise fail(USAGE, f'"{action}" is nothing that imutui table does; it can: {", ".join(_VALUES)}.')
    if not controller:
        raise fail(USAGE, "which table? Say --controller acutrol://HOST:PORT.")
    wanted = _VALUES[action].split()
    if len(values) != len(wanted):
        from imutui.command_line import command as command_of

        usage = command_of("table", action, *wanted, "--controller", "URL")
        raise fail(USAGE, f'"{" ".join(values)}" is not what follows {action}. Type: {usage}')
    return [text if what == "AXIS" else _number(text) for what, text in zip(wanted, values, strict=True)]


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise fail(USAGE, f'"{text}" is not a number.')
    return value


def _status(url: str, limits: str, json: bool) -> None:
    from imutui.table.owner import KeptTable

    table = KeptTable(url, limits)
    try:
        _tell(table, _next(table), json)
    finally:
        table.close()


def _stop(url: str, json: bool) -> None:
    """Stop over a link of its own, whichever program commands the table; the first lines sent are the stop."""
    from imutui.table.acutrol import connect
    from imutui.table.keeper import stop_for_certain

    controller = stop_for_certain(connect(url, asks=False), lambda asks: connect(url, asks=asks), say)
    if controller is None:
        raise fail(INSTRUMENT, "the controller does NOT confirm that the table rests. Press its emergency stop.")
    try:
        state = controller.read()
    finally:
        controller.close()
    answer({"controller": url, "state": asdict(state)}, lambda: f"stopped. {_text(state)}", json=json)


def _turn(
    action: str,
    values: list[str | float],
    url: str,
    limits: str,
    how: tuple[float | None, float | None],
    seconds: float | None,
    yes_move: bool,
    json: bool,
) -> None:
    from imutui.table.messages import Command
    from imutui.table.owner import KeptTable

    table = KeptTable(url, limits)
    try:
        motions = _motions(action, values, table, how)
        _next(table)
        ask_to_move(url, _in_words(action, values), yes_move=yes_move)
        table.ask(Command("enable"))
        table.ask(Command("go", motions))
        if action == "move":
            _wait_until_there(table, motions)
        else:
            _wait(table, math.inf if seconds is None else seconds)
        table.ask(Command("stop"), _STOP_S)
        _tell(table, _next(table), json)
    except KeyboardInterrupt:
        say("imutui: stopping the table; press its emergency stop if it turns on")
        table.close()
        say(f"imutui: {table.error or 'the table was stopped: rate zero, then mode off'}")
        raise
    finally:
        table.close()


def _motions(
    action: str, values: list[str | float], table: "KeptTable", how: tuple[float | None, float | None]
) -> "tuple[Motion, ...]":
    """Return the motions to command; without options at the usual speeds, or slower if limits are lower.

    Raises InputError for a motion beyond limits.
    """
    from filters.motion.segments import AXES
    from imutui.table.motion import Begin, Move, Turn, limits_of

    axes = table.axes if action == "move" else [str(values[0])]
    own = [limits_of(axis, table.limits) for axis in axes]
    rate, accel = (
        min(usual, *(getattr(each, name) for each in own)) if said is None else said
        for said, usual, name in zip(how, (_RATE_DPS, _ACCEL_DPS2), ("rate_dps", "accel_dps2"), strict=True)
    )
    if action == "move":
        angles = dict(zip(AXES, map(float, values), strict=True))
        for axis, each in zip(axes, own, strict=True):
            _say_where(axis, angles[axis], each)
        has = [axis for axis in AXES if axis in axes or angles[axis]]
        motions: tuple[Motion, ...] = tuple(Move(axis, angles[axis], rate, accel) for axis in has)
    else:
        motions = (Turn(axes[0], float(values[1]), accel),)
    for motion in motions:  # refused wherever the table is; the keeper checks the path
        motion.check(Begin(motion.angle_deg if isinstance(motion, Move) else 0.0), table.limits)
    return motions


def _say_where(axis: str, angle: float, limits: "AxisLimits") -> None:
    """Report where an axis without stops goes; raises the exit for an angle of more than a turn."""
    if limits.has_stops:
        return
    there = math.remainder(angle, _TURN_DEG)
    if abs(angle) > _TURN_DEG:
        raise fail(
            USAGE,
            f"the {axis} axis turns without end, and {angle:g} deg is {there:g} deg there: say that. Nothing moved.",
        )
    if abs(there - angle) > 1.0:
        say(f"the {axis} axis turns without end: it goes the short way to {there:g} deg, which is {angle:g} deg")


def _in_words(action: str, values: list[str | float]) -> str:
    words = "to outer {:g}, middle {:g}, inner {:g} deg" if action == "move" else "its {} axis at {:g} deg/s"
    return words.format(*values)


# ------------------------------------------------------------------------------------------------------------- waiting


def _next(table: "KeptTable") -> "TableState":
    """Wait for another reading, and print the keeper's news; raises the exit if the keeper ends or none comes."""
    before, deadline = table.newest, time.monotonic() + _READ_S
    while table.newest is before:
        time.sleep(_LOOK_S)
        while table.news:
            text, is_warning = table.news.popleft()
            if not is_warning:
                say(f"imutui: {text}")
        if table.has_ended:
            raise fail(INSTRUMENT, table.error or "the keeper of the table has ended.")
        if time.monotonic() > deadline:
            raise fail(INSTRUMENT, f"{table.url} sends no angles within {_READ_S:g} s. Look at the table.")
    assert table.newest is not None
    return table.newest


def _wait_until_there(table: "KeptTable", motions: "tuple[Motion, ...]") -> None:
    """Wait until all motions are there; the keeper ends if the axes do not follow."""
    from imutui.table.motion import Readings

    readings = Readings()
    readings.begin(time.monotonic_ns(), motions)
    table.states.clear()
    while not all(motion.is_there(readings, table.limits) for motion in motions):
        show_progress(_text(_next(table)))
        while table.states:
            readings.add([table.states.popleft()])


def _wait(table: "KeptTable", seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        show_progress(_text(_next(table)))


# -------------------------------------------------------------------------------------------------------------- output


def _tell(table: "KeptTable", state: "TableState", json: bool) -> None:
    document = {
        "controller": table.url,
        "identity": table.identity,
        "axes": list(table.axes),
        "limits": {axis: {name: getattr(own, name) for name in _LIMITS} for axis, own in table.limits.items()},
        "state": asdict(state),
    }
    answer(document, lambda: _lines(table, state), json=json)


def _lines(table: "KeptTable", state: "TableState") -> str:
    from filters.motion.segments import AXES

    lines = [table.identity]
    for axis in table.axes:
        k = AXES.index(axis)
        # no zero with a minus
        angle, rate = round(state.angles_deg[k], 4) + 0.0, round(state.rates_dps[k], 3) + 0.0
        lines.append(f"{axis:7}{angle:10.4f} deg {rate:+9.3f} deg/s  {_may(table, axis)}")
    return "\n".join([*lines, f"mode {state.mode}{_fault(state)}"])


def _may(table: "KeptTable", axis: str) -> str:
    if axis not in table.limits:
        return "limits unknown"
    limits = table.limits[axis]
    ends = [f"{end:g}" for end in (limits.low_deg, limits.high_deg) if end is not None]
    return (
        f"{limits.rate_dps:g} deg/s, {limits.accel_dps2:g} deg/s^2{', ' + ' to '.join(ends) + ' deg' if ends else ''}"
    )


def _text(state: "TableState") -> str:
    angles = " ".join(f"{round(angle, 3) + 0.0:.3f}" for angle in state.angles_deg)
    return f"outer, middle, inner: {angles} deg, mode {state.mode}{_fault(state)}"


def _fault(state: "TableState") -> str:
    return f", FAULT: {state.fault}" if state.fault else ""

"""`imutui demo`: the main job on the virtual instrument."""

import os
import sys
from typing import Annotated, Any, Optional

import typer

from imutui.cli.options import Json, Rate

_RATE_HZ = 20.0


def command(
    headless: Annotated[
        bool, typer.Option("--headless", help="No terminal UI: progress and the final estimates.")
    ] = False,
    seconds: Annotated[Optional[float], typer.Option("--seconds", metavar="S", help="Headless: how long (60).")] = None,  # noqa: UP045
    rate: Rate = None,
    seed: Annotated[int, typer.Option("--seed", help="Of the virtual unit's biases and noise.")] = 0,
    json: Json = False,
) -> None:
    """Run the main job on a virtual instrument.

    It is acquired over its pseudo-terminal, recorded, filtered, shown. Nothing else is needed. All readings are
    simulated, and labelled so.

    Example: imutui demo --headless --seconds 60 --seed 7 --json
    """
    from imutui import config
    from imutui.cli.following import follow
    from imutui.cli.outcome import USAGE, fail
    from imutui.cli.session_options import plan_from

    if not headless and not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise fail(USAGE, "the terminal UI needs a terminal. Without one: `imutui demo --headless`.")
    if seed < 0:
        raise fail(USAGE, f"--seed is {seed}; it must not be negative.")
    plan = plan_from(
        config.load().with_flags({"acquisition.rate_hz": rate or _RATE_HZ}),
        None,
        port="virtual",
        record=True,
        duration_s=60.0 if headless and seconds is None else seconds,
        note="demo",
        # headless demos may run side by side; the one on the screen is found again by `imutui attach`
        name=f"demo-{os.getpid()}" if headless else "demo",
        virtual=("--seed", str(seed)),
    )
    if headless:
        follow(plan, json=json, add=lambda document: document | {"truth": truth(seed)})
    _show(plan)


def truth(seed: int) -> dict[str, Any]:
    """State and biases of the demo's virtual unit, with the names that the result's `final` has."""
    import numpy as np

    from filters import simulation
    from filters.state import PAPER_SITE, NavState
    from imutui.logbook import SessionInfo
    from imutui.logbook.results import state_fields

    unit = simulation.draw(seed)
    rest = NavState.at_rest(PAPER_SITE, np.eye(3))
    nav = NavState(
        rest.latitude, rest.longitude, rest.height, rest.velocity_n, rest.C_nb, unit.accel_bias, unit.gyro_bias
    )
    info = SessionInfo()
    return state_fields(nav, info.axes(), info.g_unit, np.ones(6, bool))


def _show(plan: Any) -> None:
    from imutui.session import client
    from imutui.tui import app

    running = plan.name in client.running()
    raise typer.Exit(app.run(client.attach(plan.name) if running else None, None if running else plan, logs=plan.logs))

"""`imutui demo`: the main job on the virtual instrument."""

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from imutui.cli.exit_codes import USAGE, fail
from imutui.cli.options import Flags, Json, takes_settings

if TYPE_CHECKING:
    from imutui.estimates import StateFields
    from imutui.logbook.results import RunDocument


@takes_settings("acquisition.rate_hz")
def command(
    *,
    headless: Annotated[
        bool, typer.Option("--headless", help="No terminal UI: progress and the final estimates.")
    ] = False,
    seconds: Annotated[float | None, typer.Option("--seconds", metavar="S", help="Headless: how long (60).")] = None,
    flags: Flags,
    seed: Annotated[int, typer.Option("--seed", help="Of the virtual unit's biases and noise.")] = 0,
    json: Json = False,
) -> None:
    """Run the main job on a virtual instrument.

    It is acquired over its pseudo-terminal, recorded, filtered, shown. Nothing else is needed. All readings are
    simulated, and labelled so. A minute after its last viewer has gone the demo ends by itself, with the file finished.

    Example: imutui demo --headless --seconds 60 --seed 7 --json
    """
    from filters.state import PAPER_PLACE
    from imutui import config
    from imutui.cli.attach import has_screen
    from imutui.cli.follow_acquisition import follow
    from imutui.cli.session_options import plan_from
    from imutui.session.plan import DEMO_RATE_HZ, STEADY, demo

    if not headless and not has_screen():
        raise fail(USAGE, "the terminal UI needs a terminal. Without one: `imutui demo --headless`.")
    if seed < 0:
        raise fail(USAGE, f"--seed is {seed}; it must not be negative.")
    settings = config.load().with_flags({"acquisition.rate_hz": DEMO_RATE_HZ} | flags)
    if not headless:
        shown = demo(plan_from(settings, None, port="virtual"), settings.number("acquisition.rate_hz"), seed)
        _show(replace(shown, duration_s=seconds))
    plan = plan_from(
        settings,
        PAPER_PLACE,
        port="virtual",
        record=True,
        duration_s=60.0 if seconds is None else seconds,
        note="demo",
        name=f"demo-{os.getpid()}",  # headless demos may run side by side
        virtual=("--seed", str(seed), "--scenario", str(STEADY)),
    )
    # the virtual unit stands there, whatever the user's configuration says of another place
    plan = replace(plan, gravity=None)
    follow(plan, json=json, add=lambda document: cast("RunDocument", {**document, "seed": seed, "truth": truth(seed)}))


def truth(seed: int) -> "StateFields":
    """State and biases of the demo's virtual unit, with the names that the result's `final` has."""
    import numpy as np

    from filters import simulation
    from filters.state import PAPER_SITE, NavState
    from imutui.logbook import SessionInfo, results

    unit = simulation.draw(seed)
    rest = NavState.at_rest(PAPER_SITE, np.eye(3))
    nav = NavState(
        rest.latitude, rest.longitude, rest.height, rest.velocity_n, rest.C_nb, unit.accel_bias, unit.gyro_bias
    )
    info = SessionInfo()
    return cast("StateFields", results.fields(results.state_columns(nav, info, results.ALL_SEEN)))


def _show(plan: Any) -> None:
    from imutui.cli.attach import appearance
    from imutui.session import client

    wanted = appearance()
    from imutui.tui import app

    running = plan.name in client.running()
    raise typer.Exit(
        app.run(
            client.attach(plan.name) if running else None,
            None if running else plan,
            logs=plan.logs,
            appearance=wanted,
        )
    )

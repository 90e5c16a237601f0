"""What pilot tests share: the screen as text, and waiting without sleeping."""

import contextlib
import time
from collections.abc import Callable
from typing import Any

from textual.pilot import Pilot, WaitForScreenTimeout

from helpers.processes import LIMIT_S
from imutui.tui.app import ImutuiApp

SMALLEST = (80, 24)


def text_of(app: ImutuiApp) -> str:
    """The screen in front, as the terminal has it."""
    strips = app.screen._compositor.render_strips()
    return "\n".join("".join(segment.text for segment in strip) for strip in strips)


async def until(pilot: Pilot[Any], truth: Callable[[], object]) -> None:
    """Let the application go on until something is true."""
    deadline = time.monotonic() + LIMIT_S
    while not truth():
        assert time.monotonic() < deadline, f"not true in time; the screen:\n{text_of(pilot.app)}"  # type: ignore[arg-type]
        # a busy machine's screen may not have done with its messages after Textual's 30 s
        with contextlib.suppress(WaitForScreenTimeout):
            await pilot.pause(0.02)


async def shows(pilot: Pilot[Any], *texts: str) -> str:
    """Wait until the screen has all texts, wrapped or not; returns it."""
    app = pilot.app
    assert isinstance(app, ImutuiApp)

    def has_all() -> bool:
        screen = text_of(app)
        unwrapped = " ".join(screen.split())
        return all(text in screen or text in unwrapped for text in texts)

    await until(pilot, has_all)
    return text_of(app)

"""What pilot tests share: the screen as text, and waiting without sleeping."""

import contextlib
import re
import time
from collections.abc import AsyncIterator, Callable, Mapping
from types import MappingProxyType
from typing import Any, Literal

from textual.pilot import Pilot, WaitForScreenTimeout

from helpers.fake_client import FakeClient, acquisition
from helpers.processes import LIMIT_S
from imutui.tui.app import ImutuiApp

SMALLEST = (80, 24)
NOTHING: Mapping[str, Any] = MappingProxyType({})


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


_KEY = re.compile(r"'(?P<typed>[^']*)'|(?P<name>[^\s*]+|\*)(?:\*(?P<times>\d+))?")


class See:
    """An application in a terminal: keys are pressed and words waited for, a step a call.

    A step is "keys → word | word | !word": keys by name with blanks between them, those of a text in 'quotes', one that
    is pressed several times as tab*3; words that the screen has at last, and behind an exclamation mark has no more.
    """

    def __init__(self, pilot: Pilot[Any], client: FakeClient) -> None:
        assert isinstance(pilot.app, ImutuiApp)
        self.pilot, self.app, self.client = pilot, pilot.app, client

    async def __call__(self, step: str) -> str:
        keys, _, words = step.partition("→")
        for key in _KEY.finditer(keys):
            typed, name, times = key["typed"], key["name"], int(key["times"] or 1)
            await self.pilot.press(*(typed if typed is not None else [name] * times))
        told = [word.strip() for word in words.split("|") if word.strip()]
        await shows(self.pilot, *(word for word in told if not word.startswith("!")))
        await self.until(lambda: not any(word[1:] in self.text() for word in told if word.startswith("!")))
        return self.text()

    async def shows(self, *texts: str) -> str:
        return await shows(self.pilot, *texts)

    async def until(self, truth: Callable[[], object]) -> None:
        await until(self.pilot, truth)

    def text(self) -> str:
        return text_of(self.app)


@contextlib.asynccontextmanager
async def opened(
    client: FakeClient | Literal["new"] | None = "new",
    *,
    size: tuple[int, int] = SMALLEST,
    options: Mapping[str, Any] = NOTHING,
    recording: bool = False,
    **changes: Any,
) -> AsyncIterator[See]:
    """The application on an acquisition that is not there, or on none, once it shows so.

    `client`: the acquisition, None for none; without it a new one that records or not, with changed fields.
    `options`: of the application.
    """
    client = acquisition(recording=recording, **changes) if client == "new" else client
    async with ImutuiApp(client, **options).run_test(size=size) as pilot:  # type: ignore[arg-type]
        see = See(pilot, client or FakeClient())
        known = client is not None and client.changes.get("kind") != "measured" and size >= SMALLEST
        await see("→ REC 0:" if known and client.recording else "→ SIMULATED" if known else "→ imutui")
        yield see

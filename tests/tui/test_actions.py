"""What every page offers: copy, themes, leaving."""

import pytest
from helpers.fake_client import FakeClient
from helpers.pilot import SMALLEST, shows, until

from imutui.tui.app import ImutuiApp
from imutui.tui.terminal.appearance import Appearance


def _app(client: FakeClient) -> ImutuiApp:
    return ImutuiApp(client)  # type: ignore[arg-type]


async def test_y_copies_the_numbers_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMUX", "/tmp/tmux-0/default,1,0")
    app = _app(FakeClient())
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        await pilot.press("y")
        await shows(pilot, "lines of Live", "tmux set -g set-clipboard on")
        assert "0.3461" in app.clipboard
        assert "1000.981" in app.clipboard
        assert "q quit" not in app.clipboard
        await pilot.press("4", "y")
        await shows(pilot, "lines of Filter")
        assert "±0.0291" in app.clipboard


async def test_a_theme_of_the_configuration_takes_effect() -> None:
    for asked, name in (("ansi-light", "ansi-light"), ("light", "textual-light"), ("dark", "textual-dark")):
        app = ImutuiApp(FakeClient(), appearance=Appearance(theme=asked))  # type: ignore[arg-type]
        async with app.run_test(size=SMALLEST) as pilot:
            await shows(pilot, "SIMULATED")
            assert app.theme == name
    with pytest.raises(ValueError, match=r'`screen.theme` is "sunset"; there are: dark, light.*ansi-dark'):
        Appearance(theme="sunset")


async def test_quitting_asks_about_jobs_that_would_be_lost() -> None:
    ended: list[str] = []
    app = ImutuiApp()
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "not connected")
        await pilot.press("6")
        page = app.page
        assert page is not None
        page.busy = lambda: ["tracing a.mcap"]  # type: ignore[method-assign]
        page.abandon = lambda: ended.append("ended")  # type: ignore[method-assign]
        await pilot.press("q")
        await shows(pilot, "tracing a.mcap: this ends with the screen, without a result")
        await pilot.press("escape", "q", "s")
        await until(pilot, lambda: app._exit)
    assert ended == ["ended"]

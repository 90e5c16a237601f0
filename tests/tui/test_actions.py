"""What every page offers: copy, themes, leaving."""

import pytest
from helpers.pilot import opened

from imutui.tui.terminal.appearance import Appearance


async def test_y_copies_the_numbers_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMUX", "/tmp/tmux-0/default,1,0")
    async with opened() as see:
        await see("y → lines of Live | tmux set -g set-clipboard on")
        assert "0.3461" in see.app.clipboard
        assert "1000.981" in see.app.clipboard
        assert "q quit" not in see.app.clipboard
        await see("4 y → lines of Filter")
        assert "±0.0291" in see.app.clipboard


async def test_a_theme_of_the_configuration_takes_effect() -> None:
    for asked, name in (("ansi-light", "ansi-light"), ("light", "textual-light"), ("dark", "textual-dark")):
        async with opened(options={"appearance": Appearance(theme=asked)}) as see:
            assert see.app.theme == name
    with pytest.raises(ValueError, match=r'`screen.theme` is "sunset"; there are: dark, light.*ansi-dark'):
        Appearance(theme="sunset")


async def test_quitting_asks_about_jobs_that_would_be_lost() -> None:
    ended: list[str] = []
    async with opened(None) as see:
        await see("6 →")
        page = see.app.page
        assert page is not None
        page.busy = lambda: ["tracing a.mcap"]  # type: ignore[method-assign]
        page.abandon = lambda: ended.append("ended")  # type: ignore[method-assign]
        await see("q → tracing a.mcap: this ends with the screen, without a result")
        await see("escape q s →")
        await see.until(lambda: see.app._exit)
    assert ended == ["ended"]

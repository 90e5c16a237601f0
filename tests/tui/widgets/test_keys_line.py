"""The last line: its keys are made anew when there are other ones, and only then."""

from helpers.fake_client import FakeClient
from helpers.pilot import SMALLEST, shows, until
from textual.widget import Widget

from imutui.tui.app import ImutuiApp
from imutui.tui.widgets.page_frame import KeysLine


async def test_keys_are_made_anew_when_there_are_other_ones_and_only_then() -> None:
    client = FakeClient()
    app = ImutuiApp(client)  # type: ignore[arg-type]
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "r record", "q quit")

        def keys() -> list[Widget]:
            return list(app.screen.query_one(KeysLine).children)

        await pilot.press("question_mark")
        await shows(pilot, "ON THE LIVE PAGE")
        await pilot.press("escape")
        await shows(pilot, "r record", "q quit")
        before = keys()
        app.screen.refresh_bindings()
        await pilot.pause()
        assert before
        assert all(one is other for one, other in zip(keys(), before, strict=True))
        client.recording = True
        await shows(pilot, "r finish", "m mark")
        await until(pilot, lambda: not set(keys()) & set(before))

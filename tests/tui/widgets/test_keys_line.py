"""The last line: its keys are made anew when there are other ones, and only then."""

from helpers.pilot import opened
from textual.widget import Widget

from imutui.tui.widgets.page_frame import KeysLine


async def test_keys_are_made_anew_when_there_are_other_ones_and_only_then() -> None:
    async with opened() as see:
        await see("→ r record | q quit")

        def keys() -> list[Widget]:
            return list(see.app.screen.query_one(KeysLine).children)

        await see("question_mark → ON THE LIVE PAGE")
        await see("escape → r record | q quit")
        before = keys()
        see.app.screen.refresh_bindings()
        await see.pilot.pause()
        assert before
        assert all(one is other for one, other in zip(keys(), before, strict=True))
        see.client.recording = True
        await see("→ r finish | m mark")
        await see.until(lambda: not set(keys()) & set(before))

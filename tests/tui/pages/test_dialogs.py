"""Every key that the last line shows works, and no key acts unseen: in each dialog, and while text is being typed."""

from collections.abc import Callable
from typing import Any

import pytest
from helpers.fake_client import FakeClient
from helpers.pilot import SMALLEST, shows, text_of, until
from textual import events
from textual.pilot import Pilot
from textual.screen import ModalScreen
from textual.widgets import Input

from imutui.tui.app import ImutuiApp
from imutui.tui.pages.dialogs import choice
from imutui.tui.pages.dialogs.base import FieldDialog
from imutui.tui.pages.dialogs.choice import ChoiceDialog
from imutui.tui.pages.dialogs.help import HelpDialog
from imutui.tui.pages.dialogs.note import MarkDialog, nothing_to_mark
from imutui.tui.pages.filter.page import WhyDialog
from imutui.tui.pages.logs.live_effects import EffectsDialog

_LETTERS = "dm1rPgot"  # keys of pages and of the application, as somebody types them who believes to be in a field

DIALOGS: dict[str, Callable[[ImutuiApp], ModalScreen[Any]]] = {
    "why": lambda app: WhyDialog(app.context.connection.view()),
    "help": lambda _: HelpDialog(),
    "mark": lambda _: MarkDialog(),
    "no mark": lambda _: nothing_to_mark(),
    "path": lambda _: FieldDialog("Open", "A folder."),
    "quit": lambda app: choice.quit_dialog(app.context.connection.newest),
    "jobs": lambda _: choice.jobs_dialog(["trace of a.mcap"]),
    "stop": lambda app: choice.stop_dialog(app.context.connection.newest),
    "zero": lambda _: choice.zero_dialog(),
    "ended": lambda _: choice.ended_dialog("the cable was pulled", typing=True),
    "cancel": lambda _: choice.cancel_dialog("trace of a.mcap"),
    "effects": lambda _: EffectsDialog([], loaded=True),
}


async def _open(pilot: Pilot[Any], name: str) -> ModalScreen[Any]:
    app = pilot.app
    assert isinstance(app, ImutuiApp)
    dialog = DIALOGS[name](app)
    app.push_screen(dialog)
    await until(pilot, lambda: app.screen is dialog and dialog.focused is not None)
    return dialog


def _shown(app: ImutuiApp) -> dict[str, str]:
    """Keys that the footer shows, and their actions."""
    return {key: a.binding.action for key, a in app.screen.active_bindings.items() if a.binding.show}


async def test_in_dialogs_the_shown_keys_work_and_no_other_acts(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[str] = []
    run_action = ImutuiApp.run_action

    async def noted(self: ImutuiApp, action: Any, *rest: Any) -> bool:
        ran.append(action)
        return await run_action(self, action, *rest)

    monkeypatch.setattr(ImutuiApp, "run_action", noted)
    client = FakeClient()
    app = ImutuiApp(client)  # type: ignore[arg-type]
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED", "q quit")
        for name in DIALOGS:
            dialog = await _open(pilot, name)
            keys = _shown(app)
            assert keys, name
            bindings = [a.binding for a in dialog.active_bindings.values() if a.binding.show]
            last_line = " ".join(f"{b.key_display or b.key} {b.description}" for b in bindings)
            await until(pilot, lambda last_line=last_line: last_line in " ".join(text_of(app).splitlines()[-1].split()))
            assert "q quit" not in text_of(app), name
            await pilot.press(*(letter for letter in _LETTERS if letter not in keys))
            assert app.screen is dialog, name
            for key, action in keys.items():
                if app.screen is not dialog:
                    dialog = await _open(pilot, name)
                ran.clear()
                await pilot.press(key)
                assert action in ran, (name, key)
            if app.screen is dialog:
                await pilot.press("escape")
            await until(pilot, lambda: not isinstance(app.screen, ModalScreen))
        assert not app._exit
        assert app.current_mode == "live"
        assert client.asked == []
        await shows(pilot, "q quit")


@pytest.mark.parametrize(("page", "key", "title"), [("3", "e", ""), ("5", "o", ""), ("6", "o", "Open"), ("2", "m", "")])
async def test_what_is_typed_faster_than_a_field_comes_is_typed_into_it(page: str, key: str, title: str) -> None:
    """A line that lags hands on a whole word at once: none of its letters detaches, and none is lost."""
    client = FakeClient()
    client.recording = True
    app = ImutuiApp(client)  # type: ignore[arg-type]
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "● REC")
        await pilot.press(page)
        await until(pilot, lambda: app.screen.is_mounted)
        for letter in f"{key}qd1":
            app.post_message(events.Key(letter, letter))
        await until(pilot, lambda: isinstance(app.focused, Input) and app.focused.value.endswith("qd1"))
        await shows(pilot, title)
        assert not app._exit
        assert client.asked == []


async def test_a_dialog_that_comes_while_somebody_types_takes_no_letter_for_an_answer() -> None:
    """The acquisition ends in the middle of a mark: the rest of the word answers nothing, nor does Enter."""
    client = FakeClient()
    client.recording = True
    app = ImutuiApp(client)  # type: ignore[arg-type]
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "● REC")
        await pilot.press("m", "d", "o")
        client.gone = "the cable was pulled"
        await shows(pilot, "The acquisition has ended")
        await pilot.press("c", "v")
        assert isinstance(app.screen, ChoiceDialog)
        await pilot.press("enter")
        await shows(pilot, "ENDED", "gx, deg/s")


async def test_a_dialog_is_answered_once() -> None:
    from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog

    answers: list[str | None] = []
    async with ImutuiApp(FakeClient()).run_test(size=(80, 24)) as pilot:  # type: ignore[arg-type]
        dialog = ChoiceDialog(
            "Which", "One of them.", [Answer("c", "connect", "connect"), Answer("x", "other", "other")]
        )
        pilot.app.push_screen(dialog, answers.append)
        await pilot.pause()
        for key in ("c", "x", "c"):
            dialog.post_message(events.Key(key, key))
        await pilot.pause()
        await pilot.pause()
    assert answers == ["connect"]

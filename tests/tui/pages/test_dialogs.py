"""Every key that the last line shows works, and no key acts unseen: in each dialog, and while text is being typed."""

from collections.abc import Callable
from typing import Any

import pytest
from helpers.pilot import See, opened
from textual import events
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


async def _open(see: See, name: str) -> ModalScreen[Any]:
    app = see.app
    assert isinstance(app, ImutuiApp)
    dialog = DIALOGS[name](app)
    app.push_screen(dialog)
    await see.until(lambda: app.screen is dialog and dialog.focused is not None)
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
    async with opened() as see:
        await see("→ SIMULATED | q quit")
        for name in DIALOGS:
            dialog = await _open(see, name)
            keys = _shown(see.app)
            assert keys, name
            bindings = [a.binding for a in dialog.active_bindings.values() if a.binding.show]
            last_line = " ".join(f"{b.key_display or b.key} {b.description}" for b in bindings)
            await see.until(lambda last_line=last_line: last_line in " ".join(see.text().splitlines()[-1].split()))
            assert "q quit" not in see.text(), name
            await see.pilot.press(*(letter for letter in _LETTERS if letter not in keys))
            assert see.app.screen is dialog, name
            for key, action in keys.items():
                if see.app.screen is not dialog:
                    dialog = await _open(see, name)
                ran.clear()
                await see(f"{key} →")
                assert action in ran, (name, key)
            if see.app.screen is dialog:
                await see("escape →")
            await see.until(lambda: not isinstance(see.app.screen, ModalScreen))
        assert not see.app._exit
        assert see.app.current_mode == "live"
        assert see.client.asked == []
        await see("→ q quit")


@pytest.mark.parametrize(("page", "key", "title"), [("3", "e", ""), ("5", "o", ""), ("6", "o", "Open"), ("2", "m", "")])
async def test_what_is_typed_faster_than_a_field_comes_is_typed_into_it(page: str, key: str, title: str) -> None:
    """A line that lags hands on a whole word at once: none of its letters detaches, and none is lost."""
    async with opened(recording=True) as see:
        await see(f"{page} →")
        await see.until(lambda: see.app.screen.is_mounted)
        for letter in f"{key}qd1":
            see.app.post_message(events.Key(letter, letter))
        await see.until(lambda: isinstance(see.app.focused, Input) and see.app.focused.value.endswith("qd1"))
        await see(f"→ {title}")
        assert not see.app._exit
        assert see.client.asked == []


async def test_a_dialog_that_comes_while_somebody_types_takes_no_letter_for_an_answer() -> None:
    """The acquisition ends in the middle of a mark: the rest of the word answers nothing, nor does Enter."""
    async with opened(recording=True) as see:
        await see("m d o →")
        see.client.gone = "the cable was pulled"
        await see("→ The acquisition has ended")
        await see("c v →")
        assert isinstance(see.app.screen, ChoiceDialog)
        await see("enter → ENDED | gx, deg/s")


async def test_a_dialog_is_answered_once() -> None:
    from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog

    answers: list[str | None] = []
    async with opened(size=(80, 24)) as see:
        dialog = ChoiceDialog(
            "Which", "One of them.", [Answer("c", "connect", "connect"), Answer("x", "other", "other")]
        )
        see.app.push_screen(dialog, answers.append)
        await see.pilot.pause()
        for key in ("c", "x", "c"):
            dialog.post_message(events.Key(key, key))
        await see.pilot.pause()
        await see.pilot.pause()
    assert answers == ["connect"]

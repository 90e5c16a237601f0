"""Questions with a few answers, each with a key: the dialog, and what is asked before something ends or changes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import ClassVar

from textual import events
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.widget import Widget
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from imutui.command_line import command
from imutui.session.snapshot import Snapshot
from imutui.tui import formatting, messages
from imutui.tui.pages.connect import text
from imutui.tui.pages.dialogs.base import Dialog
from imutui.tui.widgets.text_lines import WrappedText

_STAY = "stay"


@dataclass(frozen=True, slots=True)
class Answer:
    """One answer: key, what it returns, what it says; `also` has more keys, which are not shown."""

    key: str
    name: str
    label: str
    also: str = ""


class ChoiceDialog(Dialog[str | None]):
    """Asks; returns the chosen answer's name, None for Esc.

    `answers`: the first one is Enter's.
    `careful`: whether Enter is Esc instead.
    `stay`: what Esc means here.
    `letters`: whether the answers' keys choose. Without them a dialog that comes by itself can't be answered unawares
      by somebody who is typing.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "choose", "choose", key_display="enter", priority=True),
    ]

    def __init__(
        self,
        title: str,
        body: str,
        answers: list[Answer],
        *,
        careful: bool = False,
        stay: str = "cancel",
        letters: bool = True,
    ) -> None:
        super().__init__()
        self._title, self._body, self._answers = title, body, answers
        self._careful, self._stay, self._letters = careful, stay, letters

    def body(self) -> Iterable[Widget]:
        yield Static(Content.styled(self._title, "bold"), classes="title")
        yield WrappedText(self._body, classes="text")
        options = [Option(Content(f" {a.key if self._letters else ' '}  {a.label}"), id=a.name) for a in self._answers]
        yield OptionList(*options, Option(Content(f" Esc  {self._stay}"), id=_STAY), compact=True, markup=False)

    def on_mount(self) -> None:
        self.query_one(OptionList).highlighted = len(self._answers) if self._careful else 0

    def on_key(self, event: events.Key) -> None:
        """A letter chooses at once, and is no key of the page below any more."""
        for answer in self._answers if self._letters else []:
            if event.character is not None and event.character in (answer.key, *answer.also):
                event.stop()
                event.prevent_default()
                self.dismiss(answer.name)
                return

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(None if event.option_id == _STAY else event.option_id)

    def action_choose(self) -> None:
        self.query_one(OptionList).action_select()


def _recording(snapshot: Snapshot | None) -> str | None:
    recording = snapshot["recording"] if snapshot else None
    return PurePath(recording["path"]).name if recording else None


def quit_dialog(snapshot: Snapshot | None, jobs: Sequence[str] = ()) -> ChoiceDialog:
    """Ask whether the acquisition goes on without a screen; jobs of this screen end with it either way."""
    name = _recording(snapshot)
    if name is None:
        body = "It is not recording."
        leave, stop = "leave it running (come back with: imutui attach)", "stop the acquisition and quit"
    else:
        body = f"It is recording {name}."
        leave = "leave it: recording continues in the background"
        stop = "finish the file, stop the acquisition and quit"
    alone = messages.until(snapshot)
    body = "\n".join([body, *([f"Left, it goes on{alone}."] if alone else []), *_ending(jobs)])
    return ChoiceDialog("An acquisition is running", body, [Answer("l", "leave", leave), Answer("s", "stop", stop)])


def quit_rack_dialog(batch: str, units: Sequence[str], jobs: Sequence[str] = ()) -> ChoiceDialog:
    """The same of all units of a batch."""
    count = formatting.plural(len(units), "unit")
    answers = [
        Answer("l", "leave", f"leave them running; {command('attach', '--batch', batch)} comes back"),
        Answer("s", "stop", "finish the files, stop all units and quit"),
    ]
    said = [f"{count} of it {'is' if len(units) == 1 else 'are'} being acquired.", *_ending(jobs)]
    return ChoiceDialog(f"The batch {batch} is running", "\n".join(said), answers)


def jobs_dialog(jobs: Sequence[str]) -> ChoiceDialog:
    """Ask before the jobs of this screen end with it."""
    answers = [Answer("s", "quit", "stop it and quit")]
    return ChoiceDialog("Something is still being worked out", "\n".join(_ending(jobs)), answers)


def _ending(jobs: Sequence[str]) -> list[str]:
    return [f"{job}: this ends with the screen, without a result." for job in jobs]


def zero_dialog() -> ChoiceDialog:
    """Ask before the instrument is changed; Enter cancels."""
    answers = [Answer("z", "zero", "zero them now: the unit stands still")]
    return ChoiceDialog(text.ZERO_TITLE, text.ZERO_TEXT, answers, careful=True)


def move_dialog(url: str, what: str) -> ChoiceDialog:
    """Ask before a table moves by itself; Enter cancels."""
    body = (
        f"The table at {url} will be commanded through {what}, without another question. Look that nobody is near"
        " it, and that cables are free. Esc stops it at any time, on every page."
    )
    answers = [Answer("y", "yes", "yes, it may move")]
    return ChoiceDialog("THE TABLE WILL MOVE", body, answers, careful=True)


def stop_dialog(snapshot: Snapshot | None) -> ChoiceDialog:
    """Ask before an acquisition is stopped to connect to something else."""
    name = _recording(snapshot)
    body = f"Its recording {name} will be finished." if name else "It is not recording."
    return ChoiceDialog("Stop this acquisition?", body, [Answer("s", "stop", "stop it")], careful=True)


def ended_dialog(reason: str, *, typing: bool = False, rack: bool = False) -> ChoiceDialog:
    """Say that the acquisition is over; letters of somebody who was typing just then are no answers.

    `rack`: whether it is one of a batch, whose other units go on.
    """
    again = Answer("c", "connect", "connect again", also="1")
    answers = [Answer("0", "connect", "back to all units") if rack else again, Answer("q", "quit", "quit")]
    title, stay = "The acquisition has ended", "look at the last data"
    return ChoiceDialog(title, reason, answers, stay=stay, careful=typing, letters=not typing)


def cancel_dialog(job: str) -> ChoiceDialog:
    """Ask before a job is cancelled; Enter lets it go on."""
    answers = [Answer("y", "yes", "cancel it: nothing of it is kept")]
    return ChoiceDialog(f"Cancel {job}?", "It is still being worked out.", answers, careful=True, stay="let it go on")

"""The table profiles there are: a list, a field for the path of another, and what is in the one under the cursor."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from textual import work
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.message import Message
from textual.widgets import Input, Label, Static

from filters.errors import InputError
from imutui.session.snapshot import Snapshot
from imutui.tui.background import in_thread
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.base import FieldDialog
from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog
from imutui.tui.pages.table import profiles, text
from imutui.tui.terminal.glyphs import choose
from imutui.tui.widgets.option_rows import OptionRows

if TYPE_CHECKING:
    from imutui.jobs.operator_steps import Offer, OperatorStep


class ProfileChooser(Vertical):
    """Lead, list, field and preview; posts `Chosen` and `Written`."""

    @dataclass
    class Chosen(Message):
        """The filter shall go by a profile; None for no profile, a unit that stands still and level."""

        offer: "Offer | None"

    @dataclass
    class Written(Message):
        """A profile was written to a file."""

        path: Path

    def __init__(self) -> None:
        super().__init__(id="choose")
        self._now: Snapshot | None = None
        self._offers: list[Offer] = []
        self._looked = False
        self._level = False  # whether the first line is the way back to level
        self._wanted: Path | None = None  # file that the cursor goes to once it is in the list

    def compose(self) -> ComposeResult:
        yield Static(id="choose-lead")
        yield OptionRows(id="offers")
        with Horizontal(id="other-row"):
            yield Label("other file")
            yield Input(id="other", placeholder="path of a TOML or CSV file, or a name; o goes here", compact=True)
        yield Static(id="preview")

    def on_mount(self) -> None:
        self._say_lead()
        self._list()

    def show(self, now: Snapshot | None) -> None:
        """Offer the way back to level where the filter goes by a file."""
        self._now = now
        if self._looked and self._level != self._has_reference():
            self._list()
        self._say_lead()

    def _say_lead(self) -> None:
        self.query_one("#choose-lead", Static).update(Content.styled(text.lead(self._now), "bold"))

    def _has_reference(self) -> bool:
        """Whether the filter goes by a file, and so can be brought back to level."""
        now = self._now
        return now is not None and now["state"] == "running" and bool(now["reference"]["file"])

    # the list

    def look(self, folders: list[Path], wanted: Path | None = None, experiment: tuple[str, str] | None = None) -> None:
        """Look for profiles; with the cursor on one, if it is there; `experiment` is what a trace recommends."""
        self._wanted = wanted or self._wanted
        self._look(folders, experiment)

    @work(exclusive=True, group="look")
    async def _look(self, folders: list[Path], experiment: tuple[str, str] | None) -> None:
        found = await in_thread(lambda: profiles.found(folders, experiment))
        if not self.query("#preview"):  # the page has gone meanwhile
            return
        if not self._looked:
            self._looked = True
            self.query_one("#preview", Static).update("")
        known = {(offer.place, offer.name) for offer in found}
        self._offers = [*found, *(o for o in self._offers if (o.place, o.name) not in known and Path(o.place).is_dir())]
        self._list()

    def _list(self) -> None:
        rows, before = self.query_one("#offers", OptionRows), self._level
        self._level = self._looked and self._has_reference()
        lines = ([f" {text.LEVEL}"] if self._level else []) + text.offer_lines(self._offers, self.app.size.width)
        rows.fill([Content(choose().text(line)) for line in lines])
        at = next((n for n, o in enumerate(self._offers) if self._wanted == Path(o.place) / o.name), None)
        if at is not None:
            rows.highlighted, self._wanted = at + self._level, None
        elif self._level != before and rows.highlighted is not None:  # the cursor stays with its profile
            rows.highlighted = max(rows.highlighted + self._level - before, 0)
        self._preview()

    def as_text(self) -> str:
        return self.query_one("#offers", OptionRows).as_text()

    # what is under the cursor

    def _offer(self) -> "Offer | None":
        at = self.query_one("#offers", OptionRows).cursor
        number = -1 if at is None else at - self._level
        return self._offers[number] if 0 <= number < len(self._offers) else None

    def _at_level(self) -> bool:
        """Whether the cursor is on the way back to level."""
        return self._level and self.query_one("#offers", OptionRows).cursor == 0

    def on_option_list_option_highlighted(self) -> None:
        self._preview()

    @work(exclusive=True, group="preview")
    async def _preview(self) -> None:
        offer = self._offer()
        preview = self.query_one("#preview", Static)
        if offer is None:
            said = text.LEVEL_PREVIEW if self._at_level() else "" if self._looked else text.LOOKING
            preview.update(Content(choose().text(said)))
        elif offer.error:
            preview.update(Content(f"{offer.name} can't be used: {offer.error}"))
        else:
            steps = await in_thread(lambda: profiles.steps(offer))
            if self.query("#preview"):  # the page may have gone meanwhile
                preview.update(Content(choose().text("\n".join(self._preview_lines(offer, steps)))))

    def _preview_lines(self, offer: "Offer", steps: "list[OperatorStep]") -> list[str]:
        width, room = self.app.size.width - 2, max(self.query_one("#preview").size.height - 1, 1)
        about = text.about_lines(offer.about, width)
        return [*about, *text.preview(steps, width, max(room - len(about), 1))]

    # writing one

    def copy(self, folder: Path) -> None:
        """Write the profile under the cursor to a file of another name, after asking which."""
        offer = self._offer()
        if offer is None or offer.error:
            self.post_message(Page.Say("no profile here that could be copied", "wait"))
            return
        hint = f"It ends in {Path(offer.file).suffix}. A file that is there stays as it is."
        proposed = text.copy_name(offer.file, ready_made=offer.place == text.READY_MADE)
        dialog = FieldDialog(f"Copy {offer.name} to", hint, str(folder / proposed), select=False)

        def save(entered: str | None) -> None:
            if entered is not None:
                self._save(offer, entered)

        self.app.push_screen(dialog, save)

    @work(exclusive=True, group="open")
    async def _save(self, offer: "Offer", entered: str) -> None:
        path = Path(entered).expanduser()
        try:
            await in_thread(lambda: profiles.save(offer, path))
        except FileExistsError:
            self.post_message(Page.Say(f"{path} exists and is left as it is; s asks for another name", "bad"))
            return
        except (OSError, InputError) as error:
            said = error.strerror or error if isinstance(error, OSError) else error
            self.post_message(Page.Say(f"{path} is not written: {said}", "bad"))
            return
        self.post_message(Page.Say(f"wrote {path}", "good"))
        self.post_message(self.Written(path))

    # taking one

    def on_input_submitted(self, event: Input.Submitted) -> None:
        if event.value.strip():
            self._open(Path(event.value.strip()).expanduser())  # or a name, which no file has

    @work(exclusive=True, group="open")
    async def _open(self, path: Path) -> None:
        offer = await in_thread(lambda: profiles.read(path))
        if offer.error:
            self.post_message(Page.Say(f"{path}: {offer.error}", "bad"))
            return
        self._offers = [o for o in self._offers if (o.place, o.name) != (offer.place, offer.name)] + [offer]
        self._wanted = Path(offer.place) / offer.name
        self._list()
        self.query_one("#offers").focus()
        self._choose(offer)

    def take(self) -> None:
        offer = self._offer()
        if self._at_level():
            self.post_message(self.Chosen(None))
        elif offer is not None and offer.error:
            self.post_message(Page.Say(f"{offer.name} can't be used: {offer.error}", "bad"))
        elif offer is not None:
            self._choose(offer)

    def _choose(self, offer: "Offer") -> None:
        """Choose a profile; one that is not joined by marks may be followed by hand all the same."""
        if offer.align == "marks" or offer.file.endswith(".csv"):
            self.post_message(self.Chosen(offer))
            return
        if offer.still:
            self._take_by_hand(offer)
            return
        answers = [Answer("h", "hand", "I do, by hand: guide me"), Answer("t", "table", "the table, by itself")]
        dialog = ChoiceDialog(f"{offer.name}: who moves the table?", text.who(offer.align), answers)
        self.app.push_screen(dialog, lambda answer: self._answered(offer, answer))

    def _answered(self, offer: "Offer", answer: str | None) -> None:
        if answer == "hand":
            self._take_by_hand(offer)
        elif answer == "table":
            self.post_message(self.Chosen(offer))

    @work(exclusive=True, group="open")
    async def _take_by_hand(self, offer: "Offer") -> None:
        self.post_message(self.Chosen(await in_thread(lambda: profiles.by_hand(offer))))

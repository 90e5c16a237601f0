"""Loading found effects into the live filter: which, from where, and whether it takes them now."""

from collections.abc import Iterable
from pathlib import Path
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.content import Content
from textual.widget import Widget
from textual.widgets import OptionList, Static

from imutui.jobs import log_files
from imutui.jobs.log_files import EffectsFile
from imutui.report import effect_words
from imutui.session.client import Client
from imutui.tui import formatting
from imutui.tui.background import in_thread
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.base import Dialog, FieldDialog
from imutui.tui.pages.logs import text
from imutui.tui.widgets.option_rows import OptionRows
from imutui.tui.widgets.text_lines import WrappedText


class LiveEffects:
    """Asks for effects in front of a page, and has the acquisition take them.

    `page`: what is said is said there; its newest view says whether a recording runs.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._folder = Path()

    def choose(self, folder: Path) -> None:
        """Ask which effects the live filter shall take, of those in a folder and in the working folder."""
        self._folder = folder
        self._page.run_worker(self._choose(), exclusive=True, group="effects")

    async def _choose(self) -> None:
        folders = list(dict.fromkeys([self._folder, Path()]))
        files = await in_thread(lambda: log_files.effects_files(folders))
        now = self._page.now
        loaded = now is not None and bool(now["effects"])
        self._page.app.push_screen(EffectsDialog(files, loaded), self._chosen)

    def _chosen(self, file: EffectsFile | str | None) -> None:
        if file == "none":
            self.load("no effects", "")
        elif file == "open":
            hint = "A TOML file that a trace wrote. Enter opens it, Esc cancels."
            self._page.app.push_screen(FieldDialog("Effects file", hint, f"{self._folder}/"), self._typed)
        elif file is not None and not isinstance(file, str):
            self.load(file.path.name, file.text)

    def _typed(self, entered: str | None) -> None:
        if entered is not None:
            self._page.run_worker(self._open(entered), exclusive=True, group="effects")

    async def _open(self, entered: str) -> None:
        file = await in_thread(lambda: log_files.effects_file(Path(entered).expanduser()))
        if file.error:
            self._page.say(f"{entered}: {file.error}", "bad")
        else:
            self.load(file.path.name, file.text)

    def load(self, name: str, content: str) -> None:
        """Have the live filter take effects; it begins anew."""
        refused = text.refused(self._page.recording, "effects")
        if refused is not None:
            self._page.say(refused, "wait")
            return

        def ask(client: Client) -> str:
            client.configure(effects=content)
            return f"loaded {name}: the filter began anew with it"

        self._page.post_message(Page.Ask(ask, f"loading {name}"))


_NAME = 64
_LEAD = "The filter begins anew with them. Files that a trace wrote, newest first; o opens another."
_NONE = "No effects file here yet: t traces a log, then w on its result writes one. o opens another."


class EffectsDialog(Dialog[EffectsFile | str | None]):
    """Returns the file, "none" for no effects, "open" to type a path, None for Esc."""

    DEFAULT_CSS = "EffectsDialog OptionRows { height: auto; max-height: 10; margin-bottom: 1; }"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "take", "take", key_display="enter"),
        Binding("o", "open", "other file"),
    ]

    def __init__(self, files: list[EffectsFile], loaded: bool) -> None:
        super().__init__()
        self._files = files
        self._loaded = loaded

    def body(self) -> Iterable[Widget]:
        yield Static(Content.styled("Load effects into the live filter", "bold"), classes="title")
        yield WrappedText(_LEAD if self._files else _NONE, classes="text")
        yield OptionRows(id="files")
        yield WrappedText("", id="about", classes="text")

    def on_mount(self) -> None:
        names = [f" {name}" for name in formatting.apart([file.path.name for file in self._files], _NAME)]
        self.query_one(OptionRows).fill(
            [Content(name) for name in [*names, *([" no effects"] if self._loaded else [])]]
        )
        self.query_one(OptionRows).focus()
        self._about()

    def on_option_list_option_highlighted(self) -> None:
        self._about()

    def on_option_list_option_selected(self, _: OptionList.OptionSelected) -> None:
        self.action_take()

    def _file(self) -> EffectsFile | str | None:
        at = self.query_one(OptionRows).cursor
        if at is None:
            return None
        return self._files[at] if at < len(self._files) else "none"

    def _about(self) -> None:
        file = self._file()
        if file is None or isinstance(file, str):
            said = "The filter estimates biases only." if file else ""
        elif file.error:
            said = f"can't be used: {file.error}"
        else:
            said = f"{effect_words.included(file.effects) or 'no effect'}\n{file.source}"
        self.query_one("#about", WrappedText).update(said)

    def action_take(self) -> None:
        file = self._file()
        if file is not None and (isinstance(file, str) or not file.error):
            self.dismiss(file)

    def action_open(self) -> None:
        self.dismiss("open")

"""Asks which found effects shall join the filter."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar

from textual.binding import Binding, BindingType
from textual.content import Content
from textual.widget import Widget
from textual.widgets import OptionList, Static

from imutui.report import effect_words
from imutui.tui import formatting
from imutui.tui.pages.dialogs.base import Dialog
from imutui.tui.widgets.option_rows import OptionRows
from imutui.tui.widgets.wrapped_text import WrappedText

if TYPE_CHECKING:
    from imutui.jobs.sidecar_files import EffectsFile

_NAME = 64
_LEAD = "The filter begins anew with them. Files that a trace wrote, newest first; o opens another."
_NONE = "No effects file here yet: t traces a log, then w on its result writes one. o opens another."


class EffectsDialog(Dialog["EffectsFile | str | None"]):
    """Returns the file, "none" for no effects, "open" to type a path, None for Esc.

    `files`: what there is.
    `loaded`: whether the filter has effects now.
    """

    DEFAULT_CSS = "EffectsDialog OptionRows { height: auto; max-height: 10; margin-bottom: 1; }"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "take", "take", key_display="enter"),
        Binding("o", "open", "other file"),
    ]

    def __init__(self, files: "list[EffectsFile]", loaded: bool) -> None:
        super().__init__()
        self._files = files
        self._loaded = loaded

    def body(self) -> Iterable[Widget]:
        """Title, files, what is in the one with the cursor."""
        yield Static(Content.styled("Load effects into the live filter", "bold"), classes="title")
        yield WrappedText(_LEAD if self._files else _NONE, classes="text")
        yield OptionRows(id="files")
        yield WrappedText("", id="about", classes="text")

    def on_mount(self) -> None:
        """List the effects files that lie with the recordings."""
        names = [f" {formatting.shorten(file.path.name, _NAME)}" for file in self._files]
        self.query_one(OptionRows).fill(
            [Content(name) for name in [*names, *([" no effects"] if self._loaded else [])]]
        )
        self.query_one(OptionRows).focus()
        self._about()

    def on_option_list_option_highlighted(self) -> None:
        """Say what is in it."""
        self._about()

    def on_option_list_option_selected(self, _: OptionList.OptionSelected) -> None:
        """A file that was clicked is chosen, as by Enter."""
        self.action_take()

    def _file(self) -> "EffectsFile | str | None":
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
        """Take it, if it can be used."""
        file = self._file()
        if file is not None and (isinstance(file, str) or not file.error):
            self.dismiss(file)

    def action_open(self) -> None:
        """Ask for the path of a file that is not listed."""
        self.dismiss("open")

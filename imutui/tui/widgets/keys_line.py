"""The last line of a page or a dialog: the keys that do something there."""

from textual.widgets import Footer


class KeysLine(Footer):
    """Textual's footer, made anew only when it would show something else.

    Textual says that keys may have changed whenever the focus moves or a page comes to the front; mostly they have not,
    and a new widget for each of them costs more than all else that is drawn.
    """

    def __init__(self) -> None:
        super().__init__(compact=True, show_command_palette=False)
        self._made_of: list[object] | None = None

    async def recompose(self) -> None:
        """Take other keys, if there are other ones."""
        if not self.is_attached:  # its page went meanwhile
            return
        wanted: list[object] = [
            (active.binding, active.enabled, active.tooltip)
            for active in self.screen.active_bindings.values()
            if active.binding.show
        ]
        if wanted != self._made_of:
            self._made_of = wanted
            await super().recompose()

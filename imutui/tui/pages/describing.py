"""Note and operator of the file that is being written, changed from any page: asked in front of it, then written."""

from pathlib import Path

from imutui.session.client import Client
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.note import NoteDialog

_HINT = "Both go into the file that is being written; what stood there before stays in it as an event."


def describe_recording(page: Page) -> None:
    """Ask for note and operator of the recording that runs, and have the acquisition write what was changed.

    `page`: in front of which it is asked; nothing happens where no recording runs.
    """
    now = page.view.now if page.view is not None else None
    recording = now["recording"] if now is not None else None
    if now is None or recording is None:
        return
    name = Path(recording["path"]).name
    before = now["note"], now["operator"]

    def entered(after: tuple[str, str] | None) -> None:
        if after is None or after == before:
            return
        note, operator = (new if new != old else None for new, old in zip(after, before, strict=True))

        def ask(client: Client) -> str:
            client.describe(note, operator)
            return f"written into {name}"

        page.post_message(Page.Ask(ask, ""))

    page.app.push_screen(NoteDialog(f"Note of {name}", _HINT, *before), entered)

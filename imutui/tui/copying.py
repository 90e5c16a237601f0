"""Taking a page away: its numbers to the terminal's clipboard, its picture to a file."""

import os
from pathlib import Path

from imutui.tui import messages, pictures
from imutui.tui.context import AppContext


def copy_page(context: AppContext) -> None:
    """Copy the numbers of the page in front."""
    page = context.front
    if page is not None:
        copied = page.as_text()
        context.app.copy_to_clipboard(copied)
        context.say(messages.copied(page.TITLE or "", copied, os.environ), "none")


def save_picture(context: AppContext, folder: str) -> None:
    """Save a picture of the screen beside the recordings."""
    page = (context.front.TITLE or "").lower() if context.front is not None else ""
    try:
        path = pictures.save(context.app.export_screenshot(title=f"imutui {page}"), Path(folder), page)
        context.say(f"picture of the screen: {pictures.near(path)}", "good")
    except OSError as error:
        context.say(f"no picture saved: {error}. Start imutui in a folder that you may write to.", "bad")

"""A recording's note, name and end: add to it, rename it, delete it, each with the files that are its own."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from filters.errors import InputError
from imutui.jobs import log_files
from imutui.jobs.info import Brief
from imutui.tui import formatting
from imutui.tui.background import in_thread
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.base import FieldDialog
from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog
from imutui.tui.pages.dialogs.note import ask_for_note, describe_recording
from imutui.tui.pages.logs import text

Steps = Callable[[], tuple[str, Path | None]]  # done in a thread: returns what to say, and where the cursor goes


class FileActions:
    """Asks in front of the logs page, then does it in a thread and says what was done.

    `done`: called with the recording that the cursor goes to, None for where it is.
    """

    def __init__(self, page: Page, done: Callable[[Path | None], None]) -> None:
        self._page = page
        self._done = done

    def note(self, brief: Brief) -> None:
        """Ask for note and operator of a recording: into the file if this acquisition writes it, else beside it."""
        if self._writes(brief.path):
            describe_recording(self._page)
        elif brief.state == text.WRITING:
            self._say("another acquisition writes it: `imutui note --name NAME` changes its note", "wait")
        else:
            before = brief.latest_note, brief.latest_operator
            ask_for_note(self._page, brief.name, text.NOTE_HINT, before, partial(self._annotate, brief.path))

    def _annotate(self, path: Path, note: str | None, operator: str | None) -> None:
        def steps() -> tuple[str, Path | None]:
            made = log_files.annotate(path, note, operator)
            return f"written to {made.name}; the log itself is unchanged", path

        self._run(steps)

    def _writes(self, path: Path) -> bool:
        recording = self._page.recording
        return recording is not None and Path(recording["path"]).resolve() == path.resolve()

    def rename(self, brief: Brief) -> None:
        if brief.state == text.WRITING:
            self._say(text.WRITTEN, "wait")
        else:
            self._ask_for_name(brief, text.RENAME_HINT, brief.path.name)

    def _ask_for_name(self, brief: Brief, hint: str, value: str) -> None:
        """Ask; a name that cannot be is asked for again, with the reason."""

        def entered(name: str | None) -> None:
            def steps() -> tuple[str, Path | None]:
                made = log_files.rename(brief.path, name or "")
                return (
                    f"{brief.path.name} is {made.name} now" if made != brief.path else "the name is as it was"
                ), made

            if name is not None:
                self._run(steps, partial(self._ask_for_name, brief, value=name))

        self._page.app.push_screen(FieldDialog(f"Rename {brief.name}", hint, value), entered)

    def delete(self, brief: Brief) -> None:
        if brief.state == text.WRITING:
            self._say(text.WRITTEN, "wait")
        else:
            self._page.run_worker(self._ask_to_delete(brief), exclusive=True, group="files")

    async def _ask_to_delete(self, brief: Brief) -> None:
        try:
            found = await in_thread(lambda: log_files.of(brief.path))
        except OSError as error:
            self._say(f"{brief.path}: {error.strerror or error}", "bad")
            return
        answers = [Answer("y", "yes", "yes, delete it for good"), Answer("n", "no", "no, keep it")]

        def steps() -> tuple[str, Path | None]:
            more = len(log_files.delete(brief.path)) - 1
            beside = f" and {formatting.plural(more, 'file')} beside it" if more else ""
            return f"deleted {brief.path.name}{beside}", None

        def answered(answer: str | None) -> None:
            if answer == "yes":
                self._run(steps)

        body = text.deletion(brief.name, [path.name for path in found.beside], found.bytes)
        self._page.app.push_screen(ChoiceDialog(f"Delete {brief.name}?", body, answers, careful=True), answered)

    def _run(self, steps: Steps, again: Callable[[str], None] | None = None) -> None:
        self._page.run_worker(self._steps(steps, again), exclusive=True, group="files")

    async def _steps(self, steps: Steps, again: Callable[[str], None] | None) -> None:
        cursor = None
        try:
            said, cursor = await in_thread(steps)
        except InputError as error:
            if again is None:
                self._say(str(error), "bad")
            else:
                again(str(error))
        except OSError as error:
            self._say(f"{error.filename or 'the file'}: {error.strerror or error}", "bad")
        else:
            self._say(said, "good")
        self._done(cursor)

    def _say(self, said: str, level: str) -> None:
        self._page.say(said, level)

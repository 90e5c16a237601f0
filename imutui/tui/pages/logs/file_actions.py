"""A recording's note, name and end: add to it, rename it, delete it, each with the files that are its own."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from filters.errors import InputError
from imutui.tui.background import in_thread
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.base import FieldDialog
from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog
from imutui.tui.pages.dialogs.note import NoteDialog, describe_recording
from imutui.tui.pages.logs import text

if TYPE_CHECKING:
    from imutui.jobs.info import Brief
    from imutui.jobs.log_files import LogFiles


class FileActions:
    """Asks in front of the logs page, then does it in a thread and says what was done.

    `page`: what is said is said there.
    `done`: called with the recording that the cursor goes to, None for where it is.
    """

    def __init__(self, page: Page, done: Callable[[Path | None], None]) -> None:
        self._page = page
        self._done = done

    # notes

    def note(self, brief: "Brief") -> None:
        """Ask for note and operator of a recording: into the file if this acquisition writes it, else beside it."""
        if self._writes(brief.path):
            describe_recording(self._page)
            return
        if brief.state == text.WRITING:
            self._say("another acquisition writes it: `imutui note --name NAME` changes its note", "wait")
            return
        before = brief.latest_note, brief.latest_operator

        def entered(after: tuple[str, str] | None) -> None:
            if after is not None and after != before:
                note, operator = (new if new != old else None for new, old in zip(after, before, strict=True))
                self._run(lambda: _annotate(brief.path, note, operator), brief.path)

        self._page.app.push_screen(NoteDialog(f"Note of {brief.name}", text.NOTE_HINT, *before), entered)

    def _writes(self, path: Path) -> bool:
        recording = self._page.view.recording if self._page.view is not None else None
        return recording is not None and Path(recording["path"]).resolve() == path.resolve()

    # names

    def rename(self, brief: "Brief") -> None:
        if brief.state == text.WRITING:
            self._say(text.WRITTEN, "wait")
            return
        self._ask_for_name(brief, text.RENAME_HINT, brief.path.name)

    def _ask_for_name(self, brief: "Brief", hint: str, value: str) -> None:
        """Ask; a name that cannot be is asked for again, with the reason."""

        def entered(name: str | None) -> None:
            if name is not None:
                again = partial(self._ask_for_name, brief, value=name)
                self._run(lambda: _rename(brief.path, name), None, again)

        self._page.app.push_screen(FieldDialog(f"Rename {brief.name}", hint, value), entered)

    # the end

    def delete(self, brief: "Brief") -> None:
        if brief.state == text.WRITING:
            self._say(text.WRITTEN, "wait")
        else:
            self._page.run_worker(self._ask_to_delete(brief), exclusive=True, group="files")

    async def _ask_to_delete(self, brief: "Brief") -> None:
        try:
            found = await in_thread(lambda: _files_of(brief.path))
        except OSError as error:
            self._say(f"{brief.path}: {error.strerror or error}", "bad")
            return
        answers = [Answer("y", "yes", "yes, delete it for good"), Answer("n", "no", "no, keep it")]

        def answered(answer: str | None) -> None:
            if answer == "yes":
                self._run(lambda: _delete(brief.path), None)

        body = text.deletion(brief.name, [path.name for path in found.beside], found.bytes)
        self._page.app.push_screen(ChoiceDialog(f"Delete {brief.name}?", body, answers, careful=True), answered)

    # in a thread

    def _run(
        self,
        steps: Callable[[], tuple[str, Path | None]],
        cursor: Path | None,
        again: Callable[[str], None] | None = None,
    ) -> None:
        self._page.run_worker(self._steps(steps, cursor, again), exclusive=True, group="files")

    async def _steps(
        self, steps: Callable[[], tuple[str, Path | None]], cursor: Path | None, again: Callable[[str], None] | None
    ) -> None:
        try:
            said, path = await in_thread(steps)
        except InputError as error:
            if again is None:
                self._say(str(error), "bad")
            else:
                again(str(error))
        except OSError as error:
            self._say(f"{error.filename or 'the file'}: {error.strerror or error}", "bad")
        else:
            self._say(said, "good")
            cursor = path or cursor
        self._done(cursor)

    def _say(self, said: str, level: str) -> None:
        self._page.post_message(Page.Say(said, level))


def _annotate(path: Path, note: str | None, operator: str | None) -> tuple[str, Path | None]:
    from imutui.jobs import log_files

    made = log_files.annotate(path, note, operator)
    return f"written to {made.name}; the log itself is unchanged", path


def _rename(path: Path, name: str) -> tuple[str, Path | None]:
    from imutui.jobs import log_files

    made = log_files.rename(path, name)
    return (f"{path.name} is {made.name} now" if made != path else "the name is as it was"), made


def _files_of(path: Path) -> "LogFiles":
    from imutui.jobs import log_files

    return log_files.of(path)


def _delete(path: Path) -> tuple[str, Path | None]:
    from imutui.jobs import log_files

    more = len(log_files.delete(path)) - 1
    return f"deleted {path.name}{f' and {text.files(more)} beside it' if more else ''}", None

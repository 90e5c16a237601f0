"""What is asked of the acquisition while it runs: recordings, marks, the guide, and whatever a page asks."""

import time
from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from filters.errors import InputError
from imutui.session.client import Client
from imutui.session.plan import RecordingWish
from imutui.session.snapshot import RecordingSnapshot
from imutui.tui import messages
from imutui.tui.background import in_thread
from imutui.tui.context import AppContext
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.note import MarkDialog, NoteDialog, nothing_to_mark
from imutui.tui.pages.record import text

if TYPE_CHECKING:
    from imutui.jobs.documents import RunDocument

_NOTE_HINT = (
    "Enter records, with or without a note; it can be changed while the recording runs: n on page 3. Esc: not yet."
)

_SEEN_S = 2.0
# Dialogs' callbacks run in the app's own message queue: whatever takes a while must be a worker.


class RecordingControl:
    """Begins and finishes recordings as the Record page's form says, and tells that page what was written."""

    def __init__(self, context: AppContext) -> None:
        self._context = context
        self._finished: list[tuple[str, str]] = []
        self._under_way = False
        self._seen: Callable[[], bool] = lambda: True
        self._seen_by = 0.0

    def toggle(self) -> None:
        context, client = self._context, self._context.connection.client
        # a key that came twice is no wish to undo what the first one asked for
        if client is None or self._under_way or (time.monotonic() < self._seen_by and not self._seen()):
            return
        if context.recording is not None:
            self._start(lambda: self._finish(client))
            return
        try:
            wish = self._wish() or RecordingWish()
        except InputError as error:  # the form asks what cannot be
            context.say(f"not recorded: {error}", "bad")
            return
        if self._note(wish):
            self._start(lambda: self._begin(client, wish))
        else:
            self._ask_for_note(client, wish)

    def _note(self, wish: RecordingWish) -> str:
        """The note that a recording would get."""
        newest = self._context.connection.newest
        return (newest["note"] if newest is not None else "") if wish.note is None else wish.note

    def _ask_for_note(self, client: Client, wish: RecordingWish) -> None:
        def entered(answer: tuple[str, str] | None) -> None:
            if answer is not None:
                noted = replace(wish, note=answer[0])
                self._start(lambda: self._begin(client, noted))

        self._context.app.push_screen(NoteDialog("A note for this recording", _NOTE_HINT), entered)

    def begin_guide(self, *, yes_move: bool = False) -> None:
        """Begin to guide through the profile, with a recording if none runs; see `Client.guide`."""
        client = self._context.connection.client
        if client is not None:
            self._start(lambda: self._begin_guide(client, yes_move))

    def stop_table(self) -> None:
        """Stop a table under command, before anything else that was asked for is waited for."""
        client = self._context.connection.client
        if client is not None:
            self._context.work(self._stop_table(client))

    async def _stop_table(self, client: Client) -> None:
        async def steps() -> None:
            await in_thread(lambda: client.guide("cancel"))
            self._context.say("the table was stopped: rate zero, mode off. b on page 5 goes on", "wait")

        await self._context.guarded(steps)

    def _start(self, steps: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Do what was asked for, unless something else is under way."""
        if not self._under_way:
            self._under_way = True
            self._context.work(self._recorded(steps), "record")

    async def _recorded(self, steps: Callable[[], Coroutine[Any, Any, None]]) -> None:
        try:
            await self._context.guarded(steps)
        except InputError as error:  # the form asks what cannot be
            self._context.say(f"not recorded: {error}", "bad")
        finally:
            self._under_way = False

    async def _begin(self, client: Client, wish: RecordingWish) -> None:
        path = await in_thread(lambda: client.record(wish))
        self._begun()
        self._context.say(messages.recording_to(path, self._context.connection.newest), "good")
        self._shall_see(lambda: self._context.recording is not None)

    async def _finish(self, client: Client) -> None:
        context, recording = self._context, self._context.recording
        context.say("finishing the file", "wait")
        result = await in_thread(client.stop_recording)
        self.tell_page(text.finished(recording, result))
        shown = context.front is not None and context.front is context.record_page
        context.say("the file is finished" if shown else messages.finished(result), "good")
        path = None if recording is None else recording["path"]
        self._shall_see(lambda: context.recording is None or context.recording["path"] != path)

    def _shall_see(self, seen: Callable[[], bool]) -> None:
        """Leave out keys until the newest snapshot shows what was done, a little while at most: they meant that."""
        self._seen, self._seen_by = seen, time.monotonic() + _SEEN_S

    async def _begin_guide(self, client: Client, yes_move: bool) -> None:
        recording = self._context.recording
        wish = self._wish() if recording is None else None
        self._context.say("starting the recording" if recording is None else "beginning", "wait")
        await in_thread(lambda: client.guide("begin", wish, yes_move=yes_move))
        if recording is None:
            self._begun()
        self._context.say("recording; the line in bold above says what to do", "good")

    def _wish(self) -> RecordingWish | None:
        """What the form asks of the recording; InputError if it cannot be."""
        page = self._context.record_page
        return page.wish() if page is not None else None

    def _begun(self) -> None:
        """What was typed into the form is taken, and what was written before is no longer the last."""
        if self._context.record_page is not None:
            self._context.record_page.begun()
        self.tell_page([])

    def tell_finished(self, recording: RecordingSnapshot, result: "RunDocument") -> None:
        """A recording was finished by somebody else."""
        self.tell_page(text.finished(recording, result))

    def tell_page(self, finished: list[tuple[str, str]]) -> None:
        """What was written last stays on the Record page, which need not exist yet."""
        self._finished = finished
        self.show_finished(self._context.record_page)

    def show_finished(self, page: Page | None) -> None:
        """Have the Record page say what was written last, if this is that page."""
        record_page = self._context.record_page
        if record_page is not None and page is record_page:
            record_page.finished(self._finished)

    def ask_for_mark(self) -> None:
        if self._context.recording is None:
            self._context.app.push_screen(nothing_to_mark())
        else:
            self._context.app.push_screen(MarkDialog(), self._mark)

    def _mark(self, said: str | None) -> None:
        client = self._context.connection.client
        if said is not None and client is not None:
            self._context.work(self._set_mark(client, said))

    async def _set_mark(self, client: Client, said: str) -> None:
        async def steps() -> None:
            await in_thread(lambda: client.mark(said))
            self._context.say(f"marked: {said}", "good")

        await self._context.guarded(steps)

    def ask(self, request: Page.Ask) -> None:
        client = self._context.connection.client
        if client is not None:
            self._context.work(self._ask(client, request))

    async def _ask(self, client: Client, request: Page.Ask) -> None:
        async def steps() -> None:
            if said := await in_thread(lambda: request.function(client)):
                self._context.say(said, "good")

        if request.busy:
            self._context.say(request.busy, "wait")
        if await self._context.guarded(steps) and request.done is not None:
            request.done()

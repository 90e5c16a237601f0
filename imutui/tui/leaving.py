"""Leaving: detaching from the acquisition, stopping it, quitting, and what is asked before."""

from typing import TYPE_CHECKING, cast

from textual.screen import ModalScreen

from imutui.tui import messages
from imutui.tui.background import in_thread
from imutui.tui.connecting import Connector
from imutui.tui.context import FAULTS, AppContext
from imutui.tui.pages.dialogs.quit import jobs_dialog, quit_dialog, stop_dialog
from imutui.tui.pages.record import text
from imutui.tui.recording import RecordingControl

if TYPE_CHECKING:
    from imutui.tui.messages import RecordingResult


class Leaving:
    """Ends the screen, the acquisition, or both.

    `context`: what is left.
    `connector`: lets go of the acquisition.
    `recorder`: is told which file was finished.
    """

    def __init__(self, context: AppContext, connector: Connector, recorder: RecordingControl) -> None:
        self.farewell: list[str] = []
        """Lines for the terminal after the UI has gone."""
        self._context = context
        self._connector = connector
        self._recorder = recorder

    def quit(self) -> None:
        """Quit, after asking what becomes of the acquisition; in a dialog, close that."""
        context, app = self._context, self._context.app
        jobs = context.jobs()
        if isinstance(app.screen, ModalScreen):
            app.screen.dismiss(None)
        elif context.connection.client is not None:
            app.push_screen(quit_dialog(context.connection.newest, jobs), self._after_quit)
        elif jobs:
            app.push_screen(jobs_dialog(jobs), self._after_jobs)
        else:
            if self._connector.connecting:
                self.farewell.append("The acquisition that was being started is stopped.")
            app.exit(self._connector.exit_code)

    def _after_jobs(self, answer: str | None) -> None:
        if answer == "quit":
            self._context.app.exit(self._connector.exit_code)

    def _after_quit(self, answer: str | None) -> None:
        if answer == "leave":
            self.detach()
        elif answer == "stop":
            self._context.work(self._stop_and_quit())

    def detach(self) -> None:
        """Leave the screen; the acquisition goes on."""
        if self._context.connected("detach from"):
            self.farewell += messages.left(self._context.connection.newest)
            self._connector.release()
            self._context.app.exit(0)

    async def _stop_and_quit(self) -> None:
        error = await self._stop()
        self.farewell.append(error or self._context.connection.notice_text())
        self._context.app.exit(0 if error is None else 4)

    def ask_to_stop(self) -> None:
        """Stop the acquisition, after asking."""
        if self._context.connection.client is not None:
            self._context.app.push_screen(stop_dialog(self._context.connection.newest), self._after_stop)

    def _after_stop(self, answer: str | None) -> None:
        if answer == "stop":
            self._context.work(self._stop_only())

    async def _stop_only(self) -> None:
        error = await self._stop()
        if error is not None:
            self._context.say(error, "bad")

    async def _stop(self) -> str | None:
        """Stop the acquisition and say so; the error if it ended with one."""
        context, connection, recording = self._context, self._context.connection, self._context.recording
        client = connection.client
        if client is None:
            return None
        connection.pause()
        context.say("stopping: finishing the file" if recording else "stopping the acquisition", "wait")
        try:
            result = cast("RecordingResult | None", await in_thread(lambda: client.stop("the screen")))
        except FAULTS as error:
            return messages.fault(error)
        finally:
            self._connector.release()
            connection.over()
        done = [messages.finished(recording, result)] if recording else []
        self._recorder.tell_page(text.finished(recording, result) if recording else [])
        context.say("\n".join([*done, "the acquisition is stopped"]), "good")
        return None

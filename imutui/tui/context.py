"""What the parts of the application share: the acquisition as it is seen, the pages that are open, what is said."""

from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from textual.app import App

from imutui.session.client import SessionError
from imutui.session.snapshot import RecordingSnapshot
from imutui.tui import messages
from imutui.tui.connection.model import ConnectionModel
from imutui.tui.connection.rack import Rack
from imutui.tui.pages.base import PAGES, RACK, Page, page_class

if TYPE_CHECKING:
    from imutui.tui.pages.connect.page import ConnectPage
    from imutui.tui.pages.logs.page import LogsPage
    from imutui.tui.pages.record.page import RecordPage
    from imutui.tui.pages.table.page import TablePage

FAULTS = (SessionError, OSError)
"""What a call to the acquisition may raise: its own refusals, and a socket that does not answer."""


class AppContext:
    """The application, the acquisition, and the pages that were opened so far."""

    def __init__(self, app: App[int], rack: Rack | None = None) -> None:
        self.app = app
        self.rack = rack
        """Units of the batch that is looked at; each page of a unit leads back to them."""
        self.connection = ConnectionModel()
        self._opened: dict[str, Page] = {}  # Connect and Logs are asked for only once they are
        self._said_on: Page | None = None
        for _, title in [RACK, *PAGES]:
            app.add_mode(title.lower(), partial(self._open, title))

    def _open(self, title: str) -> Page:
        page = self._opened[title.lower()] = page_class(title)()
        return page

    @property
    def front(self) -> Page | None:
        """The page in front, also under a dialog."""
        return next((screen for screen in reversed(self.app.screen_stack) if isinstance(screen, Page)), None)

    @property
    def connect_page(self) -> "ConnectPage":
        return cast("ConnectPage", self._opened["connect"])

    @property
    def logs_page(self) -> "LogsPage":
        return cast("LogsPage", self._opened["logs"])

    @property
    def record_page(self) -> "RecordPage | None":
        return cast("RecordPage | None", self._opened.get("record"))

    @property
    def table_page(self) -> "TablePage | None":
        return cast("TablePage | None", self._opened.get("table"))

    def jobs(self) -> Sequence[str]:
        """What pages work out just now, and would be lost with the program."""
        return [job for page in self._opened.values() for job in page.busy()]

    @property
    def recording(self) -> RecordingSnapshot | None:
        """The file that is being written, as far as known."""
        newest = self.connection.newest
        return newest["recording"] if newest is not None else None

    # what is shown

    def show(self, page: Page) -> None:
        """Draw a page anew."""
        if page.is_whole and self.app.is_running:
            page.show(self.connection.view())

    def redraw(self) -> None:
        if self.front is not None:
            self.show(self.front)

    def say(self, said: str, level: str = "none") -> None:
        """Have something said at the bottom of the page."""
        self._said_on = self.front
        self.connection.say(said, level)
        self.redraw()

    def arrived(self, page: Page) -> None:
        """A page has come to the front: what was said on another one goes, and the page is drawn."""
        if page is not self._said_on:
            self.connection.say_no_longer()
        self.show(page)

    def connected(self, purpose: str) -> bool:
        """Whether there is an acquisition; without one, what it is lacking for is said."""
        if self.connection.client is None:
            newest = self.connection.newest
            ended = newest is not None and newest["state"] == "ended"
            cure = "the acquisition has ended. 1 connects again" if ended else "not connected. 1 connects; there, v"
            self.say(f"nothing to {purpose}: {cure}{'' if ended else ' starts the demo'}", "wait")
        return self.connection.client is not None

    # what may take a while

    def work(self, steps: Coroutine[Any, Any, None], group: str = "default") -> None:
        """Run a coroutine beside the event loop's other work; one of a named group ends the one before it."""
        self.app.run_worker(steps, exclusive=group != "default", group=group)

    async def guarded(self, steps: Callable[[], Coroutine[Any, Any, None]]) -> bool:
        """Run calls to the acquisition; False if they failed, which is said."""
        try:
            await steps()
        except FAULTS as error:
            self.say(messages.fault(error), "bad")
            return False
        return True

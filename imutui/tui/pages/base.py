"""What all pages share: header, notice, footer, and the message for a terminal that is too small."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module

from textual import events
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.message import Message
from textual.screen import Screen
from textual.widget import Widget

from imutui.session.client import Client
from imutui.session.snapshot import RecordingSnapshot, Snapshot
from imutui.tui.connection.model import View
from imutui.tui.connection.rack import Rack
from imutui.tui.widgets.page_frame import DebugLine, KeysLine, Notice, StatusHeader, TooSmall, is_too_small
from imutui.tui.widgets.text_lines import TextLines

PAGES = [("1", "Connect"), ("2", "Live"), ("3", "Record"), ("4", "Filter"), ("5", "Table"), ("6", "Logs")]
"""Keys and titles. A page's class stands in `pages/TITLE/page.py`, as TITLEPage."""
RACK = ("0", "Rack")
"""The same of the page that is there while a batch is looked at."""
WIDE = 112
TALL = 34


def page_class(title: str) -> "type[Page]":
    """The class of a page. It is loaded when it is first opened: the first frame waits for one page, not for six."""
    found: type[Page] = getattr(import_module(f"imutui.tui.pages.{title.lower()}.page"), f"{title}Page")
    return found


class Page(Screen[None]):
    """Base of pages; subclasses give `TITLE` and `body`."""

    @dataclass
    class Wanted(Message):
        """A page wants the newest view."""

        page: "Page"

    @dataclass
    class Ask(Message):
        """Have something asked of the acquisition, in a thread.

        `function`: asks the client; returns what to say when it is done, empty for nothing.
        `busy`: what to say meanwhile, empty for nothing.
        `done`: called in the event loop once it has worked.
        """

        function: Callable[[Client], str]
        busy: str
        done: Callable[[], None] | None = None

    @dataclass
    class Say(Message):
        """Have something said at the bottom of the page; level "none", "good", "wait" or "bad"."""

        text: str
        level: str = "none"

    def __init__(self) -> None:
        super().__init__()
        self.view: View | None = None
        self._fitted: tuple[int, int] | None = None

    @property
    def is_whole(self) -> bool:
        """Whether it has its widgets: data come before it is made, and while it goes."""
        return self.is_mounted and bool(self.query("#page"))

    @property
    def rack(self) -> Rack | None:
        """The units of the batch that is looked at, if one is."""
        rack = getattr(getattr(self.app, "context", None), "rack", None)
        return rack if isinstance(rack, Rack) else None

    @property
    def now(self) -> Snapshot | None:
        """The newest snapshot, as far as known."""
        return self.view.now if self.view is not None else None

    @property
    def recording(self) -> RecordingSnapshot | None:
        """The file that is being written now, if one is."""
        return self.view.recording if self.view is not None else None

    def say(self, text: str, level: str = "none") -> None:
        """Have something said at the bottom of the page."""
        self.post_message(self.Say(text, level))

    def redraw(self) -> None:
        """Show the newest view once more, if there is one."""
        if self.view is not None and self.is_whole:
            self.show(self.view)

    def compose(self) -> ComposeResult:
        yield TooSmall()
        with Vertical(id="page"):
            yield self.header()
            yield from self.body()
            yield DebugLine()
            yield Notice()
        yield KeysLine()

    def header(self) -> StatusHeader:
        """What stands above the page's own widgets."""
        return StatusHeader([RACK, *PAGES], self.TITLE or "")

    def body(self) -> Iterable[Widget]:
        """Widgets between header and notice."""
        raise NotImplementedError

    def show(self, view: View) -> None:
        """Show a view; subclasses add what is not lines of text."""
        self.view = view
        for widget in self.query(TextLines):
            widget.show(view)
        self.query_one(TooSmall).show(recording=view.recording is not None)

    def busy(self) -> Sequence[str]:
        """What this page works out just now and would be lost with the program: "tracing a.mcap, 40 %"."""
        return ()

    def abandon(self) -> None:
        """End that, because the program ends."""

    def on_unmount(self) -> None:
        self.abandon()

    def as_text(self) -> str:
        """The page's numbers, to be copied: its lines of text, as shown."""
        widgets = [w for w in self.query(TextLines) if w.display and not isinstance(w, (StatusHeader, Notice))]
        shown = [w.render().plain for w in widgets if all(node.display for node in w.ancestors_with_self)]
        return "\n".join(line.rstrip() for text in shown for line in text.splitlines() if line.strip())

    def on_mount(self) -> None:
        self._fit()
        self.post_message(self.Wanted(self))

    def on_resize(self, _: events.Resize) -> None:
        self._fit()

    def on_screen_suspend(self) -> None:
        """Under a dialog the keys of the page do nothing, so they are not shown."""
        self.query_one(KeysLine).visible = False

    def on_screen_resume(self) -> None:
        """Fit a size that changed while another page was on, and show the newest data."""
        self.query_one(KeysLine).visible = True
        self._fit()
        self.post_message(self.Wanted(self))

    def _fit(self) -> None:
        size = self.app.size
        if size == self._fitted:
            return
        self._fitted = size
        self.set_class(is_too_small(size), "-small")
        self.set_class(size.width >= WIDE, "-wide")
        self.set_class(size.height >= TALL, "-tall")
        self.query_one(TooSmall).refresh()
        self.refresh_bindings()  # some keys are only offered where they do something

"""Names of Textual and Rich that are nobody's promise: here, and nowhere else in this package.

What imutui does with them makes it cheaper, never possible: sending only the cells that changed, measuring how
the terminal takes what it is sent, and parsing each style sheet once. A version of Textual that lacks one of the names
gets the plain way instead: Textual's own drawing, no measuring, and style sheets parsed anew for every page.
`missing()` says what is lacking.
"""

import inspect
from collections.abc import Callable
from functools import cache
from typing import IO, TYPE_CHECKING, Any

from rich.color import ColorSystem
from textual.app import App
from textual.cache import LRUCache
from textual.css.stylesheet import Stylesheet

if TYPE_CHECKING:
    from rich.console import Console
    from textual.driver import Driver

try:
    from textual._compositor import ChopsUpdate, CompositorUpdate, LayoutUpdate
except ImportError:  # none of what is drawn is then one of these
    ChopsUpdate = LayoutUpdate = CompositorUpdate = type("CompositorUpdate", (), {})  # type: ignore[misc, assignment]
try:
    from textual.drivers.linux_driver import LinuxDriver
except ImportError:
    LinuxDriver = type("LinuxDriver", (), {})  # type: ignore[misc, assignment]

__all__ = ["ChopsUpdate", "CompositorUpdate", "LayoutUpdate", "LinuxDriver"]

DRAWING = ("ChopsUpdate", "LayoutUpdate", "_display")  # what sending only changed cells rests on
MEASURING = ("_driver", "_file", "_writer_thread", "_queue", "exit_event", "input_tty", "run_input_thread")
"""What measuring and watching the terminal rests on."""
PARSING = ("_parse_cache",)  # what parsing each style sheet once rests on
_SHEETS = 1024  # style sheets of one theme that are kept parsed: every widget has one, and every page
HIDDEN: set[str] = set()  # names that are taken as missing: tests put some here and look at what is then drawn


class WithoutTraceback(App[int]):
    """An application that ends at an unforeseen exception and shows nothing of it: whoever ran it says what it was."""

    def _fatal_error(self) -> None:
        self.bell()
        self._close_messages_no_wait()

    @property
    def unforeseen(self) -> Exception | None:
        return getattr(self, "_exception", None)


def _found(owner: object, name: str) -> bool:
    return name not in HIDDEN and hasattr(owner, name)


def _takes(function: Callable[..., object], *names: str) -> bool:
    return set(names) <= set(inspect.signature(function).parameters)


def missing() -> list[str]:
    """Names that this Textual lacks, or has otherwise than they are used; looked up on classes."""
    lacking = []
    if "ChopsUpdate" in HIDDEN or not _takes(ChopsUpdate, "chops", "spans", "chop_ends"):
        lacking.append("ChopsUpdate")
    if "LayoutUpdate" in HIDDEN or not _takes(LayoutUpdate, "strips", "region"):
        lacking.append("LayoutUpdate")
    if not _found(App, "_display") or list(inspect.signature(App._display).parameters)[1:] != ["screen", "renderable"]:
        lacking.append("_display")
    if not _found(LinuxDriver, "run_input_thread"):
        lacking.append("run_input_thread")
    return lacking


def draw_through(app: "App[Any]", exact: Callable[[Any], Any]) -> bool:
    """Have all that an application draws go through a function first.

    Returns false if this Textual has no place for that: it then draws as it does by itself.
    """
    if set(missing()) & set(DRAWING):
        return False
    plain = app._display

    def display(screen: Any, renderable: Any) -> None:
        plain(screen, exact(renderable))

    app._display = display  # type: ignore[method-assign]
    return True


@cache
def _parsed(variables: frozenset[tuple[str, str]]) -> "LRUCache[tuple[Any, ...], Any]":
    """Style sheets parsed so far with these colours; their rules are read, and never written."""
    del variables
    return LRUCache(_SHEETS)


class KeptStylesheet(Stylesheet):
    """Textual's style sheet, which parses each source once.

    Textual keeps 64 parsed sources, of more than there are, and puts them away at every page that is opened.
    """

    def __init__(self, variables: dict[str, str]) -> None:
        super().__init__(variables=variables)
        self._parse_cache = _parsed(frozenset(variables.items()))

    def set_variables(self, variables: dict[str, str]) -> None:
        """Set the colours; what was parsed with others stays for when they come again."""
        self._parse_cache = LRUCache(1)  # the one that is put away
        super().set_variables(variables)
        self._parse_cache = _parsed(frozenset(variables.items()))

    def reparse(self) -> None:
        self.parse()


def keep_parsed_styles(app: "App[Any]") -> bool:
    """Have an application that does not run yet parse each style sheet once; False if it goes on as Textual does."""
    if not _found(app.stylesheet, *PARSING):
        return False
    app.stylesheet = KeptStylesheet(app.get_css_variables())
    return True


def color_system(console: "Console") -> ColorSystem:
    """Colours of a terminal; all of them where Rich does not tell."""
    found = getattr(console, "_color_system", None) if "_color_system" not in HIDDEN else None
    return found if isinstance(found, ColorSystem) else ColorSystem.TRUECOLOR


def driver_of(app: "App[Any]") -> "Driver | None":
    """The driver of a running application; None if it does not tell."""
    return getattr(app, "_driver", None) if "_driver" not in HIDDEN else None


def replace_output(driver: "Driver", output: Callable[[IO[str]], Any]) -> None:
    """Put something in place of the file that a driver writes to, if it has one."""
    if _found(driver, "_file"):
        driver._file = output(driver._file)  # type: ignore[attr-defined]


def queued(driver: "Driver") -> int:
    """Writes that wait for the terminal; 0 where that cannot be told."""
    thread = getattr(driver, "_writer_thread", None) if "_writer_thread" not in HIDDEN else None
    queue = getattr(thread, "_queue", None) if "_queue" not in HIDDEN else None
    return int(queue.qsize()) if queue is not None else 0


def is_watchable(driver: "Driver") -> bool:
    """Whether a driver tells where it reads, and can be told to stop: its terminal's end can then be waited for."""
    return all(_found(driver, name) for name in ("exit_event", "input_tty", "fileno"))


def stop_reading(driver: "Driver") -> None:
    """Have a driver read no more."""
    if _found(driver, "exit_event"):
        driver.exit_event.set()  # type: ignore[attr-defined]

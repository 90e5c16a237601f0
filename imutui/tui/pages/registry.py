"""The table of pages. Each is loaded when it is first opened: the first frame waits for one page, not for six."""

from importlib import import_module

from imutui.tui.pages.base import Page

SCREENS: dict[str, tuple[str, str]] = {
    "connect": ("imutui.tui.pages.connect.page", "ConnectPage"),
    "live": ("imutui.tui.pages.live.page", "LivePage"),
    "record": ("imutui.tui.pages.record.page", "RecordPage"),
    "filter": ("imutui.tui.pages.filter.page", "FilterPage"),
    "table": ("imutui.tui.pages.table.page", "TablePage"),
    "logs": ("imutui.tui.pages.logs.page", "LogsPage"),
}
"""Module and class of pages by name. A new one also gets a key and a title in `base.PAGES`."""


def page_class(name: str) -> type[Page]:
    """The class of a page, its module loaded."""
    module, cls = SCREENS[name]
    found: type[Page] = getattr(import_module(module), cls)
    return found

"""Pages and dialogs, one a module; `SCREENS` is the table of pages."""

from imutui.tui.pages.base import PAGES, Page
from imutui.tui.pages.connect.page import ConnectPage
from imutui.tui.pages.filter.page import FilterPage
from imutui.tui.pages.live.page import LivePage
from imutui.tui.pages.logs.page import LogsPage
from imutui.tui.pages.record.page import RecordPage
from imutui.tui.pages.table.page import TablePage

SCREENS: dict[str, type[Page]] = {
    "connect": ConnectPage,
    "live": LivePage,
    "record": RecordPage,
    "filter": FilterPage,
    "table": TablePage,
    "logs": LogsPage,
}
"""Pages by name. A new one also gets a key and a title in `page.PAGES`."""

__all__ = ["PAGES", "SCREENS", "ConnectPage", "FilterPage", "LivePage", "Page", "RecordPage"]

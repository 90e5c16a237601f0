"""Pages and dialogs, one a module; `SCREENS` is the table of pages."""

from imutui.tui.screens.connect import ConnectPage
from imutui.tui.screens.filter import FilterPage
from imutui.tui.screens.live import LivePage
from imutui.tui.screens.logs import LogsPage
from imutui.tui.screens.page import PAGES, Page
from imutui.tui.screens.record import RecordPage
from imutui.tui.screens.table import TablePage

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

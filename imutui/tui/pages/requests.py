"""What pages ask of the application, or through it of another page."""

from pathlib import Path
from typing import TypedDict

from textual.message import Message


class PlanChanges(TypedDict):
    """Fields of a plan that the connect page asks for."""

    port: str
    rate_hz: float
    sampling: str
    filter: str
    reference: str


class ConnectRequest(Message):
    """Of the application: to connect to something else, or to nothing."""


class Start(ConnectRequest):
    """Start an acquisition whose plan has these fields otherwise than usual."""

    def __init__(self, changes: PlanChanges) -> None:
        super().__init__()
        self.changes = changes


class StartDemo(ConnectRequest):
    """Start the demo, or look at the one that runs."""


class Resume(ConnectRequest):
    """Look at a running acquisition."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name


class Cancel(ConnectRequest):
    """The operator gives up the connection that is being made."""


class Stop(ConnectRequest):
    """Stop the acquisition that is connected."""


class BeginGuide(Message):
    """Record as the Record page's form says, and guide through the table profile."""


class LogsRequest(Message):
    """Of the logs page."""


class Trace(LogsRequest):
    """Trace the recording that runs, up to now; `path` is its file."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path


class ChooseEffects(LogsRequest):
    """Offer found effects for the live filter."""


class LoadEffects(LogsRequest):
    """Have the live filter take effects: their names, and the effects file as text."""

    def __init__(self, name: str, text: str) -> None:
        super().__init__()
        self.name = name
        self.text = text


class ExperimentFound(Message):
    """Of the table page: a trace recommends a motion, a profile as TOML; `source` says which trace."""

    def __init__(self, text: str, source: str) -> None:
        super().__init__()
        self.text = text
        self.source = source


class OfferProfile(Message):
    """Of the table page: come to the front with the cursor on a profile that was just written."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path

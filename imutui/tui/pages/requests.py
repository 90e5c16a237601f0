"""What pages ask of the application, or through it of another page."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from textual.message import Message


class ConnectRequest(Message):
    """Of the application: to connect to something else, or to nothing."""


@dataclass
class Start(ConnectRequest):
    """Start an acquisition whose plan has these fields otherwise than usual."""

    changes: dict[str, Any]


class StartDemo(ConnectRequest):
    """Start the demo, or look at the one that runs."""


@dataclass
class Resume(ConnectRequest):
    """Look at a running acquisition."""

    name: str


@dataclass
class LookAt(ConnectRequest):
    """Look at a unit of the rack, on a page."""

    name: str
    page: str


@dataclass
class StartUnits(ConnectRequest):
    """Start units of the rack that do not run; `done` is called once that is over."""

    names: list[str]
    done: Callable[[], None]


@dataclass
class OpenRack(ConnectRequest):
    """Look at the units of a batch."""

    batch: str


class Cancel(ConnectRequest):
    """The operator gives up the connection that is being made."""


class Stop(ConnectRequest):
    """Stop the acquisition that is connected."""


@dataclass
class BeginGuide(Message):
    """Record as the Record page's form says, and guide through the table profile.

    `yes_move`: somebody has said that a table under command may move.
    """

    yes_move: bool = False


class LogsRequest(Message):
    """Of the logs page."""


@dataclass
class Trace(LogsRequest):
    """Trace the recording that runs, up to now; `path` is its file."""

    path: Path


class ChooseEffects(LogsRequest):
    """Offer found effects for the live filter."""


@dataclass
class LoadEffects(LogsRequest):
    """Have the live filter take effects: their names, and the effects file as text."""

    name: str
    text: str


@dataclass
class ExperimentFound(Message):
    """Of the table page: a trace recommends a motion, a profile as TOML; `source` says which trace."""

    text: str
    source: str


@dataclass
class OfferProfile(Message):
    """Of the table page: come to the front with the cursor on a profile that was just written."""

    path: Path

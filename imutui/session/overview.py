"""All of a user's acquisitions at once: one that hangs, connects or has just ended costs no other's line."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from imutui.session import client
from imutui.session.client import SessionConnectingError, SessionError, SessionGoneError
from imutui.session.snapshot import NO_SERIES, Snapshot

CONNECTING, SILENT = "connecting", "does not answer"
_AT_ONCE = 16


@dataclass(frozen=True, slots=True)
class Answer:
    """What an acquisition says of itself."""

    name: str  # of the acquisition
    snapshot: Snapshot | None  # without series; None if there is none to be had
    missing: str = ""  # why there is none: "connecting" or "does not answer"


def ask(names: Sequence[str]) -> list[Answer]:
    """Ask acquisitions, all at once, how they are; one that has ended meanwhile is left out."""
    if not names:
        return []
    with ThreadPoolExecutor(min(_AT_ONCE, len(names))) as pool:
        return [answer for answer in pool.map(_ask, names) if answer is not None]


def _ask(name: str) -> Answer | None:
    try:
        return Answer(name, client.attach(name).snapshot(since=NO_SERIES))
    except SessionConnectingError:
        return Answer(name, None, CONNECTING)
    except SessionGoneError:
        return None
    except SessionError:
        return Answer(name, None, SILENT) if name in client.running() else None

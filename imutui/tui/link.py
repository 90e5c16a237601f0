"""The acquisition that the UI looks at: its client, its newest snapshot, the past that plots show."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from textual.message import Message

from imutui.session.client import Client
from imutui.tui.feed import Feed
from imutui.tui.pace import Pacing
from imutui.tui.series import Series

Snapshot = dict[str, Any]
_CHANNELS = 7
_BIASES = 6
_BIAS_ROWS = 1 << 15
_SAID_S = {"none": 20.0, "good": 30.0, "wait": 60.0, "bad": 300.0}
NOTHING = ("none", "")


@dataclass(frozen=True, slots=True)
class View:
    """What a page shows.

    Attributes
    ----------
    now : dict or None
        The newest snapshot: recording, link, alarms; never frozen.
    shown : dict or None
        The snapshot of tables and plots; an old one while the view is frozen.
    series, biases : Series
        Packets, and estimated biases, of the plots.
    frozen : bool
        Whether the view stands still.
    notice : tuple of str
        Level and text of what the UI has to say, empty text for nothing.
    pacing : Pacing
        How much is drawn, and how often.
    debug : str
        What drawing costs.
    """

    now: Snapshot | None
    shown: Snapshot | None
    series: Series
    biases: Series
    frozen: bool
    notice: tuple[str, str]
    pacing: Pacing = field(default_factory=Pacing)
    debug: str = ""


class Link:
    """Client, feed and past of one acquisition; without an acquisition it is empty."""

    def __init__(self) -> None:
        self.client: Client | None = None
        self._feed: Feed | None = None
        self._said, self._said_until = NOTHING, 0.0
        self._pacing, self._debug = Pacing(), ""
        self._clear()

    def _clear(self) -> None:
        self.newest: Snapshot | None = None
        self._series = Series(_CHANNELS)
        self._biases = Series(_BIASES, _BIAS_ROWS)
        self._frozen: View | None = None

    def attach(self, client: Client, post: Callable[[Message], bool]) -> None:
        """Look at an acquisition."""
        self.leave()
        self._clear()
        self.client = client
        self._feed = Feed(client, post, self._pacing.fps)
        self._feed.start()

    def pace(self, pacing: Pacing, debug: str = "") -> None:
        """Draw so much and so often from now on; `debug` says what it costs."""
        self._pacing, self._debug = pacing, debug
        if self._feed is not None:
            self._feed.rate_hz = pacing.fps

    def pause(self) -> None:
        """Poll no more, because the acquisition is being ended."""
        if self._feed is not None:
            self._feed.stop()
            self._feed = None

    def leave(self) -> Client | None:
        """Let go, keeping what was seen; returns the client for whoever closes it, which may take a moment."""
        self.pause()
        client, self.client = self.client, None
        return client

    def over(self) -> None:
        """The acquisition has ended: its last data stay, no longer as something that runs."""
        if self.newest is not None:
            self.newest = {**self.newest, "state": "ended", "recording": None, "silent_s": None}

    def owns(self, feed: Feed) -> bool:
        """Whether a feed's message is about this acquisition, and not a late one of the last."""
        return feed is self._feed

    def take(self, snapshot: Snapshot) -> None:
        """A snapshot has come."""
        self.newest = snapshot
        series = snapshot["series"]
        if series["t"]:
            self._series.extend(np.asarray(series["t"], float), np.asarray(series["values"], float))
        self._take_biases(snapshot)

    def _take_biases(self, snapshot: Snapshot) -> None:
        estimates = snapshot.get("filter")
        if not estimates or estimates.get("t") is None or estimates.get("waiting"):
            return
        values = [np.nan if bias["value"] is None else bias["value"] for bias in estimates["biases"]]
        t = np.array([float(estimates["t"])])
        if len(values) == _BIASES and not np.array_equal(self._biases.last(0.0)[0], t):
            self._biases.extend(t, np.array([values], float))

    def freeze(self, frozen: bool) -> None:
        """Let the view stand still, or follow again. Data are taken either way."""
        if frozen:
            self._frozen = View(self.newest, self.newest, self._series.frozen(), self._biases.frozen(), True, NOTHING)
        else:
            self._frozen = None

    @property
    def frozen(self) -> bool:
        """Whether the view stands still."""
        return self._frozen is not None

    def view(self) -> View:
        """What to show now."""
        if self._frozen is None:
            view = View(self.newest, self.newest, self._series, self._biases, False, NOTHING)
        else:
            view = self._frozen
        return replace(view, now=self.newest, notice=self._notice(), pacing=self._pacing, debug=self._debug)

    def say(self, text: str, level: str = "none") -> None:
        """Have something said at the bottom of the page for a while."""
        self._said = (level, text)
        self._said_until = time.monotonic() + _SAID_S[level]

    def notice_text(self) -> str:
        """What was said last."""
        return self._said[1]

    def _notice(self) -> tuple[str, str]:
        return self._said if time.monotonic() < self._said_until else NOTHING

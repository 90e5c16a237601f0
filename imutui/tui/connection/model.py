"""The acquisition that the UI looks at: its client, its newest snapshot, the past that plots show."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from filters.health.finding import without_bias
from imutui.estimate_history import EstimateHistory, HistorySnapshot
from imutui.estimates import FilterSnapshot
from imutui.session.client import Client
from imutui.session.snapshot import RecordingSnapshot, Snapshot
from imutui.tui.connection.packet_series import CHANNELS, TEMPERATURE, PacketSeries
from imutui.tui.connection.poller import Poller
from imutui.tui.connection.verdict import Debounce, ended, of_snapshot
from imutui.tui.terminal.pacing import Pacing
from imutui.verdict.rules import Verdict

_BIASES = 6
_SAID_S = {"none": 20.0, "good": 30.0, "wait": 60.0, "bad": 300.0}
_LEFT_S = {"none": 3.0, "good": 3.0, "wait": 3.0, "bad": 15.0}
"""How long a message is shown, and how long still where another page has come to the front."""
NOTHING = ("none", "")


@dataclass(frozen=True, slots=True)
class View:
    """What a page shows."""

    now: Snapshot | None  # the newest snapshot: recording, link, alarms; never frozen
    shown: Snapshot | None  # the snapshot of tables and plots; an old one while the view is frozen
    series: PacketSeries  # packets of the plots
    biases: EstimateHistory  # estimated biases and their certainty over the run
    temperature: EstimateHistory  # temperature over the run, degC
    frozen: bool  # whether the view stands still
    notice: tuple[str, str]  # level and text of what the UI has to say, empty text for nothing
    verdict: Verdict | None = None  # on the filter, now; never frozen
    shown_verdict: Verdict | None = None  # on the filter of `shown`
    slope_k_per_min: float | None = None  # of the temperature of `shown`
    pacing: Pacing = field(default_factory=Pacing)  # how much is drawn, and how often
    debug: str = ""  # what drawing costs

    @property
    def estimates(self) -> FilterSnapshot | None:
        """What the filter of `shown` estimates; None without a filter."""
        return self.shown["filter"] if self.shown is not None else None

    def fault_of(self, channel: str) -> str | None:
        """Return why the bias of a channel cannot be estimated: the channel's fault; None if it has none."""
        return None if self.shown is None else without_bias(self.shown["health"], channel)

    @property
    def recording(self) -> RecordingSnapshot | None:
        """The file that is being written now, if one is."""
        return self.now["recording"] if self.now is not None else None


class ConnectionModel:
    """Client, poller and past of one acquisition; without an acquisition it is empty."""

    def __init__(self) -> None:
        self.client: Client | None = None
        self._poller: Poller | None = None
        self._said, self._said_until = NOTHING, 0.0
        self._pacing, self._debug = Pacing(), ""
        self._clear()

    def _clear(self) -> None:
        self.newest: Snapshot | None = None
        self._series = PacketSeries(CHANNELS)
        self._newest_estimate_s = -np.inf
        self._begin_history(0)
        self._debounce = Debounce()
        self._verdict: Verdict | None = None
        self._slope: float | None = None
        self._frozen: View | None = None

    def _begin_history(self, run: int) -> None:
        self._run = run
        self._biases, self._temperature = EstimateHistory(_BIASES), EstimateHistory(1)

    def attach(self, client: Client, post: Callable[[Poller.Arrived | Poller.Lost], bool]) -> None:
        self.leave()
        self._clear()
        self._said = NOTHING
        self.client = client
        self._poller = Poller(client, post, self._pacing.fps)
        self._poller.start()

    def set_pacing(self, pacing: Pacing, debug: str = "") -> None:
        """Draw so much and so often from now on; `debug` says what it costs."""
        self._pacing, self._debug = pacing, debug
        if self._poller is not None:
            self._poller.rate_hz = pacing.fps

    def pause(self) -> None:
        """Poll no more, because the acquisition is being ended."""
        if self._poller is not None:
            self._poller.stop()
            self._poller = None

    def leave(self) -> Client | None:
        """Let go, keeping what was seen; returns the client for whoever closes it, which may take a moment."""
        self.pause()
        client, self.client = self.client, None
        return client

    def forget(self) -> None:
        """Let go, and keep nothing of what was seen."""
        self.leave()
        self._clear()

    def over(self) -> None:
        """The acquisition has ended: its last data stay, no longer as something that runs."""
        if self.newest is not None:
            self.newest = {**self.newest, "state": "ended", "recording": None, "silent_s": None}
        self._verdict = ended(self._verdict)
        if self._frozen is not None:
            self._frozen = replace(self._frozen, shown_verdict=self._verdict)

    def owns(self, poller: Poller) -> bool:
        """Whether what a poller posts is about this acquisition, and not a late one of the last."""
        return poller is self._poller

    def take(self, snapshot: Snapshot, history: tuple[HistorySnapshot, ...] = ()) -> None:
        """A snapshot has come, and what is new of the run's past."""
        self.newest = snapshot
        series = snapshot["series"]
        if series["t"]:
            self._series.extend(np.asarray(series["t"], float), np.asarray(series["values"], float))
        for piece in history:
            self._take_history(piece)
        slope = self._series.slope_per_minute(TEMPERATURE)
        self._slope = self._temperature.slope_per_minute(0) if slope is None else slope
        if (estimates := snapshot["filter"]) is not None:
            # pages show the slope that the verdict goes by
            self._slope = estimates["temperature_k_per_min"]
        self._note_run(snapshot)
        # the acquisition's clock, which goes on when the filter's does not
        self._verdict = self._debounce.take(float(snapshot["since_start_s"]), of_snapshot(snapshot))

    def _take_history(self, piece: HistorySnapshot) -> None:
        if piece["run"] != self._run:
            self._begin_history(piece["run"])
        self._biases.extend(piece["estimates"])
        self._temperature.extend(piece["temperature"])

    def _note_run(self, snapshot: Snapshot) -> None:
        """Begin the verdict's memory anew where another run of the filter has begun."""
        estimates = snapshot["filter"]
        if estimates is None or not estimates["samples"] or estimates["waiting"]:
            return
        if estimates["duration_s"] < self._newest_estimate_s:
            self._debounce = Debounce()
        self._newest_estimate_s = estimates["duration_s"]

    def freeze(self, frozen: bool) -> None:
        """Let the view stand still, or follow again. Data are taken either way."""
        self._frozen = self._view(frozen=True) if frozen else None

    @property
    def frozen(self) -> bool:
        return self._frozen is not None

    def view(self) -> View:
        view = self._frozen or self._view(frozen=False)
        said, pacing = self._notice(), self._pacing
        return replace(view, now=self.newest, notice=said, verdict=self._verdict, pacing=pacing, debug=self._debug)

    def _view(self, *, frozen: bool) -> View:
        return View(
            self.newest,
            self.newest,
            self._series.frozen() if frozen else self._series,
            self._biases.frozen() if frozen else self._biases,
            self._temperature.frozen() if frozen else self._temperature,
            frozen,
            self._notice(),
            verdict=self._verdict,
            shown_verdict=self._verdict,
            slope_k_per_min=self._slope,
        )

    def say(self, text: str, level: str = "none") -> None:
        """Have something said at the bottom of the page for a while."""
        self._said = (level, text)
        self._said_until = time.monotonic() + _SAID_S[level]

    def say_no_longer(self) -> None:
        """What was said belongs to a page that is left: it stays only as long as it takes to read it."""
        self._said_until = min(self._said_until, time.monotonic() + _LEFT_S[self._said[0]])

    def notice_text(self) -> str:
        return self._said[1]

    def _notice(self) -> tuple[str, str]:
        return self._said if time.monotonic() < self._said_until else NOTHING

"""How much is drawn and how often: by wish, by how far away the terminal is, and less where it falls behind.

Pure decisions; what a terminal takes is measured in `terminal`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

LOCAL_FPS = 10.0
REMOTE_FPS = 5.0
AUTO = "auto"
SCROLL, SWEEP, NUMBERS = "scroll", "sweep", "numbers"
WISHES = (AUTO, SCROLL, SWEEP, NUMBERS)
_SLOWEST_FPS = 2.0
_TABLE_HZ = {False: 5.0, True: 2.5}

_BEHIND_BUSY, _KEEPS_BUSY = 0.5, 0.2
_BEHIND_S, _KEEPS_S = 0.5, 0.1
_BEHIND_ROUND_TRIP_S, _KEEPS_ROUND_TRIP_S = 1.5, 0.7
_SETTLE_S = 2.0
_PATIENCE_S, _MOST_PATIENCE_S = 20.0, 640.0


@dataclass(frozen=True, slots=True)
class Load:
    """How a terminal takes what it is sent."""

    busy: float = 0.0  # share of the last second in which a write was under way
    stuck_s: float = 0.0  # how long the write under way has lasted; 0 if none is
    queue: int = 0  # writes that wait behind it
    # how long the terminal took to answer, at least; None if it does not answer such questions
    round_trip_s: float | None = None

    @property
    def behind(self) -> bool:
        return self.busy > _BEHIND_BUSY or self.stuck_s > _BEHIND_S or (self.round_trip_s or 0.0) > _BEHIND_ROUND_TRIP_S

    @property
    def keeps_up(self) -> bool:
        return self.busy < _KEEPS_BUSY and self.stuck_s < _KEEPS_S and (self.round_trip_s or 0.0) < _KEEPS_ROUND_TRIP_S


@dataclass(frozen=True, slots=True)
class Pacing:
    """What is drawn, and how often."""

    mode: str = SCROLL  # "scroll", "sweep" or "numbers"
    fps: float = LOCAL_FPS  # frames a second
    # changes a second of the table of channels: nobody reads faster, and a plot shows what is between
    table_hz: float = _TABLE_HZ[False]
    note: str = ""  # why it is less than wished, for the screen; empty if it is not


def is_remote(environ: Mapping[str, str]) -> bool:
    """Whether the terminal is at the other end of an SSH link."""
    return bool(environ.get("SSH_CONNECTION"))


class PacingController:
    """Wish and what becomes of it.

    Steps down at once where the terminal falls behind, and up again only after it has kept up for a while: longer each
    time that going up turned out to be too much.

    `fps`: frames a second; 0 for 10, and 5 over SSH.
    """

    def __init__(self, wish: str = AUTO, fps: float = 0.0, *, remote: bool = False) -> None:
        self._remote = remote
        self._fps = fps if fps > 0.0 else REMOTE_FPS if remote else LOCAL_FPS
        self._patience_s = _PATIENCE_S
        self.wish = wish if wish in WISHES else AUTO
        self._begin()

    def _begin(self) -> None:
        self._steps = self._ladder()
        self._step = 0
        self._changed_at = self._kept_since = float("-inf")
        self._went_up_at = float("-inf")

    def _ladder(self) -> list[Pacing]:
        """From what is wished down to the least."""
        top, half, least = self._fps, max(self._fps / 2, min(self._fps, _SLOWEST_FPS)), min(self._fps, _SLOWEST_FPS)
        if self.wish != AUTO:
            pairs = [(self.wish, top), (self.wish, half), (self.wish, least)]
        else:
            pairs = [(SWEEP, top), (SWEEP, half), (NUMBERS, least)]
            pairs = pairs if self._remote else [(SCROLL, top), *pairs]
        table = _TABLE_HZ[self._remote]
        steps = [Pacing(mode, fps, min(table, fps)) for mode, fps in dict.fromkeys(pairs)]
        return [steps[0], *(replace(step, note="link is slow") for step in steps[1:])]

    @property
    def pacing(self) -> Pacing:
        """How much is drawn, and how often, from now on."""
        return self._steps[self._step]

    def cycle(self) -> Pacing:
        """The next wish that shows a difference; after the last one it is chosen by itself again."""
        before = self.pacing.mode
        following = WISHES[WISHES.index(self.wish) + 1 :] + WISHES[:1]
        self.wish = next(wish for wish in following if wish != before)
        self._begin()
        return self.pacing

    def judge(self, now: float, load: Load) -> bool:
        """Take what the terminal does; True if the pacing has changed."""
        if not load.keeps_up:
            self._kept_since = float("inf")
        elif self._kept_since == float("inf") or self._kept_since < self._changed_at:
            self._kept_since = now
        if load.behind:
            return now - self._changed_at >= _SETTLE_S and self._down(now)
        return now - self._kept_since >= self._patience_s and self._up(now)

    def _down(self, now: float) -> bool:
        if self._step + 1 == len(self._steps):
            return False
        if now - self._went_up_at < 2 * _PATIENCE_S:
            self._patience_s = min(2 * self._patience_s, _MOST_PATIENCE_S)
        self._step, self._changed_at = self._step + 1, now
        return True

    def _up(self, now: float) -> bool:
        if self._step == 0:
            return False
        self._step, self._changed_at, self._went_up_at = self._step - 1, now, now
        return True

"""The owner of a table: starts the keeper, commands through it, and stops the table if the keeper dies.

The keeper stops the table when its owner dies. A user who kills both at once has to press the emergency stop.
"""

import contextlib
import itertools
import math
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from filters.errors import InputError
from imutui.table import messages
from imutui.table.acutrol import connect
from imutui.table.keeper import BRAKES_S, stop_for_certain
from imutui.table.links import TableError
from imutui.table.messages import Command, Report

if TYPE_CHECKING:
    from imutui.table.motion import AxisLimits, TableState

_BEAT_S = 0.2
_START_S = 30.0
_SILENT_S = 5.0
_END_S = 75.0
_BRAKES_MOST_S = 20.0  # waited for between rate zero and mode off
_MOST_STATES = 1 << 16


class KeptTable:
    """A table whose link a keeper has; `close` has the keeper stop the table and end.

    `limits_text`: limits of the operator, as `motion.parse_limits` reads them.
    `lives`: returns whether the commanding program works; the keeper stops the table soon after it returns False.
    `starts`: False starts no keeper, as if it had ended.
    `identity`, `axes`, `limits`: those of the controller; limits are narrowed by the operator's.
    Raises TableError if there is no controller, or no keeper within `_START_S`.
    """

    def __init__(
        self, url: str, limits_text: str = "", lives: Callable[[], bool] = lambda: True, *, starts: bool = True
    ) -> None:
        self.url = url
        self.states: deque[TableState] = deque(maxlen=_MOST_STATES)
        self.newest: TableState | None = None
        self.news: deque[tuple[str, bool]] = deque()  # texts for the operator, and whether each is a warning
        self.error = ""  # why the keeper ended, if it was not asked to
        self.enabled = False
        self.identity, self.axes = "", ()  # type: str, tuple[str, ...]
        self.limits: dict[str, AxisLimits] = {}
        self._lives = lives
        self._closing = self._told_its_end = False
        self._started, self._ended, self._writing = threading.Event(), threading.Event(), threading.Lock()
        self._numbers = itertools.count(1)  # of commands: an answer names the one that it belongs to
        self._awaited: dict[int, str | None] = {}  # refusals by number of a command, "" if it is done; None: no answer
        self._answered = threading.Condition()
        self._accel_dps2 = math.inf  # the gentlest acceleration that was commanded
        if not starts:
            self._ended.set()
            return
        command = [sys.executable, "-P", "-m", "imutui.table.keeper", url, "--limits", limits_text]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        self._heard_s = time.monotonic()
        threading.Thread(target=self._read, name="table", daemon=True).start()
        self._wait_for_start()
        threading.Thread(target=self._beat, name="heartbeat", daemon=True).start()

    def _wait_for_start(self) -> None:
        """Wait for the keeper's first line; raises TableError if it has an error, or does not come in time."""
        if not self._started.wait(_START_S):
            self._process.kill()
            self._ended.wait(_SILENT_S)
            raise TableError(
                f"the controller at {self.url} has not answered the table's keeper within {_START_S:g} s. Check that it"
                " is on, and its address."
            )
        if not self.axes:
            self._process.wait()
            raise TableError(self.error or "the keeper of the table did not start.")

    @property
    def has_ended(self) -> bool:
        """True if the keeper has ended."""
        return self._ended.is_set()

    def send(self, command: Command) -> None:
        """Have the keeper carry out a command; a refusal is added to `news`, the keeper's end is in `error`."""
        self._write(replace(command, number=next(self._numbers)))

    def _write(self, command: Command) -> None:
        if command.do == "enable":
            self.enabled = True
        self._accel_dps2 = min([self._accel_dps2, *(motion.accel_dps2 for motion in command.motions)])
        line = messages.encode(command)
        with contextlib.suppress(OSError, ValueError), self._writing:  # the reader reports a keeper that has gone
            assert self._process.stdin is not None
            self._process.stdin.write(line)
            self._process.stdin.flush()

    def ask(self, command: Command, timeout_s: float = 30.0) -> None:
        """Send a command and wait until it is carried out; raises TableError if it is refused, or the keeper ends."""
        number, was_enabled = next(self._numbers), self.enabled
        self._awaited[number] = None
        self._write(replace(command, number=number))
        with self._answered:
            self._answered.wait_for(lambda: self._awaited[number] is not None or self._ended.is_set(), timeout_s)
        said = self._awaited.pop(number)
        if said is None:
            raise TableError(self.error or "the controller does not answer.")
        if said:
            self.enabled = was_enabled if command.do == "enable" else self.enabled
            raise TableError(said)

    def close(self) -> None:
        """Have the keeper stop the table, if it was enabled, and end; waits until it has."""
        if not self.has_ended:
            self._closing = True
            self.send(Command("off"))
            self._ended.wait(_END_S)

    # -- threads ----------------------------------------------------------------------------------------------------

    def _beat(self) -> None:
        while not self._ended.wait(_BEAT_S):
            if self._lives():
                self.send(Command("beat"))
            if time.monotonic() - self._heard_s > _SILENT_S:  # it hangs, and watches over nothing
                self._process.kill()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._heard_s = time.monotonic()
            with contextlib.suppress(InputError):  # the last line of a keeper that was killed
                self._take(messages.report(line))
            self._started.set()
        self._process.wait()
        if not self._told_its_end:
            self._stop_it_ourselves()
        self._ended.set()
        self._started.set()
        with self._answered:
            self._answered.notify_all()

    def _take(self, report: Report) -> None:
        if report.identity:
            self.identity, self.axes, self.limits = report.identity, report.axes, report.limits
        if report.state is not None:
            self.newest = report.state
            self.states.append(report.state)
        self._told_its_end |= report.ended
        self.error = report.error or self.error
        for text, is_warning in ((report.said, False), (report.refused, True), (report.error, True)):
            if text and (is_warning or not self._closing):
                self.news.append((text, is_warning))
        if report.to in self._awaited:
            with self._answered:
                self._awaited[report.to] = report.refused
                self._answered.notify_all()

    def _stop_it_ourselves(self) -> None:
        """Stop the table over a link of our own: the keeper was killed, or failed."""
        self.error = "the keeper of the table ended without a word."
        if self.enabled:
            found = stop_for_certain(
                None, lambda asks: connect(self.url, asks=asks), lambda said: self.news.append((said, False)),
                self._braking_s(), is_deaf=True,
            )  # fmt: skip
            if found is None:
                self.error += " Its rest is NOT confirmed: press the table's emergency stop."
            else:
                self.error += " Rate zero and mode off were sent from here."
                found.close()
        self.news.append((self.error, True))

    def _braking_s(self) -> float:
        """Return the time within which all axes come to rest, s."""
        if self.newest is None:
            return BRAKES_S
        accel = min([self._accel_dps2, *(own.accel_dps2 for own in self.limits.values())])
        return min(1.0 + max(map(abs, self.newest.rates_dps)) / accel, _BRAKES_MOST_S)

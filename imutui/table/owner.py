"""A table as its owner has it: starts the keeper, commands through it, and stops the table itself if the keeper dies.

The keeper stops the table when its owner dies, and the owner when its keeper does; who kills both at once has to press
the emergency stop.
"""

import contextlib
import json
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, cast

from imutui import fast_time
from imutui.table.controller import AxisLimits, TableError, TableState
from imutui.table.keeper import Told
from imutui.table.registry import connect

_BEAT_S = 0.2
_START_S = 30.0
_SILENT_S = 5.0
_END_S = 70.0
_MOST_STATES = 1 << 16
_AGAIN_S, _TRIES = 0.5, 60
_real_s = time.monotonic


class KeptTable:
    """A table that a keeper has the link to; `close` has the keeper stop it and end.

    `limits_text`: of `gate.parse_limits`, what the operator gives.
    `lives`: whether whoever commands does its work still; the keeper stops the table soon after it says no.
    `identity`, `axes`, `limits`: what the controller said, narrowed by what the operator gives.
    Raises TableError if there is no controller, or no keeper.
    """

    def __init__(self, url: str, limits_text: str = "", lives: Callable[[], bool] = lambda: True) -> None:
        self.url = url
        self.states: deque[TableState] = deque(maxlen=_MOST_STATES)
        self.newest: TableState | None = None
        self.news: deque[tuple[str, bool]] = deque()  # what was said or refused, and whether it is a warning
        self.error = ""  # why it ended, if not as told
        self.enabled = False
        self._lives = lives
        self._closing = self._told_its_end = False
        self._ended, self._writing = threading.Event(), threading.Lock()
        self._answers: deque[str] = deque()
        self._answered = threading.Condition()
        command = [sys.executable, "-P", "-m", "imutui.table", url, "--limits", limits_text, *fast_time.arguments()]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        self._heard_s = _real_s()
        self.identity, self.axes, self.limits = self._first_line()
        self._reader = threading.Thread(target=self._read, name="table", daemon=True)
        self._reader.start()
        threading.Thread(target=self._beat, name="heartbeat", daemon=True).start()

    def _first_line(self) -> tuple[str, tuple[str, ...], dict[str, AxisLimits]]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        told: Told = json.loads(line) if line else {"error": "the keeper of the table did not start."}
        if "error" in told:
            self._process.wait()
            raise TableError(told["error"])
        limits = {axis: AxisLimits(**cast("dict[str, float]", each)) for axis, each in told["limits"].items()}
        return told["identity"], tuple(told["axes"]), limits

    @property
    def pid(self) -> int:
        """Of the keeper."""
        return self._process.pid

    @property
    def has_ended(self) -> bool:
        """Whether the keeper has ended, as told or not."""
        return self._ended.is_set()

    def send(self, **command: Any) -> None:
        """Have the keeper carry out a command, `do`; what comes of it is in `news` or `error`."""
        if command["do"] == "enable":
            self.enabled = True
        with contextlib.suppress(OSError, ValueError), self._writing:  # a keeper that has gone is told by the reader
            assert self._process.stdin is not None
            self._process.stdin.write(json.dumps(command).encode() + b"\n")
            self._process.stdin.flush()

    def ask(self, timeout_s: float = 30.0, **command: Any) -> None:
        """Send a command and wait until it is carried out; raises TableError if it is refused, or the keeper ends."""
        self._answers.clear()
        self.send(**command)
        with self._answered:
            self._answered.wait_for(lambda: self._answers or self._ended.is_set(), timeout_s)
        if not self._answers:
            raise TableError(self.error or "the controller does not answer.")
        if said := self._answers.popleft():
            raise TableError(said)

    def close(self) -> None:
        """Have the keeper stop the table, if it was enabled, and end; waits until it has."""
        self._closing = True
        self.send(do="off")
        self._ended.wait(_END_S)

    # -- threads ----------------------------------------------------------------------------------------------------

    def _beat(self) -> None:
        while not self._ended.wait(_BEAT_S):
            if self._lives():
                self.send(do="beat")
            if _real_s() - self._heard_s > _SILENT_S:  # it hangs, and watches over nothing
                self._process.kill()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._heard_s = _real_s()
            with contextlib.suppress(json.JSONDecodeError):  # the last line of one that was killed
                self._take(json.loads(line))
        self._process.wait()
        if not self._told_its_end:
            self._stop_it_ourselves()
        self._ended.set()
        with self._answered:
            self._answered.notify_all()

    def _take(self, told: Told) -> None:
        if "state" in told:
            said = told["state"]
            (o, m, i), (p, q, r) = said["angles_deg"], said["rates_dps"]
            self.newest = TableState(
                said["stamp_ns"], said["uncertainty_ns"], (o, m, i), (p, q, r), said["mode"], said["fault"]
            )
            self.states.append(self.newest)
            return
        self._told_its_end |= bool(told.get("ended"))
        if "error" in told:
            self.error = told["error"]
        for key, is_warning in (("said", False), ("refused", True), ("error", True)):
            if (text := told.get(key)) and (is_warning or not self._closing):
                self.news.append((str(text), is_warning))
        if "did" in told or "refused" in told:
            with self._answered:
                self._answers.append(told.get("refused", ""))
                self._answered.notify_all()

    def _stop_it_ourselves(self) -> None:
        """The keeper was killed, or failed: the table is stopped over a link of our own."""
        self.error = "the keeper of the table ended without a word."
        if self.enabled:
            for _ in range(_TRIES):
                with contextlib.suppress(TableError):
                    controller = connect(self.url)
                    try:
                        controller.stop()
                        self.error += " Rate zero and mode off were sent from here."
                        break
                    finally:
                        controller.close()
                self._ended.wait(_AGAIN_S)
            else:
                self.error += " The table could NOT be stopped from here: press its emergency stop."
        self.news.append((self.error, True))

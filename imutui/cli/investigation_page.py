"""What `imutui investigate` shows while it goes on: a page on a terminal, lines elsewhere."""

import os
import select
import signal
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.live import Live
from rich.text import Text

from imutui.cli.exit_codes import say
from imutui.jobs.investigation_diary import NOTHING, DiaryDocument, RoundEntry
from imutui.plain_text import in_line

if TYPE_CHECKING:
    from imutui.session.snapshot import Snapshot

_ESC = b"\x1b"
_MOST_PAST = 3
_OUTCOMES = {
    "explained": "every channel is explained, and the run that judges confirms it",
    "not_here": "not all can be explained on this table",
    "time": "time was up before all was explained",
}


class Page:
    """Shows how an investigation goes; within it Esc is Ctrl+C."""

    def __init__(self, diary: DiaryDocument) -> None:
        self._diary = diary
        self.left_s: Callable[[], float] = lambda: diary["hours"] * 3600.0
        self._doing = self._table = ""
        self._live: Live | None = None
        self._over = threading.Event()

    def __enter__(self) -> Self:
        if sys.stdin.isatty() and sys.stderr.isatty():
            self._live = Live(
                console=Console(stderr=True), refresh_per_second=4, screen=True, get_renderable=self._text
            )
            self._live.start()
            self._modes = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
            threading.Thread(target=self._keys, name="keys", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the terminal back."""
        self._over.set()
        if self._live is not None:
            self._live.stop()
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._modes)
            self._live = None

    def _keys(self) -> None:
        while not self._over.is_set():
            keys = os.read(sys.stdin.fileno(), 64) if select.select([sys.stdin], [], [], 0.1)[0] else b""
            if keys and not keys.strip(_ESC):  # arrows and the like begin with Esc too
                os.kill(os.getpid(), signal.SIGINT)

    def told(self, said: str, entry: RoundEntry | None) -> None:
        """Take what happens now."""
        self._doing, self._table = said, ""
        if self._live is None:
            number = len(self._diary["rounds"])
            say(f"{number:2d}  {said}" if entry is not None else f"    {said}")

    def seen(self, snapshot: "Snapshot", seconds: float) -> None:
        """Take how the acquisition of the motion is."""
        recording, controller = snapshot["recording"], snapshot["controller"]
        parts = [] if recording is None else [f"{recording['seconds']:.0f} of about {seconds:.0f} s"]
        if controller is not None and controller["angles_deg"] is not None:
            moves = "TABLE MOVES" if controller["moves"] else "table stands"
            parts.insert(0, f"{moves}  {' '.join(f'{round(a, 2) + 0.0:8.2f}' for a in controller['angles_deg'])} deg")
        self._table = "   ".join(parts)

    def _text(self) -> Text:
        console = Console(stderr=True)
        lines = list(page(self._diary, self._doing, self._table, self.left_s(), console.width))[: console.height]
        return Text("\n".join(in_line(line)[: console.width] for line in lines))


def page(diary: DiaryDocument, doing: str, table: str, left_s: float, width: int) -> Iterator[str]:
    """Lines of the page, which fit 80 by 24."""
    rounds = diary["rounds"]
    left = f"{max(0.0, left_s) / 60.0:.0f} of {60.0 * diary['hours']:.0f} min left"
    yield f"INVESTIGATION   {_motions(len(rounds))}   {left}"
    yield ""
    known = next((r for r in reversed(rounds) if r["status"]), None)
    yield "What is known"
    if known is None:
        yield "  nothing yet: the unit is taken through the first motions"
    else:
        for channel, status in known["status"].items():
            yield _cut(f"  {channel}  {_STATUS.get(status, status):12s} {_odds(known, channel)}", width)
    yield ""
    yield "What was done"
    for number, entry in list(enumerate(rounds, 1))[-_MOST_PAST - 1 :]:
        if entry["log"]:
            yield _cut(f"  {number:2d} {entry['motion']}: {entry['came'] or 'not traced yet'}", width)
    yield ""
    yield "Now"
    yield from _wrapped(doing, width)
    if table:
        yield _cut(f"  {table}", width)
    yield ""
    yield "Esc or Ctrl+C stops the table at once; --resume goes on"


_STATUS = {"confounded": "several fit", "partial": "in part", "stochastic": "drift", "run_specific": "once",
           "unexplained": "not explained"}  # fmt: skip


def _odds(entry: RoundEntry, channel: str) -> str:
    """Names that are still possible on a channel, with their odds."""
    from filters.effects import plain_names

    best: dict[str, float] = {}
    for rival in entry["rivals"]:
        if rival["channel"] == channel:
            for name, odds in zip(rival["names"], rival["odds"], strict=True):
                if name != NOTHING:
                    best[plain_names.effect(name)] = odds
    return ", ".join(f"{name} {odds:.3g}:1" for name, odds in sorted(best.items(), key=lambda pair: -pair[1]))


def _wrapped(text: str, width: int) -> Iterator[str]:
    import textwrap

    yield from (f"  {line}" for line in textwrap.wrap(text, width - 4)[:4])


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 1] + "…"


def ended(diary: DiaryDocument, sentence: str) -> Iterator[str]:
    """What is said at the end."""
    minutes, made = diary["spent_s"] / 60.0, _motions(len(diary["rounds"]))
    yield f"{_OUTCOMES[diary['outcome']]}, after {minutes:.0f} min and {made}."
    yield sentence
    yield from diary["takes"]


def _motions(count: int) -> str:
    return f"{count} motion{'' if count == 1 else 's'}"

"""The units of a batch as the screen sees them.

Each is asked once a second, by a thread and over a connection of its own: one that hangs keeps no other from it. Its
snapshot without packets costs the acquisition a millisecond; nothing is drawn but what reads differently.
"""

import threading
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

from imutui import batch_file
from imutui.batch_file import Unit
from imutui.session import batch
from imutui.session import client as session
from imutui.session.batch import Answer
from imutui.session.client import Client, SessionError
from imutui.session.plan import Plan
from imutui.session.snapshot import NO_SERIES, ProfileDescription, Snapshot
from imutui.tui.connection.verdict import Debounce, of_snapshot
from imutui.verdict.rules import Verdict, bias_levels

_EVERY_S, _UNSEEN_S = 1.0, 10.0
"""Seconds from one look at a unit to the next; the same while another page is in front."""


@dataclass(frozen=True, slots=True)
class UnitView:
    """A unit as it was when it answered last."""

    name: str  # of its acquisition
    answer: Answer | None = None  # None before the first
    unit: Unit | None = None  # in the batch's file, if it is in there
    verdict: Verdict | None = None
    gauges: tuple[str, ...] = ()  # levels of the six biases; empty without a filter
    profile: ProfileDescription | None = None  # which its filter goes by
    serial_number: str = ""  # as it said last

    @property
    def now(self) -> Snapshot | None:
        """Its snapshot; None of one that does not answer."""
        return self.answer.snapshot if self.answer is not None else None


class Rack:
    """Looks at the units of a batch, those that come later too, from `look` to `close`.

    `rows`, `attach`: which acquisitions there are, with their tables in the batch's file; what connects to one.
    """

    def __init__(
        self,
        name: str,
        rows: Callable[[str], Mapping[str, Unit | None]] = batch.rows,
        attach: Callable[[str], Client] = session.attach,
    ) -> None:
        self.name = name
        self.seen = True  # whether somebody looks at it
        self.news = threading.Event()  # set when a unit has answered
        self._rows, self._attach = rows, attach
        self._watched: dict[str, _Watch] = {}
        self._closed = threading.Event()

    def look(self) -> None:
        """Look for units; to be called in a thread, now and then."""
        found = self._rows(self.name)
        if self._closed.is_set():
            return
        # one that was there once stays, with what is wrong with it, as long as the file has it
        gone = [name for name, one in self._watched.items() if name not in found and one.view.now is None]
        watched = {name: one for name, one in self._watched.items() if name not in gone}
        for name in gone:
            self._watched[name].stop()
        for name, unit in found.items():
            if name not in watched:
                watched[name] = _Watch(self, name, unit, self._attach)
        ordered = [*(name for name in found if name in watched), *(name for name in watched if name not in found)]
        self._watched = {name: watched[name] for name in ordered}
        self.news.set()

    def units(self) -> list[UnitView]:
        """The units, in the order of the batch's file."""
        return [one.view for one in self._watched.values()]

    def running(self) -> list[str]:
        """Names of the acquisitions that answer."""
        return [unit.name for unit in self.units() if unit.now is not None]

    def hurry(self) -> None:
        """Look at all units at once: something was asked of them, or somebody looks again."""
        for one in self._watched.values():
            one.due.set()

    def start(self, units: Collection[str], base: Plan) -> dict[str, Client | SessionError]:
        """Start units of the batch's file that do not run; returns the client of each, or why it did not start.

        What the batch was begun with holds for them. `base`: what the file does not state, for a batch that no
        command began. Raises SessionError if the file is gone, and BatchError if it can't be used.
        """
        path = batch.file_of(self.name)
        if path is None:
            raise SessionError(f"the file of the batch {self.name} is not there any more")
        read = batch_file.read(path)
        common = batch.asked_of(self.name) or batch.base_of(read, replace(base, record=True))
        plans = [plan for plan in batch.plans(read, common) if plan.name in units]
        replies: dict[str, Client | SessionError] = {}
        batch.start(read, plans, lambda plan, outcome: replies.update({plan.name: outcome}))
        for reply in replies.values():
            if isinstance(reply, Client):
                reply.close()
        return replies

    @property
    def period_s(self) -> float:
        return _EVERY_S if self.seen else _UNSEEN_S

    def close(self) -> None:
        """Look no more. The acquisitions go on."""
        self._closed.set()
        for one in self._watched.values():
            one.stop()


class _Watch:
    """Looks at one unit, from a thread of its own."""

    def __init__(self, rack: Rack, name: str, unit: Unit | None, attach: Callable[[str], Client]) -> None:
        self.view = UnitView(name, unit=unit)
        self.due = threading.Event()
        self._rack, self._attach = rack, attach
        self._client: Client | None = None
        self._debounce = Debounce()
        self._stopped = False
        self._profile_of: object = None
        self._profile: ProfileDescription | None = None
        threading.Thread(target=self._run, name=f"imutui-rack-{name}", daemon=True).start()

    def stop(self) -> None:
        self._stopped = True
        self.due.set()

    def _run(self) -> None:
        while not self._stopped:
            self.due.clear()
            self._take(batch.answer_of(self.view.name, self._look))
            self._rack.news.set()
            self.due.wait(self._rack.period_s)
        if self._client is not None:
            self._client.close()

    def _look(self) -> Snapshot:
        """A snapshot, and the profile that the filter goes by where that is another than before."""
        try:
            if self._client is None:
                self._client = self._attach(self.view.name)
            now = self._client.snapshot(since=NO_SERIES)
            reference = now["reference"]
            of = (now["pid"], reference["file"]) if reference["profile"] else None
            if of != self._profile_of:
                self._profile, self._profile_of = (None if of is None else self._client.profile()), of
        except SessionError:
            if self._client is not None:
                self._client.close()
            self._client, self._debounce = None, Debounce()
            raise
        else:
            return now

    def _take(self, answer: Answer) -> None:
        now, verdict = answer.snapshot, None
        gauges: tuple[str, ...] = ()
        if now is not None:
            # the acquisition's clock, which goes on when the filter's does not
            verdict = self._debounce.take(float(now["since_start_s"]), of_snapshot(now))
            gauges = () if now["filter"] is None else tuple(bias_levels(now["filter"], now["health"]))
        serial = now["serial_number"] if now is not None else self.view.serial_number
        self.view = UnitView(self.view.name, answer, self.view.unit, verdict, gauges, self._profile, serial)

"""The threads of an acquisition and how requests reach it.

One thread reads the port (`reader_thread`), another records and filters (`acquisition`); requests queue for that one.
A slow disk or a slow filter therefore never makes a stamp late, and nothing but the second thread touches a file.
"""

import contextlib
import math
import queue
import threading
import time
from collections.abc import Callable
from concurrent import futures
from concurrent.futures import Future
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from filters.errors import InputError
from imutui.instrument.clock import Clock
from imutui.instrument.driver import Driver, Identity, InstrumentError
from imutui.instrument.registry import INSTRUMENTS
from imutui.instrument.transmitter import transfer_s
from imutui.session import lifecycle, live_filter
from imutui.session.acquisition import Acquisition
from imutui.session.commanded_table import CommandedTable
from imutui.session.lifecycle import Lifecycle
from imutui.session.metadata import session_info
from imutui.session.plan import VIRTUAL_PORT, Plan
from imutui.session.reader_thread import LeftOtherwise, Reader, ReaderEvent
from imutui.session.reconnection import KnownUnit, LineLost
from imutui.session.stream import ERROR, Stamper
from imutui.session.watches import FoxgloveFollower

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument

_FIRST_PACKET_S = 3.0
_READER_END_S = 0.5
_BEHIND_S = 0.2
_LOOK_S = 0.1
_AFTER_BLOCK_S = 0.015
_HANGS_S = 5.0  # a thread that does not come round for so long commands no table
PATIENCE_S = 30.0
"""How long a request waits for the worker, unless the viewer waits less."""
_BUSY = "the acquisition was busy, perhaps while its filter is compiled,"

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class QueuedCall:
    """A request to be carried out between two packets, or, if `late`, after the last one as well."""

    function: Callable[[Acquisition], Any]
    future: "Future[Any]"
    late: bool


class Engine:
    """Runs one acquisition from its first packet to its last.

    `host` is of a unit that is identified, set up, and sends nothing by itself; `foxglove` serves what is recorded, and
    is closed after the end by the caller; `table` is one under command. `lifecycle` may have failed before: the
    acquisition then ends at once.
    Raises InputError if the filter could not run with what is asked.
    """

    def __init__(
        self,
        plan: Plan,
        host: Driver,
        identity: Identity,
        foxglove: FoxgloveFollower | None = None,
        table: CommandedTable | None = None,
        lifecycle: Lifecycle | None = None,
    ) -> None:
        self.lifecycle = lifecycle or Lifecycle()
        self._plan = plan = plan.of_instrument(plan.instrument)
        self._port = port = host.port
        self._instrument = instrument = INSTRUMENTS[plan.instrument]
        self._queue: queue.SimpleQueue[ReaderEvent | QueuedCall] = queue.SimpleQueue()
        polled = plan.sampling == "polled"
        known = KnownUnit(identity, port.baud, instrument.power_up_bauds, returns=plan.port != VIRTUAL_PORT)
        clock = Clock(
            transfer_s(instrument.packet_bytes, port.baud) * 1e9,
            host.counter,
            polled=polled,
            period_ns=1e9 / host.stream_hz if host.stream_hz else 0.0,
        )
        self._reader = Reader(host, Stamper(clock), plan.rate_hz if polled else None, self._queue.put, known)
        info = session_info(plan, port, identity, "" if table is None else table.identity)
        self._table = table
        self._looped_s = math.inf  # when the second thread last looked for something to do
        if table is not None:
            table.lives = lambda: time.monotonic() - self._looped_s < _HANGS_S
        self._acquisition = Acquisition(plan, info, self._reader, self.lifecycle, foxglove, table)
        self._duration_over = False
        self._worker = threading.Thread(target=self._work, name="worker", daemon=True)

    @property
    def result(self) -> "RunDocument | None":
        """Result of the last recording, after the end."""
        return self._acquisition.recording.result

    @property
    def ended_by_itself(self) -> bool:
        """Whether the end came without a request: its duration was over, or its disk nearly full."""
        return self._duration_over

    @property
    def exit_code(self) -> int:
        """Exit code of the process, after the end.

        An end that was asked for (`imutui stop`, SIGTERM) has 0 whatever the unit did, since the findings are in its
        reply. An end that came without a request has the code of its worst finding.
        """
        codes = [finding["exit_code"] for finding in self.lifecycle.findings] if self._duration_over else []
        return self.lifecycle.exit_code or max(codes, default=0)

    def start(self) -> None:
        """Begin, and return once the first packet has come.

        Raises OSError if the disk fails, InstrumentError if no packet comes, and any other exception that ended the
        acquisition before.
        """
        polled = self._plan.sampling == "polled"
        if polled and self._plan.filter != "none":
            # a polled packet is stamped when it arrives: loading the compiler meanwhile would make stamps late
            live_filter.load()
        self._reader.start()
        self._worker.start()
        deadline = time.monotonic() + _FIRST_PACKET_S + (self._plan.period_s if polled else 0.0)
        stands = self.lifecycle
        while not stands.streaming.wait(0.05) and not stands.ended.is_set():
            # a busy machine may take longer to make a file of the first one
            if time.monotonic() > deadline and not self._reader.has_packet:
                self.request_stop()
                stands.ended.wait(5.0)
                raise InstrumentError(
                    f"{self._port.name}: the unit answers commands but sends no packets. Power it off and on, then"
                    " connect again."
                )
        if not stands.streaming.is_set():
            if stands.cause is not None:
                raise stands.cause
            if stands.error is not None:
                raise InstrumentError(stands.error)

    def call(self, function: Callable[[Acquisition], T], timeout: float = PATIENCE_S, *, late: bool = False) -> T:
        """Carry out a function in the worker, between two packets; return and raise what the function does.

        A function that only looks may be `late`: it is carried out when the worker has ended, too; others are refused
        then.

        Raises InputError if the worker did not get to it within `timeout` seconds. The function is then not carried
        out later, unless the worker is in the middle of it: the message says which.
        """
        future: Future[T] = Future()
        self._queue.put(QueuedCall(function, future, late))
        if self.lifecycle.ended.is_set():
            self._answer_late_calls()
        if futures.wait([future], timeout).done:
            return future.result()
        if future.cancel():
            raise InputError(f"{_BUSY} for {timeout:.0f} s, and did nothing of this. Try again in a few seconds.")
        raise InputError(f"{_BUSY} with this for {timeout:.0f} s, and will finish it. `imutui status` shows when.")

    def zero(self, argument: int, timeout: float = PATIENCE_S) -> str:
        """Have the unit zero its rate sensors and wait for it; returns what came of it. See `client.Client.zero`.

        Raises InputError if it cannot be done now, or the unit did not answer in time; the message says what next.
        """
        self._instrument.check_zeroing(argument)
        return self.call(lambda acquisition: acquisition.begin_zeroing(argument), timeout).result()

    def request_stop(self, by: str = "") -> None:
        """End: the reader stops, what it has read is used, the file is finished; safe from any thread and signal."""
        self.stop_table()
        self.lifecycle.stop(by)
        self._reader.stop()

    def stop_table(self) -> None:
        """Stop a table under command at once; safe from any thread and signal. Its profile is not cancelled by it."""
        if self._table is not None:
            self._table.leave()

    def terminate(self, by: str = "") -> None:
        """End as `request_stop` does, but wait for no filter that is not ready: the process has to go."""
        self.lifecycle.terminated = True
        self.request_stop(by)

    # -- worker ---------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        acquisition, recording = self._acquisition, self._acquisition.recording
        try:
            self._guard(self._loop)
            if self.lifecycle.exit_code == lifecycle.OWN_ERROR and self.lifecycle.error is not None:
                self._guard(lambda: acquisition.event("acquisition", self.lifecycle.error or "", ERROR))
            for step in (acquisition.look_back, recording.finish, recording.finish_bare):
                if self.lifecycle.exit_code != lifecycle.DISK:
                    self._guard(step)
        finally:
            self._reader.stop()
            self._reader.join(_READER_END_S)
            self._port.close()
            self.lifecycle.end()
            self._answer_late_calls()
            acquisition.abandon_zeroing(self.lifecycle.error or "the acquisition ended before the unit was done")

    def _guard(self, step: Callable[[], None]) -> None:
        """Do a step of the work; an exception ends the acquisition as failed, and its file is finished."""
        try:
            step()
        except OSError as error:
            self._fail(lifecycle.DISK, self._acquisition.recording.disk_message(error), error)
        except Exception as error:  # noqa: BLE001 - a viewer must not take this for a good end
            self.lifecycle.defect(error)
            self._end_reading()

    def _loop(self) -> None:
        # soon after a block of packets has come: what is not on the disk yet is then as little as can be
        next_second = self._reader.next_block_ns(time.monotonic_ns()) / 1e9 + _AFTER_BLOCK_S
        while self._reader.is_alive() or not self._queue.empty():
            self._looped_s = time.monotonic()
            try:
                with contextlib.suppress(queue.Empty):  # nothing came; the seconds still pass
                    self._handle(self._queue.get(timeout=max(0.0, min(_LOOK_S, next_second - time.monotonic()))))
                self._acquisition.look_at_table()
                late_s = time.monotonic() - next_second
                # what came before is written before: log time does not go back
                if late_s >= 0.0 and (self._queue.empty() or late_s > _BEHIND_S):
                    self._acquisition.every_second()
                    next_second += max(1.0, math.ceil(late_s))
            except OSError as error:
                self._acquisition.recording.disk_failed(error)
            if self.lifecycle.exit_code and not self._reader.stopping.is_set():  # another thread has failed
                self._end_reading()
            over = None if self._duration_over else self._acquisition.why_over(time.monotonic_ns())
            if over is not None:
                self._duration_over = self.lifecycle.stopping_since_ns is None
                self.request_stop(over)

    def _handle(self, item: ReaderEvent | QueuedCall) -> None:
        match item:
            case LineLost() if item.final:
                self._fail(lifecycle.INSTRUMENT, item.message)
                self._acquisition.event("acquisition", item.message, ERROR)
            case LeftOtherwise():
                # the next host will see that the unit is not as it was found
                self._acquisition.recording.find(lifecycle.FINDINGS, item.message)
            case Exception():
                raise item
            case QueuedCall():
                self._carry_out(item)
            case _:
                self._acquisition.take(item)

    def _carry_out(self, call: QueuedCall) -> None:
        if not call.future.set_running_or_notify_cancel():
            return  # its viewer has ceased to wait
        try:
            call.future.set_result(call.function(self._acquisition))
        except Exception as error:  # a bad request concerns its sender only
            call.future.set_exception(error)
            if isinstance(error, OSError):  # but a full disk concerns the recording
                raise

    def _answer_late_calls(self) -> None:
        """Answer requests that came too late for the worker."""
        with contextlib.suppress(queue.Empty):
            while True:
                item = self._queue.get_nowait()
                if isinstance(item, QueuedCall) and item.late:
                    self._carry_out(item)
                elif isinstance(item, QueuedCall) and item.future.set_running_or_notify_cancel():
                    item.future.set_exception(InputError(self.lifecycle.error or "the acquisition has ended"))

    def _fail(self, exit_code: int, message: str, cause: Exception | None = None) -> None:
        self.lifecycle.fail(exit_code, message, cause)
        self._end_reading()

    def _end_reading(self) -> None:
        """Stop the table and the reader: the acquisition has failed, and its worker ends when the reader has."""
        self.stop_table()
        self._reader.stop()

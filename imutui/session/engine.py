"""The acquisition: one thread reads the port (`reading`), another records and filters; requests queue for that one.

A slow disk or a slow filter therefore never makes a stamp late, and nothing but the second thread touches a take.
"""

import contextlib
import queue
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from filters.motion.profile import Profile
from imutui.instrument.clock import Clock
from imutui.instrument.crossbow import BITS_PER_BYTE, PACKET_BYTES, Scaling
from imutui.instrument.port import Port
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.session import ipc, operator_guide, zeroing
from imutui.session.disk_space import Growth, Room, disk_message
from imutui.session.handshake import Identity, InstrumentError
from imutui.session.metadata import (
    attach,
    changed,
    default_path,
    effects_of,
    motion_of,
    session_info,
)
from imutui.session.observe import Mark, snapshot
from imutui.session.plan import Plan, RecordingWish
from imutui.session.reader_thread import Arrival, Gone, Missed, Reader, Zeroed
from imutui.session.recent_packets import LiveView
from imutui.session.recording import Take, Timebase
from imutui.session.rotation import Parts
from imutui.session.snapshot import EventLine, ProfileDescription, SessionState, Snapshot

EXIT_OWN = 1
EXIT_INSTRUMENT = 4
EXIT_DISK = 5
_FIRST_PACKET_S = 3.0
_CLOCK_STEP_NS = 100_000_000
_CLOCK_READINGS = 5
_EVENTS = 20
_MARKS = 50


@dataclass(frozen=True, slots=True)
class Call:
    """A request to be carried out between two packets, or, if `late`, after the last one as well."""

    function: Callable[[], Any]
    future: "Future[Any]"
    late: bool


class Engine:
    """One acquisition from its first packet to its last.

    Parameters
    ----------
    plan : Plan
        What is asked.
    port : Port
        Open, the unit identified, in scaled mode, polled.
    identity : Identity
        What the unit said.
    """

    def __init__(self, plan: Plan, port: Port, identity: Identity) -> None:
        self.plan = plan
        self.info = session_info(plan, port, identity)
        self.state: SessionState = "connecting"
        self.error: str | None = None
        self.exit_code = 0
        self.result: dict[str, Any] | None = None
        self.started_ns = time.monotonic_ns()
        self.live = LiveView(Scaling(plan.rate_range_dps, plan.accel_range_g))
        self.events: deque[EventLine] = deque(maxlen=_EVENTS)
        self.marks: deque[Mark] = deque(maxlen=_MARKS)
        self.guide: operator_guide.Guide | None = None
        self.room, self.growth = Room(), Growth()
        self.timebase = Timebase(_utc_minus_monotonic_ns())
        self.ended = threading.Event()
        self.streaming = threading.Event()
        self.take: Take
        self.parts: Parts | None = None
        self.motion = motion_of(plan)
        self._effects = effects_of(plan, self.info)
        self._port = port
        self._queue: queue.SimpleQueue[Arrival | Missed | Zeroed | Gone | Call] = queue.SimpleQueue()
        polled = plan.sampling == "polled"
        self._reader = Reader(port, plan.rate_hz if polled else None, self._queue.put)
        self._clock = Clock(PACKET_BYTES * BITS_PER_BYTE / port.baud * 1e9, polled=polled)
        self._base = (0, 0)
        self._seen = (0, 0)
        self._silent = False
        self._stepped_ns = 0
        self._to_begin = plan.record
        self._zeroing: Future[str] | None = None
        self._disk_error: OSError | None = None
        self._worker = threading.Thread(target=self._work, name="worker", daemon=True)

    @property
    def last_packet_ns(self) -> int:
        """When the last packet was read, whether or not it has been used yet, monotonic."""
        return self._reader.heard_ns

    @property
    def zeroing(self) -> bool:
        """Whether the unit is zeroing its rate sensors: no packets are asked for."""
        return self._zeroing is not None

    def start(self) -> None:
        """Begin; raises OSError or InstrumentError if there is no disk, or no packet, to begin with."""
        self.take = Take(self.info, self.timebase, None, self.motion, self._effects)
        self._reader.start()
        self._worker.start()
        limit = _FIRST_PACKET_S + (1.0 / self.plan.rate_hz if self.plan.sampling == "polled" else 0.0)
        deadline = time.monotonic() + limit
        while not self.streaming.wait(0.05) and not self.ended.is_set():
            if time.monotonic() > deadline:
                self.request_stop()
                self.ended.wait(5.0)
                raise InstrumentError(
                    f"{self._port.name}: the unit answers commands but sends no packets. Power it off and on, then"
                    " connect again."
                )
        if not self.streaming.is_set():
            if self._disk_error is not None:
                raise self._disk_error
            if self.error is not None:
                raise InstrumentError(self.error)

    def call(self, function: Callable[[], Any], timeout: float = 30.0, *, late: bool = False) -> Any:
        """Carry out a function in the worker, between two packets, and return what it returns.

        One that only looks is carried out `late` too, when the worker has ended; others are refused then.
        """
        future: Future[Any] = Future()
        self._queue.put(Call(function, future, late))
        if self.ended.is_set():
            self._turn_away()
        return future.result(timeout)

    def _turn_away(self) -> None:
        """Answer requests that came too late for the worker."""
        with contextlib.suppress(queue.Empty):
            while True:
                item = self._queue.get_nowait()
                if isinstance(item, Call) and item.late:
                    self._carry_out(item)
                elif isinstance(item, Call):
                    item.future.set_exception(ValueError(self.error or "the acquisition has ended"))

    # -- requests; each runs in the worker through `call` ---------------------------------------------------------

    def snapshot(self, since: int) -> Snapshot:
        """State for viewers."""
        return snapshot(self, since)

    def mark(self, text: str) -> None:
        """Write the operator's mark; while guided a remark, since a mark would begin the profile's next dwell."""
        if self.take.writer is None:
            raise ValueError(
                "nothing is being recorded, so there is no file to put the mark into; start recording first"
            )
        self._event("mark" if self.guide is None else "remark", text)

    def record(self, wish: RecordingWish) -> str:
        """Begin a recording, and a new take with it; returns its path. What is wished but the note stays for later."""
        self._refuse_while_zeroing()
        if self.take.writer is not None:
            raise ValueError(f"already recording to {self.take.writer.path}")
        asked = {key: getattr(wish, key) for key in ("operator", "place", "table") if getattr(wish, key)}
        limits = {key: getattr(wish, key) for key in ("rotate_minutes", "rotate_mb") if getattr(wish, key) is not None}
        before = self.plan, self.info
        self.plan = replace(self.plan, **asked, **limits)
        self.info = replace(self.info, **asked)
        try:
            self._begin(wish.note or self.plan.note, None)
        except OSError as error:  # nothing has been recorded yet, so nothing is lost but this wish
            self.plan, self.info = before
            raise ValueError(disk_message(None, error)) from error
        assert self.take.writer is not None
        return str(self.take.writer.path)

    def stop_recording(self) -> dict[str, Any]:
        """Finish the file; the acquisition, its filter included, goes on without one."""
        if self.take.writer is None:
            raise ValueError("nothing is being recorded")
        result = self._finish_file()
        if self.guide is not None:
            self.guide.recording_ended(time.monotonic_ns())
        self._event("acquisition", f"finished {result['log']}")
        return result

    def configure(self, changes: dict[str, Any]) -> None:
        """Take another reference or other effects; the filter begins anew with them."""
        self._refuse_while_zeroing()
        if self.take.writer is not None:
            raise ValueError("finish the recording first: r. A file has one reference and one set of effects")
        # refuses, before anything is changed, what the filter could not run with
        setup = changed(self.plan, self.info, changes)
        self.plan, self.info, self.motion, self._effects = setup.plan, setup.info, setup.motion, setup.effects
        self.guide = None
        self._new_take(None, self.info)
        source = self.plan.reference_file[0]
        said = f"reference {self.plan.reference}{f' from {source}' if source else ''}"
        said += ", with effects" if self.plan.effects else ", without effects"
        self._event("acquisition", f"{said}: the filter begins anew")

    def zero(self, argument: int) -> str:
        """Have the unit zero its rate sensors and wait for it; returns what came of it. Not through `call`: it waits.

        Parameters
        ----------
        argument : int
            Length of the average, 0 to 255, in a unit that documents dispute; 0 erases the stored zero.

        Raises
        ------
        ValueError
            If it cannot be done now, or the unit did not answer in time; the message says what next.
        """
        zeroing.check(argument)
        pending: Future[str] = self.call(lambda: self._begin_zeroing(argument))
        return pending.result()

    def profile(self) -> ProfileDescription | None:
        """The profile that the reference comes from, if it comes from one."""
        if not isinstance(self.motion, Profile):
            return None
        return operator_guide.described(self.motion, self.plan.reference_file[0])

    def guide_do(self, do: str, wish: RecordingWish) -> None:
        """Guide the operator through the profile: begin, next, cancel, resume; a recording that begins is as wished."""
        recording = self.take.writer is not None
        if do == "begin":
            begun = operator_guide.begun(self.motion, self.plan.filter, self.guide, recording=recording)
            if not recording:
                self.record(wish)
            self.guide = begun
            self._event("acquisition", f"guide through {self.plan.reference_file[0]} begins")
            return
        if self.guide is None:
            raise ValueError("no guide is under way; begin one first")
        mark = self.guide.do(do, time.monotonic_ns(), recording=recording)
        if mark is not None:
            self._event("mark", mark)

    def _begin_zeroing(self, argument: int) -> "Future[str]":
        self._refuse_while_zeroing()
        if self.take.writer is not None:
            raise ValueError("finish the recording first: r. Zeroing would put a step into the file")
        if self.state != "running":
            raise ValueError(f"the acquisition is {self.state}; zero the rate sensors while it runs")
        self._zeroing = Future()
        self._event("acquisition", f"zeroing the rate sensors (argument {argument}); packets pause")
        self._reader.zero(argument)
        return self._zeroing

    def _refuse_while_zeroing(self) -> None:
        if self._zeroing is not None:
            raise ValueError("the unit is zeroing its rate sensors; wait until it is done")

    def request_stop(self) -> None:
        """End: the reader stops, what it has read is used, the file is finished; safe from any thread and signal."""
        self.state = "stopping" if self.state in ("connecting", "running") else self.state
        self._reader.stop()

    # -- worker ---------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        try:
            self._loop()
        except OSError as error:
            self._disk_error = error
            self._fail(EXIT_DISK, disk_message(self.take.writer, error))
        except Exception as error:  # noqa: BLE001 - whoever follows must hear of it, and not take it for a good end
            traceback.print_exc()
            self._fail(
                EXIT_OWN,
                f"an error of imutui's own: {type(error).__name__}: {error}. {ipc.log_path(self.plan.name)}"
                " has the details; please report them. What was recorded is on the disk up to the last flush.",
            )
        try:
            self._finish()
        except OSError as error:
            self._fail(EXIT_DISK, disk_message(self.take.writer, error))
        finally:
            self.state = "failed" if self.exit_code else "stopped"
            self._reader.stop()
            self._port.close()
            self.ended.set()
            self._turn_away()
            if self._zeroing is not None:
                self._zeroing.set_exception(ValueError(self.error or "the acquisition ended before the unit was done"))

    def _loop(self) -> None:
        next_second = time.monotonic() + 1.0
        while self._reader.is_alive() or not self._queue.empty():
            with contextlib.suppress(queue.Empty):  # nothing came; the seconds still pass
                self._handle(self._queue.get(timeout=max(0.0, min(0.1, next_second - time.monotonic()))))
            if time.monotonic() >= next_second:
                self._every_second()
                next_second = max(next_second + 1.0, time.monotonic())

    def _handle(self, item: Arrival | Missed | Zeroed | Gone | Call) -> None:
        match item:
            case Arrival():
                self._packet(item)
            case Missed():
                self.take.tally.lost_packets += 1
            case Zeroed():
                self._zeroed(item)
            case Gone():
                self._fail(EXIT_INSTRUMENT, item.message)
            case Call():
                self._carry_out(item)

    def _carry_out(self, call: Call) -> None:
        if call.future.done():
            return
        try:
            call.future.set_result(call.function())
        except Exception as error:  # a bad request is its sender's trouble, not the recording's
            call.future.set_exception(error)
            if isinstance(error, OSError):  # but a disk that takes no more is everybody's
                raise

    def _packet(self, arrival: Arrival) -> None:
        packet = arrival.packet
        if self._to_begin:
            # not before: a unit that sends nothing must not cost the file that --force would replace
            self._to_begin = False
            self._begin(self.plan.note, Path(self.plan.output) if self.plan.output else None)
        elif self._is_full(arrival.host_ns):
            self._rotate()
        stamp = self._clock.stamp(packet.ticks, arrival.host_ns, contiguous=arrival.contiguous)
        self._seen = arrival.bad_checksums, arrival.discarded_bytes
        self.take.tally.bad_checksums = self._seen[0] - self._base[0]
        self.take.tally.discarded_bytes = self._seen[1] - self._base[1]
        self.take.packet(packet, stamp, arrival.host_ns)
        self.live.add((stamp.monotonic_ns - self.started_ns) / 1e9, packet)
        if not self.streaming.is_set():
            self.streaming.set()
            self.state = "running"
            self._event("acquisition", f"connected to {self.info.port}, first packet")
        if stamp.lost:
            self._event("acquisition", f"{stamp.lost} packets lost")
        if self._is_over(stamp.monotonic_ns):
            self.request_stop()

    def _is_over(self, now_ns: int) -> bool:
        """Whether the plan's duration is over, counted through all files of a recording."""
        started = self.take.started_ns
        if self.parts is not None:
            self.parts.began_ns = started = self.parts.began_ns or started
        duration = self.plan.duration_s
        return duration is not None and started is not None and now_ns - started >= duration * 1e9

    def _zeroed(self, item: Zeroed) -> None:
        """Go on after the pause: packets on either side of it do not belong together, nor do their biases."""
        before = self.live.rates_dps()
        self._clock.interrupt()
        self.live.interrupt()
        self._new_take(None, self.info)
        done, self._zeroing = self._zeroing, None
        failed = item.seconds is None
        said = zeroing.unanswered(item.argument)
        if item.seconds is not None:
            said = zeroing.in_words(item.argument, item.seconds, before)
        self._event("acquisition", said, 30 if failed else 20)
        if done is not None and failed:
            done.set_exception(ValueError(said))
        elif done is not None:
            done.set_result(said)

    def _every_second(self) -> None:
        now = time.monotonic_ns()
        self.take.every_second(now)
        if self.take.writer is not None:
            self.growth.add(now, self.take.writer.size)
        if self.guide is not None:
            self.guide.advance(now)
        silence = (now - self.last_packet_ns) / 1e9
        period = 1.0 / self.plan.rate_hz if self.plan.sampling == "polled" else 0.0
        silent = silence > max(1.0, 3.0 * period) and not self.zeroing
        if silent != self._silent and self.streaming.is_set():
            self._silent = silent
            text = f"no packets for {silence:.1f} s: power, cable?" if silent else "packets again"
            self._event("acquisition", text, 30 if silent else 20)
        step = _utc_minus_monotonic_ns() - self.timebase.utc_minus_monotonic_ns - self._stepped_ns
        if abs(step) > _CLOCK_STEP_NS:
            self._stepped_ns += step
            self._event("acquisition", f"the system clock stepped by {step / 1e9:+.3f} s; stamps are not affected", 30)

    def _event(self, name: str, text: str, level: int = 20) -> None:
        now = time.monotonic_ns()
        utc = time.strftime("%H:%M:%S", time.gmtime(self.timebase.utc_ns(now) / 1e9))
        self.events.append({"utc": utc, "name": name, "text": text})
        if name in ("mark", "remark"):
            self.marks.append(Mark(now, utc, text))
        self.take.event(name, text, now, level)

    def _begin(self, note: str, path: Path | None) -> None:
        """Begin a recording."""
        path = path or default_path(Path(self.plan.logs), self.info.serial_number, note)
        self._open(path, note, overwrite=self.plan.overwrite)
        self.parts = Parts(path, self.plan.rotate_minutes, self.plan.rotate_mb)
        self.growth, self.guide = Growth(), None
        self.marks.clear()
        self._event("acquisition", f"recording to {path.name}")
        if self.plan.rotates != bool(self.plan.rotate_minutes or self.plan.rotate_mb):
            why = "the reference is told from one log's first sample on"
            self._event("acquisition", f"the recording stays in one file: {why}", 30)

    def _open(self, path: Path, note: str, *, overwrite: bool) -> None:
        """Begin a file, and a new take with it."""
        info = replace(self.info, note=note)
        writer = LogWriter(path, info, self.plan.configuration(), time.time_ns(), overwrite=overwrite)
        attach(writer, self.plan, time.time_ns())
        self._new_take(writer, info)

    def _is_full(self, now_ns: int) -> bool:
        """Whether the recording goes on in another file, from this packet on."""
        take = self.take
        if take.writer is None or self.parts is None or take.started_ns is None or self.state != "running":
            return False
        return self.plan.rotates and self.parts.full((now_ns - take.started_ns) / 1e9, take.writer.size)

    def _rotate(self) -> None:
        """Go on in the next file."""
        parts, take = self.parts, self.take
        assert parts is not None
        path, before = parts.next_path(), take.writer.path.name if take.writer is not None else ""
        self._event("acquisition", f"continued in {path.name}")
        self._finish_file()
        parts.number += 1
        self._open(path, take.info.note, overwrite=False)
        self._event("acquisition", f"part {parts.number}, continues {before}")

    def _finish_file(self) -> dict[str, Any]:
        """Finish the file; the take goes on without one."""
        result = self.take.finish(time.monotonic_ns())
        assert result is not None
        assert self.parts is not None
        self.result = self.parts.finished(result)
        self.take.writer = None
        return self.result

    def _new_take(self, writer: LogWriter | None, info: SessionInfo) -> None:
        self.take = Take(info, self.timebase, writer, self.motion, self._effects)
        self._base = self._seen
        # marks of the take before are at no time of this one
        self.marks = deque((replace(mark, at_ns=None) for mark in self.marks), _MARKS)

    def _fail(self, code: int, message: str) -> None:
        if not self.exit_code:
            self.exit_code, self.error = code, message
        self._reader.stop()
        if code == EXIT_INSTRUMENT:
            self._event("acquisition", message, 40)

    def _finish(self) -> None:
        if self.exit_code != EXIT_DISK and self.take.writer is not None:
            self._finish_file()


def _utc_minus_monotonic_ns() -> int:
    """System clock less monotonic clock; the least of a few readings, since this thread may be held up between two."""
    return min(time.time_ns() - time.monotonic_ns() for _ in range(_CLOCK_READINGS))

"""The acquisition's threads: one reads the port, decodes and stamps, one records and filters; requests queue for it.

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

import numpy as np

from imutui.instrument.clock import Clock, arrival_before
from imutui.instrument.crossbow import (
    BITS_PER_BYTE,
    PACKET_BYTES,
    Decoder,
    Discarded,
    GetPacket,
    Mode,
    Packet,
    Scaling,
    StartStream,
    encode,
)
from imutui.instrument.port import Port, PortError
from imutui.logbook import effects
from imutui.logbook.session import SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.session import connect, wire
from imutui.session.connect import Identity, InstrumentError
from imutui.session.info import default_path, effects_of, motion_of, session_info
from imutui.session.live import LiveView
from imutui.session.plan import Plan
from imutui.session.snapshot import snapshot
from imutui.session.take import Take, Timebase

EXIT_OWN = 1
EXIT_INSTRUMENT = 4
EXIT_DISK = 5
_FIRST_PACKET_S = 3.0
_POLL_S = 0.3
_CLOCK_STEP_NS = 100_000_000
_CLOCK_READINGS = 5
_EVENTS = 20


@dataclass(frozen=True, slots=True)
class Arrival:
    """A packet as the reader hands it on."""

    packet: Packet
    host_ns: int
    contiguous: bool
    bad_checksums: int
    discarded_bytes: int


@dataclass(frozen=True, slots=True)
class Missed:
    """A poll that was not answered in time."""

    host_ns: int


@dataclass(frozen=True, slots=True)
class Gone:
    """The line went away; the reader has ended."""

    message: str


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
        self.state = "connecting"
        self.error: str | None = None
        self.exit_code = 0
        self.result: dict[str, Any] | None = None
        self.started_ns = time.monotonic_ns()
        self.live = LiveView()
        self.events: deque[dict[str, str]] = deque(maxlen=_EVENTS)
        self.last_packet_ns = self.started_ns
        self.timebase = Timebase(_utc_minus_monotonic_ns())
        self.ended = threading.Event()
        self.streaming = threading.Event()
        self.take: Take
        self._motion = motion_of(plan)
        self._effects = effects_of(plan, self.info)
        self._port = port
        self._stop_reading = threading.Event()
        self._queue: queue.SimpleQueue[Arrival | Missed | Gone | Call] = queue.SimpleQueue()
        line_ns = PACKET_BYTES * BITS_PER_BYTE / port.baud * 1e9
        self._clock = Clock(line_ns, polled=plan.sampling == "polled")
        self._scaling = Scaling(plan.rate_range_dps, plan.accel_range_g)
        self._base = (0, 0)
        self._seen = (0, 0)
        self._silent = False
        self._stepped_ns = 0
        self._to_begin = plan.record
        self._disk_error: OSError | None = None
        self._threads = [
            threading.Thread(target=self._read, name="reader", daemon=True),
            threading.Thread(target=self._work, name="worker", daemon=True),
        ]

    def start(self) -> None:
        """Begin; raises OSError or InstrumentError if there is no disk, or no packet, to begin with."""
        self.take = Take(self.info, self.timebase, None, self._motion, self._effects)
        for thread in self._threads:
            thread.start()
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

    def snapshot(self, since: int) -> dict[str, Any]:
        """State for viewers."""
        return snapshot(self, since)

    def mark(self, text: str) -> None:
        """Write the operator's mark."""
        if self.take.writer is None:
            raise ValueError(
                "nothing is being recorded, so there is no file to put the mark into; start recording first"
            )
        self._event("mark", text)

    def record(self, note: str) -> str:
        """Begin a recording, and a new take with it; returns its path."""
        if self.take.writer is not None:
            raise ValueError(f"already recording to {self.take.writer.path}")
        self._begin(note, None)
        assert self.take.writer is not None
        return str(self.take.writer.path)

    def stop_recording(self) -> dict[str, Any]:
        """Finish the file; the acquisition, its filter included, goes on without one."""
        if self.take.writer is None:
            raise ValueError("nothing is being recorded")
        self.result = self.take.finish(time.monotonic_ns())
        assert self.result is not None
        self.take.writer = None
        self._event("acquisition", f"finished {self.result['log']}")
        return self.result

    def request_stop(self) -> None:
        """End: the reader stops, what it has read is used, the file is finished; safe from any thread and signal."""
        self.state = "stopping" if self.state in ("connecting", "running") else self.state
        self._stop_reading.set()

    # -- reader ---------------------------------------------------------------------------------------------------

    def _read(self) -> None:
        try:
            if self.plan.sampling == "polled":
                self._poll()
            else:
                self._stream()
            connect.stop_stream(self._port)
        except PortError as error:
            self._queue.put(Gone(str(error)))
        finally:
            self._stop_reading.set()

    def _stream(self) -> None:
        decoder = Decoder()
        decoder.expect_packets(Mode.SCALED, streaming=True)
        self._port.write(encode(StartStream()))
        contiguous = False
        while not self._stop_reading.is_set():
            data = self._port.read(decoder.missing)
            host_ns = time.monotonic_ns()
            events = decoder.feed(data) if data else decoder.quiet()
            # a packet that waited for the next one to vouch for it arrived before that one did
            newest = next((event.ticks for event in reversed(events) if isinstance(event, Packet)), 0)
            for event in events:
                if isinstance(event, Packet):
                    arrived = arrival_before(host_ns, event.ticks, newest)
                    self._queue.put(Arrival(event, arrived, contiguous, decoder.bad_checksums, decoder.discarded_bytes))
                    contiguous = True
                elif isinstance(event, Discarded):
                    contiguous = False

    def _poll(self) -> None:
        decoder = Decoder()
        start = time.monotonic()
        number = 0
        while not self._stop_reading.wait(max(0.0, start + number / self.plan.rate_hz - time.monotonic())):
            # a poll that took longer than a period is not made up for: the next one keeps to the grid
            number = max(number + 1, int((time.monotonic() - start) * self.plan.rate_hz) + 1)
            decoder.expect_packets(Mode.SCALED, streaming=False)
            self._port.write(encode(GetPacket()))
            packet, host_ns = self._await_packet(decoder)
            if packet is None:
                self._queue.put(Missed(host_ns))
            else:
                counters = decoder.bad_checksums, decoder.discarded_bytes
                self._queue.put(Arrival(packet, host_ns, False, *counters))

    def _await_packet(self, decoder: Decoder) -> tuple[Packet | None, int]:
        deadline = time.monotonic() + _POLL_S
        while time.monotonic() < deadline:
            data = self._port.read(decoder.missing)
            host_ns = time.monotonic_ns()
            for event in decoder.feed(data):
                if isinstance(event, Packet):
                    return event, host_ns
        return None, time.monotonic_ns()

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
                f"an error of imutui's own: {type(error).__name__}: {error}. {wire.log_path(self.plan.name)}"
                " has the details; please report them. What was recorded is on the disk up to the last flush.",
            )
        try:
            self._finish()
        except OSError as error:
            self._fail(EXIT_DISK, disk_message(self.take.writer, error))
        finally:
            self.state = "failed" if self.exit_code else "stopped"
            self._stop_reading.set()
            self._port.close()
            self.ended.set()
            self._turn_away()

    def _loop(self) -> None:
        next_second = time.monotonic() + 1.0
        while not (self._stop_reading.is_set() and not self._threads[0].is_alive() and self._queue.empty()):
            with contextlib.suppress(queue.Empty):  # nothing came; the seconds still pass
                self._handle(self._queue.get(timeout=max(0.0, min(0.1, next_second - time.monotonic()))))
            if time.monotonic() >= next_second:
                self._every_second()
                next_second = max(next_second + 1.0, time.monotonic())

    def _handle(self, item: Arrival | Missed | Gone | Call) -> None:
        match item:
            case Arrival():
                self._packet(item)
            case Missed():
                self.take.tally.lost_packets += 1
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
        stamp = self._clock.stamp(packet.ticks, arrival.host_ns, contiguous=arrival.contiguous)
        self.last_packet_ns = arrival.host_ns
        self._seen = arrival.bad_checksums, arrival.discarded_bytes
        self.take.tally.bad_checksums = self._seen[0] - self._base[0]
        self.take.tally.discarded_bytes = self._seen[1] - self._base[1]
        self.take.packet(packet, stamp, arrival.host_ns)
        counts = (*packet.rates, *packet.accels, packet.temperature)
        values = np.empty(7)
        values[:3] = self._scaling.rates_dps(packet.rates)
        values[3:6] = self._scaling.accels_g(packet.accels) * 1e3
        values[6] = self._scaling.temperature_degc(packet.temperature)
        self.live.add((stamp.monotonic_ns - self.started_ns) / 1e9, counts, values)
        if not self.streaming.is_set():
            self.streaming.set()
            self.state = "running"
            self._event("acquisition", f"connected to {self.info.port}, first packet")
        if stamp.lost:
            self._event("acquisition", f"{stamp.lost} packets lost")
        started, duration = self.take.started_ns, self.plan.duration_s
        if duration is not None and started is not None and stamp.monotonic_ns - started >= duration * 1e9:
            self.request_stop()

    def _every_second(self) -> None:
        now = time.monotonic_ns()
        self.take.every_second(now)
        silence = (now - self.last_packet_ns) / 1e9
        period = 1.0 / self.plan.rate_hz if self.plan.sampling == "polled" else 0.0
        silent = silence > max(1.0, 3.0 * period)
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
        self.take.event(name, text, now, level)

    def _begin(self, note: str, path: Path | None) -> None:
        info = replace(self.info, note=note)
        path = path or default_path(Path(self.plan.logs), info.serial_number, note)
        writer = LogWriter(path, info, self.plan.configuration(), time.time_ns(), overwrite=self.plan.overwrite)
        name, text = self.plan.reference_file
        if name:
            writer.attach(
                name, "text/csv" if name.endswith(".csv") else "application/toml", text.encode(), time.time_ns()
            )
        if self.plan.effects:
            writer.attach(effects.ATTACHMENT, effects.MEDIA_TYPE, self.plan.effects.encode(), time.time_ns())
        self._new_take(writer, info)
        self._event("acquisition", f"recording to {path.name}")

    def _new_take(self, writer: LogWriter | None, info: SessionInfo) -> None:
        self.take = Take(info, self.timebase, writer, self._motion, self._effects)
        self._base = self._seen

    def _fail(self, code: int, message: str) -> None:
        if not self.exit_code:
            self.exit_code, self.error = code, message
        self._stop_reading.set()
        if code == EXIT_INSTRUMENT:
            self._event("acquisition", message, 40)

    def _finish(self) -> None:
        result = self.take.finish(time.monotonic_ns()) if self.exit_code != EXIT_DISK else None
        self.result = result if result is not None else self.result


def _utc_minus_monotonic_ns() -> int:
    """System clock less monotonic clock; the least of a few readings, since this thread may be held up between two."""
    return min(time.time_ns() - time.monotonic_ns() for _ in range(_CLOCK_READINGS))


def disk_message(writer: LogWriter | None, error: OSError) -> str:
    """Words for a disk that does not take what is written."""
    if writer is None:
        return f"{error.filename or 'disk'}: {error.strerror or error}. Choose another folder or free some space."
    return (
        f"{writer.path}: {error.strerror or error}. The file holds everything up to its last flush"
        f" ({writer.size} bytes) and `imutui replay` reads it. Free some space, then record again."
    )

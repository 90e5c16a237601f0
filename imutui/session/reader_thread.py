"""The thread that owns the port: it reads, decodes and stamps packets, and sends the unit its commands meanwhile.

Nothing else happens in it, so that a slow disk or a slow filter never makes a stamp late. When the line is lost or the
unit falls silent it finds the same unit again.
"""

import os
import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from imutui.instrument.clock import arrival_before
from imutui.instrument.counter_spec import SPAN
from imutui.instrument.counts import DataPacket, RepeatedPackets
from imutui.instrument.driver import Driver, PacketStream, Poller
from imutui.instrument.frame_search import Discarded
from imutui.instrument.port import PortError
from imutui.session import reconnection
from imutui.session.reconnection import AmidStream, KnownUnit, LineLost, LineReturned, StillAway
from imutui.session.stream import Block, Broke, PacketArrival, Stamper, Why

BLOCK_NS = 500_000_000
"""Length of a block of a stream that no viewer looks at."""
_WATCHED_BLOCK_NS, _WATCHED_NS = 25_000_000, 2_000_000_000
_SCATTER_NS = 154_508_497


@dataclass(frozen=True, slots=True)
class ZeroingFinished:
    """The rate sensors were to be zeroed. Packets before and after do not belong together: none came in between."""

    argument: int  # as it was sent
    seconds: float | None  # until the unit said that it is done; None if it did not

    def in_words(self, before: np.ndarray | None, patience_s: float) -> str:
        """Return the outcome in words; `before` is what all channels read before, `patience_s` the longest wait."""
        if self.seconds is None:
            return (
                f"the unit did not say within {patience_s:.0f} s that its rate sensors are zeroed (argument"
                f" {self.argument}). Whether they are is not known: look at the rates when packets come again. If none"
                " come, power it off and on, then connect again."
            )
        done = "erased its stored zero" if self.argument == 0 else "zeroed its rate sensors"
        read = ""
        if before is not None:
            x, y, z = before[:3]
            read = f"; before, they read x {x:+.4f}, y {y:+.4f}, z {z:+.4f} deg/s"
        return f"the unit says that it has {done} ({self.seconds:.1f} s){read}. The filter begins anew."


@dataclass(frozen=True, slots=True)
class LeftOtherwise:
    """The unit was not left as it was found; `message` says how."""

    message: str


ReaderEvent = Block | Broke | ZeroingFinished | LineLost | StillAway | LineReturned | LeftOtherwise | Exception
"""What a reader emits; after an exception, which no code expects, nothing more."""


class Reader:
    """Reads packets until it is stopped.

    `host` is of a unit that is identified, set up, and sends nothing by itself; it is polled `poll_hz` times a second,
    or streams. `stamper` makes blocks of its packets. `emit` takes what happens, in the reader's thread. `known` is the
    unit to find again after the first packet; without it all ends when the line is lost.
    """

    def __init__(
        self,
        host: Driver,
        stamper: Stamper,
        poll_hz: float | None,
        emit: Callable[[ReaderEvent], None],
        known: KnownUnit | None = None,
    ) -> None:
        self.stopping = threading.Event()
        self.last_packet_ns = time.monotonic_ns()  # when it was read, or the last pause of packets was over
        self._host, self._port = host, host.port
        self._stamper = stamper
        self._poll_hz = poll_hz
        self._emit = emit
        self._known = known
        self._wake = threading.Event()
        self._silent = threading.Event()
        self._has_line = True
        self._found: str | None = None
        self._last: DataPacket | None = None
        self._in_time_ns = self.last_packet_ns
        self._has_mode = self._sends = True
        self._has_left = False
        self._zero_requests: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._follows = self._quiet = False  # of the next packet of a stream, see `PacketArrival`
        self._watched_until_ns = 0
        self._bad_checksums = 0
        self._discarded_bytes = 0
        self._counted = (0, 0)
        self._repeated = RepeatedPackets(SPAN * host.counter.tick_ns, 1e9 / host.stream_hz if host.stream_hz else 0.0)
        self._thread = threading.Thread(target=self._run, name="reader", daemon=True)

    @property
    def has_packet(self) -> bool:
        """Whether a packet has been read."""
        return self._last is not None

    def start(self) -> None:
        """Start the thread; it first sets the unit streaming, or polls it at once."""
        self._thread.start()

    def stop(self) -> None:
        """End soon; safe from any thread and signal."""
        self.stopping.set()
        self._wake.set()

    def is_alive(self) -> bool:
        """Return whether it may still emit something: no more once it is stopped while it has no line."""
        return self._thread.is_alive() and (self._has_line or not self.stopping.is_set())

    def join(self, timeout: float) -> None:
        """Wait until it has ended, `timeout` seconds at most."""
        self._thread.join(timeout)

    def zero(self, argument: int) -> None:
        """Zero the rate sensors; emits `ZeroingFinished`, unless the line goes away or it is stopped."""
        self._zero_requests.put(argument)
        self._wake.set()

    def ask_again(self) -> None:
        """Ask a unit that has long been silent who it is, and set it up as at the beginning."""
        self._silent.set()
        self._wake.set()

    def _run(self) -> None:
        try:
            self._acquire_until_stopped()
        except Exception as error:  # noqa: BLE001 - the worker ends the acquisition, and its file, as failed
            self._emit(error)
        finally:
            self.stopping.set()

    def _acquire_until_stopped(self) -> None:
        try:
            self._acquire()
            while not self.stopping.is_set():
                self._acquire()
        finally:
            self.stopping.set()
            # where it was stopped while the unit was looked for
            with suppress(PortError):
                self._leave()

    def _leave(self) -> None:
        """Leave the unit as it was found, once."""
        if self._has_left:
            return
        said = self._host.leave()
        self._has_left = True
        if said:
            self._emit(LeftOtherwise(said))

    def _acquire(self) -> None:
        """Take packets until it is stopped, or the line was lost and the unit found again."""
        try:
            if self._poll_hz is not None:
                self._poll(self._poll_hz)
            while not self.stopping.is_set():
                self._stream()
                self._do_as_asked()
            self._leave()
        except PortError as error:
            # what the decoder still held was cut off; what it had counted with its last packet stays
            self._bad_checksums, self._discarded_bytes = self._counted
            final = self._last is None or self._known is None or not self._known.returns
            if final:
                # it may be the unit that refuses, and the line that is well
                with suppress(PortError):
                    self._leave()
            self._lose(str(error), final=final)
            self._find_again(streams=self._poll_hz is None)

    def _lose(self, message: str, *, final: bool = False) -> None:
        """Emit that the unit is away; stop if that is final."""
        self._has_line = False
        # what was asked of the unit that went away is not asked of it when it is back
        while not self._zero_requests.empty():
            self._zero_requests.get()
        if final:
            self.stopping.set()
        self._emit(LineLost(message, self.last_packet_ns, final))

    def _find_again(self, *, streams: bool) -> None:
        """Wait until the unit is found again, or this is stopped."""
        if self._known is not None and not self.stopping.is_set():
            found = reconnection.find_again(self._host, self._known, self.stopping, self._emit, streams=streams)
            if found is not None:
                identity, self._found = found
                # one that had not said who it is may have done so now
                version = identity.version or self._known.identity.version
                self._known = replace(self._known, identity=replace(identity, version=version))
        self._has_line = not self.stopping.is_set()

    def _ask_silent_unit(self) -> None:
        """Ask a unit that has fallen silent who it is; packets that only came late are used."""
        silent_s = (time.monotonic_ns() - self.last_packet_ns) / 1e9
        stopped, self._sends = not self._sends, True
        if self._known is None or not (stopped or silent_s >= reconnection.ask_again_after_s(self._poll_hz)):
            return
        self._lose(f"no packets for {silent_s:.1f} s; the unit is asked again.")
        heard = reconnection.ask_silent(self._host, self._known, self.stopping)
        if self._poll_hz is None and not self.stopping.is_set():
            self._take_late(heard)
        self._find_again(streams=False)

    def _take_late(self, heard: bytes) -> None:
        """Hand on the packets among what came when the silence was over."""
        host_ns, decoder = time.monotonic_ns(), self._host.packets()
        events = [*decoder.feed(heard), *decoder.quiet()]
        if all(isinstance(event, Discarded) for event in events):
            return
        contiguous = False
        for event in events:
            if not isinstance(event, Discarded) and not self._repeated.take(event, host_ns, contiguous=contiguous):
                damage = self._damage(decoder)
                self._arrived(PacketArrival(event, host_ns, contiguous, not contiguous, True, *damage))
            contiguous = not isinstance(event, Discarded)
        self._release()
        self._count(decoder)

    def _stream(self) -> None:
        """Let the unit stream until there is something else to do.

        The time of each read is taken at once, and packets are decoded by the block: a thread that only reads when it
        is woken takes a fraction of the time.
        """
        decoder = self._host.packets()
        self._host.start()
        amid = AmidStream(self._host, decoder, self._known)
        reads, due_ns = list[tuple[int, bytes]](), 0
        self._follows = self._quiet = False
        try:
            while not self._wake.is_set():
                data = self._port.take()
                host_ns = time.monotonic_ns()
                if data:
                    reads.append((host_ns, data))
                    if host_ns < due_ns and self._last is not None:
                        continue
                self._decode(reads, decoder)
                reads, due_ns = [], self.next_block_ns(host_ns)
                if not data:
                    self._pause(host_ns, decoder, amid)
                self._stamper.due(host_ns)
                self._emit_blocks()
        finally:
            self._decode(reads, decoder)
            self._release()
        self._count(decoder)

    def _emit_blocks(self) -> None:
        for block in self._stamper.blocks():
            self._emit(block)

    def _release(self) -> None:
        """Hand on the packets that wait: none comes for a while that could make their stamps sure."""
        self._stamper.release()
        self._emit_blocks()

    def next_block_ns(self, now_ns: int) -> int:
        """Return when what comes from now on is decoded; each of several processes has instants of its own."""
        if now_ns < self._watched_until_ns:
            return now_ns + _WATCHED_BLOCK_NS
        phase = os.getpid() * _SCATTER_NS
        return now_ns + BLOCK_NS - (now_ns - phase) % BLOCK_NS

    def be_watched(self) -> None:
        """Emit short blocks for the next seconds: a viewer looks at packets as they come."""
        self._watched_until_ns = time.monotonic_ns() + _WATCHED_NS

    def _pause(self, host_ns: int, decoder: PacketStream, amid: AmidStream) -> None:
        """Handle a moment in which nothing came."""
        self._quiet = True
        if self._last is not None and amid.has_stopped(host_ns, self.last_packet_ns):
            self._sends = False
            self.ask_again()
        self._hand_on(decoder.pause(), host_ns, decoder, behind=False)

    def _decode(self, reads: list[tuple[int, bytes]], decoder: PacketStream) -> None:
        """Decode what was read and when, up to a packet's end at a time: what is behind that had come already."""
        for host_ns, data in reads:
            at = 0
            while at < len(data):
                end = at + decoder.missing
                self._hand_on(decoder.feed(data[at:end]), host_ns, decoder, behind=end < len(data))
                at = end

    def _hand_on(
        self, events: Sequence[DataPacket | Discarded], host_ns: int, decoder: PacketStream, *, behind: bool
    ) -> None:
        # a packet that waited for the next one to vouch for it arrived before that one did
        newest = 0
        if len(events) > 1:
            newest = next((event.ticks for event in reversed(events) if not isinstance(event, Discarded)), 0)
        for event in events:
            if isinstance(event, Discarded):
                self._follows = False
            else:
                alone = len(events) == 1
                arrived_ns = host_ns if alone else arrival_before(host_ns, event.ticks, newest, self._host.counter)
                if not self._repeated.take(event, arrived_ns, contiguous=self._follows):
                    damage = self._damage(decoder)
                    self._arrived(PacketArrival(event, arrived_ns, self._follows, self._quiet, behind, *damage))
                self._follows, self._quiet = True, False

    def _poll(self, hz: float) -> None:
        poller = self._host.poller(self._wake.is_set)
        start = time.monotonic()
        number = 0
        while not self.stopping.is_set():
            if self._wake.wait(max(0.0, start + number / hz - time.monotonic())):
                self._do_as_asked()
                continue
            # a poll that took longer than a period is not made up for: the next one keeps to the grid
            number = max(number + 1, int((time.monotonic() - start) * hz) + 1)
            try:
                answer = poller.poll()
            finally:
                if poller.unanswered:
                    self._emit(Broke(Why.UNANSWERED))
                self._repeated.count += poller.doubled
                poller.doubled = 0
            # a unit that is asked more often than it measures gives the same reading again
            if answer is None or self._repeated.take(answer.packet, answer.arrived_ns, asked=True):
                continue
            if not self._answers_as_after_power_up(answer.packet, poller):
                damage, requested_ns = self._damage(poller), answer.requested_ns
                self._arrived(
                    PacketArrival(answer.packet, answer.arrived_ns, False, True, False, *damage, requested_ns)
                )

    def _arrived(self, arrival: PacketArrival) -> None:
        packet, host_ns, behind = arrival.packet, arrival.host_ns, arrival.behind
        if self._known is not None and not self._has_mode:
            return  # of a unit that is to be set up first
        if self._is_as_after_power_up(packet, None if behind else host_ns):
            self._set_up_soon()
            return
        if self._found is not None:
            self._stamper.interrupt(lossy=True)
            self._emit(LineReturned(self._found))
            self._found = None
        self.last_packet_ns, self._last = host_ns, packet
        if not behind:
            self._in_time_ns = host_ns
        self._counted = arrival.bad_checksums, arrival.discarded_bytes
        self._stamper.take(arrival)
        if arrival.requested_ns is not None:
            self._emit_blocks()

    def _damage(self, counters: PacketStream | Poller) -> tuple[int, int, int]:
        """Return bad checksums, discarded bytes and doubled packets of the line so far."""
        bad, discarded = counters.bad_checksums, counters.discarded_bytes
        return self._bad_checksums + bad, self._discarded_bytes + discarded, self._repeated.count

    def _is_as_after_power_up(self, packet: DataPacket, in_time_ns: int | None) -> bool:
        """Whether a unit that streams forgot how it was set up; only one that is known can be set up again."""
        if self._poll_hz is not None or self._last is None or self._known is None:
            return False
        elapsed_s = None if in_time_ns is None else (in_time_ns - self._in_time_ns) / 1e9
        return self._host.has_forgotten(packet, self._last, elapsed_s)

    def _answers_as_after_power_up(self, packet: DataPacket, poller: Poller) -> bool:
        """Whether a polled unit forgot how it was set up: where a packet may say so, it is, and another asked for."""
        if not self._host.may_have_forgotten(packet) or not self._host.set_up():
            return False
        again = poller.poll()
        if again is None or not self._host.has_forgotten(packet, again.packet):
            return False
        self._set_up_soon()
        return True

    def _set_up_soon(self) -> None:
        """Have the unit, which forgot its mode and perhaps more, set up again before the next packet."""
        self._has_mode = False
        self._wake.set()

    def _count(self, decoder: PacketStream) -> None:
        """Keep a decoder's counters; what it still holds was cut off on purpose and counts for nothing."""
        self._bad_checksums += decoder.bad_checksums
        self._discarded_bytes += decoder.discarded_bytes

    def _do_as_asked(self) -> None:
        self._wake.clear()
        if self._silent.is_set():
            self._silent.clear()
            self._ask_silent_unit()
        if not self._has_mode and self._known is not None:
            self._has_mode = True
            self._lose(f"{self._host.as_after_power_up}; it is set up again.")
            self._find_again(streams=False)
        while not self.stopping.is_set() and not self._zero_requests.empty():
            self._zero(self._zero_requests.get())

    def _zero(self, argument: int) -> None:
        seconds = self._host.zero(argument, self.stopping.is_set)
        if seconds is None and not self.stopping.is_set():
            # said at once: what follows may take minutes
            self._zeroed(argument, None)
        # a unit that still averages is deaf, and it may have forgotten its mode
        while not self.stopping.is_set() and not self._host.set_up():
            self._host.stop()
        self.last_packet_ns = time.monotonic_ns()
        if seconds is not None:
            self._zeroed(argument, seconds)

    def _zeroed(self, argument: int, seconds: float | None) -> None:
        self._stamper.interrupt()
        self._emit(ZeroingFinished(argument, seconds))

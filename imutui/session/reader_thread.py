"""The thread that owns the port: it reads, decodes and stamps, and carries out what must be said to the unit meanwhile.

Nothing else happens in it, so that a slow disk or a slow filter never makes a stamp late.
"""

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from imutui.instrument.clock import arrival_before
from imutui.instrument.crossbow import Decoder, Discarded, GetPacket, Mode, Packet, StartStream, encode
from imutui.instrument.port import Port, PortError
from imutui.session import handshake, zeroing

_POLL_S = 0.3


@dataclass(frozen=True, slots=True)
class PacketArrival:
    """A packet as it was read."""

    packet: Packet
    host_ns: int
    contiguous: bool
    bad_checksums: int
    discarded_bytes: int


@dataclass(frozen=True, slots=True)
class PollUnanswered:
    """A poll that was not answered in time."""

    host_ns: int


@dataclass(frozen=True, slots=True)
class ZeroingFinished:
    """The rate sensors were to be zeroed. Packets before and after do not belong together: none came in between.

    Attributes
    ----------
    argument : int
        As it was sent.
    seconds : float or None
        Until the unit said that it is done; None if it did not.
    """

    argument: int
    seconds: float | None


@dataclass(frozen=True, slots=True)
class LineLost:
    """The line went away; the reader has ended."""

    message: str


ReaderEvent = PacketArrival | PollUnanswered | ZeroingFinished | LineLost


class Reader:
    """Reads packets until told to stop.

    Parameters
    ----------
    port : Port
        Open, the unit identified, in scaled mode, polled.
    poll_hz : float or None
        Requests a second; None to have the unit stream.
    emit : callable
        Takes what happens; called in the reader's thread.

    Attributes
    ----------
    last_packet_ns : int
        When the last packet was read, or the last pause of packets was over, monotonic.
    """

    def __init__(self, port: Port, poll_hz: float | None, emit: Callable[[ReaderEvent], None]) -> None:
        self.stopping = threading.Event()
        self.last_packet_ns = time.monotonic_ns()
        self._port = port
        self._poll_hz = poll_hz
        self._emit = emit
        self._wake = threading.Event()
        self._zero_requests: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._bad_checksums = 0
        self._discarded_bytes = 0
        self._thread = threading.Thread(target=self._run, name="reader", daemon=True)

    def start(self) -> None:
        """Start the thread; it first sets the unit streaming, or polls it at once."""
        self._thread.start()

    def stop(self) -> None:
        """Have it end soon; safe from any thread and signal."""
        self.stopping.set()
        self._wake.set()

    def is_alive(self) -> bool:
        """Whether it may still hand something on."""
        return self._thread.is_alive()

    def zero(self, argument: int) -> None:
        """Have it zero the rate sensors; `ZeroingFinished` comes of it, unless the line goes away or it is stopped."""
        self._zero_requests.put(argument)
        self._wake.set()

    def _run(self) -> None:
        try:
            if self._poll_hz is None:
                while not self.stopping.is_set():
                    self._stream()
                    self._zero_as_asked()
            else:
                self._poll(self._poll_hz)
            handshake.stop_stream(self._port)
        except PortError as error:
            self._emit(LineLost(str(error)))
        finally:
            self.stopping.set()

    def _stream(self) -> None:
        """Let the unit stream until there is something else to do."""
        decoder = Decoder()
        decoder.expect_packets(Mode.SCALED, streaming=True)
        self._port.write(encode(StartStream()))
        contiguous = False
        while not self._wake.is_set():
            data = self._port.read(decoder.missing)
            host_ns = time.monotonic_ns()
            events = decoder.feed(data) if data else decoder.quiet()
            # a packet that waited for the next one to vouch for it arrived before that one did
            newest = next((event.ticks for event in reversed(events) if isinstance(event, Packet)), 0)
            for event in events:
                if isinstance(event, Packet):
                    self._arrived(event, arrival_before(host_ns, event.ticks, newest), decoder, contiguous=contiguous)
                    contiguous = True
                elif isinstance(event, Discarded):
                    contiguous = False
        self._count(decoder)

    def _poll(self, hz: float) -> None:
        decoder = Decoder()
        start = time.monotonic()
        number = 0
        while not self.stopping.is_set():
            if self._wake.wait(max(0.0, start + number / hz - time.monotonic())):
                self._zero_as_asked()
                continue
            # a poll that took longer than a period is not made up for: the next one keeps to the grid
            number = max(number + 1, int((time.monotonic() - start) * hz) + 1)
            decoder.expect_packets(Mode.SCALED, streaming=False)
            self._port.write(encode(GetPacket()))
            packet, host_ns = self._await_packet(decoder)
            if packet is None:
                self._emit(PollUnanswered(host_ns))
            else:
                self._arrived(packet, host_ns, decoder, contiguous=False)

    def _await_packet(self, decoder: Decoder) -> tuple[Packet | None, int]:
        deadline = time.monotonic() + _POLL_S
        while time.monotonic() < deadline:
            data = self._port.read(decoder.missing)
            host_ns = time.monotonic_ns()
            for event in decoder.feed(data):
                if isinstance(event, Packet):
                    return event, host_ns
        return None, time.monotonic_ns()

    def _arrived(self, packet: Packet, host_ns: int, decoder: Decoder, *, contiguous: bool) -> None:
        self.last_packet_ns = host_ns
        bad = self._bad_checksums + decoder.bad_checksums
        discarded = self._discarded_bytes + decoder.discarded_bytes
        self._emit(PacketArrival(packet, host_ns, contiguous, bad, discarded))

    def _count(self, decoder: Decoder) -> None:
        """Keep a decoder's counters; what it still holds was cut off on purpose and counts for nothing."""
        self._bad_checksums += decoder.bad_checksums
        self._discarded_bytes += decoder.discarded_bytes

    def _zero_as_asked(self) -> None:
        self._wake.clear()
        while not self.stopping.is_set() and not self._zero_requests.empty():
            self._zero(self._zero_requests.get())

    def _zero(self, argument: int) -> None:
        seconds = zeroing.zero(self._port, argument, self.stopping.is_set)
        if seconds is None and not self.stopping.is_set():
            # said at once: what follows may take minutes
            self._emit(ZeroingFinished(argument, None))
        # a unit that still averages is deaf; and nobody says whether it remembers its mode
        while not self.stopping.is_set() and not handshake.set_scaled(self._port):
            handshake.stop_stream(self._port)
        self.last_packet_ns = time.monotonic_ns()
        if seconds is not None:
            self._emit(ZeroingFinished(argument, seconds))

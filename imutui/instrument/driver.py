"""What every instrument has: its data, and the dialogue with one unit over one port.

A `Driver` is the only code that writes to the port. It may block; the session sees packets only.
"""

import math
import re
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias

from filters.errors import InputError
from imutui.instrument.counter_spec import CounterSpec
from imutui.instrument.counts import COUNT_LIMITS, DataPacket, Scaling
from imutui.instrument.frame_search import Discarded, EventT, FrameDecoder
from imutui.instrument.port import Port
from imutui.plain_text import NAME_LIMIT, NOTE_LIMIT, one_line

REPLY_S = 1.0
"""How long a reply may take: units answer within about 10 ms, and a terminal server far away adds some tenths."""

_QUIET_S, _QUIET_LIMIT_S = 0.06, 1.0
_LEAST_PATIENCE_S, _MOST_PATIENCE_S = 0.1, 2.0
_NOTHING_CAME_S = 0.5
_REST_S = 0.3

PacketStream: TypeAlias = FrameDecoder[DataPacket]


class InstrumentError(Exception):
    """The instrument is absent, is another one, or does not behave; the message names the next step."""


@dataclass(frozen=True, slots=True)
class Identity:
    """What a unit reports about itself; a field is empty where the unit did not answer or has no such information."""

    serial_number: str
    version: str
    source: str = ""  # origin of a virtual unit's readings
    configuration: str = field(default="", compare=False)  # its configuration when it was found, in words
    # axes of its packets in its case as it is configured, as `filters.imu.parse_mount` reads them
    own_mount: str = field(default="", compare=False)

    @property
    def model(self) -> str:
        """Model in a version such as "IMU400CD-200 1.07"; empty if it names none."""
        named = re.match(r"[A-Z]{2,}[ -]?\d+[A-Z]*(-\d+)?", self.version.strip(), re.IGNORECASE)
        return named[0] if named else ""


def origin_of(text: str) -> tuple[str, str]:
    """Split a unit's text into its own, and the origin of a virtual unit's readings behind " from "; "" of a real one.

    A virtual unit names itself so: no simulated log may pass for a measured one.
    """
    own, _, source = text.partition(" from ") if "VIRTUAL" in text.upper() else (text, "", "")
    return one_line(own, NAME_LIMIT), one_line(source, NOTE_LIMIT)


class Driver(ABC):
    """A kind of instrument as class attributes, and the dialogue with one unit of it as methods.

    Every method that uses the port raises PortError if the line goes away.

    `port`: open.
    `rate_hz`: rate asked of the stream, Hz; None if packets are polled.
    """

    name: ClassVar[str]
    """Name on a command line."""
    models: ClassVar[tuple[str, ...]]
    """Beginnings of the models' names, in capitals."""
    model: ClassVar[str]
    """Model of a unit that does not report one."""
    is_one_model: ClassVar[bool] = False
    """True if every accepted unit is of `model`, whatever its version text is."""
    power_up_bauds: ClassVar[tuple[int, ...]]
    """Line speeds after power-up; the first one is tried first."""
    packet_bytes: ClassVar[int]
    """Length of a data packet on the line."""
    rates_hz: ClassVar[tuple[float, ...]]
    """Rates of a stream at which every packet is a sample."""
    most_rate_hz: ClassVar[float]
    """The highest of them."""
    accel_sign: ClassVar[int]
    """+1 if it reads specific force, -1 if its sign is the other."""
    mode: ClassVar[str]
    """Content of its packets, in two words."""
    mode_words: ClassVar[str]
    """Content of its packets, in a line."""
    counter: ClassVar[CounterSpec]
    """What the packets' counter counts."""
    rate_range_dps: ClassVar[float]
    """Range of the rate sensors, deg/s, unless the configuration has another."""
    accel_range_g: ClassVar[float]
    """Range of the accelerometers, g, unless the configuration has another."""
    count_limits: ClassVar[tuple[int, int]] = COUNT_LIMITS
    """Least and largest count; a reading there means "this or more"."""
    low_pass_loop_hz: ClassVar[float | None] = None
    """Rate of the loop that runs its first-order low-pass filters, Hz; None if its filters are others or can be set."""
    turns_axes: ClassVar[bool] = False
    """True if its configuration can turn the axes of its packets."""
    zeroes_rates: ClassVar[bool] = False
    """True if it has a command that zeroes its rate sensors."""
    status_names: ClassVar[Any] = None
    """Returns the names of the bits set in a status word; None if packets have no `counts.PacketDetails`."""
    as_after_power_up: ClassVar[str]
    """Sign of a unit that lost its setting, in words."""
    streams_from_power_up: ClassVar[bool] = False
    """True if it streams after power-up, so that a running stream is no proof that it kept power."""

    stream_hz = 0.0
    """Rate of the stream that the driver asked for, Hz; 0 if the unit has only one."""

    def __init_subclass__(cls) -> None:
        if hasattr(cls, "rates_hz"):
            cls.most_rate_hz = max(cls.rates_hz)

    def __init__(self, port: Port, rate_hz: float | None = None) -> None:
        self.port = port
        self._rate_hz = rate_hz

    # ---------------------------------------------------------------------------------------------------- of the kind

    @staticmethod
    @abstractmethod
    def scaling(rate_range_dps: float, accel_range_g: float) -> Scaling:
        """Return the scaling for these ranges."""

    @classmethod
    def gives(cls, rate_hz: float) -> bool:
        """Return True if a stream has this rate, so that each packet is a sample; else samples are means of packets."""
        return rate_hz in cls.rates_hz or rate_hz >= cls.most_rate_hz

    @classmethod
    def packets_hz(cls, rate_hz: float) -> float:
        """Return the nominal rate of packets for samples at a rate, Hz."""
        return min(rate_hz, cls.most_rate_hz) if cls.gives(rate_hz) else cls.most_rate_hz

    @classmethod
    def status_in_words(cls, word: int) -> str:
        """Return a status word and the meaning of its bits, such as "0x0002 (hardware error)"."""
        names: Sequence[str] = () if cls.status_names is None else cls.status_names(word)
        return f"0x{word:04X} ({', '.join(names) or 'nothing set'})"

    @classmethod
    def check_zeroing(cls, argument: int) -> None:
        """Raise InputError if the rate sensors cannot be zeroed with this argument."""
        raise InputError(f"an {cls.models[0]} has no command that zeroes its rate sensors; the filter has their biases")

    @staticmethod
    def zeroing_patience_s(argument: int) -> float:
        """Return how long a unit may take to zero its rate sensors, s."""
        return 0.0

    # ---------------------------------------------------------------------------------------------------- of one unit

    @abstractmethod
    def find(self) -> Identity:
        """Find the unit's speed and identify it, no more; raises InstrumentError if it does not answer."""

    @abstractmethod
    def answers(self, baud: int | None = None) -> bool:
        """Ask briefly whether such a unit is there, at one speed or at any that it may have.

        Another kind of unit at that speed makes nothing of the question. One at another speed receives other bytes
        than were sent, and may take them for commands.
        """

    def check_model(self, identity: Identity) -> None:  # noqa: B027 - most refuse none
        """Raise InstrumentError for a unit with other ranges or packets."""

    @abstractmethod
    def open(
        self,
        baud: int | None,
        *,
        accept: Callable[[Identity], None] = lambda identity: None,
        thorough: bool = True,
    ) -> Identity:
        """Find the unit, identify it, and set it up; it sends nothing by itself afterwards.

        `baud`: wanted speed; None to leave the unit at its own, where its kind has one.
        `accept`: raises InstrumentError to refuse a unit before any setting of it is changed.
        `thorough`: True to look for it at every speed.
        Raises InstrumentError if nothing answers, garbage answers, or another model does.
        """

    @abstractmethod
    def start(self) -> None:
        """Have the unit stream."""

    def stop(self, limit_s: float = _QUIET_LIMIT_S) -> bytes:
        """Stop the unit's stream, and wait for quiet for so long at most; return the bytes that came meanwhile."""
        self.port.write(self._stop_command)
        heard, began = b"", time.monotonic()
        last = began
        while time.monotonic() - began < limit_s and time.monotonic() - last < _QUIET_S:
            if data := self.port.read(64):
                heard, last = heard + data, time.monotonic()
        self.port.discard_input()
        return heard

    _stop_command: ClassVar[bytes]

    def leave(self) -> str:
        """Stop the unit and put its settings back.

        Returns what the unit does not take back, in words; "" if it is as it was found.
        """
        self.stop()
        return ""

    @abstractmethod
    def packets(self) -> PacketStream:
        """Return a new decoder of the stream."""

    @abstractmethod
    def poller(self, giving_up: Callable[[], bool]) -> "Poller":
        """Return an object that polls the unit; it waits no longer once `giving_up` returns True."""

    @abstractmethod
    def ask_for_life(self) -> None:
        """Send a question that any unit of the kind answers, without waiting: for one that has fallen silent."""

    @abstractmethod
    def ask_amid(self, identity: Identity) -> None:
        """Send a question that the unit answers without stopping its stream; the stream's decoder counts answers."""

    def may_have_forgotten(self, packet: DataPacket) -> bool:
        """Return True if a packet leaves open whether the unit lost its setting."""
        return False

    @abstractmethod
    def has_forgotten(self, packet: DataPacket, before: DataPacket, elapsed_s: float | None = None) -> bool:
        """Return True if a packet shows that the unit lost its setting, or is another one.

        `before`: the last packet that was right; `packet` arrived `elapsed_s` after it, or None if its arrival does
          not show when it was sent.
        """

    @abstractmethod
    def set_up(self) -> bool:
        """Set up a unit on a quiet line again; returns True if it confirms."""

    def zero(self, argument: int, stopping: Callable[[], bool]) -> float | None:
        """Have the rate sensors zeroed; returns the seconds until the unit confirmed, None if it did not."""
        return None


def exchange(
    port: Port,
    decoder: FrameDecoder[EventT],
    request: bytes,
    wanted: Callable[[EventT | Discarded], bool],
    patience_s: float = REPLY_S,
    giving_up: Callable[[], bool] = lambda: False,
) -> EventT | Discarded | None:
    """Send a request and read until an event is wanted; None if none comes in time, or `giving_up` returns True."""
    port.write(request)
    deadline = time.monotonic() + patience_s
    while True:
        data = port.read(decoder.missing)
        for event in decoder.feed(data) if data else decoder.pause():
            if wanted(event):
                return event
        if giving_up() or time.monotonic() > deadline:
            return None


@dataclass(frozen=True, slots=True)
class Answer:
    """A polled packet: when it was asked for and when its last byte had been read, monotonic ns."""

    packet: DataPacket
    requested_ns: int
    arrived_ns: int


class Poller:
    """Polls a unit for one packet at a time; an answer is never taken for the answer to a later poll.

    The unit answers one thing after the other. So when an answer is late, the poller asks something else that changes
    nothing: its answer means that no answer to an earlier request comes any more. Until then nothing else is asked, and
    a poll counts as lost only when its answer certainly did not come.

    `driver`: of a unit that is set up and sends nothing by itself.
    `giving_up`: returns True to stop waiting.
    `decoder`: makes events of the unit's bytes.
    `request`: bytes that ask for a packet, and the packet's class.
    `check`: bytes that ask something else, and a function that returns how many answers to that an event is.
    """

    def __init__(
        self,
        driver: Driver,
        giving_up: Callable[[], bool],
        decoder: FrameDecoder[Any],
        request: tuple[bytes, type[DataPacket]],
        check: tuple[bytes, Callable[[Any], int]],
    ) -> None:
        self._port, self._packet_bytes = driver.port, driver.packet_bytes
        self._giving_up = giving_up
        self._decoder = decoder
        self._request, self._packet = request
        self._check, self._answers = check
        self._patience_s = _LEAST_PATIENCE_S
        self._last: DataPacket | None = None
        self._unasked = 0  # packets
        self._answered_bytes = 0  # of answers to `check` that the decoder discards
        self.doubled = 0
        """Answers that came a second time."""
        self.unanswered = False
        """True if the last request was sent and has no answer; also after an error of the line."""

    @property
    def bad_checksums(self) -> int:
        """Answers that came damaged."""
        return self._decoder.bad_checksums

    @property
    def discarded_bytes(self) -> int:
        """Bytes that belonged to no answer."""
        return self._decoder.discarded_bytes - self._answered_bytes + self._unasked * self._packet_bytes

    def poll(self) -> Answer | None:
        """Poll a packet and wait for it; None if it certainly does not come, or the poller gives up.

        Raises PortError if the line goes away.
        """
        # what waits here came before the request, so it is no answer to it
        stray = self._port.read(waiting) if (waiting := self._port.waiting()) else b""
        events = [*self._decoder.feed(stray), *self._decoder.quiet()]
        again = sum(event == self._last for event in events)
        self.doubled += again
        self._unasked += sum(isinstance(event, self._packet) for event in events) - again
        self._count_answers(events)
        requested_ns = time.monotonic_ns()
        self.unanswered = True
        found = exchange(
            self._port, self._decoder, self._request, lambda event: isinstance(event, self._packet),
            self._patience_s, self._giving_up,
        )  # fmt: skip
        answer = self._first([found], requested_ns) or self._await_certainty(requested_ns)
        self.unanswered = answer is None
        if answer is not None:
            self._last = answer.packet
            # over a slow line the unit is not asked twice each time
            late_s = 2e-9 * (answer.arrived_ns - requested_ns)
            self._patience_s = min(max(_LEAST_PATIENCE_S, late_s, 0.5 * self._patience_s), _MOST_PATIENCE_S)
        return answer

    def _await_certainty(self, requested_ns: int) -> Answer | None:
        """Return the late answer, or None once it is certain that it does not come."""
        answer, asked, said = None, 0, 0
        came, since = False, -math.inf
        while not self._giving_up():
            now = time.monotonic()
            if not came and now - since > _NOTHING_CAME_S:
                self._port.write(self._check)
                asked, since = asked + 1, now
            data = self._port.read(self._decoder.missing)
            rested = came and not data and time.monotonic() - since > _REST_S
            events = self._decoder.feed(data) if data else self._decoder.quiet() if rested else []
            if data:
                came, since = True, time.monotonic()
            answer = answer or self._first(events, requested_ns)
            said += self._count_answers(events)
            # an answer that did not come with the others is lost, and so it is where only the packet came
            if said >= asked or (rested and (said or answer is not None)):
                break
            if rested:  # damaged bytes, and what was asked for perhaps among them: once more
                asked, came, since = 0, False, -math.inf
        return answer

    def _first(self, events: Sequence[Any], requested_ns: int) -> Answer | None:
        arrived_ns = time.monotonic_ns()
        packets = (Answer(event, requested_ns, arrived_ns) for event in events if isinstance(event, self._packet))
        return next(packets, None)

    def _count_answers(self, events: Sequence[Any]) -> int:
        """Return how often the unit has answered the other question."""
        answers = [event for event in events if self._answers(event)]
        self._answered_bytes += sum(len(event.data) for event in answers if isinstance(event, Discarded))
        return sum(map(self._answers, answers))

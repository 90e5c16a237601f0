"""The host side of a 440, 380 or 381: what the session asks for, said in frames.

The unit keeps its own speed. What is set is set in RAM only, and put back on leaving; nothing is written to EEPROM.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

from imutui.instrument.counter_spec import CounterSpec
from imutui.instrument.host import PATIENCE_S, QUICK_S, DataPacket, InstrumentError, PacketStream
from imutui.instrument.identity import Identity
from imutui.instrument.port import Port
from imutui.instrument.uut import readings
from imutui.instrument.uut.counter import COUNTS_PER_SECOND, CounterWatch
from imutui.instrument.uut.fields import QUIET, RATE_OF_DIVIDER, Field, fits_line, in_words, orientation_of
from imutui.instrument.uut.frame_search import FIXED_LENGTHS
from imutui.instrument.uut.messages import Memory, PacketS1, Ping, SetFields
from imutui.instrument.uut.payloads import encode
from imutui.instrument.uut.requests import Requests
from imutui.plain_text import NAME_LIMIT, NOTE_LIMIT, one_line

# "2, 3, 5 and 6" of the field BAUD, and those that only the 440 and the 380 have.
SPEEDS = (115200, 57600, 38400, 230400, 19200, 9600)
_QUICK_SPEEDS = SPEEDS[:4]
BARE_PING = b"UUPK"
""""The bare ping, without length and sum, must work too": an IMU400CD makes nothing of it."""

COUNTER = CounterSpec(1e9 / COUNTS_PER_SECOND, 1e-3, +1, may_count_packets=True)
"""Time, 65536 counts a second, so that it wraps each second; a count of packets on some."""

_S1 = int.from_bytes(b"S1", "big")
_UNKNOWN = 0xFFFF
_PING_S = 0.15
# other programs wait for about a second
_SLOW_PING_S = 1.5
_QUIET_S, _QUIET_LIMIT_S = 0.06, 1.0
_OWN = (Field.RATE_DIVIDER, Field.BAUD, Field.PACKET_TYPE, Field.LOW_PASS_5, Field.LOW_PASS_6, Field.ORIENTATION)


class UutHost:
    """See `host.Host`.

    `port`: open.
    `rate_hz`: asked rate of a stream: the unit sends at it if it can, else faster, to be averaged. None if packets are
      asked for.
    """

    as_after_power_up = "the unit sends other packets than it was told to, or its counter began anew, as after power-up"
    streams_from_power_up = True

    def __init__(self, port: Port, rate_hz: float | None = None) -> None:
        self.port = port
        self.counter = COUNTER
        self._rate_hz = rate_hz
        self._own: dict[int, int] = {}
        self._changed = False
        self._patience_s = PATIENCE_S
        self._divider = QUIET
        self._watch: CounterWatch | None = None

    @property
    def stream_hz(self) -> float:
        """Packets a second of the stream; 0 if packets are asked for."""
        return float(RATE_OF_DIVIDER.get(self._divider, 0))

    def find(self) -> Identity:
        """Find the unit's speed and ask who it is."""
        self._find_speed(_QUICK_SPEEDS, _PING_S)
        return self._identify(Requests(self.port))

    def answers(self, baud: int | None = None) -> bool:
        """Whether such a unit streams or answers at a speed, or at any that it may have."""
        try:
            self._find_speed(SPEEDS if baud is None else (baud,), _PING_S, bare=True)
        except InstrumentError:
            return False
        return True

    def check_model(self, identity: Identity) -> None:
        """Refuse none: whatever gives packets S1 has their scales."""

    def open(
        self,
        baud: int | None,
        *,
        accept: Callable[[Identity], None] = lambda identity: None,
        thorough: bool = True,
        patience_s: float = PATIENCE_S,
    ) -> Identity:
        """Find the unit, identify it, read its fields and set its type of packet; it is quiet afterwards."""
        speeds = SPEEDS if thorough else _QUICK_SPEEDS
        likely = dict.fromkeys((self.port.baud, baud or SPEEDS[0], *speeds))
        self._find_speed(likely, min(patience_s, _PING_S), patience_s if thorough else 0.0)
        requests = Requests(self.port, patience_s)
        identity = self._identify(requests)
        accept(identity)
        own = requests.fields(_OWN)
        if Field.PACKET_TYPE not in own or Field.RATE_DIVIDER not in own:
            raise InstrumentError(f"{self.port.name}: the unit does not say its configuration. Power it off and on.")
        # found again, it may have what was set here still
        self._own = self._own or own
        self._divider = self._divider_for(self._rate_hz)
        self._changed = True
        self.stop()
        if not requests.put({Field.PACKET_TYPE: _S1}) or requests.fields((Field.PACKET_TYPE,)).get(3) != _S1:
            raise InstrumentError(f"{self.port.name}: the unit refuses packets of type S1, so it gives no readings.")
        self._patience_s = max(QUICK_S, 3.0 * requests.slowest_s)
        return self._as_configured(identity)

    def start(self) -> None:
        """Have the unit stream; whether it does is seen by what comes."""
        self._watch = CounterWatch(RATE_OF_DIVIDER[self._divider])
        self.port.write(encode(SetFields(Memory.RAM, ((Field.RATE_DIVIDER, self._divider),))))

    def stop(self) -> None:
        """Have it send nothing by itself."""
        self.port.write(encode(SetFields(Memory.RAM, ((Field.RATE_DIVIDER, QUIET),))))
        began = last = time.monotonic()
        while time.monotonic() - last < _QUIET_S and time.monotonic() - began < _QUIET_LIMIT_S:
            last = time.monotonic() if self.port.read(64) else last
        self.port.discard_input()

    def leave(self) -> str:
        """Put its own type and rate of packets back, if they were changed."""
        if not self._changed:
            return ""
        self.stop()
        requests = Requests(self.port, self._patience_s)
        fields = [int(field) for field in (Field.PACKET_TYPE, Field.RATE_DIVIDER) if field in self._own]
        own = {field: self._own[field] for field in fields}
        # both at once: one of them may not go with what the other is now
        requests.put(own)
        left = requests.fields(tuple(fields))
        # of one that does not answer any more nothing else is asked: whoever stops waits for this
        if left and left != own:
            for field in fields:
                requests.put({field: own[field]})
            left = requests.fields(tuple(fields))
        if left and left != own and requests.fields(tuple(fields), Memory.EEPROM) == own:
            # some do not take in mid-work what they come with: with a restart they do
            left = own if requests.reset() else left
        self._changed = False
        if left == own:
            return ""
        has = f"it has {in_words(left)}" if left else "it does not say what it has"
        return f"the unit was found with {in_words(own)} and does not take that back: {has} until its power goes"

    def packets(self) -> readings.Packets:
        """What makes packets of the stream's bytes."""
        return readings.Packets(
            f"{self.port.name}: the unit refuses a stream of {RATE_OF_DIVIDER.get(self._divider, 0)} Hz."
            " Ask for another rate: --rate."
        )

    def poller(self, giving_up: Callable[[], bool]) -> readings.Poller:
        """What asks for packets one by one."""
        return readings.Poller(self.port, giving_up)

    def ask_for_life(self) -> None:
        """Ping, without waiting for the answer."""
        self.port.write(encode(Ping()))

    def ask_amid(self, packets: PacketStream, identity: Identity) -> None:
        """Ping: "replies are interleaved with the continuous packets"."""
        del packets, identity
        self.ask_for_life()

    def may_have_forgotten(self, packet: DataPacket) -> bool:
        """Never: a packet that was asked for is of the type that was asked for."""
        return False

    def has_forgotten(self, packet: DataPacket, before: DataPacket, elapsed_s: float | None = None) -> bool:
        """Whether packets are of another type or rate than the unit was told, or their counter began anew."""
        del before
        if isinstance(packet, readings.DataPacket) and not isinstance(packet.source, PacketS1):
            return True
        return self._watch is not None and self._watch.began_anew(packet.ticks, elapsed_s)

    def set_up(self) -> bool:
        """Set the type of packet anew; whether the unit has taken it."""
        return Requests(self.port, QUICK_S).put({Field.PACKET_TYPE: _S1})

    def zero(self, argument: int, stopping: Callable[[], bool]) -> float | None:
        """Do nothing: the unit has no such command, which `instrument.check_zeroing` has said before."""
        return None

    def _find_speed(self, speeds: Iterable[int], wait_s: float, longest_s: float = 0.0, *, bare: bool = False) -> None:
        """Find the speed at which the unit answers a ping, soon or at last with patience; leave the port at it."""
        usual = list(speeds)
        waits = [(speed, wait_s) for speed in usual]
        slow = [(speed, min(longest_s, _SLOW_PING_S)) for speed in usual if speed in _QUICK_SPEEDS and longest_s]
        # "a frame must arrive within 4 s": what somebody left in the unit that was cut off has been given up at last
        for speed, patience_s in (*waits, *slow, *(waits if slow else ())):
            self.port.set_baud(speed)
            self.port.discard_input()
            # before the whole one: the unit may have only that
            self.port.write(BARE_PING)
            requests = Requests(self.port)
            if requests.hear_frame(patience_s) if bare else requests.ping(patience_s):
                return
        raise InstrumentError(
            f"{self.port.name}: no answer to a ping as an IMU381 gives it (tried"
            f" {', '.join(map(str, SPEEDS))} baud). Check that the unit has power, that transmit and receive are not"
            " swapped, that its line is the serial one, and that this is its port."
        )

    def _identify(self, requests: Requests) -> Identity:
        said, version = requests.identification(), requests.version()
        text = "" if said is None else said.text
        number = "" if version is None else f" {version.text}"
        source = text.partition(" from ")[2] if "VIRTUAL" in text.upper() else ""
        return Identity(
            "" if said is None else str(said.serial_number),
            one_line(text.partition(" from ")[0] + number, NAME_LIMIT),
            one_line(source, NOTE_LIMIT),
            requests.slowest_s,
        )

    def _as_configured(self, identity: Identity) -> Identity:
        """The same unit with what it said of its own fields."""
        orientation = orientation_of(self._own.get(Field.ORIENTATION, _UNKNOWN))
        own_mount = "" if orientation is None else orientation.mount
        return replace(identity, configuration=one_line(in_words(self._own), NOTE_LIMIT), own_mount=own_mount)

    def _divider_for(self, rate_hz: float | None) -> int:
        """Divider of the asked rate; of the fastest one that the line carries where the unit has no such rate."""
        fits = {
            hz: divider
            for divider, hz in RATE_OF_DIVIDER.items()
            if fits_line(hz, FIXED_LENGTHS[b"S1"], self.port.baud)
        }
        if rate_hz is None:
            return QUIET
        exact = next((divider for hz, divider in fits.items() if hz == rate_hz), None)
        if exact is not None:
            return exact
        if not fits or max(fits) < rate_hz:
            raise InstrumentError(
                f"{self.port.name}: the line of {self.port.baud} baud does not carry {rate_hz:g} Hz; it carries"
                f" {max(fits, default=0):g} Hz: --rate."
            )
        return fits[max(fits)]

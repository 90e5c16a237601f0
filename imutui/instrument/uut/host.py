"""The host side of a 440, 380 or 381: what the session asks for, said in frames, and the family's data.

The unit keeps its own speed. What is set is set in RAM only, and put back on leaving; nothing is written to EEPROM.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TypeVar

from filters.errors import InputError
from imutui.instrument import names
from imutui.instrument.counter_spec import CounterSpec
from imutui.instrument.counts import DataPacket
from imutui.instrument.frame_search import Discarded
from imutui.instrument.host import (
    PATIENCE_S,
    QUICK_S,
    Host,
    Identity,
    InstrumentError,
    PacketStream,
    Poller,
    await_event,
)
from imutui.instrument.instrument import Instrument
from imutui.instrument.port import Port, PortError
from imutui.instrument.uut.counter import COUNTS_PER_SECOND, CounterWatch
from imutui.instrument.uut.decoder import BARE_PING, Decoder, frame_decoder
from imutui.instrument.uut.fields import QUIET, RATE_OF_DIVIDER, Field, fits_line, in_words, orientation_of
from imutui.instrument.uut.frames import FIXED_LENGTHS, OVERHEAD_BYTES, Frame, framed
from imutui.instrument.uut.messages import (
    SCALING,
    SET,
    Fields,
    FieldsSet,
    GetFields,
    GetPacket,
    Identification,
    Measurement,
    Memory,
    OtherFrame,
    PacketS0,
    PacketS1,
    Ping,
    Refused,
    Reply,
    Request,
    Reset,
    SetFields,
    Version,
    encode,
    frame_of,
    names_of_bits,
    read_reply,
)
from imutui.plain_text import NAME_LIMIT, NOTE_LIMIT, one_line

# "2, 3, 5 and 6" of the field BAUD, and those that only the 440 and the 380 have.
SPEEDS = (115200, 57600, 38400, 230400, 19200, 9600)
_QUICK_SPEEDS = SPEEDS[:4]
COUNTER = CounterSpec(1e9 / COUNTS_PER_SECOND, 1e-3, +1)
"""Time, 65536 counts a second, so that it wraps each second."""

_S1 = int.from_bytes(b"S1", "big")
_UNKNOWN = 0xFFFF
_PING_S = 0.15
# other programs wait for about a second
_SLOW_PING_S = 1.5
_QUIET_S, _QUIET_LIMIT_S = 0.06, 1.0
_OWN = (Field.RATE_DIVIDER, Field.BAUD, Field.PACKET_TYPE, Field.LOW_PASS_5, Field.LOW_PASS_6, Field.ORIENTATION)

ReplyT = TypeVar("ReplyT", bound=Reply)


@dataclass(slots=True)
class Requests:
    """Asks one thing after the other, while packets of a stream may come in between: replies are told by their type."""

    port: Port  # at the unit's speed
    patience_s: float = PATIENCE_S  # how long to wait for a reply
    slowest_s: float = 0.0  # how long the slowest reply so far took

    def ping(self, patience_s: float) -> bool:
        """Whether the unit answers a ping."""
        return self.ask(Ping(), Ping, patience_s=patience_s, tries=1) is not None

    def hear_unit(self, patience_s: float) -> bool:
        """Whether a unit is heard: a whole frame of a stream, or one that answers the ping that was sent, and more."""
        found = await_event(self.port, Decoder(), lambda event: not isinstance(event, Discarded), patience_s)
        return found is not None and (not isinstance(found, Ping) or self.answers_questions())

    def answers_questions(self) -> bool:
        """Whether a question is answered soon; a line that echoes returns a ping, which looks like the answer to it."""
        said = self.ask(GetPacket(b"ID"), Identification, patience_s=QUICK_S, tries=1)
        return said is not None or self.ask(GetPacket(b"VR"), Version, patience_s=QUICK_S, tries=1) is not None

    def fields(self, ids: tuple[int, ...], memory: Memory = Memory.RAM) -> dict[int, int]:
        """Fields in force, or those of the next power-up, as far as there are such."""
        reply = self.ask(
            GetFields(memory, ids),
            Fields,
            lambda reply: reply.memory is memory and dict(reply.values).keys() <= set(ids),
        )
        return {} if reply is None else dict(reply.values)

    def put(self, values: dict[int, int]) -> bool:
        """Put fields in force, until the next power-up; whether the unit has taken all of them."""
        # the reply of a slow unit may be that to an earlier request, of other fields
        reply = self.ask(
            SetFields(Memory.RAM, tuple(values.items())),
            FieldsSet,
            lambda reply: reply.memory is Memory.RAM and set(reply.ids) <= values.keys(),
        )
        return reply is not None and set(values) <= set(reply.ids)

    def ask(
        self,
        request: Request,
        kind: type[ReplyT],
        fits: Callable[[ReplyT], bool] = lambda reply: True,
        patience_s: float | None = None,
        tries: int = 2,
    ) -> ReplyT | None:
        """Send a request and wait for its reply; None if it does not come, or the unit refuses."""
        refusal = Refused(frame_of(request).type)
        for _ in range(tries):
            began = time.monotonic()
            self.port.write(encode(request))
            found = await_event(
                self.port,
                Decoder(),
                lambda event: event == refusal or (isinstance(event, kind) and fits(event)),
                self.patience_s if patience_s is None else patience_s,
            )
            if isinstance(found, kind):
                self.slowest_s = max(self.slowest_s, time.monotonic() - began)
                return found
            if found is not None:
                return None
        return None


class UutHost(Host):
    """See `host.Host`. The bare ping, without length and sum, must work too: an IMU400CD makes nothing of it.

    `rate_hz`: asked rate of a stream: the unit sends at it if it can, else faster, to be averaged. None if packets are
      asked for.
    """

    as_after_power_up = "the unit sends other packets than it was told to, or its counter began anew, as after power-up"
    streams_from_power_up = True
    counter = COUNTER

    def __init__(self, port: Port, rate_hz: float | None = None) -> None:
        super().__init__(port)
        self._rate_hz = rate_hz
        self._own: dict[int, int] = {}
        self._changed = False
        self._patience_s = PATIENCE_S
        self._divider = QUIET
        self._watch: CounterWatch | None = None

    def find(self) -> Identity:
        self._find_speed(_QUICK_SPEEDS, _PING_S)
        return self._identify(Requests(self.port))

    def answers(self, baud: int | None = None) -> bool:
        try:
            self._find_speed(SPEEDS if baud is None else (baud,), _PING_S, bare=True)
        except InstrumentError:
            return False
        return True

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
        self.stream_hz = float(RATE_OF_DIVIDER.get(self._divider, 0))
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
            left = own if requests.ask(Reset(), Reset, tries=1) else left
        self._changed = False
        if left == own:
            return ""
        has = f"it has {in_words(left)}" if left else "it does not say what it has"
        return f"the unit was found with {in_words(own)} and does not take that back: {has} until its power goes"

    def packets(self) -> PacketStream:
        return frame_decoder(self._streamed)

    def _streamed(self, frame: Frame) -> Measurement | Discarded | None:
        """What the session takes of a frame in a stream; raises PortError if the unit refuses to stream."""
        match read_reply(frame):
            case (PacketS0() | PacketS1()) as packet:
                return packet
            case Refused(kind) if kind == SET[Memory.RAM]:
                raise PortError(
                    f"{self.port.name}: the unit refuses a stream of {self.stream_hz:g} Hz."
                    " Ask for another rate: --rate."
                )
            case OtherFrame():  # nobody has asked for it: S2, perhaps, or attitudes
                return Discarded(framed(frame), bad_checksum=False)
        return None

    def poller(self, giving_up: Callable[[], bool]) -> Poller:
        request, check = (encode(GetPacket(b"S1")), PacketS1), (encode(Ping()), Ping)
        return Poller(self.port, giving_up, Decoder(), request, check)

    def ask_for_life(self) -> None:
        self.port.write(encode(Ping()))

    def ask_amid(self, identity: Identity) -> None:
        """Ping: "replies are interleaved with the continuous packets"."""
        self.ask_for_life()

    def has_forgotten(self, packet: DataPacket, before: DataPacket, elapsed_s: float | None = None) -> bool:
        """Whether packets are of another type or rate than the unit was told, or their counter began anew."""
        if isinstance(packet, PacketS0):
            return True
        return self._watch is not None and self._watch.began_anew(packet.ticks, elapsed_s)

    def set_up(self) -> bool:
        return Requests(self.port, QUICK_S).put({Field.PACKET_TYPE: _S1})

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
            if requests.hear_unit(patience_s) if bare else requests.ping(patience_s):
                return
        raise InstrumentError(
            f"{self.port.name}: no answer to a ping as an IMU381 gives it (tried"
            f" {', '.join(map(str, SPEEDS))} baud). Check that the unit has power, that transmit and receive are not"
            " swapped, that its line is the serial one, and that this is its port."
        )

    def _identify(self, requests: Requests) -> Identity:
        said = requests.ask(GetPacket(b"ID"), Identification)
        version = requests.ask(GetPacket(b"VR"), Version)
        if said is None and version is None and not requests.fields(_OWN):
            raise InstrumentError(
                f"{self.port.name}: a ping comes back, but no question is answered. The device, or its adapter, echoes"
                " what is sent. Name the unit's own port."
            )
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


def check_zeroing(argument: int) -> None:
    """Refuse to zero the rate sensors.

    Raises InputError: always.
    """
    raise InputError("an IMU381 has no command that zeroes its rate sensors; take their biases from the filter")


IMU381 = Instrument(
    name=names.IMU381,
    models=("IMU381", "IMU380", "DMU380", "DMU381", "IMU440"),
    model="IMU381ZA",
    power_up_bauds=SPEEDS[:4],
    packet_bytes=FIXED_LENGTHS[b"S1"] + OVERHEAD_BYTES,
    rates_hz=tuple(map(float, RATE_OF_DIVIDER.values())),
    accel_sign=1,
    turns_axes=True,
    mode="packets S1",
    mode_words="packets S1: rates, forces, four temperatures, status word",
    counter=COUNTER,
    # what the words of all of them hold: the sensors of each are good for less
    rate_range_dps=630.0,
    accel_range_g=10.0,
    scaling=lambda rate_range_dps, accel_range_g: SCALING,
    check_zeroing=check_zeroing,
    status_names=names_of_bits,
    host=UutHost,
)
"""Aceinna's IMU381, MEMSIC's IMU380, Crossbow's IMU440."""
